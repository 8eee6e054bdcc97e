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
from ..units import wholeNumber
from .connectivity import (
    MOST_VERTICES,
    areaOf,
    check,
    edgeLengthsOf,
    edgesOf,
    halfedges,
    labelComponents,
    pairHalfedges,
    requireVertices,
    signedVolume,
    triangleNormals,
)
from .relaxation import FloatArray, IntegerArray, Triangulation, relax

# What is promised: the change of area and volume, the distance between the surfaces in mean edge lengths, and the least
# and the greatest edge length over the mean.
MOST_CHANGE, MOST_DISTANCE, EDGE_RANGE = 0.01, 0.1, (0.6, 1.5)
_ROUNDS = 20
_LIBRARIES = "mmgpy", "igl"
# Of so many vertices a surface is covered in some seconds, only to see whether it can be.
_MOST_TRIED = 20_000


@dataclass(frozen=True, eq=False)
class Remeshing:
    """A surface covered anew by :func:`remesh`.

    Attributes
    ----------
    triangulation : Triangulation
        its vertices and triangles
    areaChange, volumeChange : float
        of area and volume, as fractions of those of the input
    distance : float
        the greatest distance between the two surfaces, over the mean edge length of the new one
    edgeRange : tuple of float
        the least and the greatest edge length over the mean
    """

    triangulation: Triangulation
    areaChange: float
    volumeChange: float
    distance: float
    edgeRange: tuple[float, float]

    def summary(self) -> str:
        """Return what has been made, in a sentence."""
        (low, high), (vertices, triangles) = self.edgeRange, self.triangulation
        return (
            f"{len(vertices)} vertices, {len(triangles)} triangles; area {self.areaChange:+.2%}, "
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


def remesh(mesh: Triangulation, numVertices: int | None = None, edgeLength: float | None = None) -> Remeshing:
    """Cover a surface anew with even triangles.

    Parameters
    ----------
    mesh : Triangulation
        the surface, which must be closed: see :func:`openmmhelfrich.geometry.connectivity.check`
    numVertices : int, optional
        the number of vertices to have
    edgeLength : float, optional
        instead: the mean length of edges, met to within a few percent

    Raises
    ------
    ValueError
        if an argument is out of range, or so few vertices do not cover the surface
    """
    # The library's tolerances and ours are those of lengths about 1.
    center, size, given = mesh.vertices.mean(axis=0), math.sqrt(areaOf(*mesh)), _ofUnitArea(mesh)
    count = _numVertices(given, numVertices, edgeLength and edgeLength / size)
    surface = _TriangulatedSurface(given)
    made = relax(_splitLongest(_uniform(given, count), count), surface, _ROUNDS)
    _requireSound(made)
    lengths = edgeLengthsOf(made.vertices, edgesOf(made.triangles, count))
    return Remeshing(
        Triangulation(made.vertices * size + center, made.triangles),
        areaOf(*made) / areaOf(*given) - 1,
        signedVolume(*made) / signedVolume(*given) - 1,
        _distance(made, surface, given) / lengths.mean(),
        (float(lengths.min() / lengths.mean()), float(lengths.max() / lengths.mean())),
    )


class _TriangulatedSurface:
    """The surface of a mesh, with an index of its triangles."""

    def __init__(self, mesh: Triangulation):
        self._x, self._triangles = np.ascontiguousarray(mesh.vertices), mesh.triangles.astype(np.int64)
        self._tree = require("igl", "remeshing", "remesh").AABB()
        self._tree.init(self._x, self._triangles)
        normals = triangleNormals(self._x, self._triangles)
        self._normals = normals / np.linalg.norm(normals, axis=1)[:, np.newaxis]

    def closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the closest points, and the normals there."""
        _, triangle, closest = self._tree.squared_distance(self._x, self._triangles, np.ascontiguousarray(points))
        return closest, self._normals[triangle]

    def distance(self, points: FloatArray) -> float:
        """Return the distance of the farthest of some points."""
        squares, _, _ = self._tree.squared_distance(self._x, self._triangles, np.ascontiguousarray(points))
        return float(math.sqrt(squares.max()))


def _numVertices(mesh: Triangulation, numVertices: int | None, edgeLength: float | None) -> int:
    """Return the number of vertices that is asked for, on a surface of area 1."""
    if numVertices is not None and edgeLength is None:
        return wholeNumber(numVertices, "remesh: the number of vertices", 12, MOST_VERTICES)
    if numVertices is not None or edgeLength is None:
        raise ValueError("remesh: give the number of vertices or the edge length, and not both")
    if not (math.isfinite(edgeLength) and edgeLength > 0):
        raise ValueError("remesh: the edge length must be positive")
    count = 2 / math.sqrt(3) / edgeLength / edgeLength + eulerCharacteristic(mesh)
    requireVertices(count, f"remesh: the edge length is {edgeLength:.2g} times the square root of the area")
    if count < 12:
        raise ValueError(
            f"remesh: edges of {edgeLength:.2g} times the square root of the area make {round(count)} vertices; there "
            "must be at least 12: give a shorter length"
        )
    return round(count)


def eulerCharacteristic(mesh: Triangulation) -> int:
    """Return V-E+F of a closed surface: the sum of 2-2g over its membranes of genus g."""
    return len(mesh.vertices) - len(mesh.triangles) // 2


def _uniform(mesh: Triangulation, count: int) -> Triangulation:
    """Return triangles of edges about as long as each other, with a few percent less vertices than asked for."""
    wanted = 0.96 * count
    length = math.sqrt(2 / math.sqrt(3) / wanted)
    if _extent(mesh) > wanted / 3 * length:  # of which MMG would take all memory
        raise ValueError("remesh: the surface is too long and thin for so few vertices; ask for more")
    made = first = _byMMG(mesh, np.full(len(mesh.vertices), length))
    # An even mesh is left as it is by any length that is near its own, unless lengths vary from place to place.
    variation = np.random.default_rng(1).uniform(0.6, 1.4, len(first.vertices))
    for _ in range(8):
        found = len(made.vertices)
        if 0.92 * count <= found <= count:
            return made
        length *= min(max(math.sqrt(found / wanted), 0.7), 1.4)
        made = _byMMG(first, length * variation)
    raise ValueError(
        f"remesh: the number of vertices is {count}, and this surface takes about {found}; give another number, or "
        "repair the mesh first if it has specks"
    )


def _extent(mesh: Triangulation) -> float:
    """Return how long the longest of the surfaces is, along an axis."""
    count, label = labelComponents(mesh.triangles, len(mesh.vertices))
    order = np.argsort(label, kind="stable")
    x, first = mesh.vertices[order], np.searchsorted(label[order], np.arange(count))
    return float((np.maximum.reduceat(x, first) - np.minimum.reduceat(x, first)).max())


def missing() -> str:
    """Return how to get the libraries if one is missing, to go on what is ready with them; else nothing."""
    try:
        for library in _LIBRARIES:
            require(library, "remeshing", "remesh")
    except ValueError:
        return ", with the libraries that pip install 'openmm-helfrich[remesh]' brings"
    return ""


def tried(mesh: Triangulation, numVertices: int) -> Remeshing | None:
    """Return a closed surface covered anew, or None if the libraries are missing or it is too large to be tried.

    Raises ValueError if it cannot be covered, as far as the library shows that at once where it is large.
    """
    if missing():
        return None
    if max(numVertices, len(mesh.vertices)) <= _MOST_TRIED:
        return remesh(mesh, numVertices)
    _uniform(_ofUnitArea(mesh), numVertices)
    return None


def _ofUnitArea(mesh: Triangulation) -> Triangulation:
    """Return a surface that is scaled to an area of 1 and moved to the origin."""
    return Triangulation((mesh.vertices - mesh.vertices.mean(axis=0)) / math.sqrt(areaOf(*mesh)), mesh.triangles)


def _byMMG(mesh: Triangulation, lengths: FloatArray) -> Triangulation:
    """Return triangles by MMG, of edges about as long as asked for at each vertex; no edge is taken for a ridge."""
    source = require("mmgpy", "remeshing", "remesh").MmgMeshS(mesh.vertices, mesh.triangles.astype(np.int32))
    source["metric"] = lengths[:, np.newaxis]
    try:
        source.remesh(hausd=float(lengths.mean()), hgrad=-1.0, ar=179.0, verbose=-1)
    except RuntimeError as error:
        raise ValueError(f"remesh: the library MMG could not cover the surface ({error}); repair it first") from None
    made = Triangulation(np.array(source.get_vertices()), np.array(source.get_triangles()))
    if eulerCharacteristic(made) != eulerCharacteristic(mesh) or not _isSound(made):
        handles = labelComponents(mesh.triangles, len(mesh.vertices))[0] - eulerCharacteristic(mesh) // 2
        if handles == 0:
            raise ValueError("remesh: the surface does not keep its topology with so few vertices; ask for more")
        raise ValueError(
            f"remesh: the surface has {handles} handle{'s' if handles > 1 else ''}, of which some are thinner than the "
            "new edges; ask for more vertices or, if noise made them, smooth the segmentation before marching cubes"
        )
    return made


def _isSound(mesh: Triangulation) -> bool:
    try:
        check(*mesh)
    except ValueError:
        return False
    return True


def _requireSound(made: Triangulation) -> None:
    """Raise a ValueError if what was made is no membrane, which is no fault of the surface that was given."""
    try:
        check(*made)
    except ValueError as error:
        raise ValueError(
            "remesh: the surface is too thin, or too sharp, for so few vertices, and what is made of it is no membrane "
            f"({error}); ask for more vertices"
        ) from None


def _splitLongest(mesh: Triangulation, count: int) -> Triangulation:
    """Return triangles of so many vertices, by new ones in the middles of the longest edges."""
    while len(mesh.vertices) < count:
        mesh = _split(mesh, _longest(mesh, count - len(mesh.vertices)))
    return mesh


def _longest(mesh: Triangulation, most: int) -> IntegerArray:
    """Return a halfedge of each of at most so many of the longest edges, of which no two have a common triangle."""
    first, second = pairHalfedges(mesh.triangles, len(mesh.vertices))
    origin, target = (end[first] for end in halfedges(mesh.triangles))
    order = np.argsort(-edgeLengthsOf(mesh.vertices, np.column_stack((origin, target))), kind="stable")
    isTaken, chosen = np.zeros(len(mesh.triangles), dtype=bool), []
    for e in order[: 8 * most].tolist():
        f, g = first[e] // 3, second[e] // 3
        if not (isTaken[f] or isTaken[g]):
            isTaken[[f, g]] = True
            chosen.append(e)
            if len(chosen) == most:
                break
    return np.column_stack((first[chosen], second[chosen]))


def _split(mesh: Triangulation, edges: IntegerArray) -> Triangulation:
    """Split edges, of which each is given by its two halfedges."""
    (vertices, triangles), new = mesh, len(mesh.vertices) + np.arange(len(edges))
    origin, target = (end[edges[:, 0]] for end in halfedges(triangles))
    parts = [triangles.copy()]
    for t, a in (np.divmod(h, 3) for h in edges.T):
        b, c = (a + 1) % 3, (a + 2) % 3
        parts.append(np.column_stack((new, triangles[t, b], triangles[t, c])))
        parts[0][t, b] = new
    middles = (vertices[origin] + vertices[target]) / 2
    return Triangulation(np.concatenate((vertices, middles)), np.concatenate(parts))


def _distance(made: Triangulation, surface: _TriangulatedSurface, given: Triangulation) -> float:
    """Return the greatest distance between two surfaces, by their vertices and the middles of edges and triangles."""
    return max(surface.distance(_samples(made)), _TriangulatedSurface(made).distance(_samples(given)))


def _samples(mesh: Triangulation) -> FloatArray:
    x, triangles = mesh
    return np.concatenate((x, x[edgesOf(triangles, len(x))].mean(axis=1), x[triangles].mean(axis=1)))
