"""Size and form of a closed surface."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..display import Brief
from ..geometry import connectivity, measures
from ..geometry.mesh import Mesh
from ..optional import dataFrame
from .frames import checkedFrames, trianglesOfEach


@dataclass(frozen=True, eq=False, repr=False)
class ShapeDescription(Brief):
    """Size and form of a closed surface.

    Attributes
    ----------
    area, volume : float
        A, in nm^2, and V, in nm^3
    reducedVolume : float
        v = 6 sqrt(pi) V/A^(3/2), 1 for a sphere
    reducedAreaDifference : float
        M/(4 pi R_A), with the integrated mean curvature M and R_A = sqrt(A/4 pi): 1 for a sphere (Seifert, Berndl and
        Lipowsky, Phys. Rev. A 44, 1182, 1991)
    gyrationTensor : (3, 3) array of float
        S = 1/A int (x-c)(x-c)^T dA over the triangles, with their center of area c, in nm^2
    radiusOfGyration : float
        sqrt(tr S), in nm
    asphericity : float
        l_1-(l_2+l_3)/2 with the eigenvalues l_1 >= l_2 >= l_3 of S, in nm^2 (Theodorou and Suter, Macromolecules 18,
        1206, 1985)
    relativeShapeAnisotropy : float
        1-3 (l_1 l_2+l_2 l_3+l_3 l_1)/(tr S)^2: 0 for a sphere, 1 for points on a line (the same source)
    shapeClass : str
        "sphere", "prolate", "oblate", "stomatocyte", "budded" or "genus 1" and so on: see :func:`classifyShape`
    """

    area: float
    volume: float
    reducedVolume: float
    reducedAreaDifference: float
    gyrationTensor: np.ndarray
    radiusOfGyration: float
    asphericity: float
    relativeShapeAnisotropy: float
    shapeClass: str


def describeShape(mesh: Mesh) -> ShapeDescription:
    """Return size and form of a closed mesh.

    ::

        shape = mh.describeShape(mesh)
        print(shape.shapeClass, shape.reducedVolume)

    Parameters
    ----------
    mesh : Mesh
        a closed mesh

    Returns
    -------
    ShapeDescription
        with areas in nm^2, volumes in nm^3, and the class that :func:`classifyShape` gives
    """
    tensor = gyrationTensor(mesh)
    l3, l2, l1 = np.linalg.eigvalsh(tensor)
    trace = l1 + l2 + l3
    return ShapeDescription(
        mesh.area,
        mesh.volume,
        mesh.reducedVolume,
        reducedAreaDifference(mesh),
        tensor,
        math.sqrt(trace),
        float(l1 - (l2 + l3) / 2),
        float(1 - 3 * (l1 * l2 + l2 * l3 + l3 * l1) / trace**2),
        classifyShape(mesh),
    )


def describeTrajectory(frames: ArrayLike, triangles: ArrayLike) -> list[ShapeDescription]:
    """Return the :class:`ShapeDescription` of each frame.

    ::

        frames = np.stack([mesh.vertices, 1.1 * mesh.vertices])
        areas = [shape.area for shape in mh.describeTrajectory(frames, mesh.triangles)]

    Parameters
    ----------
    frames : (n, N, 3) array
        positions, in nm
    triangles : (T, 3) or (n, T, 3) array of int
        the triangles of all frames, or of each
    """
    positions = checkedFrames(frames)
    return [describeShape(Mesh(x, t)) for x, t in zip(positions, trianglesOfEach(triangles, len(positions)))]


def toDataFrame(descriptions: Sequence[ShapeDescription]) -> Any:
    """Return a pandas.DataFrame with a row for each :class:`ShapeDescription`, without the tensors."""
    return dataFrame(
        [{name: value for name, value in vars(d).items() if name != "gyrationTensor"} for d in descriptions]
    )


def reducedAreaDifference(mesh: Mesh) -> float:
    """Return M/(4 pi R_A) of a closed mesh: see :class:`ShapeDescription`."""
    return float(measures.reducedAreaDifference(mesh.area, mesh.vertexMeanCurvatures.sum()))


def gyrationTensor(mesh: Mesh) -> np.ndarray:
    """Return the gyration tensor of a surface, (3, 3) in nm^2: the integral over its flat triangles is exact.

    See :class:`ShapeDescription`.
    """
    corners, areas = mesh.vertices[mesh.triangles], mesh.triangleAreas
    corners = corners - np.average(corners.mean(axis=1), axis=0, weights=areas)
    sums = corners.sum(axis=1)
    moments = np.einsum("tci,tcj->tij", corners, corners) + np.einsum("ti,tj->tij", sums, sums)
    return np.einsum("t,tij->ij", areas, moments) / (12 * areas.sum())


def classifyShape(mesh: Mesh) -> str:
    """Name the form of a closed, connected surface.

    With the square roots a >= b >= c of the gyration tensor's eigenvalues, the first of these that applies:

    - "sheet": the surface is periodic
    - "genus 1", "genus 2" ...: the surface has handles, as a torus has one
    - "stomatocyte": the reduced area difference is below 0.8.  Along the axisymmetric branches it is at most 0.51 for
      stomatocytes, and above 1.02 for oblates and prolates
    - "budded": along the longest axis there is a neck, a place at which the mean distance of the surface from the axis
      is less than half of its greatest value on either side
    - "sphere": c > 0.9 a
    - "prolate": a-b > b-c
    - "oblate": otherwise

    ::

        mh.classifyShape(mh.spheroid(300, 2))  # "prolate"

    Parameters
    ----------
    mesh : Mesh
        a closed, connected surface
    """
    if mesh.isPeriodic:
        return "sheet"
    genus = connectivity.genus(mesh.triangles, len(mesh.vertices))
    if genus != 0:
        return f"genus {genus}"
    if reducedAreaDifference(mesh) < 0.8:
        return "stomatocyte"
    values, axes = np.linalg.eigh(gyrationTensor(mesh))
    if _hasNeck(mesh, axes[:, 2]):
        return "budded"
    c, b, a = np.sqrt(np.maximum(values, 0))  # of a flat surface rounding may make one negative
    if c > 0.9 * a:
        return "sphere"
    return "prolate" if a - b > b - c else "oblate"


def _hasNeck(mesh: Mesh, axis: np.ndarray) -> bool:
    """Return whether the distance from an axis through the center has a minimum below half of the maxima on either
    side.
    """
    x = mesh.vertices - np.average(mesh.vertices, axis=0, weights=mesh.vertexAreas)
    height = x @ axis
    distance = np.linalg.norm(x - np.outer(height, axis), axis=1)
    # As wide as two edges, so that none is empty, and not so wide that it hides a neck.
    bins = max(8, int(np.ptp(height) / (2 * mesh.edgeLengths.mean())))
    place = np.minimum(((height - height.min()) / np.ptp(height) * bins).astype(int), bins - 1)
    weight = np.bincount(place, mesh.vertexAreas, bins)
    filled = weight > 0
    profile = np.bincount(place, mesh.vertexAreas * distance, bins)[filled] / weight[filled]
    before, after = np.maximum.accumulate(profile), np.maximum.accumulate(profile[::-1])[::-1]
    return bool(np.any(profile < 0.5 * np.minimum(before, after)))
