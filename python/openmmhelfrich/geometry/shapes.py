"""Meshes of simple shapes to begin with, or to test against."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.spatial import ConvexHull

from ..units import wholeNumber
from .connectivity import MOST_VERTICES
from .measures import reducedVolume
from .mesh import Mesh
from .relaxation import EdgeShortener


def surfaceOfRevolution(outline: ArrayLike, numVertices: int, rounds: int = 100) -> Mesh:
    """Create a closed surface of revolution about the z axis, of nearly equal edges.

    The vertices begin on a spiral of the golden angle, at equal areas.  Then every edge is a spring that pulls towards
    the mean length, edges flip where that makes them shorter, and vertices slide on the surface, each on its own sheet
    where two come close to each other.  The flips are annealed: a temperature that falls to 0 lets defects move,
    without which the spiral's strain would stay in a lattice that has none.

    ::

        angles = np.linspace(0, np.pi, 200)
        capsule = np.column_stack([np.sin(angles), 2 * np.cos(angles)])
        mesh = mh.surfaceOfRevolution(capsule, 300)

    Parameters
    ----------
    outline : (n, 2) array
        distance from the axis and height of points of the outline, in nm, close together, from one pole to the other;
        both poles are on the axis, and z falls at the first, whose outside is up
    numVertices : int
        the number of vertices, from 12 to 2e7
    rounds : int
        how often the vertices move

    Raises
    ------
    ValueError
        if an argument is out of range
    """
    outline = np.array(outline, dtype=float)
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3 or not np.all(np.isfinite(outline)):
        raise ValueError(
            f"surfaceOfRevolution: the outline has the shape {outline.shape}; it must be finite and of shape (n, 2), "
            "with at least 3 points"
        )
    if np.any(outline[1:-1, 0] <= 0) or np.any(np.abs(outline[[0, -1], 0]) > 1e-9 * outline[:, 0].max()):
        raise ValueError("surfaceOfRevolution: the outline must begin and end on the axis, and touch it nowhere else")
    numVertices = wholeNumber(numVertices, "surfaceOfRevolution: numVertices", 12, MOST_VERTICES)
    rounds = wholeNumber(rounds, "surfaceOfRevolution: rounds", 0)
    outline[[0, -1], 0] = 0
    surface, flip = _Revolution(outline, numVertices), EdgeShortener(_goldenTriangles(numVertices), numVertices)
    triangles = flip(surface.points(), sweeps=20)
    for done in range(rounds):
        surface.evenOut(Mesh(surface.points(), triangles).edges)
        triangles = flip(surface.points(), sweeps=2, heat=0.2 * max(0, 1 - done / (0.7 * rounds)))
    return Mesh(surface.points(), triangles)


def spheroid(numVertices: int, aspectRatio: float, area: float = 4 * math.pi) -> Mesh:
    """Create a spheroid of nearly equal edges about the z axis.

    ::

        mesh = mh.spheroid(500, mh.spheroidAspectRatio(0.9, "prolate"))

    Parameters
    ----------
    numVertices : int
        the number of vertices, from 12 to 2e7
    aspectRatio : float
        length along the axis over width: above 1 the spheroid is prolate, below 1 oblate; see
        :func:`spheroidAspectRatio`
    area : float
        the area of the triangles, in nm^2; by default that of a unit sphere

    Raises
    ------
    ValueError
        if an argument is out of range
    """
    if not 0.02 <= aspectRatio <= 50 or not (math.isfinite(area) and area > 0):
        raise ValueError(
            f"spheroid: aspectRatio is {aspectRatio} and area {area}; they must be from 0.02 to 50, and positive"
        )
    u = np.linspace(0, np.pi, 20001)
    mesh = surfaceOfRevolution(np.column_stack((np.sin(u), aspectRatio * np.cos(u))), numVertices)
    mesh.vertices *= math.sqrt(area / mesh.area)
    return mesh


def spheroidAspectRatio(reducedVolume: float, kind: str) -> float:
    """Return the aspect ratio of the "prolate" or "oblate" spheroid that has a reduced volume.

    ::

        mh.spheroidAspectRatio(0.9, "oblate")  # below 1

    Parameters
    ----------
    reducedVolume : float
        above 0 and at most 1
    kind : str
        "prolate" or "oblate"
    """
    ranges = {"prolate": (1.0, 50.0), "oblate": (0.02, 1.0)}
    if kind not in ranges:
        raise ValueError(f"spheroidAspectRatio: kind is '{kind}'; it must be 'prolate' or 'oblate'")
    low, high = ranges[kind]
    least = _spheroidReducedVolume(high if kind == "prolate" else low)
    if not least < reducedVolume <= 1:
        raise ValueError(
            f"spheroidAspectRatio: reducedVolume is {reducedVolume}; it must be above {least:.3f} and at most 1"
        )
    return 1.0 if reducedVolume == 1 else brentq(lambda a: _spheroidReducedVolume(a) - reducedVolume, low, high)


def invaginatedSphere(inner: float, opening: float) -> NDArray[np.float64]:
    """Return the outline of a stomatocyte, for :func:`surfaceOfRevolution`: a sphere of radius 1 and one inside it,
    joined by a round rim.

    Parameters
    ----------
    inner : float
        the radius of the inner sphere, in nm
    opening : float
        the angle between the axis and the middle of the rim, seen from the center
    """
    arc, down = np.linspace(np.pi, opening, 2000), np.linspace(0, np.pi, 500)[1:-1, np.newaxis]
    radial, around = np.array([math.sin(opening), math.cos(opening)]), np.array([-math.cos(opening), math.sin(opening)])
    rim = (1 + inner) / 2 * radial + (1 - inner) / 2 * (np.sin(down) * around - np.cos(down) * radial)
    sphere = np.column_stack((np.sin(arc), np.cos(arc)))
    sphere[0, 0] = 0
    return np.concatenate((inner * sphere, rim, sphere[::-1]))


def _spheroidReducedVolume(a: float) -> float:
    e = math.sqrt(1 - min(a, 1 / a) ** 2)
    if e < 1e-6:
        return 1.0
    area = 2 * math.pi * (1 + a / e * math.asin(e) if a > 1 else 1 + a * a / e * math.atanh(e))
    return reducedVolume(area, 4 * math.pi / 3 * a)


def _goldenAngles(number: int) -> np.ndarray:
    return np.arange(number) * np.pi * (3 - math.sqrt(5))


class _Revolution:
    """Points on a surface of revolution, each held by its arc length along the outline and its angle."""

    def __init__(self, outline: np.ndarray, number: int) -> None:
        """Put points on a spiral, each of an equal part of the area, a golden angle from one to the next."""
        length = np.linalg.norm(np.diff(outline, axis=0), axis=1)
        self._outline, self._length = outline, np.concatenate(([0], np.cumsum(length)))
        self._tangents = np.gradient(outline, self._length, axis=0)
        part = np.concatenate(([0], np.cumsum(length * (outline[1:, 0] + outline[:-1, 0]))))
        self._s, self._angle = (
            np.interp((np.arange(number) + 0.5) / number, part / part[-1], self._length),
            _goldenAngles(number),
        )

    def points(self) -> np.ndarray:
        r, z = self._at(self._outline)
        return np.column_stack((r * np.cos(self._angle), r * np.sin(self._angle), z))

    def evenOut(self, edges: np.ndarray) -> None:
        """Slide the points along the surface as springs at the edges, which pull towards the mean length, would move
        them.
        """
        a, b = edges.T
        x = self.points()
        edge = x[b] - x[a]
        length = np.linalg.norm(edge, axis=1)
        pull = 0.1 * edge * (1 - length.mean() / length)[:, np.newaxis]
        x += np.column_stack(
            [np.bincount(a, pull[:, i], len(x)) - np.bincount(b, pull[:, i], len(x)) for i in range(3)]
        )
        moved = np.array([np.hypot(x[:, 0], x[:, 1]), x[:, 2]]) - self._at(self._outline)
        self._s = np.clip(self._s + np.sum(moved * self._at(self._tangents), axis=0), 0, self._length[-1])
        self._angle = np.arctan2(x[:, 1], x[:, 0])

    def _at(self, columns: np.ndarray) -> np.ndarray:
        return np.array([np.interp(self._s, self._length, column) for column in columns.T])


def _goldenTriangles(numVertices: int) -> np.ndarray:
    """Return the triangles of the golden spiral on a sphere."""
    height = 1 - 2 * (np.arange(numVertices) + 0.5) / numVertices
    r, angle = np.sqrt(1 - height**2), _goldenAngles(numVertices)
    points = np.column_stack((r * np.cos(angle), r * np.sin(angle), height))
    triangles = ConvexHull(points).simplices
    a, b, c = (points[triangles[:, i]] for i in range(3))
    inwards = np.einsum("ti,ti->t", np.cross(b - a, c - a), a) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return triangles
