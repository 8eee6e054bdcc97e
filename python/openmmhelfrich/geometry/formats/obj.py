"""OBJ: the vertices and faces of all its objects."""

import re

import numpy as np
from numpy.typing import NDArray

from .content import Content
from .text import Lines

_OTHERS = {"p": "points", "l": "lines", "curv": "curves", "curv2": "curves", "surf": "free-form surfaces"}


def read(content: bytes) -> Content:
    """Read the vertices and faces of a file's bytes.

    A corner of a face is vertex/texture/normal, of which the first alone matters; a negative number counts back from
    the last vertex before the face.
    """
    lines = Lines(content, continued=True)
    vertices: list[int] = []
    faces: list[int] = []
    before: list[int] = []  # how many vertices there are before each face
    others: dict[str, int] = {}
    for i, text in enumerate(lines.texts):
        word = text.split(None, 1)[0]
        if word == "v":
            vertices.append(i)
        elif word == "f":
            faces.append(i)
            before.append(len(vertices))
        elif word in _OTHERS:
            others[_OTHERS[word]] = others.get(_OTHERS[word], 0) + 1
    if not vertices:
        raise ValueError("it has no vertices: no line begins with 'v'")
    points = lines.rows(vertices, 3, float, "v x y z", skip=1)
    corners, sizes = _readCorners(lines, faces)
    start = np.repeat(before, sizes)
    _checkCorners(lines, faces, corners, sizes, start, len(vertices))
    result = Content(points, np.where(corners < 0, corners + start, corners - 1), sizes)
    for what, count in others.items():
        result.noteLeftOut(count, what)
    return result


def _readCorners(lines: Lines, faces: list[int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the corners of the faces, as their numbers in the file, and how many each face has."""
    rows = re.sub(r"(?m)^f\s*|/\S*", "", "\n".join(lines.texts[i] for i in faces)).split("\n") if faces else []
    try:
        table = (
            np.loadtxt(rows, dtype=np.int64, ndmin=2, comments=None) if any(rows) else np.zeros((0, 3), dtype=np.int64)
        )
        if len(table) == len(rows):  # no face is empty
            return table.ravel(), np.full(len(rows), table.shape[1])
    except ValueError:  # faces of different sizes, or words that are no numbers
        pass
    return _readDifferentCorners(lines, faces, [row.split() for row in rows])


def _readDifferentCorners(
    lines: Lines, faces: list[int], rows: list[list[str]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    for i, row in zip(faces, rows):
        if not all(re.fullmatch(r"[+-]?\d{1,18}", word) for word in row):
            raise lines.fault(i, "f and the number of each corner's vertex")
    return np.array([int(word) for row in rows for word in row], dtype=np.int64), np.array([len(row) for row in rows])


def _checkCorners(
    lines: Lines,
    faces: list[int],
    corners: NDArray[np.int64],
    sizes: NDArray[np.int64],
    start: NDArray[np.int64],
    numVertices: int,
) -> None:
    wrong = np.flatnonzero((corners == 0) | (corners > numVertices) | (corners < -start))
    if len(wrong):
        face = faces[np.repeat(np.arange(len(sizes)), sizes)[wrong[0]]]
        raise lines.fault(
            face,
            f"of vertices from 1 to {numVertices}, or from -1 to {-int(start[wrong[0]])}, but one is "
            f"{corners[wrong[0]]}",
        )
