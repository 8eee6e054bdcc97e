"""Replica exchange: exact distributions at every temperature and target, exact exchanges, restarts."""

import io
import itertools
import json
import math
import re
import signal
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import createForce, energyOf, kelvin, positionsOf
from openmmhelfrich.sampling.replicaexchange import ReplicaExchange, ThermodynamicState
from test_flips import energiesOf, enumerateStates, octahedron, softForce, stateOf


def simulate(mesh, force, integrator, platform="CPU"):
    system = mesh.createSystem()
    system.addForce(force)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform(platform))
    simulation.context.setPositions(mesh.vertices)
    return simulation


def flippingOctahedra(temperatures):
    """Return an exchange of frozen vertices with a few flips a round, so that the exchanges do much of the mixing."""
    mesh = octahedron()
    simulations = []
    for k in range(len(temperatures)):
        flips = mh.EdgeFlipIntegrator(300, 3 / len(mesh.edges))
        flips.setRandomNumberSeed(k + 1)
        simulations.append(simulate(mesh, softForce(mesh, False), flips))
    return ReplicaExchange(simulations, [ThermodynamicState(kelvin(kT)) for kT in temperatures])


def deviations(exchange, expected, rounds=3000):
    """Return by how many standard errors, from batches, the mean energy of each state deviates."""
    exchange.run(rounds, 1)
    energies = exchange.potentialEnergies(discard=50)
    batches = np.array([[batch.mean() for batch in np.array_split(row, 25)] for row in energies])
    return (batches.mean(axis=1) - expected) / (batches.std(axis=1, ddof=1) / 5)


TEMPERATURES = [0.3, 0.5, 0.9]


def exactMeanEnergies():
    """Return the mean energies of the octahedron's triangulations, all of which are known."""
    mesh = octahedron()
    energies = energiesOf(mesh, enumerateStates(stateOf(mesh.triangles)), False)
    weights = [np.exp((energies.min() - energies) / kT) for kT in TEMPERATURES]
    return np.array([w @ energies / w.sum() for w in weights])


def test_distributions_are_exact():
    exchange = flippingOctahedra(TEMPERATURES)
    assert np.abs(deviations(exchange, exactMeanEnergies())).max() < 3
    assert np.all((exchange.acceptanceRates > 0.2) & (exchange.acceptanceRates < 0.9))


def test_the_test_of_distributions_sees_a_wrong_exchange(monkeypatch):
    exchange = flippingOctahedra(TEMPERATURES)
    right = exchange._exchange
    monkeypatch.setattr(exchange, "_exchange", lambda u: right(0.5 * u))
    assert np.abs(deviations(exchange, exactMeanEnergies(), 2000)).max() > 5


def oscillators(stiffness, temperature=300, seed=1):
    """Return an exchange of particles on springs, whose stiffness is a parameter."""
    simulations = []
    for k in range(len(stiffness)):
        system = mm.System()
        system.addParticle(1)
        spring = mm.CustomExternalForce("0.5*k*(x^2+y^2+z^2)")
        spring.addGlobalParameter("k", 1)
        spring.addParticle(0)
        system.addForce(spring)
        integrator = mh.HamiltonianTrajectoryIntegrator(temperature, 0.03, 4)
        integrator.setRandomNumberSeed(k + 1)
        topology = app.Topology()
        topology.addAtom("A", None, topology.addResidue("A", topology.addChain()))
        simulations.append(app.Simulation(topology, system, integrator, mm.Platform.getPlatform("Reference")))
        simulations[-1].context.setPositions([[0.1, 0, 0]])
    return ReplicaExchange(simulations, [ThermodynamicState(temperature, {"k": k}) for k in stiffness], seed)


def test_parameters():
    """Free energies of oscillators, 1.5 ln k, from the energies in all states; and each energy is 3/2 kT in its own."""
    mbar = pytest.importorskip("pymbar").MBAR
    stiffness = [50, 100, 200, 400]
    exchange = oscillators(stiffness)
    exchange.run(2000, 2)
    u, counts = exchange.samples(discard=20, stride=2)
    for k in range(4):
        own = u[k].reshape(4, -1)[k]
        assert abs(own.mean() - 1.5) < 3 * own.std() / math.sqrt(len(own)), k
    free = mbar(u, counts).compute_free_energy_differences()
    exact = 1.5 * np.log(np.array(stiffness) / stiffness[0])
    assert (
        np.all(np.abs(free["Delta_f"][0] - exact) < 3 * free["dDelta_f"][0] + 1e-12) and free["dDelta_f"][0].max() < 0.1
    )


def test_exchanges_have_the_probability_that_the_formula_gives():
    exchange = oscillators([50, 150, 450])
    exchange.run(3000, 1)
    history, u = exchange.history, exchange.reducedEnergies
    assert np.all(np.sort(history, axis=1) == [0, 1, 2]) and len({tuple(row) for row in history}) == 6
    expected = variance = accepted = 0
    for n in range(len(history) - 1):
        i = n % 2
        a, b = np.argsort(history[n])[[i, i + 1]]
        p = min(1, math.exp(u[n, a, i] + u[n, b, i + 1] - u[n, b, i] - u[n, a, i + 1]))
        expected, variance = expected + p, variance + p * (1 - p)
        hasExchanged = history[n + 1, a] == i + 1 and history[n + 1, b] == i
        assert hasExchanged or np.array_equal(history[n], history[n + 1])
        accepted += hasExchanged
    assert abs(accepted - expected) < 3 * math.sqrt(variance) and 0.2 < accepted / 3000 < 0.9
    assert exchange.acceptanceRates @ [1500, 1500] == pytest.approx(accepted, abs=1)


def test_velocities_follow_the_temperature():
    exchange = oscillators([50, 50])
    exchange.simulations[0].context.setVelocities([[1, 2, 3]])
    exchange.states[1] = ThermodynamicState(1200, {"k": 50.0}, 0.01)
    exchange._enter(0, 1)
    context = exchange.simulations[0].context
    assert context.getState(velocities=True).getVelocities()[0].value_in_unit(
        unit.nanometer / unit.picosecond
    ) == pytest.approx((2, 4, 6))
    integrator = exchange.simulations[0].integrator
    assert integrator.getTemperature() == 1200 * unit.kelvin and integrator.getStepSize() == 0.01 * unit.picosecond


def test_forces_that_are_not_integrated_do_not_count():
    """Energies are of the groups that moves follow; a force in another group would drive replicas apart."""
    exchange = oscillators([50, 50])
    field = mm.CustomExternalForce("60*x")
    field.addParticle(0)
    field.setForceGroup(1)
    for simulation in exchange.simulations:
        simulation.system.addForce(field.__copy__())
        simulation.context.reinitialize(preserveState=True)
        simulation.integrator.setIntegrationForceGroups({0})
    exchange.simulations[0].context.setPositions([[0.5, 0, 0]])
    exchange._propagate(1)
    x = exchange.simulations[0].context.getState(positions=True).getPositions(asNumpy=True)._value
    kT = exchange.states[0].thermalEnergy
    assert exchange._energiesOf(0) == pytest.approx(0.5 * 50 * np.sum(x**2) / kT, rel=1e-6)


@pytest.mark.parametrize("name", ["_enter", "_energiesOf", "_observe"])
def test_an_interrupt_ends_a_run_between_exchanges(monkeypatch, name):
    """However it comes: no two replicas are in one state, each has the parameters of its own, and rows are whole."""
    exchange, calls = vesicles(), itertools.count(1)
    original = getattr(exchange, name)

    def interrupted(*arguments):
        if next(calls) == 5:
            signal.raise_signal(signal.SIGINT)
        return original(*arguments)

    monkeypatch.setattr(exchange, name, interrupted)
    with pytest.raises(KeyboardInterrupt):
        exchange.run(500, 1)
    assert sorted(exchange.replicaStates) == [0, 1, 2]
    assert exchange.numRounds == len(exchange._made) == len(exchange._observed) == len(exchange._energies) < 500
    for replica, membrane in enumerate(exchange._membranes):
        own = exchange.states[exchange.replicaStates[replica]].parameters
        assert membrane.current(own) == pytest.approx(own)
    exchange.run(2, 1)


def coarseVelocitiesIn(simulation):
    state = mm.XmlSerializer.serialize(simulation.context.getState(integratorParameters=True))
    found = [dict(node.attrib) for node in ElementTree.fromstring(state).iter("Velocity")]
    return np.array([[float(node[axis]) for axis in "xyz"] for node in found if "level" in node])


def test_velocities_of_coarser_meshes_follow_the_temperature():
    """Momenta that are kept would else bring the temperature of the one state into the other."""
    exchange = vesicles()
    for simulation in exchange.simulations:
        simulation.integrator.setMultilevelWeight(2)
        simulation.integrator.setMomentumRefreshment(0.1)
        simulation.step(3)
    before = [coarseVelocitiesIn(simulation) for simulation in exchange.simulations]
    exchange._enter(0, 1)
    exchange._enter(1, 0)
    after = [coarseVelocitiesIn(simulation) for simulation in exchange.simulations]
    for k, factor in enumerate([math.sqrt(1.1), math.sqrt(1 / 1.1), 1]):
        assert len(before[k]) > 4 and after[k] == pytest.approx(factor * before[k], rel=1e-12)


def test_dynamics_takes_over_the_temperature():
    mesh, simulations = mh.Mesh.icosphere(1), []
    for _ in range(2):
        integrator = mh.HybridMonteCarloIntegrator(
            mm.LangevinMiddleIntegrator(300, 1, 0.001), mh.EdgeFlipIntegrator(300, 0.1)
        )
        simulations.append(simulate(mesh, createForce(mesh), integrator))
    ReplicaExchange(simulations, [ThermodynamicState(310), ThermodynamicState(320)])
    for simulation, temperature in zip(simulations, (310, 320)):
        for k in range(2):
            assert simulation.integrator.getMove(k).getTemperature() == temperature * unit.kelvin


def vesicles(subdivisions=1, stepSize=0.002, **changes):
    """Return an exchange of vesicles, of different temperatures and target volumes."""
    mesh = mh.Mesh.icosphere(subdivisions)
    simulations, states = [], []
    for k, (temperature, volume) in enumerate([(300, 1.0), (330, 0.95), (330, 0.9)]):
        force = createForce(mesh)
        integrator = mh.HybridMonteCarloIntegrator(300, stepSize * (k + 1), 10, 0.3)
        integrator.setRandomNumberSeed(k + 1)
        simulations.append(simulate(mesh, force, integrator))
        states.append(
            ThermodynamicState(
                temperature * unit.kelvin,
                {force.getTargetVolumeParameter(): 4 * volume, force.getTargetAreaParameter(): 12.0},
            )
        )
    return ReplicaExchange(simulations, states, **{"seed": 5, **changes})


def everythingIn(exchange):
    contexts = [simulation.context for simulation in exchange.simulations]
    forces = [mh.HelfrichForce.cast(simulation.system.getForce(0)) for simulation in exchange.simulations]
    return [
        exchange.history.tolist(),
        exchange.reducedEnergies.tolist(),
        exchange.replicaStates.tolist(),
        exchange.acceptanceRates.tolist(),
        [positionsOf(c).tolist() for c in contexts],
        [f.getTrianglesInContext(c).tolist() for f, c in zip(forces, contexts)],
        [dict(c.getParameters()) for c in contexts],
        [exchange.observables(k)["area"].tolist() for k in range(len(contexts))],
        [exchange.counters(k) for k in range(len(contexts))],
        [exchange.displacement(k) for k in range(len(contexts))],
        str(exchange.verdict),
        [simulation.currentStep for simulation in exchange.simulations],
    ]


def test_restart(tmp_path):
    """A run that is saved and loaded goes on as one that was not interrupted, with its step sizes, and so does one with
    two workers.
    """
    whole, first, second, threaded = vesicles(), vesicles(), vesicles(stepSize=0.003), vesicles(workers=2)
    whole.run(9, 4)
    threaded.run(9, 4)
    first.run(5, 4, tmp_path / "exchange.zip", 2)
    second.load(tmp_path / "exchange.zip")
    assert everythingIn(second) == everythingIn(first) and second.states == first.states
    second.run(4, 4)
    assert everythingIn(second) == everythingIn(whole) == everythingIn(threaded)
    assert len({tuple(row) for row in whole.history}) > 1
    assert [path.name for path in tmp_path.iterdir()] == ["exchange.zip"]


def spheres(temperatures=(300, 330), steps=200, volume=0.95, **sampling):
    """Return an exchange of thermal vesicles of 162 vertices."""
    simulations, mesh = [], mh.Mesh.icosphere(2)
    for seed, temperature in enumerate(temperatures, 1):
        own = {"seed": seed, "steps_per_trajectory": 20, "step_size": 1e-3, **sampling}
        config = {"membrane": {"reduced_volume": volume}, "sampling": own, "platform": {"threads": 1}}
        scene = mh.Scene.of(config, mesh)
        simulations.append(scene.createSimulation(scene.createForce()))
        simulations[-1].integrator.setTemperature(temperature)
        simulations[-1].step(200)
    exchange = ReplicaExchange(simulations, [ThermodynamicState(temperature) for temperature in temperatures], seed=3)
    exchange.run(steps // 5, 5)
    return exchange


def test_a_good_exchange():
    exchange = spheres()
    assert exchange.verdict.level == "good" and [verdict.level for verdict in exchange.verdicts] == ["good"] * 2
    lines = dict(exchange.lines())
    assert lines["verdict"] == "good" and lines["state 1"].startswith("330 K: accepted trajectories ")
    assert "exchanges with the next" in lines["state 0"] and "exchanges" not in lines["state 1"]
    assert str(exchange).splitlines()[-1].split() == ["verdict", "good"] and "<th" in exchange._repr_html_()
    assert spheres(steps=5).verdict.level == "doubtful"


def test_observables_and_counters_are_those_of_a_state():
    exchange = spheres((300, 301))
    assert exchange.acceptanceRates[0] > 0.5
    counters = [exchange.counters(k) for k in range(2)]
    moves = [simulation.integrator.getMove(k) for simulation in exchange.simulations for k in range(2)]
    tried = sum(move.getNumAttempted() for move in moves)
    assert 0 < sum(c.trajectories + c.flips for c in counters) < tried
    exchange.run(3, 5)
    after = [exchange.counters(k) for k in range(2)]
    made = sum(move.getNumAttempted() for move in moves) - tried
    assert sum(c.trajectories + c.flips for c in after) - sum(c.trajectories + c.flips for c in counters) == made
    late = [exchange.counters(k, discard=40) for k in range(2)]
    assert [np.subtract(a, b).tolist() for a, b in zip(after, counters)] == [list(c) for c in late]
    assert not any(exchange.counters(0, discard=43))
    for k, _state in enumerate(exchange.states):
        rows, own = (
            exchange.observables(k),
            exchange.reducedEnergies[np.arange(43), np.argsort(exchange.history)[:, k], k],
        )
        assert rows["energy"] == pytest.approx(own, rel=1e-12) and list(rows["step"]) == list(range(1, 44))
        assert len(exchange.observables(k, discard=15)["step"]) == 28


@pytest.mark.parametrize(
    "make, level, words",
    [
        (lambda: spheres(step_size=2e-2), "failed", r"in state 0 only 0.0% of the traj.*and so in 1"),
        (
            lambda: spheres((300, 3000), step_size=3e-4),
            "doubtful",
            "0 of 20 exchanges between the states 0 and 1 were accepted, too few to tell",
        ),
        (lambda: spheres((300, 3000), step_size=3e-4), "doubtful", "no replica has come from one end"),
        (
            lambda: spheres(volume=0.6, approach="none"),
            "failed",
            "in state 0 the volume is .* off its target.*and so in 1",
        ),
        (lambda: spheres(steps=20), "doubtful", "in state 0 averages are over 2 rows.*make more rounds"),
    ],
)
def test_what_is_not_good_is_told(make, level, words):
    verdict = make().verdict
    assert verdict.level == level and re.search(words, str(verdict)), str(verdict)


def test_a_state_that_freezes_is_told():
    """Enough are accepted all in all, and none of the last."""
    exchange = spheres(steps=200)
    exchange.states = [replace(state, stepSize=0.02) for state in exchange.states]
    for replica, state in enumerate(exchange.replicaStates.tolist()):
        exchange._enter(replica, state)
    exchange.run(40, 5)
    words = r"in state 0 of the last \d+ trajectories 0 were accepted, and 4\d% of all.*and so in 1"
    assert exchange.verdict.level == "failed" and re.search(words, str(exchange.verdict)), str(exchange.verdict)


def test_passages():
    exchange = oscillators([50, 60, 70])
    assert exchange.verdict is None and exchange.verdicts == []
    exchange._history = [np.array(row) for row in ([0, 1, 2], [1, 0, 2], [2, 0, 1], [2, 1, 0], [1, 2, 0])]
    assert exchange.numPassages == 3  # 0 to 2 of the first, 0 to 2 of the second, 2 to 0 of the third


def test_files_of_the_first_format(tmp_path):
    """They tell nothing of observables and counters, and what follows is judged."""
    exchange, file = spheres(steps=50), tmp_path / "exchange.zip"
    exchange.save(file)
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    data, rounds = json.loads(parts["exchange.json"]), np.load(io.BytesIO(parts["rounds.npz"]))
    old = io.BytesIO()
    np.savez(old, history=rounds["history"], reducedEnergies=rounds["reducedEnergies"])
    parts["rounds.npz"] = old.getvalue()
    new = {"columns", "counters"}
    parts["exchange.json"] = json.dumps({k: v for k, v in data.items() if k not in new} | {"format": 1}).encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    loaded = spheres(steps=0)
    loaded.load(file)
    assert loaded.numRounds == 10 and loaded.verdict is None and len(loaded.observables(0)["step"]) == 0
    assert not any(loaded.counters(0))
    loaded.run(2, 5)
    exchange.run(2, 5)
    assert list(loaded.observables(1)["step"]) == [11, 12] and loaded.verdict.level == "doubtful"
    assert list(loaded.observables(1)["area"]) == list(exchange.observables(1, discard=10)["area"])


def test_files_of_the_second_format(tmp_path):
    """They have the sums of the counters, which count as those of the last round."""
    exchange, file = spheres(steps=50), tmp_path / "exchange.zip"
    sums = [exchange.counters(k) for k in range(2)]
    exchange.save(file)
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    data, rounds = json.loads(parts["exchange.json"]), dict(np.load(io.BytesIO(parts["rounds.npz"])))
    del rounds["counters"]
    old = io.BytesIO()
    np.savez(old, **rounds)
    parts["rounds.npz"] = old.getvalue()
    parts["exchange.json"] = json.dumps(data | {"format": 2, "counters": [list(c) for c in sums]}).encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    loaded = spheres(steps=0)
    loaded.load(file)
    assert [loaded.counters(k) for k in range(2)] == sums == [loaded.counters(k, discard=9) for k in range(2)]
    loaded.run(2, 5)
    exchange.run(2, 5)
    assert [loaded.counters(k) for k in range(2)] == [exchange.counters(k) for k in range(2)]
    assert [loaded.counters(k, discard=10) for k in range(2)] == [exchange.counters(k, discard=10) for k in range(2)]


def test_energies_in_other_states():
    """They are those of the replica's shape with the parameters of that state, and afterwards its own are back."""
    exchange = vesicles()
    exchange.run(1, 5)
    state = exchange.history[0]
    for a, simulation in enumerate(exchange.simulations):
        for i, other in enumerate(exchange.states):
            for name, value in other.parameters.items():
                simulation.context.setParameter(name, value)
            assert exchange.reducedEnergies[0, a, i] == pytest.approx(
                energyOf(simulation.context) / other.thermalEnergy, rel=1e-13
            )
    assert exchange.states[state[1]].stepSize == 0.002 * (state[1] + 1)


@pytest.mark.parametrize(
    "make, problem",
    [
        (lambda: ReplicaExchange([], []), "0 simulations and 0 states; there must be two or more"),
        (lambda: ReplicaExchange(vesicles().simulations, [ThermodynamicState(300)]), "3 simulations and 1 states"),
        (
            lambda: ReplicaExchange(vesicles().simulations[:1] * 2, [ThermodynamicState(300)] * 2),
            "a simulation is given twice",
        ),
        (
            lambda: ReplicaExchange(vesicles().simulations[:2], [ThermodynamicState(300), ThermodynamicState(-1)]),
            "the temperature is -1 K",
        ),
        (
            lambda: ReplicaExchange(
                vesicles().simulations[:2], [ThermodynamicState(300), ThermodynamicState(300, {"x": 1})]
            ),
            r"state 1 has the parameters \['x'\]; they must be those of state 0",
        ),
        (
            lambda: ReplicaExchange(vesicles().simulations[:2], [ThermodynamicState(300, {"x": 1})] * 2),
            "state 0: there is no parameter 'x'; it must be one of .*TargetVolume",
        ),
        (lambda: oscillators([1, math.nan]), "in state 1 the parameter 'k' is nan"),
        (lambda: vesicles(seed=-1), "seed is -1"),
        (lambda: vesicles(workers=0), "workers is 0"),
        (lambda: vesicles().run(-1, 1), "rounds is -1"),
        (lambda: vesicles().run(1, 0.5), "steps is 0.5"),
        (lambda: vesicles().run(1, 1, interval=0), "interval is 0"),
    ],
)
def test_bad_input(make, problem):
    with pytest.raises(ValueError, match=problem):
        make()


def scenes(*sections):
    """Return a simulation for each of some sections of a configuration."""
    simulations = []
    for section in sections:
        scene = mh.Scene.of({"sampling": {"seed": 1, "approach": "none"}, **section}, mh.Mesh.icosphere(1))
        simulations.append(scene.createSimulation(scene.createForce()))
    return simulations


def test_replicas_must_have_the_same_energy():
    """What a Context has of its own may differ if the states have it; moduli in kT of each temperature are an error."""
    states = [ThermodynamicState(300), ThermodynamicState(330)]
    with pytest.raises(ValueError, match="the forces of simulation 1 are not those of simulation 0"):
        ReplicaExchange(scenes({}, {"membrane": {"bending_modulus": 22}}), states)
    volumes = [{"membrane": {"reduced_volume": v}} for v in (0.9, 0.92)]
    with pytest.raises(ValueError, match=r"'HelfrichForceTargetVolume' is 3.44\d+ in simulation 1 and 3.37\d+ in"):
        ReplicaExchange(scenes(*volumes), states)
    ladder = [ThermodynamicState(300, {"HelfrichForceTargetVolume": volume}) for volume in (3.37, 3.44)]
    exchange = ReplicaExchange(scenes(*volumes), ladder)
    exchange.run(1, 5)  # now the triangles differ, too
    ReplicaExchange(exchange.simulations, ladder).run(1, 1)


SPECIES = [{"name": "a", "fraction": 0.3}, {"name": "b", "spontaneous_curvature": 2.0}]


def test_replicas_may_have_other_species_and_spontaneous_curvatures():
    """They are a Context's own, while the moduli of the species are not."""
    sections = [{"species": SPECIES, "membrane": {"spontaneous_curvature": c}} for c in (0.0, 0.3)]
    sections[1]["sampling"] = {"seed": 2, "approach": "none"}
    ladder = [ThermodynamicState(300, {"HelfrichForceSpontaneousCurvature": c}) for c in (0.0, 0.3)]
    exchange = ReplicaExchange(scenes(*sections), ladder)
    exchange.run(2, 2)
    assert "crumpled" not in str(exchange.verdict) and exchange.numRounds == 2
    other = {**sections[0], "species": [SPECIES[0], {**SPECIES[1], "spontaneous_curvature": 2.5}]}
    with pytest.raises(ValueError, match="the forces of simulation 1 are not those of simulation 0"):
        ReplicaExchange(scenes(sections[0], other), ladder)
    more = [{**SPECIES[0], "fraction": 0.5}, SPECIES[1]]
    with pytest.raises(
        ValueError, match=r"simulation 1 have \[21, 21\] vertices, and those of simulation 0 \[13, 29\]"
    ):
        ReplicaExchange(scenes(sections[0], {**sections[0], "species": more}), ladder)
    mutations = {"seed": 1, "approach": "none", "exchange_probability": 0.3, "exchange_proposal": "mutation"}
    sections = [{"species": species, "sampling": mutations} for species in (SPECIES, more)]
    ReplicaExchange(scenes(*sections), ladder).run(1, 1)
    for section in sections:
        section["species"] = [section["species"][0], {**section["species"][1], "chemical_potential": 1.0}]
    ReplicaExchange(scenes(*sections), ladder).run(1, 1)
    plain = [{"membrane": {"spontaneous_curvature": c}} for c in (0.0, 0.3)]
    ReplicaExchange(scenes(*plain), ladder).run(1, 1)


@pytest.mark.parametrize("rounds", [0, 3])
def test_an_exchange_without_a_membrane_is_saved(tmp_path, rounds):
    exchange, again = oscillators([50, 60]), oscillators([50, 60])
    exchange.run(rounds, 1, tmp_path / "exchange.zip")
    exchange.save(tmp_path / "exchange.zip")
    again.load(tmp_path / "exchange.zip")
    assert again.numRounds == rounds and np.array_equal(again.history, exchange.history)
    assert str(again) == str(exchange)


def test_an_integrator_without_temperature():
    system = mm.System()
    system.addParticle(1)
    simulations = [
        app.Simulation(app.Topology(), system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference"))
        for _ in range(2)
    ]
    with pytest.raises(ValueError, match="simulation 0, a VerletIntegrator, has no temperature"):
        ReplicaExchange(simulations, [ThermodynamicState(300)] * 2)


def test_an_energy_that_is_not_a_number():
    exchange = oscillators([1, 2])
    exchange.simulations[1].context.setPositions([[math.inf, 0, 0]])
    with pytest.raises((ValueError, mm.OpenMMException), match=r"not finite|must be numbers|NaN"):
        exchange.run(1, 1)
    assert exchange.numRounds == 0


def test_files_that_do_not_fit(tmp_path):
    exchange = vesicles()
    exchange.run(2, 2)
    exchange.save(tmp_path / "a.zip")
    before = everythingIn(exchange)
    (tmp_path / "b.zip").write_bytes((tmp_path / "a.zip").read_bytes()[:3000])
    with pytest.raises(FileNotFoundError, match=r"c.zip"):
        exchange.load(tmp_path / "c.zip")
    with pytest.raises(ValueError, match=r"b.zip is not a file that ReplicaExchange.save wrote"):
        exchange.load(tmp_path / "b.zip")
    with pytest.raises(ValueError, match="has the seed 5; here it is 6"):
        vesicles(seed=6).load(tmp_path / "a.zip")
    with pytest.raises(ValueError, match="has the temperatures and parameters"):
        oscillators([1, 2, 3], seed=5).load(tmp_path / "a.zip")
    larger = vesicles(2)
    with pytest.raises(ValueError, match=r"replica 0 of .*a.zip has 42 particles; here it has 162"):
        larger.load(tmp_path / "a.zip")
    assert larger.numRounds == 0
    assert everythingIn(exchange) == before
