"""What a mesh is like: its topology, the shape of its triangles, whether it meets itself."""

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from ..units import lengthUnit as lengthInNm
from . import connectivity
from .copies import Copy, copies
from .measured import MeasuredMesh
from .measures import reducedVolume
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

BLOCK = 1 << 17  # points that a search has at a time, which bounds the memory of large meshes
SLACK = 1 + 1e-6  # for rounding, where a search is to miss nothing


class MeshQuality(MeasuredMesh):
    """The description of a closed mesh: see :func:`assess`.

    Attributes
    ----------
    edgeLengths : (E,) array
        the length of each edge, in nm
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
    copies : list of Copy
        the pairs of surfaces that lie on each other, as two copies of one object do
    """

    @cached_property
    def edgeLengths(self) -> np.ndarray:
        return self.mesh.edgeLengths

    @cached_property
    def meanEdgeLength(self) -> float:
        return self.edgeLengths.mean()

    @cached_property
    def genera(self) -> list[int]:
        return [connectivity.genus(surface.triangles, len(surface.vertices)) for surface in self.surfaces]

    @cached_property
    def valences(self) -> np.ndarray:
        return np.bincount(self.mesh.triangles.ravel())  # as many as triangles around a vertex, for the mesh is closed

    @cached_property
    def _shapes(self) -> tuple[np.ndarray, np.ndarray]:
        return _shapes(self.mesh)

    @property
    def angles(self) -> np.ndarray:
        return self._shapes[0]

    @property
    def aspectRatios(self) -> np.ndarray:
        return self._shapes[1]

    @cached_property
    def dihedrals(self) -> np.ndarray:
        return dihedralAngles(self.mesh)

    @cached_property
    def closestPair(self) -> tuple[int, int, float] | None:
        return closestPair(self.mesh)

    @cached_property
    def crossings(self) -> np.ndarray:
        return crossings(self.mesh)

    @cached_property
    def copies(self) -> list[Copy]:
        mesh, sheets = self.mesh, connectivity.sheets(self.mesh.triangles, len(self.mesh.vertices))
        if not mesh.isPeriodic:
            return copies(mesh.vertices, mesh.triangles, sheets)
        patch = connectivity.patchOf(mesh.vertices, mesh.triangles, np.asarray(mesh.box))
        return copies(patch.vertices, patch.triangles, sheets[patch.triangleOf])

    @property
    def reducedVolumes(self) -> list[float | None]:
        """The reduced volume of each surface; None of one that is periodic."""
        return [None if v is None else reducedVolume(a, v) for a, v in zip(self.areas, self.volumes)]

    def lines(self, lengthUnit: str = "nm") -> list[tuple[str, str]]:
        """Return a label and a text for each thing worth knowing."""
        mesh, lengths, mean, u = self.mesh, self.edgeLengths, self.meanEdgeLength, lengthUnit
        return [
            ("membrane", f"{len(mesh.vertices)} vertices, {len(lengths)} edges, {len(mesh.triangles)} triangles"),
            ("surface", self._kind(u)),
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
        found, areas = [], self.areas
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
        copied = self.copied(lengthUnit)
        if copied is not None:
            found.append(copied)
        size, nm = float(np.ptp(self.mesh.vertices, axis=0).max()), lengthInNm(lengthUnit)
        if nm is not None and not _SMALLEST <= size * nm <= _LARGEST:
            found.append(
                f"it is {size:.3g} {lengthUnit} across, {'smaller' if size * nm < _SMALLEST else 'larger'} than cells "
                "and vesicles are: is that the unit of the file?  --length-unit tells it; shapes do not depend on it"
            )
        return found

    def copied(self, lengthUnit: str = "nm") -> str | None:
        """Return which surfaces lie on each other and what to do about it, in a sentence, or None if none do."""
        if not self.copies:
            return None
        first, second, distance, part = self.copies[0]
        more = f", the first of {len(self.copies)} pairs" if len(self.copies) > 1 else ""
        return (
            f"surfaces {first} and {second} are within {f'{distance:.2g} {lengthUnit}'.strip()}, {part:.2g} of an "
            f"edge, of each other over most of their area, like copies of one object{more}: leave one out, by repair "
            "--keep or in the program that exported the file"
        )

    def _kind(self, u: str) -> str:
        if not self.mesh.isPeriodic:
            return f"closed, manifold, oriented outwards: {_components(self.genera)}"
        sides = " x ".join(f"{side:.4g}" for side in np.diag(np.asarray(self.mesh.box)))
        return f"periodic in a box of {sides} {u}, manifold: {_components(self.genera)}"

    def _measures(self, u: str) -> list[tuple[str, str]]:
        """Return area, volume and reduced volume, of each surface in a column of its own if there are several."""
        rows = [("area", [f"{area:.6g}" for area in self.areas], f" {u}^2")]
        if not self.mesh.isPeriodic:
            rows.append(("volume", [f"{volume:.6g}" for volume in self.volumes], f" {u}^3"))
            rows.append(("reduced volume", [f"{volume:.4f}" for volume in self.reducedVolumes], ""))
        if len(self.surfaces) == 1:
            return [(label, cells[0] + suffix) for label, cells, suffix in rows]
        shown = self.surfaces[:_COLUMNS]
        head = [
            ("surface", [str(k) for k in range(len(shown))]),
            ("vertices", [str(len(surface.vertices)) for surface in shown]),
            ("genus", [str(genus) for genus in self.genera[:_COLUMNS]]),
        ]
        table = head + [(label + suffix.replace(" ", ", "), cells[:_COLUMNS]) for label, cells, suffix in rows]
        more = len(self.surfaces) - len(shown)
        return [
            (
                label,
                "".join(f"{cell:>14}" for cell in cells) + (f"  and {more} more" * (more > 0 and label == "surface")),
            )
            for label, cells in table
        ]

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
    return MeshQuality(mesh)


def triangleAngles(mesh: Mesh) -> np.ndarray:
    """Return the angles of each triangle, in degrees: a (T, 3) array; those of one without area are 0 and 180."""
    return _shapes(mesh)[0]


def dihedralAngles(mesh: Mesh) -> np.ndarray:
    """Return the angle between the normals of the two triangles at each edge, in degrees: 0 where the surface is flat,
    positive where it is convex, 180 where facets lie on each other; 0 beside a triangle without area, as in the force.
    """
    first, second = connectivity.pairHalfedges(mesh.triangles, len(mesh.vertices))
    normals, angles = np.empty(mesh.triangles.shape), np.empty(len(first))
    for block in connectivity.blocks(len(normals)):
        normals[block] = connectivity.triangleNormals(mesh.vertices, mesh.triangles[block], mesh.images)
    for block in connectivity.blocks(len(angles)):
        f, g = (normals[side[block] // 3] for side in (first, second))
        edge = connectivity.edgeVectors(mesh.vertices, *connectivity.endsOf(mesh.triangles, first[block]), mesh.images)
        length = np.linalg.norm(edge, axis=1)
        sine = _dot(np.cross(f, g), edge) / np.where(length > 0, length, 1)
        angles[block] = np.degrees(np.arctan2(sine, _dot(f, g)))
    return angles


def closestPair(mesh: Mesh) -> tuple[int, int, float] | None:
    """Return the two closest vertices that are three or more edges apart, and their distance; None if all are farther
    than two mean edge lengths.
    """
    edges, n = mesh.edges, len(mesh.vertices)
    reach = connectivity.edgeLengthsOf(mesh.vertices, edges, mesh.images).mean()
    a, b = np.concatenate((edges, edges[:, ::-1])).T
    bonded = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(n, n)).tocsr()
    near = bonded + bonded @ bonded
    near.sort_indices()  # which makes a search of each look
    closest, points, owner = None, mesh.vertices, np.arange(n)
    if mesh.isPeriodic:
        patch = connectivity.patchOf(mesh.vertices, mesh.triangles, np.asarray(mesh.box), 2 * reach)
        points, owner = patch.vertices, patch.vertexOf
        near.setdiag(True)  # of a vertex's own images
    for a, b in _touching(np.ascontiguousarray(points.T), np.full(len(points), reach), BLOCK):
        isFar = ~np.asarray(near[owner[a], owner[b]]).ravel() if len(a) else np.zeros(0, dtype=bool)
        a, b = a[isFar], b[isFar]
        distances = np.linalg.norm(points[a] - points[b], axis=1)
        if len(a) and (closest is None or distances.min() < closest[2]):
            i, j, distance = owner[a[distances.argmin()]], owner[b[distances.argmin()]], distances.min()
            closest = int(i), int(j), float(distance)
    return closest


def crossings(mesh: Mesh, block: int = BLOCK) -> np.ndarray:
    """Return the vertices of an edge and the number of a triangle for each edge that passes through a triangle, as a
    (K, 3) array.

    Signs are exact: what touches without passing through, or lies in the same plane, is not found.  An edge may pass
    through a side of the triangle, but where it passes exactly through a corner it is not found.
    """
    if mesh.isPeriodic:
        return _crossingsInBox(mesh, block)
    middles, radii = np.empty((3, len(mesh.triangles))), np.empty(len(mesh.triangles))
    for some in connectivity.blocks(len(radii)):
        corners = mesh.vertices[mesh.triangles[some]]
        middle = corners.mean(axis=1)
        middles[:, some] = middle.T
        radii[some] = np.linalg.norm(corners - middle[:, np.newaxis], axis=2).max(axis=1)
    vertices, triangles = (np.ascontiguousarray(rows.T) for rows in (mesh.vertices, mesh.triangles))
    found = [
        _passing(mesh, *sides)
        for pairs in _touching(middles, radii, block)
        for sides in _near(vertices, triangles, pairs, middles, radii)
    ]
    rows = np.unique(np.concatenate(found), axis=0) if found else np.zeros((0, 3), dtype=int)
    return rows[np.argsort(np.floor(np.log2(radii[rows[:, 2]])), kind="stable")]


def _crossingsInBox(mesh: Mesh, block: int) -> np.ndarray:
    """Return the crossings of a periodic mesh: those of its triangles in the box with all that come near them."""
    margin = 2 * float(mesh.edgeLengths.max())
    patch = connectivity.patchOf(mesh.vertices, mesh.triangles, np.asarray(mesh.box), margin)
    found = crossings(Mesh(patch.vertices, patch.triangles), block)
    edges = np.sort(patch.vertexOf[found[:, :2]], axis=1)
    return np.unique(np.column_stack((edges, patch.triangleOf[found[:, 2]])), axis=0)


# What follows has a row for each coordinate and a column for each point: numpy is slow with many short rows.


def _touching(middles: np.ndarray, radii: np.ndarray, block: int) -> Iterator[np.ndarray]:
    """Yield the pairs of spheres that touch, in arrays of shape (2, K)."""
    # Spheres of similar size together, so that a few large ones do not widen the search for all.
    sizes = np.minimum(np.floor(np.log2(radii.max() / radii)), 20)
    classes = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    trees = [cKDTree(middles[:, mine].T) for mine in classes] if len(classes) > 1 else []
    for i, mine in enumerate(classes):
        for pairs in _touchingInSlabs(middles[:, mine], radii[mine], block):
            yield mine[pairs]
        for tree, others in zip(trees[i + 1 :], classes[i + 1 :]):
            reach = radii[mine].max() + radii[others].max()
            for start in range(0, len(mine), block):
                some = mine[start : start + block]
                found = cKDTree(middles[:, some].T).sparse_distance_matrix(tree, reach, output_type="ndarray")
                a, b = some[found["i"]], others[found["j"]]
                yield np.stack((a, b))[:, found["v"] <= SLACK * (radii[a] + radii[b])]


def _touchingInSlabs(middles: np.ndarray, radii: np.ndarray, block: int) -> Iterator[np.ndarray]:
    """Yield the pairs of spheres of similar size that touch, found in slabs across the longest axis, each with the
    spheres beyond it that its own can reach.
    """
    along, reach = middles[np.ptp(middles, axis=1).argmax()], 2 * radii.max()
    order = np.argsort(along, kind="stable") if len(radii) > block else np.arange(len(radii))
    for start in range(0, len(order), block):
        last = min(start + block, len(order)) - 1
        stop = np.searchsorted(along, along[order[last]] + reach, "right", order) if block < len(order) else len(order)
        mine = order[start:stop]
        x, r = middles[:, mine], radii[mine]
        pairs = np.ascontiguousarray(cKDTree(x.T).query_pairs(reach, output_type="ndarray").T)
        pairs = pairs[:, np.minimum(*pairs) <= last - start]
        a, b = pairs
        square = sum(np.square(row[a] - row[b]) for row in x)
        yield mine[pairs[:, square <= SLACK * (r[a] + r[b]) ** 2]]


def _near(
    vertices: np.ndarray, triangles: np.ndarray, pairs: np.ndarray, middles: np.ndarray, radii: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the edges of each triangle of a pair that have no vertex of the other, and come close to it, with that."""
    first, second = (triangles[:, mine] for mine in pairs)
    same = [[a == b for b in second] for a in first]
    for corners, isShared, others in (
        (first, [a | b | c for a, b, c in same], pairs[1]),
        (second, [a | b | c for a, b, c in zip(*same)], pairs[0]),
    ):
        for i, j in ((0, 1), (1, 2), (2, 0)):
            mine = np.flatnonzero(~(isShared[i] | isShared[j]))
            one, other, t = corners[i][mine], corners[j][mine], others[mine]
            square, length = np.zeros(len(mine)), np.zeros(len(mine))
            for row, middle in zip(vertices, middles):
                a, b = row[one], row[other]
                length += np.square(b - a)
                square += np.square((a + b) / 2 - middle[t])
            isNear = square <= SLACK * (np.sqrt(length) / 2 + radii[t]) ** 2
            one, other, t = one[isNear], other[isNear], t[isNear]
            yield np.column_stack((np.minimum(one, other), np.maximum(one, other))), t


# --- what is near, row by row


def _passing(mesh: Mesh, edges: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return those of the edges that pass through the triangle beside them, and that triangle."""
    for isLeft in (_boxesOverlap, _hasEndsOnBothSides, _goesThrough):
        left = isLeft(mesh, edges, triangles)
        edges, triangles = edges[left], triangles[left]
    return np.column_stack((edges, triangles))


def _points(mesh: Mesh, edges: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of edges and the corners of triangles, (2, n, 3) and (3, n, 3)."""
    return mesh.vertices[edges.T], mesh.vertices[mesh.triangles[triangles].T]


def _boxesOverlap(mesh: Mesh, edges: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    ends, corners = _points(mesh, edges, triangles)
    return np.all((ends.min(axis=0) <= corners.max(axis=0)) & (corners.min(axis=0) <= ends.max(axis=0)), axis=1)


def _hasEndsOnBothSides(mesh: Mesh, edges: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    ends, corners = _points(mesh, edges, triangles)
    return orientations(*corners, ends[0]) * orientations(*corners, ends[1]) < 0


def _goesThrough(mesh: Mesh, edges: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return where edges whose ends are on both sides of the plane of a triangle pass through it, or, through one of
    its sides, from one side of the surface to the other.
    """
    ends, corners = _points(mesh, edges, triangles)
    hands = np.array([orientations(*ends, corners[i], corners[(i + 1) % 3]) for i in range(3)])
    positive, negative = (hands > 0).sum(axis=0), (hands < 0).sum(axis=0)
    through = (positive == 3) | (negative == 3)
    atSide = np.flatnonzero((positive == 2) & (negative == 0) | (negative == 2) & (positive == 0))
    if len(atSide):
        sides = (hands[:, atSide] == 0).argmax(axis=0)
        through[atSide] = _crossesAtSide(mesh, edges[atSide], triangles[atSide], sides)
    return through


def _crossesAtSide(mesh: Mesh, edges: np.ndarray, triangles: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return where edges through the given side of a triangle have their ends on both sides of its two facets."""
    order, start = connectivity.groupHalfedges(mesh.triangles, len(mesh.vertices))
    first = start[np.diff(start, append=len(order)) == 2]  # a patch of a periodic mesh has borders
    opposite = np.arange(3 * len(mesh.triangles))
    opposite[order[first]], opposite[order[first + 1]] = order[first + 1], order[first]
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


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def _shapes(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles, in degrees, and the aspect ratio of each triangle."""
    angles, aspectRatios = np.empty(mesh.triangles.shape), np.empty(len(mesh.triangles))
    doubleAreas = 2 * mesh.triangleAreas
    for block in connectivity.blocks(len(angles)):
        x = connectivity.cornersOf(mesh.vertices, mesh.triangles[block], mesh.images)
        doubleArea = doubleAreas[block]
        sides = x[:, [2, 0, 1]] - x[:, [1, 2, 0]]  # opposite to each corner
        lengths = np.linalg.norm(sides, axis=2)
        cosine = -np.einsum("tci,tci->tc", sides[:, [1, 2, 0]], sides[:, [2, 0, 1]])
        angles[block] = np.degrees(np.arctan2(doubleArea[:, np.newaxis], cosine))
        with np.errstate(divide="ignore"):
            aspectRatios[block] = lengths.prod(axis=1) * lengths.sum(axis=1) / (4 * doubleArea**2)
    return angles, aspectRatios


def _components(genera: Sequence[int]) -> str:
    if len(genera) == 1:
        return f"one membrane of genus {genera[0]}"
    return f"{len(genera)} membranes of genus {', '.join(map(str, sorted(set(genera))))}"


def _range(values: np.ndarray) -> str:
    return f"{values.min():.4g} to {values.max():.4g}, mean {values.mean():.4g}"
