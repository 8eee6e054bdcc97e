"""Whether trajectories from a mesh will be accepted, found out before a run rather than after it."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from openmm import OpenMMException, app, unit

from ..files import PathLike
from ..geometry.mesh import Mesh
from ..geometry.quality import dihedralAngles, triangleAngles
from ..helfrich import HelfrichForce
from ..sampling.moves import trajectoriesOf
from ..units import valueIn
from .additions import additionsTo
from .config import Config, parseConfig
from .scene import Scene, currentMesh
from .sections import SystemSection

# A mesh is even if its tether holds less than a thermal share, in kT for each vertex, and no triangle is near flat or
# folded: its trajectories are then accepted as the step size has it.
_TETHER_SHARE, _LEAST_ANGLE, _GREATEST_DIHEDRAL = 0.5, 15.0, 120.0
# Of a mesh that is not, so many trajectories of so many that are tried must be accepted.
_ACCEPTED, _TRIED = 3, 24


def obstacle(
    scene: Scene, simulation: app.Simulation, force: HelfrichForce, stepSize: float | None = None
) -> str | None:
    """Return why a run from the present shape would sample nothing, in a sentence, or None if it would not.

    An even mesh passes as it is.  With another a few steps are made in a Context of their own, with the targets that
    the mesh has already, so that nothing but the mesh decides; of the scene's step size, or another, in ps.
    """
    mesh = currentMesh(simulation, force)
    if _isEven(scene, simulation, force, mesh) or _accepts(scene, simulation, mesh, stepSize or scene.stepSize):
        return None
    tether, lengths = scene.tether, mesh.edgeLengths
    return (
        f"trajectories from this mesh are not accepted: its edges are {lengths.min():.3g} to {lengths.max():.3g} "
        f"{scene.lengthUnit} long, where the tether keeps them from {tether.minLength:.3g} to {tether.maxLength:.3g}, "
        f"and its triangles have angles down to {triangleAngles(mesh).min():.2g} degrees"
    )


def requireReady(scene: Scene, simulation: app.Simulation, force: HelfrichForce, stepSize: float | None = None) -> None:
    """Raise a ValueError if a run from the present shape would sample nothing."""
    sentence = obstacle(scene, simulation, force, stepSize)
    if sentence is not None:
        file = scene.config.mesh.file
        raise ValueError(
            f"{file or '[mesh] icosphere'}: {sentence}; it is ready after\n"
            f"{remeshing(file or 'mesh.ply', scene, scene.mesh)}\n"
            f"or with remesh = {_numVertices(scene, scene.mesh)} in [mesh]"
        )


class Verdict(NamedTuple):
    """Whether a mesh is ready for a run.

    Attributes
    ----------
    reason : str or None
        why it is not
    commands : sequence of str
        what makes it ready; none if it is, or if nothing is known that does
    notes : sequence of str
        what the first of them would do
    """

    reason: str | None = None
    commands: Sequence[str] = ()
    notes: Sequence[str] = ()


def judge(mesh: Mesh, file: PathLike) -> Verdict:
    """Return the Verdict on a mesh that was read from a file, for a run with default settings."""
    reason, repair, notes = _obstacleOf(mesh), [], []
    if reason is None:
        return Verdict()
    try:
        repaired = mesh.repaired()
    except ValueError:
        repaired = mesh
    if repaired.notes != mesh.notes:
        target = _named(file, "repaired")
        repair, notes = [f"openmm-helfrich repair {file} {target}"], repaired.notes
        mesh, file = repaired, target
    left = _obstacleOf(mesh)
    if left is None:
        return Verdict(reason, repair, notes)
    try:
        mesh.check()
    except ValueError:
        return Verdict(reason)
    return Verdict(reason, [*repair, remeshing(file, _defaultScene(mesh), mesh)], notes)


def remeshing(file: PathLike, scene: Scene, mesh: Mesh) -> str:
    """Return the command that makes the mesh of a file anew."""
    return f"openmm-helfrich remesh {file} {_named(file, 'even')} --vertices {_numVertices(scene, mesh)}"


def _named(file: PathLike, word: str) -> Path:
    path = Path(file)
    return path.with_name(f"{path.stem}_{word}.ply")


def _obstacleOf(mesh: Mesh) -> str | None:
    try:
        mesh.check()
    except ValueError as error:
        return str(error)
    scene = _defaultScene(mesh)
    force = scene.createForce()
    return obstacle(scene, scene.createSimulation(force), force)


def _defaultScene(mesh: Mesh) -> Scene:
    return Scene.of(parseConfig({"mesh": {"file": "mesh"}, "sampling": {"seed": 1}}), mesh)


def _isEven(scene: Scene, simulation: app.Simulation, force: HelfrichForce, mesh: Mesh) -> bool:
    energies = force.getEnergyTermsInContext(simulation.context)
    share = valueIn(energies["tether"], unit.kilojoules_per_mole) / (scene.kT * len(mesh.vertices))
    return (
        share <= _TETHER_SHARE
        and triangleAngles(mesh).min() >= _LEAST_ANGLE
        and np.abs(dihedralAngles(mesh)).max() <= _GREATEST_DIHEDRAL
    )


def _accepts(scene: Scene, simulation: app.Simulation, mesh: Mesh, stepSize: float) -> bool:
    """Return whether trajectories are accepted from a mesh, at the targets that it has."""
    if scene.config.sampling.flip_probability == 1:
        return True
    trial = Scene.of(_withOwnTargets(scene.config), mesh, additionsTo(simulation, len(mesh.vertices)))
    try:
        steps = trial.createSimulation(trial.createForce())
        trajectories = trajectoriesOf(steps.integrator)
        trajectories.setStepSize(stepSize)
        while trajectories.getNumAttempted() < _TRIED:
            steps.step(1)
            if trajectories.getNumAccepted() == _ACCEPTED:
                return True
    except OpenMMException:  # where there is no finite energy
        pass
    return False


def _withOwnTargets(config: Config) -> Config:
    """Return a copy of a Config without targets, so that those of the mesh take their place, and without what a System
    has already.
    """
    config = config.model_copy(deep=True)
    config.system = SystemSection()
    for name in config.membrane.targetNames():
        setattr(config.membrane, name, None)
    return config


def _numVertices(scene: Scene, mesh: Mesh) -> int:
    """Return the number of vertices with which edges are where the tether wants them."""
    if scene.tether.minLength < mesh.edgeLengths.mean() < scene.tether.maxLength:
        return max(len(mesh.vertices), 162)
    length = (scene.tether.minLength + scene.tether.maxLength) / 2
    return max(round(2 * mesh.area / (np.sqrt(3) * length**2)), 12)
