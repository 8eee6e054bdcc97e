"""Edge flips in a live Context: energies, connectivity, and the distribution that they sample."""

import itertools
import os

import numpy as np
import openmm as mm
import pytest
from hypothesis import given, settings, strategies as st
from openmm import unit
from scipy import stats

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
from openmmhelfrich.geometry import connectivity


def oneAttempt(mesh, temperature):
    """Return an integrator that attempts a single flip a step."""
    flips = mh.EdgeFlipIntegrator(temperature, 1 / len(mesh.edges))
    flips.setRandomNumberSeed(5)
    return flips


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize(
    "terms, exclusionLevel", [([term], 1) for term in TERMS] + [(TERMS, level) for level in (0, 1, 2)]
)
def test_each_flip(platform, terms, exclusionLevel):
    """After each flip the mesh is a closed manifold, and energy and forces are those of a new Context with its
    triangles.
    """
    mesh = createBlob(1)
    force = createForce(mesh, terms, exclusionLevel)
    flips = oneAttempt(mesh, kelvin(500))
    context = createContext(mesh, force, platform, flips)
    energies = {energyOf(context)}
    for attempt in range(1, 101):
        accepted = flips.getNumAccepted()
        flips.step(1)
        assert flips.getNumAttempted() == attempt
        if flips.getNumAccepted() == accepted:
            continue
        live = mh.Mesh(mesh.vertices, force.getTrianglesInContext(context))
        assert len(live.vertices) - len(live.edges) + len(live.triangles) == 2
        assert np.bincount(live.edges.ravel()).min() >= 3
        fresh = createForce(mesh, terms, exclusionLevel)
        fresh.setTriangles(live.triangles)
        other = createContext(mesh, fresh, platform)
        assert energyOf(context) == pytest.approx(energyOf(other), rel=1e-12)
        assert np.abs(forcesOf(context) - forcesOf(other)).max() < 1e-11 * np.abs(forcesOf(other)).max()
        energies.add(energyOf(context))
    assert flips.getNumAccepted() > 20
    assert len(energies) > 15


@pytest.mark.parametrize("platform", PLATFORMS)
def test_at_zero_temperature_the_energy_only_falls(platform):
    mesh = createBlob(2)
    force = createForce(mesh)
    flips = oneAttempt(mesh, 0)
    context = createContext(mesh, force, platform, flips)
    energy = start = energyOf(context)
    for _ in range(300):
        flips.step(1)
        assert energyOf(context) <= energy * (1 + 1e-14)
        energy = energyOf(context)
    assert flips.getNumAccepted() > 10
    assert energy < start


def test_platforms_and_threads_make_the_same_flips():
    mesh = createBlob(3)
    results = []
    for platform, properties in (("Reference", {}), ("CPU", {"Threads": "1"}), ("CPU", {"Threads": "2"})):
        force = createForce(mesh, TERMS, 2)
        flips = mh.EdgeFlipIntegrator(kelvin(5), 0.5)
        flips.setRandomNumberSeed(3)
        context = createContext(mesh, force, platform, flips, properties)
        flips.step(3)
        results.append((force.getTrianglesInContext(context), flips.getNumAccepted(), flips.getNumForbidden()))
    for triangles, accepted, forbidden in results[1:]:
        assert np.array_equal(triangles, results[0][0])
        assert (accepted, forbidden) == results[0][1:]


def test_reference_decides_as_the_cpu():
    """All terms, hot and cold, at each exclusion level, some edges fixed: over 100,000 attempts both platforms accept
    and forbid the same ones.
    """
    mesh = createBlob(2)
    numAttempted, ends = 0, []
    for level in (0, 1, 2):
        for kT in (5, 500):
            runs = []
            for platform in PLATFORMS:
                force = createForce(mesh, TERMS, level)
                for edge in mesh.edges[::17]:
                    force.addFixedEdge(*edge)
                flips = mh.EdgeFlipIntegrator(kelvin(kT), 2)
                flips.setRandomNumberSeed(11)
                runs.append((createContext(mesh, force, platform, flips), force, flips))
            for _ in range(18):
                outcomes = []
                for context, force, flips in runs:
                    flips.step(1)
                    counts = flips.getNumAttempted(), flips.getNumAccepted(), flips.getNumForbidden()
                    outcomes.append((counts, force.getTrianglesInContext(context).tolist()))
                assert outcomes[0] == outcomes[1]
            (attempted, accepted, forbidden), triangles = outcomes[0]
            assert forbidden > attempted / 20
            low, high = (0.1, 0.2) if kT == 5 else (0.5, 0.6)
            assert low * attempted < accepted < high * attempted
            numAttempted += attempted
            ends.append(triangles)
    assert numAttempted > 100000
    assert all(a != b for a, b in itertools.combinations(ends, 2))  # each level of exclusions matters


def test_threads_that_share_a_membrane():
    """Of more than 100,000 vertices there is one copy for all threads; sweeps between moves, with a restart, make the
    same flips on any number.
    """
    mesh = createBlob(7)
    edge = mesh.edgeLengths.mean()
    results = []
    for threads in ("1", "2", "4"):
        force = createForce(mesh)
        force.setRepulsion(0.5, 1.3 * edge, 2, 2)
        flips = mh.EdgeFlipIntegrator(kelvin(3000), 0.2)
        flips.setRandomNumberSeed(3)
        context = createContext(mesh, force, "CPU", flips, {"Threads": threads})
        flips.step(1)
        middle = context.createCheckpoint()
        context.setPositions(1.01 * mesh.vertices)
        flips.step(1)
        context.loadCheckpoint(middle)
        flips.step(1)
        results.append((force.getTrianglesInContext(context), flips.getNumAccepted(), flips.getNumForbidden()))
    assert results[0][1] > len(mesh.edges) / 20
    for triangles, accepted, forbidden in results[1:]:
        assert np.array_equal(triangles, results[0][0])
        assert (accepted, forbidden) == results[0][1:]


def test_seeds():
    mesh = createBlob(2)

    def flip(seed):
        force = createForce(mesh)
        flips = mh.EdgeFlipIntegrator(kelvin(50), 0.5)
        flips.setRandomNumberSeed(seed)
        context = createContext(mesh, force, integrator=flips)
        flips.step(2)
        return force.getTrianglesInContext(context).tolist()

    assert flip(1) == flip(1)
    assert flip(1) != flip(2)
    assert flip(0) != flip(0)


def test_counters():
    mesh = createBlob(2)
    flips = mh.EdgeFlipIntegrator(kelvin(5), 0.25)
    context = createContext(mesh, createForce(mesh), integrator=flips)
    flips.step(7)
    assert flips.getNumSweeps() == 7
    assert flips.getNumAttempted() == 7 * round(0.25 * len(mesh.edges))
    assert 0 < flips.getNumAccepted() < flips.getNumAttempted() - flips.getNumForbidden()
    assert flips.getFlipRate() == flips.getNumAccepted() / (7 * len(mesh.edges))
    assert context.getStepCount() == 7


def test_flip_rate():
    """It is over the edges of all membranes and over the sweeps, not the steps."""
    blob = createBlob(2)
    mesh, forces = together(blob, blob), [createForce(blob), createForce(blob)]
    forces[1].setTriangles(blob.triangles + len(blob.vertices))
    forces[1].setName("other")
    integrator = mh.HybridMonteCarloIntegrator(kelvin(5), 1e-4, 5, 0.25, 0.5)
    integrator.setRandomNumberSeed(3)
    assert integrator.getFlipRate() == integrator.getFlipIntegrator().getFlipRate() == 0
    context = createContext(mesh, forces, integrator=integrator)
    assert integrator.getFlipRate() == 0
    integrator.step(20)
    flips = integrator.getFlipIntegrator()
    assert 0 < flips.getNumSweeps() < 20
    assert (
        integrator.getFlipRate()
        == flips.getFlipRate()
        == flips.getNumAccepted() / (len(mesh.edges) * flips.getNumSweeps())
        > 0
    )
    context.reinitialize()
    assert integrator.getFlipRate() == 0


def test_a_force_group_that_is_not_integrated_is_left_alone():
    mesh = createBlob(2)
    force = createForce(mesh)
    force.setForceGroup(2)
    flips = mh.EdgeFlipIntegrator(kelvin(50), 1)
    flips.setIntegrationForceGroups({0, 1})
    context = createContext(mesh, force, integrator=flips)
    flips.step(1)
    assert np.array_equal(force.getTrianglesInContext(context), mesh.triangles)
    flips.setIntegrationForceGroups({2})
    flips.step(1)
    assert not np.array_equal(force.getTrianglesInContext(context), mesh.triangles)


def test_no_membrane_to_flip():
    mesh = createBlob(1)
    with pytest.raises(mm.OpenMMException, match="EdgeFlipIntegrator: the System has no HelfrichForce"):
        createContext(mesh, [], integrator=mh.EdgeFlipIntegrator(300, 1))


def test_flips_with_dynamics():
    """Sweeps between Langevin steps: the kinetic energy stays that of the temperature, and the surface a membrane."""
    mesh = mh.Mesh.icosphere(2)
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(50)
    force.setVolumeModulus(500)
    force.setTargetVolume(mesh.volume)
    force.setTether(20, 0.5 * edge, 1.5 * edge, 2)
    force.setRepulsion(1, edge, 2, 1)
    # Dynamics of a surface that folds now and then meets forces for which no step is short enough, and Hybrid Monte
    # Carlo would reject: a strong friction takes the heat away, and gives the mean an error of 0.3%.
    langevin, flips = mm.LangevinMiddleIntegrator(300, 1000, 0.0001), mh.EdgeFlipIntegrator(300, 0.1)
    langevin.setRandomNumberSeed(4)
    flips.setRandomNumberSeed(4)
    integrator = mh.HybridMonteCarloIntegrator(langevin, flips, 0.3)
    integrator.setRandomNumberSeed(4)
    context = createContext(mesh, force, "CPU", integrator)
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(2000)
    kinetic = []
    for _ in range(800):
        integrator.step(10)
        kinetic.append(context.getState(energy=True).getKineticEnergy() / unit.kilojoule_per_mole)
    assert np.mean(kinetic) == pytest.approx(1.5 * len(mesh.vertices) * 300 / kelvin(1), rel=0.03)
    assert flips.getNumAccepted() > 1000
    mh.Mesh(positionsOf(context), force.getTrianglesInContext(context)).check()


def test_flips_with_brownian_dynamics():
    """Equipartition: the mean of the coordinates times their energy gradients is kT for each, whatever flips between
    the steps.
    """
    mesh = mh.Mesh.icosphere(1)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(50)
    force.setVolumeModulus(500)
    force.setTargetVolume(mesh.volume)
    edge = mesh.edgeLengths.mean()
    # With wider bounds a needle-shaped triangle, now and then, is too stiff for the step.
    force.setTether(20, 0.7 * edge, 1.4 * edge, 2)
    brownian, flips = mm.BrownianIntegrator(300, 1000, 0.01), mh.EdgeFlipIntegrator(300, 0.1)
    brownian.setRandomNumberSeed(4)
    flips.setRandomNumberSeed(4)
    integrator = mh.HybridMonteCarloIntegrator(brownian, flips, 0.3)
    context = createContext(mesh, force, "CPU", integrator)
    integrator.step(10000)
    virials = []
    for _ in range(6000):
        integrator.step(20)
        x = positionsOf(context)
        virials.append(-np.sum((x - x.mean(axis=0)) * forcesOf(context)))
    # Eight runs with other random numbers came to 311 with a standard deviation of 15, where 307 is to be expected.
    assert np.mean(virials) == pytest.approx(3 * (len(mesh.vertices) - 1) * 300 / kelvin(1), rel=0.2)
    assert flips.getNumAccepted() > 10000
    mh.Mesh(positionsOf(context), force.getTrianglesInContext(context)).check()


# Ten million attempts take some minutes, and are made where the environment variable OPENMM_HELFRICH_LARGE_TESTS is
# set.
STRESS_EXAMPLES = 25
STRESS_ATTEMPTS = (10**7 if "OPENMM_HELFRICH_LARGE_TESTS" in os.environ else 5 * 10**5) // STRESS_EXAMPLES


def logUniform(low, high):
    return st.floats(np.log10(low), np.log10(high)).map(lambda exponent: 10**exponent)


@st.composite
def flippedMembranes(draw):
    """Draw a mesh, a function that creates a force with some of its terms on given triangles, and an integrator."""
    # Without noise some triangles fold onto each other exactly, and the last bit decides whether an angle is pi or -pi.
    mesh = createBlob(draw(st.integers(0, 4)), draw(st.floats(0.01, 0.3)), draw(st.integers(0, 1000)))
    terms = draw(st.lists(st.sampled_from(TERMS), min_size=1, unique=True))
    level = draw(st.integers(0, 2))
    bending, area, areaDifference = (draw(logUniform(low, high)) for low, high in ((0.1, 1000), (1, 1e6), (1, 1e6)))
    # Soft ones would not keep the hottest membranes from turning inside out, which is an error in a new Context.
    volume, pressure = draw(logUniform(1e4, 1e6)), draw(logUniform(1e4, 1e6))

    def create(triangles):
        force = createForce(mesh, terms, level)
        force.setTriangles(triangles)
        for term, setModulus, modulus in (
            ("bending", force.setBendingModulus, bending),
            ("area", force.setAreaModulus, area),
            ("volume", force.setVolumeModulus, volume),
            ("areaDifference", force.setAreaDifferenceModulus, areaDifference),
            ("pressure", force.setPressure, pressure),
        ):
            if term in terms:
                setModulus(modulus)
        return force

    flips = mh.EdgeFlipIntegrator(
        draw(st.one_of(st.just(0), logUniform(0.01, 100).map(kelvin))), draw(st.floats(0.1, 1))
    )
    flips.setRandomNumberSeed(draw(st.integers(1, 2**31 - 1)))
    return mesh, create, flips


@given(membrane=flippedMembranes(), threads=st.sampled_from(["1", "2", "3"]))
@settings(max_examples=STRESS_EXAMPLES, deadline=None, derandomize=True, database=None)
def test_stress(membrane, threads):
    """After any number of flips of any membrane the mesh is valid, and the energy that of a new Context with its
    triangles.
    """
    mesh, create, flips = membrane
    force = create(mesh.triangles)
    context = createContext(mesh, force, "CPU", flips, {"Threads": threads})
    numBlocks = 5
    attemptsPerSweep = round(flips.getFraction() * len(mesh.edges))
    for _ in range(numBlocks):
        flips.step(-(-STRESS_ATTEMPTS // (numBlocks * attemptsPerSweep)))
        live = force.getTrianglesInContext(context)
        first, second = connectivity.pairHalfedges(live, len(mesh.vertices))
        origin, _ = connectivity.halfedges(live)
        assert np.all(origin[first] != origin[second])
        assert len(mesh.vertices) - len(first) + len(live) == 2
        assert np.bincount(live.ravel(), minlength=len(mesh.vertices)).min() >= 3
        # A new Context does not take triangles that are not a closed manifold.
        fresh = create(live)
        other = termsOf(fresh, createContext(mesh, fresh))
        scale = sum(abs(energy) for energy in other.values())
        moduli = {
            "area": fresh.getAreaModulus(),
            "volume": fresh.getVolumeModulus(),
            "areaDifference": fresh.getAreaDifferenceModulus(),
        }
        for term, energy in termsOf(force, context).items():
            # kappa (X/X_0-1)^2: the rounding of X/X_0, 1e-15, is not small against a deviation of nearly 0.
            rounding = 2e-15 * (moduli[term]._value * energy) ** 0.5 if term in moduli else 0
            assert energy == pytest.approx(other[term], rel=1e-9, abs=1e-13 * scale + rounding), term
    assert flips.getNumAttempted() >= STRESS_ATTEMPTS


# Detailed balance, seen: all triangulations of a few frozen vertices, and how often a run visits each.


def stateOf(triangles):
    """Return what tells two triangulations apart: the triangles, each from its first vertex."""
    return frozenset(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in triangles.tolist())


def flipped(state):
    """Return the triangulations that one flip makes."""
    apex = {(t[n], t[(n + 1) % 3]): t[(n + 2) % 3] for t in state for n in range(3)}
    valence = {v: sum(v in t for t in state) for v in range(6)}
    for (i, j), k in apex.items():
        l = apex[j, i]
        if i < j and (k, l) not in apex and min(valence[i], valence[j]) > 3:
            old = {t for t in state if i in t and j in t}
            yield (state - old) | stateOf(np.array([(l, j, k), (k, i, l)]))


def enumerateStates(start):
    states, unexplored = {start: 0}, [start]
    while unexplored:
        for state in flipped(unexplored.pop()):
            if state not in states:
                states[state] = len(states)
                unexplored.append(state)
    return states


def softForce(mesh, hasRepulsion):
    """Return a force whose energy differs by a few kJ/mol among the triangulations of six vertices."""
    force = mh.HelfrichForce()
    edge = mesh.edgeLengths.mean()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(0.05)
    force.setAreaModulus(0.5)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(0.15)
    force.setTargetVolume(mesh.volume)
    force.setAreaDifferenceModulus(0.15)
    force.setTargetAreaDifference(2 * mesh.vertexMeanCurvatures.sum())
    force.setTether(0.01, 0.8 * edge, 1.2 * edge, 2)
    if hasRepulsion:
        force.setRepulsion(0.5, 3 * edge, 2, 1)
    return force


def octahedron():
    vertices = np.concatenate((np.eye(3), -np.eye(3))) * [1, 0.9, 0.8]
    triangles = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    return mh.Mesh(vertices + np.random.default_rng(1).uniform(-0.1, 0.1, (6, 3)), triangles)


def energiesOf(mesh, states, hasRepulsion):
    force = softForce(mesh, hasRepulsion)
    # Some triangulations are inside out, which is an error where a user sets triangles and a volume term is on.
    force.setVolumeModulus(0)
    context = createContext(mesh, force)
    energies = []
    for state in states:
        force.setTrianglesInContext(context, sorted(state))
        volume = mh.Mesh(mesh.vertices, sorted(state)).volume
        energies.append(energyOf(context) + 0.15 * (volume / mesh.volume - 1) ** 2)
    return np.array(energies)


ATTEMPTS_PER_SAMPLE = 250


def pOf(counts, energies, kT):
    """Return the p value of chi square for counts of Boltzmann distributed states, the rare ones in one bin."""
    weights = np.exp((energies.min() - energies) / kT)
    expected = counts.sum() * weights / weights.sum()
    rare = expected < 10
    bins = expected[~rare], counts[~rare]
    if rare.any():
        bins = np.append(bins[0], expected[rare].sum()), np.append(bins[1], counts[rare].sum())
    return stats.chisquare(bins[1], bins[0]).pvalue


def test_enumeration():
    """The 195 triangulations of six labeled vertices (OEIS A000109, labeled), each of either orientation."""
    states = enumerateStates(stateOf(octahedron().triangles))
    assert len(states) == 2 * 195


@pytest.mark.parametrize("kT, hasRepulsion", list(itertools.product([1, 0.5], [False, True])))
def test_detailed_balance(kT, hasRepulsion):
    """Visits agree with Boltzmann weights, and would not agree with those of a wrong temperature or of another
    repulsion.
    """
    mesh = octahedron()
    states = enumerateStates(stateOf(mesh.triangles))
    energies = {repulsion: energiesOf(mesh, states, repulsion) for repulsion in (False, True)}
    force = softForce(mesh, hasRepulsion)
    flips = mh.EdgeFlipIntegrator(kelvin(kT), ATTEMPTS_PER_SAMPLE / len(mesh.edges))
    flips.setRandomNumberSeed(9)
    context = createContext(mesh, force, "CPU", flips)
    counts = np.zeros(len(states))
    for _ in range(20000):
        flips.step(1)
        counts[states[stateOf(force.getTrianglesInContext(context))]] += 1
    assert np.count_nonzero(counts) > 150
    assert pOf(counts, energies[hasRepulsion], kT) > 0.01
    assert pOf(counts, energies[hasRepulsion], 1.5 - kT) < 1e-9
    assert pOf(counts, energies[not hasRepulsion], kT) < 1e-9


@pytest.mark.parametrize("kT, hasRepulsion", list(itertools.product([1, 0.5], [False, True])))
def test_samples_are_independent(kT, hasRepulsion):
    """The transition matrix of the test above leaves less than 5% of any correlation between samples."""
    mesh = octahedron()
    states = enumerateStates(stateOf(mesh.triangles))
    energies = energiesOf(mesh, states, hasRepulsion)
    matrix = np.zeros((len(states), len(states)))
    for state, a in states.items():
        for other in flipped(state):
            b = states[other]
            matrix[a, b] = min(1, np.exp((energies[a] - energies[b]) / kT)) / len(mesh.edges)
        matrix[a, a] = 1 - matrix[a].sum()
    root = np.exp((energies.min() - energies) / (2 * kT))
    eigenvalues = np.linalg.eigvalsh(matrix * root[:, None] / root[None, :])
    assert eigenvalues[-1] == pytest.approx(1)
    assert eigenvalues[-2] ** ATTEMPTS_PER_SAMPLE < 0.05
