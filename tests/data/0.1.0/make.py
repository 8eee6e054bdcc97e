"""Make the files of this folder, with version 0.1.0 of openmm-helfrich.

    python tests/data/0.1.0/make.py

Every scene gives a System and an integrator as XML and, for each platform, a State and a checkpoint of a Context in
which moves have been made, with a JSON file that says what it held then, and what the same moves made of it
afterwards.
"""

import json
import os
import sys
from pathlib import Path

import numpy as np
import openmm as mm

import openmmhelfrich as mh

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent.parent))
from test_version_0_1_0 import CLASSES, PLATFORMS, STEPS, advance, createContext, describe, restore  # noqa: E402

OPENMMS_NUMBERS = ("custom", "langevin", "compound")  # a State has no random numbers of OpenMM's own generators


def createMesh(subdivisions=1, seed=1):
    """Return a rough ellipsoid away from the origin, whose edges have the mean length 1."""
    mesh = mh.Mesh.icosphere(subdivisions)
    noise = np.random.default_rng(seed).uniform(-0.1, 0.1, mesh.vertices.shape)
    mesh.vertices = mesh.vertices * [1, 0.9, 0.7]
    mesh.vertices = mesh.vertices / mesh.edgeLengths.mean() + noise + [0.3, -0.2, 0.5]
    return mesh


def createForce(mesh, name="HelfrichForce", first=0, level=1):
    """Return a force that has something other than the default for everything."""
    force = mh.HelfrichForce()
    force.setName(name)
    force.setForceGroup(level)
    force.setTriangles(mesh.triangles + first)
    force.setBendingModulus(30)
    force.setAreaModulus(2000)
    force.setTargetArea(1.01 * mesh.area)
    force.setVolumeModulus(1500)
    force.setTargetVolume(0.98 * mesh.volume)
    force.setAreaDifferenceModulus(100)
    force.setLeafletSeparation(0.2)
    force.setTargetAreaDifference(0.38 * mesh.vertexMeanCurvatures.sum())
    force.setTether(60, 0.75, 1.35, 3)
    force.setTetherLengthScale(1.1)
    force.setRepulsion(3, (1.0, 1.6, 2.6)[level], 4, level)
    for a, b in mesh.edges[5::20] + first:
        force.addFixedEdge(a, b)
    return force


def createTrajectories():
    integrator = mh.HamiltonianTrajectoryIntegrator(310, 0.012, 6)
    integrator.setSplitting("bcss3")
    integrator.setTetherSubsteps(2)
    integrator.setTrajectoryJitter(0.5)
    integrator.setMomentumRefreshment(0.6)
    return integrator


def createWaves():
    return mh.ShearWaveIntegrator(305, 0.3, 0.4, 1.2, 3)


def createLangevin():
    integrator = mm.LangevinMiddleIntegrator(300, 20, 0.002)
    integrator.setRandomNumberSeed(8)
    return integrator


def createIntegrator(scene):
    if scene == "flips":
        integrator = mh.EdgeFlipIntegrator(320, 0.3)
    elif scene == "trajectories":
        integrator = createTrajectories()
    elif scene == "mixed":
        integrator = mh.HamiltonianTrajectoryIntegrator(300, 0.01, 6)
        integrator.setForcePrecision("mixed")
    elif scene == "waves":
        integrator = createWaves()
    elif scene == "custom":
        integrator = mh.HybridMonteCarloIntegrator(300, 0.01, 5, 0.3, 0.4, "custom")
    elif scene == "langevin":
        integrator = mh.HybridMonteCarloIntegrator(createLangevin(), mh.EdgeFlipIntegrator(300, 1), 0.4)
    elif scene == "compound":
        integrator = mm.CompoundIntegrator()
        flips = mh.EdgeFlipIntegrator(300, 1)
        flips.setRandomNumberSeed(7)
        for part in flips, createLangevin():
            integrator.addIntegrator(part)
        return integrator
    elif scene == "native":
        integrator = mh.HybridMonteCarloIntegrator(300, 0.015, 6, 0.3, 0.4)
    else:
        integrator = mh.HybridMonteCarloIntegrator(createTrajectories(), mh.EdgeFlipIntegrator(310, 0.3), 0.4)
        integrator.addShearWaves(createWaves(), 0.3)
    integrator.setRandomNumberSeed(7)
    return integrator


def createSystem(scene):
    """Return a System and its positions."""
    if scene != "two_membranes":
        mesh = createMesh(2 if scene == "flips" else 1)
        system = mesh.createSystem(1.5)
        system.addForce(createForce(mesh))
        return system, mesh.vertices
    meshes, system, positions = [createMesh(seed=1), createMesh(seed=2)], mm.System(), []
    for i, mesh in enumerate(meshes):
        first = system.getNumParticles()
        for _ in mesh.vertices:
            system.addParticle(1.5)
        system.addForce(createForce(mesh, f"Vesicle{i}", first, i))
        positions.append(mesh.vertices + np.array([6 * i, 0, 0]))
    bond = mm.HarmonicBondForce()
    bond.addBond(0, len(meshes[0].vertices), 1, 10)
    system.addForce(bond)
    return system, np.concatenate(positions)


def write(name, text):
    (FOLDER / name).write_text(text)


def makeScene(scene):
    system, positions = createSystem(scene)
    write(f"{scene}.system.xml", mm.XmlSerializer.serialize(system))
    write(f"{scene}.integrator.xml", mm.XmlSerializer.serialize(createIntegrator(scene)))
    for platform in PLATFORMS:
        name = f"{scene}.{platform}"
        context, integrator, forces = createContext(scene, platform)
        context.setPositions(positions)
        advance(scene, integrator, 20)
        for force in forces:
            context.setParameter(force.getTargetVolumeParameter(), 0.99 * force.getTargetVolume()._value)
        advance(scene, integrator, 7)
        state = context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
        write(f"{name}.state.xml", mm.XmlSerializer.serialize(state))
        (FOLDER / f"{name}.checkpoint").write_bytes(context.createCheckpoint())
        expected = {"saved": describe(context, integrator, forces)}
        advance(scene, integrator, STEPS)
        expected["checkpoint"] = describe(context, integrator, forces)
        del context, integrator, forces
        context, integrator, forces = createContext(scene, platform)
        restore(context, name, "state.xml")
        advance(scene, integrator, STEPS)
        expected["state.xml"] = describe(context, integrator, forces)
        for form in "checkpoint", "state.xml":
            isFluid = scene not in ("trajectories", "mixed", "waves")
            assert (expected[form]["triangles"] != expected["saved"]["triangles"]) == isFluid
            assert expected[form]["positions"] != expected["saved"]["positions"] or scene == "flips"
        assert scene in OPENMMS_NUMBERS or expected["state.xml"] == expected["checkpoint"]
        write(f"{name}.json", json.dumps(expected, separators=(",", ":")) + "\n")


STUDY = {
    "mesh": {"icosphere": 1},
    "membrane": {"area_difference_modulus": 50.0, "leaflet_separation": 0.2},
    "repulsion": {"modulus": 10.0},
    "platform": {"threads": 1},
    "sampling": {
        "seed": 4,
        "steps_per_trajectory": 5,
        "trajectory_jitter": 0.3,
        "integrator": "bcss2",
        "momentum_refreshment": 0.7,
        "step_size": "auto",
        "burn_in": 25,
        "shear_wave_probability": 0.2,
        "shear_waves_per_step": 3,
    },
    "output": {
        "prefix": "study",
        "trajectory_interval": 10,
        "observables_interval": 2,
        "overwrite": True,
    },
    "stages": [
        {"kind": "minimize", "max_iterations": 100},
        {"kind": "sample", "steps": 30},
        {"kind": "anneal", "steps": 8, "end_temperature": 100.0},
        {"kind": "continue", "windows": 1, "reduced_volume": 0.9, "equilibration": 2, "steps": 4},
    ],
}


def makeStudy():
    """Stop a run half-way, keep its files, and write down how it ends."""

    def stop(study):
        if study.simulation.currentStep == 20:
            raise KeyboardInterrupt

    os.chdir(FOLDER)
    mh.run(STUDY, stop)
    kept = {
        f"study.{ending}": (FOLDER / f"study.{ending}").read_bytes()
        for ending in ("checkpoint", "csv", "dcd", "vtkhdf")
    }
    mh.resume("study")
    final, table = mh.Mesh.read("study.ply"), mh.readObservables("study.csv")
    expected = {
        "triangles": final.triangles.tolist(),
        "vertices": final.vertices.tolist(),
        "steps": [1, *range(10, 51, 10)],
        "table": {name: column.tolist() for name, column in table.items()},
    }
    for file in FOLDER.glob("study*"):
        file.unlink()
    for name, content in kept.items():
        (FOLDER / name).write_bytes(content)
    write("study.json", json.dumps(expected, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    for scene in CLASSES:
        makeScene(scene)
    makeStudy()
