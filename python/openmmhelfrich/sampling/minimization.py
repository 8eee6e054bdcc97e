"""Minima of a membrane's energy, at fixed connectivity or with a connectivity that flows."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import openmm as mm
from openmm import app, unit

from ..display import Brief
from ..geometry.connectivity import labelComponents, nearestImages
from ..helfrich import EdgeFlipIntegrator, HelfrichForce
from ..optional import dataFrame
from ..units import realNumber, valueIn, wholeNumber
from .conditions import moduliOf, positionsOf
from .moves import findMove
from .progress import requireProgress
from .symmetry import bendsOut, displacementsOut
from .targets import currentTargets, nameOf, setTargets, totalOf
from .waves import WaveStiffness, descend

_ENERGY, _FORCE = unit.kilojoules_per_mole, unit.kilojoules_per_mole / unit.nanometer
_PENALTIES = ("area", "volume", "areaDifference")
# A tether whose energy is a larger part of the bending energy than this bends the shape, or the mesh is still on its
# way.
_TETHER_SHARE = 1e-3
# A firm tether's bounds are nearer to each other by this part at either end, in logarithms, and its modulus is so many
# bending moduli at least.
_MARGIN, _FIRMNESS = 0.1, 1e3
# The most iterations in which edges are first brought well within the tether's bounds, how many times the tolerance is
# near enough, and the part by which the bounds are then nearer to each other at either end, in logarithms.
_EVENING, _LOOSE, _EVEN_MARGIN = 80, 300.0, 0.2
# Other forces push or turn a surface if this part of the forces on it does.
_PUSH = 1e-6
# How far flat sheets are bent, in mean edge lengths: the first of these that lowers the energy.
_BENDS = 0.3, 0.1, 0.03, 0.01
# A shape is to change where penalties are a larger part of the bending energy than this.
_PENALTY_SHARE = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class MinimizationResult(Brief):
    """What a minimization came to.

    ::

        result = mh.minimizeFluid(simulation, force)
        print(result.converged, result.reason, result.energies["bending"])

    Attributes
    ----------
    energies : dict of str to Quantity
        the energy of each term of the membrane, in kJ/mol, as :meth:`HelfrichForce.getEnergyTermsInContext` names them
    energy : Quantity
        the potential energy of the whole System, in kJ/mol
    rmsForce : Quantity
        root mean square of the components of the forces, in kJ/mol/nm
    iterations, flips, rounds : int
        iterations of L-BFGS, accepted flips, and times that flips took turns with L-BFGS
    converged : bool
        whether the forces fell below the tolerance and no flip lowers the energy
    reason : str
        why it ended, in words
    history : array of float
        the energy after each iteration, in kJ/mol, of the terms as they were then: while penalties are softened they
        count as such
    warnings : tuple of str
        what a user should know about the minimum, such as a tether that bends it
    """

    energies: dict
    energy: unit.Quantity
    rmsForce: unit.Quantity
    iterations: int
    flips: int
    rounds: int
    converged: bool
    reason: str
    history: np.ndarray
    warnings: tuple

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with the energy after each iteration, in kJ/mol."""
        return dataFrame({"iteration": np.arange(len(self.history)), "energy": self.history})


def minimize(
    simulation: app.Simulation,
    force: HelfrichForce,
    tolerance: float | unit.Quantity | None = None,
    maxIterations: int = 0,
    progress: Callable[[int, float], bool] | None = None,
    multilevelWeight: float = 0,
) -> MinimizationResult:
    """Move the vertices of a Simulation to a minimum of its energy, with the triangles as they are, by L-BFGS.

    It is that of OpenMM's LocalEnergyMinimizer, or, with a multilevel weight, one that knows the stiffness of the
    membrane's waves.

    Where the line search of L-BFGS fails, it begins anew from the best positions, as long as that lowers the energy.
    A surface whose mesh has the symmetry of a regular solid, as an icosphere, would keep it: where it is far from its
    targets it is first lengthened, by a third of an edge at most.

    Settings of the force that its updateParametersInContext() has not yet given to the Context may be given to it.

    ::

        result = mh.minimize(simulation, force)
        print(result.energy, result.rmsForce)

    Parameters
    ----------
    simulation : openmm.app.Simulation
        what to minimize; its positions change, its velocities do not
    force : HelfrichForce
        the membrane
    tolerance : float or Quantity, optional
        the root mean square of the components of the forces, in kJ/mol/nm, at which to stop; by default kappa_B l/(4A),
        with the mean edge length l and the area A, of several surfaces that of the largest: it falls with l since the
        forces of a slow, long wave are shared by more vertices
    maxIterations : int
        the number of iterations at which to stop, or 0 for no limit
    progress : callable, optional
        called after each iteration with their number so far and the energy in kJ/mol; if it returns True the
        minimization ends
    multilevelWeight : float
        0 to move vertices one by one; with any other weight they move together: long waves, which take the more
        iterations the more vertices there are, then take about as few as short ones.  Edges are first brought well
        within the tether's bounds, by narrower bounds for a while; iterations of that are counted, too

    Raises
    ------
    ValueError
        if an argument is out of range
    openmm.OpenMMException
        if the energy or a force is not finite at the start, or nowhere along the way down; the positions are then those
        at the start
    """
    descent = _Descent(simulation, force, tolerance, maxIterations, progress, multilevelWeight)
    with _restoredOnError(simulation, force):
        descent.leaveSymmetry()
        reason = descent.even() or descent.run()
        return descent.result(reason, 0, 0)


def minimizeFluid(
    simulation: app.Simulation,
    force: HelfrichForce,
    tolerance: float | unit.Quantity | None = None,
    maxIterations: int = 10000,
    progress: Callable[[int, float], bool] | None = None,
    soften: bool = True,
    iterationsPerRound: int = 50,
    multilevelWeight: float = 0,
) -> MinimizationResult:
    """Find a minimum of a fluid membrane's energy: L-BFGS takes turns with edge flips at zero temperature until neither
    lowers the energy.

    Where the area, volume and area difference are far from their targets, stiff penalties would crumple the membrane on
    the way there.  Their moduli are then first multiplied by the ratio of bending to penalty energy, and raised tenfold
    from minimum to minimum up to their own values.

    The flips are those of the Simulation's EdgeFlipIntegrator, whose temperature and fraction, and the Context's step
    count, are afterwards as before.  Its counters of sweeps and flips go on.

    ::

        result = mh.minimizeFluid(simulation, force)
        print(result.energies["bending"] / (8 * np.pi * force.getBendingModulus()))  # 1 on a sphere

    Parameters
    ----------
    simulation : openmm.app.Simulation
        what to minimize, with an EdgeFlipIntegrator, or a HybridMonteCarloIntegrator that has one
    force : HelfrichForce
        the membrane
    tolerance, progress, multilevelWeight
        as for :func:`minimize`
    maxIterations : int
        the number of iterations at which to stop
    soften : bool
        whether to soften penalties that are far from their targets
    iterationsPerRound : int
        the number of iterations between flips

    Raises
    ------
    ValueError
        if an argument is out of range, or the Simulation has no flips
    openmm.OpenMMException
        as for :func:`minimize`; positions, triangles and moduli are then those at the start
    """
    maxIterations = wholeNumber(maxIterations, "minimizeFluid: maxIterations", 1)
    iterationsPerRound = wholeNumber(iterationsPerRound, "minimizeFluid: iterationsPerRound", 1)
    descent = _Descent(simulation, force, tolerance, maxIterations, progress, multilevelWeight)
    with _restoredOnError(simulation, force), _zeroTemperatureFlips(simulation) as flip:
        rounds = flips = 0
        descent.leaveSymmetry()
        for scale in _softening(simulation, force) if soften else [1.0]:
            descent.forget()
            with _scaledPenalties(simulation, force, scale):
                if rounds == 0:
                    descent.even()
                reason, newRounds, newFlips = _settle(descent, flip, iterationsPerRound, 1 if scale == 1 else 10)
            rounds, flips = rounds + newRounds, flips + newFlips
            if descent.isOver:
                break
        return descent.result(reason, flips, rounds)


def _settle(
    descent: "_Descent", flip: Callable[[], int], iterationsPerRound: int, looseness: float
) -> tuple[str, int, int]:
    """Let L-BFGS and flips take turns until neither lowers the energy, or, at penalties to be stiffened yet, until it
    is near enough.
    """
    rounds = flips = stalled = idle = 0
    energy = math.inf
    while True:
        reason = descent.run(iterationsPerRound, looseness)
        accepted = flip()
        rounds, flips = rounds + 1, flips + accepted
        if descent.isOver or (looseness > 1 and rounds == 12):
            return reason, rounds, flips
        if accepted == 0 and reason == _CONVERGED:
            return reason, rounds, flips
        # The flips of a round may open a way that the line search did not find.
        stalled = stalled + 1 if reason == STALLED else 0
        # Flips of a flat sheet cost nothing, and need not end.
        before, energy = energy, descent.energy()
        idle = 0 if before - energy > 1e-9 * abs(energy) else idle + 1
        if (stalled > 0 and accepted == 0) or max(stalled, idle) == 5:
            return STALLED if reason == _ROUND else reason, rounds, flips


_CONVERGED = "the forces fell below the tolerance"
STALLED = "no lower energy was found along the forces: the energy is rough or stiff there"
CUT_SHORT = "the greatest number of iterations was reached"
_STOPPED = "the caller ended it"
_ROUND = "the iterations of a round were made"


class _Descent:
    """Descends by L-BFGS, in one run or several, and keeps count."""

    def __init__(
        self,
        simulation: app.Simulation,
        force: HelfrichForce,
        tolerance: float | unit.Quantity | None,
        maxIterations: int,
        progress: Callable[[int, float], Any] | None,
        multilevelWeight: float,
    ) -> None:
        requireProgress(progress)
        self.simulation, self.force, self.progress = simulation, force, progress
        self.tolerance = (
            defaultTolerance(simulation, force) if tolerance is None else realNumber(tolerance, "tolerance", _FORCE)
        )
        if not (math.isfinite(self.tolerance) and self.tolerance > 0):
            raise ValueError(f"the tolerance is {self.tolerance} kJ/mol/nm; it must be positive and finite")
        self.maxIterations = wholeNumber(maxIterations, "maxIterations", 0)
        if not (math.isfinite(realNumber(multilevelWeight, "multilevelWeight")) and multilevelWeight >= 0):
            raise ValueError(f"the multilevel weight is {multilevelWeight}; it must be finite, 0 or more")
        self.multilevelWeight = multilevelWeight
        masses = map(simulation.system.getParticleMass, range(simulation.system.getNumParticles()))
        self._isFixed = np.array([mass._value == 0 for mass in masses])
        if np.all(self._isFixed):
            raise ValueError("minimization: all particles of the System have mass 0; one must have another to move")
        self.history: list[float] = []
        self.isOver = False
        self._pairs: list[tuple[np.ndarray, np.ndarray]] = []

    def energy(self) -> float:
        """Return the energy, in kJ/mol."""
        return self._evaluate()[0]

    def forget(self) -> None:
        """Forget the second derivatives that were met, since others follow."""
        self._pairs.clear()

    def leaveSymmetry(self) -> None:
        """Lengthen surfaces a little that are far from their targets and would keep the symmetry of their mesh, or bend
        flat sheets, if they have less energy then.

        A closed surface that needs no iteration stays, since the energy there may be less.
        """
        if self.force.usesPeriodicBoundaryConditions():
            self._bend()
            return
        bending, penalty = _bendingAndPenalty(self.simulation, self.force)
        if penalty <= _PENALTY_SHARE * bending or self._measure()[1] <= self.tolerance:
            return
        context, triangles = self.simulation.context, self.force.getTrianglesInContext(self.simulation.context)
        positions = positionsOf(context)
        forces, length = self._evaluate()[1], float(currentEdgeLengths(self.simulation, self.force).mean())
        _, surfaces = labelComponents(triangles, len(positions))
        out = np.zeros(positions.shape)
        for surface in np.unique(surfaces[triangles[:, 0]]):
            own = np.flatnonzero(surfaces == surface)
            if not np.any(self._isFixed[own]):
                inside = np.searchsorted(own, triangles[surfaces[triangles[:, 0]] == surface])
                out[own] = displacementsOut(positions[own], forces[own], inside, length)
        if np.any(out):
            context.setPositions(positions + out)

    def _bend(self) -> None:
        """Bend a flat periodic sheet by its longest wave, or a bump, if that lowers the energy."""
        context = self.simulation.context
        positions, sides = positionsOf(context), currentSides(self.simulation, self.force)
        isVertex = np.zeros(len(positions), dtype=bool)
        isVertex[self.force.getTrianglesInContext(context)] = True
        if np.any(self._isFixed[isVertex]):
            return
        box = context.getState().getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        energy, length = self._evaluate()[0], float(np.linalg.norm(sides, axis=2).mean())
        for out, bend in product(bendsOut(positions, sides, box), _BENDS):
            context.setPositions(positions + bend * length * out * isVertex[:, np.newaxis])
            if self._evaluate()[0] < energy:
                return
        context.setPositions(positions)

    def even(self) -> str | None:
        """Bring edges well within the tether's bounds, if the energy is then lower, and return the reason if this is
        the end.

        Long waves strain many edges, which would meet these bounds over and over.
        """
        context, modulus = self.simulation.context, self.force.getTether()[0]
        energy, rmsForce = self._measure()
        if self.multilevelWeight == 0 or valueIn(modulus, _ENERGY) == 0 or rmsForce <= self.tolerance:
            return None
        before = positionsOf(context)
        scale = self.force.getTetherLengthScale()
        with _narrowTether(self.simulation, self.force, _EVEN_MARGIN, modulus, scale):
            reason = self.run(_EVENING, _LOOSE)
        self.forget()
        if not self._evaluate()[0] < energy:
            context.setPositions(before)
        return reason if self.isOver else None

    def run(self, iterations: int = 0, looseness: float = 1) -> str:
        """Make a number of iterations, or as many as it takes, and return the reason for the end."""
        tolerance, first = looseness * self.tolerance, len(self.history)
        byWaves = self.multilevelWeight > 0
        while True:
            energy, rmsForce = self._measure()
            if rmsForce <= tolerance:
                return _CONVERGED
            left = [
                n
                for n in (
                    iterations and iterations - len(self.history) + first,
                    self.maxIterations and self.maxIterations - len(self.history),
                )
                if n
            ]
            recorder = self._descend(tolerance, min(left, default=0), byWaves)
            if recorder.isStopped or (self.maxIterations and len(self.history) >= self.maxIterations):
                self.isOver = True
                return _STOPPED if recorder.isStopped else CUT_SHORT
            if iterations and len(self.history) - first >= iterations:
                return _CONVERGED if self._measure()[1] <= tolerance else _ROUND
            after, rmsForce = self._measure()
            if energy - after <= 1e-9 * abs(energy):
                if rmsForce <= tolerance:
                    return _CONVERGED
                if not byWaves:
                    return STALLED
                byWaves = False  # one by one, vertices may find a way yet

    def result(self, reason: str, flips: int, rounds: int) -> MinimizationResult:
        energy, rmsForce = self._measure()
        energies = self.force.getEnergyTermsInContext(self.simulation.context)
        return MinimizationResult(
            energies,
            energy * _ENERGY,
            rmsForce * _FORCE,
            len(self.history),
            flips,
            rounds,
            reason == _CONVERGED,
            reason,
            np.array(self.history),
            tuple(_warnings(energies)),
        )

    def _descend(self, tolerance: float, iterations: int, byWaves: bool) -> "_Recorder":
        """Run L-BFGS once.

        The Context may be left at a step that the line search has tried: the best positions are the last reported.
        """
        context, recorder = self.simulation.context, _Recorder(self, tolerance)
        start = positionsOf(context)
        try:
            if byWaves:
                self._descendByWaves(iterations, recorder)
            else:
                mm.LocalEnergyMinimizer.minimize(context, tolerance, iterations, recorder)
        except mm.OpenMMException:
            # A step of the line search led where there is no finite energy.  From the best positions it may find
            # another way; after a round of flips, others may.
            if recorder.positions is None and not self.history:
                context.setPositions(start)
                raise
        context.setPositions(start if recorder.positions is None else np.reshape(recorder.positions, (-1, 3)))
        return recorder

    def _descendByWaves(self, iterations: int, recorder: "_Recorder") -> None:
        """Run L-BFGS with the stiffness of the membrane's waves."""
        context = self.simulation.context
        start = positionsOf(context)

        def evaluate(positions: np.ndarray) -> tuple[float, np.ndarray]:
            context.setPositions(positions)
            try:
                energy, forces = self._evaluate()
            except mm.OpenMMException:
                return math.inf, np.zeros(positions.shape)
            forces[self._isFixed] = 0
            return energy if np.all(np.isfinite(forces)) else math.inf, -forces

        def report(positions: np.ndarray, energy: float, slopes: np.ndarray) -> bool:
            return recorder.report(0, positions, slopes[~self._isFixed], {"system energy": energy})

        def stiffnessAt(positions: np.ndarray) -> WaveStiffness:
            context.setPositions(positions)
            return self._stiffness()

        length = float(np.linalg.norm(currentSides(self.simulation, self.force), axis=2).mean())
        descend(evaluate, start, stiffnessAt, length, report, iterations, self._pairs)

    def _stiffness(self) -> WaveStiffness:
        """Return the inverse of an approximate second derivative at the positions of the Context."""
        context, force = self.simulation.context, self.force
        triangles, bending = force.getTrianglesInContext(context), valueIn(force.getBendingModulus(), _ENERGY)
        _, surfaces = labelComponents(triangles, len(self._isFixed))
        forces, sides = self._evaluate()[1], currentSides(self.simulation, force)
        penalties = self._penalties(forces, surfaces)
        moved = self._rigidMotions(forces, surfaces, np.unique(surfaces[triangles[:, 0]]))
        rigid = [motion / math.sqrt(bending or 1.0) for motion in moved]
        return WaveStiffness(sides, triangles, self._isFixed, bending or 1.0, self._tension(), penalties, rigid)

    def _rigidMotions(self, forces: np.ndarray, surfaces: np.ndarray, numbers: np.ndarray) -> list[np.ndarray]:
        """Return shifts by the size of a surface, and rotations by a radian, of surfaces that other forces push or
        turn.
        """
        if self.force.usesPeriodicBoundaryConditions():
            return []
        context, found = self.simulation.context, []
        positions = positionsOf(context)
        for surface in numbers:
            own = surfaces == surface
            if np.any(self._isFixed[own]):
                continue
            arms = np.where(own[:, np.newaxis], positions - positions[own].mean(axis=0), 0)
            size = math.sqrt(np.mean(arms[own] ** 2))
            shifts = [np.where(own[:, np.newaxis], size * axis, 0) for axis in np.identity(3)]
            for motion in (*shifts, *(np.cross(axis, arms) for axis in np.identity(3))):
                if abs(np.vdot(motion, forces)) > _PUSH * np.linalg.norm(motion) * np.linalg.norm(forces[own]):
                    found.append(motion)
        return found

    def _penalties(self, forces: np.ndarray, surfaces: np.ndarray) -> list[np.ndarray]:
        """Return slopes whose products with themselves are the second derivatives of the penalties.

        The forces of a penalty k (X/X0 - 1)^2 change with its target.
        """
        context, force, part = self.simulation.context, self.force, 1e-3
        targets, moduli = currentTargets(context, force), moduliOf(context, force)
        found = []
        for name, target in targets.items():
            modulus = moduli[totalOf(name)]
            if modulus == 0 or target == 0:
                continue
            setTargets(context, force, {name: (1 + part) * target})
            try:
                change = self._evaluate()[1] - forces
            finally:
                setTargets(context, force, {name: target})
            change[self._isFixed] = 0
            for surface in np.unique(surfaces[np.any(change != 0, axis=1)]):
                own = np.where((surfaces == surface)[:, np.newaxis], change, 0)
                found.append(own / (part * math.sqrt(2 * modulus)))
        return found

    def _tension(self) -> float:
        """Return the greatest derivative of the energy with respect to the area of a surface, or 0 if it is less.

        It guides the search, and is told nowhere.  With one of its own for each of two vesicles, of which one was under
        tension, searches took no fewer iterations.
        """
        context, force = self.simulation.context, self.force
        modulus = moduliOf(context, force)["area"]
        targets = {name: v for name, v in currentTargets(context, force).items() if totalOf(name) == "area"}
        own = context.getParameter(force.getTensionParameter())
        if modulus == 0:
            return max(own, 0.0)
        greatest = 0.0
        for number, surface in enumerate(force.getGeometryInContext(context).surfaces):
            target = targets.get(nameOf("area", number), targets.get("area"))
            if target:
                strain = valueIn(surface.area, unit.nanometer**2) / target - 1
                greatest = max(greatest, own + 2 * modulus * strain / target)
        return greatest

    def _evaluate(self) -> tuple[float, np.ndarray]:
        """Return the energy and the forces."""
        groups = self.simulation.integrator.getIntegrationForceGroups()
        state = self.simulation.context.getState(energy=True, forces=True, groups=groups)
        forces = state.getForces(asNumpy=True).value_in_unit(_FORCE)
        return state.getPotentialEnergy().value_in_unit(_ENERGY), forces

    def _measure(self) -> tuple[float, float]:
        """Return the energy and the root mean square of the components of the forces."""
        energy, forces = self._evaluate()
        rmsForce = math.sqrt(np.mean(forces[~self._isFixed] ** 2))
        if not (math.isfinite(energy) and math.isfinite(rmsForce)):
            raise mm.OpenMMException(
                f"minimization: the energy is {energy} kJ/mol and the root mean square force {rmsForce} kJ/mol/nm; "
                "both must be finite"
            )
        return energy, rmsForce


class _Recorder(mm.MinimizationReporter):
    """Remembers positions and energies of the iterations, and ends them when forces are small or the caller asks."""

    def __init__(self, descent: _Descent, tolerance: float) -> None:
        super().__init__()
        self._descent, self._tolerance = descent, tolerance
        self.positions, self.isStopped = None, False

    def report(self, iteration: int, x: Any, grad: Any, args: dict[str, float]) -> bool:
        history, energy = self._descent.history, args["system energy"]
        if not math.isfinite(energy):
            return True
        self.positions = x
        history.append(energy)
        if self._descent.progress is not None and self._descent.progress(len(history), energy):
            self.isStopped = True
        return self.isStopped or float(np.mean(np.square(grad))) <= self._tolerance**2


def defaultTolerance(simulation: app.Simulation, force: HelfrichForce) -> float:
    """Return the root mean square of the components of the forces, in kJ/mol/nm, at which minimizations stop by
    default: kappa_B l/(4A).
    """
    modulus = valueIn(force.getBendingModulus(), _ENERGY)
    if modulus == 0:
        raise ValueError(
            "the bending modulus is 0, and so sets no scale for the tolerance of the forces; give a tolerance"
        )
    length = float(currentEdgeLengths(simulation, force).mean())
    surfaces = force.getGeometryInContext(simulation.context).surfaces
    area = max(surface.area.value_in_unit(unit.nanometer**2) for surface in surfaces)
    return 0.25 * modulus * length / area


def _warnings(energies: dict[str, unit.Quantity]) -> Iterator[str]:
    bending, tether = (valueIn(energies[name], _ENERGY) for name in ("bending", "tether"))
    if tether > _TETHER_SHARE * bending:
        share = f", {tether / bending:.1%} of the bending energy," if bending > 0 else ""
        yield (
            f"the tether holds {tether:.3g} kJ/mol{share} and so bends the shape: give it wider bounds, or begin "
            "with a more even mesh"
        )


def _softening(simulation: app.Simulation, force: HelfrichForce) -> list[float]:
    """Return the factors by which to multiply the penalties' moduli, one after the other; the last is 1."""
    bending, penalty = _bendingAndPenalty(simulation, force)
    if bending == 0 or penalty <= bending:
        return [1.0]
    decades = math.ceil(math.log10(penalty / bending))
    return [10.0**-n for n in range(decades, -1, -1)]


def _bendingAndPenalty(simulation: app.Simulation, force: HelfrichForce) -> tuple[float, float]:
    """Return the energies of bending and of all penalties, in kJ/mol."""
    energies = {name: valueIn(e, _ENERGY) for name, e in force.getEnergyTermsInContext(simulation.context).items()}
    return energies["bending"], sum(energies[name] for name in _PENALTIES)


@contextmanager
def _scaledPenalties(simulation: app.Simulation, force: HelfrichForce, scale: float) -> Iterator[None]:
    """Multiply the moduli of the penalties in the Context for a while."""
    setters = (force.setAreaModulus, force.setVolumeModulus, force.setAreaDifferenceModulus)
    moduli = (force.getAreaModulus(), force.getVolumeModulus(), force.getAreaDifferenceModulus())

    def multiply(factor: float) -> None:
        for setter, modulus in zip(setters, moduli):
            setter(factor * modulus)
        force.updateParametersInContext(simulation.context)

    multiply(scale)
    try:
        yield
    finally:
        multiply(1.0)


@contextmanager
def firmTether(simulation: app.Simulation, force: HelfrichForce) -> Iterator[None]:
    """Keep edges within the tether's bounds, rather than near them, during minimizations in the block.

    The tether's energy rises so slowly beyond its bounds, and in a unit of length in which edges are long numbers it is
    so small, that others push edges across.  For a while the bounds are nearer to each other by a fifth, as ratios,
    lengths are in mean edge lengths, and the modulus is a thousand bending moduli at least.
    """
    modulus = max(force.getTether()[0], _FIRMNESS * force.getBendingModulus())
    with _narrowTether(simulation, force, _MARGIN, modulus, float(currentEdgeLengths(simulation, force).mean())):
        yield


@contextmanager
def _narrowTether(
    simulation: app.Simulation, force: HelfrichForce, margin: float, modulus: Any, scale: Any
) -> Iterator[None]:
    """Give the tether another modulus and scale of length for a while, and bounds that are nearer to each other by a
    part at either end, in logarithms.
    """
    (before, low, high, exponent), scaleBefore = force.getTether(), force.getTetherLengthScale()

    def put(modulus: Any, low: Any, high: Any, scale: Any) -> None:
        force.setTether(modulus, low, high, exponent)
        force.setTetherLengthScale(scale)
        force.updateParametersInContext(simulation.context)

    factor = (high / low) ** margin
    put(modulus, low * factor, high / factor, scale)
    try:
        yield
    finally:
        put(before, low, high, scaleBefore)


def currentEdgeLengths(simulation: app.Simulation, force: HelfrichForce) -> np.ndarray:
    """Return the present lengths of the sides of the triangles, in nm: a (T, 3) array."""
    return np.linalg.norm(currentSides(simulation, force), axis=2)


def currentSides(simulation: app.Simulation, force: HelfrichForce) -> np.ndarray:
    """Return the vectors along the sides of the triangles, from each corner to the next, in nm: a (T, 3, 3) array."""
    positions = positionsOf(simulation.context)
    triangles = force.getTrianglesInContext(simulation.context)
    sides = positions[np.roll(triangles, -1, axis=1)] - positions[triangles]
    if force.usesPeriodicBoundaryConditions():
        box = simulation.context.getState().getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        sides = nearestImages(sides, box)
    return sides


@contextmanager
def _zeroTemperatureFlips(simulation: app.Simulation, sweeps: int = 5) -> Iterator[Callable[[], int]]:
    """Lend a function that tries to flip every edge, on average five times, where this lowers the energy, and returns
    how many it flipped.
    """
    flips = findMove(simulation.integrator, EdgeFlipIntegrator)
    if flips is None:
        raise ValueError(
            f"minimizeFluid: the Simulation has a {type(simulation.integrator).__name__}, which flips no edges; it "
            "needs an EdgeFlipIntegrator or a HybridMonteCarloIntegrator that has one"
        )
    temperature, fraction = flips.getTemperature(), flips.getFraction()
    flips.setTemperature(0)
    flips.setFraction(1)

    def flip() -> int:
        before, step = flips.getNumAccepted(), simulation.context.getStepCount()
        flips.step(sweeps)
        simulation.context.setStepCount(step)
        return flips.getNumAccepted() - before

    try:
        yield flip
    finally:
        flips.setTemperature(temperature)
        flips.setFraction(fraction)


@contextmanager
def _restoredOnError(simulation: app.Simulation, force: HelfrichForce) -> Iterator[None]:
    """Put positions and triangles back if something fails."""
    context = simulation.context
    positions, triangles = positionsOf(context), force.getTrianglesInContext(context)
    try:
        yield
    except BaseException:
        context.setPositions(positions)
        force.setTrianglesInContext(context, triangles)
        raise
