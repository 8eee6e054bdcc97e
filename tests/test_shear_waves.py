"""Shear waves: moves that keep volumes, go back the way they came, and sample the Boltzmann distribution."""

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import PLATFORMS, createContext, energyOf, forcesOf, kelvin, positionsOf
from openmmhelfrich.runs.config import parseConfig
from test_hmc import KT, assertMean, softForce, velocitiesOf


def freeContext(positions, waves, mass=1.0):
    """Return a Context of particles on which nothing acts, so that every move is accepted."""
    system = mm.System()
    for _ in positions:
        system.addParticle(mass)
    context = mm.Context(system, waves, mm.Platform.getPlatform("Reference"))
    context.setPositions(positions)
    return context


def createWaves(amplitude=0.1, least=1.0, greatest=4.0, moves=1, kT=KT, seed=5):
    waves = mh.ShearWaveIntegrator(kelvin(kT), amplitude, least, greatest, moves)
    waves.setRandomNumberSeed(seed)
    return waves


def displacementsOf(positions, numWaves, **settings):
    """Return what each of the first waves does to particles at given positions, in turn."""
    waves = createWaves(**settings)
    context, results = freeContext(positions, waves), []
    for _ in range(numWaves):
        context.setPositions(positions)
        waves.step(1)
        results.append(positionsOf(context) - positions)
    return np.array(results)


def createRun(flipProbability=0.0, probability=0.4, amplitude=0.02, moves=5, platform="Reference", mesh=None):
    mesh = mesh or mh.Mesh.icosphere(1)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), 0.004, 10, 0.2, flipProbability)
    integrator.addShearWaves(mh.ShearWaveIntegrator(300, amplitude, 1, 4, moves), probability)
    integrator.setTemperature(kelvin(KT))
    integrator.setRandomNumberSeed(5)
    force = softForce(mesh)
    return mesh, force, integrator, createContext(mesh, force, platform, integrator)


def test_the_opposite_wave_leads_back():
    """Displaced particles meet the same wave: that of the opposite amplitude takes them back."""
    x = np.random.default_rng(1).normal(size=(50, 3))
    for n, u in enumerate(displacementsOf(x, 10)):
        again = displacementsOf(x + u, n + 1)[n]
        assert np.abs(u).max() > 1e-3
        assert np.abs(x + u - again - x).max() < 1e-14


def test_jacobian_is_1():
    random, h = np.random.default_rng(2), 1e-5
    centers = random.normal(size=(20, 3))
    x = np.concatenate([centers + h * sign * axis for axis in np.eye(3) for sign in (1, -1)])
    for u in displacementsOf(x, 20, amplitude=0.5):
        plus, minus = np.moveaxis((x + u).reshape(3, 2, 20, 3), 1, 0)
        jacobians = np.moveaxis((plus - minus) / (2 * h), 0, 2)
        assert np.abs(jacobians - np.eye(3)).max() > 1e-3
        assert np.linalg.det(jacobians) == pytest.approx(1, abs=1e-8)


def test_waves():
    """u(x) = a d sin(k.x+phi): d is perpendicular to k, |k| uniform between its bounds, a Gaussian with the standard
    deviation that is asked for at the least |k|.
    """
    h, least, greatest = 0.001, 2.0, 6.0
    x = np.concatenate(
        [np.zeros((1, 3)), h * np.eye(3), -h * np.eye(3), np.random.default_rng(3).uniform(-10, 10, (400, 3))]
    )
    k, strain = [], []
    for u in displacementsOf(x, 400, amplitude=0.3, least=least, greatest=greatest):
        _, scale, axes = np.linalg.svd(u)
        assert scale[1] < 1e-13  # all along d
        wave = u @ axes[0]
        squares = 2 * (1 - (wave[1:4] + wave[4:7]) / (2 * wave[0])) / h**2
        gradient = wave[1:4] - wave[4:7]
        assert abs(gradient @ axes[0]) < 1e-4 * np.linalg.norm(gradient)
        if abs(wave[0]) > 0.1 * np.abs(wave).max():
            k.append(np.sqrt(squares.sum()))
            strain.append(np.sqrt(2 * np.mean(wave[7:] ** 2)) * k[-1])
    k, strain = np.array(k), np.array(strain)
    assert least * 0.99 < k.min() < 2.1 and 5.9 < k.max() < greatest * 1.01
    assert np.histogram(k, 4, (least, greatest))[0] == pytest.approx(len(k) / 4, abs=4 * (len(k) * 3 / 16) ** 0.5)
    for half in (k < 4, k >= 4):
        assert np.sqrt(np.mean(strain[half] ** 2)) == pytest.approx(0.3 * least, rel=0.2)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_harmonic_wells(platform):
    """Waves alone sample wells of known variance: kT/K for each coordinate."""
    stiffness, centers = 100.0, np.random.default_rng(4).normal(size=(4, 3))
    system, well = mm.System(), mm.CustomExternalForce("0.5*k*((x-x0)^2+2*(y-y0)^2+4*(z-z0)^2)")
    well.addGlobalParameter("k", stiffness)
    for name in ("x0", "y0", "z0"):
        well.addPerParticleParameter(name)
    for i, center in enumerate(centers):
        system.addParticle(1)
        well.addParticle(i, center)
    system.addForce(well)
    waves = createWaves(0.3, 1, 6, 40)
    context = mm.Context(system, waves, mm.Platform.getPlatform(platform))
    context.setPositions(centers)
    waves.step(50)
    x = []
    for _ in range(2500):
        waves.step(1)
        x.append(positionsOf(context) - centers)
    assert 0.1 < waves.getNumAccepted() / waves.getNumAttempted() < 0.9
    for axis, factor in enumerate((1, 2, 4)):
        assertMean(np.mean(np.square(x)[:, :, axis], axis=1) * factor * stiffness / KT, 1)


def test_membrane():
    """<sum x.grad E> = (3N-3)kT, and <E> is that of trajectories alone.

    With flips so few vertices fold now and then, and stay so for long.
    """
    means, errors = [], []
    for probability in (0.4, 0):
        mesh, force, integrator, context = createRun(0, probability)
        integrator.step(500)
        samples = []
        for _ in range(3500):
            integrator.step(4)
            x = positionsOf(context)
            samples.append((-np.sum((x - x.mean(axis=0)) * forcesOf(context)), energyOf(context)))
        batches = np.reshape(samples, (25, -1, 2)).mean(axis=1)
        means.append(batches.mean(axis=0))
        errors.append(batches.std(axis=0, ddof=1) / 5)
        assert (integrator.getShearWaveAcceptanceRate() > 0.2) == (probability > 0)
    means, errors, virial = np.array(means), np.array(errors), (3 * len(mesh.vertices) - 3) * KT
    assert np.all(errors < 0.05 * means)
    assert np.all(np.abs(means[:, 0] - virial) < 3 * errors[:, 0])
    assert abs(means[0, 1] - means[1, 1]) < 3 * np.hypot(*errors[:, 1])


@pytest.mark.parametrize("platform", PLATFORMS)
def test_rejected_moves_leave_no_trace(platform):
    mesh, force, integrator, context = createRun(platform=platform, flipProbability=0, probability=0.5)
    integrator.step(20)
    waves = integrator.getShearWaveIntegrator()
    start = positionsOf(context), velocitiesOf(context), energyOf(context)
    integrator.setShearWaveProbability(1)
    accepted = waves.getNumAccepted()
    for amplitude in (10, 1e160):
        waves.setAmplitude(amplitude)
        integrator.step(4)
        assert waves.getNumAccepted() == accepted
        assert waves.getLastAcceptanceProbability() < 1e-3
        assert all(
            np.array_equal(a, b)
            for a, b in zip((positionsOf(context), velocitiesOf(context), energyOf(context)), start)
        )
    assert waves.getNumDiverged() >= 20
    assert context.getStepCount() == 28


def test_a_start_whose_energy_is_not_finite_is_an_error():
    mesh, force, integrator, context = createRun(probability=1)
    x = mesh.vertices.copy()
    x[5] = x[20]
    context.setPositions(x)
    with pytest.raises(mm.OpenMMException, match="not finite"):
        integrator.step(1)
    assert np.array_equal(positionsOf(context), x)


def test_frozen_vertices_stay():
    mesh = mh.Mesh.icosphere(1)
    system, waves = mesh.createSystem(), createWaves(0.02, moves=50)
    for i in range(0, 42, 3):
        system.setParticleMass(i, 0)
    system.addForce(softForce(mesh))
    context = mm.Context(system, waves, mm.Platform.getPlatform("Reference"))
    context.setPositions(mesh.vertices)
    waves.step(1)
    assert waves.getNumAccepted() > 0
    moved = np.any(positionsOf(context) != mesh.vertices, axis=1)
    assert np.array_equal(np.flatnonzero(~moved), np.arange(0, 42, 3))


def test_platforms_and_threads_make_the_same_moves():
    mesh, results = mh.Mesh.icosphere(3), []
    for platform, properties in (("Reference", {}), ("CPU", {"Threads": "1"}), ("CPU", {"Threads": "3"})):
        waves = createWaves(0.01, moves=30)
        context = createContext(mesh, softForce(mesh), platform, waves, properties)
        waves.step(2)
        assert 0 < waves.getNumAccepted() < 60
        results.append((positionsOf(context), waves.getNumAccepted()))
    assert np.abs(results[0][0] - results[1][0]).max() < 1e-12
    assert results[0][1] == results[1][1] and np.array_equal(results[1][0], results[2][0])


def test_share_of_moves():
    mesh, force, integrator, context = createRun(0.25, 0.5)
    integrator.step(200)
    waves, sweeps = (
        integrator.getShearWaveIntegrator().getNumAttempted() / 5,
        integrator.getFlipIntegrator().getNumSweeps(),
    )
    assert 75 < waves < 125 and 30 < sweeps < 70
    assert integrator.getNumTrajectories() + sweeps + waves == context.getStepCount() == 200


def test_a_probability_of_0_changes_nothing():
    results = []
    for hasWaves in (False, True):
        mesh = mh.Mesh.icosphere(1)
        integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), 0.004, 10, 0.2, 0.3)
        if hasWaves:
            integrator.addShearWaves(createWaves(), 0)
        integrator.setRandomNumberSeed(5)
        context = createContext(mesh, softForce(mesh), integrator=integrator)
        integrator.step(50)
        results.append(positionsOf(context))
    assert np.array_equal(*results)


def test_constraints_and_virtual_sites_are_refused():
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
        system = mm.System()
        for _ in range(4):
            system.addParticle(1)
        spoil(system)
        with pytest.raises(mm.OpenMMException, match="ShearWaveIntegrator.*" + problem):
            mm.Context(system, createWaves(), mm.Platform.getPlatform("Reference"))


def test_one_integrator_for_waves():
    integrator, waves = mh.HybridMonteCarloIntegrator(300, 0.1, flipProbability=0.5), createWaves()
    with pytest.raises(mm.OpenMMException, match="no ShearWaveIntegrator; call addShearWaves"):
        integrator.setShearWaveProbability(0.1)
    with pytest.raises(mm.OpenMMException, match="add up to more than 1"):
        integrator.addShearWaves(waves, 0.6)
    assert waves.thisown and integrator.getNumMoves() == 2
    integrator.addShearWaves(waves, 0.2)
    assert not waves.thisown and isinstance(integrator.getMove(2), mh.ShearWaveIntegrator)
    with pytest.raises(mm.OpenMMException, match="has a ShearWaveIntegrator already"):
        integrator.addShearWaves(createWaves(), 0.2)
    with pytest.raises(ValueError, match="belongs to another"):
        mh.HybridMonteCarloIntegrator(300, 0.1).addShearWaves(waves, 0.2)
    with pytest.raises(mm.OpenMMException, match="add up to more than 1"):
        integrator.setFlipProbability(0.9)
    for temperature in (400 * unit.kelvin,):
        integrator.setTemperature(temperature)
        assert integrator.getShearWaveIntegrator().getTemperature() == temperature


def createSimulation(probability=0.5, amplitude=1.0, moves=5):
    mesh = mh.Mesh.icosphere(1)
    system, integrator = mesh.createSystem(), mh.HybridMonteCarloIntegrator(kelvin(KT), 0.004, 10, 0.2, 0)
    integrator.addShearWaves(mh.ShearWaveIntegrator(kelvin(KT), amplitude, 1, 4, moves), probability)
    integrator.setRandomNumberSeed(5)
    system.addForce(softForce(mesh))
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("Reference"))
    simulation.context.setPositions(mesh.vertices)
    return simulation


@pytest.mark.parametrize("amplitude", [10.0, 1e-5])
def test_amplitude_adapts(amplitude):
    simulation = createSimulation(amplitude=amplitude)
    result, waves = mh.adaptStepSize(simulation, 500), simulation.integrator.getShearWaveIntegrator()
    assert waves.getAmplitude() == result.amplitude * unit.nanometer and 0.003 < result.amplitude < 0.3
    attempted, accepted = waves.getNumAttempted(), waves.getNumAccepted()
    simulation.step(600)
    assert (waves.getNumAccepted() - accepted) / (waves.getNumAttempted() - attempted) == pytest.approx(0.25, abs=0.1)


def test_too_short_a_burn_in_changes_nothing():
    simulation = createSimulation(0.02)
    with pytest.raises(ValueError, match="search for the amplitude has not ended"):
        mh.adaptStepSize(simulation, 40)
    integrator = simulation.integrator
    assert (
        integrator.getStepSize() == 0.004 * unit.picosecond
        and integrator.getShearWaveIntegrator().getAmplitude() == 1 * unit.nanometer
    )


def test_waves_that_are_rare_in_a_burn_in_are_not_warned_of(recwarn):
    """Their acceptance is within what so few scatter."""
    simulation = createSimulation(0.1, 0.05)
    assert mh.adaptStepSize(simulation, 120).amplitude is not None
    assert simulation.integrator.getShearWaveIntegrator().getNumAttempted() < 5 * 20 and not recwarn.list


def configure(prefix, **sampling):
    return parseConfig(
        {
            "mesh": {"icosphere": 1, "length_unit": "um"},
            "membrane": {"area_modulus": 1e3, "volume_modulus": 1e3},
            "platform": {"name": "Reference"},
            "output": {"prefix": str(prefix), "mesh_trajectory": False, "observables_interval": 1},
            "sampling": {
                "steps": 400,
                "burn_in": 200,
                "seed": 4,
                "flip_probability": 0.2,
                "steps_per_trajectory": 10,
                "shear_waves_per_step": 8,
                **sampling,
            },
        }
    )


@pytest.mark.parametrize("amplitude", ["auto", 0.05, "50 nm"])
def test_configuration(amplitude, tmp_path):
    """An amplitude stays as it is, or adapts in the burn-in and is said in the end."""
    summary = mh.run(configure(tmp_path / "run", shear_wave_probability=0.5, shear_wave_amplitude=amplitude))
    amplitudes, accepted = summary.table["waveAmplitude"], summary.table["waveAcceptance"]
    assert 0.05 < accepted[-1] < 0.95
    if amplitude == "auto":
        assert len(np.unique(amplitudes[:200])) > 50 and len(np.unique(amplitudes[250:])) == 1
        assert any(
            f"amplitude {amplitudes[-1]:.4g} um, chosen for an acceptance of 25%" in note for note in summary.notes
        )
    else:
        assert np.all(amplitudes == 0.05) and not any("amplitude" in note for note in summary.notes)


def test_probabilities_of_a_configuration(tmp_path):
    with pytest.raises(
        ValueError,
        match=r"\[sampling\] flip_probability is 0.2 and shear_wave_probability 0.9; they must not add up to more than "
        r"1",
    ):
        configure(tmp_path / "run", shear_wave_probability=0.9)
