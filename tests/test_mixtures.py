"""What samples, adapts, leads and minimizes works with any mixture of moves, whatever their number and order."""

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import kelvin

KT = 2.5
T = kelvin(KT)


def createTrajectories():
    return mh.HamiltonianTrajectoryIntegrator(T, 0.1, 10)


def createCustom():
    return mh.CustomTrajectoryIntegrator(T, 0.1, 10)


def createWaves():
    return mh.ShearWaveIntegrator(T, 1.0, 1, 3, 3)


def createFlips(fraction=0.2):
    return mh.EdgeFlipIntegrator(T, fraction)


def createLangevin():
    return mm.LangevinMiddleIntegrator(T, 1, 1e-4)


def mix(first, *others):
    integrator = mh.HybridMonteCarloIntegrator(first)
    for move, probability in others:
        integrator.addMove(move, probability)
    integrator.setRandomNumberSeed(5)
    return integrator


# How an integrator is made, and where in it the trajectories, the flips and the waves are, if anywhere.
MIXTURES = {
    "trajectories alone": (createTrajectories, (), None, None),
    "one trajectory": (lambda: mix(createTrajectories()), (0,), None, None),
    "no flips": (lambda: mix(createTrajectories(), (createWaves(), 0.4)), (0,), None, (1,)),
    "flips after waves": (
        lambda: mix(createTrajectories(), (createWaves(), 0.3), (createFlips(), 0.2)),
        (0,),
        (2,),
        (1,),
    ),
    "trajectories last": (
        lambda: mix(createFlips(), (createWaves(), 0.3), (createTrajectories(), 0.4)),
        (2,),
        (0,),
        (1,),
    ),
    "two of flips": (
        lambda: mix(createCustom(), (createFlips(), 0.2), (createFlips(1.0), 0.1), (createWaves(), 0.3)),
        (0,),
        (1,),
        (3,),
    ),
    "dynamics between": (
        lambda: mix(createTrajectories(), (createLangevin(), 0.1), (createFlips(), 0.3)),
        (0,),
        (2,),
        None,
    ),
    "mixture in a mixture": (
        lambda: mix(createLangevin(), (mix(createTrajectories(), (createFlips(), 0.2), (createWaves(), 0.3)), 0.9)),
        (1, 0),
        (1, 1),
        (1, 2),
    ),
}


def createSimulation(integrator):
    mesh = mh.Mesh.icosphere(1)
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(20 * KT)
    force.setAreaModulus(1e4 * KT)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(1e4 * KT)
    force.setTargetVolume(0.95 * mesh.volume)
    force.setTether(1000 * KT, 0.75 * edge, 1.3 * edge, 2)
    system = mesh.createSystem()
    system.addForce(force)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("Reference"))
    simulation.context.setPositions(mesh.vertices)
    return simulation, force


def at(integrator, place):
    """Return the move at a place, None if there is none."""
    if place is None:
        return None
    for index in place:
        integrator = integrator.getMove(index)
    return integrator


@pytest.fixture(params=MIXTURES)
def mixture(request):
    """A Simulation, its force, and its trajectories, flips and waves."""
    create, *places = MIXTURES[request.param]
    simulation, force = createSimulation(create())
    return simulation, force, *(at(simulation.integrator, place) for place in places)


def test_moves_of_a_kind_have_their_own_numbers():
    """With one seed trajectories would draw the momenta of those before, and mixtures in a mixture make its choice."""
    inner = mh.HybridMonteCarloIntegrator(mh.HamiltonianTrajectoryIntegrator(300, 1e-3, 5))
    mixture = mh.HybridMonteCarloIntegrator(300, 1e-3, 5)
    for move in (mh.HamiltonianTrajectoryIntegrator(300, 1e-3, 5), inner, mh.EdgeFlipIntegrator(300, 0.1)):
        mixture.addMove(move, 0.1)
    mixture.setRandomNumberSeed(7)
    moves = [mixture.getMove(index) for index in range(mixture.getNumMoves())]
    trajectories, flips, second, within, more = (move.getRandomNumberSeed() for move in moves)
    inside = mh.HybridMonteCarloIntegrator.cast(moves[3]).getMove(0).getRandomNumberSeed()
    assert mixture.getRandomNumberSeed() == trajectories == flips == 7
    assert len({7, second, within}) == 3 and more not in (0, flips) and inside == within
    mixture.setRandomNumberSeed(7)
    assert [move.getRandomNumberSeed() for move in moves] == [7, 7, second, within, more]
    mixture.setRandomNumberSeed(0)
    assert not any(move.getRandomNumberSeed() for move in moves)


def test_two_trajectory_moves_sample_a_spring():
    """Springs of 1 to 10 kT, from equilibrium: the mean energy, over 3/2 kT, of two moves that get one seed."""
    stiffnesses = np.geomspace(1, 10, 50)
    system, spring = mm.System(), mm.CustomExternalForce("0.5*k*(x^2+y^2+z^2)")
    spring.addPerParticleParameter("k")
    for particle, stiffness in enumerate(stiffnesses):
        system.addParticle(1)
        spring.addParticle(particle, [stiffness * KT])
    system.addForce(spring)
    means = []
    for seed in range(1, 13):
        mixture = mh.HybridMonteCarloIntegrator(mh.HamiltonianTrajectoryIntegrator(T, 0.1, 5))
        mixture.addMove(mh.HamiltonianTrajectoryIntegrator(T, 0.1, 5), 0.5)
        mixture.setRandomNumberSeed(seed)
        context = mm.Context(system, mixture, mm.Platform.getPlatform("Reference"))
        context.setPositions(np.random.default_rng(seed).normal(size=(50, 3)) / np.sqrt(stiffnesses)[:, np.newaxis])
        energies = []
        for _ in range(300):
            mixture.step(1)
            energies.append(context.getState(energy=True).getPotentialEnergy()._value / KT / 75)
        means.append(np.mean(energies))
    assert abs(np.mean(means) - 1) < 4 * np.std(means, ddof=1) / 12**0.5 < 0.1, (np.mean(means), means)


def test_columns(mixture, tmp_path):
    simulation, force, trajectories, flips, waves = mixture
    simulation.reporters.append(mh.ObservablesReporter(tmp_path / "a.csv", 10, force))
    trajectories.setStepSize(0.004)
    if waves:
        waves.setAmplitude(0.02)
    simulation.step(200)
    last = {name: column[-1] for name, column in mh.readObservables(tmp_path / "a.csv").items()}
    expected = {}
    if trajectories is not simulation.integrator:
        expected |= {"acceptance": trajectories.getAcceptanceRate(), "diverged": trajectories.getNumDiverged()}
    if flips:
        forbidden = flips.getNumForbidden() / flips.getNumAttempted()
        expected |= {"flipAcceptance": flips.getAcceptanceRate(), "flipRate": flips.getFlipRate()}
        expected |= {"flipsForbidden": forbidden}
    if waves:
        expected |= {"waveAcceptance": waves.getAcceptanceRate(), "waveAmplitude": 0.02}
    assert {name: last[name] for name in list(last)[list(last).index("meanCurvature") + 1 :]} == expected
    assert all(move is None or move.getAcceptanceRate() > 0 for move in (trajectories, flips, waves))


def test_adaptation(mixture):
    simulation, _, trajectories, _, waves = mixture
    result = mh.adaptStepSize(simulation, 400)
    assert trajectories.getStepSize() == result.stepSize * unit.picosecond
    assert len(result.probabilities) == trajectories.getNumAttempted()
    assert 0.6 < result.acceptance < 0.9 and 0.001 < result.stepSize < 0.02
    assert (result.amplitude is None) == (waves is None)
    if waves:
        assert waves.getAmplitude() == result.amplitude * unit.nanometer and 0.003 < result.amplitude < 0.3


def test_too_short_a_burn_in_changes_nothing(mixture):
    simulation, _, trajectories, _, waves = mixture
    with pytest.raises(ValueError, match="has not ended"):
        mh.adaptStepSize(simulation, 2)
    assert trajectories.getStepSize() == 0.1 * unit.picosecond
    assert waves is None or waves.getAmplitude() == 1.0 * unit.nanometer


def test_waves_that_are_never_made_do_not_adapt():
    waves = createWaves()
    simulation, _ = createSimulation(mix(createTrajectories(), (waves, 0)))
    assert mh.adaptStepSize(simulation, 60).amplitude is None
    assert waves.getAmplitude() == 1.0 * unit.nanometer


def test_annealing(mixture):
    simulation, _, trajectories, flips, waves = mixture
    trajectories.setStepSize(0.004)
    result = mh.anneal(simulation, mh.ExponentialSchedule.over(60, T, T / 4), 60)
    assert np.isfinite(result.probabilities).sum() == trajectories.getNumAttempted() > 0
    assert trajectories.getStepSize() != 0.004 * unit.picosecond
    for move in filter(None, (trajectories, flips, waves)):
        assert move.getTemperature() == result.temperatures[-1] * unit.kelvin


def test_continuation(mixture):
    simulation, force, trajectories, *_ = mixture
    trajectories.setStepSize(0.004)
    result = mh.continueTo(simulation, force, {"reducedVolume": 0.9}, windows=2, equilibration=5, steps=10)
    assert list(result.windows["window"]) == [0, 1, 2] and np.isfinite(result.windows["energy"]).all()


def test_minimization(mixture):
    simulation, force, _, flips, _ = mixture
    simulation.integrator.setTemperature(123)
    if flips is None:
        with pytest.raises(ValueError, match="which flips no edges; it needs an EdgeFlipIntegrator"):
            mh.minimizeFluid(simulation, force)
        return
    fraction = flips.getFraction()
    assert mh.minimizeFluid(simulation, force).converged
    assert flips.getNumAttempted() > 0
    assert flips.getTemperature() == 123 * unit.kelvin and flips.getFraction() == fraction


@pytest.mark.parametrize("name", MIXTURES)
def test_replica_exchange(name):
    create, *places = MIXTURES[name]
    simulations = [createSimulation(create())[0] for _ in range(2)]
    states = [mh.ThermodynamicState(k * T, stepSize=0.002 * k) for k in (1, 2)]
    exchange = mh.ReplicaExchange(simulations, states, seed=3)
    exchange.run(4, 5)
    for simulation, state in zip(simulations, exchange.replicaStates):
        trajectories, *others = (at(simulation.integrator, place) for place in places)
        assert trajectories.getStepSize() == states[state].stepSize * unit.picosecond
        for move in filter(None, (trajectories, *others)):
            assert move.getTemperature() == states[state].temperature * unit.kelvin


def test_replicas_without_a_temperature():
    simulations = [createSimulation(mix(mm.VerletIntegrator(1e-4)))[0] for _ in range(2)]
    with pytest.raises(ValueError, match="simulation 0, a HybridMonteCarloIntegrator, has no temperature"):
        mh.ReplicaExchange(simulations, [mh.ThermodynamicState(T)] * 2)
