"""The fluctuations of a quasi-spherical vesicle, whose spectrum gives its bending modulus back.

Writes fluctuations.png.

Arguments: the number of Monte Carlo steps (2000), how often the sphere's triangles are divided (2, which makes 162
vertices), and the bending modulus in kT (20).
"""

import sys

import numpy as np
import openmm as mm
from matplotlib.figure import Figure
from openmm import app, unit

import openmmhelfrich as mh
from openmmhelfrich.analysis import fluctuationSpectrum, meshStiffness, vertexDiffusion

steps, subdivisions, kappa = (int(argument) for argument in (sys.argv[1:] + ["2000", "2", "20"][len(sys.argv) - 1 :]))
temperature = 300 * unit.kelvin
kT = temperature * unit.MOLAR_GAS_CONSTANT_R

mesh = mh.Mesh.icosphere(subdivisions)
edge, size = mesh.edgeLengths.mean(), len(mesh.vertices)
force = mh.HelfrichForce()
force.setTriangles(mesh.triangles)
force.setBendingModulus(kappa * kT)  # kappa of kappa/2 times the integral of (2H-C_0)^2, with C_0 = 0
force.setVolumeModulus(1e5 * kT)
force.setTargetVolume(mesh.volume)
# Soft, so that the degrees fluctuate independently, but against the pressure of the vertices, which would make the
# tension negative.
force.setAreaModulus(60 * size * kT)
force.setTargetArea(mesh.area)
force.setTether(20 / edge**2 * kT, 0.8 * edge, 1.35 * edge, 2)
system = mesh.createSystem()
system.addForce(force)
# Trajectories of about a quarter of the slowest mode's period: it decorrelates in some ten of them, and in hundreds of
# short ones.
integrator = mh.HybridMonteCarloIntegrator(
    temperature, 2e-4 * unit.picoseconds, stepsPerTrajectory=round(0.8 * size), flipFraction=0.5, flipProbability=0.3
)
integrator.setRandomNumberSeed(1)
simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatformByName("CPU"))
simulation.context.setPositions(mesh.vertices)

burnIn = mh.adaptStepSize(simulation, max(100, steps // 8))
simulation.step(max(100, steps // 8))
frames, triangles = [], []
for _ in range(steps):
    simulation.step(1)
    frames.append(simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer))
    triangles.append(force.getTrianglesInContext(simulation.context))

spectrum = fluctuationSpectrum(frames, maxDegree=8)
edge = np.mean([mh.Mesh(x, t).edgeLengths.mean() for x, t in zip(frames[::20], triangles[::20])])
print(
    f"step size {burnIn.stepSize:.3g} ps, acceptance {integrator.getAcceptanceRate():.2f}, flips "
    f"{integrator.getFlipAcceptanceRate():.2f}"
)
for maxDegree in (4, 6, 8):
    fit, continuous = spectrum.fit(2, maxDegree, edge), spectrum.fit(2, maxDegree)
    print(
        f"l = 2 to {maxDegree}: kappa = {fit.bendingModulus:.1f} +- {fit.bendingModulusError:.1f} kT, "
        f"sigma = {fit.tension:.1f} +- {fit.tensionError:.1f}; "
        f"taken for continuous {continuous.bendingModulus:.1f} +- {continuous.bendingModulusError:.1f} kT, "
        f"{continuous.tension:.1f} +- {continuous.tensionError:.1f}"
    )
print(
    "autocorrelation times in steps: "
    + ", ".join(f"l={l}: {t:.1f}" for l, t in zip(spectrum.degrees, spectrum.autocorrelationTimes))
)

fit, l = spectrum.fit(2, 6, edge), spectrum.degrees
stiffness = meshStiffness(l, edge / spectrum.radius)
modes = (l - 1) * (l + 2) * (l * (l + 1) + fit.tension)
figure = Figure(figsize=(11, 3.3), layout="constrained")
powers, moduli, right = figure.subplots(1, 3)
powers.errorbar(l, spectrum.powers, spectrum.errors, fmt="o", label="measured")
powers.plot(l, 1 / (kappa * modes * stiffness), label=f"theory, κ = {kappa} kT, σ̄ = {fit.tension:.1f}")
powers.set(ylabel="mean |u$_{lm}$|²", xscale="log", yscale="log")
for factor, label in ((stiffness, "on a mesh"), (1, "taken for continuous")):
    moduli.errorbar(
        l,
        1 / (spectrum.powers * modes * factor),
        spectrum.errors / (spectrum.powers**2 * modes * factor),
        fmt="o",
        label=label,
    )
moduli.axhline(kappa, color="0.5")
moduli.set(ylabel="κ from each degree, kT", ylim=(0, None))
for axes in (powers, moduli):
    axes.set(xlabel="degree l")
    axes.set_xticks(l, l)
    axes.minorticks_off()
    axes.legend(loc="lower left")
diffusion = vertexDiffusion(frames[::4], triangles[::4], 20)
right.plot(4 * diffusion.lags, diffusion.meanSquaredDisplacements / edge**2, "o-")
right.set(xlabel="Monte Carlo steps", ylabel="displacement along the surface², edges²")
figure.savefig("fluctuations.png", dpi=110)
