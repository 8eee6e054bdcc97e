"""Integrators at the extremes of temperature, step size, targets and length; geometry and parameters are
HelfrichExtremes.h's.  docs/results/extremes.md lists them all.
"""

import math
import os

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
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

ENGINES = ["native", "custom"]
GENTLE = 2e-4


def createRun(temperature, stepSize=GENTLE, platform="CPU", engine="native", flipProbability=0.5, force=None):
    mesh = createBlob(1)
    integrator = mh.HybridMonteCarloIntegrator(temperature, stepSize, 10, 0.5, flipProbability, engine)
    integrator.setRandomNumberSeed(3)
    force = force or createForce(mesh)
    return force, integrator, createContext(mesh, force, platform, integrator)


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("temperature", [1e-300, 1e-20])
def test_cold(platform, engine, temperature):
    """No move goes uphill by more than rounding makes of it, and flips go downhill."""
    force, integrator, context = createRun(temperature, platform=platform, engine=engine)
    energy = start = energyOf(context)
    for _ in range(30):
        integrator.step(1)
        before, energy = energy, energyOf(context)
        assert energy <= before * (1 + 1e-13)
    assert energy < 0.9 * start


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("engine", ENGINES)
def test_hot(platform, engine):
    force, integrator, context = createRun(1e6, 1e-5, platform, engine)
    integrator.step(40)
    assert integrator.getAcceptanceRate() > 0.5 and integrator.getFlipAcceptanceRate() > 0.2
    assert math.isfinite(energyOf(context))


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("factor", [1e3, 1e150])
def test_step_sizes_too_large(platform, engine, factor):
    """Every trajectory is rejected, and leaves the positions as they were, to the last bit."""
    force, integrator, context = createRun(300, GENTLE * factor, platform, engine, flipProbability=0)
    start, energy = positionsOf(context), energyOf(context)
    integrator.step(8)
    assert integrator.getAcceptanceRate() == 0
    assert np.array_equal(positionsOf(context), start) and energyOf(context) == energy
    integrator.setStepSize(GENTLE)
    integrator.step(8)
    assert integrator.getAcceptanceRate() > 0


def test_targets_out_of_reach():
    """A volume that no surface of this area has: the vesicle becomes as round as it can, and both terms pull against
    each other for ever.
    """
    mesh = mh.Mesh.icosphere(2)
    mesh.vertices *= [1, 1, 0.7]
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(10)
    force.setAreaModulus(1e5)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(1e5)
    force.setTargetVolume(10 * mesh.volume)
    before = mesh.reducedVolume
    integrator = mh.HybridMonteCarloIntegrator(1, 5e-4, 50, 0.1, 0.3)
    integrator.setRandomNumberSeed(3)
    context = createContext(mesh, force, "CPU", integrator)
    energy = energyOf(context)
    integrator.step(150)
    mesh = mh.Mesh(positionsOf(context), force.getTrianglesInContext(context))
    terms = termsOf(force, context)
    assert energyOf(context) < 0.97 * energy
    assert before + 0.02 < mesh.reducedVolume < 1
    assert mesh.area > force.getTargetArea()._value and mesh.volume < force.getTargetVolume()._value
    assert min(terms["area"], terms["volume"]) > 1e3


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("exponent", [-308, -200, -160, -155, -150, -100, -78, -60, 60, 100, 150])
def test_scales_where_numbers_end(platform, exponent):
    """Where squares of lengths, areas or their inverses are too small or too large for a number, there is an error or
    the right energy, and never a force of NaN.
    """
    mesh = mh.Mesh.icosphere(1)
    expected = energyOf(createContext(mesh, createForce(mesh, ["bending"]), platform))
    mesh.vertices *= 10.0**exponent
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(20)
    context = createContext(mesh, force, platform)
    try:
        energy, forces = energyOf(context), forcesOf(context)
    except mm.OpenMMException as error:
        assert "not finite" in str(error) and abs(exponent) > 70
        return
    assert np.all(np.isfinite(forces))
    assert energy == pytest.approx(expected, rel=1e-9) or exponent < -70


@pytest.mark.parametrize("platform", PLATFORMS)
def test_forces_that_are_not_finite(platform):
    """An energy that is finite does not hide them."""
    mesh = mh.Mesh.icosphere(1)
    force = createForce(mesh, [])
    force.setTether(1e300, 1, 2, 1)
    context = createContext(mesh, force, platform)
    context.setPositions(mesh.vertices * 1e-5)
    assert 1e300 < termsOf(force, context)["tether"] < math.inf
    with pytest.raises(mm.OpenMMException, match="not finite"):
        context.getState(forces=True)
    context.setPositions(mesh.vertices)
    assert np.all(np.isfinite(forcesOf(context)))


@pytest.mark.parametrize("platform", PLATFORMS)
def test_geometry_that_is_not_finite(platform):
    mesh = createBlob(1)
    force = createForce(mesh, ["area"])
    flips = mh.EdgeFlipIntegrator(300, 1)
    context = createContext(mesh, force, platform, flips)
    for positions in (
        mesh.vertices * 1e200,
        mesh.vertices[
            np.where(np.arange(len(mesh.vertices)) == mesh.edges[0, 0], mesh.edges[0, 1], np.arange(len(mesh.vertices)))
        ],
    ):
        context.setPositions(positions)
        with pytest.raises(mm.OpenMMException, match="geometry is not finite"):
            force.getGeometryInContext(context)
    flips.step(1)  # without a term that asks for angles a sweep needs none


def test_a_vesicle_far_away():
    """The mesh's own volume and area lose no more than the positions have lost."""
    mesh = createBlob(2)
    far = mh.Mesh(mesh.vertices + np.array([1e6, -7e5, 3e5]), mesh.triangles)
    back = mh.Mesh(far.vertices - far.vertices[0], mesh.triangles)
    assert (far.volume, far.area) == pytest.approx((back.volume, back.area), rel=1e-14)
    assert far.volume == pytest.approx(mesh.volume, rel=1e-8)


@pytest.mark.skipif(
    "OPENMM_HELFRICH_LARGE_TESTS" not in os.environ,
    reason="OPENMM_HELFRICH_LARGE_TESTS is not set; this takes some minutes",
)
def test_a_million_trajectories():
    """Positions, triangles and energies after a million trajectories and as many sweeps are those of a Context that has
    seen none of them.
    """
    mesh = mh.Mesh.icosphere(1)
    edge = mesh.edgeLengths.mean()
    force = createForce(mesh, TERMS[:4])
    force.setTargetVolume(0.9 * mesh.volume)
    force.setTether(500, 0.75 * edge, 1.4 * edge, 2)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(1), 2e-3, 4, 0.1, 0.5)
    integrator.setRandomNumberSeed(3)
    context = createContext(mesh, force, "CPU", integrator)
    while integrator.getNumTrajectories() < 1000000:
        integrator.step(10000)
    geometry, terms = force.getGeometryInContext(context), termsOf(force, context)
    last = mh.Mesh(positionsOf(context), force.getTrianglesInContext(context))
    last.check()
    x = last.vertices.astype(np.longdouble) - last.vertices[0]
    normals = np.cross(
        x[last.triangles[:, 1]] - x[last.triangles[:, 0]], x[last.triangles[:, 2]] - x[last.triangles[:, 0]]
    )
    area, volume = np.sqrt((normals**2).sum(axis=1)).sum() / 2, (x[last.triangles[:, 0]] * normals).sum() / 6
    found = [
        value.value_in_unit_system(unit.md_unit_system)
        for value in (geometry.area, geometry.volume, geometry.integratedMeanCurvature)
    ]
    drifts = [float(value / exact - 1) for value, exact in zip(found, (area, volume, last.vertexMeanCurvatures.sum()))]
    print(
        f"{integrator.getNumTrajectories()} trajectories, {integrator.getAcceptanceRate():.3f} accepted, A, V and M "
        f"off by {drifts}"
    )
    assert max(map(abs, drifts)) < 1e-10
    fresh = createForce(mesh, TERMS[:4])
    fresh.setTriangles(last.triangles)
    fresh.setTargetArea(force.getTargetArea())
    fresh.setTargetVolume(force.getTargetVolume())
    fresh.setTargetAreaDifference(force.getTargetAreaDifference())
    fresh.setTether(*force.getTether())
    expected = termsOf(fresh, createContext(last, fresh, "Reference"))
    assert terms == {name: pytest.approx(value, rel=1e-10, abs=1e-12) for name, value in expected.items()}
