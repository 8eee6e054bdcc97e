"""DCD trajectories as sequences of meshes.

DCD has positions alone: the triangles come from a topology, and stay as they are there.
"""

import contextlib
import ctypes
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..files import PathLike
from ..geometry.connectivity import trianglesFromEdges
from ..geometry.mending import foldedEdges
from ..geometry.mesh import Mesh
from ..geometry.quality import dihedralAngles
from ..optional import require
from .runfiles import TRAJECTORY
from .vtkhdf import Frames, MeshFrame, meshFrame

# A surface whose edges have flipped, drawn with those that it had before, is folded at many edges: by more than this
# angle, in degrees, at more than this part of them.
_FOLD, _MOST_FOLDS = 120.0, 0.02


class DCDTrajectory(Frames):
    """The frames of a DCD file, with the triangles of a topology."""

    lengthUnit = "nm"

    def __init__(self, file: PathLike, topology: PathLike | None):
        """Open a DCD file.

        Parameters
        ----------
        file : path
            the DCD file; 10 angstroms in it are 1 nm
        topology : path
            a mesh file, or a PSF file whose bonds are the edges of closed membranes

        Raises
        ------
        FileNotFoundError
            if there is no such file
        ValueError
            if a file is damaged, the topology is missing or has another number of vertices, its bonds do not tell
            triangles, or these are no longer those of the last frame, as edges have flipped
        """
        formats = require("mdtraj", "reading DCD files").formats
        self._path = Path(file)
        if topology is None:
            raise ValueError(
                f"{file} has no triangles; give a topology that has them: a mesh file, or the PSF file of the run"
            )
        for path in (self._path, Path(topology)):
            if not path.exists():
                raise FileNotFoundError(f"there is no file {path}")
        with self._complaint("is not a complete DCD file"):
            with _silentLibraries():
                self._file = formats.DCDTrajectoryFile(str(file))
            start, interval = np.fromfile(file, "<i4", 5)[3:5].tolist()
            self.steps = start + interval * np.arange(len(self._file), dtype=np.int64)
            first = self._positions(0)
        self._triangles, self._box = _trianglesOf(Path(topology), first, self._path)
        if len(self) and _folds(self[-1].mesh) > _MOST_FOLDS:
            whole = self._path.with_suffix(TRAJECTORY)
            better = f"{whole} has" if whole.exists() else f"a mesh trajectory ({TRAJECTORY}) would have"
            raise ValueError(
                f"{topology} does not have the triangles of the last frame of {file}: edges have flipped since; "
                f"{better} those of each frame"
            )

    def _positions(self, i: int) -> np.ndarray:
        with _silentLibraries(), np.errstate(all="ignore"):  # what is no number is told by Mesh
            self._file.seek(i)
            return self._file.read(1)[0][0].astype(np.float64) / 10

    def _read(self, i: int) -> MeshFrame:
        positions, numVertices = self._positions(i), int(self._triangles.max()) + 1
        mesh = Mesh(positions[:numVertices], self._triangles, self._box, positions[numVertices:])
        return meshFrame(int(self.steps[i]), mesh)


def _folds(mesh: Mesh) -> float:
    """Return the part of a mesh's edges at which it is folded."""
    return float((np.abs(dihedralAngles(mesh)) > _FOLD).mean())


@contextlib.contextmanager
def _silentLibraries() -> Iterator[None]:
    """Keep the DCD library's own remarks, which C prints, from the screen."""
    screen, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
        ctypes.CDLL(None).fflush(None)
    finally:
        os.dup2(screen, 1)
        os.close(screen)
        os.close(nowhere)


def _trianglesOf(topology: Path, positions: np.ndarray, dcd: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the triangles that a mesh file or a PSF file gives to these positions, and the box of a periodic mesh."""
    if topology.suffix.lower() != ".psf":
        mesh = Mesh.read(topology)
        _requireSize(topology, len(mesh.vertices), dcd, positions)
        return mesh.triangles, mesh.images
    bonds, size = _readBonds(topology)
    _requireSize(topology, size, dcd, positions)
    try:
        # beads have no bonds, and come last
        vertices = positions[: bonds.max(initial=-1) + 1]
        triangles = trianglesFromEdges(bonds, vertices)
        if (sentence := foldedEdges(vertices, triangles)) is not None:
            raise ValueError(f"{sentence}, which a PSF file does not have; give a mesh file that does")
    except ValueError as error:
        raise ValueError(f"{topology}: {error}") from None
    return triangles, None


def _requireSize(topology: Path, size: int, dcd: Path, positions: np.ndarray) -> None:
    if size != len(positions):
        raise ValueError(
            f"{topology} has {size} vertices and {dcd} has {len(positions)} atoms; the numbers must be equal"
        )


def _readBonds(file: Path) -> tuple[np.ndarray, int]:
    """Return the bonds of a PSF file as a (E, 2) array, and the number of its atoms."""
    try:
        topology = require("mdtraj", "reading PSF files").load_topology(str(file))
    except Exception as error:  # a damaged file raises anything
        raise ValueError(f"{file} is not a complete PSF file: {error}") from None
    return np.array([(a.index, b.index) for a, b in topology.bonds], dtype=np.int64).reshape(-1, 2), topology.n_atoms
