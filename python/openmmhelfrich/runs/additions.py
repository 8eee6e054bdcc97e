"""What a run has beside its membrane: a user's own forces and beads, and vertices that stay where they are.

They come from [system] of a configuration and from a function, the setup, and are part of the System from then on: a
checkpoint holds them, so that a run goes on with them without either.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import openmm as mm
from numpy.typing import NDArray
from openmm import app, unit

from ..files import PathLike
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce
from ..sampling.marks import heldParticles
from ..units import valueIn
from .sections import SystemSection

# What adds to a System, given the Scene too, and returns the positions of the particles that it added.
Setup: TypeAlias = Callable[[mm.System, Any], Any]


def fixedVertices(section: SystemSection, mesh: Mesh) -> list[int]:
    """Return the indices of the vertices that are to stay where they are, or raise a ValueError if there are no such
    vertices.
    """
    count = len(mesh.vertices)
    if section.fixed_box is not None:
        low, high = np.array(section.fixed_box)
        found = np.flatnonzero(np.all(_areBetween(mesh, low, high), axis=1)).tolist()
        if not found:
            sides = ("[" + ", ".join(f"{x:.4g}" for x in end(mesh.vertices, axis=0)) + "]" for end in (np.min, np.max))
            raise ValueError(f"[system] fixed_box has no vertex in it; they lie from {' to '.join(sides)}")
    else:
        found = sorted(set(section.fixed or ()))
    if found and found[-1] >= count:
        raise ValueError(f"[system] fixed has the vertex {found[-1]}; the mesh has {count}, from 0 to {count - 1}")
    if len(found) == count:
        raise ValueError(f"[system] fixed has all {count} vertices of the mesh; leave some that can move")
    return found


def _areBetween(mesh: Mesh, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each coordinate of the vertices, or of one of their images, is between two others."""
    if mesh.images is None:
        return (mesh.vertices >= low) & (mesh.vertices <= high)
    lengths = np.diag(mesh.images)
    return np.ceil((low - mesh.vertices) / lengths) <= np.floor((high - mesh.vertices) / lengths)


def addSection(system: mm.System, section: SystemSection) -> None:
    """Give the System of a membrane what a configuration's [system] has."""
    for vertex in section.fixed or ():
        system.setParticleMass(vertex, 0.0)
    for file in section.forces or ():
        for force in loadForces(file, system.getNumParticles()):
            system.addForce(force)


def loadForces(file: PathLike, numVertices: int) -> list[mm.Force]:
    """Return the Forces of OpenMM's XML of a Force or a System.

    Raises a FileNotFoundError or a ValueError that names the file.
    """
    path = Path(file)
    if not path.is_file():
        raise FileNotFoundError(f"[system] forces: there is no file {path}")
    try:
        found = mm.XmlSerializer.deserialize(path.read_text(encoding="utf-8"))
    except Exception as error:  # of what is no XML of its own OpenMM makes anything
        raise ValueError(f"[system] forces: {path} is not OpenMM's XML of a Force or a System: {error}") from None
    if isinstance(found, mm.System):
        return _forcesOf(found, path, numVertices)
    if not isinstance(found, mm.Force):
        raise ValueError(f"[system] forces: {path} has a {type(found).__name__}; it must be a Force or a System")
    _requireOther(found, path)
    return [found]


def additionsTo(simulation: app.Simulation, numVertices: int) -> Setup:
    """Return a setup that gives another System of the membrane what a Simulation's has beside it."""
    own = simulation.system

    def setup(system: mm.System, scene: Any) -> Any:
        for i in range(own.getNumParticles()):
            if i >= numVertices:
                system.addParticle(own.getParticleMass(i))
            elif own.getParticleMass(i)._value == 0:
                system.setParticleMass(i, 0.0)
        for force in otherForces(own):
            system.addForce(mm.XmlSerializer.clone(force))
        return scene.mesh.beads

    return setup


def otherForces(system: mm.System) -> list[mm.Force]:
    """Return the forces of a System beside the membrane's, which is its first HelfrichForce."""
    forces = system.getForces()
    own = next(i for i, force in enumerate(forces) if HelfrichForce.isinstance(force))
    return forces[:own] + forces[own + 1 :]


def requireCreated(
    system: mm.System, section: SystemSection, numVertices: int, create: Callable[[mm.System], mm.Context]
) -> None:
    """Raise a ValueError if no Context can be created with one of the forces beside the membrane's and those before
    it; it names that force.
    """
    others = otherForces(system)
    membrane = next(force for force in system.getForces() if HelfrichForce.isinstance(force))
    for n in range(len(others) + 1):
        try:
            create(_withForces(system, [membrane, *others[:n]]))
        except mm.OpenMMException as error:
            if n > 0:
                raise ValueError(f"{_namesOf(others, section, numVertices)[n - 1]} cannot be used: {error}") from None
            return


def requireFinite(context: mm.Context, section: SystemSection | None, numVertices: int) -> None:
    """Raise a ValueError unless energy and forces in a Context are finite; it names the force of OpenMM that is not.

    Without a [system] it is not known from where they are.  Of the membrane's it is an OpenMMException.
    """
    problem = _infinityIn(context)
    if problem is None:
        return
    others = otherForces(context.getSystem())
    for name, force in zip(_namesOf(others, section, numVertices), others):
        own = _infinityIn(_contextOf(force, context))
        if own is not None:
            raise ValueError(f"{name} has {own}")
    raise ValueError(f"the membrane and all that is beside it have, together, {problem}")


def _namesOf(others: list[mm.Force], section: SystemSection | None, numVertices: int) -> list[str]:
    """Return what messages call the forces beside the membrane's: those of files, and then those of a setup."""
    if section is None:
        return [f"the {_title(force)} beside the membrane" for force in others]
    files = [file for file in section.forces or () for _ in loadForces(file, numVertices)]
    names = [f"[system] forces: the {_title(force)} of {file}" for force, file in zip(others, files)]
    return names + [f"setup: the {_title(force)}" for force in others[len(files) :]]


def _title(force: mm.Force) -> str:
    """Return the class of a force, and its name if it has one."""
    kind, name = type(force).__name__, force.getName()
    return kind if name == kind else f"{kind} {name!r}"


def _infinityIn(context: mm.Context) -> str | None:
    """Return what is not finite: the energy, or the force on a particle that can move."""
    state, system = context.getState(energy=True, forces=True), context.getSystem()
    energy, forces = state.getPotentialEnergy()._value, state.getForces(asNumpy=True)._value
    if not np.isfinite(energy):
        return f"the energy {energy} kJ/mol at the start; it must be finite"
    isInfinite = ~np.all(np.isfinite(forces), axis=1)
    if np.any(isInfinite):
        for i in np.flatnonzero(isInfinite & ~heldParticles(system)).tolist():
            force = ", ".join(f"{x:.4g}" for x in forces[i])
            return f"the force ({force}) kJ/mol/nm on particle {i} at the start; it must be finite"
    return None


def _contextOf(force: mm.Force, context: mm.Context) -> mm.Context:
    """Return a Context like another, of one of its forces alone."""
    system, state = _withForces(context.getSystem(), [force]), context.getState(positions=True)
    alone = mm.Context(system, mm.VerletIntegrator(0), context.getPlatform())
    alone.setPeriodicBoxVectors(*state.getPeriodicBoxVectors())
    alone.setPositions(state.getPositions())
    for name in alone.getParameters():
        alone.setParameter(name, context.getParameter(name))
    return alone


def _withForces(system: mm.System, forces: list[mm.Force]) -> mm.System:
    """Return a copy of a System with other forces, which are copied, too."""
    made = mm.XmlSerializer.clone(system)
    while made.getNumForces() > 0:
        made.removeForce(0)
    for force in forces:
        made.addForce(mm.XmlSerializer.clone(force))
    return made


def describe(system: mm.System, numVertices: int) -> list[str]:
    """Return what a System has beside a membrane: a sentence, or none."""
    numBeads = system.getNumParticles() - numVertices
    numFixed = sum(system.getParticleMass(i)._value == 0 for i in range(numVertices))
    parts = [
        *([f"{numBeads} bead{'s' if numBeads > 1 else ''}"] if numBeads else []),
        *([f"{numFixed} fixed {'vertices' if numFixed > 1 else 'vertex'}"] if numFixed else []),
        *(force.getName() for force in otherForces(system)),
    ]
    return [f"beside the membrane: {', '.join(parts)}"] if parts else []


def requireSame(system: mm.System, other: mm.System, prefix: PathLike) -> None:
    """Raise a ValueError unless the System of a checkpoint has what a setup makes of another."""
    count, given = system.getNumParticles(), other.getNumParticles()
    if count != given:
        raise ValueError(f"the setup makes {given} particles of vertices and beads; the run {prefix} has {count}")
    texts = [[mm.XmlSerializer.serialize(force) for force in otherForces(each)] for each in (system, other)]
    masses = [[each.getParticleMass(i) for i in range(each.getNumParticles())] for each in (system, other)]
    if texts[0] != texts[1] or masses[0] != masses[1]:
        raise ValueError(
            f"the setup makes other forces or masses than the run {prefix} has; it goes on with those of its "
            "checkpoint, and needs no setup"
        )


def _forcesOf(system: mm.System, path: Path, numVertices: int) -> list[mm.Force]:
    """Return copies of the forces of a System of as many particles as there are vertices."""
    if system.getNumParticles() != numVertices:
        raise ValueError(
            f"[system] forces: the System of {path} has {system.getNumParticles()} particles, and the mesh "
            f"{numVertices} vertices; the numbers must be equal. Beads take a script: mh.run(config, setup=...)"
        )
    if system.getNumConstraints() > 0:
        raise ValueError(f"[system] forces: the System of {path} has constraints, which trajectories do not support")
    for force in system.getForces():
        _requireOther(force, path)
    return [mm.XmlSerializer.clone(force) for force in system.getForces()]


def _requireOther(force: mm.Force, path: Path) -> None:
    if HelfrichForce.isinstance(force):
        raise ValueError(f"[system] forces: {path} has a HelfrichForce; the membrane's own comes from [membrane]")


def beadPositions(positions: Any, count: int) -> NDArray[np.float64]:
    """Return the positions that a setup returned, as a (B, 3) array, or raise a ValueError if they are not those of the
    beads.
    """
    if positions is None:
        positions = np.empty((0, 3))
    try:
        found = np.array(valueIn(positions, unit.nanometer, "what the setup returns"), dtype=np.float64)
    except (TypeError, ValueError):
        found = np.full(1, np.nan)
    if count == 0:
        if found.size > 0:
            raise ValueError("the setup returned something, and added no particles; add beads, or return nothing")
        return np.empty((0, 3))
    if found.shape != (count, 3) or not np.all(np.isfinite(found)):
        raise ValueError(
            f"the setup added {count} particle{'' if count == 1 else 's'} to the System; it must return their "
            f"positions, an array of finite numbers, in nm, of shape ({count}, 3)"
        )
    return found
