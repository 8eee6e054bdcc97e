"""Even triangles on a given surface: vertices slide, edges flip, and volumes stay."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
import openmm as mm
from numpy.typing import ArrayLike, NDArray
from openmm import unit

from ..helfrich import EdgeFlipIntegrator, HelfrichForce
from .connectivity import edgeLengthsOf, edgesOf, triangleNormals

FloatArray = NDArray[np.float64]
IntegerArray = NDArray[np.integer]
# Of the way that springs at the edges would take a vertex: with six neighbors of like stiffness, more overshoots.
_PULL = 0.15
# Between two projections vertices move in the planes of their triangles, which is enough for such small ways.
_STEPS_PER_PROJECTION = 4


class Triangulation(NamedTuple):
    """The vertices, (N, 3), and the triangles, (T, 3), of a surface."""

    vertices: FloatArray
    triangles: IntegerArray


class Surface(Protocol):
    """A closed surface on which points can be put."""

    def closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the closest point of the surface to each of some points, and its unit normal there: (n, 3) arrays."""


class TorusSurface:
    """The torus of a ring of radius R about the z axis and a tube of radius r."""

    def __init__(self, ringRadius: float, tubeRadius: float):
        """Create the torus from R and r."""
        self._ringRadius, self._tubeRadius = ringRadius, tubeRadius

    def closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the closest points, and the normals there."""
        ring = points * [1, 1, 0]
        ring *= self._ringRadius / np.linalg.norm(ring, axis=1)[:, np.newaxis]
        normals = points - ring
        normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
        return ring + self._tubeRadius * normals, normals


class EdgeShortener:
    """Keeps triangles, and flips edges where that makes them shorter."""

    def __init__(
        self,
        triangles: ArrayLike,
        numVertices: int,
        platform: str = "Reference",
        properties: Mapping[str, str] | None = None,
    ):
        """Begin with triangles, of vertices from 0 to numVertices-1."""
        self._force, system = HelfrichForce(), mm.System()
        self._force.setTriangles(np.asarray(triangles))
        self._force.setTether(1, 1e-12, 2e-12, 2)  # in effect the sum of squares of the edges' lengths
        for _ in range(numVertices):
            system.addParticle(1)
        system.addForce(self._force)
        self._flips = EdgeFlipIntegrator(0, 1)
        self._flips.setRandomNumberSeed(1)
        self._context = mm.Context(system, self._flips, mm.Platform.getPlatform(platform), dict(properties or {}))

    def __call__(self, x: FloatArray, sweeps: int, heat: float = 0.0) -> Any:
        """Return the triangles after some sweeps at positions x; heat is kT over the mean energy of an edge."""
        self._context.setPositions(x)
        energy = self._context.getState(energy=True).getPotentialEnergy() / (3 * len(x) - 6)
        self._flips.setTemperature(heat * energy / unit.MOLAR_GAS_CONSTANT_R)
        self._flips.step(sweeps)
        return self._force.getTrianglesInContext(self._context)


def relax(start: Triangulation, surface: Surface, rounds: int) -> Triangulation:
    """Return more even triangles on a surface, with as many vertices and the topology of those to begin with.

    Every edge is a spring that pulls towards the mean length, vertices slide on the surface, and edges flip where that
    makes them shorter, at a temperature that falls to 0.  At the end the vertices leave the surface a little, so that
    triangles are as far outside of it as inside, and enclose its volume.

    Parameters
    ----------
    start : Triangulation
        what to begin with, close to the surface
    surface : Surface
        where to stay
    rounds : int
        how often flips and slides take turns
    """
    x, triangles = start
    # The springs that flips are decided by have no rest length to speak of at positions about 1.
    scale = edgeLengthsOf(x, edgesOf(triangles, len(x))).mean()
    flip = EdgeShortener(triangles, len(x), "CPU", {"Threads": "1"})
    for done in range(rounds):
        triangles = flip(x / scale, sweeps=2, heat=0.2 * max(0.0, 1 - done / (0.7 * rounds)))
        edges = edgesOf(triangles, len(x))
        for _ in range(_STEPS_PER_PROJECTION):
            x = x + _alongSurface(_springs(x, edges), vertexNormals(x, triangles))
        x = _project(x, triangles, surface)
    triangles = flip(x / scale, sweeps=3)
    return Triangulation(_fit(x, triangles, surface), triangles)


def torusTriangulation(ringRadius: float, tubeRadius: float, edgeLength: float) -> Triangulation:
    """Return the triangles of a torus between rings that have vertices in proportion to their lengths."""
    numRings = max(3, round(2 * math.pi * tubeRadius / (edgeLength * math.sqrt(3) / 2)))
    angles = 2 * np.pi * np.arange(numRings) / numRings
    radii, heights = ringRadius + tubeRadius * np.cos(angles), tubeRadius * np.sin(angles)
    counts = [max(3, round(2 * math.pi * radius / edgeLength)) for radius in radii]
    starts = np.cumsum([0, *counts])
    # Every second ring is turned by half an edge.
    turns = [(np.arange(n) + 0.5 * (i % 2)) * 2 * np.pi / n for i, n in enumerate(counts)]
    vertices = np.concatenate(
        [
            np.column_stack((radius * np.cos(turn), radius * np.sin(turn), np.full(len(turn), height)))
            for radius, height, turn in zip(radii, heights, turns)
        ]
    )
    triangles = []
    for i, j in zip(range(numRings), [*range(1, numRings), 0]):
        triangles += _band(turns[i], turns[j], starts[i], starts[j])
    return Triangulation(vertices, np.array(triangles))


def vertexNormals(x: FloatArray, triangles: IntegerArray) -> FloatArray:
    """Return the unit normals of the vertices, means by area of those of their triangles."""
    sums = _sums(triangles.ravel(), np.repeat(triangleNormals(x, triangles), 3, axis=0), len(x))
    return sums / np.maximum(np.linalg.norm(sums, axis=1), np.finfo(float).tiny)[:, np.newaxis]


def _band(turn: FloatArray, otherTurn: FloatArray, start: int, otherStart: int) -> list[tuple[int, int, int]]:
    """Return the triangles between two rings of vertices, of which the other is the next counter-clockwise as seen
    along the ring.
    """
    n, m, triangles, i, j = len(turn), len(otherTurn), [], 0, 0
    while i < n or j < m:
        a, b = start + i % n, otherStart + j % m
        nextTurn, nextOther = (
            np.inf if done else t
            for done, t in (
                (i == n, turn[(i + 1) % n] + 2 * np.pi * ((i + 1) // n)),
                (j == m, otherTurn[(j + 1) % m] + 2 * np.pi * ((j + 1) // m)),
            )
        )
        if nextTurn < nextOther:
            triangles.append((a, start + (i + 1) % n, b))
            i += 1
        else:
            triangles.append((a, otherStart + (j + 1) % m, b))
            j += 1
    return triangles


def _project(x: FloatArray, triangles: IntegerArray, surface: Surface) -> FloatArray:
    """Return positions moved onto a surface, but for those whose closest point is on another sheet of it."""
    closest, normals = surface.closest(x)
    isOwn = np.einsum("vi,vi->v", normals, vertexNormals(x, triangles)) > 0
    return np.where(isOwn[:, np.newaxis], closest, x)


def _fit(x: FloatArray, triangles: IntegerArray, surface: Surface, iterations: int = 4) -> FloatArray:
    """Return positions moved along normals, so that around each vertex triangles are as far outside as inside."""
    a, b = edgesOf(triangles, len(x)).T
    normals, count = vertexNormals(x, triangles), np.bincount(triangles.ravel(), minlength=len(x))
    for _ in range(iterations):
        middles = (x[a] + x[b]) / 2
        closest, outwards = surface.closest(middles)
        # The mean over a triangle of what is quadratic in it is that of the middles of its sides.
        outside = np.einsum("ei,ei->e", middles - closest, outwards)
        outside[np.einsum("ei,ei->e", outwards, normals[a] + normals[b]) < 0] = 0  # another sheet's
        mean = (np.bincount(a, outside, len(x)) + np.bincount(b, outside, len(x))) / count
        x = x - mean[:, np.newaxis] * normals
    return x


def _springs(x: FloatArray, edges: IntegerArray) -> FloatArray:
    """Return the moves of vertices by the pull of springs at the edges towards the mean length."""
    a, b = edges.T
    edge, length = x[b] - x[a], edgeLengthsOf(x, edges)
    pull = _PULL * edge * (1 - length.mean() / length)[:, np.newaxis]
    return _sums(a, pull, len(x)) - _sums(b, pull, len(x))


def _alongSurface(moves: FloatArray, normals: FloatArray) -> FloatArray:
    return moves - np.einsum("vi,vi->v", moves, normals)[:, np.newaxis] * normals


def _sums(places: IntegerArray, vectors: FloatArray, count: int) -> FloatArray:
    return np.column_stack([np.bincount(places, vectors[:, i], count) for i in range(3)])
