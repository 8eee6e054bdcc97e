"""Topologies of FreeDTS, .tsi and .q: a box, vertices and triangles, each with its number."""

import numpy as np
from numpy.typing import NDArray

from .content import Content
from .text import Lines


def readTSI(content: bytes) -> Content:
    """Read a .tsi file's bytes: sections of a name and a number of lines."""
    lines = Lines(content)
    sections: dict[str, int] = {}
    i = 0
    while i < len(lines):
        name = lines.texts[i].split()[0].lower()
        if not name.replace("_", "").isalpha() or name in sections:
            raise lines.fault(i, "the name of a section that is not there yet, like box, vertex or triangle")
        sections[name] = i
        count = 0 if name in ("version", "box") else _count(lines, i)
        if name == "vector_fields":  # each vertex has a line, and the number is that of fields
            count = _count(lines, sections["vertex"]) if "vertex" in sections else 0
        lines.require(i + 1, count, f"lines of the section {name}")
        i += 1 + count
    for name in ("box", "vertex", "triangle"):
        if name not in sections:
            raise ValueError(f"it is not complete: it has no section '{name}'")
    result = _content(
        lines,
        lines.rows([sections["box"]], 3, float, "box and its lengths", skip=1)[0],
        *(x for name in ("vertex", "triangle") for x in (sections[name] + 1, _count(lines, sections[name]))),
    )
    for name in sorted(sections.keys() - {"version", "box", "vertex", "triangle"}):
        result.noteLeftOut(
            _count(lines, sections[name]),
            "vector fields" if name == "vector_fields" else f"lines of the section '{name}'",
        )
    return result


def readQ(content: bytes) -> Content:
    """Read a .q file's bytes: the box, the number of vertices, these, the number of triangles, and these."""
    lines = Lines(content)
    lines.require(0, 2, "lines of box and number of vertices")
    box = lines.table(0, 1, 3, float, "the lengths of the box")[0]
    numVertices = lines.integers(1, 1, "the number of vertices")[0]
    lines.require(2, numVertices + 1, "lines of vertices and the number of triangles")
    numTriangles = lines.integers(2 + numVertices, 1, "the number of triangles")[0]
    result = _content(lines, box, 2, numVertices, 3 + numVertices, numTriangles)
    result.noteLeftOut(len(lines) - 3 - numVertices - numTriangles, "lines after the last triangle")
    return result


def _count(lines: Lines, i: int) -> int:
    words = lines.texts[i].split()
    if len(words) < 2 or not words[1].isdecimal():
        raise lines.fault(i, "the name of a section and its number of lines")
    return int(words[1])


def _content(
    lines: Lines, box: NDArray[np.float64], firstVertex: int, numVertices: int, firstTriangle: int, numTriangles: int
) -> Content:
    numbers = lines.table(firstVertex, numVertices, 1, int, "the number of a vertex")[:, 0]
    points = lines.table(firstVertex, numVertices, 3, float, "a number and the coordinates of a vertex", skip=1)
    triangles = lines.table(firstTriangle, numTriangles, 3, int, "a number and three vertices", skip=1)
    if not np.array_equal(numbers, np.arange(numVertices)):
        triangles = _byPlace(numbers, triangles)
    result = Content.ofTriangles(points, triangles)
    if not (np.all(np.isfinite(box)) and np.all(box > 0)):
        raise ValueError(f"the box is {' x '.join(f'{length:g}' for length in box)}; its lengths must be positive")
    result.box = np.diag(box)
    return result


def _byPlace(numbers: NDArray[np.integer], triangles: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the places of the vertices of some numbers."""
    order = np.argsort(numbers, kind="stable")
    if len(numbers) == 0 or np.any(np.diff(numbers[order]) == 0):
        raise ValueError("two vertices have the same number; each must have its own")
    place = np.minimum(np.searchsorted(numbers[order], triangles), len(numbers) - 1)
    unknown = triangles[numbers[order][place] != triangles]
    if len(unknown):
        raise ValueError(f"a triangle has the vertex {unknown[0]}; no vertex has that number")
    return order[place]


def textOf(
    suffix: str, points: NDArray[np.float64], triangles: NDArray[np.integer], box: NDArray[np.float64] | None
) -> str:
    """Return the text of a .tsi or .q file; without a box, it has one of twice the mesh's extent."""
    lengths = 2 * np.ptp(points, axis=0) if box is None else np.diag(box)
    if box is not None and np.any(box != np.diag(lengths)):
        raise ValueError("the box is not rectangular; FreeDTS has rectangular boxes only")
    vertices = [f"{i:8d} {x:24.17g} {y:24.17g} {z:24.17g}" for i, (x, y, z) in enumerate(points.tolist())]
    faces = [f"{i:8d} {a:8d} {b:8d} {c:8d}" for i, (a, b, c) in enumerate(triangles.tolist())]
    sides = " ".join(f"{length:.17g}" for length in lengths)
    if suffix == ".tsi":
        head = ["version 1.1", f"box {sides}", f"vertex {len(vertices)}"]
        lines = [*head, *vertices, f"triangle {len(faces)}", *faces]
    else:
        lines = [sides, str(len(vertices)), *(f"{line} 0" for line in vertices), str(len(faces))]
        lines += [f"{line} 0" for line in faces]
    return "\n".join(lines) + "\n"
