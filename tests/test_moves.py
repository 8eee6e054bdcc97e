"""Mixtures of any moves, and the live state of membranes, which every Monte Carlo move saves."""

import numpy as np
import openmm as mm
import pytest

import openmmhelfrich as mh
from conftest import together
from membranes import PLATFORMS, createBlob, createContext, createForce, energyOf, positionsOf

T = 3000


def createTrajectories():
    return mh.HamiltonianTrajectoryIntegrator(T, 0.0001, 3)


def createWaves():
    return mh.ShearWaveIntegrator(T, 0.001, 1, 3, 2)


def createFlips():
    return mh.EdgeFlipIntegrator(T, 0.1)


def createCustom():
    return mh.CustomTrajectoryIntegrator(T, 0.0001, 3)


def createLangevin():
    return mm.LangevinMiddleIntegrator(T, 1, 0.0001)


def mixture(first, *others):
    integrator = mh.HybridMonteCarloIntegrator(first)
    for move, probability in others:
        integrator.addMove(move, probability)
    integrator.setRandomNumberSeed(5)
    return integrator


def compound(*integrators):
    result = mm.CompoundIntegrator()
    for integrator in integrators:
        result.addIntegrator(integrator)
    return result


INTEGRATORS = {
    "trajectories": createTrajectories,
    "waves": createWaves,
    "custom": createCustom,
    "flips": createFlips,
    "mixture without flips": lambda: mixture(createTrajectories(), (createWaves(), 0.5)),
    "mixture of others": lambda: mixture(createLangevin(), (mm.VerletIntegrator(0.0001), 0.5)),
    "mixture": lambda: mixture(createCustom(), (createFlips(), 0.3), (createWaves(), 0.3)),
    "mixture in a mixture": lambda: mixture(createLangevin(), (mh.HybridMonteCarloIntegrator(T, 0.0001, 3), 0.5)),
    "compound": lambda: compound(createLangevin(), createWaves(), createFlips()),
    "mixture in a compound": lambda: compound(createLangevin(), mixture(createTrajectories()), createFlips()),
}


def createChanged(create, platform, numMembranes=1):
    """Return a Context with other triangles than its forces have, the forces and the triangles."""
    blob, forces = createBlob(1), []
    mesh = together(*[blob] * numMembranes)
    for i in range(numMembranes):
        forces.append(createForce(blob))
        forces[-1].setTriangles(blob.triangles + i * len(blob.vertices))
        forces[-1].setName(f"Vesicle{i}")
    context = createContext(mesh, forces, platform, create())
    changed = []
    for i, force in enumerate(forces):
        changed.append(np.roll(force.getTriangles(), i + 1, axis=0))
        force.setTrianglesInContext(context, changed[-1])
    return context, forces, changed


def assertTriangles(context, forces, expected):
    for force, triangles in zip(forces, expected):
        assert np.array_equal(force.getTrianglesInContext(context), triangles)


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_live_triangles_are_saved_by_all_integrators(name, platform):
    context, forces, changed = createChanged(INTEGRATORS[name], platform, 2)
    originals = [force.getTriangles() for force in forces]
    checkpoint, state = context.createCheckpoint(), context.getState(positions=True, integratorParameters=True)
    context.reinitialize(preserveState=True)
    assertTriangles(context, forces, changed)
    for restore in (
        lambda: context.loadCheckpoint(checkpoint),
        lambda: context.setState(mm.XmlSerializer.deserialize(mm.XmlSerializer.serialize(state))),
    ):
        context.reinitialize(preserveState=True)
        for force, triangles in zip(forces, originals):
            force.setTrianglesInContext(context, triangles)
        restore()
        assertTriangles(context, forces, changed)
    context.getIntegrator().step(2)
    assert np.isfinite(energyOf(context))


@pytest.mark.parametrize("name", INTEGRATORS)
def test_live_triangles_are_saved_once(name):
    context, forces, changed = createChanged(INTEGRATORS[name], "Reference", 2)
    checkpoint, state = context.createCheckpoint(), context.getState(integratorParameters=True)
    assert [checkpoint.count(triangles.astype(np.int32).tobytes()) for triangles in changed] == [1, 1]
    assert mm.XmlSerializer.serialize(state).count("<Triangles") == 2


@pytest.mark.parametrize("name", INTEGRATORS)
def test_a_run_that_is_continued_is_the_uninterrupted_one(name):
    context, forces, _ = createChanged(INTEGRATORS[name], "Reference")
    integrator, results = context.getIntegrator(), []
    integrator.step(5)
    checkpoint = context.createCheckpoint()
    for _ in range(2):
        integrator.step(5)
        results.append((positionsOf(context), forces[0].getTrianglesInContext(context)))
        context.loadCheckpoint(checkpoint)
    assert all(np.array_equal(a, b) for a, b in zip(*results))


@pytest.mark.parametrize("platform", PLATFORMS)
def test_systems_without_membranes(platform):
    """Moves of positions need no HelfrichForce, and a sweep of flips has one error that says that it does."""
    system, well = mm.System(), mm.CustomExternalForce("x^2+y^2+z^2")
    for i in range(4):
        system.addParticle(1)
        well.addParticle(i)
    system.addForce(well)
    integrator = mixture(createTrajectories(), (createWaves(), 0.3), (createCustom(), 0.3))
    context = mm.Context(system, integrator, mm.Platform.getPlatform(platform))
    context.setPositions(np.eye(4, 3))
    integrator.step(10)
    checkpoint, x = context.createCheckpoint(), positionsOf(context)
    context.setState(context.getState(positions=True, velocities=True, integratorParameters=True))
    context.reinitialize(preserveState=True)
    integrator.step(5)
    context.loadCheckpoint(checkpoint)
    assert np.array_equal(positionsOf(context), x)
    with pytest.raises(mm.OpenMMException, match="EdgeFlipIntegrator: the System has no HelfrichForce"):
        mm.Context(system, createFlips(), mm.Platform.getPlatform(platform))


def test_shares_of_four_moves():
    waves, langevin = createWaves(), createLangevin()
    integrator = mixture(createTrajectories(), (createFlips(), 0.2), (waves, 0.3), (createCustom(), 0.1))
    mesh = createBlob(1)
    context = createContext(mesh, createForce(mesh), integrator=integrator)
    integrator.step(1000)
    moves = [integrator.getMove(index) for index in range(integrator.getNumMoves())]
    kinds = [mh.HamiltonianTrajectoryIntegrator, mh.EdgeFlipIntegrator, mh.ShearWaveIntegrator]
    assert [type(move) for move in moves] == [*kinds, mh.CustomTrajectoryIntegrator]
    counts = [
        moves[0].getNumTrajectories(),
        moves[1].getNumSweeps(),
        moves[2].getNumAttempted() // 2,
        moves[3].getNumTrajectories(),
    ]
    assert sum(counts) == context.getStepCount() == 1000
    shares = np.array([0.4, 0.2, 0.3, 0.1])
    assert np.all(np.abs(counts - 1000 * shares) < 4 * np.sqrt(1000 * shares * (1 - shares)))
    assert [integrator.getMoveProbability(i) for i in range(4)] == pytest.approx(shares)
    for move in moves:
        assert 0 < move.getAcceptanceRate() == move.getNumAccepted() / move.getNumAttempted() <= 1
    assert integrator.getAcceptanceRate() == moves[0].getAcceptanceRate()
    with pytest.raises(mm.OpenMMException, match="cannot be called after"):
        integrator.addMove(langevin, 0.1)
    assert langevin.thisown and not waves.thisown


def test_a_probability_can_be_set_at_any_time():
    integrator = mixture(createTrajectories(), (createWaves(), 0.2), (createLangevin(), 0.2))
    mesh = createBlob(1)
    context = createContext(mesh, createForce(mesh), integrator=integrator)
    integrator.setMoveProbability(1, 0.8)
    assert integrator.getShearWaveProbability() == integrator.getMoveProbability(1) == 0.8
    assert integrator.getMoveProbability(0) == 0
    integrator.step(20)
    assert integrator.getNumTrajectories() == 0 and context.getStepCount() == 20


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda i: i.addMove(createWaves(), 1.5), "the probability of move 2 is 1.5.*between 0 and 1"),
        (lambda i: i.addMove(createWaves(), 0.6), "probability of move 2, 0.6.*add up to more than 1, to 1.1"),
        (lambda i: i.setMoveProbability(1, -1), "the probability of move 1 is -1.*between 0 and 1"),
        (lambda i: i.setMoveProbability(0, 0.1), "the probability of move 0 cannot be set"),
        (lambda i: i.setMoveProbability(2, 0.1), "no move 2; there are 2"),
        (lambda i: i.getMoveProbability(-1), "no move -1; there are 2"),
        (lambda i: i.addMove(None, 0.1), "no Integrator to add"),
    ],
)
def test_what_a_mixture_refuses(call, words):
    integrator = mixture(createTrajectories(), (createFlips(), 0.5))
    with pytest.raises(mm.OpenMMException, match=words):
        call(integrator)
    assert integrator.getNumMoves() == 2 and integrator.getMoveProbability(1) == 0.5


def test_a_move_belongs_to_one_mixture():
    waves = createWaves()
    with pytest.raises(mm.OpenMMException):
        mixture(createTrajectories()).addMove(waves, 2)
    assert waves.thisown
    integrator = mixture(createTrajectories(), (waves, 0.1))
    with pytest.raises(ValueError, match="the ShearWaveIntegrator belongs to another integrator already"):
        mixture(createTrajectories()).addMove(waves, 0.1)
    assert integrator.getNumMoves() == 2


def test_a_mixture_without_flips():
    integrator = mixture(createTrajectories(), (createWaves(), 0.5))
    assert integrator.getFlipProbability() == integrator.getFlipAcceptanceRate() == 0
    for call in (integrator.getFlipIntegrator, integrator.getFlipFraction, lambda: integrator.setFlipProbability(0.1)):
        with pytest.raises(mm.OpenMMException, match="it has no EdgeFlipIntegrator"):
            call()


def test_methods_of_the_moves():
    """A method that a mixture lacks is that of the first move that has it."""
    integrator = mixture(createTrajectories(), (createWaves(), 0.3), (createLangevin(), 0.2))
    integrator.setAmplitude(0.02)
    assert integrator.getAmplitude() == integrator.getMove(1).getAmplitude() == 0.02 * mm.unit.nanometer
    assert integrator.getFriction() == integrator.getMove(2).getFriction()
    assert integrator.getSplitting() == "leapfrog"
    assert {"getAmplitude", "getFriction", "getSplitting", "addShearWaves", "addMove"} <= set(dir(integrator))
    assert not hasattr(integrator, "getFraction") and not hasattr(integrator, "_secret")
    with pytest.raises(AttributeError, match="'HybridMonteCarloIntegrator' object has no attribute 'getFraction'"):
        integrator.getFraction()
    assert "HamiltonianTrajectoryIntegrator.setSplitting" in mh.HybridMonteCarloIntegrator.setSplitting.__doc__


def test_a_temperature_for_all_moves():
    integrator = mixture(createLangevin(), (createWaves(), 0.1), (createCustom(), 0.1), (createFlips(), 0.1))
    integrator.setTemperature(250)
    temperatures = [integrator.getMove(i).getTemperature()._value for i in range(4)]
    assert temperatures == [T, 250, 250, 250] and integrator.getTemperature()._value == 250
    with pytest.raises(mm.OpenMMException, match="no move with a temperature"):
        mixture(createLangevin()).getTemperature()


def test_checkpoints_of_other_mixtures_are_refused():
    mesh = createBlob(1)
    integrators = (
        mixture(createTrajectories(), (createWaves(), 0.3)),
        mixture(createTrajectories(), (createWaves(), 0.3), (createFlips(), 0.3)),
        mixture(createTrajectories(), (createFlips(), 0.3)),
    )
    contexts = [createContext(mesh, createForce(mesh), integrator=integrator) for integrator in integrators]
    for context in contexts:
        context.getIntegrator().step(3)
        for other in contexts:
            if other is not context:
                with pytest.raises(mm.OpenMMException):
                    context.loadCheckpoint(other.createCheckpoint())
        context.getIntegrator().step(3)
        assert np.isfinite(energyOf(context))


def createSweeps(hasSpecies):
    """Return a mixture of trajectories and small sweeps."""
    moves = [createFlips()] + [mh.SpeciesExchangeIntegrator(T, 0.2) for _ in range(2 * hasSpecies)]
    for move in moves[2:]:
        move.setProposal("mutation")
    return mixture(createTrajectories(), *((move, 0.2) for move in moves))


@pytest.mark.parametrize("threads", ["1", "2"])
@pytest.mark.parametrize("hasSpecies", [False, True])
def test_sweeps_know_of_whatever_happened(hasSpecies, threads):
    """What a sweep keeps of trajectories and earlier sweeps is what a Context without a past computes."""
    mesh = createBlob(3)
    force = createForce(mesh, ("bending", "area", "volume", "tether"))
    if hasSpecies:
        force.addSpecies(40, 0.5, -10)
        force.addSpecies(10, -0.5, 5)
        force.setLineTension(0, 1, 20)
        force.setVertexSpecies((mesh.vertices[:, 0] > 0).astype(int))
    integrator = createSweeps(hasSpecies)
    context = createContext(mesh, force, "CPU", integrator, {"Threads": threads})
    moves = [integrator.getIntegrator(i) for i in range(integrator.getNumIntegrators())]

    def rejectTrajectory():
        moves[0].setStepSize(1)
        moves[0].step(1)
        moves[0].setStepSize(0.0001)

    def change(set):
        set()
        force.updateParametersInContext(context)

    triangles = force.getTrianglesInContext(context)
    events = [lambda move=move: move.step(1) for move in moves] * 2 + [
        lambda: moves[1].step(3),
        rejectTrajectory,
        lambda: context.setPositions(1.01 * positionsOf(context)),
        lambda: context.setParameter(force.getSpontaneousCurvatureParameter(), 0.3),
        lambda: change(lambda: force.setTether(0, 0, 1, 2)),
        lambda: change(lambda: force.setAreaModulus(0)),
        lambda: force.setTrianglesInContext(context, triangles),
        lambda: None,
    ]
    if hasSpecies:
        events += [
            lambda: change(lambda: force.setSpeciesParameters(1, 30, 0.1, 5)),
            lambda: change(lambda: force.setLineTension(0, 1, 0)),
            lambda: change(lambda: force.setPairEnergy(0, 1, 3)),
            lambda: force.setVertexSpeciesInContext(context, force.getVertexSpeciesInContext(context)[::-1]),
        ]
    for event in events + events[::-1]:
        event()
        system = mm.XmlSerializer.deserialize(mm.XmlSerializer.serialize(context.getSystem()))
        fresh = mm.Context(system, createSweeps(hasSpecies), context.getPlatform(), {"Threads": "1"})
        fresh.loadCheckpoint(context.createCheckpoint())
        outcomes = []
        for each in (context, fresh):
            own = mh.HelfrichForce.cast(each.getSystem().getForce(0))
            for i in range(1, len(moves)):
                each.getIntegrator().getIntegrator(i).step(1)
            outcomes.append(
                [own.getTrianglesInContext(each).tolist(), own.getVertexSpeciesInContext(each).tolist()]
                + [each.getIntegrator().getIntegrator(i).getNumAccepted() for i in range(1, len(moves))]
            )
        assert outcomes[0] == outcomes[1]
        assert energyOf(context) == energyOf(fresh)
    assert all(move.getNumAccepted() > 100 for move in moves[1:])
