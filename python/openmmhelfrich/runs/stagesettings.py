"""The kinds of stages, as a configuration describes them: the keys of each, their checks, and what the rest of a run
asks it.

What a stage does is in :mod:`.stages`, where each of these has its counterpart.
"""

import math
from abc import abstractmethod
from collections.abc import Iterable
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, TypeVar

from pydantic import Field, PrivateAttr, model_validator

from .sections import GREATEST_COUNT, Conditions, Force, StepSize, Temperature

Own = TypeVar("Own", bound="StageSettings")


class StageSettings(Conditions):
    """A part of a run.  Targets, moduli and the like that it gives stay for the stages that follow.

    Attributes
    ----------
    isMonteCarlo : bool
        whether its steps are those of Monte Carlo, which rates of acceptance are of
    isSteady : bool
        whether its conditions stay what they are at its beginning
    isGradual : bool
        whether it leads to the moduli and the like that it gives, rather than beginning with them
    hasPath : bool
        whether it leads along a path of windows, whose averages are results of the run
    """

    isMonteCarlo: ClassVar[bool] = True
    isSteady: ClassVar[bool] = False
    isGradual: ClassVar[bool] = False
    hasPath: ClassVar[bool] = False

    _isAdded: bool = PrivateAttr(False)
    name: str | None = Field(None, min_length=1, description="what it is called while it runs; its kind by default")
    kind: str

    @property
    def title(self) -> str:
        """What to call the stage."""
        return self.name or self.kind

    @property
    def isAdded(self) -> bool:
        """Whether a run has added it by itself, so that it is not among the stages that its user numbers."""
        return self._isAdded

    def added(self: Own) -> Own:
        """Return the stage as one that a run adds by itself."""
        self._isAdded = True
        return self

    @property
    def returns(self) -> bool:
        """Whether it ends with the conditions that it began with, whatever it gives."""
        return False

    @property
    @abstractmethod
    def totalSteps(self) -> int:
        """The number of Monte Carlo steps."""

    @property
    def longestInterval(self) -> float:
        """The largest number of steps between rows of the table with which the stage can be averaged."""
        return math.inf

    def lastPart(self, whole: str) -> str:
        """Return what is averaged of it, whatever the stage is called."""
        return f"second half of {whole}"

    def suddenTargets(self, start: dict[str, float], end: dict[str, float]) -> dict[str, float]:
        """Return the targets, of those at its start and at its end, to which its first step would bring a membrane."""
        return end

    def extended(self, steps: int) -> list[Any]:
        """Return the stages that take this one's place, as a run's last, if the run is to make more steps."""
        return [self, SampleStage(kind="sample", steps=steps)]


class MinimizeStage(StageSettings):
    """Finds a minimum of the energy near by, for its targets: L-BFGS takes turns with flips at zero temperature.

    It counts as one step.
    """

    isMonteCarlo = False

    kind: Literal["minimize"] = Field(description="which kind of stage")
    fluid: bool = Field(
        True,
        description="flip edges where this lowers the energy, and soften penalties that are far from their targets for "
        "a while; false keeps the triangles as they are",
    )
    max_iterations: int = Field(
        10000,
        ge=1,
        le=GREATEST_COUNT,
        description="of L-BFGS, at which to stop; shapes of 642 vertices that leave a branch, and flip on their way, "
        "took up to 30000, and to deflate a sphere of 2562 vertices to a reduced volume of 0.8 took 50000",
    )
    tolerance: Force | None = Field(
        None,
        gt=0,
        description="root mean square of the forces at which to stop, in kT per unit of length; by default kappa_B "
        "l/(4A), with the mean edge length l and the area A, below which long waves hardly move",
    )
    multilevel_weight: float = Field(
        0.0,
        ge=0,
        le=1000,
        description="above 0, vertices move together in waves, which takes a third of the iterations at 642 vertices, "
        "and a fortieth at 10242; 0 moves them one by one",
    )
    within_bounds: bool = Field(
        False,
        description="end with every edge within the tether's bounds, by a firmer tether for a while, or stop with an "
        "error",
    )

    @property
    def totalSteps(self) -> int:
        return 1

    def suddenTargets(self, start: dict[str, float], end: dict[str, float]) -> dict[str, float]:
        return {}  # far from them it softens the penalties


class SampleStage(StageSettings):
    """Samples at a temperature; the targets that it gives hold from its first step."""

    isSteady = True

    kind: Literal["sample"] = Field(description="which kind of stage")
    steps: int = Field(1000, ge=1, description="number of Monte Carlo steps")
    temperature: Temperature | None = Field(None, gt=0, description="in K; that of [sampling] by default")
    step_size: StepSize = Field(None, description='in ps, or "auto"; that of [sampling] by default')

    @property
    def totalSteps(self) -> int:
        return self.steps

    def extended(self, steps: int) -> list[Any]:
        return [self.model_copy(update={"steps": self.steps + steps})]


class ApproachStage(StageSettings):
    """Leads area, volume and area difference to its targets, and moduli and the like to what it gives, a little with
    each step, while the membrane follows.  A run adds such a stage by itself where one that samples or anneals would
    begin far from its targets.
    """

    isGradual = True

    kind: Literal["approach"] = Field(description="which kind of stage")
    steps: int = Field(1000, ge=1, description="number of Monte Carlo steps")
    temperature: Temperature | None = Field(None, gt=0, description="in K; that of [sampling] by default")

    @model_validator(mode="after")
    def _goal(self) -> "ApproachStage":
        if not self.targetNames() and not self.conditions():
            raise ValueError(f"has no target to go to; give one of {', '.join(Conditions.model_fields)}")
        return self

    @property
    def totalSteps(self) -> int:
        return self.steps

    def suddenTargets(self, start: dict[str, float], end: dict[str, float]) -> dict[str, float]:
        return {}


class AnnealStage(StageSettings):
    """Cools: T(n) = max(T_0 exp(-rate (n-n_0)), T_min) at the stage's step n, for trajectories and flips alike; the
    step size follows.
    """

    kind: Literal["anneal"] = Field(description="which kind of stage")
    steps: int = Field(1000, ge=1, description="number of Monte Carlo steps")
    start_temperature: Temperature | None = Field(None, gt=0, description="T_0 in K; that of [sampling] by default")
    end_temperature: Temperature | None = Field(None, gt=0, description="T_min in K; needed where there is no table")
    rate: float | None = Field(
        None, ge=0, description="lambda, per step; by default such that T_min is reached with the last step"
    )
    cooling_start: int = Field(0, ge=0, description="n_0, the stage's step at which cooling begins")
    table: list[list[Temperature]] | None = Field(
        None, min_length=1, description="instead: pairs [step, temperature in K], between which T is linear"
    )
    multilevel_weight: float | None = Field(
        None, ge=0, le=1000, description="of the momenta on coarser meshes; that of [sampling] by default"
    )

    @model_validator(mode="after")
    def _schedule(self) -> "AnnealStage":
        exponential = [
            name for name in ("start_temperature", "end_temperature", "rate") if getattr(self, name) is not None
        ]
        if self.table is None:
            if self.end_temperature is None:
                raise ValueError("end_temperature is missing; give it or a table of temperatures")
            if self.cooling_start >= self.steps:
                raise ValueError(
                    f"cooling_start is {self.cooling_start}; it must be less than the number of steps, {self.steps}"
                )
        elif exponential:
            raise ValueError(f"table and {exponential[0]} are both given; give one of them")
        else:
            _checkTable(self.table)
        return self

    @property
    def totalSteps(self) -> int:
        return self.steps


def givenConditions(stages: Iterable[StageSettings]) -> list[str]:
    """Return the names of the conditions that stages give, in their order."""
    return list(dict.fromkeys(name for stage in stages for name in stage.conditions()))


def checkCooling(stages: Iterable[StageSettings], temperature: float) -> None:
    """Raise a ValueError if a stage would cool to more than it begins with, a temperature where it says nothing."""
    for i, stage in enumerate(stages):
        if isinstance(stage, AnnealStage) and stage.end_temperature is not None:
            start, key = stage.start_temperature, "start_temperature"
            if start is None:
                start, key = temperature, "temperature of [sampling]"
            if stage.end_temperature > start:
                raise ValueError(
                    f"stage {i + 1} ({stage.kind}) end_temperature is {stage.end_temperature:g} K; it must be at most "
                    f"the {key}, {start:g} K"
                )


class ContinueStage(StageSettings):
    """Goes to its targets, moduli and the like along eta(lambda) = lambda eta_1 + (1-lambda) eta_0, from those at its
    start, window by window.
    """

    isGradual = hasPath = True

    kind: Literal["continue"] = Field(description="which kind of stage")
    windows: int = Field(
        10, ge=1, le=10**6, description="steps of lambda from 0 to 1, so that there are windows+1 values"
    )
    equilibration: int = Field(
        100, ge=0, description="Monte Carlo steps after each change of lambda, which the averages leave out"
    )
    steps: int = Field(100, ge=1, description="Monte Carlo steps over which each window is averaged")
    there_and_back: bool = Field(False, description="go back to lambda = 0 by the same windows, to see hysteresis")
    path: dict[str, list[float]] = Field(
        {},
        description="a lambda of its own for a target or the like, from 0 at the start to 1 at its end: a plain number "
        "for each of the windows+1 points, by name",
    )
    temperature: Temperature | None = Field(None, gt=0, description="in K; that of [sampling] by default")

    @model_validator(mode="after")
    def _paths(self) -> "ContinueStage":
        given = [*self.targetNames(), *self.conditions()]
        if not given:
            raise ValueError(f"has no target to go to; give one of {', '.join(Conditions.model_fields)}")
        for name, values in self.path.items():
            if name not in given:
                raise ValueError(f"path has '{name}'; it must be a target that the stage gives: {', '.join(given)}")
            if len(values) != self.windows + 1:
                raise ValueError(
                    f"path of {name} has {len(values)} values; windows = {self.windows} asks for {self.windows + 1}"
                )
        return self

    @property
    def returns(self) -> bool:
        return self.there_and_back

    @property
    def totalSteps(self) -> int:
        return (self.equilibration + self.steps) * (self.windows + 1 + (self.windows if self.there_and_back else 0))

    @property
    def longestInterval(self) -> float:
        return self.steps

    def suddenTargets(self, start: dict[str, float], end: dict[str, float]) -> dict[str, float]:
        return start

    def lastPart(self, whole: str) -> str:
        return f"last window of {whole}, where it is equilibrated"


STAGES: dict[str, type[StageSettings]] = {
    "minimize": MinimizeStage,
    "sample": SampleStage,
    "approach": ApproachStage,
    "anneal": AnnealStage,
    "continue": ContinueStage,
}
AnyStage: TypeAlias = Annotated[
    MinimizeStage | SampleStage | ApproachStage | AnnealStage | ContinueStage, Field(discriminator="kind")
]


def _checkTable(table: list[list[float]]) -> None:
    for i, row in enumerate(table):
        if len(row) != 2:
            raise ValueError(f"table has the row {row}; each must be [step, temperature]")
        if row[1] <= 0:
            raise ValueError(f"table has the temperature {row[1]:g} K at step {row[0]:g}; it must be positive")
        if i > 0 and row[0] <= table[i - 1][0]:
            raise ValueError(f"table has step {row[0]:g} after step {table[i - 1][0]:g}; steps must ascend")
