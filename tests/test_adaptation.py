"""Step sizes that adapt: to the acceptance that is asked for, from any start, and again after a restart; and
temperatures that follow a schedule.
"""

import itertools
import json
import math
import re

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import kelvin
from openmmhelfrich.sampling.adaptation import Adaptation

KT = 2.5


def acceptanceOf(stepSize):
    """The mean acceptance of a leapfrog trajectory, erfc(sqrt(<dH>/kT)/2) with <dH> as the fourth power of the step
    size.
    """
    return math.erfc(min(stepSize, 1e3) ** 2)


def trajectories(adapter, count, seed=1):
    """Let an adapter meet trajectories whose acceptance probabilities scatter about their mean, and return the step
    sizes.
    """
    random, stepSizes = np.random.default_rng(seed), []
    for _ in range(count):
        mean = acceptanceOf(adapter.stepSize)
        adapter.update(random.beta(3 * mean, 3 * (1 - mean)) if 1e-6 < mean < 1 - 1e-6 else round(mean))
        stepSizes.append(adapter.stepSize)
    return np.array(stepSizes)


def createSimulation(stepSize, engine="native", flipProbability=0.5, seed=4):
    mesh = mh.Mesh.icosphere(1)
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(20 * KT)
    force.setVolumeModulus(1e4 * KT)
    force.setTargetVolume(0.9 * mesh.volume)
    force.setTether(1000 * KT, 0.75 * edge, 1.3 * edge, 2)
    system = mesh.createSystem()
    system.addForce(force)
    if isinstance(engine, str):
        integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), stepSize, 20, 0.1, flipProbability, engine)
    else:
        integrator = mh.HybridMonteCarloIntegrator(engine, mh.EdgeFlipIntegrator(kelvin(KT), 0.1), flipProbability)
    integrator.setRandomNumberSeed(seed)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("Reference"))
    simulation.context.setPositions(mesh.vertices)
    return simulation


@pytest.mark.parametrize("start", [1e-6, 1e-3, 0.5, 1e3, 1e6])
@pytest.mark.parametrize("acceptance", [0.6, 0.75, 0.9])
def test_acceptance_from_any_start(start, acceptance):
    adapter = mh.StepSizeAdapter(start, acceptance)
    trajectories(adapter, 300)
    assert acceptanceOf(adapter.freeze()) == pytest.approx(acceptance, abs=0.04)


def test_frozen():
    adapter = mh.StepSizeAdapter(0.3)
    trajectories(adapter, 50)
    frozen = adapter.freeze()
    assert adapter.isFrozen and adapter.update(0) == adapter.update(1) == adapter.freeze() == frozen


def test_frozen_too_early():
    adapter = mh.StepSizeAdapter(1e6)
    trajectories(adapter, 10)
    with pytest.raises(ValueError, match="search for the step size has not ended"):
        adapter.freeze()


def test_tracker_follows():
    """The stiffness changes by a factor of 10 over 2000 trajectories, and with it the right step size."""
    tracker, random, probabilities = mh.StepSizeTracker(0.5), np.random.default_rng(2), []
    for n in range(2000):
        mean = acceptanceOf(tracker.stepSize * 10 ** (n / 2000))
        probabilities.append(random.beta(3 * mean, 3 * (1 - mean)))
        tracker.update(probabilities[-1])
    for part in np.split(np.array(probabilities), 10):
        assert part.mean() == pytest.approx(0.75, abs=0.06)


@pytest.mark.parametrize("cls", [mh.StepSizeAdapter, mh.StepSizeTracker])
@pytest.mark.parametrize("count", [0, 3, 40])
def test_state_restores_every_bit(cls, count):
    adapter = cls(1e-3)
    trajectories(adapter, count)
    restored = cls(77)
    restored.setState(json.loads(json.dumps(adapter.getState())))
    assert np.array_equal(trajectories(adapter, 50, seed=9), trajectories(restored, 50, seed=9))
    with pytest.raises(ValueError, match="must be one that getState"):
        restored.setState({"stepSize": 1})


@pytest.mark.parametrize(
    "create, problem",
    [
        (lambda: mh.StepSizeAdapter(0), "step size is 0.0 ps"),
        (lambda: mh.StepSizeAdapter(math.nan), "step size is nan"),
        (lambda: mh.StepSizeAdapter(1, 1), "acceptance is 1; it must be between 0 and 1"),
        (lambda: mh.StepSizeTracker(1, gain=0), "gain is 0"),
        (lambda: mh.StepSizeAdapter(1).update(math.nan), "probability is nan"),
        (lambda: mh.StepSizeTracker(1).update(1.5), "probability is 1.5"),
    ],
)
def test_what_is_refused(create, problem):
    with pytest.raises(ValueError, match=problem):
        create()


@pytest.mark.parametrize("engine", ["native", "custom"])
@pytest.mark.parametrize("factor", [1000, 0.001])
def test_membrane(engine, factor):
    simulation = createSimulation(0.005 * factor, engine)
    result = mh.adaptStepSize(simulation, 400)
    integrator = simulation.integrator
    assert result.stepSize == integrator.getStepSize() / unit.picosecond
    assert simulation.currentStep == 400 and len(result.probabilities) == integrator.getNumTrajectories()
    assert 1 / 3 < result.stepSize / 0.005 < 3
    before, accepted = integrator.getNumTrajectories(), integrator.getNumAcceptedTrajectories()
    simulation.step(800)
    rate = (integrator.getNumAcceptedTrajectories() - accepted) / (integrator.getNumTrajectories() - before)
    assert rate == pytest.approx(0.75, abs=0.12)  # of which 3 standard errors of 400 trajectories are 0.065


def test_mistakes_are_told_by_the_name_of_what_was_called():
    with pytest.raises(ValueError, match=r"^adaptStepSize: the acceptance is 2; it must be between 0 and 1$"):
        mh.adaptStepSize(createSimulation(0.005), 10, acceptance=2)
    with pytest.raises(ValueError, match=r"^adaptStepSize: the search for the step size has not ended"):
        mh.adaptStepSize(createSimulation(5), 3)
    simulation = createSimulation(0.001, mm.LangevinMiddleIntegrator(300, 1, 0.001), flipProbability=0)
    with pytest.raises(ValueError, match=r"^adaptStepSize: there is no step size to adapt"):
        mh.adaptStepSize(simulation, 10)


def test_diverged_trajectories_have_probability_0():
    for engine in ("native", "custom"):
        simulation = createSimulation(1000, engine, flipProbability=0)
        assert Adaptation(simulation, mh.StepSizeAdapter(1000)).step() == [0]
        assert (
            simulation.integrator.getNumDivergedTrajectories() == 1
            and simulation.integrator.getStepSize() / unit.picosecond == pytest.approx(500)
        )


def test_too_short_a_burn_in_changes_nothing():
    simulation = createSimulation(5)
    with pytest.raises(ValueError, match="more trajectories are needed than in 6 steps, of which 3 had a trajectory"):
        mh.adaptStepSize(simulation, 6)
    assert simulation.integrator.getStepSize() == 5 * unit.picosecond


def adaptAt(monkeypatch, steps, probability):
    """Adapt with trajectories alone, whose acceptance probability is a function of how many there were."""
    count = itertools.count()
    monkeypatch.setattr(mh.StepSizeAdapter, "lastProbability", staticmethod(lambda *_: probability(next(count))))
    simulation = createSimulation(0.005, flipProbability=0)
    return simulation, lambda: mh.adaptStepSize(simulation, steps)


def test_a_step_size_at_which_next_to_nothing_was_accepted_is_an_error(monkeypatch):
    """The search found an order of magnitude, but nothing was accepted since: it is told, and all is as before."""
    simulation, adapt = adaptAt(monkeypatch, 6, lambda i: float(i < 3))
    with pytest.raises(ValueError, match=r"came to .* ps with a mean acceptance of 0\.00 in the last 2 tries, where 0"):
        adapt()
    assert simulation.integrator.getStepSize() == 0.005 * unit.picosecond


@pytest.mark.parametrize(
    "steps, late, problem",
    [
        (8, 0.75, "in the last 4 tries, .*too few to tell"),
        (8, 0.1, "of 0.10 in the last 4 tries"),
        (60, 0.45, "of 0.45 in the last 30 tries"),
        (60, 0.7, None),
    ],
)
def test_a_step_size_that_may_be_wrong_is_told(monkeypatch, recwarn, steps, late, problem):
    _, adapt = adaptAt(monkeypatch, steps, lambda i: [1.0, 0.0][i] if i < 2 else late)
    result = adapt()
    messages = [str(warning.message) for warning in recwarn]
    assert result.acceptance == pytest.approx(late) and len(messages) == (problem is not None)
    assert all(re.search(problem, message) for message in messages)


def test_a_step_size_that_moves_nothing_is_an_error():
    """On an uneven mesh steps that are accepted are of no use: it is told why, and all is as before."""
    sphere = mh.Mesh.icosphere(2)
    for height, isEven in ((1.0, True), (8.0, False)):
        mesh = mh.Mesh(sphere.vertices * [1, 1, height], sphere.triangles)
        scene = mh.Scene.of({"sampling": {"seed": 1}}, mesh)
        simulation = scene.createSimulation(scene.createForce())
        if isEven:
            assert mh.adaptStepSize(simulation, 200).stepSize > scene.stepSize / 10
            continue
        with pytest.raises(ValueError, match=r"moves vertices by .* edges are .* angles down to .*Mesh\.remeshed\(\)"):
            mh.adaptStepSize(simulation, 200)
        assert simulation.integrator.getStepSize() == scene.stepSize * unit.picosecond


def test_dynamics_have_nothing_to_adapt():
    simulation = createSimulation(0.001, mm.LangevinMiddleIntegrator(300, 1, 0.001), flipProbability=0)
    with pytest.raises(
        ValueError, match="no step size to adapt: the moves are LangevinMiddleIntegrator, EdgeFlipIntegrator"
    ):
        Adaptation(simulation, mh.StepSizeTracker(0.001))


def test_annealing():
    simulation = createSimulation(0.005)
    schedule = mh.ExponentialSchedule.over(500, kelvin(20 * KT), kelvin(KT / 5), firstStep=100)
    result = mh.anneal(simulation, schedule, 800)
    assert np.array_equal(result.steps, np.arange(800)) and np.array_equal(
        result.temperatures, [schedule(n) for n in range(800)]
    )
    integrator = simulation.integrator
    for temperature in (integrator.getTemperature(), *(integrator.getMove(i).getTemperature() for i in (0, 1))):
        assert temperature / unit.kelvin == pytest.approx(kelvin(KT / 5))
    probabilities = result.probabilities[np.isfinite(result.probabilities)]
    assert len(probabilities) == integrator.getNumTrajectories()
    for part in np.array_split(probabilities[40:], 4):
        assert 0.55 < part.mean() < 0.95


def test_annealing_goes_on_after_a_restart(tmp_path):
    schedule = mh.ExponentialSchedule(1000, 0.01, 300)
    whole, first = createSimulation(0.005), createSimulation(0.005)
    mh.anneal(whole, schedule, 60)
    tracker = mh.StepSizeTracker(0.005)
    mh.anneal(first, schedule, 25, tracker)
    first.saveCheckpoint(str(tmp_path / "checkpoint"))
    second, restored = createSimulation(0.1), mh.StepSizeTracker(0.1)
    second.loadCheckpoint(str(tmp_path / "checkpoint"))
    restored.setState(tracker.getState())
    mh.anneal(second, schedule, 35, restored)
    for a, b in zip(*(s.context.getState(positions=True).getPositions(asNumpy=True)._value for s in (whole, second))):
        assert np.array_equal(a, b)
