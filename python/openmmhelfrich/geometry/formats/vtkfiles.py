"""VTK, VTU and VTP by VTK itself, which comes with the extra "looking"; without it VTU and VTK by meshio.

VTK reads every dialect of its own formats: polygonal data and grids, legacy files of all versions, text and binary,
appended and compressed data in either byte order, several pieces.  Of these meshio has no polygonal data and no LZ4,
stops at sections that are not VTK's, and takes one piece of several for all.  VTK reads in a process of its own, since
a damaged file can end the process that reads it.
"""

import importlib.util
import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...optional import require
from . import meshiofiles
from ._vtkreader import FIELD
from .content import Content, trianglesOfStrip

_SECONDS = 10  # of the processor, for a small file
_BYTES = 2**31

# The types of VTK's cells: what becomes of them.
_FACES = {5: "triangle", 7: "polygon", 9: "quad"}
_STRIP, _PIXEL = 6, 8
_LEFT_OUT = {0: "empty cells", 1: "points", 2: "points", 3: "lines", 4: "lines"}


def read(path: Path) -> Content:
    """Read the triangles, strips and polygons of a file."""
    with path.open("rb") as file:
        start = file.read(1000)
    if not re.match(rb"# vtk DataFile|\s*(<\?xml|<VTKFile|<!--)", start):
        raise ValueError("it begins neither with '# vtk DataFile' nor with the element VTKFile of XML")
    if not _hasVTK():
        return _readWithoutVTK(path)
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "cells.npz"
        _readElsewhere(path, output)
        with np.load(output) as found:
            result = _content(*(found[name] for name in ("points", "types", "sizes", "corners")))
            result.fields = {name.removeprefix(FIELD): found[name] for name in found if name.startswith(FIELD)}
    # Pieces of one surface have vertices of their own along their seams, at the same positions.
    return result.welded(0.0) if path.read_bytes().count(b"<Piece") > 1 and len(result.sizes) else result


def _hasVTK() -> bool:
    return importlib.util.find_spec("vtkmodules") is not None


def _readWithoutVTK(path: Path) -> Content:
    content = path.read_bytes()
    if path.suffix.lower() == ".vtp" or re.search(rb"(?m)^DATASET\s+POLYDATA", content[:2000]):
        require("vtkmodules", f"reading polygonal data ({path.suffix})")
    if content.count(b"<Piece") > 1:
        require("vtkmodules", "reading several pieces")
    return meshiofiles.read(path)


def _readElsewhere(path: Path, output: Path) -> None:
    """Have VTK read a file in a process of its own, which leaves arrays in another file."""
    size = path.stat().st_size
    seconds = _SECONDS + size // 1000000
    limits = {"OPENBLAS_NUM_THREADS": "1", "READER_BYTES": str(_BYTES + 40 * size), "READER_SECONDS": str(seconds)}
    try:
        done = subprocess.run(
            [sys.executable, "-I", str(Path(__file__).with_name("_vtkreader.py")), str(path), str(output)],
            capture_output=True,
            timeout=12 * seconds,
            env=os.environ | limits,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ValueError("VTK does not come to an end of reading it") from None
    if done.returncode == -signal.SIGXCPU:
        raise ValueError("VTK does not come to an end of reading it")
    if done.returncode != 0 or not output.exists():
        raise ValueError(f"VTK cannot read it: {_reason(done.stderr.decode('utf-8', 'replace'))}")


def _reason(text: str) -> str:
    """Return what VTK said was wrong."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", text)
    found = re.findall(r"\((?:0x)?[0-9a-f]+\): (.*)", text) or [line for line in text.splitlines() if line.strip()][-1:]
    return found[0].strip() if found else "it is damaged"


def _content(
    points: NDArray[np.floating], types: NDArray[np.int64], sizes: NDArray[np.int64], corners: NDArray[np.int64]
) -> Content:
    """Return the faces of cells of all types, in their order."""
    others = sorted(set(types.tolist()) - {*_FACES, _STRIP, _PIXEL, *_LEFT_OUT})
    if others:
        raise ValueError(
            f"the mesh has cells of VTK's type {', '.join(map(str, others))}; a surface has triangles, strips, quads "
            "and polygons (5, 6, 7, 8, 9)"
        )
    isFace = np.isin(types, list(_FACES))
    if np.any((types == _STRIP) | (types == _PIXEL)):
        result = Content.ofFaces(points, _unfolded(types, sizes, corners))
    else:
        result = Content(points, corners[np.repeat(isFace, sizes)], sizes[isFace])
    for what in dict.fromkeys(_LEFT_OUT.values()):
        kinds = [kind for kind, name in _LEFT_OUT.items() if name == what]
        result.noteLeftOut(int(np.sum(np.isin(types, kinds))), what)
    return result


def _unfolded(types: NDArray[np.int64], sizes: NDArray[np.int64], corners: NDArray[np.int64]) -> list[list[int]]:
    """Return faces as lists of corners: strips as triangles, and pixels in cyclic order."""
    faces = []
    for kind, cell in zip(types.tolist(), np.split(corners, np.cumsum(sizes)[:-1])):
        ring = cell.tolist()
        if kind == _STRIP:
            faces += trianglesOfStrip(ring)
        elif kind == _PIXEL:
            faces.append([ring[0], ring[1], ring[3], ring[2]])
        elif kind in _FACES:
            faces.append(ring)
    return faces
