"""Whether trajectories from a mesh will be accepted, found out before a run rather than after it."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from openmm import Context, OpenMMException, VerletIntegrator, app, unit

from ..analysis.verdict import INTERSECTIONS
from ..files import PathLike
from ..geometry.connectivity import genus
from ..geometry.measures import reducedVolume
from ..geometry.mesh import Mesh
from ..geometry.quality import MeshQuality, triangleAngles
from ..geometry.relaxation import Triangulation
from ..geometry.remeshing import missing, tried
from ..helfrich import HelfrichForce
from ..sampling.conditions import currentMesh
from ..sampling.moves import trajectoriesOf
from ..sampling.targets import nameOf, totalOf
from ..units import valueIn
from .additions import additionsTo
from .approach import endTargets
from .config import Config, parseConfig
from .scene import Scene, createScene
from .sections import SystemSection
from .tethers import FITTING, Tether

# A mesh is even if its tether holds less than a thermal share, in kT for each vertex, and no triangle is near flat or
# folded: its trajectories are then accepted as the step size has it.
_TETHER_SHARE, _LEAST_ANGLE, _GREATEST_DIHEDRAL = 0.5, 15.0, 120.0
# The number of vertices from which on fluid membranes of 20 kT did not fold on their way from a sphere to a reduced
# volume, from the largest down: docs/reference/verdicts.md has what was tried.
LEAST_VERTICES = ((0.77, 162), (0.62, 252), (0.47, 362), (-np.inf, 642))
# What advice asks for at least.
_FEWEST = min(count for _, count in LEAST_VERTICES)
# Of a mesh that is not, so many trajectories of so many that are tried must be accepted.
_ACCEPTED, _TRIED = 3, 24
# Of the random numbers of trials: one answer for a mesh and its settings, whatever the seed of the run.
_TRIAL_SEED = 1
# Where each of the first few ends by so many kT higher, flips do not mend the mesh meanwhile: what was tried is in
# docs/how-to/remeshing.md.
_FIRST_FEW, _HOPELESS = 5, 2e4
# The greatest ratio of the bounds of a tether that keeps triangles well shaped: see docs/explanation/model.md.
_FIRM = 2.0
# A mesh that is made anew is another surface if its area or its volume changes by more than this part.
_OTHER = 0.1
# What is thin is tried with up to so many vertices, which takes some seconds.
_MOST_FOR_THIN = 10_000


def obstacle(
    scene: Scene, simulation: app.Simulation, force: HelfrichForce, stepSize: float | None = None
) -> str | None:
    """Return why a run from the present shape would sample nothing, in a sentence, or None if it would not.

    A mesh passes as it is if it is even, and does not if the tether does not go with a surface.  With another a few
    steps are made in a Context of their own, with the targets that the mesh has already and random numbers of their
    own, so that nothing but the mesh decides; of the scene's step size, or another, in ps.
    """
    mesh = currentMesh(simulation, force)
    mismatch = _mismatch(scene, mesh)
    if mismatch is not None:
        return mismatch
    if _isRelaxed(scene, simulation, force) and _isEven(MeshQuality(mesh)):
        return None
    return _refusal(scene, simulation, mesh, stepSize or scene.stepSize)


def evenness(scene: Scene, mesh: Mesh) -> str:
    """Return how long the edges of a mesh are and how sharp its triangles, as what follows a colon."""
    tether, lengths = scene.tether, mesh.edgeLengths
    return (
        f"its edges are {lengths.min():.3g} to {lengths.max():.3g} {scene.lengthUnit} long, where the tether keeps "
        f"them from {tether.minLength:.3g} to {tether.maxLength:.3g}, and its triangles have angles down to "
        f"{triangleAngles(mesh).min():.2g} degrees"
    )


def requireReady(scene: Scene, simulation: app.Simulation, force: HelfrichForce, stepSize: float | None = None) -> None:
    """Raise a ValueError if a run from the present shape would sample nothing."""
    sentence = obstacle(scene, simulation, force, stepSize)
    if sentence is not None:
        raise remeshFirst(scene, sentence)


def beyondBounds(scene: Scene, simulation: app.Simulation, force: HelfrichForce) -> str | None:
    """Return how many edges of the present shape are beyond the tether's bounds, in a sentence, or None if none is."""
    tether, lengths = scene.tether, currentMesh(simulation, force).edgeLengths
    count = int(np.sum((lengths < tether.minLength) | (lengths > tether.maxLength)))
    return (
        f"{count} of {len(lengths)} edges are beyond the bounds of the tether, {tether.minLength:.4g} to "
        f"{tether.maxLength:.4g} {scene.lengthUnit}: they are {lengths.min():.4g} to {lengths.max():.4g} "
        f"{scene.lengthUnit} long"
        if count
        else None
    )


class UnevenError(ValueError):
    """The mesh of a file is to be made anew before a run.

    Attributes
    ----------
    problem : str
        what is wrong, up to what it is ready after
    commands : sequence of str
        what makes the mesh anew
    file : Path
        what the last of them writes
    """

    def __init__(self, problem: str, commands: Sequence[str], file: Path, instead: str):
        super().__init__("\n".join([problem, *commands, f"or with {instead}"]))
        self.problem, self.commands, self.file = problem, commands, file


def remeshFirst(scene: Scene, sentence: str) -> ValueError:
    """Return an error with the advice to make the mesh anew, or to take another one."""
    section = scene.config.mesh
    source = section.file or f"[mesh] {'icosphere' if section.sheet is None else 'sheet'}"
    if scene.mesh.isPeriodic:
        return ValueError(f"{source}: {sentence}; {_another(scene)}")
    misfit = _misfit(scene)
    if misfit is not None:
        return ValueError(f"{source}: {sentence}; {misfit}")
    numVertices = _numVertices(scene, scene.mesh)
    failure = _hindrance(scene, scene.mesh, numVertices)
    if failure is not None:
        return ValueError(f"{source}: {sentence}; and {failure}")
    instead = " instead of subdivide" if section.subdivide else ""
    advice = f"remesh = {numVertices} in [mesh]{instead}"
    if section.file is None:
        return ValueError(f"{source}: {sentence}; it is ready with {advice}{missing()}")
    commands, file = [], Path(section.file)
    if section.repair:
        file = _named(file, "repaired")
        commands = [repairing(section.file, file)]
    commands.append(remeshing(file, numVertices))
    after = f"it is ready after{', without subdivide,' if section.subdivide else ''}{missing()}"
    return UnevenError(f"{source}: {sentence}; {after}", commands, _named(file, "even"), advice)


def _misfit(scene: Scene) -> str | None:
    """Return that the tether is too long for a surface, and which lengths are not; None if a mesh goes with it."""
    area, mean = min(surface.area for surface in scene.mesh.components()), float(scene.mesh.edgeLengths.mean())
    count = _numWithEdges(min(scene.tether.minLength / FITTING[0], _middle(scene)), area)
    if _isWithin(scene.tether, scene.mesh.edgeLengths.mean()) or count >= _FEWEST:
        return None
    return (
        f"with edges as long as the tether wants them a surface has at most {count} vertices, and must have {_FEWEST} "
        "or more: leave min_length and max_length out of [tether], or give such as go with the edges that there are, "
        f"{FITTING[0] * mean:.3g} and {FITTING[1] * mean:.3g} {scene.lengthUnit}"
    )


def _another(scene: Scene) -> str:
    """Return the advice to take another mesh in place of a periodic one, which is not made anew."""
    return (
        f"begin with another mesh, with even edges about {_middle(scene):.3g} "
        f"{scene.lengthUnit} long, as remesh takes no periodic one"
    )


class Coarse(NamedTuple):
    """Too few vertices: how many there are, the reduced volumes for which they are too few, and how many are enough."""

    vertices: int
    volumes: tuple[float, ...]
    enough: int

    def __str__(self) -> str:
        least, greatest = f"{min(self.volumes):.3g}", f"{max(self.volumes):.3g}"
        volumes = f"a reduced volume of {least}" if least == greatest else f"reduced volumes of {least} to {greatest}"
        return (
            f"{self.vertices} vertices are too few for {volumes}: such a mesh can fold onto itself, and has less "
            f"energy than any smooth shape then; {self.enough} or more do not"
        )

    def advice(self) -> str:
        """Return the sentence with what not to trust, and how to get a mesh that is fine enough."""
        times = next(k for k in range(1, 7) if 4**k * (self.vertices - 2) + 2 >= self.enough)
        return (
            f"{self}.  Do not trust energies and shapes of this mesh; subdivide = {times} in [mesh], or "
            f"Mesh.subdivided({times}), makes it fine enough"
        )


def coarseness(scene: Scene, targets: Sequence[dict[str, float]]) -> list[Coarse]:
    """Return the surfaces that have too few vertices for the smallest of some reduced volumes to which their targets
    lead them, those at the start of each stage and at the end.
    """
    holding = [i for i in range(len(scene.stages)) if _holdsVolume(scene.during(i))]
    acting = [targets[i + end] for i in holding for end in (0, 1)]
    found = []
    for k, surface in enumerate(scene.mesh.components() if acting else ()):
        volumes = [reducedVolume(*(_targetOf(each, total, k) for total in ("area", "volume"))) for each in acting]
        found.append(coarse(surface, min(volumes)))
    return [each for each in found if each is not None]


def _holdsVolume(scene: Scene) -> bool:
    return scene.moduli["area"] > 0 and scene.moduli["volume"] > 0


def coarse(surface: Mesh, volume: float) -> Coarse | None:
    """Return that a connected surface has too few vertices for a reduced volume, or None."""
    count = len(surface.vertices)
    enough = next(least for bound, least in LEAST_VERTICES if volume >= bound)
    isEnough = count >= enough or genus(surface.triangles, count) > 0
    return None if isEnough else Coarse(count, (volume,), enough)


def _targetOf(targets: dict[str, float], total: str, surface: int) -> float:
    return targets[name if (name := nameOf(total, surface)) in targets else total]


class Readiness(NamedTuple):
    """Whether a mesh is ready for a run.

    Attributes
    ----------
    reason : str or None
        why it is not
    commands : sequence of str
        what makes it ready; none if it is, or if nothing is known that does
    notes : sequence of str
        what the first of them would do
    needs : str
        how to get the libraries that they need and that are not installed, to go on "ready after"; else nothing
    scene : Scene or None
        what a run with this mesh has; none if the mesh is no membrane
    quality : MeshQuality or None
        the description of the mesh; none if it is no membrane
    """

    reason: str | None = None
    commands: Sequence[str] = ()
    notes: Sequence[str] = ()
    needs: str = ""
    scene: Scene | None = None
    quality: MeshQuality | None = None


def readinessOf(mesh: Mesh, file: PathLike, lengthUnit: str = "nm") -> Readiness:
    """Return the Readiness of a mesh that was read from a file, for a run with default settings."""
    found = _readinessAsItIs(mesh, lengthUnit)
    if found.reason is None:
        return found
    repaired, options = _repaired(mesh)
    notes, repair, left = repaired.notes[len(mesh.notes) :], [], found
    if notes:
        target = _named(file, "repaired")
        repair, left = [repairing(file, target, *options)], _readinessAsItIs(repaired, lengthUnit)
        mesh, file = repaired, target
    if left.reason is None:
        return found._replace(commands=repair, notes=notes)
    if left.scene is None:
        after = f"; but then {left.reason}" if notes else ""
        copied = MeshQuality(mesh).copied(lengthUnit)
        return found._replace(reason=f"{found.reason}{after}{'' if copied is None else f'; {copied}'}")
    if mesh.isPeriodic:
        return found._replace(reason=f"{found.reason}; {_another(left.scene)}")
    failure = None
    for numVertices in _countsToTry(left.scene, mesh):
        failure = _hindrance(left.scene, mesh, numVertices)
        if failure is None:
            commands = [*repair, remeshing(file, numVertices)]
            return found._replace(commands=commands, notes=notes, needs=missing())
    return found._replace(reason=f"{found.reason}; and {failure}")


def _countsToTry(scene: Scene, mesh: Mesh) -> list[int]:
    """Return with how many vertices a mesh is made anew: as many as its edges ask for, or more if it is thin."""
    first = _numVertices(scene, mesh)
    return [first, *(count for count in (4 * first, 16 * first) if count <= _MOST_FOR_THIN)]


def _hindrance(scene: Scene, mesh: Mesh, numVertices: int) -> str | None:
    """Return why a mesh that is made anew is not ready, which is tried, in a sentence; None if it is, or if the
    libraries are missing or the mesh is too large for that.
    """
    try:
        made = tried(Triangulation(mesh.vertices, mesh.triangles), numVertices)
    except ValueError as error:
        return str(error)
    if made is None:
        return None
    if max(abs(made.areaChange), abs(made.volumeChange)) > _OTHER:
        return (
            f"remesh with {numVertices} vertices changes its area by {made.areaChange:+.0%} and its volume by "
            f"{made.volumeChange:+.0%}: it has parts that are thinner than the edges, for which many more vertices are "
            "needed, or a thicker shape"
        )
    reason = _readinessAsItIs(Mesh(*made.triangulation), scene.lengthUnit).reason
    return None if reason is None else f"after remesh with {numVertices} vertices {reason}"


def _repaired(mesh: Mesh) -> tuple[Mesh, list[str]]:
    """Return a mesh that is mended as far as it can be, and the options for the command that does it."""
    for options, closesHoles in (([], False), (["--close-holes"], True)):
        try:
            repaired = mesh.repaired(closeHoles=closesHoles)
            repaired.check()
            return repaired, options
        except ValueError:
            pass
    return mesh, []


def remeshing(file: PathLike, numVertices: int) -> str:
    """Return the command that makes the mesh of a file anew."""
    arguments = "remesh", file, _named(file, "even"), "--vertices", numVertices
    return shlex.join(["openmm-helfrich", *map(str, arguments)])


def repairing(file: PathLike, target: PathLike, *options: str) -> str:
    """Return the command that mends the mesh of a file."""
    return shlex.join(["openmm-helfrich", "repair", str(file), str(target), *options])


def _named(file: PathLike, word: str) -> Path:
    path = Path(file)
    return path.with_name(f"{path.stem}_{word}.ply")


def _readinessAsItIs(mesh: Mesh, lengthUnit: str) -> Readiness:
    """Return what keeps a mesh from a run with default settings, and what the mesh is like, without any remedy."""
    try:
        mesh.check()
    except ValueError as error:
        return Readiness(str(error))
    scene, quality = defaultScene(mesh, lengthUnit), MeshQuality(mesh)
    crossed = overlap(quality)
    if crossed is not None:
        return Readiness(crossed, quality=quality)
    mismatch = _mismatch(scene, mesh)
    if mismatch is not None:
        return Readiness(mismatch, scene=scene, quality=quality)
    isEven = _isEven(quality)  # before there is a Context, so that the memory for both is not needed at once
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    if isEven and _isRelaxed(scene, simulation, force):
        return Readiness(scene=scene, quality=quality)
    return Readiness(_refusal(scene, simulation, mesh, scene.stepSize), scene=scene, quality=quality)


def overlap(quality: MeshQuality) -> str | None:
    """Return that a surface passes through itself so often that any run is failed, or None."""
    count, edges = len(quality.crossings), len(quality.mesh.edges)
    if count <= INTERSECTIONS.failed * edges:
        return None
    return (
        f"the surface passes through itself {count} times, which is at more than {INTERSECTIONS.failed:.0%} of its "
        f"{edges} edges: part or merge what overlaps, in the program that it comes from"
    )


def defaultScene(mesh: Mesh, lengthUnit: str = "nm") -> Scene:
    """Return the Scene of a mesh with default settings."""
    config = parseConfig({"mesh": {"file": "mesh", "length_unit": lengthUnit}, "sampling": {"seed": _TRIAL_SEED}})
    return Scene.of(config, mesh)


def _isRelaxed(scene: Scene, simulation: app.Simulation, force: HelfrichForce) -> bool:
    energies = force.getEnergyTermsInContext(simulation.context)
    share = valueIn(energies["tether"], unit.kilojoules_per_mole) / (scene.kT * len(scene.mesh.vertices))
    return bool(share <= _TETHER_SHARE)


def _isEven(quality: MeshQuality) -> bool:
    return bool(quality.angles.min() >= _LEAST_ANGLE and np.abs(quality.dihedrals).max() <= _GREATEST_DIHEDRAL)


def _mismatch(scene: Scene, mesh: Mesh) -> str | None:
    """Return which surface has edges that the tether does not let be as long as they are, in a sentence, or None.

    A surface keeps its vertices, so that as long as it keeps its area its edges stay as long on average.
    """
    if not _keepsAreas(scene):
        return None
    surfaces, tether = mesh.components(), scene.tether
    for k, surface in enumerate(surfaces):
        if not _isWithin(tether, surface.edgeLengths.mean()) and not _tetherShare(scene, surface) <= _TETHER_SHARE:
            which = f"surface {k}" if len(surfaces) > 1 else "the surface"
            return (
                f"the tether does not go with the edges of {which}: their mean length is "
                f"{surface.edgeLengths.mean():.4g} {scene.lengthUnit}, where the tether keeps edges from "
                f"{tether.minLength:.4g} to {tether.maxLength:.4g}{_remedy(scene, surfaces)}"
            )
    return None


def _remedy(scene: Scene, surfaces: Sequence[Mesh]) -> str:
    """Return what makes a tether go with all surfaces, beside a mesh made anew, as what ends a sentence."""
    means = [surface.edgeLengths.mean() for surface in surfaces]
    least, most = FITTING[0] * min(means), FITTING[1] * max(means)
    if most > _FIRM * least:
        return "; all surfaces must have edges of about one length"
    if _misfit(scene) is not None:  # which names such bounds
        return ""
    return f"; [tether] min_length = {least:.3g} and max_length = {most:.3g} go with them"


def _keepsAreas(scene: Scene) -> bool:
    """Return whether trajectories keep the area of each surface about as it is, and the targets of no stage lead it
    elsewhere.
    """
    targets = [scene.targets, *(endTargets(stage, scene.targets) for stage in scene.stages)]
    return (
        scene.config.sampling.flip_probability < 1
        and scene.moduli["area"] > 0
        and all(
            abs(target / scene.targetScales[name] - 1) <= _OTHER
            for name, target in (item for each in targets for item in each.items())
            if totalOf(name) == "area"
        )
    )


def _tetherShare(scene: Scene, surface: Mesh) -> float:
    """Return the energy of the tether of a connected surface, in kT for each vertex."""
    tether, force, system = scene.tether, HelfrichForce(), surface.createSystem()
    force.setTriangles(surface.triangles)
    force.setUsesPeriodicBoundaryConditions(surface.isPeriodic)
    force.setTether(scene.moduli["tether"], tether.minLength, tether.maxLength, scene.config.tether.exponent)
    force.setTetherLengthScale(tether.lengthScale)
    system.addForce(force)
    context = Context(system, VerletIntegrator(0), scene.platform, scene.platformProperties)
    context.setPositions(surface.vertices)
    energy = force.getEnergyTermsInContext(context)["tether"]
    return float(valueIn(energy, unit.kilojoules_per_mole) / (scene.kT * len(surface.vertices)))


def _refusal(scene: Scene, simulation: app.Simulation, mesh: Mesh, stepSize: float) -> str | None:
    """Return that trajectories from a mesh are not accepted, if they are not."""
    if _accepts(scene, simulation, mesh, stepSize):
        return None
    return f"trajectories from this mesh are not accepted: {evenness(scene, mesh)}"


def _accepts(scene: Scene, simulation: app.Simulation, mesh: Mesh, stepSize: float) -> bool:
    """Return whether trajectories are accepted from a mesh, at the targets that it has, with random numbers of their
    own.
    """
    if scene.config.sampling.flip_probability == 1:
        return True
    trial = createScene(_forTrial(scene.config), mesh, additionsTo(simulation, len(mesh.vertices)))
    try:
        steps = trial.createSimulation(trial.createForce())
        trajectories = trajectoriesOf(steps.integrator)
        trajectories.setStepSize(stepSize)
        changes: list[float] = []
        while trajectories.getNumAccepted() < _ACCEPTED:
            changes.append(_nextEnergyChange(steps, trajectories) / trial.kT)
            left = _TRIED - len(changes)
            isHopeless = len(changes) == _FIRST_FEW and min(changes) > _HOPELESS
            if isHopeless or trajectories.getNumAccepted() + left < _ACCEPTED:
                return False
        return True
    except OpenMMException:  # where there is no finite energy
        pass
    return False


def _nextEnergyChange(simulation: app.Simulation, trajectories: Any) -> float:
    """Make steps up to the next trajectory, and return its change of energy in kJ/mol, infinite if it diverged."""
    numAttempted = trajectories.getNumAttempted()
    while trajectories.getNumAttempted() == numAttempted:
        simulation.step(1)
    return float(valueIn(trajectories.getLastEnergyChange(), unit.kilojoules_per_mole))


def _forTrial(config: Config) -> Config:
    """Return a copy of a Config with the seed of trials, without targets, so that those of the mesh take their place,
    and without what a System has already.
    """
    config = config.model_copy(deep=True)
    config.sampling.seed = _TRIAL_SEED
    config.system = SystemSection()
    for name in config.membrane.targetNames():
        setattr(config.membrane, name, None)
    return config


def _numVertices(scene: Scene, mesh: Mesh) -> int:
    """Return the number of vertices with which edges are where the tether wants them."""
    count = len(mesh.vertices)
    means = [surface.edgeLengths.mean() for surface in mesh.components()]
    equal = np.sqrt(2 * mesh.area / (np.sqrt(3) * count))
    fits = all(_isWithin(scene.tether, mean) for mean in means) or _isWithin(scene.tether, equal)
    return max(count if fits else _numWithEdges(_middle(scene), mesh.area), _FEWEST)


def _isWithin(tether: Tether, length: float) -> bool:
    return bool(tether.minLength < length < tether.maxLength)


def _middle(scene: Scene) -> float:
    """Return the length in the middle of the tether's bounds."""
    return (scene.tether.minLength + scene.tether.maxLength) / 2


def _numWithEdges(length: float, area: float) -> int:
    """Return the number of vertices of a surface of an area with equal edges of a length."""
    return round(2 * area / (np.sqrt(3) * length**2))
