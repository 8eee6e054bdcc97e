"""Continuation: targets that go from where they are to where they should be, eta(lambda) = lambda eta_1 + (1-lambda)
eta_0, window by window.

Each target may have a lambda of its own.  On the way back the windows are the same, so that hysteresis shows as a
difference between the two branches. The method is that of Siggel et al., J. Chem. Phys. 157, 174801 (2022).
"""

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import openmm as mm
from numpy.typing import ArrayLike, NDArray
from openmm import app, unit

from ..display import Brief, drawing
from ..helfrich import HelfrichForce
from ..tables import Table
from ..units import wholeNumber
from .averages import averageWindows
from .conditions import moduliOf
from .progress import requireProgress
from .reporters import ObservablesReporter
from .targets import (
    absoluteTargets,
    currentTargets,
    inWords,
    measuredTargets,
    requireComparableTarget,
    setTargets,
    targetScales,
    totalOf,
)

Number: TypeAlias = float | unit.Quantity
# The part of the greatest target below which another one is 0 but for rounding.
_NO_SIGN = 1e-9


def windowLambdas(windows: int, thereAndBack: bool) -> NDArray[np.float64]:
    """Return how far along a path each window is: from 0 to 1 and, there and back, to 0 again."""
    uniform = np.linspace(0, 1, int(windows) + 1)
    return np.concatenate((uniform, uniform[-2::-1])) if thereAndBack else uniform


class ContinuationPath:
    """The targets of each window.

    Attributes
    ----------
    lambdas : array of float
        how far along the path each window is
    """

    def __init__(
        self,
        start: dict[str, float],
        end: dict[str, float],
        windows: int,
        thereAndBack: bool = False,
        path: dict[str, Sequence[float]] | None = None,
    ):
        """Create a ContinuationPath.

        Parameters
        ----------
        start, end : dict
            targets by name, in powers of nm; those that `end` does not name stay as they are.  Those of single
            surfaces have names like "volume[1]"
        windows : int
            the number of equal steps of lambda
        thereAndBack : bool
            whether to return by the same windows
        path : dict, optional
            a lambda for each of the windows+1 points by the name of the target, instead of equal steps; that of
            "volume" is of every surface

        Raises
        ------
        ValueError
            if a target is not one that `end` names, is not positive or 0 where it must not be, or a number of values is
            wrong
        """
        windows = wholeNumber(windows, "continuation: windows", 1)
        self.lambdas, uniform = windowLambdas(windows, thereAndBack), windowLambdas(windows, False)
        self._values = {}
        for name, value in end.items():
            given = (path or {}).get(name, (path or {}).get(totalOf(name)))
            lambdas = self._lambdasOf(name, given, uniform)
            self._values[name] = lambdas * value + (1 - lambdas) * start[name]
            self._check(name, self._values[name])
        for name in path or {}:
            if name not in end and name not in map(totalOf, end):
                raise ValueError(f"continuation: path has '{name}'; it must be one of the targets: {', '.join(end)}")

    def pointOf(self, window: int) -> int:
        """Return the point of the path at which a window is, there or back."""
        points = (len(self.lambdas) + 1) // 2 if self.lambdas[-1] == 0 else len(self.lambdas)
        return window if window < points else len(self.lambdas) - 1 - window

    def targets(self, window: int) -> dict[str, float]:
        """Return the targets of a window by name, in powers of nm."""
        point = self.pointOf(window)
        return {name: float(values[point]) for name, values in self._values.items()}

    def requireOneSign(self) -> None:
        """Raise a ValueError if an area difference goes through 0 on the way."""
        for name, values in self._values.items():
            requireOneSign(name, values)

    @staticmethod
    def _lambdasOf(name: str, given: ArrayLike | None, uniform: np.ndarray) -> np.ndarray:
        if given is None:
            return uniform
        given = np.asarray(given, dtype=float)
        if given.shape != uniform.shape or not np.all(np.isfinite(given)):
            raise ValueError(
                f"continuation: the path of {name} has {given.size} values; it must have {len(uniform)} finite ones, "
                "one more than there are windows"
            )
        return given

    @staticmethod
    def _check(name: str, values: np.ndarray) -> None:
        hasSign = totalOf(name) == "areaDifference"
        wrong = values[(values == 0) if hasSign else (values <= 0)]
        if len(wrong):
            raise ValueError(
                f"continuation: the path leads to a target {inWords(name)} of {wrong[0]:g}; it must "
                f"{'not be 0' if hasSign else 'be positive'}"
            )


def requireOneSign(name: str, targets: ArrayLike) -> None:
    """Raise a ValueError if targets, one after the other on a path, are area differences of both signs: the energy is
    that of a ratio to the target.  One that is about 0, as a flat sheet's, has no sign.
    """
    values = np.asarray(targets, dtype=float)
    wrong = values[values * values[0] < 0]
    hasSign = abs(values[0]) > _NO_SIGN * np.abs(values).max()
    if totalOf(name) == "areaDifference" and hasSign and len(wrong):
        raise ValueError(
            f"the target {inWords(name)} would go from {values[0]:.4g} to {wrong[-1]:.4g}, and through 0, where its "
            f"energy has no bound; all its values must be {'positive' if values[0] > 0 else 'negative'}, or the path "
            "must begin with a mesh whose area difference has the other sign"
        )


@dataclass(frozen=True, eq=False, repr=False)
class ContinuationResult(Brief):
    """What was seen along a path.

    ::

        result = mh.continueTo(simulation, force, {"reducedVolume": 0.95}, windows=2, equilibration=5, steps=5)
        print(result.windows["lambda"], result.windows["energy"])

    Attributes
    ----------
    windows : Table
        averages over each window: "window", "lambda", and for each quantity its mean and, with a name that ends in
        "Deviation", its standard deviation
    rows : Table
        all observations, with the window that each belongs to
    """

    windows: Table
    rows: Table

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each window."""
        return self.windows.toDataFrame()

    def plot(self, lengthUnit: str = "nm", energyUnit: str = "kJ/mol") -> Any:
        """Return a Picture of the averages against lambda, the ways there and back apart, which a notebook shows."""
        return drawing().pathPicture(self.windows, lengthUnit, energyUnit)


def continueTo(
    simulation: app.Simulation,
    force: HelfrichForce,
    targets: dict[str, Number],
    windows: int = 10,
    equilibration: int = 100,
    steps: int = 100,
    thereAndBack: bool = False,
    path: dict[str, Sequence[float]] | None = None,
    interval: int = 1,
    temperature: Number | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ContinuationResult:
    """Lead a membrane's targets to new values while it is sampled, and average over each window of the way.

    ::

        result = mh.continueTo(simulation, force, {"reducedVolume": 0.95}, windows=4, equilibration=10, steps=10)
        print(result.windows["reducedVolume"])

    Parameters
    ----------
    simulation : openmm.app.Simulation
        what to lead; its targets are where the path begins
    force : HelfrichForce
        the membrane
    targets : dict
        where to go: "area", "volume" or "reducedVolume", "areaDifference", in powers of nm or with units.  A reduced
        volume is that of the target area.  Of several surfaces each goes there by itself, or to its own in a list
    windows : int
        the number of equal steps from 0 to 1 that lambda makes
    equilibration, steps : int
        Monte Carlo steps in each window, before and during its average
    thereAndBack : bool
        whether to return by the same windows
    path : dict, optional
        a lambda of its own for a target: windows+1 values, by its name
    interval : int
        steps between observations
    temperature : float or Quantity, optional
        the unit of the energies in the result is kT at this temperature, in K, instead of kJ/mol
    progress : callable, optional
        called after each window with the number done and the number of all

    Raises
    ------
    ValueError
        if a target or a number is out of range, the modulus of a target is 0, or an area difference would go through 0
    """
    requireProgress(progress)
    start = _startOf(simulation.context, force)
    ends = absoluteTargets(targets, start)
    _requireModuli(moduliOf(simulation.context, force), targets)
    scales = targetScales(simulation.context, force)
    for name in ends.keys() & scales.keys():
        requireComparableTarget(f"continueTo: the target {name}", name, ends[name], scales[name])
    line = ContinuationPath(start, ends, windows, thereAndBack, _absoluteNames(path))
    line.requireOneSign()
    interval = wholeNumber(interval, "continueTo: interval", 1)
    steps = wholeNumber(steps, "continueTo, with this interval: steps", interval)
    equilibration = wholeNumber(equilibration, "continueTo: equilibration", 0)
    observer, rows = ObservablesReporter(io.StringIO(), interval, force, temperature), []
    for window in range(len(line.lambdas)):
        setTargets(simulation.context, force, line.targets(window))
        simulation.step(equilibration)
        for _ in range(steps // interval):
            simulation.step(interval)
            rows.append({**observer.observe(simulation), "window": window})
        if progress is not None:
            progress(window + 1, len(line.lambdas))
    table = Table.ofRows(rows)
    return ContinuationResult(averageWindows(table, line.lambdas), table)


def _startOf(context: mm.Context, force: HelfrichForce) -> dict[str, float]:
    """Return the targets in a Context, and the measure itself where there is none: that of an area without modulus is
    the one that a reduced volume is of.
    """
    measured = measuredTargets(context, force)
    return {name: value or measured.get(name, value) for name, value in currentTargets(context, force).items()}


def _requireModuli(moduli: Mapping[str, float], targets: Mapping[str, Any]) -> None:
    """Raise a ValueError if a target would have no effect."""
    for name in targets:
        total = totalOf(name).replace("reducedVolume", "volume")
        setsVolume = total == "area" and "reducedVolume" in targets
        if moduli[total] == 0 and not setsVolume:
            raise ValueError(
                f"continueTo: there is a target {name}, and it has no effect, since the modulus of the {total} is 0"
            )


def _absoluteNames(path: Mapping[str, Any] | None) -> dict[str, Any]:
    return {"volume" if name == "reducedVolume" else name: values for name, values in (path or {}).items()}
