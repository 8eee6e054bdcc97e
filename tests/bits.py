"""Record what runs give, to the last bit, and compare it with what the same runs give later.

    python tests/bits.py record DIR                    # make all runs
    python tests/bits.py compare DIR                   # make them again, and say of each item whether it is the same
    python tests/bits.py compare DIR --only NAME ...   # some of the runs
    python tests/bits.py compare DIR --seed 2          # other random numbers: nearly everything must differ

DIR/NAME.npz has the bits, DIR/NAME.json is to be read.  Together the runs use every term, move, splitting, precision,
platform and kind of stage.  A change that is not to change results is proved by a recording made before it and a
comparison after it, with the same versions of everything else.

The bits are those of one machine and one instruction set (the environment variable OPENMM_HELFRICH_SIMD chooses another
one): a recording is of no use on another processor or with another compiler.
"""

import argparse
import csv
import hashlib
import itertools
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import openmm as mm
from openmm import unit

import openmmhelfrich as mh

ROOT = Path(__file__).resolve().parent.parent
KT = 2.494338785445972  # kJ/mol at 300 K
FAILED = 3  # the exit code of a run whose verdict is so, and which has results all the same
TERMS = ("bending", "area", "volume", "areaDifference", "tether", "repulsion")
STATISTICS = (
    "getNumSweeps",
    "getNumTrajectories",
    "getNumAttempted",
    "getNumAccepted",
    "getNumForbidden",
    "getNumAlike",
    "getNumDiverged",
    "getLastNumSteps",
    "getLastEnergyChange",
    "getLastAcceptanceProbability",
    "getAcceptanceRate",
    "getFlipAcceptanceRate",
    "getFlipRate",
    "getNumDivergedTrajectories",
)
RUNS: dict[str, Callable] = {}


def run(function):
    """Make a function one of the runs: it takes a seed, and returns arrays and texts by name."""
    RUNS[function.__name__] = function
    return function


# Scenes


def createMesh(subdivisions, seed=1):
    """Return a rough, flat ellipsoid away from the origin, whose edges have the mean length 1."""
    mesh = mh.Mesh.icosphere(subdivisions)
    noise = np.random.default_rng(seed).uniform(-0.1, 0.1, mesh.vertices.shape)
    mesh.vertices = mesh.vertices * [1, 0.9, 0.7]
    mesh.vertices = mesh.vertices / mesh.edgeLengths.mean() + noise + [0.3, -0.2, 0.5]
    return mesh


def createForce(mesh, level=1, terms=TERMS, lengthScale=None):
    """Return a force on a mesh near its targets, with an exclusion level of the repulsion."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    if "bending" in terms:
        force.setBendingModulus(20 * KT)
    if "area" in terms:
        force.setAreaModulus(2e4 * KT)
        force.setTargetArea(1.01 * mesh.area)
    if "volume" in terms:
        force.setVolumeModulus(1e4 * KT)
        force.setTargetVolume(0.98 * mesh.volume)
    if "areaDifference" in terms:
        force.setAreaDifferenceModulus(200 * KT)
        force.setLeafletSeparation(0.1)
        force.setTargetAreaDifference(0.19 * mesh.vertexMeanCurvatures.sum())
    if "tether" in terms:
        force.setTether(50 * KT, 0.8, 1.3, 2)
    if lengthScale is not None:
        force.setTetherLengthScale(lengthScale)
    if "repulsion" in terms:
        force.setRepulsion((0.5 if level == 0 else 2) * KT, (1, 1.6, 2.6)[level], 2, level)
    return force


def fixEveryTenthEdge(force, mesh):
    for a, b in mesh.edges[::10]:
        force.addFixedEdge(a, b)
    return force


def createTrajectories(
    stepSize=0.002, steps=20, splitting="leapfrog", precision="double", substeps=1, jitter=0, refreshment=1, seed=1
):
    integrator = mh.HamiltonianTrajectoryIntegrator(300, stepSize, steps)
    integrator.setSplitting(splitting)
    integrator.setForcePrecision(precision)
    integrator.setTetherSubsteps(substeps)
    integrator.setTrajectoryJitter(jitter)
    integrator.setMomentumRefreshment(refreshment)
    integrator.setRandomNumberSeed(seed)
    return integrator


def createFlips(seed, fraction=0.3, temperature=300):
    integrator = mh.EdgeFlipIntegrator(temperature, fraction)
    integrator.setRandomNumberSeed(seed)
    return integrator


def createWaves(seed, mesh, moves=5):
    radius = (mesh.area / (4 * np.pi)) ** 0.5
    integrator = mh.ShearWaveIntegrator(300, radius / len(mesh.vertices) ** 0.5, 1 / radius, 3 / radius, moves)
    integrator.setRandomNumberSeed(seed)
    return integrator


def mix(seed, trajectories, flips, waves=None):
    """Return a mixture of moves."""
    integrator = mh.HybridMonteCarloIntegrator(trajectories, flips, 0.4)
    if waves is not None:
        integrator.addShearWaves(waves, 0.2)
    integrator.setRandomNumberSeed(seed, False)
    return integrator


# What is recorded


def simulate(
    mesh, force, integrator, steps, moves=(), platform="CPU", threads=1, system=None, positions=None, change=None
):
    """Make Monte Carlo steps, and return what they leave.

    ``moves`` are the integrators whose statistics are recorded besides that of ``integrator``; ``change`` is called
    half-way with the Context.
    """
    forces = force if isinstance(force, list) else [force]
    if system is None:
        system = mesh.createSystem(1.0)
        for item in forces:
            system.addForce(item)
    properties = {"Threads": str(threads)} if platform == "CPU" else {}
    context = mm.Context(system, integrator, mm.Platform.getPlatformByName(platform), properties)
    context.setPositions(mesh.vertices if positions is None else positions)
    items = {"system.xml": mm.XmlSerializer.serialize(system), "start forces": forcesOf(context)}
    energies = [energiesOf(forces, context)]
    for part in range(10):
        integrator.step(steps // 10)
        energies.append(energiesOf(forces, context))
        if change is not None and part == 4:
            change(context)
    items["energies"] = np.array(energies)
    items.update(stateOf(forces, context))
    for move in (integrator, *moves):
        items.update(statisticsOf(move))
    return items


def plain(value):
    """Return what a Quantity holds, with no conversion that could round it."""
    return value.value_in_unit(value.unit) if unit.is_quantity(value) else value


def energiesOf(forces, context):
    """Return the energies of each force by term, in the order of TERMS."""
    terms = [force.getEnergyTermsInContext(context) for force in forces]
    return [[plain(energies[term]) for term in TERMS] for energies in terms]


def forcesOf(context):
    forces = context.getState(forces=True).getForces(asNumpy=True)
    return forces.value_in_unit(unit.kilojoule_per_mole / unit.nanometer)


def stateOf(forces, context):
    state = context.getState(positions=True, velocities=True, energy=True, parameters=True)
    items = {
        "positions": state.getPositions(asNumpy=True).value_in_unit(unit.nanometer),
        "velocities": state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond),
        "forces": forcesOf(context),
        "potential energy": plain(state.getPotentialEnergy()),
        "kinetic energy": plain(state.getKineticEnergy()),
        "time": plain(state.getTime()),
        "step count": context.getStepCount(),
    }
    items.update({f"parameter {name}": value for name, value in state.getParameters().items()})
    for i, force in enumerate(forces):
        geometry = force.getGeometryInContext(context)
        items[f"triangles {i}"] = force.getTrianglesInContext(context)
        if force.getNumSpecies() > 0:
            items[f"species {i}"] = force.getVertexSpeciesInContext(context)
        items[f"geometry {i}"] = np.array(
            [plain(getattr(geometry, name)) for name in ("area", "volume", "areaDifference", "integratedMeanCurvature")]
        )
        items[f"vertex areas {i}"] = plain(geometry.vertexAreas)
        items[f"vertex mean curvatures {i}"] = plain(geometry.vertexMeanCurvatures)
    return items


def statisticsOf(move):
    names = [name for name in STATISTICS if hasattr(move, name)]
    return {f"{type(move).__name__}.{name}": plain(getattr(move, name)()) for name in names}


# The moves on the CPU platform


@run
def leapfrog_642(seed):
    mesh = createMesh(3)
    trajectories, flips = createTrajectories(0.006, seed=seed), createFlips(seed)
    return simulate(mesh, createForce(mesh, 1), mix(seed, trajectories, flips), 400, (trajectories, flips))


@run
def bcss2_mixed_2562(seed):
    mesh = createMesh(4)
    trajectories = createTrajectories(0.005, 20, "bcss2", "mixed", jitter=0.4, refreshment=0.5, seed=seed)
    flips = createFlips(seed)
    force = createForce(mesh, 2, lengthScale=1.1)
    return simulate(mesh, force, mix(seed, trajectories, flips), 100, (trajectories, flips), threads=2)


@run
def bcss3_substeps_2562(seed):
    mesh = createMesh(4)
    trajectories = createTrajectories(0.006, 30, "bcss3", substeps=3, seed=seed)
    flips = createFlips(seed)
    return simulate(mesh, createForce(mesh, 0), mix(seed, trajectories, flips), 100, (trajectories, flips))


@run
def waves_and_substeps_mixed_642(seed):
    mesh = createMesh(3)
    trajectories = createTrajectories(0.012, 20, "leapfrog", "mixed", 4, 0.3, 0.7, seed)
    flips, waves = createFlips(seed), createWaves(seed, mesh)
    force = fixEveryTenthEdge(createForce(mesh, 1, lengthScale=0.9), mesh)
    return simulate(mesh, force, mix(seed, trajectories, flips, waves), 200, (trajectories, flips, waves), threads=2)


@run
def trajectories_10242(seed):
    mesh = createMesh(5)
    return simulate(mesh, createForce(mesh, 2), createTrajectories(0.005, 20, seed=seed), 40, threads=2)


@run
def trajectories_mixed_10242(seed):
    mesh = createMesh(5)
    terms = [term for term in TERMS if term != "repulsion"]
    integrator = createTrajectories(0.005, 20, precision="mixed", seed=seed)
    return simulate(mesh, createForce(mesh, 1, terms), integrator, 40)


def addSpecies(force, mesh):
    """Replace the material of a force by three species in patches, with all that acts between them."""
    for moduli in ((20 * KT, 0.3, -15 * KT), (8 * KT, -0.2, 6 * KT), (30 * KT, 0.0, 0.0)):
        force.addSpecies(*moduli)
    force.setLineTension(0, 1, 4 * KT)
    force.setLineTension(1, 2, 2 * KT)
    force.setPairEnergy(0, 2, KT)
    force.setSpontaneousCurvature(0.1)
    x = mesh.vertices / np.abs(mesh.vertices).max()
    force.setVertexSpecies(np.digitize(np.sin(5 * x[:, 0]) + x[:, 1], (-0.5, 0.5)))
    return force


@run
def species_642(seed):
    mesh = createMesh(3)
    trajectories, flips = createTrajectories(0.005, seed=seed), createFlips(seed)
    force = addSpecies(createForce(mesh, 1), mesh)
    return simulate(mesh, force, mix(seed, trajectories, flips), 200, (trajectories, flips), threads=2)


@run
def exchanges_642(seed):
    mesh = createMesh(3)
    trajectories, flips = createTrajectories(0.005, seed=seed), createFlips(seed)
    moves = [mh.SpeciesExchangeIntegrator(300, fraction) for fraction in (0.5, 0.2, 0.1)]
    integrator = mix(seed, trajectories, flips)
    for move, proposal in zip(moves, ("neighbors", "anywhere", "mutation")):
        move.setProposal(proposal)
        move.setChemicalPotential(1, 0.5 * KT)
        move.setRandomNumberSeed(seed)
        integrator.addMove(move, 0.15)
    force = addSpecies(createForce(mesh, 1), mesh)
    return simulate(mesh, force, integrator, 200, (trajectories, flips, *moves[:1]), threads=2)


@run
def species_mixed_642(seed):
    mesh = createMesh(3)
    trajectories, flips = createTrajectories(0.005, 20, "bcss2", "mixed", 2, seed=seed), createFlips(seed)
    force = addSpecies(createForce(mesh, 1), mesh)
    return simulate(mesh, force, mix(seed, trajectories, flips), 100, (trajectories, flips))


@run
def waves_2562(seed):
    mesh = createMesh(4)
    return simulate(mesh, createForce(mesh, 1), createWaves(seed, mesh, 10), 50, threads=2)


def flipsOn(mesh, seed, level, temperature, fraction, steps, threads, fixes=False):
    force = createForce(mesh, level)
    if fixes:
        fixEveryTenthEdge(force, mesh)
    return simulate(mesh, force, createFlips(seed, fraction, temperature), steps, threads=threads)


@run
def hot_flips_10242_level_0(seed):
    return flipsOn(createMesh(5), seed, 0, 30000, 0.3, 10, 2)


@run
def hot_flips_10242_level_1(seed):
    return flipsOn(createMesh(5), seed, 1, 30000, 1, 10, 1)


@run
def hot_flips_10242_level_2_fixed_edges(seed):
    return flipsOn(createMesh(5), seed, 2, 30000, 0.3, 10, 2, True)


@run
def cold_flips_10242(seed):
    return flipsOn(createMesh(5), seed, 1, 0, 1, 10, 2)


@run
def cold_flips_2562_level_2(seed):
    return flipsOn(createMesh(4), seed, 2, 30, 0.1, 100, 1, True)


@run
def flips_163842(seed):
    """A membrane of which threads have no copies of their own."""
    mesh = createMesh(7)
    terms = [term for term in TERMS if term != "repulsion"]
    force = createForce(mesh, terms=terms)
    return simulate(mesh, force, createFlips(seed, 0.02, 3000), 10, threads=2)


@run
def order_of_vertices_162(seed):
    """After a thousand sweeps the vertices have another order."""
    mesh = createMesh(2)
    trajectories, flips = createTrajectories(0.01, 5, seed=seed), createFlips(seed, 0.1)
    return simulate(mesh, createForce(mesh, 1), mix(seed, trajectories, flips), 3000, (trajectories, flips))


@run
def custom_642(seed):
    mesh = createMesh(3)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.008, 10, 0.3, 0.4, engine="custom")
    integrator.setRandomNumberSeed(seed)
    return simulate(mesh, createForce(mesh, 1), integrator, 100)


@run
def langevin_642(seed):
    mesh = createMesh(3)
    langevin, flips = mm.LangevinMiddleIntegrator(300, 50, 0.001), createFlips(seed)
    langevin.setRandomNumberSeed(seed)
    return simulate(mesh, createForce(mesh, 2), mix(seed, langevin, flips), 200, (flips,))


@run
def diverging_642(seed):
    """Trajectories whose step is far too long are rejected moves."""
    mesh = createMesh(3)
    trajectories, flips = createTrajectories(5, 20, "bcss2", jitter=0.5, seed=seed), createFlips(seed)
    return simulate(mesh, createForce(mesh, 1), mix(seed, trajectories, flips), 50, (trajectories, flips))


@run
def diverging_custom_642(seed):
    mesh = createMesh(3)
    integrator = mh.HybridMonteCarloIntegrator(300, 5, 10, 0.3, 0.4, engine="custom")
    integrator.setRandomNumberSeed(seed)
    return simulate(mesh, createForce(mesh, 1), integrator, 50)


@run
def changes_642(seed):
    """Targets, moduli and triangles of a Context change on the way."""
    mesh = createMesh(3)
    force = createForce(mesh, 1)

    def change(context):
        context.setParameter(force.getTargetVolumeParameter(), 0.97 * mesh.volume)
        context.setParameter(force.getTargetAreaParameter(), 1.02 * mesh.area)
        context.setParameter(force.getTargetAreaDifferenceParameter(), 0.2 * mesh.vertexMeanCurvatures.sum())
        force.setBendingModulus(15 * KT)
        force.setTetherLengthScale(1.2)
        force.setRepulsion(KT, 2.6, 3, 2)
        force.updateParametersInContext(context)
        force.setTrianglesInContext(context, np.roll(force.getTrianglesInContext(context), 7, axis=0))

    trajectories, flips = createTrajectories(0.005, seed=seed), createFlips(seed)
    return simulate(mesh, force, mix(seed, trajectories, flips), 100, (trajectories, flips), change=change)


# Several membranes, other particles and forces


def createCompany(platform, numMembranes):
    """Return a mesh, the forces, System and positions of membranes with a bead in each and forces between all; some
    particles are fixed.
    """
    subdivisions = 1 if platform == "Reference" else 2
    meshes = [createMesh(subdivisions, seed) for seed in range(1, 1 + numMembranes)]
    n = len(meshes[0].vertices)
    beads = [n + i * (n + 1) for i in range(numMembranes)]
    system = mm.System()
    for i in range(numMembranes * (n + 1)):
        system.addParticle(0 if i in (3, 17) else 1)
    forces = []
    for i, mesh in enumerate(meshes):
        force = createForce(mesh, i + 1)
        force.setName(f"Vesicle{i}")
        force.setForceGroup(i)
        force.setTriangles(mesh.triangles + i * (n + 1))
        system.addForce(force)
        forces.append(force)
    ties = mm.CustomExternalForce("5*((x-0.3)^2+(y+0.2)^2+z^2)")
    for bead in beads:
        ties.addParticle(bead, [])
    contacts = mm.CustomNonbondedForce("50*step(2-r)*(2-r)^2")
    for _ in range(system.getNumParticles()):
        contacts.addParticle([])
    contacts.addInteractionGroup(beads, set(range(system.getNumParticles())) - set(beads))
    for force in ties, contacts:
        force.setForceGroup(5)
        system.addForce(force)
    width = 1.1 * (meshes[0].vertices.max() - meshes[0].vertices.min())
    positions = [
        np.vstack((mesh.vertices, mesh.vertices.mean(axis=0))) + np.array([i * width, 0, 0])
        for i, mesh in enumerate(meshes)
    ]
    return meshes[0], forces, system, np.concatenate(positions)


def simulateCompany(seed, platform, numMembranes, steps, **settings):
    mesh, forces, system, positions = createCompany(platform, numMembranes)
    moves = createTrajectories(0.01, 12, seed=seed, **settings), createFlips(seed), createWaves(seed, mesh)
    return simulate(mesh, forces, mix(seed, *moves), steps, moves, platform, system=system, positions=positions)


@run
def two_membranes_162(seed):
    return simulateCompany(seed, "CPU", 2, 100, splitting="bcss3", substeps=2, jitter=0.3, refreshment=0.6)


@run
def membrane_and_bead_162(seed):
    return simulateCompany(seed, "CPU", 1, 100, precision="mixed")


# The Reference platform


@run
def reference_162(seed):
    mesh = createMesh(2)
    moves = (
        createTrajectories(0.015, 12, "bcss3", "double", 2, 0.3, 0.6, seed),
        createFlips(seed),
        createWaves(seed, mesh),
    )
    return simulate(mesh, createForce(mesh, 1, lengthScale=1.1), mix(seed, *moves), 60, moves, "Reference")


@run
def reference_leapfrog_42(seed):
    mesh = createMesh(1)
    moves = createTrajectories(0.012, 10, seed=seed), createFlips(seed)
    return simulate(mesh, createForce(mesh, 0), mix(seed, *moves), 100, moves, "Reference")


@run
def reference_hot_flips_642(seed):
    mesh = createMesh(3)
    force = fixEveryTenthEdge(createForce(mesh, 2), mesh)
    return simulate(mesh, force, createFlips(seed, 0.2, 30000), 10, platform="Reference")


@run
def reference_custom_42(seed):
    mesh = createMesh(1)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.008, 10, 0.3, 0.4, engine="custom")
    integrator.setRandomNumberSeed(seed)
    return simulate(mesh, createForce(mesh, 1), integrator, 40, platform="Reference")


@run
def reference_two_membranes_42(seed):
    return simulateCompany(seed, "Reference", 2, 30, splitting="bcss2", substeps=2)


# Every subset of the terms


def simulateSubsets(subdivisions, platform, seed):
    """Return forces, energies and a few moves for each of the 64 subsets of terms, the first axis of every array."""
    mesh, rows = createMesh(subdivisions), []
    for on in itertools.product((False, True), repeat=len(TERMS)):
        terms = [term for term, isOn in zip(TERMS, on) if isOn]
        precision = "mixed" if platform == "CPU" and sum(on) % 2 else "double"
        moves = createTrajectories(0.008, 4, precision=precision, seed=seed), createFlips(seed, 1, 3000)
        rows.append(simulate(mesh, createForce(mesh, 1, terms), mix(seed, *moves), 10, moves, platform))
    return {name: np.array([row[name] for row in rows]) for name in rows[0] if name != "system.xml"}


@run
def subsets_of_terms_162(seed):
    return simulateSubsets(2, "CPU", seed)


@run
def reference_subsets_of_terms_12(seed):
    return simulateSubsets(0, "Reference", seed)


# The command

STAGES = """
[[stages]]
kind = "minimize"
fluid = false
max_iterations = 200
[[stages]]
kind = "minimize"
max_iterations = 300
reduced_volume = 0.95
[[stages]]
kind = "sample"
steps = 60
[[stages]]
kind = "sample"
steps = 40
temperature = 100
step_size = 1e-4
[[stages]]
kind = "anneal"
steps = 50
end_temperature = 30
cooling_start = 10
[[stages]]
kind = "anneal"
steps = 30
table = [[0, 300], [30, 100]]
[[stages]]
kind = "continue"
windows = 2
target_area = 12.4
reduced_volume = 0.9
equilibration = 10
steps = 10
there_and_back = true
path = {target_area = [0.0, 0.0, 1.0]}
"""
STUDY = """
[mesh]
icosphere = 2
[membrane]
area_difference_modulus = 50
leaflet_separation = 0.1
[repulsion]
modulus = 10
exclusion_level = 2
onset = 0.6
[sampling]
steps_per_trajectory = 20
integrator = "bcss2"
tether_substeps = 2
step_size = "auto"
burn_in = 30
trajectory_jitter = 0.3
momentum_refreshment = 0.6
shear_wave_probability = 0.2
shear_waves_per_step = 5
[platform]
threads = 1
precision = "mixed"
[output]
trajectory_interval = 10
observables_interval = 2
"""


def command(*arguments, stop=None):
    """Run openmm-helfrich, whatever its verdict; with ``stop`` end it by a signal when that file has 5000 bytes."""
    process = subprocess.Popen([Path(sys.executable).with_name("openmm-helfrich"), *map(str, arguments), "--quiet"])
    if stop is not None:
        while process.poll() is None and not (stop.exists() and stop.stat().st_size > 5000):
            time.sleep(0.002)
        process.send_signal(signal.SIGTERM)
    expected = (0, FAILED) if stop is None else (128 + signal.SIGTERM,)
    if process.wait() not in expected:
        sys.exit(f"openmm-helfrich {' '.join(map(str, arguments))}: it ended with {process.returncode}, not {expected}")


def study(text, seed, *options, stops=False):
    """Run a configuration, perhaps stopped and resumed on the way, and return its results."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        config, prefix = folder / "study.toml", folder / "result"
        config.write_text(text)
        table = Path(f"{prefix}.csv")
        command("run", config, "--output", prefix, "--seed", seed, *options, stop=table if stops else None)
        if stops:
            command("resume", prefix)
        return resultsOf(prefix)


def resultsOf(prefix):
    final = mh.Mesh.read(f"{prefix}.ply")
    items = {
        "final vertices": final.vertices,
        "final triangles": final.triangles,
        "DCD": coordinatesOf(f"{prefix}.dcd"),
        **tableOf(f"{prefix}.csv", "table"),
    }
    if Path(f"{prefix}_path.csv").exists():
        items.update(tableOf(f"{prefix}_path.csv", "path"))
    with h5py.File(f"{prefix}.vtkhdf") as file:
        names = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        items.update({name: file[name][()] for name in names if file[name].dtype.kind in "iuf"})
    return items


def tableOf(file, title):
    with open(file, newline="") as text:
        header, *rows = csv.reader(text)
    return {f"{title} {name}": np.array(column, float) for name, column in zip(header, zip(*rows))}


def coordinatesOf(file):
    """Return the coordinates in a DCD file, by frame, axis and particle: its records after the header that have
    a number a particle.
    """
    data, start, records = Path(file).read_bytes(), 0, []
    while start < len(data):
        length = int.from_bytes(data[start : start + 4], "little")
        records.append(data[start + 4 : start + 4 + length])
        start += length + 8
    numParticles = int.from_bytes(records[2], "little")
    axes = [np.frombuffer(record, np.float32) for record in records[3:] if len(record) == 4 * numParticles]
    return np.array(axes).reshape(-1, 3, numParticles)


@run
def study_162(seed):
    return study(STUDY + STAGES, seed)


@run
def study_642_resumed(seed):
    double = STUDY.replace("icosphere = 2", "icosphere = 3").replace('"mixed"', '"double"').replace("bcss2", "leapfrog")
    return study(double + STAGES, seed, "--threads", 2, stops=True)


@run
def study_42_reference(seed):
    text = (
        '[mesh]\nicosphere = 1\n[platform]\nname = "Reference"\n'
        + STUDY[STUDY.index("[sampling]") : STUDY.index("[platform]")]
    )
    return study(text + STAGES.replace("12.4", "11.8"), seed)


@run
def red_blood_cell_2562(seed):
    text = (ROOT / "examples" / "red_blood_cell.toml").read_text()
    text = text.replace("red_blood_cell.stl", str(ROOT / "examples" / "red_blood_cell.stl"))
    return study(text, seed, "--steps", 30, "--threads", 2)


# Files and comparisons


def save(folder, name, items):
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {key: np.asarray(value) for key, value in items.items()}
    np.savez_compressed(folder / f"{name}.npz", **{key.replace("/", "|"): value for key, value in arrays.items()})
    summary = {key: summarize(value) for key, value in arrays.items()}
    (folder / f"{name}.json").write_text(json.dumps(summary, indent=1) + "\n")


def load(folder, name):
    with np.load(folder / f"{name}.npz") as file:
        return {key.replace("|", "/"): file[key] for key in file.files}


def summarize(array):
    """Return what a reader wants to see of an array: all of a small one, and the beginning of another."""
    values = [text(value) for value in array.reshape(-1)[:20]]
    if array.dtype.kind == "U":
        values = [f"{len(str(array))} characters"]
    checksum = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
    return {"type": str(array.dtype.kind), "shape": array.shape, "sha256": checksum, "values": values}


def text(value):
    return float(value).hex() if isinstance(value, np.floating) else str(value)


def difference(recorded, found):
    """Return where two items differ first and how much, or None if all bits are the same."""
    found = np.asarray(found)
    if recorded.dtype.kind == "U":
        lines = itertools.zip_longest(str(recorded).splitlines(), str(found).splitlines())
        return next((f"line {i + 1}: {a!r}, now {b!r}" for i, (a, b) in enumerate(lines) if a != b), None)
    if recorded.shape != found.shape or recorded.dtype != found.dtype:
        return f"{recorded.dtype}{recorded.shape}, now {found.dtype}{found.shape}"
    width = recorded.dtype.itemsize
    bits = [np.ascontiguousarray(array).reshape(-1).view(np.uint8).reshape(-1, width) for array in (recorded, found)]
    where = np.flatnonzero(np.any(bits[0] != bits[1], axis=1))
    if len(where) == 0:
        return None
    first = tuple(map(int, np.unravel_index(where[0], recorded.shape)))
    a, b = recorded[first], found[first]
    largest = np.nanmax(np.abs(recorded.astype(float) - found.astype(float)))
    return (
        f"{len(where)} of {recorded.size}, first at {list(first)}: {text(a)}, now {text(b)} "
        f"({float(a):.17g}, {float(b):.17g}); "
        f"the largest difference is {largest:.3g}"
    )


def compare(folder, name, items):
    """Print a comparison with a recording and return the number of items that differ.

    Statistics that moves did not have when the recording was made are no difference.
    """
    recorded, numDifferent = load(folder, name), 0
    for key in [*recorded, *(key for key in items if key not in recorded)]:
        if key in recorded:
            problem = difference(recorded[key], items[key]) if key in items else "is not there now"
        else:
            problem = "was not recorded"
        isNew = key not in recorded and key.partition(".")[2] in STATISTICS
        numDifferent += problem is not None and not isNew
        verdict = "same" if problem is None else f"new: {problem}" if isNew else f"DIFFERS: {problem}"
        print(f"  {key:52} {verdict}")
    return numDifferent


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["record", "compare"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=RUNS, default=list(RUNS), help=", ".join(RUNS))
    parser.add_argument("--seed", type=int, default=1, help="of all random numbers; 1 by default")
    arguments = parser.parse_args()
    numDifferent = 0
    for name in arguments.only:
        start = time.perf_counter()
        items = RUNS[name](arguments.seed)
        print(f"{name}: {len(items)} items, {time.perf_counter() - start:.1f} s", flush=True)
        if arguments.action == "record":
            save(arguments.folder, name, items)
        else:
            numDifferent += compare(arguments.folder, name, items)
    if arguments.action == "compare":
        print(f"{numDifferent} items differ" if numDifferent else "everything is the same")
    return min(numDifferent, 1)


if __name__ == "__main__":
    sys.exit(main())
