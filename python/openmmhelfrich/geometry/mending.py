"""Faults of surfaces, mended one kind after the other; each that is found is a sentence.

All functions work on arrays: vertices (N, 3) and triangles (T, 3).  :meth:`Mesh.repaired` calls :func:`repair`.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from . import connectivity
from .copies import copies

Points = NDArray[np.float64]
Triangles = NDArray[np.int64]
Halfedges = NDArray[np.int64]

# A triangle has no area to speak of if twice that is less than this part of its longest side, squared.
_FLAT = 1e-3
# A flat triangle is a needle if its shortest side is less than this part of its longest.
_NEEDLE = 1e-2
# A triangle that is to be divided is flat if one of its angles has less than this cosine, 170 degrees, and its neighbor
# lies in about the same plane if the normals have more than this one, 30 degrees.
_OBTUSE, _LEVEL = -0.985, 0.866
_ROUNDS = 30
# How far the sheets of a surface that touched itself move apart, in parts of their edges.
_PARTING = 0.1
# An open surface is inside out if its volume is less than this multiple of its area to the power of 3/2.
_CLEARLY = -0.01
# How many things of a kind are named one by one.
_NAMED = 10


# An edge may be longer than a small box by more than whole numbers tell.
_unwarned = np.errstate(over="ignore", invalid="ignore")


@dataclass
class Wanted:
    """What :func:`repair` is asked for; see :meth:`Mesh.repaired`."""

    tolerance: float = 1e-3
    smallest: float = 0.01
    keep: list[int] | None = None
    closeHoles: bool = False
    reverse: bool = False


@dataclass
class _Surface:
    """A surface that is being mended, and what was done."""

    vertices: Points
    triangles: Triangles
    notes: list[str] = field(default_factory=list)

    def edges(self) -> tuple[Halfedges, Halfedges, Halfedges]:
        """Return the halfedges in the order of their edges, where each edge begins there, and how many it has."""
        order, start = connectivity.groupHalfedges(self.triangles, len(self.vertices))
        return order, start, np.diff(start, append=len(order))

    def opposites(self) -> Halfedges:
        """Return the other halfedge of the edge of each, or -1 where an edge has not two."""
        order, start, counts = self.edges()
        opposite = np.full(len(order), -1)
        two = start[counts == 2]
        opposite[order[two]], opposite[order[two + 1]] = order[two + 1], order[two]
        return opposite

    def facetsPerHalfedge(self) -> NDArray[np.int64]:
        """Return how many triangles the edge of each halfedge has, a row for each triangle."""
        order, _, counts = self.edges()
        result = np.empty(len(order), dtype=np.int64)
        result[order] = np.repeat(counts, counts)
        return result.reshape(-1, 3)

    def areas(self) -> tuple[Points, Points]:
        """Return twice the area of each triangle, and the lengths of its sides, from each corner to the next."""
        x = self.vertices[self.triangles]
        sides = np.linalg.norm(x[:, [1, 2, 0]] - x, axis=2)
        return np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1), sides


@_unwarned
def repair(
    vertices: Points, triangles: NDArray[np.integer], box: Points | None, wanted: Wanted
) -> tuple[Points, Triangles, list[str]]:
    """Mend a surface; return its vertices and triangles, and a sentence for each thing that was done or is left."""
    if not len(triangles):
        raise ValueError("the mesh has no triangles")
    surface = _Surface(vertices.copy(), triangles.astype(np.int64))
    if box is not None:
        _unfold(surface, box)
    elif (sentence := foldedEdges(vertices, triangles)) is not None:
        raise ValueError(f"{sentence}; the lengths of the box must be given (--box) to unfold it")
    _weld(surface, wanted.tolerance)
    repeated = _dropTwice(surface)
    _dropRepeated(surface)
    _agree(surface)
    isTurned = _turnAll(surface)
    _dropFlat(surface, repeated)
    _part(surface, wanted.keep is not None)
    _keepSurfaces(surface, wanted)
    if not wanted.reverse:
        _turnOutwards(surface, isTurned)
    elif not isTurned:
        surface.triangles = surface.triangles[:, ::-1]
    if wanted.reverse:
        surface.notes.append("all facets were turned round, as asked for")
    _holes(surface, wanted.closeHoles)
    return surface.vertices, surface.triangles, surface.notes


def counted(count: int, one: str, many: str | None = None) -> str:
    """Return a number and what it counts, with its verb: "1 facet was", "2 facets were"."""
    return f"1 {one} was" if count == 1 else f"{count} {many or one + 's'} were"


def place(point: Points) -> str:
    """Return a point as text."""
    return f"({', '.join(f'{x:.4g}' for x in point)})"


# --- periodic boxes


@_unwarned
def foldedEdges(vertices: Points, triangles: NDArray[np.integer], box: Points | None = None) -> str | None:
    """Return a sentence on edges that lead through the sides of a box, as those of a surface do that was folded into
    it, or None if there are none.

    Where the box is not known, they are nearly as long as the mesh.  Such edges are few, much longer than the others,
    and lead from some vertices among the lowest to some among the highest along an axis, unlike those of spikes and of
    long bodies with round ends; those of bodies with flat ends are all as long.
    """
    if box is not None:
        steps = connectivity.edgeVectors(vertices, *connectivity.halfedges(triangles))
        count = int(np.sum(np.any(_images(steps, box) != 0, axis=1)) // 2)
        return (
            f"{count} edges are longer than half of the periodic box, into which the surface is folded"
            if count
            else None
        )
    if len(triangles) < 20:
        return None
    origin, target = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    lengths = connectivity.edgeLengthsOf(vertices, np.stack((origin, target), axis=1))
    extents, usual = np.ptp(vertices, axis=0), np.median(lengths)
    for axis, name in enumerate("xyz"):
        x = vertices[:, axis]
        steps = x[target] - x[origin]
        isLong = steps > max(0.7 * extents[axis], 2 * usual)
        long, low, high = steps[isLong], np.unique(origin[isLong]), np.unique(target[isLong])
        if not (len(long) < 0.12 * len(steps) and min(len(low), len(high)) > 2):
            continue
        isOutermost = x[low].max() < x.min() + 2 * usual and x[high].min() > x.max() - 2 * usual
        if isOutermost and long.std() > 0.05 * usual:
            return (
                f"{len(long)} edges are nearly as long as the mesh along {name}, up to {long.max():.4g} of "
                f"{extents[axis]:.4g}, so that the surface seems to be folded into a periodic box"
            )
    return None


@_unwarned
def isPeriodic(vertices: Points, triangles: NDArray[np.integer], box: Points) -> bool:
    """Return whether a surface goes through the whole of a periodic box, as a sheet does, and cannot be unfolded."""
    origin, target = connectivity.halfedges(triangles)
    shifts, images = _unfoldingShifts(vertices, origin, target, box)
    return bool(np.any(shifts[target] - shifts[origin] != images))


def _unfoldingShifts(
    vertices: Points, origin: NDArray[np.int64], target: NDArray[np.int64], box: Points
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return by how many boxes to move each vertex to put it beside its neighbors, and by how many each halfedge asks
    its ends to be moved apart.
    """
    images = -_images(vertices[target] - vertices[origin], box)
    crossing = np.any(images != 0, axis=1)
    if not crossing.any():
        return np.zeros((len(vertices), 3), dtype=np.int64), images
    count, patch = _components(origin[~crossing], target[~crossing], len(vertices))
    return _shifts(count, patch[origin[crossing]], patch[target[crossing]], images[crossing])[patch], images


def _unfold(surface: _Surface, box: Points) -> None:
    """Put the vertices of each surface beside their neighbors where edges lead through the sides of a box."""
    origin, target = connectivity.halfedges(surface.triangles)
    shifts, images = _unfoldingShifts(surface.vertices, origin, target, box)
    crossing = np.any(images != 0, axis=1)
    if not crossing.any():
        return
    if np.any(shifts[target] - shifts[origin] != images):
        raise ValueError("the surface goes through the whole periodic box, so that it cannot be unfolded")
    surface.vertices = surface.vertices + shifts @ box
    moved = int(np.any(shifts != 0, axis=1).sum())
    surface.notes.append(
        f"{counted(int(crossing.sum()) // 2, 'edge')} as long as the periodic box: the surface was unfolded, by moving "
        f"{moved} vertices by the box"
    )


def _images(steps: Points, box: Points) -> NDArray[np.int64]:
    """Return how many boxes each step leads through, in each direction."""
    return np.rint(steps @ np.linalg.inv(box)).astype(np.int64)


def _shifts(
    count: int, first: NDArray[np.int64], second: NDArray[np.int64], images: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return by how many boxes to move each of some patches, where those of the second are the images' more than those
    of the first.
    """
    beyond: list[dict[int, NDArray]] = [{} for _ in range(count)]
    for a, b, image in zip(first.tolist(), second.tolist(), images):
        beyond[a].setdefault(b, image)
        beyond[b].setdefault(a, -image)
    shifts, known = np.zeros((count, 3), dtype=np.int64), np.zeros(count, dtype=bool)
    for start in np.argsort(-np.bincount(np.concatenate((first, second)), minlength=count)).tolist():
        waiting = [] if known[start] else [start]
        known[start] = True
        while waiting:
            a = waiting.pop()
            for b, step in beyond[a].items():
                if not known[b]:
                    known[b], shifts[b] = True, shifts[a] + step
                    waiting.append(b)
    return shifts


# --- corners and facets


def weldRims(vertices: Points, triangles: Triangles, distance: float) -> tuple[Triangles, int]:
    """Return the triangles with vertices of open edges that are closer than a distance made one, and how many vertices
    that took away.
    """
    order, start = connectivity.groupHalfedges(triangles, len(vertices))
    single = order[start[np.diff(start, append=len(order)) == 1]]
    rim = np.unique(np.concatenate([end[single] for end in connectivity.halfedges(triangles)]))
    pairs = cKDTree(vertices[rim]).query_pairs(distance, output_type="ndarray") if len(rim) else np.zeros((0, 2), int)
    if not len(pairs):
        return triangles, 0
    count, label = _components(pairs[:, 0], pairs[:, 1], len(rim))
    _, first = np.unique(label, return_index=True)
    places = np.arange(len(vertices))
    places[rim] = rim[first[label]]
    return places[triangles], len(rim) - count


def _weld(surface: _Surface, tolerance: float) -> None:
    _, sides = surface.areas()
    distance = tolerance * float(np.median(sides))
    surface.triangles, count = weldRims(surface.vertices, surface.triangles, distance)
    if count:
        surface.notes.append(f"{counted(count, 'corner')} welded to another that is closer than {distance:.3g}")
    _weldSurfaces(surface, tolerance)


def _weldSurfaces(surface: _Surface, tolerance: float) -> None:
    """Weld vertices of surfaces that are in one place, but for those of which welding makes no surfaces."""
    _, label = connectivity.labelComponents(surface.triangles, len(surface.vertices))
    pairs, distance = connectivity.coincident(surface.vertices, surface.triangles, label, tolerance)
    if not len(pairs):
        return
    _, group = _components(label[pairs[:, 0]], label[pairs[:, 1]], int(label.max()) + 1)
    isLeft = _spoiled(surface, pairs, label, group[label])[group[label[pairs[:, 0]]]]
    if isLeft.any():
        surface.notes.append(
            f"{counted(len(np.unique(pairs[isLeft, 1])), 'vertex', 'vertices')} left where another surface's is, since "
            "the surfaces share a part, and welding does not mend that"
        )
    triangles, count = _welded(surface, pairs[~isLeft])
    if count:
        surface.triangles = triangles
        surface.notes.append(
            f"{counted(count, 'vertex', 'vertices')} welded to another surface's that is closer than {distance:.3g}"
        )


def _welded(surface: _Surface, pairs: NDArray[np.int64]) -> tuple[Triangles, int]:
    """Return the triangles with the vertices of pairs made one, and how many vertices that takes away."""
    _, label = _components(pairs[:, 0], pairs[:, 1], len(surface.vertices))
    _, first, mine = np.unique(label, return_index=True, return_inverse=True)
    return first[mine][surface.triangles], len(mine) - len(first)


def _spoiled(
    surface: _Surface, pairs: NDArray[np.int64], label: NDArray[np.int64], group: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return which groups of surfaces that are joined by pairs of vertices welding does not mend, tried on a copy:
    those that have more edges of an odd number of facets then, as surfaces have that differ beyond a common part, or
    that lie on each other without a common facet.  Surfaces and groups are those of each vertex.
    """
    trial, size = _Surface(surface.vertices, _welded(surface, pairs)[0]), int(group.max()) + 1
    _dropTwice(trial)
    _dropRepeated(trial)
    odd, facets = (
        [np.bincount(group[some], minlength=size) for some in ends]
        for ends in zip(*((_oddEnds(each), each.triangles[:, 0]) for each in (surface, trial)))
    )
    isSpoiled = odd[1] > odd[0]
    for copy in copies(surface.vertices, surface.triangles, label[surface.triangles[:, 0]]):
        mine = group[np.flatnonzero(label == copy.first)[0]]
        isSpoiled[mine] |= mine == group[np.flatnonzero(label == copy.second)[0]] and facets[1][mine] == facets[0][mine]
    return isSpoiled


def _oddEnds(surface: _Surface) -> NDArray[np.int64]:
    """Return where each halfedge begins whose edge has an odd number of facets."""
    return surface.triangles[surface.facetsPerHalfedge() % 2 == 1]


def _dropTwice(surface: _Surface) -> int:
    """Take away triangles that have a vertex twice, and return how many they were."""
    a, b, c = surface.triangles.T
    isWhole = (a != b) & (b != c) & (c != a)
    surface.triangles = surface.triangles[isWhole]
    return int(np.sum(~isWhole))


def _dropRepeated(surface: _Surface) -> None:
    """Take away all but one of the triangles with the same vertices, and then what sticks to a surface by an edge,
    unless that opens it, as it does surfaces that share a part.
    """
    before = len(surface.triangles)
    _, first, counts = np.unique(np.sort(surface.triangles, axis=1), axis=0, return_index=True, return_counts=True)
    order = np.argsort(first)
    surface.triangles = unique = surface.triangles[first[order]]
    _dropFins(surface, counts[order] > 1)
    if len(surface.triangles) < len(unique):
        numOpen = [np.sum(each.facetsPerHalfedge() == 1) for each in (surface, _Surface(surface.vertices, unique))]
        surface.triangles = unique if numOpen[0] > numOpen[1] else surface.triangles
    if before > len(surface.triangles):
        surface.notes.append(
            f"{counted(before - len(surface.triangles), 'facet')} taken away that lay on another or stuck out"
        )


def _dropFins(surface: _Surface, isRepeated: NDArray[np.bool_]) -> None:
    """Take away triangles that stick to a surface by an edge: those that were repeated first, then open ones."""
    if isRepeated.any():
        surface.triangles = surface.triangles[~(isRepeated & np.any(surface.facetsPerHalfedge() > 2, axis=1))]
    for _ in range(_ROUNDS):
        perEdge = surface.facetsPerHalfedge()
        isFin = np.any(perEdge == 1, axis=1) & np.any(perEdge > 2, axis=1)
        if not isFin.any():
            break
        surface.triangles = surface.triangles[~isFin]


def _dropFlat(surface: _Surface, found: int) -> None:
    """Take away triangles without area: needles, by making the ends of their shortest side one vertex, and others by
    flipping their longest side, which puts their middle vertex on the neighbor's side.
    """
    for _ in range(_ROUNDS):
        doubleArea, sides = surface.areas()
        flat = np.flatnonzero(doubleArea <= _FLAT * sides.max(axis=1) ** 2)
        if not len(flat):
            break
        needles = flat[sides[flat].min(axis=1) <= _NEEDLE * sides[flat].max(axis=1)]
        changed = _collapse(surface, needles, sides) or _flip(surface, 3 * flat + sides[flat].argmax(axis=1))
        found += changed
        if changed == 0:
            where = place(surface.vertices[surface.triangles[flat[0]]].mean(axis=0))
            surface.notes.append(f"{counted(len(flat), 'facet')} left without area, one of them at {where}")
            break
    if found:
        surface.notes.append(f"{counted(found, 'facet without area', 'facets without area')} taken away")


def _collapse(surface: _Surface, needles: NDArray[np.int64], sides: Points) -> int:
    """Make the ends of the shortest side of needles one vertex, where that leaves the surface a surface; return for how
    many that was done.
    """
    origin, target = connectivity.halfedges(surface.triangles)
    n = len(surface.vertices)
    bonds = coo_array((np.ones(2 * len(origin)), (np.r_[origin, target], np.r_[target, origin])), shape=(n, n)).tocsr()
    replaced, isTouched, changed = np.arange(n), np.zeros(n, dtype=bool), 0
    for h in (3 * needles + sides[needles].argmin(axis=1)).tolist():
        i, j = int(origin[h]), int(target[h])
        around = [bonds.indices[bonds.indptr[v] : bonds.indptr[v + 1]] for v in (i, j)]
        if isTouched[around[0]].any() or isTouched[around[1]].any() or len(np.intersect1d(*around)) != 2:
            continue
        isTouched[around[0]] = isTouched[around[1]] = True
        replaced[j] = i
        changed += 1
    surface.triangles = replaced[surface.triangles]
    _dropTwice(surface)
    return changed


def flipFlat(vertices: Points, triangles: NDArray[np.integer], box: Points | None = None) -> tuple[Triangles, int]:
    """Return triangles of which the nearly flat ones have their longest side flipped, and how many were flipped.

    Only those are that lie in about the same plane as their neighbor, before and after, and only if the new side is no
    shorter than all others, so that the surface hardly changes.
    """
    surface, total = _Surface(vertices, triangles.astype(np.int64)), 0
    for _ in range(_ROUNDS):
        edges = _flippable(surface, box)
        changed = _flip(surface, edges) if len(edges) else 0
        if changed == 0:
            break
        total += changed
    return surface.triangles, total


def _flippable(surface: _Surface, box: Points | None) -> Halfedges:
    """Return the halfedges that :func:`flipFlat` may flip."""
    vertices = surface.vertices
    h = _acrossObtuse(vertices, surface.triangles, box)
    if not len(h):  # as a rule, and then all else is not needed
        return h
    o = surface.opposites()[h]
    h, o = h[o >= 0], o[o >= 0]
    origin, target = connectivity.halfedges(surface.triangles)
    a, b, m, c = origin[h], target[h], target[_next(h)], target[_next(o)]
    toB, toM, toC = (connectivity.edgeVectors(vertices, a, end, box) for end in (b, m, c))
    old, new = (np.cross(toB, toM), np.cross(toC, toB)), (np.cross(toC, toM), np.cross(toM - toB, toC - toB))
    isLevel = _areLevel(*old) & _areLevel(old[0] + old[1], new[0]) & _areLevel(old[0] + old[1], new[1])
    lengths = [np.linalg.norm(side, axis=1) for side in (toM - toC, toM, toM - toB, toC, toC - toB)]
    return h[isLevel & (lengths[0] >= np.min(lengths[1:], axis=0))]


def _areLevel(first: Points, second: Points) -> NDArray[np.bool_]:
    """Return whether triangles with some normals lie in about the same plane as those with others."""
    cosines = np.sum(first * second, axis=1)
    return cosines > _LEVEL * np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)


def _acrossObtuse(vertices: Points, triangles: Triangles, box: Points | None) -> Halfedges:
    """Return the halfedges that are opposite to an angle of nearly 180 degrees."""
    found = [np.zeros(0, dtype=np.int64)]
    for block in connectivity.blocks(len(triangles)):
        corners = triangles[block].T
        sides = [connectivity.edgeVectors(vertices, corners[k], corners[k - 2], box) for k in range(3)]
        lengths = np.linalg.norm(sides, axis=2)
        for k in range(3):  # opposite to the side from corner k is the angle between the other two sides
            cosine = -np.sum(sides[k - 2] * sides[k - 1], axis=1)
            isObtuse = cosine < _OBTUSE * lengths[k - 2] * lengths[k - 1]
            found.append(3 * (block.start + np.flatnonzero(isObtuse)) + k)
    return np.concatenate(found)


def _flip(surface: _Surface, edges: Halfedges) -> int:
    """Flip edges that are given by a halfedge each, where that leaves the surface a surface; return how many there
    were.
    """
    opposite = surface.opposites()
    origin, target = connectivity.halfedges(surface.triangles)
    n = len(surface.vertices)
    keys = np.unique(np.minimum(origin, target) * n + np.maximum(origin, target))
    isTouched, changed = np.zeros(n, dtype=bool), 0
    for h in edges.tolist():
        o = int(opposite[h])
        if o < 0 or origin[h] != target[o]:
            continue
        a, b, m, c = origin[h], target[h], target[_next(h)], target[_next(o)]
        spot = np.searchsorted(keys, min(m, c) * n + max(m, c))
        isBond = spot < len(keys) and keys[spot] == min(m, c) * n + max(m, c)
        if m == c or isBond or isTouched[[a, b, m, c]].any():
            continue
        isTouched[[a, b, m, c]] = True
        surface.triangles[h // 3], surface.triangles[o // 3] = (m, a, c), (c, b, m)
        changed += 1
    return changed


def _next(h: Any) -> Any:
    """Return the next halfedge of a triangle."""
    return h - h % 3 + (h + 1) % 3


# --- surfaces


def _components(a: NDArray[np.int64], b: NDArray[np.int64], size: int) -> tuple[int, NDArray[np.int64]]:
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(size, size))
    return connected_components(graph, directed=False)


def _patches(surface: _Surface) -> tuple[Halfedges, Halfedges, int, NDArray[np.int64]]:
    """Return the halfedges of edges with two triangles, as two arrays, and the number and the patch of each triangle
    that such edges join.
    """
    order, start, counts = surface.edges()
    first, second = order[start[counts == 2]], order[start[counts == 2] + 1]
    count, patch = _components(first // 3, second // 3, len(surface.triangles))
    return first, second, count, patch


def _agree(surface: _Surface) -> None:
    """Turn triangles that run against their neighbors.

    Every triangle is two nodes of a graph, one for each way round, and neighbors are joined in the ways that agree: a
    surface with two sides is two components.
    """
    first, second, numPatches, patch = _patches(surface)
    origin, _ = connectivity.halfedges(surface.triangles)
    f, g, differ = first // 3, second // 3, (origin[first] == origin[second]).astype(np.int64)
    size = len(surface.triangles)
    way = np.concatenate((f, f + size)), np.concatenate((g + size * differ, g + size * (1 - differ)))
    _, label = _components(*way, 2 * size)
    if np.any(label[:size] == label[size:]):
        surface.notes.append("a surface has one side only, like a Moebius strip; it cannot be oriented")
        return
    # The component of the first triangle of a patch is the one whose way round the patch keeps, unless most would turn.
    _, example = np.unique(patch, return_index=True)
    isTurned = label[:size] != label[:size][example][patch]
    most = np.bincount(patch, isTurned, numPatches) > np.bincount(patch, minlength=numPatches) / 2
    isTurned ^= most[patch]
    surface.triangles = np.where(isTurned[:, np.newaxis], surface.triangles[:, ::-1], surface.triangles)
    if isTurned.any():
        surface.notes.append(f"{counted(int(isTurned.sum()), 'facet')} turned round, to agree with the neighbors")


def _volumes(surface: _Surface, patch: NDArray[np.int64], numPatches: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the volumes and areas of patches of triangles."""
    x = surface.vertices[surface.triangles]
    weights = np.maximum(np.bincount(patch, minlength=numPatches), 1)
    centers = np.column_stack([np.bincount(patch, x[:, 0, k], numPatches) / weights for k in range(3)])
    x = x - centers[patch][:, np.newaxis]
    volumes = np.einsum("ti,ti->t", x[:, 0], np.cross(x[:, 1], x[:, 2])) / 6
    return np.bincount(patch, volumes, numPatches), np.bincount(patch, surface.areas()[0] / 2, numPatches)


def _turnAll(surface: _Surface) -> bool:
    """Turn everything round if it is clearly inside out, and return whether it was."""
    (volume,), (area,) = _volumes(surface, np.zeros(len(surface.triangles), dtype=np.int64), 1)
    isInside = bool(volume < _CLEARLY * area**1.5)
    if isInside:
        surface.triangles = surface.triangles[:, ::-1]
    return isInside


def _turnOutwards(surface: _Surface, isTurned: bool) -> None:
    """Turn surfaces whose volume is negative, or clearly so if they are open, and note how many are now the other way
    round than they were at first, if all of them were turned before.
    """
    _, _, numPatches, patch = _patches(surface)
    volumes, areas = _volumes(surface, patch, numPatches)
    isOpen = np.bincount(patch, np.any(surface.facetsPerHalfedge() == 1, axis=1), numPatches) > 0
    isInside = np.where(isOpen, volumes < _CLEARLY * areas**1.5, volumes < 0)
    surface.triangles = np.where(isInside[patch][:, np.newaxis], surface.triangles[:, ::-1], surface.triangles)
    count = int(np.sum(isInside != isTurned))
    if count:
        surface.notes.append(f"{counted(count, 'surface')} inside out and turned")


def _part(surface: _Surface, keepsCopies: bool) -> None:
    """Give each sheet of a surface that touches itself, at a vertex or along an edge, vertices of its own; unless they
    lie on each other all over, as copies of one object do, and are not to be kept all the same.
    """
    before = _Surface(surface.vertices, surface.triangles.copy())
    parted = _partVertices(surface)
    for _ in range(_ROUNDS):
        divided = _divideEdges(surface)
        if divided == 0:
            break
        parted += divided
    if parted and not keepsCopies and _madeCopies(surface, before):
        surface.vertices, surface.triangles = before.vertices, before.triangles
        surface.notes.append("the surface touches itself all over, as two copies of one object do, and was not parted")
    elif parted:
        surface.notes.append(
            f"{counted(parted, 'vertex', 'vertices')} added where the surface touched itself, whose sheets were moved "
            f"apart by {_PARTING:g} of an edge"
        )
    order, start, counts = surface.edges()
    left = order[start[counts > 2]]
    if len(left):
        where = place(surface.vertices[surface.triangles.ravel()[left[0]]])
        surface.notes.append(f"{counted(len(left), 'edge')} left with more than two facets, one of them at {where}")


def _madeCopies(surface: _Surface, before: _Surface) -> bool:
    """Return whether a surface has become several of which two lie on each other."""
    new, old = (surfaces(each.triangles, len(each.vertices))[1] for each in (surface, before))
    among = new[: len(old)]
    return any(
        old[among == copy.first][0] == old[among == copy.second][0]
        for copy in copies(surface.vertices, surface.triangles, new)
    )


def _partVertices(surface: _Surface) -> int:
    """Give each fan of triangles around a vertex a vertex of its own, and return how many that added."""
    (first, second), together = _sheets(surface)
    corner = np.arange(surface.triangles.size)
    following = _next(corner)
    links = [(first, following[second]), (following[first], second), together]
    ends, others = (np.concatenate(halves) for halves in zip(*links))
    _, fan = _components(ends, others, len(corner))
    vertex = surface.triangles.ravel()
    _, example, member = np.unique(fan, return_index=True, return_inverse=True)
    owner = vertex[example]  # of each fan
    order = np.argsort(example, kind="stable")
    isFirst = np.zeros(len(example), dtype=bool)
    isFirst[order[np.unique(owner[order], return_index=True)[1]]] = True
    if isFirst.all():
        return 0
    numbers = owner.copy()
    numbers[~isFirst] = len(surface.vertices) + np.arange(np.sum(~isFirst))
    vertices = np.concatenate((surface.vertices, surface.vertices[owner[~isFirst]]))
    isParted = np.isin(owner, owner[~isFirst])
    ends = surface.vertices[vertex[following]] + surface.vertices[vertex[following[following]]]
    sums = np.column_stack([np.bincount(member, ends[:, k]) for k in range(3)])
    means = sums / (2 * np.bincount(member)[:, np.newaxis])
    vertices[numbers[isParted]] += _PARTING * (means[isParted] - vertices[numbers[isParted]])
    surface.vertices, surface.triangles = vertices, numbers[member].reshape(-1, 3)
    return int(np.sum(~isFirst))


def _divideEdges(surface: _Surface) -> int:
    """Divide edges at which sheets touch that share their ends, with a vertex in the middle for each sheet; return how
    many vertices that added.
    """
    first, second = _crowded(surface)[0]
    vertices: list[Points] = []
    triangles, isTouched = [surface.triangles], np.zeros(len(surface.triangles), dtype=bool)
    for h, o in zip(first.tolist(), second.tolist()):
        if isTouched[[h // 3, o // 3]].any():
            continue
        isTouched[[h // 3, o // 3]] = True
        (i, j, a), b = np.roll(surface.triangles[h // 3], -(h % 3)), surface.triangles.ravel()[_next(_next(o))]
        x, m = surface.vertices, len(surface.vertices) + len(vertices)
        middle = (x[i] + x[j]) / 2
        vertices.append(middle + _PARTING * ((x[a] + x[b]) / 2 - middle))
        surface.triangles[h // 3], surface.triangles[o // 3] = (m, j, a), (m, i, b)
        triangles.append(np.array([(i, m, a), (j, m, b)]))
    surface.vertices = np.concatenate((surface.vertices, np.reshape(vertices, (-1, 3))))
    surface.triangles = np.concatenate(triangles)
    return len(vertices)


def _sheets(surface: _Surface) -> tuple[Halfedges, Halfedges]:
    """Return pairs of halfedges that run in opposite directions along an edge of one sheet, and pairs of corners that
    belong together all the same, as two rows each: where triangles run against each other, or sheets cannot be told.
    """
    first, second, _, _ = _patches(surface)
    origin, target = connectivity.halfedges(surface.triangles)
    agree = origin[first] != origin[second]
    told, untold = _crowded(surface)
    f, g = np.concatenate((np.stack((first[~agree], second[~agree])), untold), axis=1)
    sameWay = origin[f] == origin[g]
    corners = np.where(sameWay, g, _next(g)), np.where(sameWay, _next(g), g)
    together = np.stack((np.concatenate((f, _next(f))), np.concatenate(corners)))
    return np.concatenate((np.stack((first[agree], second[agree])), told), axis=1), together


def _crowded(surface: _Surface) -> tuple[Halfedges, Halfedges]:
    """Return pairs of the halfedges of edges with more than two triangles, as two rows: those of one sheet each, and,
    where that is not certain, each with the next.
    """
    order, start, counts = surface.edges()
    origin, _ = connectivity.halfedges(surface.triangles)
    told, untold = [np.zeros((2, 0), dtype=np.int64)], [np.zeros((2, 0), dtype=np.int64)]
    for e in np.flatnonzero(counts > 2).tolist():
        some = order[start[e] : start[e] + counts[e]]
        paired = _pairAround(surface, some, origin)
        told.append(paired)
        if not paired.size:
            untold.append(np.stack((some[:-1], some[1:])))
    return np.concatenate(told, axis=1), np.concatenate(untold, axis=1)


def _pairAround(surface: _Surface, some: Halfedges, origin: NDArray[np.int64]) -> Halfedges:
    """Return pairs of the halfedges of one edge, each of which bounds a wedge of the inside, as two rows; none if they
    are not as many in one direction as in the other.
    """
    none = np.zeros((2, 0), dtype=np.int64)
    i = origin[some].min()
    forward = origin[some] == i
    if 2 * forward.sum() != len(some):
        return none
    j = surface.triangles.ravel()[_next(some[forward][0])]
    axis = surface.vertices[j] - surface.vertices[i]
    apexes = surface.vertices[surface.triangles.ravel()[_next(_next(some))]] - surface.vertices[i]
    u = np.cross(axis, apexes[0])
    v = np.cross(axis, u)
    angles = np.arctan2(apexes @ u * np.linalg.norm(axis), -apexes @ v)
    around = some[np.argsort(angles, kind="stable")]
    isForward = origin[around] == i
    # With the outside in front of each facet, the inside is between one that runs backward and the next that runs
    # forward.
    begin = np.flatnonzero(~isForward & np.roll(isForward, -1))
    return none if 2 * len(begin) != len(around) else np.stack((np.roll(around, -1)[begin], around[begin]))


def _keepSurfaces(surface: _Surface, wanted: Wanted) -> None:
    """Leave out surfaces that are not to be kept, and specks."""
    count, label = surfaces(surface.triangles, len(surface.vertices))
    areas = np.bincount(label, surface.areas()[0] / 2, count)
    if wanted.keep is not None:
        wrong = [k for k in wanted.keep if not 0 <= k < count]
        if wrong or not wanted.keep:
            numbers = "surface 0" if count == 1 else f"surfaces from 0 to {count - 1}"
            raise ValueError(f"surface {wrong[0] if wrong else 'none'} is to be kept; there are {numbers}")
        isKept, word = np.isin(np.arange(count), wanted.keep), "surface"
    else:
        isKept, word = areas >= wanted.smallest * areas.max(initial=0.0), "speck"
    gone = np.flatnonzero(~isKept)
    for k in gone[:_NAMED]:
        mine = surface.triangles[label == k]
        surface.notes.append(
            f"a {word} of {len(mine)} facets and area {areas[k]:.3g} was left out, at "
            f"{place(surface.vertices[np.unique(mine)].mean(axis=0))}"
        )
    if len(gone) > _NAMED:
        surface.notes.append(
            f"{counted(len(gone) - _NAMED, f'more {word}')} left out, of area {areas[gone].max():.3g} at most"
        )
    surface.triangles = surface.triangles[isKept[label]]


def surfaces(triangles: NDArray[np.integer], numVertices: int) -> tuple[int, NDArray[np.int64]]:
    """Return the number of connected surfaces and that of each triangle, in the order of their first triangles."""
    count, label = connectivity.labelComponents(triangles, numVertices)
    if count == 1:
        return min(1, len(triangles)), np.zeros(len(triangles), dtype=np.int64)
    mine = connectivity.byFirstAppearance(label[triangles[:, 0]])
    return int(mine.max(initial=-1)) + 1, mine


# --- holes


def _holes(surface: _Surface, close: bool) -> None:
    """Note the holes, with their length and place, or close them."""
    loops = _loops(surface)
    x = surface.vertices
    lengths = [float(np.linalg.norm(x[loop] - x[np.roll(loop, -1)], axis=1).sum()) for loop in loops]
    byLength = sorted(zip(lengths, loops), key=lambda item: -item[0])
    fate = "was closed" if close else "is left open"
    for length, loop in byLength[:_NAMED]:
        surface.notes.append(
            f"a hole of {len(loop)} edges, {length:.4g} long in all, around {place(x[loop].mean(axis=0))}, {fate}"
        )
    if len(loops) > _NAMED:
        surface.notes.append(f"{counted(len(loops) - _NAMED, 'smaller hole')} {'closed' if close else 'left open'}")
    if close and loops:
        _close(surface, loops)


def _loops(surface: _Surface) -> list[NDArray[np.int64]]:
    """Return the vertices around each hole, in the direction in which the triangles run along it."""
    order, start, counts = surface.edges()
    origin, target = connectivity.halfedges(surface.triangles)
    single = order[start[counts == 1]]
    after = dict(zip(origin[single].tolist(), target[single].tolist()))
    loops = []
    while after:
        first, v = after.popitem()
        loop = [first]
        while v != first and v in after:
            loop.append(v)
            v = after.pop(v)
        if v == first and len(loop) > 2:  # others come of edges with more than two facets
            loops.append(np.array(loop))
    return loops


def _close(surface: _Surface, loops: list[NDArray[np.int64]]) -> None:
    """Close holes: those of three edges with a triangle, others with triangles around a vertex in their middle."""
    middles: list[Points] = []
    triangles: list[Triangles] = []
    for loop in loops:
        if len(loop) == 3:
            triangles.append(loop[[1, 0, 2]][np.newaxis])
            continue
        middle = np.full(len(loop), len(surface.vertices) + len(middles))
        middles.append(surface.vertices[loop].mean(axis=0))
        triangles.append(np.column_stack((np.roll(loop, -1), loop, middle)))
    surface.vertices = np.concatenate((surface.vertices, np.reshape(middles, (-1, 3))))
    surface.triangles = np.concatenate((surface.triangles, *triangles))
