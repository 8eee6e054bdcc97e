"""Step sizes of Hybrid Monte Carlo, and amplitudes of shear waves: found during a burn-in, or followed while the
temperature falls.

An adapter is told the acceptance probability of each trajectory and says with which step size to make the next one.
It knows the kind of moves that it is for.  Its state is a handful of numbers, which :meth:`getState` and
:meth:`setState` carry over a restart without losing a bit.

Averages taken while step sizes and amplitudes change are not those of a fixed distribution: adapt first, freeze, then
sample.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from openmm import app, unit

from ..display import Brief
from ..geometry.mesh import Mesh
from ..geometry.quality import triangleAngles
from ..helfrich import HamiltonianTrajectoryIntegrator, HelfrichForce, ShearWaveIntegrator, TrajectoryMove
from ..optional import dataFrame
from ..units import realNumber, thermalEnergy, valueIn, wholeNumber
from .conditions import boxOf
from .moves import findMove, movesOf, trajectoriesOf
from .progress import requireProgress

# Long trajectories give most for their cost at an acceptance of 0.651 (Beskos et al., Bernoulli 19, 1501, 2013), but
# little less from 0.6 to 0.9 (Betancourt, Byrne and Girolami, arXiv:1411.6669).  At 0.75 they cost 3% more, and a
# membrane whose shape turns stiff is further from sticking.
DEFAULT_ACCEPTANCE = 0.75
# The part of the mean edge length that a vertex at the thermal velocity must go in a step: of the default step size it
# goes 7e-4 to 5e-3, on spheres of 42 to 2,562 vertices with moduli of 20 to 200 and 1e6 to 1e7 kT.
LEAST_MOTION = 2e-5
# After a burn-in the mean acceptance probability is an error below this part of the one aimed at, with at least so many
# tries, whose means scatter by 0.1.  Fewer may all be of the first step sizes after the search, at which little is
# accepted: they tell only if nothing is.
LEAST_PART, LEAST_TRIES, LEAST_PART_OF_FEW = 0.25, 10, 1e-3
# It is told where it is off by more than this, and by more than the scatter of so few tries.
FAR_OFF = 0.25


# Moves that many degrees of freedom resist get furthest at an acceptance of 0.234, and within 8% of that from 0.15 to
# 0.35 (Roberts, Gelman and Gilks, Ann. Appl. Probab. 7, 110, 1997).
DEFAULT_WAVE_ACCEPTANCE = 0.25


class _Adapter:
    """A step size and a set of numbers, with checks.

    Attributes
    ----------
    KINDS : tuple of classes
        the moves that it is for
    QUANTITY : str
        what it adapts of them
    UNIT : openmm.unit.Unit
        the unit of that
    """

    KINDS: tuple[type, ...] = (TrajectoryMove,)
    QUANTITY, UNIT = "step size", unit.picosecond

    def __init__(self, stepSize: float | unit.Quantity, acceptance: float = DEFAULT_ACCEPTANCE):
        stepSize = realNumber(stepSize, f"the {self.QUANTITY}", self.UNIT)
        if not (math.isfinite(stepSize) and stepSize > 0):
            raise ValueError(
                f"the {self.QUANTITY} is {stepSize} {self.UNIT.get_symbol()}; it must be positive and finite"
            )
        if not 0 < realNumber(acceptance, "the acceptance") < 1:
            raise ValueError(f"the acceptance is {acceptance}; it must be between 0 and 1")
        self._acceptance = float(acceptance)
        self._logStepSize = math.log(stepSize)

    @classmethod
    def of(cls, integrator: Any, *arguments: Any) -> Any:
        """Return one that begins with what the move of an integrator has, and the other arguments."""
        return cls(cls.read(cls.findMove(integrator)), *arguments)

    @classmethod
    def findMove(cls, integrator: Any) -> Any:
        """Return the first move of an integrator that this is for.

        Raises
        ------
        ValueError
            if it has none
        """
        move = findMove(integrator, *cls.KINDS)
        if move is None:
            raise ValueError(
                f"there is no {cls.QUANTITY} to adapt: the moves are "
                f"{', '.join(type(move).__name__ for move in movesOf(integrator))}; one must be a "
                f"{' or a '.join(each.__name__ for kind in cls.KINDS for each in kind.__subclasses__() or [kind])}"
            )
        return move

    @staticmethod
    def read(move: Any) -> unit.Quantity:
        """Return the step size of a move."""
        return move.getStepSize()

    @staticmethod
    def write(move: Any, stepSize: float | unit.Quantity) -> None:
        """Set the step size of a move."""
        move.setStepSize(stepSize)

    @staticmethod
    def lastProbability(move: Any, hasDiverged: bool) -> float:
        """Return the acceptance probability of a move's last step, which may have diverged."""
        if hasDiverged:
            return 0.0
        if isinstance(move, HamiltonianTrajectoryIntegrator):
            change = valueIn(move.getLastEnergyChange(), unit.kilojoules_per_mole)
        else:
            change = move.getGlobalVariableByName("endEnergy") - move.getGlobalVariableByName("startEnergy")
        return math.exp(-max(change, 0) / thermalEnergy(move.getTemperature()))

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

    ::

        integrator.setFlipProbability(0)
        adapter = mh.StepSizeAdapter(integrator.getStepSize(), acceptance=0.75)
        for _ in range(50):
            simulation.step(1)
            change = integrator.getLastEnergyChange() / kT
            integrator.setStepSize(adapter.update(min(1, np.exp(-change))))
        integrator.setStepSize(adapter.freeze())
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
        self._centre = self._logStepSize  # spelled as in checkpoints of version 0.1.0
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
            min(1, exp(-dH/kT)), or 0 for a trajectory that diverged: :class:`Adaptation` knows
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
                    f"the search for the {self.QUANTITY} has not ended (it is at "
                    f"{self.stepSize:.3g} {self.UNIT.get_symbol()}); more trajectories are needed"
                )
            self._logStepSize, self._isFrozen = self._logAverage, True
        return self.stepSize

    def _search(self, probability: float) -> None:
        direction = 1 if probability > 0.5 else -1
        if self._direction in (0, direction):
            self._direction = direction
            self._logStepSize += direction * math.log(2)
        else:
            self._direction, self._centre = None, self._logStepSize

    def _average(self, probability: float) -> None:
        self._count += 1
        self._error += (self._acceptance - probability - self._error) / (self._count + self.T0)
        self._logStepSize = self._centre - math.sqrt(self._count) / self.GAMMA * self._error
        self._logAverage += self._count**-self.KAPPA * (self._logStepSize - self._logAverage)


class StepSizeTracker(_Adapter):
    """Keeps trajectories accepted with a given probability while the temperature, or whatever else, changes slowly.

    After each trajectory the logarithm of the step size changes by a constant gain times the deviation of its
    acceptance probability (H. Robbins and S. Monro, Ann. Math. Stat. 22, 400 (1951), with a gain that does not fall).

    ::

        tracker = mh.StepSizeTracker(4e-4)
        mh.anneal(simulation, 250.0, 20, tracker)
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
        if not 0 < realNumber(gain, "StepSizeTracker: the gain") <= 1:
            raise ValueError(f"StepSizeTracker: the gain is {gain}; it must be above 0 and at most 1")
        self._gain = float(gain)

    def update(self, acceptanceProbability: float) -> float:
        """Take in the acceptance probability of a trajectory, as :meth:`StepSizeAdapter.update`, and return the step
        size for the next one, in ps.
        """
        self._logStepSize += self._gain * (_checkProbability(acceptanceProbability) - self._acceptance)
        return self.stepSize


class _Amplitude(_Adapter):
    """Makes an adapter of step sizes one of the amplitudes of shear waves, in nm."""

    KINDS = (ShearWaveIntegrator,)
    QUANTITY, UNIT = "amplitude", unit.nanometer

    @staticmethod
    def read(move: Any) -> unit.Quantity:
        """Return the amplitude of a move."""
        return move.getAmplitude()

    @staticmethod
    def write(move: Any, stepSize: float | unit.Quantity) -> None:
        """Set the amplitude of a move."""
        move.setAmplitude(stepSize)

    @staticmethod
    def lastProbability(move: Any, hasDiverged: bool) -> float:
        """Return the mean acceptance probability of the waves of a move's last step."""
        return move.getLastAcceptanceProbability()

    @property
    def amplitude(self) -> float:
        """The amplitude for the next step of shear waves, in nm."""
        return self.stepSize


class AmplitudeAdapter(_Amplitude, StepSizeAdapter):
    """Finds the amplitude of shear waves that are accepted with a given probability, as a :class:`StepSizeAdapter` does
    the step size.

    ::

        adapter = mh.AmplitudeAdapter(0.03)
        amplitude = adapter.update(0.4)  # for the next step, after waves of this mean acceptance probability
    """

    def __init__(self, amplitude: float | unit.Quantity, acceptance: float = DEFAULT_WAVE_ACCEPTANCE):
        super().__init__(amplitude, acceptance)


class AmplitudeTracker(_Amplitude, StepSizeTracker):
    """Keeps shear waves accepted with a given probability, as a :class:`StepSizeTracker` does trajectories.

    ::

        tracker = mh.AmplitudeTracker(0.03)
        amplitude = tracker.update(0.4)
    """

    def __init__(
        self, amplitude: float | unit.Quantity, acceptance: float = DEFAULT_WAVE_ACCEPTANCE, gain: float = 0.1
    ):
        super().__init__(amplitude, acceptance, gain)


Adapter: TypeAlias = StepSizeAdapter | StepSizeTracker  # the others are derived from these

# What a burn-in adapts beside the step size, where there are such moves.
_OTHER_ADAPTERS = (AmplitudeAdapter,)


@dataclass(frozen=True, eq=False, repr=False)
class AdaptationResult(Brief):
    """What a burn-in found.

    Attributes
    ----------
    stepSize : float
        the step size that the simulation has now, in ps
    acceptance : float
        mean acceptance probability over the second half of the trajectories, while the step size still changed, without
        those that searched for its order of magnitude
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


class Adaptation:
    """Adapters at work, each on the move of a Simulation that it is for."""

    def __init__(self, simulation: app.Simulation, *adapters: Adapter):
        """Create an Adaptation.  Raises a ValueError if there is no move of an adapter's kind."""
        self._simulation = simulation
        self._adapters: tuple[Any, ...] = adapters  # trackers do not freeze
        self._moves = [adapter.findMove(simulation.integrator) for adapter in adapters]
        self._originals = [adapter.read(move) for adapter, move in zip(adapters, self._moves)]

    def step(self) -> list[float | None]:
        """Make one Monte Carlo step of the Simulation, and set what the adapter of its kind of move asks for.

        Returns for each adapter the acceptance probability, min(1, exp(-dH/kT)) or 0 for a trajectory that diverged, or
        None if the step was of another kind.
        """
        before = [(move.getNumAttempted(), move.getNumDiverged()) for move in self._moves]
        self._simulation.step(1)
        probabilities: list[float | None] = [None] * len(self._moves)
        for i, (adapter, move) in enumerate(zip(self._adapters, self._moves)):
            numAttempted, numDiverged = before[i]
            if move.getNumAttempted() > numAttempted:
                probabilities[i] = probability = adapter.lastProbability(move, move.getNumDiverged() > numDiverged)
                adapter.write(move, adapter.update(probability))
        return probabilities

    def freeze(self) -> None:
        """Freeze the adapters, and set what they found.

        Raises
        ------
        ValueError
            if one of them knows too little, in which case all is set to what it was at first
        """
        try:
            for adapter, move in zip(self._adapters, self._moves):
                adapter.write(move, adapter.freeze())
        except ValueError:
            self.restore()
            raise

    def restore(self) -> None:
        """Set all to what it was at first."""
        for adapter, move, original in zip(self._adapters, self._moves, self._originals):
            adapter.write(move, original)


def adaptStepSize(
    simulation: app.Simulation,
    steps: int,
    acceptance: float = DEFAULT_ACCEPTANCE,
    progress: Callable[[int, float], None] | None = None,
) -> AdaptationResult:
    """Find the step size of a Simulation's trajectories during a burn-in, and the amplitude of its shear waves, and
    leave them there.

    The right step size of a smooth membrane is not that of one which undulates: the burn-in should be long enough for
    it to reach its temperature. The reporters of the Simulation see its steps.

    ::

        result = mh.adaptStepSize(simulation, 200)
        print(result.stepSize, result.acceptance)

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
        if the steps were too few to find the order of magnitude, next to nothing was accepted with what was found, or
        the step size that is accepted moves no vertex, as on an uneven mesh, in which cases step size and amplitude are
        as they were before; or if an argument is out of range, or no move makes trajectories of Hybrid Monte Carlo

    Warns
    -----
    UserWarning
        if the acceptance is still far from the one aimed at, by more than what was tried scatters, or too few
        trajectories were tried after the search to tell
    """
    requireProgress(progress)
    integrator, steps = simulation.integrator, wholeNumber(steps, "adaptStepSize: steps", 1)
    try:
        adapter = StepSizeAdapter.of(integrator, acceptance)
        others = [kind.of(integrator) for kind in _OTHER_ADAPTERS if _isUsed(integrator, kind)]
    except ValueError as error:
        raise ValueError(f"adaptStepSize: {error}") from None
    adaptation = Adaptation(simulation, adapter, *others)
    found = [_Found(each) for each in (adapter, *others)]
    stepSizes = []
    for step in range(steps):
        stepSize, searching = adapter.stepSize, [each.isSearching for each in (adapter, *others)]
        probabilities = adaptation.step()
        for each, probability, isSearching in zip(found, probabilities, searching):
            each.add(probability, isSearching)
        if probabilities[0] is not None:
            stepSizes.append(stepSize)
        if progress is not None:
            progress(step + 1, adapter.stepSize)
    try:
        adaptation.freeze()
    except ValueError as error:
        if not stepSizes:
            raise ValueError(
                f"adaptStepSize: none of {steps} steps made a trajectory; more are needed, and a probability of "
                "trajectories above 0"
            ) from None
        made = f"{steps} step{'s' if steps > 1 else ''}, of which {len(stepSizes)} had a trajectory"
        raise ValueError(f"adaptStepSize: {error} than in {made}") from None
    obstacle = _obstacle(simulation, adapter.stepSize) or next(filter(None, (each.failure() for each in found)), None)
    if obstacle is not None:
        adaptation.restore()
        raise ValueError(f"adaptStepSize: {obstacle}")
    for each in found:  # moves of other kinds may be rare
        if shortcoming := each.shortcoming(LEAST_TRIES if each is found[0] else 0):
            warnings.warn(f"adaptStepSize: {shortcoming}", stacklevel=2)
    return AdaptationResult(
        adapter.stepSize,
        found[0].acceptance,
        np.array(stepSizes),
        np.array(found[0].probabilities),
        next((each.amplitude for each in others if isinstance(each, AmplitudeAdapter)), None),
    )


class _Found:
    """What a burn-in tells of one adapter: the acceptance probabilities, and whether they are what was aimed at."""

    def __init__(self, adapter: StepSizeAdapter):
        self._adapter, self._searched, self.probabilities = adapter, 0, list[float]()

    def add(self, probability: float | None, isSearching: bool) -> None:
        """Take the acceptance probability of a step, if it was of the adapter's move."""
        if probability is not None:
            self.probabilities.append(probability)
            self._searched += isSearching

    @property
    def acceptance(self) -> float:
        """The mean acceptance probability over the second half, without what was search."""
        return float(np.mean(self._late))

    def failure(self) -> str | None:
        """Return why what was found is of no use, or None."""
        least = LEAST_PART if len(self._late) >= LEAST_TRIES else LEAST_PART_OF_FEW
        if self.acceptance < least * self._adapter.acceptance:
            return f"{self._says()}: more steps are needed, or a mesh that is nearer to its targets"
        return None

    def shortcoming(self, leastTries: int) -> str | None:
        """Return that what was found is wrong, if the tries are enough to tell, or that they are fewer than asked."""
        if len(self._late) < leastTries:
            return f"{self._says()}, too few to tell whether it is right: more steps are needed"
        difference = abs(self.acceptance - self._adapter.acceptance)
        if difference <= FAR_OFF or difference <= _scatter(self._adapter.acceptance, len(self._late)):
            return None
        return f"{self._says()}: more steps bring it nearer"

    @property
    def _late(self) -> list[float]:
        return self.probabilities[max(len(self.probabilities) // 2, self._searched) :]

    def _says(self) -> str:
        count, adapter = len(self._late), self._adapter
        return (
            f"the {adapter.QUANTITY} came to {adapter.stepSize:.3g} {adapter.UNIT.get_symbol()} with a mean acceptance "
            f"of {self.acceptance:.2f} in the last {count} {'try' if count == 1 else 'tries'}, where "
            f"{adapter.acceptance:g} is aimed at"
        )


def _scatter(mean: float, count: int) -> float:
    """Return how far from their mean value that of a number of probabilities is, in 19 of 20 cases, at most: that of
    draws of 0 and 1, which scatter more than any others.
    """
    return 1.96 * math.sqrt(mean * (1 - mean) / count)


def _obstacle(simulation: app.Simulation, stepSize: float) -> str | None:
    """Return why a step size, in ps, moves the vertices of a membrane by next to nothing, or None if it moves them."""
    system, context = simulation.system, simulation.context
    state = context.getState(positions=True)
    positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    for force in (HelfrichForce.cast(each) for each in system.getForces() if HelfrichForce.isinstance(each)):
        triangles = force.getTrianglesInContext(context)
        vertices, corners = np.unique(triangles, return_inverse=True)
        masses = np.array([valueIn(system.getParticleMass(int(i)), unit.dalton) for i in vertices])
        box = boxOf(state, force)
        mesh = Mesh(positions[vertices], corners.reshape(triangles.shape), box)
        lengths = mesh.edgeLengths
        if not masses.any():
            continue
        temperature = trajectoriesOf(simulation.integrator).getTemperature()
        part = stepSize * math.sqrt(thermalEnergy(temperature) / masses[masses > 0].min()) / lengths.mean()
        if part < LEAST_MOTION:
            _, minLength, maxLength, _ = force.getTether()
            return (
                f"the step size that is accepted, {stepSize:.2g} ps, moves vertices by {part:.1g} mean edge lengths, "
                f"so that nothing would be sampled; the edges are {lengths.min():.3g} to {lengths.max():.3g} nm long, "
                f"where the tether keeps them from {valueIn(minLength, unit.nanometer):.3g} to "
                f"{valueIn(maxLength, unit.nanometer):.3g} nm, and the triangles have angles down to "
                f"{triangleAngles(mesh).min():.2g} degrees: an uneven mesh is ready after Mesh.remeshed()"
            )
    return None


def _isUsed(integrator: Any, adapter: Any) -> bool:
    return any(isinstance(move, adapter.KINDS) for move in movesOf(integrator, onlyUsed=True))


def _checkProbability(probability: float) -> float:
    if not 0 <= probability <= 1:
        raise ValueError(
            f"the acceptance probability is {probability}; it must be from 0 to 1, and 0 for a trajectory that diverged"
        )
    return float(probability)
