"""Files of meshes: which module reads and writes each format.

Every dialect of each format that programs write was read with several libraries; docs/how-to/meshes.md has the table.
VTK, VTU and VTP are read by VTK, which alone reads all of their dialects; glTF by trimesh; GMSH by meshio.  No library
reads all of STL, PLY, OBJ and OFF: of 26 dialects of PLY, trimesh fails on lists of different lengths, VTK crashes on
elements in another order, and meshio reads a third; of OBJ, trimesh misplaces negative numbers, and VTK divides
vertices.  These four are read here, by numpy, with the number of the line where something is wrong.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..files import replacing
from ..messages import inLine
from .formats import WRITTEN, freedts, gltf, meshiofiles, obj, off, ply, stl, trimem, vtkfiles
from .formats.content import Content

_OF_BYTES: dict[str, Callable[[bytes], Content]] = {
    ".stl": stl.read,
    ".ply": ply.read,
    ".obj": obj.read,
    ".off": off.read,
    ".tsi": freedts.readTSI,
    ".q": freedts.readQ,
    ".h5": trimem.read,
}
_OF_FILES: dict[str, Callable[[Path], Content]] = {
    ".gltf": gltf.read,
    ".glb": gltf.read,
    ".vtk": vtkfiles.read,
    ".vtu": vtkfiles.read,
    ".vtp": vtkfiles.read,
}
_POINTER = b"version https://git-lfs.github.com/spec/"
_ONLY_READ = (".gltf", ".glb", ".vtp")
_WITH_DATA = (".vtu", ".vtk", ".ply")


def read(path: Path) -> Content:
    """Read what a file holds; raise a ValueError, which does not name the file, if that is no mesh."""
    suffix = path.suffix.lower()
    with open(path, "rb") as file:
        if file.read(len(_POINTER)) == _POINTER:
            raise ValueError("it is a pointer of Git LFS to the file, and not the file; 'git lfs pull' fetches that")
    try:
        if suffix in _OF_BYTES:
            return _OF_BYTES[suffix](path.read_bytes())
        return _OF_FILES.get(suffix, meshiofiles.read)(path)
    except (ValueError, PermissionError):
        raise
    except Exception as error:  # what a library raises at a damaged file may be anything
        raise ValueError(f"it cannot be read as {suffix[1:].upper()}: {type(error).__name__} {inLine(error)}") from None


def write(
    path: Path,
    points: NDArray[np.float64],
    triangles: NDArray[np.integer],
    data: Mapping[str, ArrayLike] | None,
    box: NDArray[np.float64] | None = None,
    isPeriodic: bool = False,
) -> None:
    """Write a file, with data at the points and the box where its format has room for such, replacing one that exists
    in a single step.  PLY files have the box of a periodic surface only.
    """
    suffix = path.suffix.lower()
    requireWritten(path)
    try:
        with replacing(path) as part:
            if suffix in (".tsi", ".q"):
                part.write_text(freedts.textOf(suffix, points, triangles, box, isPeriodic), encoding="utf-8")
            elif suffix == ".h5":
                part.write_bytes(trimem.content(points, triangles))
            else:
                meshiofiles.write(part, suffix, points, triangles, data if suffix in _WITH_DATA else None)
            if suffix == ".ply" and isPeriodic and box is not None:
                part.write_bytes(ply.withBox(part.read_bytes(), box))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


# What holds the box of a periodic surface.
WITH_BOX = (".tsi", ".q", ".ply")


def requireWritten(path: Path, *others: str) -> None:
    """Raise a ValueError if the suffix of a file is neither that of a format in which meshes are written nor one of
    some others.
    """
    requireFormat(path, *others)
    suffix = path.suffix.lower()
    if suffix not in (*WRITTEN, *meshiofiles.WRITTEN, *others):
        allowed = ", ".join((*WRITTEN, *others))
        raise ValueError(f"{path}: {suffix[1:].upper()} files are read, not written; use one of {allowed}")


def requireFormat(path: Path, *others: str) -> None:
    """Raise a ValueError if the suffix of a file is neither that of a mesh format nor one of some others."""
    suffix = path.suffix.lower()
    if not {suffix} & {*_OF_BYTES, *_OF_FILES, *others} and suffix not in meshiofiles.suffixes():
        kind = "format" if others else "mesh format"
        raise ValueError(
            f"{path}: no {kind} has the suffix '{suffix}'; use one of {', '.join((*WRITTEN, *_ONLY_READ, *others))}"
        )
