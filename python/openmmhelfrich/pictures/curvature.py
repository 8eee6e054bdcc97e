"""The mean curvature that pictures are colored by."""

import numpy as np
from numpy.typing import NDArray

from ..geometry.measures import localMeanCurvatures
from ..geometry.mesh import Mesh


def smoothMeanCurvature(mesh: Mesh, rounds: int = 2) -> NDArray[np.float64]:
    """Return the mean curvature at each vertex, in 1/nm, averaged over its neighborhood: an (N,) array.

    The curvature of single vertices of a fluctuating membrane is mostly noise, in which its shape would not be seen.
    """
    a, b = mesh.edges.T
    curvature, area = mesh.vertexMeanCurvatures, mesh.vertexAreas
    for _ in range(rounds):
        curvature, area = (x + np.bincount(a, x[b], len(x)) + np.bincount(b, x[a], len(x)) for x in (curvature, area))
    return localMeanCurvatures(curvature, area)
