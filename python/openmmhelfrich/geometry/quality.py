"""What a mesh is like: its topology, the shape of its triangles, whether it meets itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from . import connectivity
from .mesh import Mesh

BLOCK = 1 << 17  # points that a search has at a time, which bounds the memory of large meshes
SLACK = 1 + 1e-6  # for rounding, where a search is to miss nothing


@dataclass
class MeshQuality:
    """The description of a closed mesh by :func:`assess`.

    Attributes
    ----------
    mesh : Mesh
        the mesh
    genera : list of int
        the genus of each connected membrane: 0 for a sphere, 1 for a torus
    valences : (N,) array
        the number of neighbors of each vertex
    angles : (T, 3) array
        the angles of each triangle, in degrees
    aspectRatios : (T,) array
        circumradius over twice the inradius of each triangle: 1 if it is equilateral, more if not
    closestPair : tuple or None
        two vertices that are close in space, though at least three edges apart on the surface, and their distance in
        nm.  None if there are none within two mean edge lengths
    crossings : (K, 3) array
        the vertices of an edge and the number of a triangle through which it passes, for each such pair
    """

    mesh: Mesh
    genera: list[int]
    valences: np.ndarray
    angles: np.ndarray
    aspectRatios: np.ndarray
    closestPair: tuple[int, int, float] | None
    crossings: np.ndarray

    def lines(self, lengthUnit: str = "nm") -> list[tuple[str, str]]:
        """Return a label and a text for each thing worth knowing."""
        mesh, u = self.mesh, lengthUnit
        lengths = mesh.edgeLengths
        mean = lengths.mean()
        lines = [
            ("membrane", f"{len(mesh.vertices)} vertices, {len(lengths)} edges, {len(mesh.triangles)} triangles"),
            ("surface", f"closed, manifold, oriented outwards: {_components(self.genera)}"),
            ("area", f"{mesh.area:.6g} {u}^2"),
            ("volume", f"{mesh.volume:.6g} {u}^3"),
            ("reduced volume", f"{mesh.reducedVolume:.4f}"),
            ("edges", f"{_range(lengths)} {u} long, standard deviation {lengths.std() / mean:.1%} of the mean"),
            ("angles", f"{_range(self.angles)} degrees"),
            ("aspect ratios", f"{_range(self.aspectRatios)} (circumradius over twice the inradius)"),
            ("neighbors", f"{self.valences.min()} to {self.valences.max()} of a vertex"),
            ("contact", self._contact(mean, u)),
        ]
        if len(self.crossings):
            a, b, t = self.crossings[0]
            lines.append(
                (
                    "warning",
                    f"the surface passes through itself {len(self.crossings)} times, "
                    f"first where edge ({a}, {b}) passes through triangle {t}",
                )
            )
        return lines

    def _contact(self, mean: float, u: str) -> str:
        if self.closestPair is None:
            return "no vertices that are three or more edges apart come within two mean edge lengths of each other"
        a, b, distance = self.closestPair
        return (
            f"vertices {a} and {b}, three or more edges apart, are {distance:.4g} {u} from each other: "
            f"{distance / mean:.2f} mean edge lengths"
        )


def assess(mesh: Mesh) -> MeshQuality:
    """Describe a closed mesh.

    Raises
    ------
    ValueError
        if it is not a set of closed, oriented, manifold surfaces: see :meth:`Mesh.check`

    Returns
    -------
    MeshQuality
    """
    mesh.check()
    angles, aspectRatios = _shapes(mesh)
    valences = np.bincount(mesh.triangles.ravel())  # as many as triangles around a vertex, for the mesh is closed
    return MeshQuality(mesh, _genera(mesh), valences, angles, aspectRatios, closestPair(mesh), crossings(mesh))


def closestPair(mesh: Mesh) -> tuple[int, int, float] | None:
    """Return the two closest vertices that are three or more edges apart, and their distance; None if all are farther
    than two mean edge lengths.
    """
    edges, n = mesh.edges, len(mesh.vertices)
    a, b = np.concatenate((edges, edges[:, ::-1])).T
    bonded = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(n, n)).tocsr()
    near = bonded + bonded @ bonded
    near.sort_indices()  # which makes a search of each look
    closest = None
    for pairs in _touching(mesh.vertices, np.full(n, mesh.edgeLengths.mean()), BLOCK):
        if len(pairs):
            pairs = pairs[~np.asarray(near[pairs[:, 0], pairs[:, 1]]).ravel()]
        distances = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
        if len(pairs) and (closest is None or distances.min() < closest[2]):
            (i, j), distance = pairs[distances.argmin()], distances.min()
            closest = int(i), int(j), float(distance)
    return closest


def crossings(mesh: Mesh, block: int = BLOCK) -> np.ndarray:
    """Return the vertices of an edge and the number of a triangle for each edge that passes through a triangle, as a
    (K, 3) array.

    Two triangles without common vertices meet just if an edge of one passes through the other.  Those that touch
    without passing through are not found.
    """
    middles, radii = np.empty(mesh.triangles.shape), np.empty(len(mesh.triangles))
    for some in connectivity.blocks(len(radii)):
        corners = mesh.vertices[mesh.triangles[some]]
        middles[some] = corners.mean(axis=1)
        radii[some] = np.linalg.norm(corners - middles[some][:, np.newaxis], axis=2).max(axis=1)
    found = [
        _passing(mesh, edges, triangles)
        for pairs in _touching(middles, radii, block)
        for edges, triangles in _near(mesh, pairs, middles, radii)
    ]
    rows = np.unique(np.concatenate(found), axis=0) if found else np.zeros((0, 3), dtype=int)
    return rows[np.argsort(np.floor(np.log2(radii[rows[:, 2]])), kind="stable")]


def _touching(middles: np.ndarray, radii: np.ndarray, block: int) -> Iterator[np.ndarray]:
    """Yield the pairs of spheres that touch, in arrays of shape (K, 2)."""
    # Spheres of similar size together, so that a few large ones do not widen the search for all.
    sizes = np.minimum(np.floor(np.log2(radii.max() / radii)), 20)
    classes = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    trees = [cKDTree(middles[mine]) for mine in classes] if len(classes) > 1 else []
    for i, mine in enumerate(classes):
        for pairs in _touchingInSlabs(middles[mine], radii[mine], block):
            yield mine[pairs]
        for tree, others in zip(trees[i + 1 :], classes[i + 1 :]):
            reach = radii[mine].max() + radii[others].max()
            for start in range(0, len(mine), block):
                some = mine[start : start + block]
                found = cKDTree(middles[some]).sparse_distance_matrix(tree, reach, output_type="ndarray")
                a, b = some[found["i"]], others[found["j"]]
                yield np.column_stack((a, b))[found["v"] <= SLACK * (radii[a] + radii[b])]


def _touchingInSlabs(middles: np.ndarray, radii: np.ndarray, block: int) -> Iterator[np.ndarray]:
    """Yield the pairs of spheres of similar size that touch, found in slabs across the longest axis, each with the
    spheres beyond it that its own can reach.
    """
    along, reach = middles[:, np.ptp(middles, axis=0).argmax()], 2 * radii.max()
    order = np.argsort(along, kind="stable") if len(middles) > block else np.arange(len(middles))
    for start in range(0, len(order), block):
        last = min(start + block, len(order)) - 1
        stop = np.searchsorted(along, along[order[last]] + reach, "right", order) if block < len(order) else len(order)
        mine = order[start:stop]
        x, r = middles[mine], radii[mine]
        pairs = cKDTree(x).query_pairs(reach, output_type="ndarray")
        a, b = pairs[pairs.min(axis=1) <= last - start].T
        d = x[a] - x[b]
        isTouching = _dot(d, d) <= SLACK * (r[a] + r[b]) ** 2
        yield np.column_stack((mine[a[isTouching]], mine[b[isTouching]]))


def _near(
    mesh: Mesh, pairs: np.ndarray, middles: np.ndarray, radii: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the edges of each triangle of a pair that have no vertex of the other, and come close to it, with that."""
    first, second = mesh.triangles[pairs[:, 0]], mesh.triangles[pairs[:, 1]]
    same = first[:, :, np.newaxis] == second[:, np.newaxis, :]
    for corners, isShared, others in (
        (first, same.any(axis=2), pairs[:, 1]),
        (second, same.any(axis=1), pairs[:, 0]),
    ):
        for edge in ([0, 1], [1, 2], [2, 0]):
            mine = np.flatnonzero(~isShared[:, edge].any(axis=1))
            ends, t = np.sort(corners[mine][:, edge], axis=1), others[mine]
            a, b = mesh.vertices[ends[:, 0]], mesh.vertices[ends[:, 1]]
            distance, d = (a + b) / 2 - middles[t], b - a
            isNear = _dot(distance, distance) <= SLACK * (np.sqrt(_dot(d, d)) / 2 + radii[t]) ** 2
            yield ends[isNear], t[isNear]


def _passing(mesh: Mesh, edges: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return those of the edges that pass through the triangle beside them, and that triangle."""
    # The point a + s d of an edge has coordinates u, v in the triangle (Moeller and Trumbore, J. Graphics Tools 2, 21
    # (1997)).
    a, d = mesh.vertices[edges[:, 0]], mesh.vertices[edges[:, 1]] - mesh.vertices[edges[:, 0]]
    x = mesh.vertices[mesh.triangles[triangles]]
    side, other, offset = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], a - x[:, 0]
    p, q = np.cross(d, other), np.cross(offset, side)
    with np.errstate(all="ignore"):  # a triangle that the edge runs along has no such point
        scale = 1 / _dot(side, p)
        u, v, s = _dot(offset, p) * scale, _dot(d, q) * scale, _dot(other, q) * scale
        passes = (u >= 0) & (v >= 0) & (u + v <= 1) & (s >= 0) & (s <= 1)
    return np.column_stack((edges, triangles))[passes]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def _genera(mesh: Mesh) -> list[int]:
    """Return the genus g of each membrane, from its Euler characteristic V-E+F = 2-2g, where E = 3F/2."""
    count, label = connectivity.labelComponents(mesh.triangles, len(mesh.vertices))
    vertices, triangles = (np.bincount(l, minlength=count) for l in (label, label[mesh.triangles[:, 0]]))
    return ((2 - (vertices - triangles // 2)) // 2).tolist()


def _shapes(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles, in degrees, and the aspect ratio of each triangle."""
    angles, aspectRatios = np.empty(mesh.triangles.shape), np.empty(len(mesh.triangles))
    doubleAreas = 2 * mesh.triangleAreas
    for block in connectivity.blocks(len(angles)):
        x, doubleArea = mesh.vertices[mesh.triangles[block]], doubleAreas[block]
        sides = x[:, [2, 0, 1]] - x[:, [1, 2, 0]]  # opposite to each corner
        lengths = np.linalg.norm(sides, axis=2)
        cosine = -np.einsum("tci,tci->tc", sides[:, [1, 2, 0]], sides[:, [2, 0, 1]])
        angles[block] = np.degrees(np.arctan2(doubleArea[:, np.newaxis], cosine))
        circumradius, inradius = lengths.prod(axis=1) / (2 * doubleArea), doubleArea / lengths.sum(axis=1)
        aspectRatios[block] = circumradius / (2 * inradius)
    return angles, aspectRatios


def _components(genera: Sequence[int]) -> str:
    if len(genera) == 1:
        return f"one membrane of genus {genera[0]}"
    return f"{len(genera)} membranes of genus {', '.join(map(str, sorted(set(genera))))}"


def _range(values: np.ndarray) -> str:
    return f"{values.min():.4g} to {values.max():.4g}, mean {values.mean():.4g}"
