"""Step sizes of Hybrid Monte Carlo, and amplitudes of shear waves: found during a burn-in, or followed while the
temperature falls.

An adapter is told the acceptance probability of each trajectory and says with which step size to make the next one.
Its state is a handful of numbers, which :meth:`getState` and :meth:`setState` carry over a restart without losing a
bit.

Averages taken while step sizes and amplitudes change are not those of a fixed distribution: adapt first, freeze, then
sample.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from openmm import app, unit

from ..helfrich import HamiltonianTrajectoryIntegrator
from ..optional import dataFrame
from ..units import thermalEnergy, valueIn

# Long trajectories give most for their cost at an acceptance of 0.651 (Beskos et al., Bernoulli 19, 1501, 2013), but
# little less from 0.6 to 0.9 (Betancourt, Byrne and Girolami, arXiv:1411.6669).  At 0.75 they cost 3% more, and a
# membrane whose shape turns stiff is further from sticking.
DEFAULT_ACCEPTANCE = 0.75


# Moves that many degrees of freedom resist get furthest at an acceptance of 0.234, and within 8% of that from 0.15 to
# 0.35 (Roberts, Gelman and Gilks, Ann. Appl. Probab. 7, 110, 1997).
DEFAULT_WAVE_ACCEPTANCE = 0.25


class _Adapter:
    """A step size and a set of numbers, with checks."""

    QUANTITY, UNIT = "step size", unit.picosecond

    def __init__(self, stepSize: float | unit.Quantity, acceptance: float = DEFAULT_ACCEPTANCE):
        stepSize = float(valueIn(stepSize, self.UNIT))
        if not (math.isfinite(stepSize) and stepSize > 0):
            raise ValueError(
                f"{type(self).__name__}: the {self.QUANTITY} is {stepSize} {self.UNIT.get_symbol()}; it must be "
                "positive and finite"
            )
        if not 0 < acceptance < 1:
            raise ValueError(f"{type(self).__name__}: the acceptance is {acceptance}; it must be between 0 and 1")
        self._acceptance = float(acceptance)
        self._logStepSize = math.log(stepSize)

    @property
    def acceptance(self) -> float:
        """The acceptance probability that is aimed at."""
        return self._acceptance

    @property
    def stepSize(self) -> float:
        """The step size for the next trajectory, in ps."""
        return math.exp(self._logStepSize)

    def getState(self) -> dict:
        """Return everything that :meth:`setState` needs to go on: a dict of numbers, strings and booleans, fit for
        JSON.
        """
        return {name[1:]: value for name, value in vars(self).items()}

    def setState(self, state: dict) -> None:
        """Go on where another adapter of this class was when it returned a state from :meth:`getState`.

        Raises
        ------
        ValueError
            if the state is not one of this class
        """
        if set(state) != {name[1:] for name in vars(self)}:
            raise ValueError(
                f"{type(self).__name__}: the state has the entries {', '.join(sorted(state))}; it must be one that "
                "getState() returned"
            )
        vars(self).update({"_" + name: value for name, value in state.items()})


class StepSizeAdapter(_Adapter):
    """Finds the step size at which trajectories are accepted with a given probability.

    It first doubles or halves the step size until the acceptance probability crosses 1/2, however far away the start
    was, and then averages by the dual averaging of Hoffman and Gelman, J. Mach. Learn. Res. 15, 1593 (2014), section
    3.2, equation 6, shrunk towards the step size that the search found, with their parameters t_0 = 10 and kappa =
    0.75.  Their gamma, 0.05, makes the step size of a membrane jump by large factors from one trajectory to the next,
    so that its average accepts 0.86 to 0.95 after 100 to 300 trajectories where 0.75 was asked for; with 0.5 it accepts
    0.73 to 0.83.
    """

    GAMMA, T0, KAPPA = 0.5, 10, 0.75

    def __init__(self, stepSize: float | unit.Quantity, acceptance: float = DEFAULT_ACCEPTANCE):
        """Create a StepSizeAdapter.

        Parameters
        ----------
        stepSize : float or Quantity
            the step size to begin with, in ps; it may be wrong by any factor
        acceptance : float
            the acceptance probability to aim at, between 0 and 1

        Raises
        ------
        ValueError
            if one of them is out of range
        """
        super().__init__(stepSize, acceptance)
        self._direction: int | None = 0  # of the search, as a power of 2; None when it is over
        self._centre = self._logStepSize
        self._count, self._error, self._logAverage = 0, 0.0, 0.0
        self._isFrozen = False

    @property
    def isSearching(self) -> bool:
        """Whether the right order of magnitude is not known yet."""
        return self._direction is not None

    @property
    def isReady(self) -> bool:
        """Whether enough is known to freeze."""
        return self._count > 0

    @property
    def isFrozen(self) -> bool:
        """Whether the step size has been frozen."""
        return self._isFrozen

    def update(self, acceptanceProbability: float) -> float:
        """Take in the acceptance probability of a trajectory and return the step size for the next one, in ps.

        Parameters
        ----------
        acceptanceProbability : float
            min(1, exp(-dH/kT)), or 0 for a trajectory that diverged: :func:`stepAndAdapt` knows
        """
        probability = _checkProbability(acceptanceProbability)
        if not self._isFrozen:
            if self.isSearching:
                self._search(probability)
            else:
                self._average(probability)
        return self.stepSize

    def freeze(self) -> float:
        """Stop adapting, with the averaged step size, and return it, in ps.

        Raises
        ------
        ValueError
            if the right order of magnitude has not been found yet: there were too few trajectories
        """
        if not self._isFrozen:
            if not self.isReady:
                raise ValueError(
                    f"{type(self).__name__}: the search for the {self.QUANTITY} has not ended (it is at "
                    f"{self.stepSize:.3g} {self.UNIT.get_symbol()}); more trajectories are needed"
                )
            self._logStepSize, self._isFrozen = self._logAverage, True
        return self.stepSize

    def _search(self, probability):
        direction = 1 if probability > 0.5 else -1
        if self._direction in (0, direction):
            self._direction = direction
            self._logStepSize += direction * math.log(2)
        else:
            self._direction, self._centre = None, self._logStepSize

    def _average(self, probability):
        self._count += 1
        self._error += (self._acceptance - probability - self._error) / (self._count + self.T0)
        self._logStepSize = self._centre - math.sqrt(self._count) / self.GAMMA * self._error
        self._logAverage += self._count**-self.KAPPA * (self._logStepSize - self._logAverage)


class StepSizeTracker(_Adapter):
    """Keeps trajectories accepted with a given probability while the temperature, or whatever else, changes slowly.

    After each trajectory the logarithm of the step size changes by a constant gain times the deviation of its
    acceptance probability (H. Robbins and S. Monro, Ann. Math. Stat. 22, 400 (1951), with a gain that does not fall).
    """

    def __init__(self, stepSize: float | unit.Quantity, acceptance: float = DEFAULT_ACCEPTANCE, gain: float = 0.1):
        """Create a StepSizeTracker.

        Parameters
        ----------
        stepSize : float or Quantity
            the step size to begin with, in ps
        acceptance : float
            the acceptance probability to keep, between 0 and 1
        gain : float
            how fast to follow: 1/gain is about the number of trajectories that a change takes.  The step size scatters
            by about a third of the square root of the gain: 0.1 by a tenth

        Raises
        ------
        ValueError
            if one of them is out of range
        """
        super().__init__(stepSize, acceptance)
        if not 0 < gain <= 1:
            raise ValueError(f"StepSizeTracker: the gain is {gain}; it must be above 0 and at most 1")
        self._gain = float(gain)

    def update(self, acceptanceProbability: float) -> float:
        """Take in the acceptance probability of a trajectory, as :meth:`StepSizeAdapter.update`, and return the step
        size for the next one, in ps.
        """
        self._logStepSize += self._gain * (_checkProbability(acceptanceProbability) - self._acceptance)
        return self.stepSize


class _Amplitude(_Adapter):
    """Makes an adapter of step sizes one of amplitudes, in nm."""

    QUANTITY, UNIT = "amplitude", unit.nanometer

    @property
    def amplitude(self) -> float:
        """The amplitude for the next step of shear waves, in nm."""
        return self.stepSize


class AmplitudeAdapter(_Amplitude, StepSizeAdapter):
    """Finds the amplitude of shear waves that are accepted with a given probability, as a :class:`StepSizeAdapter` does
    the step size.
    """

    def __init__(self, amplitude: float | unit.Quantity, acceptance: float = DEFAULT_WAVE_ACCEPTANCE):
        super().__init__(amplitude, acceptance)


class AmplitudeTracker(_Amplitude, StepSizeTracker):
    """Keeps shear waves accepted with a given probability, as a :class:`StepSizeTracker` does trajectories."""

    def __init__(
        self, amplitude: float | unit.Quantity, acceptance: float = DEFAULT_WAVE_ACCEPTANCE, gain: float = 0.1
    ):
        super().__init__(amplitude, acceptance, gain)


@dataclass(frozen=True, eq=False)
class AdaptationResult:
    """What a burn-in found.

    Attributes
    ----------
    stepSize : float
        the step size that the simulation has now, in ps
    acceptance : float
        mean acceptance probability over the second half of the trajectories, while the step size still changed
    stepSizes, probabilities : arrays of float
        the step size, in ps, and the acceptance probability of each trajectory
    amplitude : float or None
        the amplitude of shear waves that the simulation has now, in nm, if it makes any
    """

    stepSize: float
    acceptance: float
    stepSizes: np.ndarray
    probabilities: np.ndarray
    amplitude: float | None = None

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each trajectory."""
        return dataFrame({"stepSize": self.stepSizes, "acceptanceProbability": self.probabilities})


def stepAndAdapt(
    simulation: app.Simulation,
    adapter: StepSizeAdapter | StepSizeTracker | None,
    waveAdapter: AmplitudeAdapter | AmplitudeTracker | None = None,
) -> float | None:
    """Make one Monte Carlo step of a Simulation, and set the step size that an adapter asks for, or the amplitude of
    shear waves that another does.

    Returns the acceptance probability of a trajectory, min(1, exp(-dH/kT)) or 0 if it diverged, and None for another
    kind of step.  Raises a ValueError if the trajectories are those of another integrator, which has no test of
    acceptance.
    """
    integrator = simulation.integrator
    trajectories, diverged, waves = (
        integrator.getNumTrajectories(),
        integrator.getNumDivergedTrajectories(),
        _numWaves(integrator),
    )
    simulation.step(1)
    if waveAdapter is not None and _numWaves(integrator) > waves:
        integrator.getIntegrator(2).setAmplitude(
            waveAdapter.update(integrator.getIntegrator(2).getLastAcceptanceProbability())
        )
    if adapter is None or integrator.getNumTrajectories() == trajectories:
        return None
    probability = 0.0 if integrator.getNumDivergedTrajectories() > diverged else _acceptanceProbability(integrator)
    integrator.setStepSize(adapter.update(probability))
    return probability


def adaptStepSize(
    simulation: app.Simulation,
    steps: int,
    acceptance: float = DEFAULT_ACCEPTANCE,
    progress: Callable[[int, float], None] | None = None,
) -> AdaptationResult:
    """Find the step size of a Simulation with a HybridMonteCarloIntegrator during a burn-in, and the amplitude of its
    shear waves, and leave them there.

    The right step size of a smooth membrane is not that of one which undulates: the burn-in should be long enough for
    it to reach its temperature. The reporters of the Simulation see its steps.

    Parameters
    ----------
    simulation : openmm.app.Simulation
        what to adapt; its step size is the first guess, and may be wrong by any factor
    steps : int
        number of Monte Carlo steps of the burn-in.  Some 100 trajectories bring the acceptance to within 0.1 of the one
        aimed at
    acceptance : float
        the acceptance probability of trajectories to aim at; that of shear waves is 0.25
    progress : callable, optional
        called after each step with their number so far and the present step size, in ps

    Raises
    ------
    ValueError
        if the steps were too few to find the order of magnitude, in which case step size and amplitude are as they were
        before, or if an argument is out of range
    """
    integrator = simulation.integrator
    original = integrator.getStepSize()
    adapter = StepSizeAdapter(original, acceptance)
    waves: Any = integrator.getIntegrator(2) if integrator.getShearWaveProbability() > 0 else None
    originalAmplitude = waves and waves.getAmplitude()
    waveAdapter = None if waves is None else AmplitudeAdapter(originalAmplitude)
    stepSizes, probabilities = [], []
    for step in range(steps):
        stepSize = adapter.stepSize
        probability = stepAndAdapt(simulation, adapter, waveAdapter)
        if probability is not None:
            stepSizes.append(stepSize)
            probabilities.append(probability)
        if progress is not None:
            progress(step + 1, adapter.stepSize)
    try:
        integrator.setStepSize(adapter.freeze())
        if waveAdapter is not None:
            waves.setAmplitude(waveAdapter.freeze())
    except ValueError as error:
        integrator.setStepSize(original)
        if waves:
            waves.setAmplitude(originalAmplitude)
        raise ValueError(f"{error} than the {len(probabilities)} of {steps} steps") from None
    return AdaptationResult(
        adapter.stepSize,
        float(np.mean(probabilities[len(probabilities) // 2 :])),
        np.array(stepSizes),
        np.array(probabilities),
        None if waveAdapter is None else waveAdapter.amplitude,
    )


def _numWaves(integrator):
    return integrator.getShearWaveIntegrator().getNumAttempted() if integrator.getNumIntegrators() > 2 else 0


def _acceptanceProbability(integrator):
    """Return min(1, exp(-dH/kT)) of the last trajectory, one that did not diverge."""
    trajectory, kT = integrator.getIntegrator(0), thermalEnergy(integrator.getTemperature())
    if isinstance(trajectory, HamiltonianTrajectoryIntegrator):
        change = valueIn(trajectory.getLastEnergyChange(), unit.kilojoules_per_mole)
    elif hasattr(trajectory, "getGlobalVariableByName"):
        change = trajectory.getGlobalVariableByName("endEnergy") - trajectory.getGlobalVariableByName("startEnergy")
    else:
        raise ValueError(
            f"the trajectories are those of a {type(trajectory).__name__}, which accepts every step; only Hybrid Monte "
            "Carlo has a step size to adapt"
        )
    return math.exp(-max(change, 0) / kT)


def _checkProbability(probability):
    if not 0 <= probability <= 1:
        raise ValueError(
            f"the acceptance probability is {probability}; it must be from 0 to 1, and 0 for a trajectory that diverged"
        )
    return float(probability)
