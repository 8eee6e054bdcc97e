"""The moves of an integrator, found by what they are: whether it is a mixture, a single move, or something else."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from ..helfrich import EdgeFlipIntegrator, HybridMonteCarloIntegrator, TrajectoryMove


def isMixture(integrator: Any) -> bool:
    """Return whether an integrator is a mixture of moves."""
    return isinstance(integrator, HybridMonteCarloIntegrator)


def movesOf(integrator: Any, onlyUsed: bool = False) -> Iterator[Any]:
    """Yield the moves of an integrator in their order: those of a mixture, and of a mixture in it; of another, itself.

    Parameters
    ----------
    integrator : openmm.Integrator
        the integrator
    onlyUsed : bool
        whether to leave out moves whose probability is 0
    """
    if not isMixture(integrator):
        yield integrator
        return
    for index in range(integrator.getNumMoves()):
        if not onlyUsed or integrator.getMoveProbability(index) > 0:
            yield from movesOf(integrator.getMove(index), onlyUsed)


def findMove(integrator: Any, *kinds: type) -> Any:
    """Return the first move of an integrator that is of one of some classes, or None."""
    return next((move for move in movesOf(integrator) if isinstance(move, kinds)), None)


def trajectoriesOf(integrator: Any) -> Any:
    """Return the move that makes an integrator's trajectories, which has their step size and counts them.

    Where none does so by Hybrid Monte Carlo it is the integrator itself: a mixture counts the steps of its first move,
    whatever that is.
    """
    return findMove(integrator, TrajectoryMove) or integrator


def numDiverged(integrator: Any) -> int:
    """Return the number of trajectories that diverged, 0 where none is one of Hybrid Monte Carlo."""
    trajectories = findMove(integrator, TrajectoryMove)
    return 0 if trajectories is None else trajectories.getNumDiverged()


class Counters(NamedTuple):
    """How often an integrator has tried trajectories and flips, and what came of it."""

    trajectories: int = 0
    accepted: int = 0
    flips: int = 0
    acceptedFlips: int = 0
    diverged: int = 0


def countersOf(integrator: Any) -> Counters:
    """Return the counters of an integrator."""
    trajectories, flips = findMove(integrator, TrajectoryMove), findMove(integrator, EdgeFlipIntegrator)
    return Counters(
        trajectories.getNumAttempted() if trajectories else 0,
        trajectories.getNumAccepted() if trajectories else 0,
        flips.getNumAttempted() if flips else 0,
        flips.getNumAccepted() if flips else 0,
        numDiverged(integrator),
    )


class FlipCounters(NamedTuple):
    """How many sweeps of flips there were, how many flips they tried, and what came of them."""

    sweeps: int = 0
    attempted: int = 0
    accepted: int = 0
    forbidden: int = 0

    @classmethod
    def of(cls, move: Any) -> "FlipCounters":
        """Return those of an EdgeFlipIntegrator; none of None."""
        if move is None:
            return cls()
        return cls(move.getNumSweeps(), move.getNumAttempted(), move.getNumAccepted(), move.getNumForbidden())

    def without(self, others: "FlipCounters") -> "FlipCounters":
        """Return these without some of them."""
        return FlipCounters(*(all - some for all, some in zip(self, others)))

    def beside(self, others: "FlipCounters") -> "FlipCounters":
        """Return these and others."""
        return FlipCounters(*map(sum, zip(self, others)))


NO_FLIPS = FlipCounters()


def makesTrajectories(integrator: Any) -> bool:
    """Return whether an integrator makes trajectories of Hybrid Monte Carlo."""
    return any(isinstance(move, TrajectoryMove) for move in movesOf(integrator, onlyUsed=True))


def makesFlips(integrator: Any) -> bool:
    """Return whether an integrator tries flips."""
    moves = movesOf(integrator, onlyUsed=True)
    return any(isinstance(move, EdgeFlipIntegrator) and move.getFraction() > 0 for move in moves)
