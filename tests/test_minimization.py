"""Minima: those of axisymmetric vesicles, with stiff penalties, from near and far; and that nothing else changes on the
way.
"""

import csv
import functools
import itertools
import math
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit
from scipy.spatial.transform import Rotation

import openmmhelfrich as mh
from membranes import forcesOf, positionsOf, termsOf
from openmmhelfrich.analysis import describeShape
from openmmhelfrich.geometry.shapes import invaginatedSphere
from openmmhelfrich.sampling.minimization import _CONVERGED, STALLED, _Descent
from openmmhelfrich.sampling.waves import WaveStiffness

KAPPA = 50.0
KJ = unit.kilojoules_per_mole


def createSimulation(mesh, reducedVolume, stiffness=1e6, tether=(10, 0.8, 1.25), integrator=None, extra=()):
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(KAPPA)
    force.setAreaModulus(stiffness * KAPPA)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(stiffness * KAPPA)
    force.setTargetVolume(reducedVolume * mesh.area**1.5 / (6 * math.sqrt(math.pi)))
    force.setTether(tether[0] * KAPPA, tether[1] * edge, tether[2] * edge, 2)
    system = mesh.createSystem()
    for f in (force, *extra):
        system.addForce(f)
    integrator = integrator or mh.HybridMonteCarloIntegrator(300, 1e-4)
    integrator.setRandomNumberSeed(2)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    return force, simulation


def axisymmetricMinima():
    with open(Path(__file__).parent / "data" / "axisymmetric_minima.csv", newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {(row["branch"], float(row["v"])): float(row["energy_over_8pi_kappa"]) for row in rows}


@pytest.mark.parametrize("minimize, subdivisions", [*itertools.product((mh.minimize, mh.minimizeFluid), (2, 3))])
def test_a_sphere_of_icosahedral_symmetry_becomes_a_prolate(minimize, subdivisions):
    """Also with the coordinates of single precision, in any place and orientation."""
    sphere = mh.Mesh.icosphere(subdivisions)
    turned = sphere.vertices @ Rotation.from_euler("xyz", [0.3, 0.5, 0.7]).as_matrix() + [3, 4, 5]
    for vertices in (sphere.vertices, turned.astype(np.float32).astype(float)):
        force, simulation = createSimulation(mh.Mesh(vertices, sphere.triangles), 0.9, 5e4)
        result = minimize(simulation, force)
        energy = result.energies["bending"]._value / (8 * math.pi * KAPPA)
        found = mh.Mesh(positionsOf(simulation.context), force.getTrianglesInContext(simulation.context))
        assert result.converged and describeShape(found).shapeClass == "prolate"
        assert energy == pytest.approx(axisymmetricMinima()["prolate", 0.9], rel=0.02)


def displaced(mesh, reducedVolume=0.9, **options):
    """Return whether a minimization moves a mesh before its first iteration."""
    force, simulation = createSimulation(mesh, reducedVolume, **options)
    before = positionsOf(simulation.context)
    _Descent(simulation, force, None, 1, None, 0).leaveSymmetry()
    return not np.array_equal(before, positionsOf(simulation.context))


@pytest.mark.parametrize("minimize", [mh.minimize, mh.minimizeFluid])
def test_a_start_within_the_tolerance_stays(minimize):
    force, simulation = createSimulation(mh.Mesh.icosphere(2), 0.9)
    before = positionsOf(simulation.context)
    result = minimize(simulation, force, tolerance=1e12)
    assert result.converged and result.iterations == 0
    assert np.array_equal(before, positionsOf(simulation.context))


def test_only_symmetric_starts_far_from_their_targets_are_displaced():
    sphere = mh.Mesh.icosphere(2)
    field = mm.CustomExternalForce("x^2")
    for i in range(len(sphere.vertices)):
        field.addParticle(i)
    two = mh.Mesh.merged([sphere, mh.Mesh(sphere.vertices + np.array([5, 0, 0]), sphere.triangles)])
    assert displaced(sphere) and displaced(mh.Mesh.icosphere(0)) and displaced(two, 0.6)
    assert not displaced(sphere, sphere.reducedVolume)
    assert not displaced(sphere, extra=(field,))  # whose forces lead out by themselves
    assert not displaced(mh.Mesh(sphere.vertices * [1, 1, 1 + 1e-4], sphere.triangles))
    assert not any(displaced(mh.spheroid(n, 1)) for n in (162, 642))


def createSheet(width, height, pressure):
    """Return a flat periodic sheet, with edges of about 1, its force and a Simulation of it: its target of the area is
    larger by a thousandth, so that it resists with a negative tension, the pressure, where it is flat.
    """
    mesh = mh.Mesh.sheet(width, height, 1)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setUsesPeriodicBoundaryConditions(True)
    force.setBendingModulus(KAPPA)
    force.setTargetArea(1.001 * mesh.area)
    force.setAreaModulus(pressure * 1.001 * mesh.area / (2 * (1 - 1 / 1.001)))  # of E = K (A/A_0-1)^2
    system = mesh.createSystem()
    system.addForce(force)
    integrator = mh.HybridMonteCarloIntegrator(300, 1e-4)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    return mesh, force, simulation


@pytest.mark.parametrize("minimize", [mh.minimize, mh.minimizeFluid])
@pytest.mark.parametrize("width, height", [(10, 10), (8, 14)])
def test_a_compressed_flat_sheet_buckles_by_its_longest_wave(minimize, width, height):
    """Where the pressure is more than what bending resists, kappa q^2, and not below, where the start has no force."""
    critical = KAPPA * (2 * math.pi / max(width, height)) ** 2
    for pressure in (0.8 * critical, 1.3 * critical):
        mesh, force, simulation = createSheet(width, height, pressure)
        before = simulation.context.getState(energy=True).getPotentialEnergy()
        result = minimize(simulation, force, maxIterations=500)
        after, isBent = positionsOf(simulation.context), pressure > critical
        assert (result.energy < 0.99 * before) == isBent == (np.ptp(after[:, 2]) > 0.03)
        assert isBent or np.array_equal(after, mesh.vertices)


def test_flips_that_cost_nothing_end():
    """As those of a flat sheet without a tether, all of whose triangulations have an energy of 0."""
    _, force, simulation = createSheet(8, 8, 0)
    result = mh.minimizeFluid(simulation, force)
    assert result.converged and result.energy._value == pytest.approx(0, abs=1e-9)


def test_a_domain_bulges_on_a_fluid_mesh():
    """Its line tension shortens the boundary, while flips and L-BFGS keep the species where they are."""
    mesh = mh.Mesh.icosphere(2)
    force, simulation = createSimulation(mesh, 0.84, 1e4)
    context, species = simulation.context, (mesh.vertices[:, 2] > 0.5).astype(int)

    def shape():
        own = force.getVertexSpeciesInContext(context)
        return mh.Mesh(positionsOf(context), force.getTrianglesInContext(context), species=own)

    for _ in range(2):
        force.addSpecies(KAPPA, 0)
    force.setLineTension(0, 1, 10 * KAPPA)
    force.setVertexSpecies(species)
    context.reinitialize()
    context.setPositions(mesh.vertices)
    before, energy = mh.findDomains(shape(), 1), simulation.context.getState(energy=True).getPotentialEnergy()
    result = mh.minimizeFluid(simulation, force)
    after = mh.findDomains(shape(), 1)
    assert result.converged and result.flips > 0 and result.energy < energy
    assert len(before.areas) == len(after.areas) == 1 and np.array_equal(shape().species, species)
    relative = [d.boundaryLengths[0] / math.sqrt(4 * math.pi * d.areas[0]) for d in (before, after)]
    assert relative[1] < 0.8 * relative[0]


@pytest.mark.parametrize("kind, reducedVolume", [("prolate", 0.8), ("oblate", 0.7)])
def test_axisymmetric_minima_from_spheroids(kind, reducedVolume):
    """A moderate mesh, of 642 vertices, with penalties of 1e6 kappa_B; test_minima.py has all that are known, from the
    axisymmetric shapes.
    """
    force, simulation = createSimulation(mh.spheroid(642, mh.spheroidAspectRatio(reducedVolume, kind)), reducedVolume)
    result = mh.minimizeFluid(simulation, force)
    assert result.converged and not result.warnings
    assert result.energies["bending"] / KJ / (8 * math.pi * KAPPA) == pytest.approx(
        axisymmetricMinima()[kind, reducedVolume], rel=0.01
    )
    geometry = force.getGeometryInContext(simulation.context)
    assert mh.reducedVolume(geometry.area._value, geometry.volume._value) == pytest.approx(reducedVolume, rel=2e-4)
    mh.Mesh(positionsOf(simulation.context), force.getTrianglesInContext(simulation.context)).check()


def test_stomatocyte():
    """From two spheres and a rim, with the firm tether that its narrow mouth needs."""
    mesh = mh.surfaceOfRevolution(invaginatedSphere(inner=0.515, opening=0.35), 642)
    mesh.vertices *= math.sqrt(4 * math.pi / mesh.area)
    force, simulation = createSimulation(mesh, 0.6, tether=(100, 0.88, 1.17))
    result = mh.minimizeFluid(simulation, force)
    assert result.converged and not result.warnings
    assert result.energies["bending"] / KJ / (8 * math.pi * KAPPA) == pytest.approx(
        axisymmetricMinima()["stomatocyte", 0.6], rel=0.01
    )
    shape = describeShape(mh.Mesh(positionsOf(simulation.context), force.getTrianglesInContext(simulation.context)))
    assert shape.shapeClass == "stomatocyte" and 0.4 < shape.reducedAreaDifference < 0.55


def test_a_sphere_without_symmetry_falls():
    mesh = mh.spheroid(642, 1)
    force, simulation = createSimulation(mesh, 0.95, tether=(100, 0.8, 1.25))
    result = mh.minimizeFluid(simulation, force)
    assert result.converged
    assert result.energies["bending"] / KJ / (8 * math.pi * KAPPA) == pytest.approx(
        mh.axisymmetricMinimum("prolate", 0.95).energy, rel=0.01
    )


def test_stiff_penalties_from_far():
    """A tenth of the volume and more must go: softened penalties lead to the minimum, at which the stiff ones crumple
    the membrane.
    """
    force, simulation = createSimulation(mh.spheroid(642, 1.3), 0.85)
    result = mh.minimizeFluid(simulation, force)
    assert result.converged and result.flips > 0
    geometry = force.getGeometryInContext(simulation.context)
    assert geometry.volume / force.getTargetVolume() == pytest.approx(1, abs=2e-4)
    assert geometry.area / force.getTargetArea() == pytest.approx(1, abs=2e-4)
    # The branch between v = 0.9 and 0.8.
    assert result.energies["bending"] / KJ / (8 * math.pi * KAPPA) == pytest.approx((1.18964 + 1.38744) / 2, rel=0.02)
    assert force.getAreaModulus() / KJ == force.getVolumeModulus() / KJ == 1e6 * KAPPA


def test_result_is_what_the_context_holds():
    mesh = mh.spheroid(162, 1.5)
    force, simulation = createSimulation(mesh, 0.95, 1e4)
    calls = []
    result = mh.minimize(simulation, force, progress=lambda iteration, energy: calls.append((iteration, energy)))
    context = simulation.context
    assert (
        result.converged
        and result.iterations == len(result.history) == len(calls)
        and calls[-1] == (result.iterations, result.history[-1])
    )
    assert result.history[-1] == pytest.approx(result.energy / KJ, rel=1e-12)
    assert sum(termsOf(force, context).values()) == pytest.approx(result.energy / KJ, rel=1e-12)
    assert np.all(np.diff(result.history) <= 0)
    assert np.sqrt(np.mean(forcesOf(context) ** 2)) == pytest.approx(result.rmsForce._value)
    assert np.array_equal(force.getTrianglesInContext(context), mesh.triangles)
    again = mh.minimize(simulation, force)
    assert again.converged and again.iterations == 0
    frame = result.toDataFrame() if pytest.importorskip("pandas") else None
    assert list(frame["energy"]) == list(result.history)


def test_flips_lower_the_energy_and_leave_the_integrator_as_it_was():
    mesh = mh.Mesh.icosphere(2)
    mesh.vertices = mesh.vertices * [1, 1, 1.4]
    results = []
    for function in (mh.minimize, mh.minimizeFluid):
        force, simulation = createSimulation(mesh, 0.97, 1e3, tether=(10, 0.6, 1.5))
        flips = simulation.integrator.getFlipIntegrator()
        flips.setTemperature(1e4)
        flips.setFraction(0.1)
        flips.step(5)  # makes a bad mesh
        simulation.integrator.setTemperature(123)
        simulation.context.setStepCount(7)
        results.append(function(simulation, force))
    fixed, fluid = results
    assert fixed.flips == 0 < fluid.flips and fluid.energy < 0.95 * fixed.energy
    flips = simulation.integrator.getFlipIntegrator()
    assert flips.getTemperature() / unit.kelvin == 123 and flips.getFraction() == 0.1
    assert simulation.currentStep == 7


@functools.cache
def smoothSpheroid(numVertices):
    return mh.spheroid(numVertices, mh.spheroidAspectRatio(0.9, "prolate"))


def roughSpheroid(numVertices, noise=0.08, isFixed=None):
    """Vertices moved at random by parts of an edge, with stiff targets of the smooth shape."""
    smooth = smoothSpheroid(numVertices)
    length, random = smooth.edgeLengths.mean(), np.random.default_rng(3)
    mesh = mh.Mesh(smooth.vertices + noise * length * random.normal(size=smooth.vertices.shape), smooth.triangles)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(1)
    force.setAreaModulus(1e6)
    force.setTargetArea(smooth.area)
    force.setVolumeModulus(1e6)
    force.setTargetVolume(smooth.volume)
    force.setTether(100, 0.8 * length, 1.25 * length, 2)
    force.setTetherLengthScale(length)
    system = mesh.createSystem()
    system.addForce(force)
    for i in np.flatnonzero(isFixed) if isFixed is not None else ():
        system.setParticleMass(int(i), 0)
    simulation = app.Simulation(
        mesh.topology(), system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("CPU"), {"Threads": "1"}
    )
    simulation.context.setPositions(mesh.vertices)
    return force, simulation


def test_iterations_hardly_grow_with_the_mesh():
    results = {}
    for numVertices in (162, 642, 2562):
        force, simulation = roughSpheroid(numVertices)
        results[numVertices] = mh.minimize(simulation, force, multilevelWeight=2)
        assert results[numVertices].converged
    assert results[2562].iterations < 2 * results[162].iterations
    for numVertices in (162, 642):
        plain = mh.minimize(*roughSpheroid(numVertices)[::-1])
        assert plain.energy / results[numVertices].energy == pytest.approx(1, abs=1e-3)
    force, simulation = roughSpheroid(642)
    again = mh.minimize(simulation, force, multilevelWeight=2)
    assert np.array_equal(again.history, results[642].history)
    assert mh.minimize(simulation, force, multilevelWeight=2).iterations == 0
    assert force.getTether()[1] / force.getTetherLengthScale() == pytest.approx(0.8)


def test_fixed_vertices_stay_when_waves_move():
    isFixed = np.arange(162) % 11 == 0
    force, simulation = roughSpheroid(162, 0.03, isFixed)
    before = positionsOf(simulation.context)
    start = simulation.context.getState(energy=True).getPotentialEnergy()
    result = mh.minimize(simulation, force, maxIterations=200, multilevelWeight=2)
    moved = np.any(positionsOf(simulation.context) != before, axis=1)
    assert result.energy < start and np.array_equal(moved, ~isFixed)


def test_second_derivatives_of_waves():
    """The motion for slopes that are those of a smooth wave along normals goes as 1/q^4, and a penalty forbids it."""
    mesh = mh.Mesh.icosphere(3)
    sides = mesh.vertices[np.roll(mesh.triangles, -1, axis=1)] - mesh.vertices[mesh.triangles]
    x, y, z = mesh.vertices.T
    stiffness = WaveStiffness(sides, mesh.triangles, np.zeros(len(x), bool), 7, 0, [])
    for wave, degree in ((x * y, 2), (x * y * z, 3), (z**4 - 6 / 7 * z**2 + 3 / 35, 4)):
        slopes = wave[:, np.newaxis] * mesh.vertices
        motion = stiffness(slopes)
        area = 4 * np.pi / len(x)
        expected = np.sum(slopes**2) / (7 * area * (degree * (degree + 1) + 1) ** 2)
        assert np.vdot(slopes, motion) == pytest.approx(expected, rel=0.1)
        hindered = WaveStiffness(sides, mesh.triangles, np.zeros(len(x), bool), 7, 0, [1e6 * slopes])(slopes)
        assert np.abs(hindered).max() < 1e-6 * np.abs(motion).max()
    turn = np.cross([0, 0, 1], mesh.vertices)
    turned = WaveStiffness(sides, mesh.triangles, np.zeros(len(x), bool), 7, 0, [], [turn])
    slopes = turn + np.cross([1, 0, 0], mesh.vertices)
    assert turned(slopes) - stiffness(slopes) == pytest.approx(np.vdot(turn, slopes) * turn)


def test_waves_serve_fluid_membranes():
    """Fluid or not, a rough spheroid comes down in about as few iterations."""
    force, simulation = roughSpheroid(642)
    alone = mh.minimize(simulation, force, multilevelWeight=2)
    smooth = smoothSpheroid(642)
    noise = 0.08 * smooth.edgeLengths.mean() * np.random.default_rng(3).normal(size=smooth.vertices.shape)
    rough = mh.Mesh(smooth.vertices + noise, smooth.triangles)
    force, simulation = createSimulation(rough, 0.9, 1e6, (100, 0.75, 1.3))
    fluid = mh.minimizeFluid(simulation, force, maxIterations=500, multilevelWeight=2)
    assert fluid.converged and fluid.iterations < 2 * alone.iterations


@pytest.mark.parametrize("minimize", [mh.minimize, mh.minimizeFluid])
@pytest.mark.parametrize("subdivisions, stretch, reducedVolume", [(1, 8, 0.9), (2, 1, 0.3), (1, 20, 0.9)])
def test_waves_end_where_they_lower_nothing(minimize, subdivisions, stretch, reducedVolume):
    """On a rough energy, where their steps go on by rounding, vertices move one by one, until they find nothing."""
    sphere = mh.Mesh.icosphere(subdivisions)
    scene = mh.Scene.of(
        {"membrane": {"reduced_volume": reducedVolume}, "sampling": {"approach": "none", "seed": 1}},
        mh.Mesh(sphere.vertices * [1, 1, stretch], sphere.triangles),
    )
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    result = minimize(simulation, force, maxIterations=9000, multilevelWeight=2)
    assert result.iterations < 9000 and result.reason in (STALLED, _CONVERGED)
    assert np.all(result.energy._value <= result.history[-1] * (1 + 1e-9))


def test_a_field_turns_a_membrane():
    """Turned as a whole, a prolate in a valley comes to lie along it."""
    field = mm.CustomExternalForce("0.5*z^2")
    for i in range(162):
        field.addParticle(i)
    mesh = mh.spheroid(162, mh.spheroidAspectRatio(0.8, "prolate"))
    force, simulation = createSimulation(mesh, 0.8, 1e4, extra=(field,))
    result = mh.minimize(simulation, force, maxIterations=1000, multilevelWeight=2)
    extent = np.ptp(positionsOf(simulation.context), axis=0)
    assert extent[2] < 0.9 * extent[:2].max(), (extent, result.reason)


def test_limits_and_the_callers_wish():
    for function in (mh.minimize, mh.minimizeFluid):
        force, simulation = createSimulation(mh.spheroid(162, 1.5), 0.9)
        start = force.getEnergyTermsInContext(simulation.context)["volume"]
        limited = function(simulation, force, maxIterations=20)
        assert limited.iterations == 20 and not limited.converged and "greatest number of iterations" in limited.reason
        assert (
            force.getVolumeModulus() / KJ == 1e6 * KAPPA
            and force.getEnergyTermsInContext(simulation.context)["volume"] < start
        )
        stopped = function(simulation, force, progress=lambda iteration, energy: iteration == 5)
        assert stopped.iterations == 5 and not stopped.converged and stopped.reason == "the caller ended it"


def test_a_tether_that_bends_the_shape_is_told():
    mesh = mh.spheroid(162, 1.5)
    force, simulation = createSimulation(mesh, 0.9, tether=(1000, 0.99, 1.0))
    (warning,) = mh.minimizeFluid(simulation, force, maxIterations=200).warnings
    assert "the tether holds" in warning and "of the bending energy" in warning


def test_a_wall_of_infinite_energy_is_no_end():
    """Where steps of the line search lead to no finite energy, the best positions so far are kept."""
    mesh = mh.spheroid(162, 1.5)
    wall = mm.CustomExternalForce("1000*(x-3)^2-1e-9*sqrt(1.5-x)")
    for i in range(len(mesh.vertices)):
        wall.addParticle(i)
    force, simulation = createSimulation(mesh, 0.9, 10, extra=[wall])
    before = simulation.context.getState(energy=True).getPotentialEnergy()
    result = mh.minimize(simulation, force, maxIterations=100)
    assert (
        result.energy <= before
        and np.all(np.isfinite(positionsOf(simulation.context)))
        and positionsOf(simulation.context)[:, 0].max() <= 1.5
    )


@pytest.mark.parametrize("function", [mh.minimize, mh.minimizeFluid])
def test_an_energy_that_is_not_finite_leaves_everything_as_it_was(function):
    mesh = mh.spheroid(162, 1.5)
    wall = mm.CustomExternalForce("sqrt(0.5-x)")
    for i in range(len(mesh.vertices)):
        wall.addParticle(i)
    force, simulation = createSimulation(mesh, 0.9, extra=[wall])
    with pytest.raises(mm.OpenMMException, match=r"nan.*must be finite"):
        function(simulation, force)
    assert np.array_equal(positionsOf(simulation.context), mesh.vertices)
    assert np.array_equal(force.getTrianglesInContext(simulation.context), mesh.triangles)
    assert force.getVolumeModulus() / KJ == 1e6 * KAPPA and simulation.integrator.getTemperature() / unit.kelvin == 300


@pytest.mark.parametrize(
    "call, problem",
    [
        (lambda s, f: mh.minimize(s, f, tolerance=0), "tolerance is 0.0 kJ/mol/nm; it must be positive"),
        (lambda s, f: mh.minimize(s, f, tolerance=math.nan), "tolerance is nan"),
        (lambda s, f: mh.minimize(s, f, maxIterations=-1), "maxIterations is -1"),
        (lambda s, f: mh.minimize(s, f, multilevelWeight=-1), "multilevel weight is -1; it must be finite, 0 or more"),
        (
            lambda s, f: mh.minimizeFluid(s, f, maxIterations=0),
            "minimizeFluid: maxIterations is 0; it must be a whole number, 1 or more",
        ),
        (lambda s, f: mh.minimizeFluid(s, f), "has a VerletIntegrator, which flips no edges"),
    ],
)
def test_what_is_refused(call, problem):
    mesh = mh.Mesh.icosphere(1)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(1)
    system = mesh.createSystem()
    system.addForce(force)
    simulation = app.Simulation(
        mesh.topology(), system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference")
    )
    simulation.context.setPositions(mesh.vertices)
    with pytest.raises(ValueError, match=problem):
        call(simulation, force)


def test_where_nothing_can_move_it_is_said():
    mesh = mh.Mesh.icosphere(1)
    force, simulation = createSimulation(mesh, 0.95)
    for particle in range(len(mesh.vertices)):
        simulation.system.setParticleMass(particle, 0)
    simulation.context.reinitialize(preserveState=True)
    for minimize in (mh.minimize, mh.minimizeFluid):
        with pytest.raises(ValueError, match="all particles of the System have mass 0; one must have another to move"):
            minimize(simulation, force)


def test_without_bending_a_tolerance_is_asked_for():
    mesh = mh.Mesh.icosphere(1)
    force, simulation = createSimulation(mesh, 0.95, 1e3)
    force.setBendingModulus(0)
    with pytest.raises(ValueError, match=r"bending modulus is 0.*give a tolerance"):
        mh.minimize(simulation, force)


@pytest.mark.parametrize("kind, low, high", [("prolate", 1, 50), ("oblate", 0.02, 1)])
def test_spheroids(kind, low, high):
    for reducedVolume in (0.5, 0.7, 0.9):
        ratio = mh.spheroidAspectRatio(reducedVolume, kind)
        mesh = mh.spheroid(642, ratio, area=7)
        mesh.check()
        assert low < ratio < high and mesh.area == pytest.approx(7)
        assert mesh.reducedVolume == pytest.approx(reducedVolume, rel=0.02)
        extent = np.ptp(mesh.vertices, axis=0)
        assert extent[2] / extent[0] == pytest.approx(ratio, rel=0.03)
        lengths = mesh.edgeLengths / mesh.edgeLengths.mean()
        assert lengths.min() > 0.7 and lengths.max() < 1.35
    assert mh.spheroidAspectRatio(1, kind) == 1


@pytest.mark.parametrize(
    "create, problem",
    [
        (lambda: mh.spheroid(5, 1), "numVertices is 5"),
        (lambda: mh.spheroid(100, 0), "aspectRatio is 0"),
        (lambda: mh.spheroid(100, 1, math.nan), "area nan"),
        (lambda: mh.spheroidAspectRatio(0.9, "pear"), "kind is 'pear'"),
        (lambda: mh.spheroidAspectRatio(1.1, "prolate"), "reducedVolume is 1.1"),
        (lambda: mh.surfaceOfRevolution([[0, 1], [1, 0], [1, -1]], 100), "begin and end on the axis"),
        (lambda: mh.surfaceOfRevolution([[0, 1, 0]], 100), r"shape \(1, 3\)"),
    ],
)
def test_shapes_that_are_refused(create, problem):
    with pytest.raises(ValueError, match=problem):
        create()
