"""What a mesh file holds, whatever its format, and how its faces become triangles."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mending import counted, weldRims

# The grade of a corner that a face has lost already, which is worse than any other.
_CUT_OFF = 9


@dataclass
class Content:
    """Points and faces of a file.

    Attributes
    ----------
    points : (N, 3) array
        positions, in the file's unit
    corners : (C,) array of int
        the corners of all faces, one face after the other
    sizes : (F,) array of int
        how many corners each face has
    notes : list of str
        sentences on what else the file has, and what became of it
    box : (3, 3) array, optional
        the vectors of the periodic box
    fields : dict
        arrays of shape (N,) by name, a number for each point
    """

    points: NDArray[np.floating]
    corners: NDArray[np.integer]
    sizes: NDArray[np.integer]
    notes: list[str] = field(default_factory=list)
    box: NDArray[np.float64] | None = None
    fields: dict[str, NDArray[Any]] = field(default_factory=dict)

    @classmethod
    def ofTriangles(cls, points: NDArray[np.floating], triangles: NDArray[np.integer], *notes: str) -> "Content":
        """Create it of faces that are all triangles."""
        return cls(points, triangles.ravel(), np.full(len(triangles), 3), list(notes))

    @classmethod
    def ofFaces(cls, points: NDArray[np.floating], faces: Iterable[list[int]], *notes: str) -> "Content":
        """Create it of lists of corners."""
        faces = list(faces)
        sizes = np.array([len(face) for face in faces], dtype=np.int64)
        return cls(points, np.array([i for face in faces for i in face], dtype=np.int64), sizes, list(notes))

    @classmethod
    def ofLooseTriangles(cls, corners: NDArray[np.floating], *notes: str) -> "Content":
        """Create it of the positions of each triangle's corners, (T, 3, 3): equal ones are one point, in order of first
        appearance.
        """
        points, places = mergeEqual(corners.reshape(-1, 3))
        return cls.ofTriangles(points, places.reshape(-1, 3), *notes)

    def noteLeftOut(self, count: int, what: str) -> None:
        """Note how many of something were left out, if there were any."""
        if count:
            self.notes.append(f"{what} were left out: {count}")

    def welded(self, distance: float) -> "Content":
        """Return the faces as triangles, with vertices of open edges that are closer than a distance made one."""
        triangles, points = self.triangles(), self.points.astype(np.float64)
        if not np.all(np.isfinite(points)):
            return self
        triangles, count = weldRims(points, triangles, distance)
        if count == 0:
            return self
        used = np.zeros(len(points), dtype=bool)
        used[triangles] = True
        where = f"that is closer than {distance:.3g}" if distance > 0 else "in the same place"
        note = f"{counted(count, 'corner')} welded to another {where}"
        result = Content.ofTriangles(self.points[used], (np.cumsum(used) - 1)[triangles], *self.notes, note)
        result.fields = {name: values[used] for name, values in self.fields.items()}
        return result

    def triangles(self) -> NDArray[np.int64]:
        """Return the faces as triangles, (T, 3); those of more corners are divided, which is noted.

        Raises
        ------
        ValueError
            if there are no triangles, or a corner is no point
        """
        numPoints, corners, sizes = len(self.points), self.corners.astype(np.int64), self.sizes.astype(np.int64)
        areTriangles = bool(np.all(sizes == 3))
        if corners.size and not (corners.min() >= 0 and corners.max() < numPoints):
            wrong = np.flatnonzero((corners < 0) | (corners >= numPoints))[0]
            raise ValueError(
                f"{'triangle' if areTriangles else 'face'} {np.searchsorted(np.cumsum(sizes), wrong, 'right')} has the "
                f"vertex {corners[wrong]}; it must be from 0 to {numPoints - 1}, for {numPoints} vertices"
            )
        if not np.any(sizes > 2):
            raise ValueError("the mesh has no triangles")
        if areTriangles:
            return corners.reshape(-1, 3)
        self.noteLeftOut(int(np.sum(sizes < 3)), "faces of less than three corners")
        result = self._divided(corners, sizes)
        wide = sizes[sizes > 3]
        if len(wide):
            kinds = ", ".join(f"{np.sum(wide == n)} of {n} corners" for n in np.unique(wide)[:5])
            self.notes.append(f"faces were divided into triangles: {kinds}")
        return result

    @np.errstate(invalid="ignore", over="ignore")  # what is no number is found later
    def _divided(self, corners: NDArray[np.int64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the triangles of faces of any size, in the order of the faces."""
        counts = np.maximum(sizes - 2, 0)
        first, place = np.cumsum(counts) - counts, np.cumsum(sizes) - sizes
        result = np.empty((counts.sum(), 3), dtype=np.int64)
        three, four = np.flatnonzero(sizes == 3), np.flatnonzero(sizes == 4)
        result[first[three]] = corners[place[three, np.newaxis] + np.arange(3)]
        halves = _halves(self.points, corners[place[four, np.newaxis] + np.arange(4)])
        result[first[four]], result[first[four] + 1] = halves
        for f in np.flatnonzero(sizes > 4).tolist():
            ring = corners[place[f] : place[f] + sizes[f]]
            result[first[f] : first[f] + counts[f]] = _ears(self.points, ring)
        return result


def mergeEqual(points: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.int64]]:
    """Return the different points, in order of first appearance, and which of them each point is."""
    order = np.lexsort(points.T)
    ordered = points[order]
    isNew = np.ones(len(points), dtype=bool)
    isNew[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    first = order[isNew]  # the sort is stable
    rank = np.empty(len(first), dtype=np.int64)
    byAppearance = np.argsort(first)
    rank[byAppearance] = np.arange(len(first))
    places = np.empty(len(points), dtype=np.int64)
    places[order] = rank[np.cumsum(isNew) - 1]
    return points[first[byAppearance]], places


def trianglesOfStrip(strip: list[int]) -> list[list[int]]:
    """Return the triangles of a strip, in which every other one runs the other way round."""
    return [
        [strip[i], strip[i + 1], strip[i + 2]] if i % 2 == 0 else [strip[i + 1], strip[i], strip[i + 2]]
        for i in range(len(strip) - 2)
    ]


def _halves(points: NDArray[np.floating], quads: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the two triangles of each face of four corners: divided by the diagonal across which they fold less, and
    by the shorter one where that does not tell.
    """

    def folds(a: int, b: int, c: int, d: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The cosine of the angle between the triangles (a, b, c) and (a, c, d)."""
        x = [points[quads[:, i]].astype(np.float64) for i in (a, b, c, d)]
        n, m = np.cross(x[1] - x[0], x[2] - x[0]), np.cross(x[2] - x[0], x[3] - x[0])
        size = np.linalg.norm(n, axis=1) * np.linalg.norm(m, axis=1)
        cosine = np.divide(np.einsum("ij,ij->i", n, m), size, out=np.full(len(n), -1.0), where=size > 0)
        return np.round(cosine, 6), np.linalg.norm(x[2] - x[0], axis=1)

    (cosine, length), (otherCosine, otherLength) = folds(0, 1, 2, 3), folds(1, 2, 3, 0)
    other = (otherCosine > cosine) | ((otherCosine == cosine) & (otherLength < length))
    quads = np.where(other[:, np.newaxis], quads[:, [1, 2, 3, 0]], quads)
    return quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]


def _ears(points: NDArray[np.floating], ring: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles of a face of many corners, which are cut off one after the other, the shortest cut first.

    Whether another corner lies in a triangle is found out for the one that is next only, and holds as long as that
    other corner is there.
    """
    x, places = _flattened(points[ring].astype(np.float64)), np.arange(len(ring))
    before, after = np.roll(places, 1), np.roll(places, -1)
    # Lower grades are cut off first: of convex corners, those in whose triangles another lies, and of reflex ones.
    grades, lengths = np.empty(len(ring), dtype=np.int64), np.empty(len(ring))
    inside, unknown, none = np.empty(len(ring), dtype=np.int64), -2, -1

    def look(some: NDArray[np.int64]) -> None:
        a, b, c = x[before[some]], x[some], x[after[some]]
        grades[some], lengths[some], inside[some] = 2 * (_areas(a, b, c) <= 0), np.linalg.norm(c - a, axis=1), unknown

    look(places)
    triangles: list[tuple[int, int, int]] = []
    while len(triangles) < len(ring) - 3:
        best = np.flatnonzero(grades == grades.min())
        b = int(best[lengths[best].argmin()])
        a, c = before[b], after[b]
        if inside[b] == unknown:
            found = np.flatnonzero((grades < _CUT_OFF) & _areInside(x, a, b, c))
            inside[b] = found[0] if len(found) else none
            grades[b] += len(found) > 0
        else:
            triangles.append((a, b, c))
            after[a], before[c], grades[b], inside[b] = c, a, _CUT_OFF, none
            look(np.concatenate(((a, c), np.flatnonzero(inside == b))))
    return ring[np.array([*triangles, np.flatnonzero(grades < _CUT_OFF)])]


def _flattened(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of a face as seen along its normal, (n, 2)."""
    x = x - x.mean(axis=0)
    normal = np.cross(x, np.roll(x, -1, axis=0)).sum(axis=0)
    normal /= np.linalg.norm(normal) or 1
    across = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
    return x @ np.column_stack((across, np.cross(normal, across)))


def _areas(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the areas of triangles in a plane, which are positive if they run counter-clockwise."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def _areInside(x: NDArray[np.float64], a: int, b: int, c: int) -> NDArray[np.bool_]:
    """Return which points lie in the triangle of three of them."""
    return (_areas(x[a], x[b], x) > 0) & (_areas(x[b], x[c], x) > 0) & (_areas(x[c], x[a], x) > 0)
