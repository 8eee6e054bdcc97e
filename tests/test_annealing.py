"""Trajectories and flips of an annealed membrane have the same temperature, that of the schedule."""

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import kelvin
from test_flips import energiesOf, enumerateStates, octahedron, pOf, softForce, stateOf
from test_hmc import assertMean, energyChangeOf, softForce as vesicleForce

KT = 2.5


def createSimulation(mesh, force, integrator, mass):
    integrator.setRandomNumberSeed(9)
    system = mesh.createSystem(mass)
    system.addForce(force)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    return simulation


def testFlipsObeyTheCooledTemperature():
    """The enumerated triangulations of frozen vertices are visited as the Boltzmann weights of the temperature at the
    end say, not of that at the start.
    """
    mesh = octahedron()
    states = enumerateStates(stateOf(mesh.triangles))
    energies, force = energiesOf(mesh, states, True), softForce(mesh, True)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(1), 0.001, 1, 250 / len(mesh.edges), 1.0)
    simulation = createSimulation(mesh, force, integrator, 0.0)
    counts = np.zeros(len(states))

    def count(step, temperature):
        if step > 200:
            counts[states[stateOf(force.getTrianglesInContext(simulation.context))]] += 1

    mh.anneal(simulation, mh.TableSchedule([0, 100], [kelvin(1), kelvin(0.5)]), 20200, progress=count)
    assert pOf(counts, energies, 0.5) > 0.01
    assert pOf(counts, energies, 1) < 1e-9


@pytest.mark.parametrize("flipProbability", [0, 0.5])
def testTrajectoriesObeyTheCooledTemperature(flipProbability):
    """<exp(-dH/kT)> = 1 and <KE> = 3NkT/2 at the temperature at the end, a quarter of that at the start."""
    mesh, kT = mh.Mesh.icosphere(1), KT / 4
    integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), 0.004, 20, 0.2, flipProbability)
    simulation = createSimulation(mesh, vesicleForce(mesh), integrator, 1.0)
    factors, kinetic = [], []

    def observe(step, temperature):
        if step > 1000 and integrator.getNumTrajectories() > observe.trajectories:
            factors.append(np.exp(-energyChangeOf(integrator) / kT))
            kinetic.append(simulation.context.getState(energy=True).getKineticEnergy() / unit.kilojoule_per_mole)
        observe.trajectories = integrator.getNumTrajectories()

    observe.trajectories = 0
    mh.anneal(
        simulation,
        mh.ExponentialSchedule.over(500, kelvin(KT), kelvin(kT)),
        7000,
        mh.StepSizeTracker(0.004, 0.8),
        progress=observe,
    )
    count = len(factors) // 25 * 25
    assert count > 2500
    assertMean(factors[:count], 1)
    assertMean(np.array(kinetic[:count]) / (1.5 * len(mesh.vertices) * kT), 1)
