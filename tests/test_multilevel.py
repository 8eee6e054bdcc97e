"""Momenta on coarser meshes: that a trajectory remains reversible and preserves volume, that what is sampled stays the
same, and that every setting works with them.
"""

import json
import re
import zipfile
from xml.etree import ElementTree

import numpy as np
import openmm as mm
import pytest
from openmm import app

import openmmhelfrich as mh
from coarsemeshes import makeCoarseMeshes
from membranes import PLATFORMS, createBlob, createContext, createForce, energyOf, forcesOf, kelvin, positionsOf
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.tables import Table
from test_flips import flipped, octahedron, stateOf
from test_hmc import KT, assertMean, energyChangeOf, softForce, velocitiesOf
from test_minimization import createSimulation as createMinimization

ALMOST_NONE = 1e-300  # keeps all velocities, to the last bit


def createIntegrator(stepSize=0.002, steps=20, weight=2.0, kT=KT, seed=5, **settings):
    """Return an integrator of trajectories with coarser meshes; settings are by the names of its setters."""
    integrator = mh.HamiltonianTrajectoryIntegrator(kelvin(kT), stepSize, steps)
    integrator.setMultilevelWeight(weight)
    integrator.setRandomNumberSeed(seed)
    for name, value in settings.items():
        getattr(integrator, f"set{name}")(value)
    return integrator


def createRun(subdivisions=1, platform="Reference", properties=None, **settings):
    mesh = mh.Mesh.icosphere(subdivisions)
    integrator = createIntegrator(**settings)
    return mesh, integrator, createContext(mesh, softForce(mesh), platform, integrator, properties)


SETTINGS = {
    "leapfrog": {},
    "bcss2": {"Splitting": "bcss2"},
    "bcss3": {"Splitting": "bcss3", "TetherSubsteps": 3},
    "substeps": {"TetherSubsteps": 2, "TrajectoryJitter": 0.3},
}


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_reversed_trajectory_returns_to_its_start(platform, setting):
    """A rejection reverses all velocities, and the next trajectory goes back the way that the one before came."""
    mesh, integrator, context = createRun(
        2, platform, stepSize=0.001, MomentumRefreshment=ALMOST_NONE, **{**SETTINGS[setting], "TrajectoryJitter": 0}
    )
    integrator.step(3)
    start, accepted = positionsOf(context), integrator.getNumAccepted()
    integrator.step(1)
    end, velocities = positionsOf(context), velocitiesOf(context)
    assert integrator.getNumAccepted() == accepted + 1 and np.abs(end - start).max() > 0.01
    integrator.setStepSize(4)
    integrator.step(1)
    assert integrator.getNumAccepted() == accepted + 1
    assert np.array_equal(positionsOf(context), end) and np.array_equal(velocitiesOf(context), -velocities)
    integrator.setStepSize(0.001)
    integrator.step(1)
    assert integrator.getNumAccepted() == accepted + 2
    assert np.abs(positionsOf(context) - start).max() < 1e-12


def coordinatesOf(root):
    """Return where a State in XML has the positions and all velocities: nodes and names of their properties."""
    return [(node, axis) for node in [*root.find("Positions"), *root.iter("Velocity")] for axis in "xyz"]


def stateOfContext(context):
    state = context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    return ElementTree.fromstring(mm.XmlSerializer.serialize(state))


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_trajectory_preserves_volume(platform):
    """The Jacobian of the map from all positions and velocities, those of coarser meshes too, to those at the end."""
    # So hot that every trajectory is accepted.
    mesh, integrator, context = createRun(
        0, platform, stepSize=0.01, kT=1e9 * KT, MomentumRefreshment=ALMOST_NONE, Splitting="bcss2", TetherSubsteps=2
    )
    integrator.setTemperature(kelvin(KT))
    integrator.step(1)
    integrator.setTemperature(kelvin(1e9 * KT))
    root = stateOfContext(context)
    start = np.array([float(node.get(axis)) for node, axis in coordinatesOf(root)])
    assert len(start) > 2 * 3 * len(mesh.vertices)

    def move(point):
        for (node, axis), value in zip(coordinatesOf(root), point, strict=True):
            node.set(axis, repr(float(value)))
        context.setState(mm.XmlSerializer.deserialize(ElementTree.tostring(root, encoding="unicode")))
        accepted = integrator.getNumAccepted()
        integrator.step(1)
        assert integrator.getNumAccepted() == accepted + 1
        return np.array([float(node.get(axis)) for node, axis in coordinatesOf(stateOfContext(context))])

    assert np.abs(move(start) - start).max() > 0.01
    step = 1e-5
    jacobian = [(move(start + step * e) - move(start - step * e)) / (2 * step) for e in np.eye(len(start))]
    assert np.linalg.det(jacobian) == pytest.approx(1, abs=1e-5)
    assert np.abs(np.array(jacobian) - np.eye(len(start))).max() > 0.1


@pytest.mark.parametrize("refreshment", [1, 0.3])
def test_energy_changes_and_sampling(refreshment):
    """<exp(-dH/kT)> = 1, <KE> = 3NkT/2 of the vertices' own velocities, and <sum x.grad E> = (3N-3)kT, with flips,
    though trajectories are rejected and velocities kept.
    """
    mesh = mh.Mesh.icosphere(1)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), 0.003, 8, 0.2, 0.3)
    integrator.setMultilevelWeight(2)
    integrator.setMomentumRefreshment(refreshment)
    integrator.setRandomNumberSeed(5)
    context = createContext(mesh, softForce(mesh), "CPU", integrator)
    integrator.step(500)
    factors, kinetic, virial = [], [], []
    for _ in range(2000):
        integrator.step(5)
        x, v = positionsOf(context), velocitiesOf(context)
        factors.append(np.exp(-energyChangeOf(integrator) / KT))
        kinetic.append(np.sum(v**2) / 2)
        virial.append(-np.sum((x - x.mean(axis=0)) * forcesOf(context)))
    assert 0.5 < integrator.getAcceptanceRate() < 0.97
    assertMean(factors, 1)
    assertMean(kinetic, 1.5 * len(mesh.vertices) * KT)
    assertMean(virial, (3 * len(mesh.vertices) - 3) * KT)


def softOctahedron(mesh):
    """Return the forces on an octahedron whose vertices hang on springs: a good part of its energy depends on the
    triangulation.
    """
    force, edge = mh.HelfrichForce(), mesh.edgeLengths.mean()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(0.06)
    force.setAreaModulus(1)
    force.setTargetArea(mesh.area)
    force.setTether(0.01, 0.8 * edge, 1.2 * edge, 2)
    springs = mm.CustomExternalForce("12*((x-x0)^2+(y-y0)^2+(z-z0)^2)")
    for name in ("x0", "y0", "z0"):
        springs.addPerParticleParameter(name)
    for i, x in enumerate(mesh.vertices):
        springs.addParticle(i, x)
    return force, springs


def observables(energy, positions, triangles):
    """Return the energy, whether the triangulation is that of an octahedron, their product, and the size."""
    isRegular = np.all(np.bincount(np.ravel(triangles)) == 4)
    return energy, isRegular, energy * isRegular, np.sum((positions - positions.mean(axis=0)) ** 2)


def sampleByTrajectories(mesh, samples):
    integrator = mh.HybridMonteCarloIntegrator(kelvin(1), 0.03, 10, 1)
    integrator.setMultilevelWeight(2)
    integrator.setRandomNumberSeed(3)
    force, springs = softOctahedron(mesh)
    context = createContext(mesh, [force, springs], "Reference", integrator)
    for _ in range(samples):
        integrator.step(3)
        yield observables(energyOf(context), positionsOf(context), force.getTrianglesInContext(context))
    assert len(list(coordinatesOf(stateOfContext(context)))) > 2 * 3 * 6
    assert 0.5 < integrator.getAcceptanceRate() < 0.97 and integrator.getFlipAcceptanceRate() > 0.05


def sampleByMetropolis(mesh, samples):
    """Move all vertices at once, and try a flip of a uniformly drawn edge, in turns."""
    random = np.random.default_rng(4)
    force, springs = softOctahedron(mesh)
    context = createContext(mesh, [force, springs])
    x, state, energy = mesh.vertices, stateOf(mesh.triangles), energyOf(context)
    for _ in range(samples):
        for _ in range(3):
            others = list(flipped(state)) if random.random() < 0.5 else None
            trial, trialState = x, state
            if others is None:
                trial = x + random.normal(0, 0.1, x.shape)
            else:
                index = random.integers(12)
                trialState = others[index] if index < len(others) else state
            context.setPositions(trial)
            force.setTrianglesInContext(context, sorted(trialState))
            trialEnergy = energyOf(context)
            if random.random() < np.exp(energy - trialEnergy):
                x, state, energy = trial, trialState, trialEnergy
        yield observables(energy, x, sorted(state))


def test_the_joint_distribution_of_positions_and_triangles():
    """That of six vertices is that of a plain Metropolis simulation."""
    mesh, means, errors = octahedron(), [], []
    for sample in (sampleByTrajectories, sampleByMetropolis):
        batches = np.array(list(sample(mesh, 10000)), float).reshape(25, -1, 4).mean(axis=1)
        means.append(batches.mean(axis=0))
        errors.append(batches.std(axis=0, ddof=1) / 5)
    assert np.all(np.hypot(*errors) < 0.05 * means[1])
    assert np.all(np.abs(means[0] - means[1]) < 3 * np.hypot(*errors))


def createTwoMembranes():
    """Return two membranes, the first of two surfaces, a rough one and a small one; and beads that hang on them
    by springs.  Some vertices are fixed, and masses differ.
    """
    blob, far = createBlob(2), createBlob(1, seed=2)
    far.vertices = far.vertices * 0.7 + [3, 0, 0]
    small = octahedron()
    small.vertices = small.vertices * 0.3 + [0, 4, 0]
    first = mh.Mesh(
        np.concatenate((blob.vertices, small.vertices)),
        np.concatenate((blob.triangles, small.triangles + len(blob.vertices))),
    )
    return first, far


def simulateTwoMembranes(platform, properties=None, steps=12, seed=3, **settings):
    """Return positions, velocities and the triangles after trajectories and sweeps."""
    first, far = createTwoMembranes()
    offset, system = len(first.vertices), mm.System()
    vertices = np.concatenate((first.vertices, far.vertices, [[1.5, 0, 0], [1.7, 0, 0]]))
    for i in range(len(vertices)):
        system.addParticle(0 if i % 10 == 0 else 1 + 0.5 * (i % 3))
    forces = [createForce(first, ["bending", "tether", "repulsion"]), mh.HelfrichForce()]
    forces[1].setName("far")
    forces[1].setTriangles(far.triangles + offset)
    forces[1].setBendingModulus(20)
    forces[1].setTether(7, 0.3, 0.6, 2)
    bond = mm.HarmonicBondForce()
    bond.addBond(0, len(vertices) - 1, 1, 5)
    bond.addBond(offset + 1, len(vertices) - 2, 1, 5)
    for force in (*forces, bond):
        system.addForce(force)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.0002, 8, 0.2, 0.4)
    integrator.setMultilevelWeight(2)
    integrator.setRandomNumberSeed(seed)
    for name, value in settings.items():
        getattr(integrator, f"set{name}")(value)
    context = mm.Context(system, integrator, mm.Platform.getPlatform(platform), properties or {})
    context.setPositions(vertices)
    integrator.step(steps)
    assert integrator.getNumAcceptedTrajectories() > 0
    triangles = [force.getTrianglesInContext(context) for force in forces]
    return context, [positionsOf(context), velocitiesOf(context), *triangles], vertices


def test_platforms_agree():
    """Several membranes and surfaces, other particles, fixed vertices, masses that differ, velocities that are kept."""
    _, expected, start = simulateTwoMembranes("Reference", MomentumRefreshment=0.5)
    _, found, _ = simulateTwoMembranes("CPU", MomentumRefreshment=0.5)
    for a, b in zip(expected, found):
        assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
    moved = np.any(expected[0] != start, axis=1)
    assert np.array_equal(np.flatnonzero(~moved), np.arange(0, len(start), 10))


def simulateAlone(threads="1", other=False, steps=8, subdivisions=4, **settings):
    mesh = createBlob(subdivisions)
    integrator = mh.HybridMonteCarloIntegrator(30000, 0.00001, 10, 0.2, 0.5)
    integrator.setMultilevelWeight(2)
    integrator.setRandomNumberSeed(3)
    for name, value in settings.items():
        getattr(integrator, f"set{name}")(value)
    forces = [createForce(mesh), mm.CustomExternalForce("0")] if other else [createForce(mesh)]
    context = createContext(mesh, forces, "CPU", integrator, {"Threads": threads})
    integrator.step(steps)
    assert integrator.getNumAcceptedTrajectories() > 0
    return positionsOf(context), velocitiesOf(context), forces[0].getTrianglesInContext(context)


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_threads_make_no_difference(precision):
    """Nor does it, in double precision, whether the membrane moves its vertices itself."""
    settings = {"ForcePrecision": precision, "Splitting": "bcss2", "MomentumRefreshment": 0.6}
    expected = simulateAlone(**settings)
    others = [simulateAlone(threads, **settings) for threads in ("2", "3")]
    if precision == "double":
        others.append(simulateAlone("2", True, **settings))
    for found in others:
        assert all(np.array_equal(a, b) for a, b in zip(expected, found))


@pytest.mark.parametrize("kind", ["checkpoint", "state", "reinitialize"])
@pytest.mark.parametrize("platform", PLATFORMS)
def test_restarts(platform, kind):
    """Velocities of coarser meshes are part of checkpoints and States."""
    settings = {"MomentumRefreshment": 0.4}
    first, _, _ = simulateTwoMembranes(platform, **settings)
    checkpoint, state = first.createCheckpoint(), ElementTree.tostring(stateOfContext(first), encoding="unicode")
    first.getIntegrator().step(12)
    second, _, _ = simulateTwoMembranes(platform, steps=7, seed=8, **settings)
    if kind == "state":
        second.setState(mm.XmlSerializer.deserialize(state))
    else:
        second.loadCheckpoint(checkpoint)
    if kind == "reinitialize":
        second.reinitialize(True)
    second.getIntegrator().step(12)
    assert np.array_equal(positionsOf(first), positionsOf(second))
    assert np.array_equal(velocitiesOf(first), velocitiesOf(second))


def test_damaged_velocities_are_refused():
    context, _, _ = simulateTwoMembranes("CPU")
    state = ElementTree.tostring(stateOfContext(context), encoding="unicode")
    for damage, message in (
        (lambda text: re.sub(r'level="1"', 'level="0"', text, count=1), "level 0 for particle"),
        (lambda text: re.sub(r'particle="\d+"', 'particle="12345"', text, count=1), "particle 12345"),
    ):
        with pytest.raises(mm.OpenMMException, match=message):
            context.setState(mm.XmlSerializer.deserialize(damage(state)))


@pytest.mark.parametrize("platform", PLATFORMS)
def test_velocities_are_scaled(platform):
    """There and back by a factor of 2, to the last bit; in between a trajectory is another one."""
    _, trajectories, context = createRun(2, platform, stepSize=0.001, MomentumRefreshment=0.4)
    trajectories.step(3)
    checkpoint, positions = context.createCheckpoint(), []
    for factors in ((), (2, 0.5), (2,)):
        context.loadCheckpoint(checkpoint)
        for factor in factors:
            trajectories.scaleCoarseVelocities(factor)
        trajectories.step(6)
        positions.append(positionsOf(context))
    assert np.array_equal(positions[0], positions[1]) and not np.array_equal(positions[0], positions[2])
    for factor in (0, -1, np.nan, np.inf):
        with pytest.raises(mm.OpenMMException, match=r"the factor of velocities is .*; it must be finite and positive"):
            trajectories.scaleCoarseVelocities(factor)
    with pytest.raises(mm.OpenMMException, match="it is not bound to a Context"):
        createIntegrator().scaleCoarseVelocities(2)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_long_waves_move_faster(platform):
    """A trajectory moves the longest waves further than one without coarser meshes, and short ones alike."""
    lengths = []
    for weight in (0, 2):
        mesh, integrator, context = createRun(3, platform, stepSize=0.0001, steps=10, weight=weight)
        integrator.step(1)
        move = positionsOf(context) - mesh.vertices
        lengths.append((np.linalg.norm(move.mean(axis=0)), np.linalg.norm(move)))
    assert lengths[1][0] > 4 * lengths[0][0] and lengths[1][1] < 4 * lengths[0][1]


def test_settings():
    integrator = mh.HybridMonteCarloIntegrator(300, 0.1)
    assert integrator.getMultilevelWeight() == 0
    assert 'version="2"' not in mm.XmlSerializer.serialize(integrator.getMove(0))
    integrator.setMultilevelWeight(1.5)
    text = mm.XmlSerializer.serialize(integrator)
    copy = mh.HybridMonteCarloIntegrator.cast(mm.XmlSerializer.deserialize(text))
    assert copy.getMultilevelWeight() == copy.getMove(0).getMultilevelWeight() == 1.5
    for value in (-1, np.nan, np.inf, 1e4):
        with pytest.raises(mm.OpenMMException, match=r"the multilevel weight is .*; it must be"):
            integrator.setMultilevelWeight(value)
    with pytest.raises(mm.OpenMMException, match=r"refreshment of momenta is 1\.000000001\d*; it must"):
        integrator.setMomentumRefreshment(1 + 1e-9)
    with pytest.raises(mm.OpenMMException, match="jitter of trajectories is -1e-09; it must be from 0"):
        integrator.setTrajectoryJitter(-1e-9)
    custom = mh.HybridMonteCarloIntegrator(300, 0.1, engine="custom")
    custom.setMultilevelWeight(0)
    with pytest.raises(mm.OpenMMException, match="the multilevel weight is 2"):
        custom.setMultilevelWeight(2)


def test_configuration():
    config = parseConfig(
        {"mesh": {"icosphere": 1}, "sampling": {"multilevel_weight": 2}, "platform": {"name": "Reference"}}
    )
    assert Scene.of(config, mh.Mesh.icosphere(1)).createIntegrator().getMultilevelWeight() == 2
    for value in (-1, 1001, "much", True, float("nan")):
        with pytest.raises(ValueError, match=r"multilevel_weight is .*it must be a number from 0 to 1000, or 'auto'"):
            parseConfig({"mesh": {"icosphere": 1}, "sampling": {"multilevel_weight": value}})


def weightOf(subdivisions, membrane=None, sampling=None):
    config = {"membrane": membrane or {}, "sampling": sampling or {}}
    scene = Scene.of(config, mh.Mesh.icosphere(subdivisions))
    assert scene.createIntegrator().getMultilevelWeight() == scene.config.sampling.multilevel_weight
    return scene.config.sampling.multilevel_weight


def test_the_weight_is_chosen():
    """By default a large surface has coarser meshes, where they do not make steps shorter."""
    assert weightOf(4) == weightOf(4, sampling={"multilevel_weight": "auto"}) == weightOf(4, {"volume_modulus": 0}) == 2
    assert weightOf(3) == 0
    assert weightOf(4, sampling={"multilevel_weight": 0}) == 0
    assert weightOf(4, sampling={"tether_substeps": 2}) == 0
    assert weightOf(4, {"area_modulus": 1e8}) == weightOf(4, {"volume_modulus": 1e8}) == 0
    assert weightOf(4, sampling={"step_size": 2e-3}) == 0 < weightOf(4, sampling={"step_size": 1e-4})
    sphere = mh.Mesh.icosphere(3)
    two = mh.Mesh(
        np.concatenate((sphere.vertices, np.add(sphere.vertices, [3, 0, 0]))),
        np.concatenate((sphere.triangles, sphere.triangles + len(sphere.vertices))),
    )
    assert Scene.of({}, two).config.sampling.multilevel_weight == 0


@pytest.mark.parametrize("stepSize", [None, "auto"])
@pytest.mark.parametrize(
    ("stage", "weight"),
    [
        ({"kind": "sample"}, 2),
        ({"kind": "sample", "volume_modulus": 1e8}, 0),
        ({"kind": "approach", "volume_modulus": 1e8}, 0),
        ({"kind": "sample", "volume_modulus": 1e5}, 2),
        ({"kind": "sample", "step_size": 0.01}, 0),
    ],
)
def test_the_weight_is_one_for_all_stages(stepSize, stage, weight):
    first, stage = {"kind": "sample", "steps": 10}, {**stage, "steps": 10}
    scene = Scene.of({"stages": [first, stage], "sampling": {"step_size": stepSize}}, mh.Mesh.icosphere(4))
    assert scene.config.sampling.multilevel_weight == weight


def test_a_run_tells_the_weight(tmp_path):
    config = {
        "mesh": {"icosphere": 4},
        "sampling": {"steps": 2, "steps_per_trajectory": 2, "seed": 1},
        "output": {"prefix": str(tmp_path / "run")},
    }
    mh.run(config)
    assert "multilevel_weight = 2" in (tmp_path / "run.resolved.toml").read_text()
    assert "[sampling] multilevel_weight is 2" in (tmp_path / "run.resolved.toml").read_text()


def test_older_runs_go_on_without(tmp_path):
    """A checkpoint that does not name the weight is of a version that had none."""
    stages = [{"kind": "sample", "steps": 2}]
    sampling = {"steps_per_trajectory": 2, "seed": 1, "multilevel_weight": 0}
    config = {
        "mesh": {"icosphere": 4},
        "sampling": sampling,
        "stages": stages,
        "output": {"prefix": str(tmp_path / "run")},
    }
    mh.run(config)
    checkpoint = tmp_path / "run.checkpoint"
    with zipfile.ZipFile(checkpoint) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    state = json.loads(parts["run.json"])
    del state["config"]["sampling"]["multilevel_weight"]
    parts["run.json"] = json.dumps(state).encode()
    with zipfile.ZipFile(checkpoint, "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
    mh.resume(tmp_path / "run", steps=2)
    assert "multilevel_weight = 0" in (tmp_path / "run.resolved.toml").read_text()


def test_stages_have_weights(tmp_path):
    """Minimizations and annealing take one; other stages go on with that of [sampling]."""
    seen = []
    config = {
        "mesh": {"icosphere": 2},
        "membrane": {"reduced_volume": 0.9},
        "sampling": {"steps_per_trajectory": 2, "seed": 1, "multilevel_weight": 1},
        "stages": [
            {"kind": "minimize", "multilevel_weight": 2, "max_iterations": 30},
            {"kind": "anneal", "steps": 2, "end_temperature": 100, "multilevel_weight": 0.5},
            {"kind": "anneal", "steps": 2, "end_temperature": 100},
            {"kind": "sample", "steps": 2},
        ],
        "output": {"prefix": str(tmp_path / "run")},
    }
    mh.run(config, lambda study: seen.append((study.index, study.simulation.integrator.getMultilevelWeight())))
    assert [dict(seen)[i] for i in (1, 2, 3)] == [0.5, 1, 1]


def test_a_minimization_by_coarser_meshes_is_that_of_the_function(tmp_path):
    energies = []
    for weight in (0, 2):
        config = {
            "mesh": {"icosphere": 2},
            "membrane": {"reduced_volume": 0.95},
            "sampling": {"seed": 1},
            "stages": [{"kind": "minimize", "fluid": False, "multilevel_weight": weight, "max_iterations": 40}],
            "output": {"prefix": str(tmp_path / f"run{weight}")},
        }
        mh.run(config)
        scene = Scene.of(config)
        force = scene.createForce()
        simulation = scene.createSimulation(force)
        result = mh.minimize(simulation, force, maxIterations=40, multilevelWeight=weight)
        energies.append(Table.read(tmp_path / f"run{weight}.csv")["energy"][-1])
        assert energies[-1] == pytest.approx(result.energy._value / scene.kT, rel=1e-6)
    assert energies[0] != energies[1]


def test_the_step_size_adapts():
    mesh = mh.Mesh.icosphere(1)
    system = mesh.createSystem()
    system.addForce(softForce(mesh))
    integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), 0.0003, 8, 0.2, 0.2)
    integrator.setMultilevelWeight(2)
    integrator.setRandomNumberSeed(1)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    mh.adaptStepSize(simulation, 300)
    before = integrator.getNumTrajectories(), integrator.getNumAcceptedTrajectories()
    simulation.step(500)
    rate = (integrator.getNumAcceptedTrajectories() - before[1]) / (integrator.getNumTrajectories() - before[0])
    assert integrator.getStepSize()._value > 0.001 and 0.5 < rate < 0.95


@pytest.mark.parametrize("platform", PLATFORMS)
def test_matrices_are_those_of_trajectories(platform):
    """From rest, a step of leapfrog moves vertices by h^2/2m B B^T f."""
    mesh, step, weight = createBlob(3), 1e-5, 1.7
    isFixed = np.arange(len(mesh.vertices)) % 7 == 0
    integrator = createIntegrator(step, 1, weight, kT=1e-25)
    system = mesh.createSystem()
    for i in np.flatnonzero(isFixed):
        system.setParticleMass(int(i), 0)
    system.addForce(createForce(mesh, ["bending"]))
    context = mm.Context(system, integrator, mm.Platform.getPlatform(platform))
    context.setPositions(mesh.vertices)
    forces = forcesOf(context)
    integrator.step(1)
    assert integrator.getNumAccepted() == 1
    meshes = makeCoarseMeshes(mesh.triangles, len(mesh.vertices), weight, isFixed)
    forces[isFixed] = 0
    motion = meshes.move(meshes.gather(forces))
    motion[isFixed] = 0
    found = (positionsOf(context) - mesh.vertices) * 2 / step**2
    assert np.abs(found - motion).max() < 1e-6 * np.abs(motion).max()


def test_minimization():
    """Coarser meshes lead to the same minimum, in fewer iterations where there are many vertices."""
    results = []
    for weight in (0, 2):
        mesh = mh.spheroid(2562, mh.spheroidAspectRatio(0.8, "prolate"))
        force, simulation = createMinimization(mesh, 0.8)
        results.append(mh.minimizeFluid(simulation, force, multilevelWeight=weight))
        assert results[-1].converged
        assert energyOf(simulation.context) == results[-1].energy._value == pytest.approx(results[-1].history[-1])
    assert results[1].iterations < 0.7 * results[0].iterations
    assert results[1].energy._value == pytest.approx(results[0].energy._value, rel=1e-3)
    with pytest.raises(ValueError, match="the multilevel weight is -1"):
        mh.minimize(simulation, force, multilevelWeight=-1)


def test_stiff_penalties_do_not_slow_minimization():
    """Coarser meshes do not move a membrane along penalties that they would make the stiffest of all."""
    mesh = mh.spheroid(642, mh.spheroidAspectRatio(0.9, "prolate"))
    noise = np.random.default_rng(3).normal(size=mesh.vertices.shape)
    rough = mh.Mesh(mesh.vertices + 0.08 * mesh.edgeLengths.mean() * noise, mesh.triangles)
    results = []
    for weight in (0, 2):
        force, simulation = createMinimization(rough, 0.9)
        force.setAreaModulus(1e6 * force.getBendingModulus())
        force.setVolumeModulus(1e6 * force.getBendingModulus())
        force.updateParametersInContext(simulation.context)
        results.append(mh.minimize(simulation, force, maxIterations=2000, multilevelWeight=weight))
        assert results[-1].converged
    assert results[1].iterations < 1.5 * results[0].iterations
    assert results[1].energy._value == pytest.approx(results[0].energy._value, rel=1e-2)


def test_minimization_keeps_what_is_fixed():
    mesh = createBlob(1)
    force = createForce(mesh)
    system = mesh.createSystem()
    for i in (0, 7):
        system.setParticleMass(i, 0)
    system.addForce(force)
    simulation = app.Simulation(mesh.topology(), system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    calls = []
    result = mh.minimize(
        simulation,
        force,
        multilevelWeight=1,
        progress=lambda n, energy: calls.append(energy) or n == 20,
    )
    moved = np.any(positionsOf(simulation.context) != mesh.vertices, axis=1)
    assert np.array_equal(np.flatnonzero(~moved), [0, 7])
    assert result.iterations == len(calls) == 20 and calls == sorted(calls, reverse=True)


def test_levels():
    """Meshes of up to 48 vertices have no coarser one, but for a membrane of more than 4."""

    def sizesOf(mesh):
        count = len(mesh.vertices)
        return makeCoarseMeshes(mesh.triangles, count, 2, np.zeros(count, bool)).sizes

    assert sizesOf(mh.Mesh.icosphere(1)) == [42, 12]
    assert sizesOf(mh.Mesh.icosphere(2)) == [162, 42]
    assert sizesOf(mh.Mesh.icosphere(3)) == [642, 162, 42]
