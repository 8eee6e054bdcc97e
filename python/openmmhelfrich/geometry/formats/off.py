"""OFF, as text: with normals, colors, texture coordinates and comments, which are left out."""

import re

import numpy as np

from .content import Content
from .text import Lines


def read(content: bytes) -> Content:
    """Read the vertices and faces of a file's bytes."""
    lines = Lines(content)
    if not len(lines):
        raise ValueError("it is not complete: it has no counts of vertices and faces")
    head = re.match(r"(?:(ST)?C?N?(4?n?)OFF|off)(?![A-Za-z])\s*(BINARY)?", lines.texts[0])
    if head:
        if head[2] or head[3]:
            raise lines.fault(0, "OFF, STOFF, COFF, NOFF or such: three coordinates a vertex, and text")
        lines.texts[0] = lines.texts[0][head.end() :].strip()
    elif not re.match(r"\d+\s+\d+", lines.texts[0]):
        raise lines.fault(0, "OFF, or the numbers of vertices and faces")
    start = 0 if lines.texts[0] else 1
    lines.require(start, 1, "lines with the numbers of vertices and faces")
    numVertices, numFaces, *_ = lines.integers(start, 2, "the numbers of vertices and faces")
    points = lines.table(start + 1, numVertices, 3, float, "the coordinates of a vertex")
    faces = _readFaces(lines, start + 1 + numVertices, numFaces)
    faces.points = points
    faces.noteLeftOut(len(lines) - (start + 1 + numVertices + numFaces), "lines after the last face")
    return faces


def _readFaces(lines: Lines, first: int, count: int) -> Content:
    nothing, what = np.zeros((0, 3)), "the number of a face's corners, and each corner's vertex"
    sizes = lines.table(first, count, 1, int, what)[:, 0]
    if np.all(sizes == 3):
        return Content.ofTriangles(nothing, lines.table(first, count, 3, int, what, skip=1))
    faces = []
    for i, size in enumerate(sizes.tolist(), start=first):
        words = lines.texts[i].split()[1 : size + 1]
        if size < 0 or len(words) < size or not all(re.fullmatch(r"[+-]?\d+", word) for word in words):
            raise lines.fault(i, what)
        faces.append([int(word) for word in words])
    return Content.ofFaces(nothing, faces)
