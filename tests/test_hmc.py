"""Hybrid Monte Carlo: what a trajectory must conserve, sample, and survive."""

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import PLATFORMS, createBlob, createContext, createForce, energyOf, forcesOf, kelvin, positionsOf

ENGINES = ["native", "custom"]
KT = 2.5


def softForce(mesh):
    """Return the force of a vesicle at its own area and volume, with a bending modulus of 30 kT."""
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(30 * KT)
    force.setAreaModulus(300)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(300)
    force.setTargetVolume(mesh.volume)
    # No triangle can become a needle: two shortest edges are longer than a longest.
    force.setTether(100 * KT, 0.8 * edge, 1.25 * edge, 2)
    force.setRepulsion(KT, 0.8 * edge, 2, 1)
    return force


def createRun(engine, platform="Reference", stepSize=0.004, stepsPerTrajectory=20, flipProbability=0.0):
    mesh = mh.Mesh.icosphere(1)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), stepSize, stepsPerTrajectory, 0.2, flipProbability, engine)
    integrator.setRandomNumberSeed(5)
    force = softForce(mesh)
    return mesh, force, integrator, createContext(mesh, force, platform, integrator)


def velocitiesOf(context):
    return context.getState(velocities=True).getVelocities(asNumpy=True)._value


def energyChangeOf(integrator):
    trajectory = integrator.getMove(0)
    if isinstance(trajectory, mh.HamiltonianTrajectoryIntegrator):
        return trajectory.getLastEnergyChange() / unit.kilojoule_per_mole
    return trajectory.getGlobalVariableByName("endEnergy") - trajectory.getGlobalVariableByName("startEnergy")


def assertMean(samples, expected):
    """Assert that the mean of correlated samples is within three standard errors, by batches, which are small."""
    batches = np.array(samples).reshape(25, -1).mean(axis=1)
    error = batches.std(ddof=1) / 5
    assert error < 0.03 * abs(expected)
    assert abs(batches.mean() - expected) < 3 * error


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kT", [KT, KT / 2])
def test_energy_changes_and_kinetic_energy(engine, kT):
    """<exp(-dH/kT)> = 1, and <KE> = 3NkT/2, at the temperature that was set last."""
    mesh, force, integrator, context = createRun(engine)
    integrator.setTemperature(kelvin(kT))
    integrator.step(500)
    factors, kinetic = [], []
    for _ in range(4000):
        integrator.step(1)
        factors.append(np.exp(-energyChangeOf(integrator) / kT))
        kinetic.append(context.getState(energy=True).getKineticEnergy() / unit.kilojoule_per_mole)
    assert 0.6 < integrator.getAcceptanceRate() < 0.99
    assertMean(factors, 1)
    assertMean(np.array(kinetic) / (1.5 * len(mesh.vertices) * kT), 1)


@pytest.mark.parametrize("engine", ENGINES)
def test_acceptance_probability(engine):
    """Trajectories that change the energy by dH are accepted with the probability min(1, exp(-dH/kT))."""
    mesh, force, integrator, context = createRun(engine, stepSize=0.005)
    integrator.step(200)
    expected, variance, accepted = 0, 0, -integrator.getNumAcceptedTrajectories()
    for _ in range(8000):
        integrator.step(1)
        probability = min(1, np.exp(-energyChangeOf(integrator) / KT))
        expected += probability
        variance += probability * (1 - probability)
    accepted += integrator.getNumAcceptedTrajectories()
    assert 0.4 * 8000 < accepted < 0.8 * 8000
    assert abs(accepted - expected) < 3 * variance**0.5


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("flipProbability", [0, 0.5])
def test_virial(engine, flipProbability):
    """<sum x.grad E> = (3N-3)kT for a surface that floats freely: positions are sampled at the right temperature, with
    flips and without.
    """
    mesh, force, integrator, context = createRun(engine, "CPU", flipProbability=flipProbability)
    integrator.step(500)
    virial = []
    for _ in range(16000):
        integrator.step(4)
        x = positionsOf(context)
        virial.append(-np.sum((x - x.mean(axis=0)) * forcesOf(context)))
    assertMean(virial, (3 * len(mesh.vertices) - 3) * KT)


def test_engines_sample_the_same_energy():
    means, errors = [], []
    for engine in ENGINES:
        mesh, force, integrator, context = createRun(engine, flipProbability=0.3)
        integrator.step(500)
        energies = []
        for _ in range(4000):
            integrator.step(1)
            energies.append(energyOf(context))
        batches = np.reshape(energies, (25, -1)).mean(axis=1)
        means.append(batches.mean())
        errors.append(batches.std(ddof=1) / 5)
    assert max(errors) < 0.02 * means[0]
    assert abs(means[0] - means[1]) < 3 * np.hypot(*errors)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_reversed_trajectory_returns_to_its_start(engine, platform):
    mesh, force, integrator, context = createRun(engine, platform, stepSize=0.002, stepsPerTrajectory=100)
    integrator.step(3)
    start = positionsOf(context)
    accepted = integrator.getNumAcceptedTrajectories()
    integrator.step(1)
    assert integrator.getNumAcceptedTrajectories() == accepted + 1
    x, v = positionsOf(context), -velocitiesOf(context)
    assert np.abs(x - start).max() > 0.01
    dt = 0.002
    v += dt / 2 * forcesOf(context)
    for n in range(100):
        x += dt * v
        context.setPositions(x)
        v += (dt if n < 99 else dt / 2) * forcesOf(context)
    assert np.abs(x - start).max() < 1e-10


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_diverging_trajectory_is_rejected(engine, platform):
    mesh, force, integrator, context = createRun(engine, platform)
    integrator.step(10)
    assert integrator.getNumDivergedTrajectories() == 0
    start, energy = positionsOf(context), energyOf(context)
    accepted = integrator.getNumAcceptedTrajectories()
    for stepSize in (4, 1e100):
        integrator.setStepSize(stepSize)
        integrator.step(3)
    assert integrator.getNumTrajectories() == 16
    assert integrator.getNumAcceptedTrajectories() == accepted
    assert integrator.getNumDivergedTrajectories() >= 3
    assert np.array_equal(positionsOf(context), start)
    assert np.all(np.isfinite(velocitiesOf(context)))
    assert energyOf(context) == energy
    assert context.getStepCount() == 16
    integrator.setStepSize(0.004)
    integrator.step(10)
    assert integrator.getNumAcceptedTrajectories() > accepted
    assert np.all(np.isfinite(positionsOf(context)))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_divergence_of_another_force_is_rejected(engine, platform):
    """An energy that is not a number, with no error."""
    mesh = mh.Mesh.icosphere(1)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.004, 8, 0.2, 0, engine)
    wall = mm.CustomExternalForce("sqrt(1.5-x)")
    for i in range(len(mesh.vertices)):
        wall.addParticle(i)
    context = createContext(mesh, [softForce(mesh), wall], platform, integrator)
    integrator.step(2)
    start = positionsOf(context)
    integrator.setStepSize(0.7)
    integrator.step(5)
    assert integrator.getNumDivergedTrajectories() > 0
    assert np.array_equal(positionsOf(context), start)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_start_whose_energy_is_not_finite_is_an_error(engine):
    mesh, force, integrator, context = createRun(engine)
    x = mesh.vertices.copy()
    x[5] = x[20]
    context.setPositions(x)
    with pytest.raises(mm.OpenMMException, match=r"not finite.*repulsion inf"):
        integrator.step(1)
    assert np.array_equal(positionsOf(context), x)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_rejection_reverses_velocities(engine):
    """Moves beside may keep them, and a trajectory that does is exact with reversed ones alone."""
    found, mesh = [], mh.Mesh.icosphere(1)
    for stepSize, steps, accepted in ((0.3, 2, 0), (1e-9, 1, 1)):
        integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), stepSize, steps, engine=engine, flipProbability=0)
        integrator.setRandomNumberSeed(3)
        context = createContext(mesh, softForce(mesh), "Reference", integrator)
        integrator.step(1)
        assert integrator.getNumAcceptedTrajectories() == accepted
        found.append(velocitiesOf(context))
    assert found[0] == pytest.approx(-found[1], rel=1e-5)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_frozen_vertices(engine, platform):
    mesh = mh.Mesh.icosphere(1)
    frozen = np.arange(0, len(mesh.vertices), 3)
    system = mesh.createSystem()
    for i in frozen:
        system.setParticleMass(int(i), 0)
    system.addForce(softForce(mesh))
    integrator = mh.HybridMonteCarloIntegrator(300, 0.004, 8, 0.2, 0.3, engine)
    integrator.setRandomNumberSeed(3)
    context = mm.Context(system, integrator, mm.Platform.getPlatform(platform))
    context.setPositions(mesh.vertices)
    kinetic = []
    for _ in range(300):
        integrator.step(1)
        kinetic.append(context.getState(energy=True).getKineticEnergy() / unit.kilojoule_per_mole)
    moved = np.any(positionsOf(context) != mesh.vertices, axis=1)
    assert np.array_equal(np.flatnonzero(~moved), frozen)
    assert np.all(velocitiesOf(context)[frozen] == 0)
    assert np.mean(kinetic) == pytest.approx(1.5 * (len(mesh.vertices) - len(frozen)) * 300 / kelvin(1), rel=0.1)


@pytest.mark.parametrize("engine", ENGINES)
def test_share_of_sweeps(engine):
    for probability, low, high in ((0, 0, 0), (1, 200, 200), (0.25, 30, 70)):
        mesh, force, integrator, context = createRun(engine, flipProbability=probability)
        integrator.step(200)
        sweeps = integrator.getFlipIntegrator().getNumSweeps()
        assert low <= sweeps <= high
        assert integrator.getNumTrajectories() == 200 - sweeps
        assert context.getStepCount() == 200
        assert integrator.getFlipIntegrator().getNumAttempted() == 24 * sweeps


def test_annealing_reaches_the_flips():
    """Peers have flipped at T = 1 whatever the temperature of the rest."""
    rates = []
    for kT in (1000 * KT, 100 * KT, 10 * KT):
        mesh, force, integrator, context = createRun("native", flipProbability=1)
        integrator.setTemperature(kelvin(kT))
        assert integrator.getFlipIntegrator().getTemperature() / unit.kelvin == pytest.approx(kelvin(kT))
        integrator.step(50)
        rates.append(integrator.getFlipAcceptanceRate())
    assert rates[0] > 1.5 * rates[1] > 1.5 * 1.5 * rates[2] > 0


def test_threads_make_no_difference():
    mesh = createBlob(3)
    results = []
    for threads in ("1", "2", "3"):
        integrator = mh.HybridMonteCarloIntegrator(30000, 0.00001, 10, 0.2, 0.5)
        integrator.setRandomNumberSeed(3)
        force = createForce(mesh)
        context = createContext(mesh, force, "CPU", integrator, {"Threads": threads})
        integrator.step(10)
        assert integrator.getNumAcceptedTrajectories() > 0
        results.append((positionsOf(context), velocitiesOf(context), force.getTrianglesInContext(context)))
    for result in results[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(result, results[0]))


def test_simulation_and_reporters(tmp_path):
    mesh = mh.Mesh.icosphere(1)
    system = mesh.createSystem()
    system.addForce(softForce(mesh))
    integrator = mh.HybridMonteCarloIntegrator(300, 0.004, 8)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    simulation.reporters.append(app.DCDReporter(str(tmp_path / "run.dcd"), 5))
    simulation.reporters.append(
        app.StateDataReporter(str(tmp_path / "run.csv"), 5, step=True, potentialEnergy=True, kineticEnergy=True)
    )
    simulation.step(23)
    assert simulation.currentStep == simulation.context.getStepCount() == 23
    lines = (tmp_path / "run.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines[1:]] == ["5", "10", "15", "20"]
    assert (tmp_path / "run.dcd").stat().st_size > 4 * 12 * len(mesh.vertices)


@pytest.mark.parametrize("engine", ENGINES)
def test_constraints_and_virtual_sites_are_refused(engine):
    mesh = mh.Mesh.icosphere(1)
    for spoil, problem in (
        (lambda system: system.addConstraint(0, 1, 1), "constraint"),
        (
            lambda system: (
                system.setParticleMass(3, 0),
                system.setVirtualSite(3, mm.TwoParticleAverageSite(0, 1, 0.5, 0.5)),
            ),
            "particle 3.*virtual site",
        ),
    ):
        system = mesh.createSystem()
        system.addForce(softForce(mesh))
        spoil(system)
        with pytest.raises(mm.OpenMMException, match=problem):
            mm.Context(
                system,
                mh.HybridMonteCarloIntegrator(300, 0.01, 10, engine=engine),
                mm.Platform.getPlatform("Reference"),
            )
