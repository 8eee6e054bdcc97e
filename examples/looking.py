"""A small vesicle, its trajectory with triangles, and ways to look at it.

Writes looking.vtkhdf, looking.ply and looking.png.
"""

import sys

import openmm as mm
from openmm import app, unit

import openmmhelfrich as mh
from openmmhelfrich.pictures.rendering import render

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500
kT = 300 * unit.kelvin * unit.MOLAR_GAS_CONSTANT_R

mesh = mh.Mesh.icosphere(subdivisions=3, radius=1.0)
force = mh.HelfrichForce()
force.setTriangles(mesh.triangles)
force.setBendingModulus(20 * kT)  # kappa of kappa/2 times the integral of (2H-C_0)^2, with C_0 = 0
force.setAreaModulus(1e5 * kT)
force.setTargetArea(mesh.area)
force.setVolumeModulus(1e5 * kT)
force.setTargetVolume(0.9 * mesh.volume)
length = mesh.edgeLengths.mean()
force.setTether(1e4 * kT, 0.75 * length, 1.4 * length, 2)
system = mesh.createSystem()
system.addForce(force)
integrator = mh.HybridMonteCarloIntegrator(300 * unit.kelvin, 1.5e-4 * unit.picoseconds)
integrator.setRandomNumberSeed(1)
simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatformByName("CPU"))
simulation.context.setPositions(mesh.vertices)

reporter = mh.MeshReporter("looking.vtkhdf", max(1, steps // 10), force)
simulation.reporters.append(reporter)
simulation.step(steps)
reporter.close()

frames = mh.readMeshTrajectory("looking.vtkhdf")
for frame in frames:
    curvature, area = frame.data["MeanCurvature"], frame.data["Area"]
    print(
        f"step {frame.step}: reduced volume {frame.mesh.reducedVolume:.4f}, mean curvature "
        f"{(curvature * area).sum() / area.sum():.3f} per nm"
    )
frames[-1].mesh.write("looking.ply", data=frames[-1].data)
render(frames[-1:], "looking.png")
