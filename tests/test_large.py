"""Ten million vertices.

This takes three minutes and 7 GiB of memory, and so is only run where the environment variable
OPENMM_HELFRICH_LARGE_TESTS is set.
"""

import math
import os
import resource

import numpy as np
import pytest
from openmm import unit

import openmmhelfrich as mh
from membranes import createContext, forcesOf, termsOf

pytestmark = pytest.mark.skipif(
    "OPENMM_HELFRICH_LARGE_TESTS" not in os.environ, reason="OPENMM_HELFRICH_LARGE_TESTS is not set"
)

# Moduli of bending, area, volume, area difference and tether, and the separation of the leaflets.
KB, KA, KV, KD, KT, H = 50.0, 1e4, 2e4, 3e3, 200.0, 1.0
MIN_LENGTH, MAX_LENGTH, EXPONENT = 0.9, 1.2, 2
CHUNK = 1 << 20


def createForce(mesh):
    """Return a force with all terms but the repulsion, each away from its minimum."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(KB)
    force.setAreaModulus(KA)
    force.setTargetArea(1.1 * mesh.area)
    force.setVolumeModulus(KV)
    force.setTargetVolume(0.8 * mesh.volume)
    force.setAreaDifferenceModulus(KD)
    force.setTargetAreaDifference(1.3 * 2 * H * (4 * np.pi * mesh.area) ** 0.5)
    force.setLeafletSeparation(H)
    force.setTether(KT, MIN_LENGTH, MAX_LENGTH, EXPONENT)
    return force


def chunks(array):
    return (array[i : i + CHUNK] for i in range(0, len(array), CHUNK))


def pairEdges(triangles):
    """Return the corners (i, j, k, l) of the pairs of triangles (i, j, k) and (j, i, l) that share an edge, an array
    with a row a pair.
    """
    i, j, k = (np.concatenate([triangles[:, (n + m) % 3] for n in range(3)]).astype(np.int64) for m in range(3))
    key = np.minimum(i, j) * (triangles.max() + 1) + np.maximum(i, j)
    order = np.argsort(key, kind="stable")
    first, second = order[:-1], order[1:]
    same = key[first] == key[second]
    first, second = first[same], second[same]
    return np.column_stack([i[first], j[first], k[first], k[second]]).astype(np.int32)


def normals(x, triangles):
    """Return the normals of triangles, of the length of twice their areas."""
    a, b, c = (x[triangles[:, n]] for n in range(3))
    return np.cross(b - a, c - a)


def hinges(x, edges):
    """Return the lengths and dihedral angles of edges."""
    e = x[edges[:, 1]] - x[edges[:, 0]]
    length = np.sqrt((e * e).sum(1))
    n, m = normals(x, edges[:, [0, 1, 2]]), normals(x, edges[:, [1, 0, 3]])
    return length, np.arctan2((np.cross(n, m) * e).sum(1) / length, (n * m).sum(1))


def tether(length):
    short = np.minimum(length, MIN_LENGTH * (1 - 1e-9))
    return (
        np.where(length < MIN_LENGTH, np.exp(short / (short - MIN_LENGTH)) / length**EXPONENT, 0)
        + EXPONENT ** (EXPONENT + 1) * np.maximum(length - MAX_LENGTH, 0) ** EXPONENT
    )


def addTo(values, indices, terms):
    values += np.bincount(indices.ravel(), np.repeat(terms, indices.shape[1]), len(values))


def exactSums(x, triangles, edges):
    """Return area, volume, integrated mean curvature, bending and tether energy: correctly rounded sums of terms in
    double precision.
    """
    areas, curvatures = np.zeros(len(x)), np.zeros(len(x))
    parts = {name: [] for name in ("area", "volume", "curvature", "bending", "tether")}
    for t in chunks(triangles):
        n = normals(x, t)
        area = np.sqrt((n * n).sum(1)) / 2
        addTo(areas, t, area / 3)
        parts["area"] += area.tolist()
        parts["volume"] += ((x[t[:, 0]] * n).sum(1) / 6).tolist()
        compress(parts)
    for e in chunks(edges):
        length, angle = hinges(x, e)
        addTo(curvatures, e[:, :2], length * angle / 4)
        parts["curvature"] += (length * angle / 2).tolist()
        parts["tether"] += (KT * tether(length)).tolist()
        compress(parts)
    for m, a in zip(chunks(curvatures), chunks(areas)):
        parts["bending"] += (2 * KB * m * m / a).tolist()
        compress(parts)
    return {name: math.fsum(values) for name, values in parts.items()}


def compress(parts):
    """Replace numbers by a few with the same sum, to within the square of the rounding error."""
    for name, values in parts.items():
        total = math.fsum(values)
        parts[name] = [total, math.fsum([*values, -total])]


def localGradient(x, triangles, vertex, slopes):
    """Return the gradient of the energy by the position of a vertex, by central differences in extended precision of
    what changes with it.
    """
    ring = np.unique(triangles[(triangles == vertex).any(1)])
    near = triangles[np.isin(triangles, ring).any(1)]
    indices, near = np.unique(near, return_inverse=True)
    near = near.reshape(-1, 3)
    core = np.isin(indices, ring)
    edges = pairEdges(near)
    edges = edges[core[edges[:, :2]].any(1)]

    def energy(y):
        n = normals(y, near)
        area = np.sqrt((n * n).sum(1)) / 2
        length, angle = hinges(y, edges)
        areas, curvatures = np.zeros(len(y), np.longdouble), np.zeros(len(y), np.longdouble)
        np.add.at(areas, near, np.repeat(area / 3, 3).reshape(-1, 3))
        np.add.at(curvatures, edges[:, :2], np.repeat(length * angle / 4, 2).reshape(-1, 2))
        return (
            (2 * KB * curvatures[core] ** 2 / areas[core]).sum()
            + KT * tether(length).sum()
            + slopes["area"] * area.sum()
            + slopes["volume"] * ((y[near[:, 0]] * n).sum() / 6)
            + slopes["curvature"] * (length * angle).sum() / 2
        )

    gradient = []
    for axis in range(3):
        energies = []
        for shift in (1e-6, -1e-6):
            y = x[indices].astype(np.longdouble)
            y[indices == vertex, axis] += np.longdouble(shift)
            energies.append(energy(y))
        gradient.append(float((energies[0] - energies[1]) / np.longdouble(2e-6)))
    return np.array(gradient)


def test_ten_million_vertices():
    mesh = mh.Mesh.icosphere(10, (3**0.5 * 10485762 / (8 * np.pi)) ** 0.5)
    x = mesh.vertices + np.random.default_rng(1).normal(scale=0.05, size=mesh.vertices.shape)
    mesh = mh.Mesh(x, mesh.triangles)
    force = createForce(mesh)
    context = createContext(mesh, force, "CPU")
    terms, geometry, forces = termsOf(force, context), force.getGeometryInContext(context), forcesOf(context)
    area, volume, curvature = (
        value.value_in_unit_system(unit.md_unit_system)
        for value in (geometry.area, geometry.volume, geometry.integratedMeanCurvature)
    )
    A0, V0, D0 = (
        value.value_in_unit_system(unit.md_unit_system)
        for value in (force.getTargetArea(), force.getTargetVolume(), force.getTargetAreaDifference())
    )
    del context, geometry

    exact = exactSums(x, mesh.triangles, pairEdges(mesh.triangles))
    assert (area, volume, curvature) == tuple(
        pytest.approx(exact[name], rel=1e-12) for name in ("area", "volume", "curvature")
    )
    difference = 2 * H * exact["curvature"]
    expected = {
        "bending": exact["bending"],
        "tether": exact["tether"],
        "area": KA * (exact["area"] / A0 - 1) ** 2,
        "volume": KV * (exact["volume"] / V0 - 1) ** 2,
        "areaDifference": KD * (difference / D0 - 1) ** 2,
        "repulsion": 0,
    }
    assert {name: terms[name] for name in expected} == pytest.approx(expected, rel=1e-12)

    slopes = {
        "area": 2 * KA * (exact["area"] / A0 - 1) / A0,
        "volume": 2 * KV * (exact["volume"] / V0 - 1) / V0,
        "curvature": 4 * H * KD * (difference / D0 - 1) / D0,
    }
    for vertex in np.linspace(0, len(x) - 1, 12).astype(int):
        gradient = localGradient(x, mesh.triangles, vertex, slopes)
        assert np.linalg.norm(forces[vertex] + gradient) < 1e-9 * np.linalg.norm(gradient)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 24 * 1024**2
