"""Splittings: what every one of them must conserve, and how small its errors are."""

import numpy as np
import pytest

import openmmhelfrich as mh
from membranes import PLATFORMS, createContext, forcesOf, kelvin, positionsOf
from test_hmc import KT, assertMean, energyChangeOf, softForce, velocitiesOf

# The kicks and drifts of a step, as fractions of it.
SPLITTINGS = {
    "leapfrog": ([0.5, 0.5], [1.0]),
    "bcss2": ([0.2117809813657482, 1 - 2 * 0.2117809813657482, 0.2117809813657482], [0.5, 0.5]),
    "bcss3": (
        [0.11888010966548, 0.38111989033452, 0.38111989033452, 0.11888010966548],
        [0.29619504261126, 0.40760991477748, 0.29619504261126],
    ),
}


def createRun(splitting, stepSize, steps, platform="Reference", subdivisions=1, kT=KT, substeps=1):
    mesh = mh.Mesh.icosphere(subdivisions)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(kT), stepSize, steps, 0.2, 0)
    integrator.setSplitting(splitting)
    integrator.setTetherSubsteps(substeps)
    integrator.setRandomNumberSeed(5)
    return integrator, createContext(mesh, softForce(mesh), platform, integrator)


@pytest.mark.parametrize("splitting", SPLITTINGS)
def test_coefficients(splitting):
    """Kicks and drifts are palindromes of sum 1; the largest expected error of oscillators that leapfrog can follow at
    this cost is no larger for neighboring coefficients.
    """
    kicks, drifts = SPLITTINGS[splitting]
    assert kicks == pytest.approx(kicks[::-1]) and drifts == pytest.approx(drifts[::-1])
    assert sum(kicks) == pytest.approx(1) and sum(drifts) == pytest.approx(1)
    if splitting != "leapfrog":
        best = largestError(kicks, drifts)
        assert best < 1e-3
        for shift in (-2e-4, 2e-4):
            others = np.array(kicks) + shift * np.array([1, *(len(kicks) - 2) * [-2 / (len(kicks) - 2)], 1])
            assert largestError(others, drifts) > best


def largestError(kicks, drifts):
    """Return the largest mean energy error of unit oscillators at kT = 1, for steps of up to a unit a stage (Blanes et
    al. 2014, section 4).
    """
    worst = 0.0
    for h in np.linspace(0.01, len(drifts), 1500):
        matrix = np.array([[1, 0], [-kicks[0] * h, 1]])
        for kick, drift in zip(kicks[1:], drifts):
            matrix = np.array([[1, 0], [-kick * h, 1]]) @ np.array([[1, drift * h], [0, 1]]) @ matrix
        worst = max(worst, (matrix[0, 1] + matrix[1, 0]) ** 2 / (2 * (1 - matrix[0, 0] ** 2)))
    return worst


@pytest.mark.parametrize("splitting", SPLITTINGS)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_reversed_trajectory_returns_to_its_start(splitting, platform):
    """With the coefficients that the paper has, from the end to the start."""
    kicks, drifts = SPLITTINGS[splitting]
    dt, stages = 0.001, len(drifts)
    integrator, context = createRun(splitting, dt, 30, platform)
    integrator.step(3)
    start, accepted = positionsOf(context), integrator.getNumAcceptedTrajectories()
    integrator.step(1)
    assert integrator.getNumAcceptedTrajectories() == accepted + 1
    x, v = positionsOf(context), -velocitiesOf(context)
    assert np.abs(x - start).max() > 0.01
    for _ in range(30 // stages):
        v += kicks[0] * stages * dt * forcesOf(context)
        for kick, drift in zip(kicks[1:], drifts):
            x += drift * stages * dt * v
            context.setPositions(x)
            v += kick * stages * dt * forcesOf(context)
    assert np.abs(x - start).max() < 1e-10


@pytest.mark.parametrize("splitting", ["leapfrog", "bcss2"])
@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_reversed_trajectory_with_substeps_returns_to_its_start(splitting, platform):
    """Each drift is the motion under the tether alone, by leapfrog."""
    (kicks, drifts), dt, substeps = SPLITTINGS[splitting], 0.002, 3
    integrator, context = createRun(splitting, dt, 10, platform, substeps=substeps)
    integrator.step(3)
    start, accepted = positionsOf(context), integrator.getNumAcceptedTrajectories()
    integrator.step(1)
    assert integrator.getNumAcceptedTrajectories() == accepted + 1
    x, v = positionsOf(context), -velocitiesOf(context)
    mesh, tether, rest = mh.Mesh.icosphere(1), mh.HelfrichForce(), softForce(mh.Mesh.icosphere(1))
    tether.setTriangles(mesh.triangles)
    tether.setTether(*rest.getTether())
    rest.setTether(0, *rest.getTether()[1:])
    tether, rest = createContext(mesh, tether), createContext(mesh, rest)

    def forces(part):
        part.setPositions(x)
        return forcesOf(part)

    step = len(drifts) * dt
    for _ in range(10 // len(drifts)):
        v += kicks[0] * step * forces(rest)
        for kick, drift in zip(kicks[1:], drifts):
            h = drift * step / substeps
            for _ in range(substeps):
                v += h / 2 * forces(tether)
                x += h * v
                v += h / 2 * forces(tether)
            v += kick * step * forces(rest)
    assert np.abs(positionsOf(context) - start).max() > 0.01 and np.abs(x - start).max() < 1e-10


@pytest.mark.parametrize("splitting, substeps", [*((splitting, 1) for splitting in SPLITTINGS), ("leapfrog", 3)])
@pytest.mark.parametrize("platform", PLATFORMS)
def test_trajectories_are_symplectic(splitting, substeps, platform):
    """The Lagrange brackets of initial positions and of a scale of initial velocities: sum_k (dx_k/da dp_k/db - dx_k/db
    dp_k/da) at the end is what it is at the start.
    """
    integrator, context = createRun(splitting, 0.004, 12, platform, 0, substeps=substeps)
    start = context.getState(positions=True).getPositions(asNumpy=True)._value
    checkpoint = context.createCheckpoint()

    def end(direction, scale):
        context.loadCheckpoint(checkpoint)
        context.setPositions(start + direction)
        integrator.setTemperature(kelvin(KT * (1 + scale) ** 2))  # initial velocities are those at KT times 1+scale
        integrator.step(1)
        assert integrator.getNumAcceptedTrajectories() == 1
        return positionsOf(context), velocitiesOf(context)

    def derivative(direction, scale, h=1e-5):
        (x1, v1), (x0, v0) = end(h * direction, h * scale), end(-h * direction, -h * scale)
        return (x1 - x0) / (2 * h), (v1 - v0) / (2 * h)

    integrator.setStepSize(1e-15)
    initialVelocities, none = end(0 * start, 0)[1], np.zeros_like(start)
    integrator.setStepSize(0.004)
    directions = [(axis.reshape(-1, 3), 0) for axis in np.eye(36)[::5]] + [(none, 1)]
    columns = [derivative(*direction) for direction in directions]
    assert max(np.abs(dx - direction[0]).max() for direction, (dx, dp) in zip(directions, columns)) > 0.05
    for i, (dx1, dp1) in enumerate(columns):
        for j, (dx2, dp2) in enumerate(columns[:i]):
            expected = -np.sum(directions[j][0] * initialVelocities) if i + 1 == len(columns) else 0
            assert np.sum(dx1 * dp2 - dx2 * dp1) == pytest.approx(
                expected, abs=2e-6 * np.linalg.norm(dp1) * np.linalg.norm(dx2) + 1e-6
            )


@pytest.mark.parametrize(
    "splitting, stepSize, substeps", [("bcss2", 0.0035, 1), ("bcss3", 0.003, 1), ("leapfrog", 0.008, 3)]
)
def test_energy_changes(splitting, stepSize, substeps):
    """<exp(-dH/kT)> = 1."""
    integrator, context = createRun(splitting, stepSize, 12, substeps=substeps)
    integrator.step(300)
    factors = []
    for _ in range(2000):
        integrator.step(1)
        factors.append(np.exp(-energyChangeOf(integrator) / KT))
    assert 0.6 < integrator.getAcceptanceRate() < 0.98
    assertMean(factors, 1)


def test_errors():
    """The energy error of a trajectory falls with the square of the step, and is smaller with two or three stages, for
    the same length and cost.
    """
    errors = {}
    for splitting in SPLITTINGS:
        for steps in (12, 24):
            integrator, context = createRun(splitting, 0.02 / steps, steps)
            x = context.getState(positions=True).getPositions(asNumpy=True)._value
            changes = []
            for _ in range(60):
                context.setPositions(x + np.random.default_rng(1).normal(0, 0.01, x.shape))
                integrator.step(1)
                assert integrator.getMove(0).getLastNumSteps() == steps
                changes.append(energyChangeOf(integrator))
            errors[splitting, steps] = np.sqrt(np.mean(np.square(changes)))
        assert 3 < errors[splitting, 12] / errors[splitting, 24] < 5.5
    assert max(errors["bcss2", 24], errors["bcss3", 24]) < 0.5 * errors["leapfrog", 24]


def test_lengths():
    """The number of steps is rounded up to whole ones of the splitting; with jitter it is uniform, whatever becomes of
    the trajectories.
    """
    for splitting, expected in (("leapfrog", 10), ("bcss2", 10), ("bcss3", 12)):
        integrator, context = createRun(splitting, 0.001, 10)
        assert integrator.getMove(0).getLastNumSteps() == 0
        integrator.step(1)
        assert integrator.getMove(0).getLastNumSteps() == expected and integrator.getStepsPerTrajectory() == 10
    lengths = []
    for stepSize in (0.001, 10.0):
        integrator, context = createRun("leapfrog", stepSize, 10)
        integrator.setTrajectoryJitter(0.5)
        lengths.append([])
        for _ in range(300):
            integrator.step(1)
            lengths[-1].append(integrator.getMove(0).getLastNumSteps())
    assert lengths[0] == lengths[1]
    counts = np.bincount(lengths[0])
    assert counts.size == 16 and counts[:5].sum() == 0
    # The 0.5% point of chi square with 10 degrees of freedom.
    assert np.sum((counts[5:] - 300 / 11) ** 2 / (300 / 11)) < 25.2


def test_leapfrog_is_the_default():
    integrator = mh.HybridMonteCarloIntegrator(300, 0.1)
    assert (
        integrator.getSplitting() == integrator.getMove(0).getSplitting() == "leapfrog"
        and integrator.getTrajectoryJitter() == 0
    )
    integrator.setSplitting("bcss2")
    integrator.setTrajectoryJitter(0.2)
    assert integrator.getMove(0).getSplitting() == "bcss2" and integrator.getMove(0).getTrajectoryJitter() == 0.2
