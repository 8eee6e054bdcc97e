"""A fluid vesicle, deflated to the reduced volume 0.8 while it fluctuates.  Writes vesicle.dcd and vesicle.psf."""

import sys

import openmm as mm
from openmm import app, unit

import openmmhelfrich as mh

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500
temperature = 300 * unit.kelvin
kT = temperature * unit.MOLAR_GAS_CONSTANT_R

mesh = mh.Mesh.icosphere(subdivisions=3, radius=1.0)
force = mh.HelfrichForce()
force.setTriangles(mesh.triangles)
force.setBendingModulus(20 * kT)  # kappa of kappa/2 times the integral of (2H-C_0)^2, with C_0 = 0
force.setAreaModulus(1e6 * kT)
force.setTargetArea(mesh.area)
force.setVolumeModulus(1e6 * kT)
force.setTargetVolume(mesh.volume)
length = mesh.edgeLengths.mean()
force.setTether(50 * kT, 0.83 * length, 1.33 * length, 2)
force.setTetherLengthScale(length)
system = mesh.createSystem(mass=1.0)
system.addForce(force)
integrator = mh.HybridMonteCarloIntegrator(temperature, 4e-4 * unit.picoseconds)
integrator.setRandomNumberSeed(1)
simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatformByName("CPU"))
simulation.context.setPositions(mesh.vertices)
mh.writePSF("vesicle.psf", simulation.topology)
simulation.reporters.append(app.DCDReporter("vesicle.dcd", max(1, steps // 50)))
simulation.reporters.append(mh.ObservablesReporter(sys.stdout, max(1, steps // 10), force, temperature))

for stage in range(1, 11):  # let water out, a little at a time
    simulation.context.setParameter(force.getTargetVolumeParameter(), (1 - 0.02 * stage) * mesh.volume)
    simulation.step(steps // 20)
simulation.step(steps - 10 * (steps // 20))
geometry = force.getGeometryInContext(simulation.context)
print(f"area {geometry.area}, volume {geometry.volume}")
