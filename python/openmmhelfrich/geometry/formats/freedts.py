"""Topologies of FreeDTS, .tsi and .q: a box, vertices and triangles, each with its number.

FreeDTS's box reaches from 0 to its lengths, and it ends with a segmentation fault where a vertex is outside.  So files
have the mesh within the box, and where FreeDTS looks at nothing a comment, "# origin X Y Z", says where it was.
"""

import re

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
    return _atOrigin(content, result)


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
    return _atOrigin(content, result)


def _atOrigin(content: bytes, result: Content) -> Content:
    """Return what was read with the origin that a comment has added to its points."""
    found = re.search(r"# origin (.*)", content.decode("utf-8", errors="replace"))
    if found:
        try:
            x, y, z = (float(word) for word in found[1].split())
        except ValueError:
            raise ValueError(f"its origin is '{found[1][:60]}'; it must be three numbers") from None
        result.points = result.points + np.array([x, y, z])
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
    if box is None:
        lengths = 2 * np.ptp(points, axis=0)
        lengths[lengths == 0] = lengths.max()
    else:
        lengths = np.diag(box)
        if np.any(box != np.diag(lengths)):
            raise ValueError("the box is not rectangular; FreeDTS has rectangular boxes only")
    origin = _originFor(points, lengths)
    vertices = [f"{i:8d} {x:24.17g} {y:24.17g} {z:24.17g}" for i, (x, y, z) in enumerate((points - origin).tolist())]
    faces = [f"{i:8d} {a:8d} {b:8d} {c:8d}" for i, (a, b, c) in enumerate(triangles.tolist())]
    sides = " ".join(f"{length:.17g}" for length in lengths)
    comment = "# origin " + " ".join(f"{x:.17g}" for x in origin) if np.any(origin) else ""
    if suffix == ".tsi":
        head = [f"version 1.1 {comment}".rstrip(), f"box {sides}", f"vertex {len(vertices)}"]
        lines = [*head, *vertices, f"triangle {len(faces)}", *faces]
    else:
        lines = [sides, str(len(vertices)), *(f"{line} 0" for line in vertices), str(len(faces))]
        lines += [*(f"{line} 0" for line in faces), *([comment] if comment else [])]
    return "\n".join(lines) + "\n"


def _originFor(points: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what to subtract from points for a box that begins at 0: nothing if they are within it, else what brings
    them to its middle, rounded so that the difference loses no digits of coarser numbers.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    if np.all((low >= 0) & (high < lengths)):
        return np.zeros(3)
    room = lengths - (high - low)
    if np.any(room <= 0):
        sizes = " and ".join(" x ".join(f"{x:g}" for x in each) for each in (high - low, lengths))
        raise ValueError(f"the sizes of the mesh and its box are {sizes}; FreeDTS needs all vertices within the box")
    step = 2.0 ** np.floor(np.log2(room / 2))
    return step * np.round((low + high - lengths) / 2 / step)
