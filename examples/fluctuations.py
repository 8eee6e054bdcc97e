"""The fluctuations of a quasi-spherical vesicle, whose spectrum gives its bending modulus back.  Writes fluctuations.png.

Arguments: the number of Monte Carlo steps (4000), and how often the sphere's triangles are divided (2, which makes 162 vertices).
"""
import sys

import openmm as mm
import openmmhelfrich as mh
from matplotlib.figure import Figure
from openmm import app, unit
from openmmhelfrich.analysis import fluctuationSpectrum, vertexDiffusion

steps, subdivisions = (int(argument) for argument in (sys.argv[1:]+["4000", "2"][len(sys.argv)-1:]))
temperature = 300*unit.kelvin
kT = temperature*unit.MOLAR_GAS_CONSTANT_R

mesh = mh.Mesh.icosphere(subdivisions)
edge = mesh.edgeLengths.mean()
force = mh.HelfrichForce()
force.setTriangles(mesh.triangles)
force.setBendingModulus(20*kT)
force.setVolumeModulus(1e6*kT)
force.setTargetVolume(mesh.volume)
force.setAreaModulus(1e5*kT)
force.setTargetArea(1.01*mesh.area)  # some area to undulate with
force.setTether(1e4*kT, 0.75*edge, 1.4*edge, 2)
system = mesh.createSystem()
system.addForce(force)
integrator = mh.HybridMonteCarloIntegrator(temperature, 2e-4*unit.picoseconds)
integrator.setRandomNumberSeed(1)
simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatformByName("CPU"))
simulation.context.setPositions(mesh.vertices)

burnIn = mh.adaptStepSize(simulation, max(100, steps//8))
frames, triangles = [], []
for _ in range(steps//4):
    simulation.step(4)
    frames.append(simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer))
    triangles.append(force.getTrianglesInContext(simulation.context))

spectrum = fluctuationSpectrum(frames, maxDegree=8)
fit = spectrum.fit(2, 6)
print(f"step size {burnIn.stepSize:.3g} ps, acceptance {integrator.getAcceptanceRate():.2f}")
print(f"kappa = {fit.bendingModulus:.1f} +- {fit.bendingModulusError:.1f} kT, sigma = {fit.tension:.1f} +- {fit.tensionError:.1f}")
print("autocorrelation times in frames: "+", ".join(f"l={l}: {t:.1f}" for l, t in zip(spectrum.degrees, spectrum.autocorrelationTimes)))

figure = Figure(figsize=(8, 3.5), layout="constrained")
left, right = figure.subplots(1, 2)
l = spectrum.degrees
left.errorbar(l, spectrum.powers, spectrum.errors, fmt="o", label="measured")
left.plot(l, 1/(20*(l-1)*(l+2)*(l*(l+1)+fit.tension)), label=f"theory, κ = 20 kT, σ = {fit.tension:.1f}")
left.set(xlabel="degree l", ylabel="mean |u$_{lm}$|²", xscale="log", yscale="log")
left.legend()
diffusion = vertexDiffusion(frames[::4], triangles[::4], 20)
right.plot(16*diffusion.lags, diffusion.meanSquaredDisplacements/edge**2, "o-")
right.set(xlabel="Monte Carlo steps", ylabel="displacement along the surface², edges²")
figure.savefig("fluctuations.png", dpi=120)
