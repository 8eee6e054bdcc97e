"""The stages of a run: what each does in one Monte Carlo step, as a function of how many it has made, and what it must
remember.

All conditions of a step (temperature, targets, length of the trajectory) follow from its number alone.  What a stage
remembers beside its number is what was found at its start and the state of the step size's adapter: a few numbers,
which a checkpoint holds.  Each kind has a class here beside the one of its settings.
"""

import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from openmm import app, unit
from pydantic import Field, TypeAdapter
from typing_extensions import NotRequired, TypedDict

from ..analysis import verdict
from ..analysis.verdict import Beside, Check, Evidence, Verdict, ratesOf
from ..geometry.measured import MeasuredMesh
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce
from ..sampling.adaptation import (
    Adaptation,
    Adapter,
    AmplitudeAdapter,
    AmplitudeTracker,
    StepSizeAdapter,
    StepSizeTracker,
)
from ..sampling.averages import averageWindows, lateRows
from ..sampling.conditions import CURVATURE, LINE_TENSION, currentConditions, currentMesh, flatEnergy, setConditions
from ..sampling.continuation import ContinuationPath, requireOneSign, windowLambdas
from ..sampling.marks import displacement, markedPositions
from ..sampling.minimization import (
    CUT_SHORT,
    STALLED,
    MinimizationResult,
    defaultTolerance,
    firmTether,
    minimize,
    minimizeFluid,
)
from ..sampling.moves import Counters, countersOf, trajectoriesOf
from ..sampling.schedules import ExponentialSchedule, Schedule, TableSchedule, createSchedule
from ..sampling.targets import (
    MODULUS_NAMES,
    currentTargets,
    inWords,
    measuredTargets,
    requireComparableTarget,
    setTargets,
    totalOf,
)
from ..tables import Table
from ..units import valueIn
from .additions import otherForces
from .approach import TARGET_NAMES, endTargets, targetInWords
from .config import conditionOf, conditionParts, namingSource
from .material import lineTensionsOf, numbered, requireKnown, requireResolved
from .readiness import beyondBounds, evenness, remeshFirst
from .scene import Scene
from .sections import Conditions, SamplingSection, SpeciesChange
from .sizes import requireBeginning, requireComparable, requireHeldDifference, requireLeastAreas, requireTrajectories
from .stagesettings import AnnealStage, ApproachStage, ContinueStage, MinimizeStage, SampleStage, StageSettings
from .stepsizes import isTooHeavy, stepSizeOf


class _Memory(TypedDict):
    """What every stage remembers, among other things, and what some do."""

    position: Annotated[int, Field(ge=0, strict=True)]
    startTargets: dict[str, float]
    startConditions: NotRequired[dict[str, float]]
    startCounters: Annotated[list[int], Field(min_length=5, max_length=5)]
    laps: NotRequired[list[Annotated[list[int], Field(min_length=6, max_length=6)]]]
    energies: NotRequired[list[tuple[float, float]]]
    adapter: dict[str, Any] | None
    waveAdapter: dict[str, Any] | None
    marks: NotRequired[list[list[float]]]
    shortfall: NotRequired[dict[Literal["fall", "excess", "slack"], float]]
    beside: NotRequired[tuple[str, float, float] | None]


# The part of the step size to begin with below which an automatic one is not searched any further.
LEAST_STEP = 1e-6
# So often counters are kept on the way.
MOST_LAPS = 32
# So many energies of a minimization are kept: more than a plot has pixels.
MOST_ENERGIES = 1000


class Stage(ABC):
    """A part of a run.

    Attributes
    ----------
    title : str
        what it is called
    steps, position : int
        the number of steps or iterations, at most, and how many have been made
    unit : str
        what these are called
    isWhole : bool
        whether it is done in a single advance(), so that it can go on from its beginning only
    listen : callable
        called within a long advance(), with no arguments; if it returns True the stage stops there
    """

    unit, isWhole = "step", False
    CHECKS: tuple[Check, ...] = ()  # what its verdict looks at
    ADAPTATION = "let targets and temperature change more slowly, so that the step size can follow"

    def __init__(self, settings: Any, scene: Scene, simulation: app.Simulation, force: HelfrichForce):
        """Create the stage that settings describe, at its beginning."""
        self.title, self.steps, self.position = settings.title, settings.totalSteps, 0
        self.listen: Callable[[], bool] = lambda: False
        self._settings, self._scene, self._simulation, self._force = settings, scene, simulation, force
        self._startConditions = currentConditions(simulation.context, force, self._endConditions())
        self._startTargets = currentTargets(simulation.context, force) | self._measuresReleased()
        self._startCounters, self._marks = self._counters(), self._positionsOfMarks().tolist()
        self._laps: list[list[int]] = []  # positions, and the counters there
        self._startAdaptation()

    @classmethod
    def check(cls, settings: Any, scene: Scene, start: dict[str, float]) -> dict[str, float]:
        """Raise a ValueError if such a stage cannot be, given the targets at its start; return those at its end."""
        end, moduli = endTargets(settings, start), settings.conditions()
        for name, scale in scene.targetScales.items():
            modulus = moduli.get(MODULUS_NAMES[totalOf(name)])
            if name in end:
                requireComparableTarget(targetInWords(settings, name), name, end[name], scale)
            elif modulus and totalOf(name) == "areaDifference":
                requireHeldDifference("", modulus, name, start[name], scale)
        requireLeastAreas("", end, MeasuredMesh(scene.mesh))
        for name in end:
            setsVolume = totalOf(name) == "area" and settings.reduced_volume is not None
            if scene.moduli[totalOf(name)] == 0 and not setsVolume:
                raise ValueError(f"it has a target for the {inWords(name)}, whose modulus is 0; give it a modulus")
        return start | end

    @classmethod
    def averages(cls, settings: Any, rows: Table) -> Table | None:
        """Return the averages over the windows of such a stage, if it has windows, from its equilibrated rows."""
        return None

    @property
    def startTargets(self) -> dict[str, float]:
        """The targets at its beginning, in powers of nm, by "area", "volume" and "areaDifference"."""
        return self._startTargets

    @property
    def isDone(self) -> bool:
        """Whether nothing is left to do."""
        return self.position >= self.steps

    @abstractmethod
    def advance(self) -> None:
        """Make a step, or, if the stage is done as a whole, all of it."""

    @abstractmethod
    def status(self, energy: Callable[[], float]) -> str:
        """Return how the stage does, in a few words, given a function that returns the energy, in kT."""

    def window(self) -> tuple[int, bool]:
        """Return the window of a path that the present step belongs to, and whether it is equilibrated: no burn-in."""
        return 0, not self._isAdapting(self.position)

    def acceptance(self) -> tuple[float, float]:
        """Return the fractions of trajectories and of flips accepted since the stage began."""
        counts = np.subtract(self._counters(), self._startCounters)
        return counts[1] / max(counts[0], 1), counts[3] / max(counts[2], 1)

    def getState(self) -> dict[str, Any]:
        """Return what the stage remembers, fit for JSON."""
        return {
            "position": self.position,
            "startTargets": self._startTargets,
            "startConditions": self._startConditions,
            "startCounters": self._startCounters,
            "laps": self._laps,
            "marks": self._marks,
            "adapter": self._adapter and self._adapter.getState(),
            "waveAdapter": self._waveAdapter and self._waveAdapter.getState(),
        }

    def setState(self, state: dict[str, Any]) -> None:
        """Go on from a state that getState() returned; raise a ValueError or KeyError if it is not like one."""
        TypeAdapter(_Memory).validate_python(state)
        self.position, self._startTargets = state["position"], state["startTargets"]
        self._startConditions = state.get("startConditions", {})  # before there were any, none were kept
        if self._startConditions.keys() != self._endConditions().keys():
            raise ValueError(f"the stage began with other conditions than {', '.join(self._endConditions())}")
        self._startCounters, self._marks = state["startCounters"], state.get("marks", [])
        self._laps = state.get("laps", [])  # earlier versions kept none
        self._startAdaptation()
        if self._adapter:
            self._adapter.setState(state["adapter"])
        if self._waveAdapter:
            self._waveAdapter.setState(state["waveAdapter"])

    def notes(self) -> list[str]:
        """Return what is worth telling at the end of the stage."""
        return []

    def judge(self, rows: Table, moduli: dict[str, float]) -> Verdict:
        """Return the verdict on the stage at its end, given its rows of the table, and the modulus of each term there,
        in kJ/mol.
        """
        inThermal = {name: modulus / self._scene.kT for name, modulus in moduli.items()}
        return verdict.judge(replace(self._evidence(rows), moduli=inThermal), self.CHECKS)

    def _evidence(self, rows: Table) -> Evidence:
        scene, mesh = self._scene, currentMesh(self._simulation, self._force)
        integrator = self._simulation.integrator
        counters, late = (
            Counters(*np.subtract(self._counters(), before).tolist())
            for before in (self._startCounters, np.maximum(self._startCounters, self._countersAtHalf()))
        )
        measured, weight = MeasuredMesh(mesh), integrator.getMultilevelWeight()
        stepSize = valueIn(trajectoriesOf(integrator).getStepSize(), unit.picosecond)
        timeScale = stepSizeOf(scene.config, measured)
        isHeavy = weight > 0 and isTooHeavy(scene.config, measured, weight, max(stepSize, timeScale))
        return Evidence(
            rows=rows,
            mesh=mesh,
            flatEnergy=flatEnergy(self._simulation.context, self._force, mesh) / scene.kT,
            isUniform=not scene.config.species,
            heat=self._heat(rows),
            **ratesOf(counters, integrator),
            lately=(late.accepted, late.trajectories),
            stepSize=stepSize,
            timeScale=timeScale,
            weight=weight if isHeavy else 0.0,
            adaptation=self.ADAPTATION if self._adapter else "",
            moved=self._moved(mesh),
        )

    def _heat(self, rows: Table) -> float:
        """Return the temperature of the averages over the one whose kT is the unit of energies."""
        return float(lateRows(rows)["temperature"].mean() / self._scene.temperature)

    def _positionsOfMarks(self) -> NDArray[np.float64]:
        """Return where some of the vertices are that can move."""
        return markedPositions(self._simulation.context, np.arange(len(self._scene.mesh.vertices)))

    def _moved(self, mesh: Mesh) -> float | None:
        """Return how far the marked vertices have come since the stage began, over the mean edge length.

        Of an earlier version's run it is not known.
        """
        if not self._marks:
            return None
        return displacement(np.array(self._marks), self._positionsOfMarks()) / float(mesh.edgeLengths.mean())

    def _keepLap(self) -> None:
        """Keep the counters at up to so many positions, evenly apart, so that those at half of any number of steps are
        about known.
        """
        apart = 1 << (self.position // MOST_LAPS).bit_length()
        if self.position % apart == 0:
            self._laps = [lap for lap in self._laps if lap[0] % apart == 0] + [[self.position, *self._counters()]]

    def _countersAtHalf(self) -> list[int]:
        """Return the counters at half of the steps that were made, or up to a sixteenth of them later."""
        late = [counters for position, *counters in self._laps if 2 * position >= self.position]
        return late[0] if late else self._startCounters

    def _counters(self) -> list[int]:
        return list(countersOf(self._simulation.integrator))

    def _measuresReleased(self) -> dict[str, float]:
        """Return what the membrane has of the targets that the stage leads to, as far as it also brings their moduli
        from 0: there it begins.
        """
        context, force = self._simulation.context, self._force
        released = {total for total, name in MODULUS_NAMES.items() if self._startConditions.get(name) == 0}
        if not (released and self._settings.isGradual):
            return {}
        goal = endTargets(self._settings, currentTargets(context, force))
        measured = measuredTargets(context, force)
        return {name: measured[name] for name in goal if name in measured and totalOf(name) in released}

    def _endTargets(self) -> dict[str, float]:
        return endTargets(self._settings, self._startTargets)

    def _endConditions(self) -> dict[str, float]:
        scene, given = self._scene, self._settings.conditions().items()
        return {numbered(scene.config, name): value * _unitOf(name, scene.kT) for name, value in given}

    def _between(self, part: float) -> dict[str, float]:
        """Return the conditions at a part of the way from those at the start to those at the end."""
        start = self._startConditions
        return {name: (1 - part) * start[name] + part * end for name, end in self._endConditions().items()}

    def _startAdaptation(self) -> None:
        self._adapter, self._waveAdapter = self._createAdapter(), self._createWaveAdapter()
        self._adapters: list[Any] = [adapter for adapter in (self._adapter, self._waveAdapter) if adapter is not None]
        self._adaptation = Adaptation(self._simulation, *self._adapters)

    def _createAdapter(self) -> Adapter | None:
        return None

    def _createWaveAdapter(self) -> Adapter | None:
        return None

    def _isAdapting(self, n: int) -> bool:
        return len(self._adapters) > 0


class Minimize(Stage):
    """A minimum of the energy.

    It is found as a whole: a run that is stopped meanwhile begins it anew, from the checkpoint at its beginning.
    """

    unit, isWhole = "iteration", True
    CHECKS = (*verdict.OF_SHAPES, *verdict.OF_MINIMA)

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self.steps = self._settings.max_iterations
        self._energies: list[tuple[float, float]] = []
        self._result: list[str] | None = None
        self._shortfall: dict[str, float] = {}
        self._beside: Beside | None = None

    @classmethod
    def check(cls, settings: Any, scene: Scene, start: dict[str, float]) -> dict[str, float]:
        """Also: raise a ValueError if edges are to stay within the bounds of a tether that is none."""
        if settings.within_bounds and not scene.moduli["tether"] > 0:
            raise ValueError("within_bounds is true, and [tether] modulus is 0; give it a modulus")
        return super().check(settings, scene, start)

    @property
    def isDone(self) -> bool:
        return self._result is not None

    def advance(self) -> None:
        """Minimize, and count this as a step."""
        simulation, settings = self._simulation, self._settings
        setTargets(simulation.context, self._force, self._endTargets())
        setConditions(simulation.context, self._force, self._endConditions())
        tolerance = settings.tolerance and settings.tolerance * self._scene.kT
        isStopped, start = False, simulation.context.getState(energy=True).getPotentialEnergy()._value
        own = _sumOf(self._force.getEnergyTermsInContext(simulation.context))
        self._energies = [(0, start / self._scene.kT)]

        def progress(iterations: int, energy: float) -> bool:
            nonlocal isStopped
            self.position = iterations
            self._energies.append((iterations, energy / self._scene.kT))
            isStopped = self.listen()
            return isStopped

        search = minimizeFluid if settings.fluid else minimize
        with firmTether(simulation, self._force) if settings.within_bounds else contextlib.nullcontext():
            result = search(
                simulation,
                self._force,
                tolerance,
                settings.max_iterations,
                progress,
                multilevelWeight=settings.multilevel_weight,
            )
        if not isStopped:
            beyond = beyondBounds(self._scene, simulation, self._force) if settings.within_bounds else None
            if beyond is not None and result.iterations < settings.max_iterations:
                raise remeshFirst(self._scene, f"after the minimization {beyond}")
            self._shortfall = _shortfall(result, start, tolerance or 0.0, self._defaultTolerance())
            self._beside = self._besideOf(result, own, start - own)
            simulation.context.setStepCount(simulation.currentStep + 1)
            count = f"{result.iterations} iteration{'s' if result.iterations != 1 else ''}"
            self._result = [
                f"{self.title}: {result.reason}, after {count}{f' and {result.flips} flips' if settings.fluid else ''}",
                *(f"{self.title}: {warning}" for warning in (*result.warnings, *filter(None, [beyond]))),
            ]

    def _besideOf(self, result: MinimizationResult, own: float, other: float) -> Beside | None:
        """Return the forces beside the membrane, if there are any, with the energies of what they drove: there is no
        minimum, and the membrane gained more than it had.

        Parameters
        ----------
        result : MinimizationResult
            what the minimization came to
        own, other : float
            the energies of the membrane, and of what is beside it, at the start, in kJ/mol
        """
        names = ", ".join(force.getName() for force in otherForces(self._simulation.system))
        gained = _sumOf(result.energies) - own
        lost = other - (result.energy._value - own - gained)
        isDriven = not result.converged and lost > gained > abs(own)
        kT = self._scene.kT
        return Beside(names, *((lost / kT, gained / kT) if isDriven else ())) if names else None

    def _defaultTolerance(self) -> float:
        """Return the tolerance of the forces that a stage without one has, in kJ/mol/nm; 0 without bending energy."""
        return defaultTolerance(self._simulation, self._force) if self._scene.moduli["bending"] > 0 else 0.0

    def status(self, energy: Callable[[], float]) -> str:
        """Return the energy of the present iteration, in a few words."""
        return f"energy {self._energies[-1][1]:.6g} kT"

    @property
    def descent(self) -> Table:
        """The iterations and the energy after each, in kT, from the start on: of many, some at equal distances.  While
        penalties are softened they count as such.
        """
        return Table.ofRows([{"iteration": iteration, "energy": energy} for iteration, energy in self._keptEnergies()])

    def _keptEnergies(self) -> list[tuple[float, float]]:
        last = len(self._energies) - 1
        chosen = np.linspace(0, last, min(last + 1, MOST_ENERGIES)).round().astype(int)
        return [self._energies[i] for i in chosen]

    def getState(self) -> dict[str, Any]:
        return {
            **super().getState(),
            "result": self._result,
            "shortfall": self._shortfall,
            "beside": self._beside,
            "energies": self._keptEnergies(),
        }

    def setState(self, state: dict[str, Any]) -> None:
        super().setState(state)
        self._result, self._shortfall = state["result"], state.get("shortfall", {})
        beside = state.get("beside")
        self._beside = beside and Beside(*beside)
        self._energies = state.get("energies", [])  # earlier versions kept none

    def notes(self) -> list[str]:
        return self._result or []

    def _evidence(self, rows: Table) -> Evidence:
        lacks: dict[str, Any] = {**self._shortfall}
        last = rows.where(np.array([-1]))
        return replace(super()._evidence(rows), rows=last, beside=self._beside, **lacks)

    def _heat(self, rows: Table) -> float:
        return 0.0


class MonteCarlo(Stage):
    """A number of Monte Carlo steps, whose conditions are functions of the step."""

    WAVE_ADAPTER: type[AmplitudeAdapter | AmplitudeTracker] = AmplitudeTracker
    CHECKS: tuple[Check, ...] = (*verdict.OF_SHAPES, *verdict.OF_MOVES)

    def _startAdaptation(self) -> None:
        weight = getattr(self._settings, "multilevel_weight", None)
        self._simulation.integrator.setMultilevelWeight(
            self._scene.config.sampling.multilevel_weight if weight is None else weight
        )
        super()._startAdaptation()

    def advance(self) -> None:
        """Make a Monte Carlo step."""
        n, simulation = self.position, self._simulation
        simulation.integrator.setTemperature(self._temperature(n))
        setTargets(simulation.context, self._force, self._targets(n))
        setConditions(simulation.context, self._force, self._conditions(n))
        if self._isAdapting(n):
            self._adaptation.step()
            self._requireStepSize()
        else:
            simulation.step(1)
        self.position += 1
        self._keepLap()
        self._stepped()

    def _requireStepSize(self) -> None:
        """Raise a ValueError if the automatic step size is lost: no trajectory is accepted, however short."""
        found = self._adapter.stepSize if self._adapter else self._scene.stepSize
        if found < LEAST_STEP * self._scene.stepSize:
            raise ValueError(
                f"{self.title}: no step size is accepted; the search has come to {found:.2g} ps, where "
                f"{self._scene.stepSize:.2g} ps go with the moduli and the mesh. Of the membrane as it is now "
                f"{evenness(self._scene, currentMesh(self._simulation, self._force))}"
            )

    def status(self, energy: Callable[[], float]) -> str:
        """Return an energy, in kT, and the rates of acceptance of the stage, in a few words."""
        trajectories, flips = self.acceptance()
        return f"energy {energy():.0f} kT, accepted {trajectories:.0%}, flips {flips:.0%}"

    def _createWaveAdapter(self) -> Any:
        if self._scene.config.sampling.shear_wave_probability == 0 or not self._scene.adaptsWaveAmplitude:
            return None
        return self.WAVE_ADAPTER.of(self._simulation.integrator)

    def _temperature(self, n: int) -> float:
        return self._settings.temperature or self._scene.temperature

    def _targets(self, n: int) -> dict[str, float]:
        return self._endTargets() if n == 0 else {}

    def _conditions(self, n: int) -> dict[str, float]:
        return self._endConditions() if n == 0 else {}

    def _stepped(self) -> None:
        pass


class Sample(MonteCarlo):
    """Constant conditions; an automatic step size or amplitude adapts in the burn-in."""

    WAVE_ADAPTER = AmplitudeAdapter
    CHECKS = (*MonteCarlo.CHECKS, *verdict.OF_AVERAGES)
    ADAPTATION = "a longer burn_in finds a better step size"

    @classmethod
    def check(cls, settings: Any, scene: Scene, start: dict[str, float]) -> dict[str, float]:
        requireComparable("step_size", settings.step_size, scene.stepSize, "that of [sampling] in ps,")
        if settings.step_size == "auto":
            requireTrajectories(scene.config.sampling)
        return super().check(settings, scene, start)

    def _createAdapter(self) -> Adapter | None:
        integrator, own = self._simulation.integrator, self._settings.step_size
        if own == "auto" or (own is None and self._scene.adaptsStepSize):
            return StepSizeAdapter.of(integrator, self._scene.config.sampling.target_acceptance)
        integrator.setStepSize(own or self._scene.stepSize)
        return None

    def _isAdapting(self, n: int) -> bool:
        return not all(adapter.isFrozen for adapter in self._adapters)

    def _stepped(self) -> None:
        isBurnedIn = self.position >= burnIn(self._scene.config.sampling, self.steps) and all(
            adapter.isReady for adapter in self._adapters
        )
        if self._isAdapting(self.position) and isBurnedIn:
            self._adaptation.freeze()
            self._startCounters = self._counters()  # the acceptance is that of the step size that was chosen

    def notes(self) -> list[str]:
        notes = []
        for adapter in self._adapters:
            value = f"{adapter.stepSize:.4g} {self._scene.lengthUnit if adapter is self._waveAdapter else 'ps'}"
            notes.append(
                f"{self.title}: {adapter.QUANTITY} {value}, chosen for an acceptance of {adapter.acceptance:.0%}"
                if adapter.isFrozen
                else (
                    f"{self.title}: the burn-in has not ended, or was too short, and no {adapter.QUANTITY} has been "
                    f"chosen; it is {value}"
                )
            )
        return [*notes, *super().notes()]


class Anneal(MonteCarlo):
    """A temperature that follows a schedule; the step size keeps the acceptance."""

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._schedule = createSchedule(self._createSchedule(self._settings, self._scene.temperature))

    @classmethod
    def check(cls, settings: Any, scene: Scene, start: dict[str, float]) -> dict[str, float]:
        cls._createSchedule(settings, scene.temperature)
        return super().check(settings, scene, start)

    @staticmethod
    def _createSchedule(settings: Any, temperature: float) -> Schedule:
        if settings.table is not None:
            return TableSchedule(*zip(*settings.table))
        start, first = settings.start_temperature or temperature, settings.cooling_start
        if settings.rate is not None:
            return ExponentialSchedule(start, settings.rate, settings.end_temperature, first)
        return ExponentialSchedule.over(settings.steps - first, start, settings.end_temperature, first)

    def _temperature(self, n: int) -> float:
        return self._schedule(n)

    def _createAdapter(self) -> StepSizeTracker:
        return StepSizeTracker.of(self._simulation.integrator, self._scene.config.sampling.target_acceptance)

    def window(self) -> tuple[int, bool]:
        return 0, True


class Continue(MonteCarlo):
    """Targets that move window by window; an automatic step size follows while each window equilibrates."""

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._path = self._createPath(self._settings, self._startTargets)

    @classmethod
    def check(cls, settings: Any, scene: Scene, start: dict[str, float]) -> dict[str, float]:
        super().check(settings, scene, start)
        for name in endTargets(settings, start):
            if totalOf(name) == "areaDifference":  # which a flat sheet has not
                requireBeginning(settings, name, start[name], scene.targetScales[name])
        path = cls._createPath(settings, start)
        path.requireOneSign()
        for window in range(len(path.lambdas)):
            targets = path.targets(window)
            for name, scale in scene.targetScales.items():
                what = f"{targetInWords(settings, name)} of window {window}"
                requireComparableTarget(what, name, targets.get(name), scale)
        return start | path.targets(len(path.lambdas) - 1)

    @classmethod
    def averages(cls, settings: Any, rows: Table) -> Table | None:
        return averageWindows(rows, windowLambdas(settings.windows, settings.there_and_back))

    def setState(self, state: dict[str, Any]) -> None:
        super().setState(state)
        self._path = self._createPath(self._settings, self._startTargets)

    def _conditions(self, n: int) -> dict[str, float]:
        window, step = self._place(n)
        if step > 0:
            return {}
        conditions, point = self._between(self._path.lambdas[window]), self._path.pointOf(window)
        config, paths = self._scene.config, self._settings.path
        own = {numbered(config, name): paths[name][point] for name in self._settings.conditions() if name in paths}
        return conditions | {name: self._between(part)[name] for name, part in own.items()}

    @staticmethod
    def _createPath(s: Any, start: dict[str, float]) -> ContinuationPath:
        path = {
            TARGET_NAMES[name].replace("reducedVolume", "volume"): values
            for name, values in s.path.items()
            if name in TARGET_NAMES
        }
        return ContinuationPath(start, endTargets(s, start), s.windows, s.there_and_back, path)

    def _place(self, n: int) -> tuple[int, int]:
        return divmod(n, self._settings.equilibration + self._settings.steps)

    def _targets(self, n: int) -> dict[str, float]:
        window, step = self._place(n)
        return self._path.targets(window) if step == 0 else {}

    def _createAdapter(self) -> StepSizeTracker | None:
        return _createTracker(self._simulation, self._scene)

    def _isAdapting(self, n: int) -> bool:
        return super()._isAdapting(n) and self._place(n)[1] < self._settings.equilibration

    def window(self) -> tuple[int, bool]:
        window, step = self._place(min(self.position, self.steps - 1))
        return window, step >= self._settings.equilibration


class Approach(MonteCarlo):
    """Targets that move a little with each step; an automatic step size follows."""

    CHECKS = (verdict.FINITE, *verdict.OF_MOVES)  # shapes are those of a membrane that follows

    @classmethod
    def check(cls, settings: Any, scene: Scene, start: dict[str, float]) -> dict[str, float]:
        end = super().check(settings, scene, start)
        for name in endTargets(settings, start):
            requireOneSign(name, [start[name], end[name]])
        return end

    def _targets(self, n: int) -> dict[str, float]:
        start, progress = self._startTargets, (n + 1) / self.steps
        return {name: (1 - progress) * start[name] + progress * end for name, end in self._endTargets().items()}

    def _conditions(self, n: int) -> dict[str, float]:
        return self._between((n + 1) / self.steps)

    def _createAdapter(self) -> StepSizeTracker | None:
        return _createTracker(self._simulation, self._scene)

    def window(self) -> tuple[int, bool]:
        return 0, False

    def notes(self) -> list[str]:
        goals = ", ".join(
            f"{inWords(name)} from {self._startTargets[name]:.4g} to {end:.4g}"
            for name, end in self._endTargets().items()
            if not math.isclose(end, self._startTargets[name], rel_tol=1e-3)
        )
        return [*([f"{self.title}: {goals} in {self.steps} steps"] if goals else []), *super().notes()]


def _createTracker(simulation: app.Simulation, scene: Scene) -> StepSizeTracker | None:
    """Return what keeps an automatic step size right while targets move; make the step size what it is otherwise."""
    if scene.adaptsStepSize:
        return StepSizeTracker.of(simulation.integrator, scene.config.sampling.target_acceptance)
    simulation.integrator.setStepSize(scene.stepSize)
    return None


_KINDS: dict[type[StageSettings], type[Stage]] = {
    MinimizeStage: Minimize,
    SampleStage: Sample,
    AnnealStage: Anneal,
    ContinueStage: Continue,
    ApproachStage: Approach,
}


def _unitOf(name: str, kT: float) -> float:
    """Return what 1 of a condition is, in kJ/mol and powers of nm."""
    return 1.0 if conditionParts(name)[0] == CURVATURE else kT


def _checkConditions(settings: StageSettings, before: Scene, after: Scene) -> None:
    """Raise a ValueError if a stage changes what its membrane has not, or leads where nothing can be, from a scene with
    the moduli that it has before the stage to one with those at its end.
    """
    given, count = settings.conditions(), len(before.config.species)
    for name in given:
        requireKnown(before.config, name)
        if name in ("bending_modulus", "gaussian_modulus") and count:
            raise ValueError(f"it has a {name}, and the membrane has species, each of which has its own")
        if name == LINE_TENSION and count < 2:
            raise ValueError(
                "it has a line_tension, and the membrane has no two [[species]], whose boundaries it is of"
            )
    if given.get(CURVATURE) and before.moduli["bending"] == 0 and not given.get("bending_modulus"):
        raise ValueError("it has a spontaneous_curvature, and the bending_modulus is 0; give it one")
    for name in [name for name, value in given.items() if value]:
        key, inside = conditionParts(name)
        modulus = f"bending_modulus[{inside}]"
        if key == CURVATURE and inside and not given.get(modulus, conditionOf(before.config, modulus)):
            raise ValueError(f"it has a spontaneous_curvature of '{inside}', whose bending_modulus is 0; give it one")
    if any(conditionParts(name)[0] == CURVATURE for name in given):
        requireResolved("its spontaneous_curvature", after.config, float(after.mesh.edgeLengths.mean()))
    if LINE_TENSION in given and settings.isGradual:
        _requireOneLineTension(before)
    if isinstance(settings, ContinueStage):
        _checkPaths(settings, before)


def _requireOneLineTension(before: Scene) -> None:
    """Raise a ValueError if the line tensions of pairs of species differ, so that there is no one to begin with."""
    count, tensions = len(before.config.species), lineTensionsOf(before.config)
    values = {*tensions.values(), *([] if len(tensions) == count * (count - 1) // 2 else [0.0])}
    if len(values) > 1:
        raise ValueError(
            "it leads all line tensions to one value, and those of [membrane] differ; let a stage of kind sample or "
            "minimize before it give a line_tension for all"
        )


def _checkPaths(settings: ContinueStage, before: Scene) -> None:
    """Raise a ValueError if a path leads to a modulus that is negative and must not be."""
    for name, end in settings.conditions().items():
        key, inside = conditionParts(name)
        fields = SpeciesChange.model_fields if inside else Conditions.model_fields
        mayBeNegative = key not in fields or not any(getattr(m, "ge", None) == 0 for m in fields[key].metadata)
        if mayBeNegative or name not in settings.path:
            continue
        start = conditionOf(before.config, name)
        least = min((1 - part) * start + part * end for part in settings.path[name])
        if least < 0:
            raise ValueError(f"the path of {name} leads to {least:g}; it must not be negative")


def createStage(settings: StageSettings, scene: Scene, simulation: app.Simulation, force: HelfrichForce) -> Stage:
    """Return the stage that settings describe, at its beginning."""
    return _KINDS[type(settings)](settings, scene, simulation, force)


def checkStages(scene: Scene, first: int = 0, targets: dict[str, float] | None = None) -> list[dict[str, float]]:
    """Raise a ValueError if one of the stages that are to come cannot be.

    Parameters
    ----------
    scene : Scene
        what has the stages
    first : int
        the index of the stage to begin with
    targets : dict, optional
        those at the start of this stage, by name; by default those of the scene

    Returns
    -------
    list of dict
        the targets at the start of each of these stages, and at the end
    """
    found = [targets or scene.targets]
    for i, settings in enumerate(scene.stages[first:], first):
        with namingSource(scene.config):
            try:
                _checkConditions(settings, scene.during(i - 1), scene.during(i))
                found.append(_KINDS[type(settings)].check(settings, scene.during(i), found[-1]))
            except ValueError as error:
                raise ValueError(f"{placeOf(scene.stages, i)}: {error}") from None
    return found


def placeOf(stages: Sequence[StageSettings], index: int) -> str:
    """Return what to call a stage, with the number that its user has given it."""
    number = 1 + sum(not stage.isAdded for stage in stages[:index])
    if stages[index].isAdded:
        return f"the approach to stage {number} ({stages[index + 1].title})"
    return f"stage {number} ({stages[index].title})"


def averagesOf(settings: StageSettings, rows: Table) -> Table | None:
    """Return the averages over the windows of a stage from its equilibrated rows, None if it has no windows."""
    return _KINDS[type(settings)].averages(settings, rows)


def _shortfall(result: MinimizationResult, start: float, tolerance: float, default: float) -> dict[str, float]:
    """Return what a minimization from an energy lacks, as attributes of an Evidence.

    Parameters
    ----------
    result : MinimizationResult
        what it came to
    start : float
        the energy, in kJ/mol
    tolerance, default : float
        its own tolerance of the forces, 0 if it has none, and the default one, 0 if there is none, in kJ/mol/nm
    """
    history, force = [start, *result.history], float(result.rmsForce._value)
    if result.reason == STALLED:
        return {"excess": force / max(tolerance, default)}
    if result.converged and 0 < default < tolerance:
        return {"slack": force / default}
    if result.reason != CUT_SHORT:
        return {}
    last = history[-1 - max(1, len(history) // 10) :]
    return {"fall": float((last[0] - last[-1]) / max(abs(last[-1]), 1e-300))}


def _sumOf(energies: dict[str, unit.Quantity]) -> float:
    """Return the sum of terms, in kJ/mol."""
    return float(sum(valueIn(energy, unit.kilojoules_per_mole) for energy in energies.values()))


def burnIn(sampling: SamplingSection, steps: int) -> int:
    """Return the number of steps of a stage during which an automatic step size adapts."""
    return sampling.burn_in or min(steps // 5, 1000)
