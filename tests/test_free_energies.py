"""Free energies over the parameters of species: against sums over all placements on six vertices."""

import copy

import numpy as np
import openmm as mm
import pytest
from openmm import app

import openmmhelfrich as mh
from membranes import createBlob, createContext, energyOf, kelvin
from openmmhelfrich.analysis.freeenergies import freeEnergies, reducedEnergies
from test_flips import octahedron, stateOf
from test_species_exchange import SmallMembranes, addSpecies, createExchange, softForce, softModel

# With so much of each term, many placements are as good as likely.
SCALES = {"bending": 0.004, "gaussian": 0.05, "line": 0.02, "pair": 0.02}
# What states have of each parameter: three states that differ in all of them.
LADDER = {
    "bending_modulus[1]": [0.05, 0.15, 0.25],
    "spontaneous_curvature[0]": [0.0, -0.6, -1.2],
    "gaussian_modulus[1]": [0.25, 0.15, 0.05],
    "line_tension[0,1]": [0.3, 0.2, 0.1],
    "pair_energy[0,0]": [0.1, 0.2, 0.3],
    "chemical_potential[1]": [-0.1, 0.4, 0.9],
    "spontaneous_curvature": [0.2, 0.5, 0.8],
}
STATES = [mh.ThermodynamicState(kelvin(1), {name: v[k] for name, v in LADDER.items()}) for k in range(3)]


def exactEnergies():
    """Return the energies, less the chemical potentials, of all placements in each state, by the tests' own
    equations.
    """
    mesh, membranes = octahedron(), SmallMembranes()
    places = np.array(list(np.ndindex(*[2] * 6)))
    numbers = [membranes.numbers[stateOf(mesh.triangles)]] * len(places)
    energies = []
    for state in STATES:
        model, p = softModel(softForce(mesh, 2, SCALES)), state.parameters
        model["materials"][1][0], model["materials"][1][2] = p["bending_modulus[1]"], p["gaussian_modulus[1]"]
        model["materials"][0][1] = p["spontaneous_curvature[0]"]
        model["spontaneousCurvature"], model["lineTension"] = p["spontaneous_curvature"], p["line_tension[0,1]"]
        model["pairEnergies"][0][0] = p["pair_energy[0,0]"]
        terms = membranes.energyOf(np.repeat(mesh.vertices[None], len(places), axis=0), numbers, places, **model)
        energies.append(sum(terms.values()) - p["chemical_potential[1]"] * places.sum(axis=1))
    return places, np.array(energies)


def createExchangeOf(states=STATES, proposals=("mutation",) * 3, scales=SCALES):
    mesh, simulations = octahedron(), []
    for seed, proposal in enumerate(proposals, 1):
        system = mesh.createSystem()
        system.addForce(softForce(mesh, 2, scales))
        integrator = createExchange(1, 0.5, proposal, seed)
        simulations.append(app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU")))
        simulations[-1].context.setPositions(mesh.vertices)
    return mh.ReplicaExchange(simulations, states, seed=1)


def test_replicas_sample_every_state_exactly():
    """The energies of each state, and the differences of free energies, are those of the sum over all placements."""
    pytest.importorskip("pymbar")
    _, energies = exactEnergies()
    exchange = createExchangeOf()
    exchange.run(1500, 1)
    assert np.all((exchange.acceptanceRates > 0.1) & (exchange.acceptanceRates < 0.95))
    weights = np.exp(-energies)
    own = (weights * energies).sum(axis=1) / weights.sum(axis=1)
    for k, (expected, series) in enumerate(zip(own, exchange.potentialEnergies(discard=20))):
        mean, error = mh.meanAndError(series)
        assert abs(mean - expected) < 3.5 * error < 0.3, k
    u, counts = exchange.samples(discard=20)
    result = freeEnergies(u, counts)
    exact = -np.log(weights.sum(axis=1) / weights[0].sum())
    assert np.ptp(exact) > 0.5 and np.all(result.freeEnergyErrors < 0.1)
    assert np.all(np.abs(result.freeEnergies - exact) <= 3.5 * result.freeEnergyErrors)
    means, errors = result.means(u[0])
    expected = (weights * energies[0]).sum(axis=1) / weights.sum(axis=1)
    assert np.all(np.abs(means - expected) < 3.5 * errors)


def test_one_state_is_reweighted_to_others():
    """From the placements of a run in one state, as frames: those of another that nobody sampled."""
    pytest.importorskip("pymbar")
    places, energies = exactEnergies()
    mesh, force = octahedron(), softForce(octahedron(), 2, SCALES)
    u = reducedEnergies([mh.Mesh(mesh.vertices, mesh.triangles, species=place) for place in places], force, STATES)
    assert u == pytest.approx(energies, abs=1e-12)
    p = np.exp(-energies[1])
    drawn = np.random.default_rng(3).choice(len(places), 2000, p=p / p.sum())
    result = freeEnergies(u[:, drawn], [0, 2000, 0])
    exact = -np.log(np.exp(-energies).sum(axis=1) / np.exp(-energies[0]).sum())
    assert np.all(np.abs(result.freeEnergies - exact) <= 3.5 * result.freeEnergyErrors)
    assert list(result.numSamples > 1000) == [False, True, False]
    assert force.getLineTension(0, 1) == softForce(mesh, 2, SCALES).getLineTension(0, 1)


SETTERS = {
    "bending_modulus[1]": lambda force, value: force.setSpeciesParameters(1, value, *_rest(force, 1)[1:]),
    "spontaneous_curvature[1]": lambda f, v: f.setSpeciesParameters(1, _rest(f, 1)[0], v, _rest(f, 1)[2]),
    "gaussian_modulus[1]": lambda f, v: f.setSpeciesParameters(1, *_rest(f, 1)[:2], v),
    "line_tension[1,0]": lambda force, value: force.setLineTension(0, 1, value),
    "line_tension": lambda f, v: [f.setLineTension(a, b, v) for a, b in ((0, 1), (0, 2), (1, 2))],
    "pair_energy[2,1]": lambda force, value: force.setPairEnergy(1, 2, value),
    "spontaneous_curvature": lambda force, value: force.setSpontaneousCurvature(value),
    "area_modulus": lambda force, value: force.setAreaModulus(value),
    "tension": lambda force, value: force.setTension(value),
    "pressure": lambda force, value: force.setPressure(value),
}


def _rest(force, species):
    return [value._value for value in force.getSpeciesParameters(species)]


def createMembrane():
    mesh = createBlob(1)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setTargetArea(1.1 * mesh.area)
    addSpecies(force, 3)
    force.setVertexSpecies(np.arange(len(mesh.vertices)) % 3)
    mesh.species = force.getVertexSpecies()
    return mesh, force


@pytest.mark.parametrize("name", SETTERS)
def test_each_parameter_is_the_one_of_the_setter(name):
    mesh, force = createMembrane()
    value, changed = 1.7, copy.deepcopy(force)
    SETTERS[name](changed, value)
    states = [mh.ThermodynamicState(300), mh.ThermodynamicState(300, {name: value}), mh.ThermodynamicState(300)]
    states[2] = mh.ThermodynamicState(600, {name: value})
    u = reducedEnergies([mesh, mh.meshFrame(0, mesh)], force, states)
    exact = energyOf(createContext(mesh, changed, "CPU"))
    assert u[1] * states[1].thermalEnergy == pytest.approx([exact] * 2, rel=1e-12)
    assert u[2] == pytest.approx(u[1] / 2, rel=1e-12)
    own = energyOf(createContext(mesh, force, "CPU"))
    assert u[0] * states[0].thermalEnergy == pytest.approx([own] * 2, rel=1e-12) and abs(own - exact) > 1e-3


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x", "there is no parameter 'x'; it must be one of spontaneous_curvature, tension, pressure, area_modulus"),
        ("bending_modulus", r"that of a membrane without species; give that of one, as 'bending_modulus\[0\]'"),
        ("bending_modulus[3]", "is of the species 3, and there are 3, from 0 on"),
        ("line_tension[0,5]", "is of the species 5, and there are 3"),
        ("line_tension[1,1]", "has no effect; a line tension is between two different species"),
        ("pair_energy[1]", r"there is no parameter 'pair_energy\[1\]'"),
        ("chemical_potential[4]", "is of the species 4, and there are 3"),
    ],
)
def test_unknown_parameters_are_told(name, message):
    mesh, force = createMembrane()
    with pytest.raises(ValueError, match=message):
        reducedEnergies([mesh], force, [mh.ThermodynamicState(300, {name: 1.0})])
    if name != "chemical_potential[4]":
        with pytest.raises(ValueError, match="ReplicaExchange: state 0: "):
            createExchangeOf([mh.ThermodynamicState(300, {name: 1.0})] * 3)


def test_chemical_potentials_are_those_of_mutations():
    """They must be the same where no state has them, and there must be mutations where one has."""
    exchange = createExchangeOf()
    exchange.simulations[1].integrator.setChemicalPotential(0, 0.5)
    with pytest.raises(ValueError, match=r"chemical potential of species 0 is 0.5 kJ/mol in simulation 1 and 0 in"):
        mh.ReplicaExchange(exchange.simulations, STATES)
    for simulation in exchange.simulations:
        simulation.integrator.setChemicalPotential(0, 0.0)
        simulation.integrator.setProposal("neighbors")
    with pytest.raises(ValueError, match=r"the parameter 'chemical_potential\[1\]', and simulation 0 no mutations"):
        mh.ReplicaExchange(exchange.simulations, STATES)


@pytest.mark.parametrize(
    ("ladder", "changing"),
    [
        ({"pair_energy[1,1]": [0.0, 0.2, 0.4]}, ["E_pair"]),
        ({"line_tension": [0.0, 0.2, 0.4], "pair_energy[1,1]": [0.4, 0.2, 0.0]}, ["E_line", "E_pair"]),
        ({"gaussian_modulus[0]": [0.0, 0.1, 0.2], "gaussian_modulus[1]": [0.0, 0.1, 0.3]}, ["E_gaussian"]),
        ({"tension": [0.0, 0.1, 0.2], "pressure": [0.1, 0.0, 0.0]}, ["E_tension", "E_pressure"]),
    ],
)
def test_states_may_begin_where_a_term_is_off(ladder, changing):
    """What was observed has columns for all terms that states change, and each is that term."""
    states = [mh.ThermodynamicState(kelvin(1), {name: v[k] for name, v in ladder.items()}) for k in range(3)]
    exchange = createExchangeOf(states, scales={**dict.fromkeys(SCALES, 0.0), "bending": 0.004})
    exchange.run(30, 1)
    series = exchange.potentialEnergies()
    for k in range(3):
        table = exchange.observables(k)
        assert set(changing) < set(table)
        terms = sum(table[name] for name in table if name.startswith("E_"))
        assert table["energy"] == pytest.approx(terms, abs=1e-12) and table["energy"] == pytest.approx(series[k])
        for name in changing:
            own = {"E_gaussian": "gaussian_modulus[0]", "E_line": "line_tension", "E_pair": "pair_energy[1,1]"}
            assert np.any(table[name]) == bool(ladder[own.get(name, name.removeprefix("E_"))][k])


def test_parameters_that_are_the_same_are_told():
    for names in (["line_tension", "line_tension[1,0]"], ["pair_energy[0,1]", "pair_energy[1,0]"]):
        states = [mh.ThermodynamicState(kelvin(1), dict.fromkeys(names, float(k))) for k in range(3)]
        with pytest.raises(ValueError, match="' are both given, which both set "):
            createExchangeOf(states)


def test_all_replicas_have_mutations_or_none():
    with pytest.raises(ValueError, match="simulation 1 has mutations of species, and simulation 0 none"):
        createExchangeOf([mh.ThermodynamicState(kelvin(t)) for t in (1, 2)], ("neighbors", "mutation"))


def test_a_shape_without_species_has_those_of_the_force():
    mesh, force = createMembrane()
    plain, other = mh.Mesh(mesh.vertices, mesh.triangles), mh.Mesh(mesh.vertices, mesh.triangles)
    other.species = np.zeros(len(mesh.vertices), dtype=int)
    u = reducedEnergies([other, plain, mesh], force, [mh.ThermodynamicState(300)])[0]
    assert u[1] == u[2] != u[0]


def test_an_exchange_of_moduli_goes_on(tmp_path):
    """A file holds what is needed, whatever moduli the forces have by then."""
    exchange, again = createExchangeOf(), createExchangeOf()
    exchange.run(5, 1)
    exchange.save(tmp_path / "a.zip")
    exchange.run(5, 1)
    again.load(tmp_path / "a.zip")
    again.run(5, 1)
    assert np.array_equal(exchange.reducedEnergies, again.reducedEnergies)
    assert np.array_equal(exchange.history, again.history)


@pytest.mark.parametrize(
    ("u", "counts", "message"),
    [
        ([[1.0, 2.0]], [2, 0], "a row for each state"),
        ([[1.0, 2.0]], [3], "add up to its columns"),
        ([[1.0, 2.0], [0.0, 1.0]], [1, 1], "there must be none or two samples or more"),
        ([[1.0, np.inf]], [2], "the energy of sample 1 in state 0 is inf"),
    ],
)
def test_samples_that_do_not_go_together(u, counts, message):
    pytest.importorskip("pymbar")
    with pytest.raises(ValueError, match=message):
        freeEnergies(u, counts)
