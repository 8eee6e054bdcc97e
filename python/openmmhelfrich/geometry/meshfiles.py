"""Files of meshes, by the library meshio."""

import contextlib
import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..files import replacing

# What the head of a file must hold, lest the mesh library searches for it beyond the end, for ever.
_HEAD = {".ply": rb"(?m)^end_header\s*$", ".off": rb"(?m)^[ \t]*\d"}
# The mesh library would take .msh for an Ansys file first, and STL for text.
_FORMAT = {".msh": "gmsh", ".stl": "stl"}
_WITH_DATA = (".vtu", ".vtk", ".ply")
_WRITE_OPTIONS = {".stl": {"binary": True}}


def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Return the points, (N, 3), and the triangles, (T, 3), of a file; raise a ValueError if it holds others."""
    return _trianglesOf(_readFile(path))


def write(
    path: Path,
    points: NDArray[np.float64],
    triangles: NDArray[np.integer],
    data: Mapping[str, ArrayLike] | None,
) -> None:
    """Write a file, with data at the points where its format has room for such, replacing one that exists in a single
    step.
    """
    import meshio

    suffix = path.suffix.lower()
    requireFormat(path)
    mesh = meshio.Mesh(points, [("triangle", triangles)], point_data=data if suffix in _WITH_DATA else None)
    try:
        with replacing(path) as part, _silence():
            meshio.write(part, mesh, file_format=_FORMAT.get(suffix), **_WRITE_OPTIONS.get(suffix, {}))
    except meshio.WriteError as error:
        raise ValueError(f"{path}: {error}") from None


def _readFile(path: Path) -> Any:
    """Read a file with the mesh library, whatever way it has to fail."""
    import meshio

    suffix = path.suffix.lower()
    try:
        if re.search(_HEAD.get(suffix, b""), path.read_bytes()):
            with _silence(), _refuseNumbersOfNodes(above=path.stat().st_size):
                return meshio.read(path, file_format=_FORMAT.get(suffix))
    except PermissionError:
        raise
    except (Exception, SystemExit):  # a damaged file raises anything from IndexError to an exit of the interpreter
        pass
    raise ValueError(f"this is not a complete {suffix[1:].upper()} file")


def _trianglesOf(data: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and the triangles of what the mesh library read."""
    others = sorted({block.type for block in data.cells} - {"triangle", "line", "vertex"})
    if others:
        raise ValueError(f"the mesh has cells of type {', '.join(others)}; all must be triangles")
    blocks = [block.data for block in data.cells if block.type == "triangle" and len(block.data)]
    if not blocks:
        raise ValueError("the mesh has no triangles")
    return data.points, np.concatenate(blocks)


def requireFormat(path: Path, *others: str) -> None:
    """Raise a ValueError if the suffix of a file is neither that of a mesh format nor one of some others."""
    import meshio

    suffix = path.suffix.lower()
    if suffix not in meshio.extension_to_filetypes and suffix not in others:
        kind = "format" if others else "mesh format"
        raise ValueError(
            f"{path}: no {kind} has the suffix '{suffix}'; use one of "
            f"{', '.join(('.stl', '.ply', '.obj', '.off', '.vtu', '.vtk', '.msh', *others))}"
        )


def _refuseNumbersOfNodes(above: int) -> contextlib.AbstractContextManager[Any]:
    """Keep the mesh library from a table up to the greatest number of a node, which in a damaged MSH file may be any of
    64 bits.
    """
    from meshio.gmsh import _gmsh41

    read = _gmsh41._read_nodes

    def checked(*arguments: Any) -> tuple[Any, ...]:
        points, numbers, *rest = read(*arguments)
        if numbers.max() > above:
            raise ValueError("a node has a number that is larger than the file")
        return points, numbers, *rest

    return mock.patch.object(_gmsh41, "_read_nodes", checked)


def _silence() -> contextlib.ExitStack:
    """Keep the mesh library from printing what the exceptions say, and from warning that text is no number."""
    stack = contextlib.ExitStack()
    stack.enter_context(np.errstate(all="ignore"))
    stack.enter_context(contextlib.redirect_stdout(io.StringIO()))
    stack.enter_context(contextlib.redirect_stderr(io.StringIO()))
    return stack
