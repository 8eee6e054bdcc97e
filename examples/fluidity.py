"""How fluid a membrane is at several flip fractions: the flip rate and how fast vertices diffuse along the surface.

Arguments: the number of Monte Carlo steps at each fraction (10000), and how often the sphere's triangles are divided
(3, which makes 642 vertices).
"""

import sys

import numpy as np
import openmm as mm
from openmm import app, unit

import openmmhelfrich as mh
from openmmhelfrich.analysis import vertexDiffusion

FRACTIONS = (0, 0.01, 0.03, 0.1, 0.3, 1)
FLIP_PROBABILITY = 0.5  # that a step is a sweep of flips and not a trajectory
STEPS_PER_FRAME, BLOCKS = 20, 4

steps, subdivisions = (int(argument) for argument in (sys.argv[1:] + ["10000", "3"][len(sys.argv) - 1 :]))
temperature = 300 * unit.kelvin
kT = temperature * unit.MOLAR_GAS_CONSTANT_R
mesh = mh.Mesh.icosphere(subdivisions)


def createSimulation(fraction):
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(20 * kT)  # kappa of kappa/2 times the integral of (2H-C_0)^2, with C_0 = 0
    force.setVolumeModulus(1e6 * kT)
    force.setTargetVolume(mesh.volume)
    force.setAreaModulus(1e5 * kT)
    force.setTargetArea(1.01 * mesh.area)
    force.setTether(1e4 * kT, 0.75 * edge, 1.4 * edge, 2)
    system = mesh.createSystem()
    system.addForce(force)
    integrator = mh.HybridMonteCarloIntegrator(temperature, 1e-4 * unit.picoseconds, 100, fraction, FLIP_PROBABILITY)
    integrator.setRandomNumberSeed(1)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatformByName("CPU"))
    simulation.context.setPositions(mesh.vertices)
    mh.adaptStepSize(simulation, max(100, steps // 8))
    return simulation, force


def sample(simulation, force, numFrames):
    """Return positions and triangles of a stretch of the run."""
    frames, triangles = [], []
    for _ in range(numFrames):
        simulation.step(STEPS_PER_FRAME)
        frames.append(
            simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        )
        triangles.append(force.getTrianglesInContext(simulation.context))
    return np.array(frames), triangles


def diffusionCoefficient(frames, triangles):
    """Return the diffusion coefficient in squared mean edge lengths per Monte Carlo step.

    At first vertices rattle between their neighbors; the slope over the later two thirds of the lags is that of
    diffusion, 4D.
    """
    edge = np.mean([mh.Mesh(x, t).edgeLengths.mean() for x, t in zip(frames, triangles)])
    diffusion = vertexDiffusion(frames, triangles, len(frames) // 2)
    late = diffusion.lags >= diffusion.lags[-1] / 3
    slope = np.polyfit(diffusion.lags[late], diffusion.meanSquaredDisplacements[late], 1)[0]
    return slope / (4 * edge**2 * STEPS_PER_FRAME)


print("fraction,flipRate,acceptance,forbidden,D per step,error,D per sweep,error")
for fraction in FRACTIONS:
    simulation, force = createSimulation(fraction)
    blocks = [
        diffusionCoefficient(*sample(simulation, force, steps // (BLOCKS * STEPS_PER_FRAME))) for _ in range(BLOCKS)
    ]
    D, error = np.mean(blocks), np.std(blocks, ddof=1) / BLOCKS**0.5
    flips = simulation.integrator.getFlipIntegrator()
    rates = (
        flips.getFlipRate(),
        simulation.integrator.getFlipAcceptanceRate(),
        flips.getNumForbidden() / max(1, flips.getNumAttempted()),
    )
    print(
        f"{fraction},"
        + ",".join(f"{x:.3g}" for x in (*rates, D, error, D / FLIP_PROBABILITY, error / FLIP_PROBABILITY)),
        flush=True,
    )
