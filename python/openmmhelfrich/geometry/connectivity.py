"""The connectivity of a triangulated surface, in numpy: who is whose neighbor, and whether it is a membrane.

A halfedge h = 3*t+corner leads from that corner of triangle t to the next one.  An edge of a closed surface is a pair
of halfedges that run in opposite directions.
"""

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

IndexArray: TypeAlias = NDArray[np.int64]
MOST_VERTICES = 20_000_000  # of a mesh that is made, of which a run takes 100 GB
BLOCK = 1 << 16  # rows that what is computed row by row takes at a time, which bounds the memory of large meshes
# The volume, in areas to the power 3/2, that rounding to seven digits, as in files, leaves to a flat surface at most.
_ROUNDING = 1e-7
# Vertices of two surfaces are in one place if they are closer than this part of the mean length of the edges.
_COINCIDENT = 1e-6


def requireVertices(count: float, argument: str) -> None:
    """Raise a ValueError if a mesh would have too many vertices; the argument that asks for them is told as "times is
    20".
    """
    if not count <= MOST_VERTICES:
        number = f"about {count:.3g}" if count < 1e15 else "more than 1e+15"
        raise ValueError(f"{argument}, which makes {number} vertices; there may be at most {MOST_VERTICES:.3g}")


def blocks(count: int) -> Iterator[slice]:
    """Yield the rows of a long array, some at a time."""
    return (slice(start, start + BLOCK) for start in range(0, count, BLOCK))


def halfedges(triangles: ArrayLike) -> tuple[IndexArray, IndexArray]:
    """Return the origins and the targets of all halfedges, each of shape (3T,), as int64."""
    triangles = np.asarray(triangles, dtype=np.int64)
    return triangles.ravel(), triangles[:, [1, 2, 0]].ravel()


def endsOf(triangles: NDArray[np.integer], some: IndexArray) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return the origins and the targets of some halfedges."""
    corners = triangles.ravel()
    return corners[some], corners[some + np.where(some % 3 < 2, 1, -2)]


def _edgeKeys(triangles: ArrayLike, numVertices: int) -> IndexArray:
    """Return a number for each halfedge, the same for those of an edge and in the order of edges."""
    triangles = np.asarray(triangles)
    following = triangles[:, [1, 2, 0]]
    keys = np.minimum(triangles, following).astype(np.int64)
    keys *= numVertices
    keys += np.maximum(triangles, following)
    return keys.ravel()


def groupHalfedges(triangles: ArrayLike, numVertices: int) -> tuple[IndexArray, IndexArray]:
    """Sort the halfedges by the edge to which they belong.

    Returns
    -------
    order : (3T,) array
        the halfedges, those of an edge in succession
    start : (E,) array
        where each edge begins in `order`; edges ascend by (smaller vertex, larger vertex)
    """
    key = _edgeKeys(triangles, numVertices)
    order = np.argsort(key, kind="stable")
    key = key[order]
    start = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1]))) if len(key) else np.zeros(0, dtype=int)
    return order, start


def pairHalfedges(triangles: ArrayLike, numVertices: int) -> tuple[IndexArray, IndexArray]:
    """Return the two halfedges of each edge of a closed surface, as two arrays of shape (E,).

    Raises ValueError if an edge has not exactly two.  :func:`check` says more.
    """
    order, start = groupHalfedges(triangles, numVertices)
    if len(order) != 2 * len(start) or np.any(start != 2 * np.arange(len(start))):
        raise ValueError("the surface is not closed: not every edge belongs to exactly two triangles")
    return order[0::2], order[1::2]


def edgesOf(triangles: ArrayLike, numVertices: int) -> NDArray[np.int32]:
    """Return the vertices of each edge, smaller index first, in ascending order: an (E, 2) array."""
    key = np.sort(_edgeKeys(triangles, numVertices))
    isFirst = np.ones(len(key), dtype=bool)
    np.not_equal(key[1:], key[:-1], out=isFirst[1:])
    return np.column_stack(np.divmod(key[isFirst], max(numVertices, 1))).astype(np.int32)


def nearestImages(steps: NDArray[np.float64], box: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return the shortest of the vectors that differ from given ones by vectors of a periodic box, if there is one."""
    return steps if box is None else steps - np.rint(steps @ np.linalg.inv(box)) @ box


def cornersOf(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer], box: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the corners of triangles, or of edges: a (T, 3, 3) array.  In a periodic box they are the images nearest
    to the first corner.
    """
    x = vertices[triangles]
    if box is not None:
        x[:, 1:] = x[:, :1] + nearestImages(x[:, 1:] - x[:, :1], box)
    return x


def edgeVectors(
    vertices: NDArray[np.float64],
    origin: NDArray[np.integer],
    target: NDArray[np.integer],
    box: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return the vectors from some vertices to others, to their nearest images if there is a periodic box."""
    return nearestImages(vertices[target] - vertices[origin], box)


def edgeLengthsOf(
    vertices: NDArray[np.float64], edges: NDArray[np.integer], box: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the length of each edge."""
    lengths = np.empty(len(edges))
    for block in blocks(len(edges)):
        a, b = edges[block].T
        lengths[block] = np.linalg.norm(edgeVectors(vertices, a, b, box), axis=1)
    return lengths


def triangleAreas(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer], box: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the area of each triangle."""
    areas = np.empty(len(triangles))
    for block in blocks(len(areas)):
        areas[block] = np.linalg.norm(triangleNormals(vertices, triangles[block], box), axis=1) / 2
    return areas


def triangleNormals(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer], box: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the normal of each triangle, outwards and of twice its area: a (T, 3) array."""
    x = cornersOf(vertices, triangles, box)
    return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])


class Patch(NamedTuple):
    """A part of the plane that a periodic surface goes over again and again, as an open surface."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    #: which vertex each is an image of, and which triangle
    vertexOf: IndexArray
    triangleOf: IndexArray


def _middleOf(vertices: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the vertices of a surface in a periodic box are on average, along each axis, and the middle of the
    box where they are everywhere.
    """
    mean = np.exp(2j * np.pi * vertices / lengths).mean(axis=0)
    return np.where(np.abs(mean) < 0.5, 0.5, np.angle(mean) / (2 * np.pi)) * lengths


def lengthsOf(box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of a box's sides; raise a ValueError if it is not rectangular."""
    lengths: NDArray[np.float64] = np.diag(box)
    if np.any(box != np.diag(lengths)):
        raise ValueError(
            f"the periodic box is {box.tolist()}; a periodic mesh needs a rectangular one, whose vectors are along "
            "x, y and z"
        )
    return lengths


def imagesInBox(vertices: NDArray[np.float64], box: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return the images of the vertices of a periodic surface that are in one rectangular box, or the vertices
    themselves if there is none.  Across a sheet, the box is around its middle.
    """
    if box is None:
        return vertices
    lengths = lengthsOf(box)
    low = _middleOf(vertices, lengths) - lengths / 2
    return vertices - np.floor((vertices - low) / lengths) * lengths


def patchOf(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer], box: NDArray[np.float64], margin: float = 0.0
) -> Patch:
    """Return each triangle of a surface in a rectangular periodic box where its first corner is in the box, and its
    images that have theirs up to a margin beyond.  Across a sheet, the box is around its middle.
    """
    lengths, inside = np.diag(box), imagesInBox(vertices, box)
    low = _middleOf(vertices, lengths) - lengths / 2
    images = np.rint((cornersOf(vertices, triangles, box) - inside[triangles]) / lengths).astype(np.int64)
    images -= images[:, :1].copy()
    owner = np.arange(len(triangles))
    for axis in range(3 * (margin > 0)):
        first = inside[triangles[owner, 0], axis] - low[axis]
        for step, isNear in ((1, first < margin), (-1, first > lengths[axis] - margin)):
            more = images[: len(first)][isNear]
            more[..., axis] += step
            images, owner = np.concatenate((images, more)), np.concatenate((owner, owner[: len(first)][isNear]))
    keys = np.concatenate((triangles[owner].reshape(-1, 1), images.reshape(-1, 3)), axis=1)
    unique, place = np.unique(keys, axis=0, return_inverse=True)
    points = inside[unique[:, 0]] + unique[:, 1:] * lengths
    return Patch(points, place.reshape(-1, 3), unique[:, 0], owner)


def areaOf(vertices: NDArray[np.float64], triangles: NDArray[np.integer]) -> float:
    """Return the area of all triangles."""
    return float(triangleAreas(vertices, triangles).sum())


def labelComponents(triangles: ArrayLike, numVertices: int) -> tuple[int, IndexArray]:
    """Return the number of connected membranes and the membrane of each vertex, numbered by first appearance."""
    a, b, c = np.asarray(triangles, dtype=np.int32).T
    ends = np.concatenate((a, b)), np.concatenate((b, c))
    graph = coo_array((np.ones(len(ends[0]), dtype=bool), ends), shape=(numVertices, numVertices))
    count, labels = connected_components(graph, directed=False)
    if count == 1:
        return count, np.zeros(numVertices, dtype=np.int64)
    return count, byFirstAppearance(labels)


def sheets(triangles: NDArray[np.integer], numVertices: int) -> IndexArray:
    """Return the sheet of each triangle, numbered by first appearance: surfaces that touch at vertices are several."""
    order, start = groupHalfedges(triangles, numVertices)
    first = start[np.diff(start, append=len(order)) == 2]
    ends, size = (order[first] // 3, order[first + 1] // 3), len(triangles)
    _, sheet = connected_components(coo_array((np.ones(len(first), dtype=bool), ends), (size, size)), directed=False)
    return byFirstAppearance(sheet)


def byFirstAppearance(labels: NDArray[np.integer]) -> IndexArray:
    """Return labels with numbers from 0 on in the order in which they come first."""
    _, first, place = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[place]


def genus(triangles: NDArray[np.integer], numVertices: int) -> int:
    """Return the number of handles of all closed membranes together: 0 for spheres, 1 for a torus."""
    count, _ = labelComponents(triangles, numVertices)
    numLoose = numVertices - np.count_nonzero(isUsed(triangles, numVertices))
    numEdges = 3 * len(triangles) // 2
    return count - numLoose - (numVertices - numLoose - numEdges + len(triangles)) // 2


def isUsed(triangles: NDArray[np.integer], numVertices: int) -> NDArray[np.bool_]:
    """Return which vertices belong to a triangle."""
    used = np.zeros(numVertices, dtype=bool)
    used[triangles] = True
    return used


def trianglesFromEdges(edges: NDArray[np.integer], vertices: NDArray[np.float64]) -> IndexArray:
    """Return the triangles of a set of closed membranes of which only the edges are known.

    Parameters
    ----------
    edges : (E, 2) integer array
        the vertices of each edge
    vertices : (N, 3) array
        positions, which tell the inside from the outside

    Raises
    ------
    ValueError
        if an edge is not part of exactly two rings of three edges, so that the triangles are not certain
    """
    neighbors: list[set[int]] = [set() for _ in range(len(vertices))]
    for i, j in edges.tolist():
        neighbors[i].add(j)
        neighbors[j].add(i)
    rings = {(i, j): neighbors[i] & neighbors[j] for i, j in np.sort(edges, axis=1).tolist()}
    for edge, corners in rings.items():
        if len(corners) != 2:
            raise ValueError(
                f"the bond {edge} belongs to {len(corners)} rings of three bonds, not two, so that bonds do not tell "
                "the triangles; give a mesh file"
            )
    triangles = np.array([(i, j, k) for (i, j), corners in rings.items() for k in corners if k > j]).reshape(-1, 3)
    return _orient(triangles, vertices)


def _turns(count: int, first: np.ndarray, second: np.ndarray, agree: np.ndarray) -> np.ndarray:
    """Return which triangles to turn so that all neighbors agree, if those in `first` and `second` share an edge and
    agree or not.
    """
    beyond: list[list[tuple[int, bool]]] = [[] for _ in range(count)]
    for f, g, same in zip(first.tolist(), second.tolist(), agree.tolist()):
        beyond[f].append((g, same))
        beyond[g].append((f, same))
    turned: list[bool | None] = [None] * count
    for start in range(count):
        if turned[start] is not None:
            continue
        turned[start], waiting = False, [start]
        while waiting:
            f = waiting.pop()
            for g, same in beyond[f]:
                if turned[g] is None:
                    turned[g] = turned[f] == same
                    waiting.append(g)
    return np.array(turned, dtype=bool)


def _orient(triangles: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Turn the triangles of closed membranes so that neighbors agree and volumes are positive."""
    first, second = pairHalfedges(triangles, len(vertices))
    origin, _ = halfedges(triangles)
    turned = _turns(len(triangles), first // 3, second // 3, origin[first] != origin[second])
    triangles = np.where(turned[:, np.newaxis], triangles[:, [0, 2, 1]], triangles)
    count, label = labelComponents(triangles, len(vertices))
    for membrane in range(count):
        mine = label[triangles[:, 0]] == membrane
        if signedVolume(vertices, triangles[mine]) < 0:
            triangles[mine] = triangles[mine][:, [0, 2, 1]]
    return triangles


class Fault(ValueError):
    """A sentence on what is wrong with a mesh, and a vertex of the surface that it is about."""

    def __init__(self, sentence: str, vertex: int):
        super().__init__(sentence)
        self.vertex = int(vertex)


def check(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer], box: NDArray[np.float64] | None = None
) -> None:
    """Raise a ValueError, in a sentence that names the first offending item, unless the mesh is a set of closed,
    oriented, manifold surfaces that enclose a positive volume, or are periodic.

    Parameters
    ----------
    vertices : (N, 3) array
        positions, in nm
    triangles : (T, 3) integer array
        vertices of each triangle, counter-clockwise seen from outside
    box : (3, 3) array, optional
        the vectors of the periodic box, in nm, of a periodic surface
    """
    if len(triangles) == 0:
        raise ValueError("the mesh has no triangles")
    _checkTriangles(vertices, triangles, box)
    order, start = groupHalfedges(triangles, len(vertices))
    _checkEdges(triangles, order, start)
    opposite = np.empty((len(triangles), 3), dtype=np.int32)
    opposite.ravel()[order[0::2]], opposite.ravel()[order[1::2]] = order[1::2], order[0::2]
    del order, start
    _checkNeighbors(triangles, opposite)
    _checkVertices(triangles, len(vertices), opposite)
    count, label = labelComponents(triangles, len(vertices))
    _checkPlaces(vertices, triangles, label)
    if box is None:
        _checkVolumes(vertices, triangles, count, label)
    else:
        _checkBox(edgeLengthsOf(vertices, edgesOf(triangles, len(vertices)), box), box)


def _checkBox(lengths: NDArray[np.float64], box: NDArray[np.float64]) -> None:
    if np.any(box != np.diag(np.diag(box))):
        raise ValueError(f"the periodic box has the vectors {box.tolist()}; it must be rectangular, along x, y and z")
    if np.diag(box).min() < 2 * lengths.max():
        raise ValueError(
            f"an edge is {lengths.max():.4g} nm long, and the periodic box {np.diag(box).min():.4g} nm wide; each side "
            "must be at least twice as long as any edge"
        )


def _checkTriangles(vertices: np.ndarray, triangles: np.ndarray, box: np.ndarray | None) -> None:
    a, b, c = triangles.T
    repeated = np.flatnonzero((a == b) | (b == c) | (c == a))
    if len(repeated):
        raise Fault(
            f"{_triangle(triangles, repeated[0])} has the same vertex twice; its three must differ",
            triangles[repeated[0], 0],
        )
    doubleArea, longest = np.empty(len(triangles)), np.empty(len(triangles))
    for block in blocks(len(triangles)):
        x = cornersOf(vertices, triangles[block], box)
        sides = np.stack((x[:, 1] - x[:, 0], x[:, 2] - x[:, 1], x[:, 0] - x[:, 2]))
        doubleArea[block] = np.linalg.norm(np.cross(sides[0], sides[1]), axis=1)
        longest[block] = np.einsum("sti,sti->st", sides, sides).max(axis=0)
    # Three points on a line leave a rounding error, which this tells from a triangle that is merely small.
    flat = np.flatnonzero(doubleArea <= 1e-12 * longest)
    if len(flat):
        raise Fault(
            f"{_triangle(triangles, flat[0])} has no area; its three vertices must not lie on a line",
            triangles[flat[0], 0],
        )


def _checkEdges(triangles: np.ndarray, order: np.ndarray, start: np.ndarray) -> None:
    count = np.diff(start, append=len(order))
    wrong = np.flatnonzero(count != 2)
    if len(wrong):
        _checkRepeatedTriangles(triangles)
        crowded = np.flatnonzero(count > 2)
        if len(crowded):
            e = crowded[0]
            owners = ", ".join(str(h // 3) for h in np.sort(order[start[e] : start[e] + count[e]]))
            raise Fault(
                f"{_edge(triangles, order[start[e]])} belongs to {count[e]} triangles ({owners}); "
                "an edge must belong to exactly two",
                triangles.flat[order[start[e]]],
            )
        raise Fault(
            f"the surface is open: {_edge(triangles, order[start[wrong[0]]])} belongs to triangle "
            f"{order[start[wrong[0]]] // 3} only ({len(wrong)} such edge{'s' if len(wrong) > 1 else ''}); a membrane "
            "must be closed",
            triangles.flat[order[start[wrong[0]]]],
        )
    origin, first, second = triangles.ravel(), order[0::2], order[1::2]
    same = np.flatnonzero(origin[first] == origin[second])
    if len(same):
        h = first[same[0]]
        raise Fault(
            f"triangles {h // 3} and {second[same[0]] // 3} run along {_edge(triangles, h)} in the same direction; "
            "all triangles must be counter-clockwise seen from outside",
            triangles.flat[h],
        )


def _checkNeighbors(triangles: np.ndarray, opposite: np.ndarray) -> None:
    """Check that no triangle has the same neighbor three times, which would have the same vertices."""
    a, b, c = (opposite // 3).T
    if np.any((a == b) & (b == c)):
        _checkRepeatedTriangles(triangles)


def _checkRepeatedTriangles(triangles: np.ndarray) -> None:
    corners = np.sort(triangles, axis=1)
    order = np.lexsort(corners.T)
    same = np.flatnonzero(np.all(corners[order[1:]] == corners[order[:-1]], axis=1))
    if len(same):
        first, second = sorted(order[same[0] : same[0] + 2])
        raise Fault(
            f"{_triangle(triangles, second)} has the same three vertices as triangle {first}; "
            "a triangle must appear once",
            triangles[second, 0],
        )


def _checkVertices(triangles: np.ndarray, numVertices: int, opposite: np.ndarray) -> None:
    """Check that the triangles around each vertex form one closed fan of at least three."""
    origin = triangles.ravel()
    valence = np.bincount(origin, minlength=numVertices)
    few = np.flatnonzero(valence < 3)
    if len(few):
        v = few[0]
        if valence[v] == 0:
            raise ValueError(f"vertex {v} belongs to no triangle")
        raise Fault(f"vertex {v} has {valence[v]} neighbors; a vertex must have at least three", v)
    following = opposite[:, [2, 0, 1]].ravel()  # around the vertex
    one, place = np.ones(len(origin), dtype=np.int8), np.arange(len(origin) + 1, dtype=np.int32)
    fans, fan = connected_components(csr_array((one, following, place)), connection="strong")
    if fans > numVertices:
        _, example = np.unique(fan, return_index=True)
        v = np.flatnonzero(np.bincount(origin[example], minlength=numVertices) > 1)[0]
        raise Fault(
            f"the surface touches itself at vertex {v}, whose triangles form more than one fan; "
            "give each sheet a vertex of its own",
            v,
        )


def coincident(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer], label: IndexArray, part: float
) -> tuple[IndexArray, float]:
    """Return pairs of vertices of two surfaces, by the label of each vertex, that are closer than a part of the mean
    length of the edges, (K, 2), and that distance.
    """
    used = np.flatnonzero(isUsed(triangles, len(vertices)))
    if len(used) == 0 or np.all(label[used] == label[used[0]]):
        return np.zeros((0, 2), dtype=np.int64), 0.0
    distance = part * float(edgeLengthsOf(vertices, np.column_stack(halfedges(triangles))).mean())
    pairs = used[cKDTree(vertices[used]).query_pairs(distance, output_type="ndarray")]
    return pairs[label[pairs[:, 0]] != label[pairs[:, 1]]], distance


def _checkPlaces(vertices: np.ndarray, triangles: np.ndarray, label: IndexArray) -> None:
    """Check that no two surfaces have vertices in one place, as one that was exported twice has."""
    pairs, _ = coincident(vertices, triangles, label, _COINCIDENT)
    if len(pairs):
        a, b = pairs[np.lexsort(pairs.T)[0]]
        raise Fault(
            f"vertices {a} and {b} of two surfaces are in the same place ({len(pairs)} such pair"
            f"{'s' if len(pairs) > 1 else ''}); surfaces must not touch, and each must be there once",
            b,
        )


def _checkVolumes(vertices: np.ndarray, triangles: np.ndarray, count: int, label: IndexArray) -> None:
    parts = [triangles]
    if count > 1:
        mine = label[triangles[:, 0]]
        order, sizes = np.argsort(mine, kind="stable"), np.bincount(mine, minlength=count)
        parts = np.split(triangles[order], np.cumsum(sizes)[:-1])
    for part in parts:
        v = signedVolume(vertices, part)
        if abs(v) <= _ROUNDING * areaOf(vertices, part) ** 1.5:
            raise Fault(f"the membrane of vertex {part.min()} is flat: it encloses no volume", part.min())
        if v < 0:
            raise Fault(
                f"the membrane of vertex {part.min()} is inside out: its volume is {v:.6g}; reverse its triangles, "
                "which must be counter-clockwise seen from outside",
                part.min(),
            )


def signedVolume(vertices: NDArray[np.float64], triangles: NDArray[np.integer]) -> float:
    """Return the volume that the triangles enclose, positive if they are counter-clockwise seen from outside."""
    # The center is subtracted so that a mesh far from the origin loses no digits.
    center, total = vertices[triangles[:, 0]].mean(axis=0), 0.0
    for block in blocks(len(triangles)):
        x = vertices[triangles[block]] - center
        parts = np.einsum("ti,ti->t", x[:, 0], np.cross(x[:, 1], x[:, 2]))
        total = np.concatenate(([total], parts)).cumsum()[-1]  # one after the other, whatever the blocks
    return float(total / 6)


def _triangle(triangles: np.ndarray, t: int) -> str:
    return f"triangle {t} ({', '.join(map(str, triangles[t]))})"


def _edge(triangles: np.ndarray, h: int) -> str:
    t, corner = divmod(int(h), 3)
    return f"edge ({triangles[t, corner]}, {triangles[t, (corner + 1) % 3]})"
