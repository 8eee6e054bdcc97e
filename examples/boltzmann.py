"""Do a vesicle's energies follow one Boltzmann distribution at all temperatures?  Nine of them, 300 K to 900 K, with
flips and trajectories at the temperature of each.  Writes boltzmann.png.

Arguments: the number of rounds (2000, ten minutes of one core), how often the sphere's triangles are divided (3, which
makes 642 vertices), and how many replicas run at a time (1).
It goes on where boltzmann.zip ends, if there is one, so that a larger number of rounds continues the run.
"""

import sys
from pathlib import Path

import numpy as np
import openmm as mm
from matplotlib.figure import Figure
from openmm import app, unit

import openmmhelfrich as mh

rounds, subdivisions, workers = (int(argument) for argument in (sys.argv[1:] + ["2000", "3", "1"][len(sys.argv) - 1 :]))
FILE = Path("boltzmann.zip")
temperatures = np.geomspace(300, 900, 9)
kT = (300 * unit.kelvin * unit.MOLAR_GAS_CONSTANT_R).value_in_unit(unit.kilojoules_per_mole)


def createSimulation(temperature, seed):
    mesh = mh.Mesh.icosphere(subdivisions)
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(30 * kT)  # kappa of kappa/2 times the integral of (2H-C_0)^2, with C_0 = 0
    force.setAreaModulus(1e5 * kT)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(1e5 * kT)
    force.setTargetVolume(0.95 * mesh.volume)
    force.setTether(1000 * kT, 0.8 * edge, 1.35 * edge, 2)
    system = mesh.createSystem()
    system.addForce(force)
    integrator = mh.HybridMonteCarloIntegrator(temperature, 1e-4, flipFraction=0.5)
    integrator.setRandomNumberSeed(seed)
    simulation = app.Simulation(
        mesh.topology(), system, integrator, mm.Platform.getPlatformByName("CPU"), {"Threads": "1"}
    )
    simulation.context.setPositions(mesh.vertices)
    if not FILE.exists():
        mh.adaptStepSize(simulation, 300)
    return simulation


simulations = [createSimulation(temperature, seed) for seed, temperature in enumerate(temperatures, 1)]
exchange = mh.ReplicaExchange(
    simulations, [mh.ThermodynamicState(temperature) for temperature in temperatures], workers=workers
)
if FILE.exists():
    exchange.load(FILE)
exchange.run(max(0, rounds - exchange.numRounds), steps=10, checkpoint=FILE)

result = mh.reweight(exchange.potentialEnergies(discard=exchange.numRounds // 10), temperatures)
density = result.densityOfStates(bins=50)
print(result.toDataFrame().to_string(index=False, float_format="{:.3f}".format))
print(exchange)  # what was accepted in each state, and the verdict
print(
    f"chi^2 = {density.chiSquared:.0f} for {density.degreesOfFreedom} degrees of freedom, p = {density.pValue:.2f}; "
    f"residuals of {np.nanstd(density.residuals):.2f} standard errors, at most "
    f"{np.nanmax(np.abs(density.residuals)):.1f}"
)

figure = Figure(figsize=(9, 5.5), layout="constrained")
(histograms, densities), (residuals, overlap) = figure.subplots(2, 2)
for k, temperature in enumerate(temperatures):
    label, color = f"T = {temperature / 300:.2f}", f"C{k}"
    histograms.hist(result.energies[k] / kT, bins=30, density=True, histtype="step", color=color, label=label)
    densities.errorbar(
        density.energies / kT, density.logDensities[k], density.errors[k], fmt="o", markersize=3, color=color
    )
    residuals.plot(density.energies / kT, density.residuals[k], "o", markersize=3, color=color)
densities.plot(density.energies / kT, density.logDensity, "k-", linewidth=0.8, zorder=0)
histograms.set(xlabel="energy, kT at T = 1", ylabel="probability density")
histograms.legend(fontsize=6)
densities.set(xlabel="energy, kT at T = 1", ylabel="ln Ω")
residuals.axhspan(-1, 1, color="0.9")
residuals.set(xlabel="energy, kT at T = 1", ylabel="residual, standard errors")
figure.colorbar(overlap.imshow(result.overlap, cmap="Blues"), label="overlap")
overlap.set(xlabel="temperature", ylabel="temperature")
figure.savefig("boltzmann.png", dpi=120)
