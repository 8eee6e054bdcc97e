"""Meshes made anew with even triangles, on the same surface.

The library MMG (mmgpy) splits, collapses and swaps edges until all are about as long as asked for.  What it makes is
manifold and of the same genus, but its edges are from 0.4 to 2 of their mean, and it takes sharp edges for noise.  So
the longest edges are then split until there are just as many vertices as asked for, edges flip, and vertices slide on
the surface that was given (closest points by libigl) until edges are even.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..optional import require
from . import connectivity
from .mesh import Mesh
from .relaxation import FloatArray, relax

# What is promised: the change of area and volume, the distance between the surfaces in mean edge lengths, and the least
# and the greatest edge length over the mean.
MOST_CHANGE, MOST_DISTANCE, EDGE_RANGE = 0.01, 0.1, (0.6, 1.5)
_ROUNDS = 15


@dataclass(frozen=True, eq=False)
class Remeshing:
    """A mesh made anew by :func:`remesh`.

    Attributes
    ----------
    mesh : Mesh
        the mesh
    areaChange, volumeChange : float
        of area and volume, as fractions of those of the input
    distance : float
        the greatest distance between the two surfaces, over the mean edge length of the new one
    edgeRange : tuple of float
        the least and the greatest edge length over the mean
    """

    mesh: Mesh
    areaChange: float
    volumeChange: float
    distance: float
    edgeRange: tuple[float, float]

    def summary(self) -> str:
        """Return what has been made, in a sentence."""
        low, high = self.edgeRange
        return (
            f"{len(self.mesh.vertices)} vertices, {len(self.mesh.triangles)} triangles; area {self.areaChange:+.2%}, "
            f"volume {self.volumeChange:+.2%}, at most {self.distance:.3f} of the mean edge length from the input; "
            f"edges {low:.2f} to {high:.2f} of their mean"
        )

    def shortcomings(self) -> list[str]:
        """Return a sentence for each promise that the surface did not let be kept."""
        (low, high), (least, most) = self.edgeRange, EDGE_RANGE
        found = []
        for name, change in (("area", self.areaChange), ("volume", self.volumeChange)):
            if abs(change) > MOST_CHANGE:
                found.append(
                    f"the {name} changed by {change:+.1%}, more than {MOST_CHANGE:.0%}: the input has features that "
                    "are finer than the edges; more vertices keep them"
                )
        if self.distance > MOST_DISTANCE:
            found.append(
                f"the surface is up to {self.distance:.2f} mean edge lengths from the input, more than "
                f"{MOST_DISTANCE:g}: the input has corners or features that are finer than the edges; more vertices "
                "come closer"
            )
        if low < least or high > most:
            found.append(
                f"the edges are from {low:.2f} to {high:.2f} of their mean, beyond {least:g} to {most:g}: the input "
                "has parts that are thinner than the edges; more vertices make them even"
            )
        return found


def remesh(mesh: Mesh, numVertices: int | None = None, edgeLength: float | None = None) -> Remeshing:
    """Make a mesh anew with even triangles, on the same surface.

    Parameters
    ----------
    mesh : Mesh
        a closed mesh
    numVertices : int, optional
        the number of vertices of the new mesh
    edgeLength : float, optional
        instead: the mean length of its edges, in nm, met to within a few percent

    Raises
    ------
    ValueError
        if the mesh is not closed, an argument is out of range, or the surface does not let itself be covered by so few
        vertices
    """
    mesh.check()
    count = _numVertices(mesh, numVertices, edgeLength)
    surface = _TriangulatedSurface(mesh)
    made = relax(_splitLongest(_uniform(mesh, count), count), surface, _ROUNDS)
    made.check()
    lengths = made.edgeLengths / made.edgeLengths.mean()
    return Remeshing(
        made,
        made.area / mesh.area - 1,
        made.volume / mesh.volume - 1,
        _distance(made, surface, mesh) / made.edgeLengths.mean(),
        (float(lengths.min()), float(lengths.max())),
    )


class _TriangulatedSurface:
    """The surface of a mesh, with an index of its triangles."""

    def __init__(self, mesh):
        self._x, self._triangles = np.ascontiguousarray(mesh.vertices), mesh.triangles.astype(np.int64)
        self._tree = require("igl", "remeshing", "remesh").AABB()
        self._tree.init(self._x, self._triangles)
        corners = self._x[self._triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normals = normals / np.linalg.norm(normals, axis=1)[:, np.newaxis]

    def closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the closest points, and the normals there."""
        _, triangle, closest = self._tree.squared_distance(self._x, self._triangles, np.ascontiguousarray(points))
        return closest, self._normals[triangle]

    def distance(self, points: FloatArray) -> float:
        """Return the distance of the farthest of some points."""
        squares, _, _ = self._tree.squared_distance(self._x, self._triangles, np.ascontiguousarray(points))
        return float(math.sqrt(squares.max()))


def _numVertices(mesh, numVertices, edgeLength):
    """Return the number of vertices that is asked for."""
    if (numVertices is None) == (edgeLength is None):
        raise ValueError("remesh: give numVertices or edgeLength, and not both")
    if edgeLength is None:
        if numVertices < 12 or numVertices != int(numVertices):
            raise ValueError(f"remesh: numVertices is {numVertices}; it must be a whole number, 12 or more")
        return int(numVertices)
    if not (math.isfinite(edgeLength) and edgeLength > 0):
        raise ValueError(f"remesh: edgeLength is {edgeLength}; it must be positive")
    count = round(mesh.area / (math.sqrt(3) / 4 * edgeLength**2) / 2 + eulerCharacteristic(mesh))
    if count < 12:
        raise ValueError(
            f"remesh: edgeLength is {edgeLength:g}; an area of {mesh.area:.4g} nm^2 takes {count} vertices then, and "
            "must take at least 12"
        )
    return count


def eulerCharacteristic(mesh: Mesh) -> int:
    """Return V-E+F: 2-2g for each membrane of genus g."""
    return len(mesh.vertices) - len(mesh.triangles) // 2


def _uniform(mesh, count):
    """Return a mesh of edges about as long as each other, with a few percent less vertices than asked for."""
    wanted, most = 0.97 * count, 0.0
    length = math.sqrt(2 / math.sqrt(3) * mesh.area / wanted)
    for _ in range(6):
        made = _byMMG(mesh, length)
        found = len(made.vertices)
        if 0.92 * count <= found <= count and eulerCharacteristic(made) == eulerCharacteristic(mesh):
            return made
        length *= math.sqrt(found / wanted)
    raise ValueError("")


def _byMMG(mesh, length):
    """Return a mesh by MMG, of edges about as long as asked for; no edge is taken for a ridge."""
    mmg = require("mmgpy", "remeshing", "remesh")
    made = mmg.MmgMeshS(mesh.vertices, mesh.triangles)
    made.remesh(hsiz=length, hausd=length, ar=179.0, verbose=-1)
    return Mesh(made.get_vertices(), made.get_triangles())


def _splitLongest(mesh, count):
    """Return a mesh of so many vertices, by new ones in the middles of the longest edges."""
    while len(mesh.vertices) < count:
        mesh = _splitOnce(mesh, count - len(mesh.vertices))
    return mesh


def _splitOnce(mesh, most):
    """Split at most so many of the longest edges, of which no two have a triangle in common."""
    first, second = connectivity.pairHalfedges(mesh.triangles, len(mesh.vertices))
    origin, target = connectivity.halfedges(mesh.triangles)
    isTaken, chosen = np.zeros(len(mesh.triangles), dtype=bool), []
    order = np.argsort(-np.linalg.norm(mesh.vertices[target[first]] - mesh.vertices[origin[first]], axis=1))
    for e in order[: 8 * most].tolist():
        f, g = first[e] // 3, second[e] // 3
        if not (isTaken[f] or isTaken[g]):
            isTaken[[f, g]] = True
            chosen.append(e)
            if len(chosen) == most:
                break
    new = len(mesh.vertices) + np.arange(len(chosen))
    triangles, added = mesh.triangles.copy(), []
    for h in (first[chosen], second[chosen]):
        t, a = np.divmod(h, 3)
        b, c = (a + 1) % 3, (a + 2) % 3
        added.append(np.column_stack((new, mesh.triangles[t, b], mesh.triangles[t, c])))
        triangles[t, b] = new
    middles = (mesh.vertices[origin[first[chosen]]] + mesh.vertices[target[first[chosen]]]) / 2
    return Mesh(np.concatenate((mesh.vertices, middles)), np.concatenate((triangles, *added)))


def _distance(made, surface, mesh):
    """Return the greatest distance between two surfaces, by their vertices and the middles of edges and triangles."""
    return max(surface.distance(_samples(made)), _TriangulatedSurface(made).distance(_samples(mesh)))


def _samples(mesh):
    x = mesh.vertices
    return np.concatenate((x, x[mesh.edges].mean(axis=1), x[mesh.triangles].mean(axis=1)))
