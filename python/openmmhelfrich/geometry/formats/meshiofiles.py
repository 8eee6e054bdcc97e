"""GMSH, and every other format that the library meshio knows."""

import contextlib
import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...messages import inLine
from .content import Content

_FORMAT = {".msh": "gmsh"}  # meshio would take it for an Ansys file first
_CORNERS = {"triangle": 3, "quad": 4}
# What comes back from these is as it was written; the others are for volumes, or not what their readers take.
WRITTEN = (
    *(".avs", ".dat", ".dato", ".h5m", ".hmf", ".inp", ".mdpa", ".med", ".mesh", ".meshb", ".msh", ".obj", ".off"),
    *(".ply", ".post", ".stl", ".tec", ".vol", ".vtk", ".vtu", ".xdmf", ".xmf", ".xml"),
)
# SVG is not read at all, and TetGen's files have no surfaces; without tetrahedra their reader does not end.
_NO_SURFACES = {".svg", ".node", ".ele"}
# What makes a file whole: numbers in the file itself, and not in one beside it.
_OPTIONS: dict[str, dict[str, Any]] = {
    ".stl": {"binary": True},
    ".xdmf": {"data_format": "XML"},
    ".xmf": {"data_format": "XML"},
}
_LEFT_OUT = {"vertex": "points", "line": "lines"}
# Where meshio writes the time into a comment: without it equal meshes become equal files.
_DATED, _DATE, _HEAD = (".ply", ".obj"), re.compile(rb"(?m)^(comment|#) Created by meshio.*\n"), 1000


def read(path: Path) -> Content:
    """Read the triangles and quads of a file with meshio, whatever way it has to fail."""
    import meshio

    suffix = path.suffix.lower()
    said = io.StringIO()
    try:
        with _silence(said), _refuseNumbersOfNodes(above=path.stat().st_size):
            mesh = meshio.read(path, file_format=_FORMAT.get(suffix))
    except (PermissionError, MemoryError):
        raise
    except (Exception, SystemExit) as error:  # a damaged file raises anything from IndexError to an exit
        raise ValueError(f"meshio cannot read it as {suffix[1:].upper()}: {_reason(error, said.getvalue())}") from None
    return _content(mesh)


def write(
    path: Path,
    suffix: str,
    points: NDArray[np.float64],
    triangles: NDArray[np.integer],
    data: Mapping[str, ArrayLike] | None,
) -> None:
    """Write a file in the format that a suffix names, one of :data:`WRITTEN`, with data at the points."""
    import meshio

    if suffix == ".vtk" and data is not None:  # whose 32-bit whole numbers meshio calls what VTK does not know
        data = {name: np.asarray(v, np.int64) if np.asarray(v).dtype.kind in "iub" else v for name, v in data.items()}
    mesh = meshio.Mesh(points, [("triangle", triangles)], point_data=data)
    kind = _FORMAT.get(suffix) or meshio.extension_to_filetypes[suffix][0]
    said = io.StringIO()
    try:
        with _silence(said):
            meshio.write(path, mesh, file_format=kind, **_OPTIONS.get(suffix, {}))
    except (OSError, MemoryError):
        raise
    except (Exception, SystemExit) as error:  # an assertion, where a number has no room
        raise ValueError(f"meshio cannot write it as {suffix[1:].upper()}: {_reason(error, said.getvalue())}") from None
    if suffix in _DATED:
        content = path.read_bytes()
        path.write_bytes(_DATE.sub(b"", content[:_HEAD]) + content[_HEAD:])


def suffixes() -> set[str]:
    """Return the suffixes of the formats that meshio reads surfaces from."""
    import meshio

    return set(meshio.extension_to_filetypes) - _NO_SURFACES


def _reason(error: BaseException, said: str) -> str:
    """Return why the library failed: what it printed or raised."""
    lines = [inLine(line) for line in said.splitlines() if line.strip() and "Couldn't read file" not in line]
    if isinstance(error, SystemExit) or not str(error):
        return lines[0] if lines else "it is damaged, or of another format"
    words = inLine(error)
    return words if isinstance(error, (ValueError, OSError)) else f"{type(error).__name__} {words}"


def _content(mesh: Any) -> Content:
    others = sorted({block.type for block in mesh.cells} - {*_CORNERS, *_LEFT_OUT})
    if others:
        raise ValueError(f"the mesh has cells of type {', '.join(others)}; a surface has triangles and quads")
    faces = [block for block in mesh.cells if block.type in _CORNERS]
    if not faces:
        raise ValueError("the mesh has no triangles")
    result = Content(
        mesh.points,
        np.concatenate([block.data.ravel() for block in faces]),
        np.concatenate([np.full(len(block.data), _CORNERS[block.type]) for block in faces]),
    )
    result.fields = {name: values for name, values in mesh.point_data.items() if np.ndim(values) == 1}
    for kind, what in _LEFT_OUT.items():
        result.noteLeftOut(sum(len(block.data) for block in mesh.cells if block.type == kind), what)
    return result


def _refuseNumbersOfNodes(above: int) -> Any:
    """Keep meshio from a table up to the greatest number of a node, which may be anything in a damaged MSH file."""
    from meshio.gmsh import _gmsh41

    read = _gmsh41._read_nodes

    def checked(*arguments: Any) -> tuple[Any, ...]:
        points, numbers, *rest = read(*arguments)
        if numbers.max() > above:
            raise ValueError("a node has a number that is larger than the file")
        return points, numbers, *rest

    return mock.patch.object(_gmsh41, "_read_nodes", checked)


def _silence(said: io.StringIO) -> contextlib.ExitStack:
    """Keep the library from printing, and from warning that text is no number."""
    stack = contextlib.ExitStack()
    stack.enter_context(np.errstate(all="ignore"))
    stack.enter_context(contextlib.redirect_stdout(said))
    stack.enter_context(contextlib.redirect_stderr(said))
    return stack
