"""Even triangles on a given surface: vertices slide, edges flip, and volumes stay."""

from typing import Any, Protocol

import numpy as np
import openmm as mm
from numpy.typing import ArrayLike, NDArray
from openmm import unit

from ..helfrich import EdgeFlipIntegrator, HelfrichForce
from .connectivity import IndexArray
from .mesh import Mesh

FloatArray = NDArray[np.float64]
# Of the way that springs at the edges would take a vertex: with six neighbors of like stiffness, more overshoots.
_PULL = 0.15
# Between two projections vertices move in the planes of their triangles, which is enough for such small ways.
_STEPS_PER_PROJECTION = 4


class Surface(Protocol):
    """A closed surface on which points can be put."""

    def closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the closest point of the surface to each of some points, and its unit normal there: (n, 3) arrays."""


class EdgeShortener:
    """Keeps the triangles of a surface of the kind of a sphere, and flips edges where that makes them shorter."""

    def __init__(self, triangles: ArrayLike, numVertices: int, platform: str = "Reference"):
        """Begin with triangles, of vertices from 0 to numVertices-1."""
        self._force, system = HelfrichForce(), mm.System()
        self._force.setTriangles(np.asarray(triangles))
        self._force.setTether(1, 1e-12, 2e-12, 2)  # in effect the sum of squares of the edges' lengths
        for _ in range(numVertices):
            system.addParticle(1)
        system.addForce(self._force)
        self._flips = EdgeFlipIntegrator(0, 1)
        self._flips.setRandomNumberSeed(1)
        self._context = mm.Context(system, self._flips, mm.Platform.getPlatform(platform))

    def __call__(self, x: FloatArray, sweeps: int, heat: float = 0.0) -> Any:
        """Return the triangles after some sweeps at positions x; heat is kT over the mean energy of an edge."""
        self._context.setPositions(x)
        energy = self._context.getState(energy=True).getPotentialEnergy() / (3 * len(x) - 6)
        self._flips.setTemperature(heat * energy / unit.MOLAR_GAS_CONSTANT_R)
        self._flips.step(sweeps)
        return self._force.getTrianglesInContext(self._context)


def relax(mesh: Mesh, surface: Surface, rounds: int) -> Mesh:
    """Return a mesh of more even triangles on a surface, with the vertices and the topology of a mesh that is on it.

    Every edge is a spring that pulls towards the mean length, vertices slide on the surface, and edges flip where that
    makes them shorter.  At the end the vertices leave the surface a little, so that the triangles are as often outside
    of it as inside, and enclose its volume.

    Parameters
    ----------
    mesh : Mesh
        what to begin with
    surface : Surface
        where it is
    rounds : int
        how often flips and slides take turns
    """
    # Positions about 1, since a spring as good as without a rest length has one of 1e-12.
    scale = mesh.edgeLengths.mean()
    x, triangles = mesh.vertices / scale, mesh.triangles
    flip = EdgeShortener(triangles, len(x), "CPU")
    for done in range(rounds):
        triangles = flip(x, sweeps=2, heat=0.1 * max(0.0, 1 - done / (0.6 * rounds)))
        edges = Mesh(x, triangles).edges
        for _ in range(_STEPS_PER_PROJECTION):
            x = x + _alongSurface(_springs(x, edges), vertexNormals(x, triangles))
        x = project(scale * x, triangles, surface) / scale
    triangles = flip(x, sweeps=3)
    return Mesh(fit(scale * x, triangles, surface), triangles)


def project(x: FloatArray, triangles: IndexArray, surface: Surface) -> FloatArray:
    """Return positions moved onto a surface, but for those whose closest point is on another sheet of it."""
    closest, normals = surface.closest(x)
    isOwn = np.einsum("vi,vi->v", normals, vertexNormals(x, triangles)) > 0
    return np.where(isOwn[:, np.newaxis], closest, x)


def fit(x: FloatArray, triangles: IndexArray, surface: Surface, iterations: int = 4) -> FloatArray:
    """Return positions moved along normals, so that around each vertex triangles are as far outside as inside."""
    edges = Mesh(x, triangles).edges
    normals = vertexNormals(x, triangles)
    count = np.bincount(edges.ravel(), minlength=len(x))
    for _ in range(iterations):
        middles = (x[edges[:, 0]] + x[edges[:, 1]]) / 2
        closest, outwards = surface.closest(middles)
        # The mean over a triangle of what is quadratic in it is that of the middles of its sides.
        outside = np.einsum("ei,ei->e", middles - closest, outwards)
        isOwn = np.einsum("ei,ei->e", outwards, normals[edges[:, 0]] + normals[edges[:, 1]]) > 0
        outside = np.where(isOwn, outside, 0)
        mean = (np.bincount(edges[:, 0], outside, len(x)) + np.bincount(edges[:, 1], outside, len(x))) / count
        x = x - mean[:, np.newaxis] * normals
    return x


def vertexNormals(x: FloatArray, triangles: IndexArray) -> FloatArray:
    """Return the unit normals of the vertices, means by area of those of their triangles."""
    corners = x[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = _sums(triangles.ravel(), np.repeat(normals, 3, axis=0), len(x))
    return sums / np.maximum(np.linalg.norm(sums, axis=1), np.finfo(float).tiny)[:, np.newaxis]


def _springs(x, edges):
    """Return the moves of vertices by the pull of springs at the edges towards the mean length."""
    a, b = edges.T
    edge = x[b] - x[a]
    length = np.linalg.norm(edge, axis=1)
    pull = _PULL * edge * (1 - length.mean() / length)[:, np.newaxis]
    return _sums(a, pull, len(x)) - _sums(b, pull, len(x))


def _alongSurface(moves, normals):
    return moves - np.einsum("vi,vi->v", moves, normals)[:, np.newaxis] * normals


def _sums(places, vectors, count):
    return np.column_stack([np.bincount(places, vectors[:, i], count) for i in range(3)])
