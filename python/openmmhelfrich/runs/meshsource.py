"""The mesh that a configuration names."""

import contextlib
import warnings
from collections.abc import Iterator

from ..geometry.mesh import Mesh
from .config import Config, namingSource
from .memory import requireMemory


def loadMesh(config: Config) -> Mesh:
    """Read or make, and check, the mesh of a Config, in its length unit.

    Its notes say what has been done to it.
    """
    if config.mesh.icosphere is not None:
        source, mesh = "[mesh] icosphere", Mesh.icosphere(config.mesh.icosphere, config.mesh.scale)
    elif config.mesh.sheet is not None:
        source, scale = "[mesh] sheet", config.mesh.scale
        with namingSource(config), _after("[mesh]"):
            mesh = Mesh.sheet(*(scale * length for length in config.mesh.sheet))
    else:
        source = str(config.mesh.file)
        field = config.mesh.species_field
        mesh = Mesh.read(source, unit=config.mesh.scale, repair=config.mesh.repair, speciesField=field)
        if field is None:
            mesh.species = None  # [[species]] say where they are
    try:
        mesh.check()
        if config.mesh.remesh is not None:
            with warnings.catch_warnings(record=True):  # they are among the notes
                mesh = mesh.remeshed(config.mesh.remesh)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
    if config.mesh.subdivide is not None:
        with _after(f"[mesh] subdivide is {config.mesh.subdivide}:"):
            mesh = _subdivided(mesh, config.mesh.subdivide)
    if config.mesh.species_field is not None and mesh.species is None:
        raise ValueError(f"{source}: the mesh has been repaired or remeshed, and so cannot have a species_field")
    return mesh


def _subdivided(mesh: Mesh, times: int) -> Mesh:
    """Return the mesh, subdivided, if the memory is there that a run of it takes."""
    requireMemory(len(mesh.vertices) + 3 * len(mesh.triangles) // 2 * (4**times - 1) // 3)
    return mesh.subdivided(times)


@contextlib.contextmanager
def _after(place: str) -> Iterator[None]:
    """Begin a ValueError with the place of the configuration that has the mistake."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{place} {error}") from None
