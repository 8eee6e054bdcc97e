"""What a mesh is like: its topology, the shape of its triangles, whether it meets itself."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from . import connectivity
from .mesh import Mesh


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
        lengths, mean = mesh.edgeLengths, mesh.edgeLengths.mean()
        lines = [
            ("membrane", f"{len(mesh.vertices)} vertices, {len(lengths)} edges, {len(mesh.triangles)} triangles"),
            ("surface", f"closed, manifold, oriented outwards: {_components(self.genera)}"),
            *self._sizes(u),
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

    def _sizes(self, u):
        surfaces = self.mesh.components()
        if len(surfaces) == 1:
            return [
                ("area", f"{self.mesh.area:.6g} {u}^2"),
                ("volume", f"{self.mesh.volume:.6g} {u}^3"),
                ("reduced volume", f"{self.mesh.reducedVolume:.4f}"),
            ]
        return [
            (
                f"surface {k}",
                f"{len(surface.vertices)} vertices, area {surface.area:.6g} {u}^2, volume {surface.volume:.6g} {u}^3, "
                f"reduced volume {surface.reducedVolume:.4f}",
            )
            for k, surface in enumerate(surfaces)
        ]

    def _contact(self, mean, u):
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
    valences = np.bincount(mesh.edges.ravel())
    return MeshQuality(mesh, _genera(mesh), valences, angles, aspectRatios, closestPair(mesh), crossings(mesh))


def closestPair(mesh: Mesh) -> tuple[int, int, float] | None:
    """Return the two closest vertices that are three or more edges apart, and their distance; None if all are farther
    than two mean edge lengths.
    """
    pairs = cKDTree(mesh.vertices).query_pairs(2 * mesh.edgeLengths.mean(), output_type="ndarray")
    a, b = mesh.edges.T
    n = len(mesh.vertices)
    bonded = coo_array(
        (np.ones(2 * len(a), dtype=np.int32), (np.concatenate((a, b)), np.concatenate((b, a)))), shape=(n, n)
    ).tocsr()
    near = (bonded + bonded @ bonded).tocoo()
    pairs = pairs[~np.isin(pairs[:, 0] * n + pairs[:, 1], near.row.astype(np.int64) * n + near.col)]
    if not len(pairs):
        return None
    distances = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
    closest = distances.argmin()
    return int(pairs[closest, 0]), int(pairs[closest, 1]), float(distances[closest])


def crossings(mesh: Mesh, block: int = 100000) -> np.ndarray:
    """Return the vertices of an edge and the number of a triangle for each edge that passes through a triangle, as a
    (K, 3) array.

    Two triangles without common vertices meet just if an edge of one passes through the other.  Those that touch
    without passing through are not found.
    """
    corners = mesh.vertices[mesh.triangles]
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, np.newaxis], axis=2).max(axis=1)
    edges, found = mesh.edges, []
    # Triangles of similar size together, so that a few large ones do not widen the search for all.
    sizes = np.floor(np.log2(radii))
    for size in np.unique(sizes):
        mine = np.flatnonzero(sizes == size)
        tree = cKDTree(middles[mine])
        for start in range(0, len(edges), block):
            some = edges[start : start + block]
            a, b = mesh.vertices[some[:, 0]], mesh.vertices[some[:, 1]]
            near = tree.query_ball_point((a + b) / 2, np.linalg.norm(b - a, axis=1) / 2 + radii[mine].max())
            counts = np.fromiter(map(len, near), dtype=np.int64, count=len(near))
            if counts.any():
                e, t = np.repeat(some, counts, axis=0), mine[np.concatenate([n for n in near if n]).astype(np.int64)]
                found.append(_passing(mesh, e, t))
    return np.concatenate(found) if found else np.zeros((0, 3), dtype=int)


def _passing(mesh, edges, triangles):
    """Return those of the edges that pass through the triangle beside them, and that triangle."""
    apart = np.all(edges[:, :, np.newaxis] != mesh.triangles[triangles][:, np.newaxis, :], axis=(1, 2))
    edges, triangles = edges[apart], triangles[apart]
    # The point a + s d of an edge has coordinates u, v in the triangle (Moeller and Trumbore, J. Graphics Tools 2, 21
    # (1997)).
    a, d = mesh.vertices[edges[:, 0]], mesh.vertices[edges[:, 1]] - mesh.vertices[edges[:, 0]]
    x = mesh.vertices[mesh.triangles[triangles]]
    side, other, offset = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], a - x[:, 0]
    p, q = np.cross(d, other), np.cross(offset, side)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / _dot(side, p)
        u, v, s = _dot(offset, p) * scale, _dot(d, q) * scale, _dot(other, q) * scale
        passes = (u >= 0) & (v >= 0) & (u + v <= 1) & (s >= 0) & (s <= 1)
    return np.column_stack((edges, triangles))[passes]


def _dot(a, b):
    return np.einsum("ij,ij->i", a, b)


def _genera(mesh):
    """Return the genus of each membrane, from its Euler characteristic V-E+F = 2-2g."""
    count, label = connectivity.labelComponents(mesh.triangles, len(mesh.vertices))
    vertices, edges, triangles = (
        np.bincount(label[of], minlength=count)
        for of in (np.arange(len(mesh.vertices)), mesh.edges[:, 0], mesh.triangles[:, 0])
    )
    return ((2 - (vertices - edges + triangles)) // 2).tolist()


def _shapes(mesh):
    """Return the angles, in degrees, and the aspect ratio of each triangle."""
    x = mesh.vertices[mesh.triangles]
    sides = x[:, [2, 0, 1]] - x[:, [1, 2, 0]]  # opposite to each corner
    lengths = np.linalg.norm(sides, axis=2)
    doubleArea = 2 * mesh.triangleAreas
    angles = np.arctan2(doubleArea[:, np.newaxis], -np.einsum("tci,tci->tc", sides[:, [1, 2, 0]], sides[:, [2, 0, 1]]))
    circumradius, inradius = lengths.prod(axis=1) / (2 * doubleArea), doubleArea / lengths.sum(axis=1)
    return np.degrees(angles), circumradius / (2 * inradius)


def _components(genera):
    if len(genera) == 1:
        return f"one membrane of genus {genera[0]}"
    return f"{len(genera)} membranes of genus {', '.join(map(str, sorted(set(genera))))}"


def _range(values):
    return f"{values.min():.4g} to {values.max():.4g}, mean {values.mean():.4g}"
