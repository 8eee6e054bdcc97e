"""Measures that compare closed surfaces of different sizes."""

import math

import numpy as np
from numpy.typing import NDArray


def reducedVolume(area: float, volume: float) -> float:
    """Return the reduced volume v = 6 sqrt(pi) V / A^(3/2): 1 for a sphere, less for every other shape.

    ::

        mh.reducedVolume(4 * np.pi, 4 * np.pi / 3)  # 1.0, a sphere

    Parameters
    ----------
    area : float
        A, in any unit
    volume : float
        V, in the cube of the unit of length of A
    """
    return 6 * math.sqrt(math.pi) * volume / area**1.5


def volumeOfReduced(reducedVolume: float, area: float) -> float:
    """Return the volume of a surface of a reduced volume."""
    return reducedVolume * area**1.5 / (6 * math.sqrt(math.pi))


def reducedAreaDifference(area: float, meanCurvature: float) -> float:
    """Return the reduced area difference M/(4 pi R_A), with the integrated mean curvature M and R_A = sqrt(A/4 pi).

    It is 1 for a sphere (Seifert, Berndl and Lipowsky, Phys. Rev. A 44, 1182, 1991), and NaN without an area.
    """
    return meanCurvature / math.sqrt(4 * math.pi * area) if area > 0 else math.nan


def localMeanCurvatures(meanCurvatures: NDArray[np.float64], areas: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean curvature at each vertex from its integral there and the vertex's area; 0 where there is no area,
    as in the force.
    """
    return np.divide(meanCurvatures, areas, out=np.zeros_like(areas), where=areas > 0)


def smoothCurvatures(
    edges: NDArray[np.integer], meanCurvatures: NDArray[np.float64], areas: NDArray[np.float64], rounds: int = 2
) -> NDArray[np.float64]:
    """Return mean curvatures averaged over neighborhoods: integrals over areas, each summed over neighbors a number of
    times.

    The curvature of single vertices of a fluctuating membrane is mostly noise, in which its shape would not be seen.
    """
    a, b = edges.T
    for _ in range(rounds):
        meanCurvatures, areas = (
            x + np.bincount(a, x[b], len(x)) + np.bincount(b, x[a], len(x)) for x in (meanCurvatures, areas)
        )
    return localMeanCurvatures(meanCurvatures, areas)
