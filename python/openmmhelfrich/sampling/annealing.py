"""Simulated annealing: Monte Carlo steps whose temperature follows a schedule, for trajectories and flips alike."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from openmm import app

from ..display import Brief
from ..optional import dataFrame
from ..units import wholeNumber
from .adaptation import Adaptation, StepSizeTracker
from .progress import requireProgress
from .schedules import createSchedule


@dataclass(frozen=True, eq=False, repr=False)
class AnnealingResult(Brief):
    """What happened at each Monte Carlo step.

    Attributes
    ----------
    steps : array of int
        the Simulation's step before each
    temperatures : array of float
        the temperature of each, in K
    stepSizes : array of float
        the step size of a trajectory, in ps, at each
    probabilities : array of float
        the acceptance probability of each trajectory, NaN for a sweep of flips
    """

    steps: np.ndarray
    temperatures: np.ndarray
    stepSizes: np.ndarray
    probabilities: np.ndarray

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each step."""
        return dataFrame(
            {
                "step": self.steps,
                "temperature": self.temperatures,
                "stepSize": self.stepSizes,
                "acceptanceProbability": self.probabilities,
            }
        )


def anneal(
    simulation: app.Simulation,
    schedule: Any,
    steps: int,
    tracker: StepSizeTracker | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> AnnealingResult:
    """Make Monte Carlo steps at the temperatures of a schedule, while the step size follows to keep the acceptance.

    The schedule is asked with the Simulation's own step, so that a Simulation loaded from a checkpoint cools on from
    where it was; a tracker's state goes with :meth:`StepSizeTracker.getState`.

    ::

        schedule = mh.ExponentialSchedule.over(50, 300 * unit.kelvin, 30 * unit.kelvin)
        mh.anneal(simulation, schedule, 50)

    Parameters
    ----------
    simulation : openmm.app.Simulation
        what to cool, with a HybridMonteCarloIntegrator, whose flips have the same temperature as its trajectories
    schedule : ExponentialSchedule, TableSchedule, callable, ...
        see :func:`createSchedule`
    steps : int
        the number of Monte Carlo steps
    tracker : StepSizeTracker, optional
        chooses the step size; by default one that begins at the integrator's
    progress : callable, optional
        called after each step with their number so far and the temperature, in K

    Raises
    ------
    ValueError
        if the schedule is none, or gives a temperature that is not positive, or if no move makes trajectories of Hybrid
        Monte Carlo
    """
    requireProgress(progress)
    integrator, schedule = simulation.integrator, createSchedule(schedule)
    steps = wholeNumber(steps, "anneal: steps", 0)
    tracker = tracker or StepSizeTracker.of(integrator)
    tracker.write(tracker.findMove(integrator), tracker.stepSize)
    adaptation = Adaptation(simulation, tracker)
    rows = []
    for count in range(1, steps + 1):
        step, stepSize, temperature = simulation.currentStep, tracker.stepSize, schedule(simulation.currentStep)
        integrator.setTemperature(temperature)
        (probability,) = adaptation.step()
        rows.append((step, temperature, stepSize, np.nan if probability is None else probability))
        if progress is not None:
            progress(count, temperature)
    columns = np.array(rows, dtype=float).reshape(-1, 4).T
    return AnnealingResult(columns[0].astype(int), *columns[1:])
