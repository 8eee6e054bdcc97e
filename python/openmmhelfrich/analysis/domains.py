"""Domains of species on a membrane: their sizes and boundaries, who neighbors whom, and how composition varies with
height, curvature and wavelength.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..display import Brief
from ..geometry.connectivity import cornersOf, imagesInBox
from ..geometry.measures import smoothCurvatures
from ..geometry.mesh import Mesh
from ..optional import dataFrame
from ..units import wholeNumber
from .fluctuations import realHarmonics


@dataclass(frozen=True, eq=False, repr=False)
class Domains(Brief):
    """The domains of a species: vertices of it that edges connect, the largest area first.

    Attributes
    ----------
    areas : (D,) array of float
        their areas, the sums of their vertices' areas, in nm^2
    counts : (D,) array of int
        their numbers of vertices
    boundaryLengths : (D,) array of float
        the lengths of their boundaries, in nm
    labels : (N,) array of int
        the domain that each vertex of the mesh is of, or -1
    """

    areas: NDArray[np.float64]
    counts: NDArray[np.int64]
    boundaryLengths: NDArray[np.float64]
    labels: NDArray[np.int64]

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each domain."""
        return dataFrame({"area": self.areas, "count": self.counts, "boundaryLength": self.boundaryLengths})


def findDomains(mesh: Mesh, species: int | str = 0) -> Domains:
    """Return the domains of a species.

    ::

        mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
        caps = mh.findDomains(mesh, 1)
        print(caps.areas, caps.boundaryLengths)

    Parameters
    ----------
    mesh : Mesh
        a closed mesh with species
    species : int or str
        the number of the species, or its name

    Raises
    ------
    ValueError
        if the mesh has no species, or not this one
    """
    isOf, edges = _isOf(mesh, species), mesh.edges
    inside = edges[isOf[edges].all(axis=1)]
    graph = coo_array((np.ones(len(inside), dtype=bool), inside.T), shape=(len(isOf), len(isOf)))
    _, part = connected_components(graph, directed=False)
    numbers, labels = np.unique(part[isOf], return_inverse=True)
    areas = np.bincount(labels, mesh.vertexAreas[isOf], len(numbers)).astype(np.float64)
    order = np.argsort(-areas, kind="stable")
    domain = np.full(len(isOf), -1, dtype=np.int64)
    domain[isOf] = np.argsort(order)[labels]
    return Domains(
        areas[order],
        np.bincount(labels, minlength=len(numbers))[order],
        _boundaryLengths(mesh, domain, len(numbers)),
        domain,
    )


def boundaryLength(mesh: Mesh) -> float:
    """Return the length of all boundaries between species, in nm: what a line tension acts on.

    ::

        mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
        print(mh.boundaryLength(mesh))

    In a triangle of two species the boundary joins the midpoints of its mixed edges; of three, it joins the midpoints
    to the centroid.
    """
    species = _speciesOf(mesh)
    return float(sum(_lengthsBy(mesh, species).values()))


def contactNumbers(mesh: Mesh) -> NDArray[np.float64]:
    """Return how many neighbors of each species a vertex of each species has on average: a (species, species) array.

    ::

        mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
        print(mh.contactNumbers(mesh)[0, 1])
    """
    species, edges = _speciesOf(mesh), mesh.edges
    count = _countOf(mesh)
    pairs = np.zeros((count, count))
    np.add.at(pairs, tuple(species[edges].T), 1)
    return (pairs + pairs.T) / np.maximum(np.bincount(species, minlength=count), 1)[:, np.newaxis]


def compositionProfile(
    mesh: Mesh, species: int | str = 0, axis: ArrayLike = (0, 0, 1), bins: int = 20
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return heights along an axis, in nm, and the part of the area there that is of a species.

    ::

        mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
        heights, parts = mh.compositionProfile(mesh, species=1, bins=8)

    Parameters
    ----------
    mesh : Mesh
        a closed mesh with species; the vertices of a periodic one count where their images in one box are
    species : int or str
        the number of the species, or its name
    axis : (3,) array
        the direction
    bins : int
        the number of slices of equal height; where one has no vertex the part is NaN

    Raises
    ------
    ValueError
        if the mesh has no species, or not this one, the axis has no direction, or bins is no whole number, 1 or more
    """
    direction = np.asarray(axis, dtype=float)
    if direction.shape != (3,) or not np.linalg.norm(direction) > 0:
        raise ValueError(
            f"compositionProfile: axis is {direction.tolist()}; it must be three numbers that are not all 0"
        )
    bins = wholeNumber(bins, "compositionProfile: bins", 1)
    heights = imagesInBox(mesh.vertices, mesh.images) @ (direction / np.linalg.norm(direction))
    areas = mesh.vertexAreas
    isOf = _isOf(mesh, species)
    total, ends = np.histogram(heights, bins, weights=areas)
    own, _ = np.histogram(heights[isOf], ends, weights=areas[isOf])
    parts = np.divide(own, total, out=np.full(bins, np.nan), where=total > 0)
    return (ends[1:] + ends[:-1]) / 2, parts


def speciesCurvature(mesh: Mesh, species: int | str = 0) -> tuple[float, float]:
    """Return the mean curvature where a species is, less that of the whole surface, in 1/nm; and the correlation of the
    species with mean curvature, from -1 to 1.

    ::

        mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
        excess, correlation = mh.speciesCurvature(mesh, 1)

    Vertices count by their areas; curvatures are averaged over neighborhoods.
    """
    isOf, areas = _isOf(mesh, species), mesh.vertexAreas
    curvature = smoothCurvatures(mesh.edges, mesh.vertexMeanCurvatures, areas)
    weights = areas / areas.sum()
    part, mean = weights @ isOf, weights @ curvature
    covariance = weights @ (isOf * (curvature - mean))
    deviations = np.sqrt(part * (1 - part) * (weights @ (curvature - mean) ** 2))
    excess = covariance / part if part > 0 else np.nan
    return float(excess), float(covariance / deviations) if deviations > 0 else np.nan


def compositionSpectrum(mesh: Mesh, species: int | str = 0, maxDegree: int = 10) -> NDArray[np.float64]:
    """Return the structure factor of a species on a vesicle that is nearly a sphere, for l from 0 to a greatest degree.

    ::

        mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
        powers = mh.compositionSpectrum(mesh, 1, maxDegree=4)

    It is the mean over m of the squares of c_lm, the integral of (phi-<phi>) Y_lm over directions from the middle.
    There phi is 1 at vertices of the species and 0 elsewhere, and each vertex stands for its part of the area.

    Parameters
    ----------
    mesh : Mesh
        a closed mesh with species
    species : int or str
        the number of the species, or its name
    maxDegree : int
        the greatest l, at least 1

    Raises
    ------
    ValueError
        if the mesh has no species, or not this one, or maxDegree is no whole number, 1 or more
    """
    maxDegree = wholeNumber(maxDegree, "compositionSpectrum: maxDegree", 1)
    if mesh.isPeriodic:
        raise ValueError("compositionSpectrum: the mesh is periodic; spherical harmonics are for vesicles")
    phi, weights = _isOf(mesh, species).astype(float), 4 * np.pi * mesh.vertexAreas / mesh.area
    arms = mesh.vertices - np.average(mesh.vertices, axis=0, weights=weights)
    harmonics = realHarmonics(arms / np.linalg.norm(arms, axis=1, keepdims=True), maxDegree)
    coefficients = (weights * (phi - np.average(phi, weights=weights))) @ harmonics
    return np.array([np.mean(coefficients[l * l : (l + 1) ** 2] ** 2) for l in range(maxDegree + 1)])


def _speciesOf(mesh: Mesh) -> NDArray[np.intc]:
    if mesh.species is None:
        raise ValueError("the mesh has no species; give it some, as in mesh.species = array")
    return mesh.species


def _countOf(mesh: Mesh) -> int:
    """Return how many species there are, as far as a mesh tells."""
    return max(len(mesh.speciesNames), int(_speciesOf(mesh).max()) + 1)


def _isOf(mesh: Mesh, species: int | str) -> NDArray[np.bool_]:
    """Return which vertices are of a species, by its number or name."""
    own, names, count = _speciesOf(mesh), mesh.speciesNames, _countOf(mesh)
    if isinstance(species, str):
        if species not in names:
            known = f"they are called {', '.join(names)}" if names else "they have no names, as in mesh.speciesNames"
            raise ValueError(f"no species of the mesh is called '{species}'; {known}")
        return own == names.index(species)
    if isinstance(species, bool) or not isinstance(species, (int, np.integer)) or not 0 <= species < count:
        more = "" if names else ", and more if mesh.speciesNames has more"
        raise ValueError(f"the mesh has no species {species}; it has 0 to {count - 1}{more}")
    return own == species


def _lengthsBy(mesh: Mesh, labels: NDArray[Any]) -> dict[tuple[int, int], float]:
    """Return the lengths of boundaries by the two labels, the lower first, on both sides."""
    pairs, lengths = _segments(mesh, labels)
    found, index = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    sums = np.bincount(index.ravel(), lengths, len(found))
    return {(int(a), int(b)): float(length) for (a, b), length in zip(found, sums)}


def _boundaryLengths(mesh: Mesh, domain: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    lengths = np.zeros(count)
    for pair, length in _lengthsBy(mesh, domain).items():
        for side in pair:
            if side >= 0:
                lengths[side] += length
    return lengths


def _segments(mesh: Mesh, labels: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Return the pieces of boundaries in triangles: the labels on both sides, and the lengths."""
    x, pairs, lengths = cornersOf(mesh.vertices, mesh.triangles, mesh.images), [], []
    label = labels[mesh.triangles]
    differ = label != np.roll(label, -1, axis=1)  # of the edge from a corner to the next one
    two, three = differ.sum(axis=1) == 2, differ.all(axis=1)
    for k in range(3):  # the like edge is the one from corner k to the next
        chosen = two & ~differ[:, k]
        pairs.append(np.column_stack((label[chosen, k], label[chosen, k - 1])))
        lengths.append(np.linalg.norm(x[chosen, k] - x[chosen, (k + 1) % 3], axis=1) / 2)
        middle = (x[three, k] + x[three, (k + 1) % 3]) / 2
        pairs.append(np.column_stack((label[three, k], label[three, (k + 1) % 3])))
        lengths.append(np.linalg.norm(middle - x[three].mean(axis=1), axis=1))
    return np.concatenate(pairs), np.concatenate(lengths)
