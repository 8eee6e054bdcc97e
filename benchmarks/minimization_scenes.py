"""How many iterations minimizations of unlike membranes take, with a multilevel weight and without.

    python benchmarks/minimization_scenes.py [--vertices 642] [--weights 0,2] [--limit 3000] [SCENE ...]

One line a scene and weight: the iterations, the energy in bending moduli, seconds of processor time, and why it ended.
"""

import argparse
import functools
import time

import numpy as np
import openmm as mm
from openmm import app

import openmmhelfrich as mh


@functools.cache
def spheroid(n, volume=0.9, noise=0.08, kind="prolate"):
    return roughened(mh.spheroid(n, mh.spheroidAspectRatio(volume, kind)), noise)


def roughened(mesh, noise, seed=3):
    motion = noise * mesh.edgeLengths.mean() * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return mh.Mesh(mesh.vertices + motion, mesh.triangles)


def withTether(mesh, length=None):
    force, length = mh.HelfrichForce(), length or float(np.median(mesh.edgeLengths))
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(1)
    force.setTether(100, 0.8 * length, 1.25 * length, 2)
    force.setTetherLengthScale(length)
    return force


def closed(mesh, volume=0.9, stiffness=1e6):
    force, area = withTether(mesh), 4 * np.pi
    force.setAreaModulus(stiffness)
    force.setTargetArea(area)
    force.setVolumeModulus(stiffness)
    force.setTargetVolume(volume * area**1.5 / (6 * np.sqrt(np.pi)))
    return mesh, force


def two(n):
    parts = [spheroid(round(0.37 * n)), spheroid(round(0.63 * n), 0.95)]
    mesh = mh.Mesh.merged([parts[0], mh.Mesh(1.3 * parts[1].vertices + [5, 0, 0], parts[1].triangles)])
    force = withTether(mesh)
    force.setAreaModulus(1e6)
    force.setVolumeModulus(1e6)
    for surface, (size, volume) in enumerate(((1, 0.9), (1.3, 0.95))):
        force.setTargetArea(4 * np.pi * size**2, surface)
        force.setTargetVolume(volume * 4 / 3 * np.pi * size**3, surface)
    return mesh, force


def sheet(n):
    side = 2 * round(np.sqrt(n) / 2)
    mesh = mh.Mesh.sheet(2, 2, 2 / side)
    noise = 0.08 * 2 / side * np.random.default_rng(3).normal(size=mesh.vertices.shape)
    noise[:, 2] += 0.2 * np.sin(np.pi * mesh.vertices[:, 0])
    mesh.vertices = mesh.vertices + noise
    force = withTether(mesh, 2 / side)
    force.setUsesPeriodicBoundaryConditions(True)
    return mesh, force


def species(n):
    mesh, force = closed(spheroid(n))
    force.addSpecies(1, 0)
    force.addSpecies(2, 3)
    force.setVertexSpecies((mesh.vertices[:, 2] > 0.7).astype(int))
    force.setLineTension(0, 1, 0.5)
    return mesh, force


def repelled(n):
    mesh, force = closed(spheroid(n, 0.6, 0.05, "oblate"), 0.6)
    length = mesh.edgeLengths.mean()
    force.setRepulsion(10, 1.5 * length, 2, 2)
    force.setRepulsionLengthScale(length)
    return mesh, force


def pulled(n):
    mesh, force = closed(spheroid(n))
    bond, field = mm.HarmonicBondForce(), mm.CustomExternalForce("0.05*z^2")
    top, bottom = (int(f(mesh.vertices[:, 2])) for f in (np.argmax, np.argmin))
    bond.addBond(top, bottom, 3.2, 20)
    for i in range(len(mesh.vertices)):
        field.addParticle(i)
    return mesh, force, bond, field


SCENES = {
    "rough": lambda n: closed(spheroid(n)),
    "rough, fluid": lambda n: closed(spheroid(n)),
    "rough, 1e3": lambda n: closed(spheroid(n), stiffness=1e3),
    "rough, 1e3, fluid": lambda n: closed(spheroid(n), stiffness=1e3),
    "smooth": lambda n: closed(spheroid(n, 0.8, 0), 0.8),
    "smooth, fluid": lambda n: closed(spheroid(n, 0.8, 0), 0.8),
    "two": two,
    "two, fluid": two,
    "sheet": sheet,
    "sheet, fluid": sheet,
    "species": species,
    "species, fluid": species,
    "repelled": repelled,
    "pulled": pulled,
    "pulled, fluid": pulled,
    "fixed": lambda n: closed(spheroid(n)),
}


def simulationOf(mesh, *forces, fixed=()):
    system = mesh.createSystem()
    for force in forces:
        system.addForce(force)
    for i in fixed:
        system.setParticleMass(i, 0)
    integrator = mh.HybridMonteCarloIntegrator(300, 1e-3)
    integrator.setRandomNumberSeed(1)
    platform = mm.Platform.getPlatform("CPU")
    simulation = app.Simulation(mesh.topology(), system, integrator, platform, {"Threads": "1"})
    simulation.context.setPositions(mesh.vertices)
    return simulation


def createSimulation(scene, n):
    mesh, *forces = SCENES[scene](n)
    fixed = range(0, len(mesh.vertices), 40) if scene == "fixed" else ()
    return forces[0], simulationOf(mesh, *forces, fixed=fixed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--vertices", type=int, default=642)
    parser.add_argument("--weights", default="0,2")
    parser.add_argument("--limit", type=int, default=3000)
    arguments = parser.parse_args()
    for scene in arguments.scenes or SCENES:
        for weight in map(float, arguments.weights.split(",")):
            force, simulation = createSimulation(scene, arguments.vertices)
            search = mh.minimizeFluid if scene.endswith("fluid") else mh.minimize
            begin = time.process_time()
            try:
                result = search(simulation, force, maxIterations=arguments.limit, multilevelWeight=weight)
            except mm.OpenMMException as error:
                print(f"{scene}, {arguments.vertices}, {weight:g}: {error}", flush=True)
                continue
            print(
                f"{scene:18} {arguments.vertices:6} {weight:3g} {result.iterations:6} {result.energy._value:11.5f} "
                f"{time.process_time() - begin:6.2f} s  {result.reason[:50]}",
                flush=True,
            )
