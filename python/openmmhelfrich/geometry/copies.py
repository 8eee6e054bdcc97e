"""Surfaces that lie on each other, as two copies of one object do that differ in their triangles.

All functions work on arrays: vertices (N, 3), triangles (T, 3), and the surface of each triangle (T,).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .connectivity import IndexArray

Points = NDArray[np.float64]

# Two surfaces are copies if each is so near the other over this part of its area, in mean edges of the finer one.
# Nested vesicles and leaflets are farther apart, and neighbors that touch do so over less.
_MOST, _NEAR = 2 / 3, 0.25
# Of each surface so many triangles are looked at, and around the middle of each the nearest of all, so many; where this
# part of them is beside another surface, distances are measured.
_SAMPLES, _AROUND, _PROMISING = 256, 8, 0.3
# The square of the sine of an angle below which a triangle is a needle.
_NARROW = 1e-12


class Copy(NamedTuple):
    """Two surfaces that lie on each other.

    Attributes
    ----------
    first, second : int
        their numbers
    distance : float
        within which each lies of the other, over most of its area
    part : float
        that over the mean edge length of the finer one
    """

    first: int
    second: int
    distance: float
    part: float


def copies(vertices: Points, triangles: NDArray[np.integer], surface: IndexArray) -> list[Copy]:
    """Return the pairs of surfaces that lie on each other."""
    if not len(triangles) or np.all(surface == surface[0]):
        return []
    corners = vertices[triangles]
    samples = _samples(surface)
    parts: dict[int, tuple[Points, Points]] = {}
    found = []
    for i, j in _besideEachOther(corners, surface, samples):
        for k in (i, j):
            if k not in parts:
                parts[k] = corners[surface == k], corners[samples[surface[samples] == k]]
        distance = max(_reach(parts[i][1], parts[j][0]), _reach(parts[j][1], parts[i][0]))
        edge = min(float(np.linalg.norm(x - x[:, [1, 2, 0]], axis=2).mean()) for x, _ in (parts[i], parts[j]))
        if edge > 0 and distance <= _NEAR * edge:
            found.append(Copy(i, j, distance, distance / edge))
    return found


def _samples(surface: IndexArray) -> IndexArray:
    """Return some triangles of each surface, at equal steps, surface by surface."""
    order = np.argsort(surface, kind="stable")
    counts = np.bincount(surface)
    rank = np.arange(len(order)) - (np.cumsum(counts) - counts)[surface[order]]
    return order[rank % np.maximum(1, counts // _SAMPLES)[surface[order]] == 0]


def _besideEachOther(corners: Points, surface: IndexArray, samples: IndexArray) -> list[tuple[int, int]]:
    """Return the pairs of surfaces of which one has many samples whose nearest triangles are also the other's.

    The one with the longer edges has, so that the many triangles of the finer one around each of its own do no harm.
    """
    middles = corners.mean(axis=1)
    _, near = cKDTree(middles).query(middles[samples], k=min(_AROUND, len(middles)))
    mine = surface[samples]
    size = int(surface.max()) + 1
    keys = np.sort(mine[:, np.newaxis] * size + surface[near], axis=1)
    isNew = np.diff(keys, axis=1, prepend=-1) > 0
    pairs, counts = np.unique(keys[isNew], return_counts=True)
    i, j = np.divmod(pairs, size)
    isPromising = (i != j) & (counts >= _PROMISING * np.bincount(mine, minlength=size)[i])
    return sorted({(min(pair), max(pair)) for pair in zip(i[isPromising].tolist(), j[isPromising].tolist())})


def _reach(samples: Points, corners: Points) -> float:
    """Return the distance to some triangles within which most of the area of others is, by their middles."""
    areas = np.linalg.norm(np.cross(samples[:, 1] - samples[:, 0], samples[:, 2] - samples[:, 0]), axis=1)
    distances = _distances(samples.mean(axis=1), corners)
    order = np.argsort(distances)
    within = np.cumsum(areas[order])
    return float(distances[order][np.searchsorted(within, _MOST * within[-1]).clip(max=len(order) - 1)])


def _distances(points: Points, corners: Points) -> Points:
    """Return the distance of each point to the triangles whose middles are nearest to it, or a little more where it is
    beside them.
    """
    _, near = cKDTree(corners.mean(axis=1)).query(points, k=range(1, 1 + min(_AROUND, len(corners))))
    x = corners[near]
    u, v, w = x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0], points[:, np.newaxis] - x[:, :, 0]
    uu, uv, vv, uw, vw = (np.sum(a * b, axis=2) for a, b in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    square = uu * vv - uv * uv
    square[square <= _NARROW * uu * vv] = np.inf  # of needles the first corner is near enough
    s, t = (vv * uw - uv * vw) / square, (uu * vw - uv * uw) / square
    weights = np.clip(np.stack((1 - s - t, s, t), axis=2), 0, None)
    weights /= weights.sum(axis=2, keepdims=True)
    closest = np.einsum("nkc,nkcx->nkx", weights, x)
    return np.linalg.norm(points[:, np.newaxis] - closest, axis=2).min(axis=1)
