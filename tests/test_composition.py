"""Membranes together with each other, with other forces, and with OpenMM's own tools."""

import csv
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
from conftest import together
from membranes import (
    PLATFORMS,
    TERMS,
    createBlob,
    createContext,
    createForce,
    energyOf,
    forcesOf,
    kelvin,
    positionsOf,
    termsOf,
)


def createPair(platform, integrator=None):
    """Return two membranes with a bead inside each, and a force on the two beads and one on all particles."""
    meshes = createBlob(1, seed=1), createBlob(1, seed=2)
    forces = [createForce(meshes[0], TERMS, 1), createForce(meshes[1], TERMS, 2)]
    n = len(meshes[0].vertices)
    system = mm.System()
    for i in range(2 * n + 2):
        system.addParticle(0 if i in (n, 2 * n + 1) else 1)
    for number, (force, mesh) in enumerate(zip(forces, meshes)):
        force.setName(f"Vesicle{number}")
        force.setForceGroup(number)
        force.setTriangles(mesh.triangles + number * (n + 1))
        system.addForce(force)
    bond = mm.HarmonicBondForce()
    bond.addBond(n, 2 * n + 1, 1, 10)
    bond.setForceGroup(2)
    contact = mm.CustomNonbondedForce("20*step(0.6-r)*(0.6-r)^2")
    for _ in range(2 * n + 2):
        contact.addParticle([])
    contact.addInteractionGroup([n, 2 * n + 1], [i for i in range(2 * n + 2) if i not in (n, 2 * n + 1)])
    contact.setForceGroup(3)
    system.addForce(bond)
    system.addForce(contact)
    context = mm.Context(system, integrator or mm.VerletIntegrator(0.001), mm.Platform.getPlatform(platform))
    centers = [mesh.vertices.mean(axis=0) for mesh in meshes]
    context.setPositions(
        np.concatenate(
            (meshes[0].vertices, [centers[0]], meshes[1].vertices + np.array([5, 0, 0]), [centers[1] + [5, 0, 0]])
        )
    )
    return meshes, forces, context


@pytest.mark.parametrize("platform", PLATFORMS)
def test_two_membranes_beads_and_other_forces(platform):
    meshes, forces, context = createPair(platform)
    n = len(meshes[0].vertices)
    alone = [createContext(mesh, createForce(mesh, TERMS, level), platform) for mesh, level in zip(meshes, (1, 2))]
    for number in range(2):
        assert energyOf(context, {number}) == pytest.approx(energyOf(alone[number]), rel=1e-11)
        expected = np.zeros((2 * n + 2, 3))
        expected[number * (n + 1) : number * (n + 1) + n] = forcesOf(alone[number])
        assert np.abs(forcesOf(context, {number}) - expected).max() < 1e-10 * np.abs(expected).max()
    assert energyOf(context, {2}) > 1 and energyOf(context, {3}) > 0.1
    assert energyOf(context) == pytest.approx(sum(energyOf(context, {group}) for group in range(4)), rel=1e-12)
    assert np.abs(forcesOf(context) - sum(forcesOf(context, {group}) for group in range(4))).max() < 1e-9


@pytest.mark.parametrize("platform", PLATFORMS)
def test_targets_of_two_membranes_are_separate(platform):
    meshes, forces, context = createPair(platform)
    before = [termsOf(force, context) for force in forces]
    assert forces[1].getTargetVolumeParameter() == "Vesicle1TargetVolume"
    context.setParameter("Vesicle1TargetVolume", meshes[1].volume)
    assert termsOf(forces[0], context) == before[0]
    assert termsOf(forces[1], context)["volume"] == pytest.approx(0, abs=1e-20)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_flips_of_two_membranes(platform):
    flips = mh.EdgeFlipIntegrator(kelvin(100), 0.5)
    flips.setRandomNumberSeed(2)
    meshes, forces, context = createPair(platform, flips)
    flips.step(3)
    n = len(meshes[0].vertices)
    live = [force.getTrianglesInContext(context) - number * (n + 1) for number, force in enumerate(forces)]
    assert flips.getNumAttempted() == 3 * 2 * round(0.5 * len(meshes[0].edges))
    for number, mesh in enumerate(meshes):
        changed = mh.Mesh(mesh.vertices, live[number])
        assert not np.array_equal(changed.edges, mesh.edges)
        fresh = createForce(mesh, TERMS, number + 1)
        fresh.setTriangles(live[number])
        assert energyOf(context, {number}) == pytest.approx(energyOf(createContext(mesh, fresh, platform)), rel=1e-11)
    assert not np.array_equal(live[0], live[1])


@pytest.mark.parametrize("platform", PLATFORMS)
def test_monte_carlo_of_two_membranes(platform):
    integrator = mh.HybridMonteCarloIntegrator(3000, 0.00005, 20, 0.2, 0.3)
    integrator.setRandomNumberSeed(2)
    meshes, forces, context = createPair(platform, integrator)
    start = positionsOf(context)
    integrator.step(40)
    n = len(meshes[0].vertices)
    moved = np.any(positionsOf(context) != start, axis=1)
    assert np.array_equal(np.flatnonzero(~moved), [n, 2 * n + 1])
    assert integrator.getAcceptanceRate() > 0.2
    for force in forces:
        assert all(np.isfinite(energy) for energy in termsOf(force, context).values())


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("platform", PLATFORMS)
def test_force_groups_of_trajectories(platform, substeps):
    """A membrane whose group is not integrated moves freely, also where the tether of another acts alone."""
    results = []
    for group in (1, 2):
        integrator = mh.HamiltonianTrajectoryIntegrator(300, 0.0005, 5)
        integrator.setTetherSubsteps(substeps)
        integrator.setRandomNumberSeed(2)
        integrator.setIntegrationForceGroups(group)
        meshes, forces, context = createPair(platform, integrator)
        start = positionsOf(context)
        integrator.step(1)
        assert integrator.getNumAccepted() == 1
        v = context.getState(velocities=True).getVelocities(asNumpy=True)._value
        results.append(np.abs(positionsOf(context) - start - integrator.getLastNumSteps() * 0.0005 * v).max(axis=1))
    n = len(meshes[0].vertices)
    for vertices, (acting, free) in ((slice(0, n), results), (slice(n + 1, -1), results[::-1])):
        assert free[vertices].max() < 1e-12 < 1e-8 < acting[vertices].min()


def test_two_membranes_of_one_name():
    mesh = createBlob(1)
    with pytest.raises(mm.OpenMMException, match=r"two HelfrichForces have the name 'HelfrichForce'.*setName"):
        createContext(mesh, [createForce(mesh), createForce(mesh)])


@pytest.mark.parametrize("platform", PLATFORMS)
def test_two_components_in_one_force(platform):
    """One HelfrichForce may hold several closed surfaces: its area and volume are their sums, and they repel each
    other.
    """
    first, second = createBlob(1, seed=1), createBlob(1, seed=2)
    apart, near = (
        together(first, mh.Mesh(second.vertices + np.array([0, 0, distance]), second.triangles)) for distance in (10, 1)
    )
    force = createForce(apart)
    context = createContext(apart, force, platform)
    geometry = force.getGeometryInContext(context)
    assert geometry.volume / unit.nanometer**3 == pytest.approx(first.volume + second.volume, rel=1e-12)
    assert geometry.area / unit.nanometer**2 == pytest.approx(first.area + second.area, rel=1e-12)
    repulsion = termsOf(force, context)["repulsion"]
    context.setPositions(near.vertices)
    assert termsOf(force, context)["repulsion"] > 1.1 * repulsion


def ellipsoid(reducedVolume, subdivisions):
    """Return a prolate ellipsoid of the area of the unit sphere and a given reduced volume."""
    low, high = 1, 5
    for _ in range(60):
        aspect = (low + high) / 2
        mesh = mh.Mesh.icosphere(subdivisions)
        mesh.vertices *= [1, 1, aspect]
        low, high = (aspect, high) if mesh.reducedVolume > reducedVolume else (low, aspect)
    mesh.vertices *= (4 * np.pi / mesh.area) ** 0.5
    return mesh


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("v", [0.9, 0.8])
def test_minimization_finds_the_prolate(platform, v):
    """LocalEnergyMinimizer brings an ellipsoid to the axisymmetric minimum of bending energy at its reduced volume."""
    with open(Path(__file__).parent / "data" / "axisymmetric_minima.csv") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    (row,) = (row for row in rows if row["branch"] == "prolate" and float(row["v"]) == v)
    mesh = ellipsoid(v, 3)
    assert len(mesh.vertices) == 642
    kappa = 20 * 2.5
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(kappa)
    force.setAreaModulus(1e7)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(1e7)
    force.setTargetVolume(v * mesh.area**1.5 / (6 * np.pi**0.5))
    edge = mesh.edgeLengths
    force.setTether(1000, 0.9 * edge.min(), 1.1 * edge.max(), 2)
    context = createContext(mesh, force, platform)
    start = termsOf(force, context)["bending"]
    mm.LocalEnergyMinimizer.minimize(context, 1)
    final = mh.Mesh(positionsOf(context), mesh.triangles)
    terms = termsOf(force, context)
    assert final.reducedVolume == pytest.approx(v, rel=1e-3)
    assert terms["bending"] < 0.99 * start
    assert terms["bending"] / (8 * np.pi * kappa) == pytest.approx(float(row["energy_over_8pi_kappa"]), rel=0.01)
    assert final.vertexMeanCurvatures.sum() / (4 * np.pi) / np.sqrt(final.area / (4 * np.pi)) == pytest.approx(
        float(row["delta_a"]), rel=0.01
    )
