"""Exchanges of species in a live Context: the distribution that they sample, alone and with all other moves."""

import io
import itertools

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from conftest import together
from membranes import PLATFORMS, createBlob, createContext, energyOf, kelvin, positionsOf, termsOf
from openmmhelfrich.sampling.interruption import StepInterrupted, interruptible
from test_flips import enumerateStates, octahedron, pOf, stateOf

PROPOSALS = ["neighbors", "anywhere", "mutation"]
# Species that differ in everything: bending modulus, spontaneous curvature and Gaussian modulus.
MATERIALS = [(20.0, 0.3, -9.0), (12.0, -0.6, 5.0), (27.0, 1.1, -3.0)]


ALL = ("bending", "gaussian", "line", "pair")
PLENTY = dict.fromkeys(ALL, 1.0)
# With so much of each term, energies differ by a few kJ/mol among placements on six vertices, or also triangulations.
FROZEN = {"bending": 0.02, "gaussian": 0.05, "line": 0.04, "pair": 0.04}
FLUID = {"bending": 0.004, "gaussian": 0.05, "line": 0.1, "pair": 0.1}


def addSpecies(force, numSpecies=2, terms=ALL, scales=PLENTY):
    """Give a force species that differ in some terms, and return it."""
    bending, gaussian, line, pair = (scales[term] * (term in terms) for term in ALL)
    for modulus, curvature, gaussianModulus in MATERIALS[:numSpecies]:
        force.addSpecies(bending * modulus, curvature, gaussian * gaussianModulus)
    for a, b in itertools.combinations_with_replacement(range(numSpecies), 2):
        if a != b:
            force.setLineTension(a, b, line * (14 + 5 * a - 3 * b))
        force.setPairEnergy(a, b, pair * (3 - 2 * a + 4 * (a != b)))
    return force


def createForce(mesh, numSpecies=2, **options):
    """Return a force with species that are evenly spread over the vertices."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setVertexSpecies(np.arange(len(mesh.vertices)) // 3 % numSpecies)
    return addSpecies(force, numSpecies, **options)


def createExchange(kT=20, fraction=1.0, proposal="neighbors", seed=5):
    exchange = mh.SpeciesExchangeIntegrator(kelvin(kT), fraction)
    exchange.setProposal(proposal)
    exchange.setRandomNumberSeed(seed)
    return exchange


@pytest.mark.parametrize("proposal", PROPOSALS)
@pytest.mark.parametrize("numSpecies", [2, 3])
def test_platforms_and_threads_make_the_same_exchanges(proposal, numSpecies):
    """Over some ten thousand attempts, hot and cold, between sweeps that flip."""
    mesh = createBlob(3)
    for kT in (5, 100):
        results = []
        for platform, properties in (("Reference", {}), ("CPU", {"Threads": "1"}), ("CPU", {"Threads": "2"})):
            exchange, flips = createExchange(kT, 1, proposal), mh.EdgeFlipIntegrator(kelvin(kT), 0.02)
            flips.setRandomNumberSeed(5)
            exchange.setChemicalPotential(1, 3)
            integrator = mh.HybridMonteCarloIntegrator(exchange)
            integrator.addMove(flips, 0.3)
            integrator.setRandomNumberSeed(2)
            force = createForce(mesh, numSpecies)
            context = createContext(mesh, force, platform, integrator, properties)
            integrator.step(8)
            counts = exchange.getNumAttempted(), exchange.getNumAccepted(), exchange.getNumAlike()
            triangles, species = force.getTrianglesInContext(context), force.getVertexSpeciesInContext(context)
            results.append((counts, triangles.tolist(), species.tolist()))
        assert results[0] == results[1] == results[2]
        (attempted, accepted, alike), _, species = results[0]
        assert attempted >= 4 * len(mesh.edges) and attempted > accepted + alike and accepted > 100
        assert (np.bincount(species) == np.bincount(force.getVertexSpecies())).all() == (proposal != "mutation")


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("proposal", PROPOSALS)
def test_each_exchange(platform, proposal):
    """After each exchange energies are those of a new Context with its species."""
    mesh = createBlob(1)
    force, exchange = createForce(mesh, 3), createExchange(proposal=proposal, fraction=1 / len(mesh.edges))
    context = createContext(mesh, force, platform, exchange)
    before, numChanged = force.getVertexSpeciesInContext(context), 0
    for attempt in range(1, 61):
        accepted = exchange.getNumAccepted()
        exchange.step(1)
        species = force.getVertexSpeciesInContext(context)
        changed = np.flatnonzero(species != before)
        assert exchange.getNumAttempted() == attempt == exchange.getNumSweeps() == context.getStepCount()
        assert len(changed) == (exchange.getNumAccepted() - accepted) * (1 if proposal == "mutation" else 2)
        if len(changed) == 2:
            assert species[changed].tolist() == before[changed][::-1].tolist()
            assert proposal == "anywhere" or np.any(np.all(mesh.edges == changed, axis=1))
        if len(changed):
            fresh = createForce(mesh, 3)
            fresh.setVertexSpecies(species)
            other = termsOf(fresh, createContext(mesh, fresh, platform))
            assert termsOf(force, context) == pytest.approx(other, rel=1e-12)
            numChanged += 1
        before = species
    assert numChanged > 10


def test_at_zero_temperature_the_energy_only_falls():
    mesh = createBlob(2)
    force, exchange = createForce(mesh), createExchange(0, 0.05)
    context = createContext(mesh, force, "CPU", exchange)
    energies = [energyOf(context)]
    for _ in range(100):
        exchange.step(1)
        energies.append(energyOf(context))
    assert np.diff(energies).max() <= 1e-10 * abs(energies[0]) and energies[-1] < energies[0] - 100


def test_force_groups_membranes_and_seeds():
    """A membrane of another group, or without species, keeps what it has; two get random numbers of their own."""
    blob = createBlob(1)
    mesh, n = together(blob, blob, blob), len(blob.vertices)

    def exchanged(exchange, group=0):
        forces = [createForce(blob), createForce(blob), mh.HelfrichForce()]
        for i, force in enumerate(forces):
            force.setTriangles(blob.triangles + i * n)
            force.setName(f"Vesicle{i}")
        forces[1].setForceGroup(group)
        context = createContext(mesh, forces, "CPU", exchange)
        exchange.step(2)
        assert len(forces[2].getVertexSpeciesInContext(context)) == 0
        return [force.getVertexSpeciesInContext(context).tolist() for force in forces[:2]]

    start, exchange = createForce(blob).getVertexSpecies().tolist(), createExchange()
    first, second = exchanged(exchange)
    assert exchange.getNumAttempted() == 2 * 2 * len(blob.edges)
    assert first != second and start not in (first, second)
    exchange = createExchange()
    exchange.setIntegrationForceGroups({0, 1})
    assert exchanged(exchange, 2) == [first, start]
    assert exchanged(createExchange()) == [first, second]
    assert exchanged(createExchange(seed=6))[0] != first


def mixture(exchange):
    integrator = mh.HybridMonteCarloIntegrator(kelvin(20), 1e-4, 5, 0.2, 0.3)
    integrator.addMove(exchange, 0.4)
    integrator.setRandomNumberSeed(8)
    return integrator


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("isMixed", [False, True])
def test_a_restart_in_the_middle(platform, isMixed):
    """From a checkpoint, from the XML of a State and of the integrator, and after reinitialize(), a run goes on as the
    uninterrupted one does, to the last bit.
    """
    mesh = createBlob(2)

    def create(integrator=None):
        force = createForce(mesh, 3)
        exchange = createExchange(proposal="mutation")
        exchange.setChemicalPotential(2, -1.5)
        return force, createContext(mesh, force, platform, integrator or (mixture(exchange) if isMixed else exchange))

    def result(force, context):
        context.getIntegrator().step(6)
        return (
            positionsOf(context).tolist(),
            force.getTrianglesInContext(context).tolist(),
            force.getVertexSpeciesInContext(context).tolist(),
            energyOf(context),
        )

    force, context = create()
    context.getIntegrator().step(6)
    checkpoint, state = (
        context.createCheckpoint(),
        context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True),
    )
    texts = [mm.XmlSerializer.serialize(object) for object in (state, context.getIntegrator())]
    expected = result(force, context)
    assert expected[2] != force.getVertexSpecies().tolist()
    context.loadCheckpoint(checkpoint)
    context.reinitialize(preserveState=True)
    assert result(force, context) == expected
    force, context = create()
    context.loadCheckpoint(checkpoint)
    assert result(force, context) == expected
    force, context = create(mm.XmlSerializer.deserialize(texts[1]))
    context.setState(mm.XmlSerializer.deserialize(texts[0]))
    assert result(force, context) == expected


@pytest.mark.parametrize("platform", PLATFORMS)
def test_an_interruption_leaves_all_as_it_was(platform):
    mesh, exchange = createBlob(2), createExchange()
    force, asked = createForce(mesh), []
    context = createContext(mesh, force, platform, exchange)
    exchange.step(1)
    before, counts = force.getVertexSpeciesInContext(context), (exchange.getNumAttempted(), exchange.getNumSweeps())
    exchange.setFraction(1e6)
    with interruptible(lambda: asked.append(1) or len(asked) == 2), pytest.raises(StepInterrupted):
        exchange.step(1)
    assert np.array_equal(force.getVertexSpeciesInContext(context), before)
    assert (exchange.getNumAttempted(), exchange.getNumSweeps()) == counts


def test_settings_are_in_the_xml():
    exchange = createExchange(3, 0.7, "mutation")
    exchange.setChemicalPotential(1, 2 * unit.kilocalorie_per_mole)
    copy = mh.SpeciesExchangeIntegrator.cast(mm.XmlSerializer.deserialize(mm.XmlSerializer.serialize(exchange)))
    assert copy.getFraction() == 0.7 and copy.getProposal() == "mutation" and copy.getRandomNumberSeed() == 5
    assert copy.getChemicalPotential(1) == 8.368 * unit.kilojoule_per_mole
    assert copy.getChemicalPotential(0) == 0 * unit.kilojoule_per_mole
    assert repr(copy).endswith("sweeps of mutations over 0.7 of the edges>")
    assert repr(createExchange()).endswith("sweeps of exchanges of neighbors over 1 of the edges>")


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: mh.SpeciesExchangeIntegrator(300, -1), "the fraction is -1; it must be finite and not negative"),
        (lambda: mh.SpeciesExchangeIntegrator(-3, 1), "the temperature in K is -3; it must be finite and not negative"),
        (lambda: createExchange().setProposal("next"), "the proposal is 'next'; it must be 'neighbors', 'anywhere' or"),
        (lambda: createExchange().setChemicalPotential(-1, 3), "that of species -1; species are numbered from 0"),
        (lambda: createExchange().getChemicalPotential(-2), "that of species -2; species are numbered from 0"),
        (lambda: createExchange().setChemicalPotential(1, np.nan), "of species 1 is nan; it must be finite"),
    ],
)
def test_settings_that_are_refused(call, words):
    with pytest.raises(mm.OpenMMException, match=f"^SpeciesExchangeIntegrator: .*{words}"):
        call()


def test_contexts_that_are_refused():
    mesh = createBlob(1)
    plain = mh.HelfrichForce()
    plain.setTriangles(mesh.triangles)
    for forces in ([], plain):
        with pytest.raises(mm.OpenMMException, match=r"no HelfrichForce with species.*add them with addSpecies\(\)"):
            createContext(mesh, forces, integrator=createExchange())
    variable = mm.CustomCVForce("x")
    variable.addCollectiveVariable("x", createForce(mesh))
    with pytest.raises(mm.OpenMMException, match=r"'HelfrichForce' is inside another Force.*keep the species"):
        createContext(mesh, variable, integrator=createExchange())
    exchange = createExchange()
    context = createContext(mesh, createForce(mesh), integrator=exchange)
    exchange.setChemicalPotential(2, 1)
    with pytest.raises(mm.OpenMMException, match="species 2 has a chemical potential, but there are 2 species"):
        exchange.step(1)
    exchange = createExchange(fraction=1e12)
    context = createContext(mesh, createForce(mesh), integrator=exchange)
    with pytest.raises(mm.OpenMMException, match=r"the number of attempts in a sweep is 1.2e.14; it must be at most"):
        exchange.step(1)
    exchange.setFraction(1)
    context.setPositions(np.full_like(mesh.vertices, np.nan))
    with pytest.raises(mm.OpenMMException, match=r"the position of particle 0 is .nan, nan, nan.; positions must be"):
        exchange.step(1)


def test_columns():
    mesh, exchange = createBlob(1), createExchange()
    force, system = createForce(mesh), mesh.createSystem()
    system.addForce(force)
    simulation = app.Simulation(mesh.topology(), system, mixture(exchange))
    simulation.context.setPositions(mesh.vertices)
    table = io.StringIO()
    simulation.reporters.append(mh.ObservablesReporter(table, 20, force))
    simulation.step(20)
    head, row = (line.split(",") for line in table.getvalue().splitlines())
    columns = dict(zip(head, map(float, row)))
    assert 0 < columns["exchangeAcceptance"] == exchange.getAcceptanceRate() < 1
    assert 0 < columns["exchangesAlike"] == exchange.getNumAlike() / exchange.getNumAttempted() < 1


# Detailed balance, seen: all placements of species on a few frozen vertices, and how often a run visits each.


def placements(numOfEach):
    """Return all placements of so many vertices of each species."""
    return sorted(set(itertools.permutations(np.repeat(np.arange(len(numOfEach)), numOfEach).tolist())))


def softForce(mesh, numSpecies, scales, terms=ALL):
    """Return a force on six vertices."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setSpontaneousCurvature(0.2)
    force.setVertexSpecies([0] * len(mesh.vertices))
    return addSpecies(force, numSpecies, terms, scales)


@pytest.mark.parametrize("proposal", PROPOSALS)
@pytest.mark.parametrize("kT", [1, 0.5])
def test_detailed_balance_of_placements(proposal, kT):
    """Three species on a frozen octahedron: visits agree with Boltzmann weights, and would not with those of another
    temperature, or without one of the terms.
    """
    mesh, potentials = octahedron(), np.array([0, 0.5, -0.7])
    if proposal == "mutation":
        states = list(itertools.product(range(3), repeat=6))
    else:
        states, potentials = placements([2, 2, 2]), 0 * potentials

    def energies(terms=ALL):
        force = softForce(mesh, 3, FROZEN, terms)
        context = createContext(mesh, force)
        result = []
        for state in states:
            force.setVertexSpeciesInContext(context, state)
            result.append(energyOf(context) - potentials[list(state)].sum())
        return np.array(result)

    force, exchange = softForce(mesh, 3, FROZEN), createExchange(kT, 10, proposal)
    force.setVertexSpecies(states[len(states) // 2])
    for species, potential in enumerate(potentials):
        exchange.setChemicalPotential(species, potential)
    context = createContext(mesh, force, "CPU", exchange)
    counts, numbers = np.zeros(len(states)), {state: i for i, state in enumerate(states)}
    for _ in range(20000):
        exchange.step(1)
        counts[numbers[tuple(force.getVertexSpeciesInContext(context).tolist())]] += 1
    assert pOf(counts, energies(), kT) > 0.01
    assert pOf(counts, energies(), 1.5 - kT) < 1e-9
    for term in ALL:
        assert pOf(counts, energies([t for t in ALL if t != term]), kT) < 1e-9


class SmallMembranes:
    """All triangulations of six vertices, and the energy of placements on them: equations of this file's own, for many
    membranes at a time.

    Attributes
    ----------
    numbers : dict
        the number of each triangulation, by what stateOf() returns
    triangles, valences, edges : array
        of each triangulation the triangles; the valences of the vertices; and the edges i-j, with the apexes k and l of
        the triangles on both sides
    flips : array
        of each edge of each triangulation the number of that which its flip makes, or -1 if it must not flip
    """

    def __init__(self):
        self.numbers = enumerateStates(stateOf(octahedron().triangles))
        self.triangles = np.array([sorted(state) for state in self.numbers])
        self.valences = np.array([np.bincount(t.ravel()) for t in self.triangles])
        apexes = [{(t[n], t[(n + 1) % 3]): t[(n + 2) % 3] for t in state for n in range(3)} for state in self.numbers]
        self.edges = np.array([[(i, j, a[i, j], a[j, i]) for i, j in sorted(a) if i < j] for a in apexes])
        self.flips = np.array(
            [[self._flip(state, *edge) for edge in self.edges[n]] for n, state in enumerate(self.numbers)]
        )

    def _flip(self, state, i, j, k, l):
        valences = [sum(v in t for t in state) for v in (i, j)]
        if min(valences) == 3 or any(k in t and l in t for t in state):
            return -1
        others = [t for t in state if not (i in t and j in t)]
        return self.numbers[stateOf(np.array([*others, (l, j, k), (k, i, l)]))]

    def measure(self, x, numbers, species):
        """Return areas, volumes, edge lengths, and vertex areas, curvatures and angles, of M membranes.

        Parameters
        ----------
        x, numbers, species : array
            the positions, of shape (M, 6, 3); the number of the triangulation of each; of shape (M, 6)
        """
        rows = np.arange(len(x))[:, None]

        def addUp(vertices, values):
            flat = np.bincount((6 * rows + vertices).ravel(), values.ravel(), 6 * len(x))
            return flat.reshape(len(x), 6)

        t, (i, j, k, l) = self.triangles[numbers], np.moveaxis(self.edges[numbers], 2, 0)
        corners = [x[rows, t[:, :, n]] for n in range(3)]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        area = np.linalg.norm(normal, axis=2) / 2
        volume = np.sum(corners[0] * np.cross(corners[1], corners[2]), axis=(1, 2)) / 6
        vertexArea = sum(addUp(t[:, :, n], area / 3) for n in range(3))
        angles = 0
        for n in range(3):
            u, w = corners[n - 2] - corners[n], corners[n - 1] - corners[n]
            angles += addUp(t[:, :, n], np.arctan2(2 * area, np.sum(u * w, axis=2)))
        along = x[rows, j] - x[rows, i]
        length = np.linalg.norm(along, axis=2)
        nf, ng = np.cross(along, x[rows, k] - x[rows, i]), np.cross(-along, x[rows, l] - x[rows, j])
        nf, ng = (n / np.linalg.norm(n, axis=2, keepdims=True) for n in (nf, ng))
        dihedral = np.arctan2(np.sum(np.cross(nf, ng) * along, axis=2) / length, np.sum(nf * ng, axis=2))
        curvature = addUp(i, length * dihedral / 4) + addUp(j, length * dihedral / 4)
        s = [species[rows, t[:, :, n]] for n in range(3)]
        pairs = species[rows, i], species[rows, j]
        sides = [np.linalg.norm(corners[n - 1] - corners[n - 2], axis=2) for n in range(3)]
        return area.sum(axis=1), volume, length, vertexArea, curvature, angles, s, pairs, sides

    def energyOf(self, x, numbers, species, materials, spontaneousCurvature, lineTension, pairEnergies):
        """Return the energy that depends on the two species, by term."""
        _, _, _, A, M, angles, s, (first, second), sides = self.measure(x, numbers, species)
        kappa, C, gaussian = np.moveaxis(np.array(materials)[species], 2, 0)
        C = C + spontaneousCurvature
        border = sum(
            np.where((s[n - 1] == s[n - 2]) & (s[n] != s[n - 1]), sides[n] / 2, 0).sum(axis=1) for n in range(3)
        )
        return {
            "bending": np.sum(2 * kappa * (M - C * A / 2) ** 2 / A, axis=1),
            "gaussian": np.sum(gaussian * (2 * np.pi - angles), axis=1),
            "line": lineTension * border,
            "pair": np.array(pairEnergies)[first, second].sum(axis=1),
        }


def softModel(force):
    """Return what softForce() says, with two species, as arguments of SmallMembranes.energyOf()."""
    return {
        "materials": [[value._value for value in force.getSpeciesParameters(n)] for n in range(2)],
        "spontaneousCurvature": force.getSpontaneousCurvature()._value,
        "lineTension": force.getLineTension(0, 1)._value,
        "pairEnergies": [[force.getPairEnergy(a, b)._value for b in range(2)] for a in range(2)],
    }


@pytest.fixture(scope="module")
def membranes():
    return SmallMembranes()


def test_equations(membranes):
    """Those of this file are those of the platforms."""
    mesh, place = octahedron(), (0, 1, 0, 0, 1, 0)
    model = softModel(softForce(mesh, 2, FLUID))
    energies = membranes.energyOf(
        mesh.vertices[None], [membranes.numbers[stateOf(mesh.triangles)]], np.array([place]), **model
    )
    for platform in PLATFORMS:
        force = softForce(mesh, 2, FLUID)
        force.setVertexSpecies(place)
        terms = termsOf(force, createContext(mesh, force, platform))
        assert {term: terms[term] for term in energies} == pytest.approx({t: e[0] for t, e in energies.items()}, 1e-12)


@pytest.mark.parametrize("kT", [1, 0.5])
def test_detailed_balance_with_flips(membranes, kT):
    """The 390 triangulations of six frozen vertices, each with the 15 placements of two vertices of another species."""
    mesh, places = octahedron(), placements([4, 2])
    force, exchange, flips = softForce(mesh, 2, FLUID), createExchange(kT, 8), mh.EdgeFlipIntegrator(kelvin(kT), 15)
    force.setVertexSpecies(places[0])
    integrator = mh.HybridMonteCarloIntegrator(flips)
    integrator.addMove(exchange, 0.5)
    integrator.setRandomNumberSeed(9)
    context = createContext(mesh, force, "CPU", integrator)
    counts = np.zeros((len(membranes.numbers), len(places)))
    for _ in range(25000):
        integrator.step(3)
        place = places.index(tuple(force.getVertexSpeciesInContext(context).tolist()))
        counts[membranes.numbers[stateOf(force.getTrianglesInContext(context))], place] += 1
    numbers, placed = (grid.ravel() for grid in np.mgrid[: len(counts), : len(places)])
    terms = membranes.energyOf(
        np.repeat(mesh.vertices[None], len(numbers), axis=0), numbers, np.array(places)[placed], **softModel(force)
    )
    assert np.count_nonzero(counts) > 1000
    assert pOf(counts.ravel(), sum(terms.values()), kT) > 0.01
    assert pOf(counts.ravel(), sum(terms.values()), 1.5 - kT) < 1e-9
    for term in terms:
        assert pOf(counts.ravel(), sum(terms.values()) - terms[term], kT) < 1e-9


# Positions, triangulations and placements together, against a plain Metropolis of this file's own.

JOINT = {"bending": 0.02, "gaussian": 0.08, "line": 0.08, "pair": 0.12}
STIFFNESS = {"area": 60.0, "volume": 60.0, "tether": 2.0}
MIN_LENGTH, MAX_LENGTH = 0.8, 1.9


def totalOf(membranes, x, numbers, species, model, start):
    """Return the whole energy, and what is compared, of M membranes."""
    area, volume, length, A, M, *_ = membranes.measure(x, numbers, species)
    terms = membranes.energyOf(x, numbers, species, **model)
    terms["area"] = STIFFNESS["area"] * (area / start.area - 1) ** 2
    terms["volume"] = STIFFNESS["volume"] * (volume / start.volume - 1) ** 2
    short, long = np.minimum(length, MIN_LENGTH), np.maximum(length, MAX_LENGTH)
    with np.errstate(divide="ignore"):
        tether = np.where(length < MIN_LENGTH, np.exp(short / (short - MIN_LENGTH)) / short**2, 0)
    terms["tether"] = STIFFNESS["tether"] * (tether + 8 * (long - MAX_LENGTH) ** 2).sum(axis=1)
    valences = membranes.valences[numbers]
    isOther = species == 1
    observables = {
        **terms,
        "volume of it": volume,
        "squared area": area**2,
        "longest edge": length.max(axis=1),
        "valences": np.sum(valences**2, axis=1),
        "valences of one species": np.sum(valences * isOther, axis=1),
        "areas of one species": np.sum(A * isOther, axis=1),
        "curvatures of one species": np.sum(M * isOther, axis=1),
        "boundary and volume": terms["line"] * volume,
        "boundary and valences": terms["line"] * np.sum(valences * isOther, axis=1),
        "bending and neighbors": terms["bending"] * terms["pair"],
    }
    return sum(terms.values()), observables


def plainMetropolis(membranes, model, start, numChains=400, numMoves=1100, burnIn=400, interval=50):
    """Return what many independent chains see: arrays of shape (numChains, samples) by the names of observables."""
    random, rows = np.random.default_rng(3), np.arange(numChains)
    x, numbers = (
        np.repeat(start.vertices[None], numChains, axis=0),
        np.full(numChains, membranes.numbers[stateOf(start.triangles)]),
    )
    species = random.permuted(np.repeat([[0, 0, 0, 0, 1, 1]], numChains, axis=0), axis=1)
    energy, observables = totalOf(membranes, x, numbers, species, model, start)
    samples = []
    for move in range(numMoves):
        newX, newNumbers, newSpecies, edge = x.copy(), numbers, species.copy(), random.integers(12, size=numChains)
        if move % 4 == 0:
            newNumbers = membranes.flips[numbers, edge]
        elif move % 4 == 2:
            i, j, _, _ = membranes.edges[numbers, edge].T
            newSpecies[rows, i], newSpecies[rows, j] = species[rows, j], species[rows, i]
        else:
            newX[rows, random.integers(6, size=numChains)] += random.uniform(-0.3, 0.3, (numChains, 3))
        isAllowed = newNumbers >= 0
        newNumbers = np.where(isAllowed, newNumbers, numbers)
        newEnergy, new = totalOf(membranes, newX, newNumbers, newSpecies, model, start)
        accepted = isAllowed & (random.random(numChains) < np.exp(np.minimum(energy - newEnergy, 0)))
        x[accepted], species[accepted] = newX[accepted], newSpecies[accepted]
        numbers, energy = np.where(accepted, newNumbers, numbers), np.where(accepted, newEnergy, energy)
        observables = {name: np.where(accepted, new[name], old) for name, old in observables.items()}
        if move >= burnIn and move % interval == 0:
            samples.append(observables)
    return {name: np.array([sample[name] for sample in samples]).T for name in observables}


def test_joint_distribution(membranes):
    """Trajectories, flips and exchanges give positions, triangulations and placements of six vertices as they are to
    be together; and they would not if the energy lacked one of the terms of species.
    """
    start = octahedron()
    force = softForce(start, 2, JOINT)
    force.setVertexSpecies([0, 0, 1, 0, 0, 1])
    force.setAreaModulus(STIFFNESS["area"])
    force.setTargetArea(start.area)
    force.setVolumeModulus(STIFFNESS["volume"])
    force.setTargetVolume(start.volume)
    force.setTether(STIFFNESS["tether"], MIN_LENGTH, MAX_LENGTH, 2)
    model = softModel(force)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(1), 0.015, 20, 1, 0.3)
    integrator.addMove(createExchange(1, 1), 0.3)
    integrator.setRandomNumberSeed(4)
    context = createContext(start, force, "CPU", integrator)
    x, numbers, species = [], [], []
    for _ in range(10000):
        integrator.step(6)
        x.append(positionsOf(context))
        numbers.append(membranes.numbers[stateOf(force.getTrianglesInContext(context))])
        species.append(force.getVertexSpeciesInContext(context))
    _, found = totalOf(membranes, np.array(x), np.array(numbers), np.array(species), model, start)
    expected = plainMetropolis(membranes, model, start)
    assert integrator.getAcceptanceRate() > 0.5

    def deviations(weights):
        result = {}
        for name, values in found.items():
            blocks = values.reshape(40, -1).mean(axis=1)
            chains = np.average(expected[name], axis=1, weights=weights)
            mean = np.average(expected[name], weights=weights)
            error = np.hypot(blocks.std() / np.sqrt(len(blocks)), chains.std() / np.sqrt(len(chains)))
            result[name] = (blocks.mean() - mean) / error
        return result

    right = deviations(np.ones_like(expected["line"]))
    assert max(map(abs, right.values())) < 4, right
    for term in ALL:
        wrong = deviations(np.exp(expected[term] - expected[term].max()))
        assert max(map(abs, wrong.values())) > 6, term
