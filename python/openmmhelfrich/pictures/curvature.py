"""What pictures show of a membrane: its surface, simplified if it is large, and the mean curvature that colors it."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..geometry.connectivity import patchOf
from ..geometry.measures import smoothCurvatures
from ..geometry.mesh import Mesh

MAX_VERTICES = 100_000  # that are drawn as they are: triangles of more are smaller than a picture's pixels
SIMPLIFIED = 30_000  # vertices of what is drawn instead


def shownSurface(mesh: Mesh) -> tuple[Mesh, NDArray[np.float64]]:
    """Return what to draw of a mesh, and the mean curvature at each of its vertices, in 1/nm.

    A mesh of more than 100,000 vertices is simplified to about 30,000, where its edges matter least to its shape (by
    quadric errors: Garland and Heckbert, SIGGRAPH 1997), with the curvature of the vertices that became one.
    A periodic mesh is drawn as it is.
    """
    if len(mesh.vertices) <= MAX_VERTICES or mesh.isPeriodic:
        return unwrappedSurface(mesh)
    import fast_simplification

    low, size = mesh.vertices.min(axis=0), np.ptp(mesh.vertices, axis=0).max()  # the library has single precision
    points, triangles, collapses = fast_simplification.simplify(
        (mesh.vertices - low) / size, mesh.triangles, target_count=2 * SIMPLIFIED, return_collapses=True
    )
    became = _survivors(len(mesh.vertices), collapses)
    if len(points) <= became.max():  # of very many small membranes some vanish
        *_, became = fast_simplification.replay_simplification(mesh.vertices, mesh.triangles, collapses)
    isShown = became >= 0
    curvature, area = (
        np.bincount(became[isShown], x[isShown], len(points)).astype(np.float64)
        for x in (mesh.vertexMeanCurvatures, mesh.vertexAreas)
    )
    surface = Mesh(low + size * points.astype(np.float64), triangles, speciesNames=mesh.speciesNames)
    if mesh.species is not None:
        surface.species = np.zeros(len(points), dtype=np.intc)
        surface.species[became[isShown]] = mesh.species[isShown]
    return surface, smoothCurvatures(surface.edges, curvature, area, 1)


def unwrappedSurface(mesh: Mesh) -> tuple[Mesh, NDArray[np.float64]]:
    """Return a mesh, of a periodic one the open surface that no triangle leaves at the borders of the box, and the mean
    curvature at each of its vertices, in 1/nm.
    """
    curvature = smoothMeanCurvature(mesh)
    if not mesh.isPeriodic:
        return mesh, curvature
    patch = patchOf(mesh.vertices, mesh.triangles, np.asarray(mesh.box))
    return mesh.unwrapped(), curvature[patch.vertexOf]


def _survivors(count: int, collapses: np.ndarray) -> NDArray[np.int64]:
    """Return which vertex of those left each of a number of vertices became, if pairs (kept, gone) collapsed."""
    graph = coo_array((np.ones(len(collapses), dtype=bool), collapses.T), shape=(count, count))
    numLeft, label = connected_components(graph, directed=False)
    isLeft = np.ones(count, dtype=bool)
    isLeft[collapses[:, 1]] = False
    number = np.empty(numLeft, dtype=np.int64)
    number[label[isLeft]] = np.arange(numLeft)
    return number[label]


def smoothMeanCurvature(mesh: Mesh) -> NDArray[np.float64]:
    """Return the mean curvature at each vertex, in 1/nm, averaged over its neighborhood: an (N,) array."""
    return smoothCurvatures(mesh.edges, mesh.vertexMeanCurvatures, mesh.vertexAreas)


def simplification(mesh: Mesh, surface: Mesh) -> str | None:
    """Return how what is drawn of a mesh was simplified, in words; None if it was not."""
    if surface is mesh or mesh.isPeriodic:
        return None
    return f"simplified to {len(surface.vertices)} of {len(mesh.vertices)} vertices"
