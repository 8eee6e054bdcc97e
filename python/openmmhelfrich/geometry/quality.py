"""What a mesh is like: its topology, the shape of its triangles, whether it meets itself."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from ..units import lengthUnit as lengthInNm
from . import connectivity
from .mesh import Mesh
from .predicates import orientations

# What is called a speck: a surface with less than this part of the area of the largest.
_SPECK = 0.01
# Angles between the normals of neighbors, in degrees, from which on a facet lies on another.
_DOUBLED = 170.0
# The sizes of what membranes enclose, in nm: less than a bilayer is thick, and more than the largest cell measures.
_SMALLEST, _LARGEST = 10.0, 1e6
# Of so many surfaces each has a column.
_COLUMNS = 8


@dataclass
class MeshQuality:
    """The description of a closed mesh by :func:`assess`.

    Attributes
    ----------
    mesh : Mesh
        the mesh
    surfaces : list of Mesh
        each connected membrane, in the order of first triangles
    genera : list of int
        the genus of each: 0 for a sphere, 1 for a torus
    valences : (N,) array
        the number of neighbors of each vertex
    angles : (T, 3) array
        the angles of each triangle, in degrees
    aspectRatios : (T,) array
        circumradius over twice the inradius of each triangle: 1 if it is equilateral, more if not
    dihedrals : (E,) array
        the angle between the normals at each edge, in degrees: 0 where it is flat, 180 where facets lie on each other
    closestPair : tuple or None
        two vertices that are close in space, though at least three edges apart on the surface, and their distance in
        nm.  None if there are none within two mean edge lengths
    crossings : (K, 3) array
        the vertices of an edge and the number of a triangle through which it passes, for each such pair
    """

    mesh: Mesh
    surfaces: list[Mesh]
    genera: list[int]
    valences: np.ndarray
    angles: np.ndarray
    aspectRatios: np.ndarray
    dihedrals: np.ndarray
    closestPair: tuple[int, int, float] | None
    crossings: np.ndarray

    def lines(self, lengthUnit: str = "nm") -> list[tuple[str, str]]:
        """Return a label and a text for each thing worth knowing."""
        mesh, u = self.mesh, lengthUnit
        lengths, mean = mesh.edgeLengths, mesh.edgeLengths.mean()
        return [
            ("membrane", f"{len(mesh.vertices)} vertices, {len(lengths)} edges, {len(mesh.triangles)} triangles"),
            ("surface", f"closed, manifold, oriented outwards: {_components(self.genera)}"),
            *self._measures(u),
            ("edges", f"{_range(lengths)} {u} long, standard deviation {lengths.std() / mean:.1%} of the mean"),
            ("angles", f"{_range(self.angles)} degrees; between facets at most {np.abs(self.dihedrals).max():.4g}"),
            ("aspect ratios", f"{_range(self.aspectRatios)} (circumradius over twice the inradius)"),
            ("neighbors", f"{self.valences.min()} to {self.valences.max()} of a vertex"),
            ("contact", self._contact(mean, u)),
            *(("warning", text) for text in self.warnings(u)),
        ]

    def warnings(self, lengthUnit: str = "nm") -> list[str]:
        """Return a sentence for each thing that is likely to be a mistake."""
        found, areas = [], [surface.area for surface in self.surfaces]
        for k, (surface, area) in enumerate(zip(self.surfaces, areas)):
            if area < _SPECK * max(areas):
                found.append(
                    f"surface {k}, of {len(surface.triangles)} triangles, has {area / max(areas):.2%} of the area of "
                    "the largest: a speck"
                )
        doubled = int(np.sum(np.abs(self.dihedrals) > _DOUBLED))
        if doubled:
            found.append(f"at {doubled} edge{'s' if doubled > 1 else ''} one facet lies on another, folded back")
        if len(self.crossings):
            a, b, t = self.crossings[0]
            found.append(
                f"the surface passes through itself {len(self.crossings)} times, "
                f"first where edge ({a}, {b}) passes through triangle {t}"
            )
        size, nm = float(np.ptp(self.mesh.vertices, axis=0).max()), lengthInNm(lengthUnit)
        if nm is not None and not _SMALLEST <= size * nm <= _LARGEST:
            found.append(
                f"it is {size:.3g} {lengthUnit} across, {'smaller' if size * nm < _SMALLEST else 'larger'} than cells "
                "and vesicles are: is that the unit of the file?  --length-unit tells it; shapes do not depend on it"
            )
        return found

    def _measures(self, u):
        """Return area, volume and reduced volume, of each surface in a column of its own if there are several."""
        rows = (
            ("area", lambda surface: f"{surface.area:.6g}", f" {u}^2"),
            ("volume", lambda surface: f"{surface.volume:.6g}", f" {u}^3"),
            ("reduced volume", lambda surface: f"{surface.reducedVolume:.4f}", ""),
        )
        if len(self.surfaces) == 1:
            return [(label, text(self.mesh) + suffix) for label, text, suffix in rows]
        shown = self.surfaces[:_COLUMNS]
        head = [
            ("surface", [str(k) for k in range(len(shown))]),
            ("vertices", [str(len(surface.vertices)) for surface in shown]),
            ("genus", [str(genus) for genus in self.genera[:_COLUMNS]]),
        ]
        table = head + [(label + suffix.replace(" ", ", "), [text(s) for s in shown]) for label, text, suffix in rows]
        more = len(self.surfaces) - len(shown)
        return [
            (
                label,
                "".join(f"{cell:>14}" for cell in cells) + (f"  and {more} more" * (more > 0 and label == "surface")),
            )
            for label, cells in table
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
    surfaces = mesh.components()
    return MeshQuality(
        mesh,
        surfaces,
        [genus(surface) for surface in surfaces],
        valences,
        angles,
        aspectRatios,
        dihedralAngles(mesh),
        closestPair(mesh),
        crossings(mesh),
    )


def genus(surface: Mesh) -> int:
    """Return the genus of a connected closed membrane, from its Euler characteristic V-E+F = 2-2g."""
    return (2 - (len(surface.vertices) - len(surface.triangles) // 2)) // 2


def triangleAngles(mesh: Mesh) -> np.ndarray:
    """Return the angles of each triangle, in degrees: a (T, 3) array; those of one without area are 0 and 180."""
    return _shapes(mesh)[0]


def dihedralAngles(mesh: Mesh) -> np.ndarray:
    """Return the angle between the normals of the two triangles at each edge, in degrees: 0 where the surface is flat,
    positive where it is convex, 180 where facets lie on each other.
    """
    first, second = connectivity.pairHalfedges(mesh.triangles, len(mesh.vertices))
    origin, target = (end[first] for end in connectivity.halfedges(mesh.triangles))
    normals = connectivity.triangleNormals(mesh.vertices, mesh.triangles)
    f, g = normals[first // 3], normals[second // 3]
    edge = mesh.vertices[target] - mesh.vertices[origin]
    sine = _dot(np.cross(f, g), edge) / np.linalg.norm(edge, axis=1)
    return np.degrees(np.arctan2(sine, _dot(f, g)))


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

    Signs are exact: what touches without passing through, or lies in the same plane, is not found.  An edge may pass
    through a side of the triangle, but where it passes exactly through a corner it is not found.
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
    for isLeft in (lambda *_: apart, _boxesOverlap, _hasEndsOnBothSides, _goesThrough):
        left = isLeft(mesh, edges, triangles)
        edges, triangles = edges[left], triangles[left]
    return np.column_stack((edges, triangles))


def _points(mesh, edges, triangles):
    """Return the ends of edges and the corners of triangles, (2, n, 3) and (3, n, 3)."""
    return mesh.vertices[edges.T], mesh.vertices[mesh.triangles[triangles].T]


def _boxesOverlap(mesh, edges, triangles):
    ends, corners = _points(mesh, edges, triangles)
    return np.all((ends.min(axis=0) <= corners.max(axis=0)) & (corners.min(axis=0) <= ends.max(axis=0)), axis=1)


def _hasEndsOnBothSides(mesh, edges, triangles):
    ends, corners = _points(mesh, edges, triangles)
    return orientations(*corners, ends[0]) * orientations(*corners, ends[1]) < 0


def _goesThrough(mesh, edges, triangles):
    """Return where edges whose ends are on both sides of the plane of a triangle pass through it, or, through one of
    its sides, from one side of the surface to the other.
    """
    ends, corners = _points(mesh, edges, triangles)
    hands = np.array([orientations(*ends, corners[i], corners[(i + 1) % 3]) for i in range(3)])
    positive, negative = (hands > 0).sum(axis=0), (hands < 0).sum(axis=0)
    through = (positive == 3) | (negative == 3)
    atSide = np.flatnonzero((positive == 2) & (negative == 0) | (negative == 2) & (positive == 0))
    through[atSide] = _crossesAtSide(mesh, edges[atSide], triangles[atSide], (hands[:, atSide] == 0).argmax(axis=0))
    return through


def _crossesAtSide(mesh, edges, triangles, sides):
    """Return where edges through the given side of a triangle have their ends on both sides of its two facets."""
    first, second = connectivity.pairHalfedges(mesh.triangles, len(mesh.vertices))
    opposite = np.empty(3 * len(mesh.triangles), dtype=np.int64)
    opposite[first], opposite[second] = second, first
    across = opposite[3 * triangles + sides] // 3
    apex = mesh.triangles[across, (opposite[3 * triangles + sides] + 2) % 3]
    ends, corners = _points(mesh, edges, triangles)
    isConvex = orientations(*corners, mesh.vertices[apex]) > 0
    others = mesh.vertices[mesh.triangles[across].T]
    place = []
    for end in ends:  # 1 outside, -1 inside, 0 on the surface; d is inside where the determinant is positive
        here, there = -orientations(*corners, end), -orientations(*others, end)
        place.append(np.where(isConvex, np.maximum(here, there), np.minimum(here, there)))
    return place[0] * place[1] < 0


def _dot(a, b):
    return np.einsum("ij,ij->i", a, b)


def _shapes(mesh):
    """Return the angles, in degrees, and the aspect ratio of each triangle."""
    x = mesh.vertices[mesh.triangles]
    sides = x[:, [2, 0, 1]] - x[:, [1, 2, 0]]  # opposite to each corner
    lengths = np.linalg.norm(sides, axis=2)
    doubleArea = 2 * mesh.triangleAreas
    angles = np.arctan2(doubleArea[:, np.newaxis], -np.einsum("tci,tci->tc", sides[:, [1, 2, 0]], sides[:, [2, 0, 1]]))
    with np.errstate(divide="ignore"):
        aspectRatios = lengths.prod(axis=1) * lengths.sum(axis=1) / (4 * doubleArea**2)
    return np.degrees(angles), aspectRatios


def _components(genera):
    if len(genera) == 1:
        return f"one membrane of genus {genera[0]}"
    return f"{len(genera)} membranes of genus {', '.join(map(str, sorted(set(genera))))}"


def _range(values):
    return f"{values.min():.4g} to {values.max():.4g}, mean {values.mean():.4g}"
