"""Trajectories that keep a part of their velocities: how motions go on, how they turn back, and that what is sampled
stays the same.
"""

import numpy as np
import openmm as mm
import pytest

import openmmhelfrich as mh
from membranes import PLATFORMS, createContext, forcesOf, kelvin, positionsOf
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.scene import Scene
from test_hmc import KT, assertMean, energyChangeOf, softForce, velocitiesOf

ALMOST_NONE = 1e-9  # keeps all but 5e-19 of the velocities


def createRun(refreshment, platform="Reference", stepSize=0.002, steps=20, flipProbability=0.0):
    mesh = mh.Mesh.icosphere(1)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), stepSize, steps, 0.2, flipProbability)
    integrator.setMomentumRefreshment(refreshment)
    integrator.setRandomNumberSeed(5)
    return mesh, integrator, createContext(mesh, softForce(mesh), platform, integrator)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_velocities_fade(platform):
    """Of free particles' velocities a trajectory leaves the part (1-refreshment^2)^(1/2), and their variance is kT/m
    from the first on.
    """
    refreshment, masses, system = 0.6, np.repeat([1.0, 4.0], 2000), mm.System()
    for mass in masses:
        system.addParticle(mass)
    integrator = mh.HamiltonianTrajectoryIntegrator(kelvin(KT), 0.01, 5)
    integrator.setMomentumRefreshment(refreshment)
    integrator.setRandomNumberSeed(3)
    context = mm.Context(system, integrator, mm.Platform.getPlatform(platform))
    context.setPositions(np.zeros((len(masses), 3)))
    velocities = []
    for _ in range(4):
        integrator.step(1)
        velocities.append(velocitiesOf(context) * np.sqrt(masses / KT)[:, None])
    assert integrator.getNumAccepted() == 4
    for n, v in enumerate(velocities):
        for half in (v[:2000], v[2000:]):
            assert np.mean(half**2) == pytest.approx(1, abs=4 * (2 / half.size) ** 0.5)
        assert np.mean(v * velocities[0]) == pytest.approx(0.8**n, abs=4 * (2 / v.size) ** 0.5)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_motions_go_on(platform):
    """Two trajectories that keep their velocities are one of twice the length."""
    ends = []
    for steps, number in ((20, 2), (40, 1)):
        mesh, integrator, context = createRun(ALMOST_NONE, platform, steps=steps)
        integrator.step(number)
        assert integrator.getNumAcceptedTrajectories() == number
        ends.append(positionsOf(context))
    assert np.abs(ends[0] - mesh.vertices).max() > 0.01
    assert np.abs(ends[0] - ends[1]).max() < 1e-6


@pytest.mark.parametrize("platform", PLATFORMS)
def test_rejections_turn_back(platform):
    """After a rejection velocities are reversed, and the next trajectory goes back the way that the one before came."""
    mesh, integrator, context = createRun(ALMOST_NONE, platform)
    integrator.step(3)
    start, accepted = positionsOf(context), integrator.getNumAcceptedTrajectories()
    integrator.step(1)
    x, v = positionsOf(context), velocitiesOf(context)
    assert integrator.getNumAcceptedTrajectories() == accepted + 1 and np.abs(x - start).max() > 0.01
    integrator.setStepSize(4)
    integrator.step(1)
    assert integrator.getNumAcceptedTrajectories() == accepted + 1
    assert np.array_equal(positionsOf(context), x) and np.abs(velocitiesOf(context) + v).max() < 1e-7
    integrator.setStepSize(0.002)
    integrator.step(1)
    assert integrator.getNumAcceptedTrajectories() == accepted + 2
    assert np.abs(positionsOf(context) - start).max() < 1e-6


def test_sampling_stays_exact():
    """<exp(-dH/kT)> = 1, <KE> = 3NkT/2 and <sum x.grad E> = (3N-3)kT, though trajectories are rejected and most of the
    velocities are kept, with flips.
    """
    mesh, integrator, context = createRun(0.3, stepSize=0.004, flipProbability=0.3)
    integrator.step(500)
    factors, kinetic, virial = [], [], []
    for _ in range(4000):
        integrator.step(4)
        x, v = positionsOf(context), velocitiesOf(context)
        factors.append(np.exp(-energyChangeOf(integrator) / KT))
        kinetic.append(np.sum(v**2) / 2)
        virial.append(-np.sum((x - x.mean(axis=0)) * forcesOf(context)))
    assert 0.6 < integrator.getAcceptanceRate() < 0.95
    assertMean(factors, 1)
    assertMean(kinetic, 1.5 * len(mesh.vertices) * KT)
    assertMean(virial, (3 * len(mesh.vertices) - 3) * KT)


def test_configuration():
    config = parseConfig(
        {"mesh": {"icosphere": 1}, "sampling": {"momentum_refreshment": 0.4}, "platform": {"name": "Reference"}}
    )
    mesh = mh.Mesh.icosphere(1)
    integrator = Scene.of(config, mesh).createIntegrator()
    assert integrator.getMomentumRefreshment() == integrator.getMove(0).getMomentumRefreshment() == 0.4
    assert mh.HybridMonteCarloIntegrator(300, 0.1, engine="custom").getMomentumRefreshment() == 1
