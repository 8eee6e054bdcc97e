"""Steps that would take hours: an exception of a signal's handler, or of whoever listens, ends them within seconds and
leaves everything as it was.
"""

import os
import signal
import subprocess
import sys
import threading
import time

import openmm as mm
import pytest

import openmmhelfrich as mh
from membranes import PLATFORMS, createBlob, createContext, createForce
from openmmhelfrich.sampling.interruption import StepInterrupted, interruptible


def longFlips():
    return mh.EdgeFlipIntegrator(300, 1e6)


def longTrajectory(refreshment=1.0, substeps=1, weight=0.0):
    integrator = mh.HamiltonianTrajectoryIntegrator(300, 1e-9, 10**9)
    integrator.setMomentumRefreshment(refreshment)
    integrator.setTetherSubsteps(substeps)
    integrator.setMultilevelWeight(weight)
    return integrator


def longWaves():
    return mh.ShearWaveIntegrator(300, 1e-6, 1, 3, 10**9)


LONG = {
    "flips": longFlips,
    "trajectory": longTrajectory,
    "partial refreshment": lambda: longTrajectory(0.3, 10**9),
    "coarser meshes": lambda: longTrajectory(0.3, 1, 2.0),
    "shear waves": longWaves,
}


def stateOf(context, force):
    """Return all that a step can change."""
    state = context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    return mm.XmlSerializer.serialize(state), force.getTrianglesInContext(context).tolist()


def createLong(kind, platform="CPU", threads=1):
    """Create a Context whose integrator has made a short step, and will make a long one."""
    mesh, integrator = createBlob(4 if threads > 1 else 2), LONG[kind]()
    force = createForce(mesh)
    integrator.setRandomNumberSeed(5)
    names = {"flips": ["Fraction"], "shear waves": ["MovesPerStep"]}.get(kind, ["StepsPerTrajectory", "TetherSubsteps"])
    lengths = [getattr(integrator, f"get{name}")() for name in names]
    for name in names:
        getattr(integrator, f"set{name}")(1)
    properties = {"Threads": str(threads)} if platform == "CPU" else {}
    context = createContext(mesh, force, platform, integrator, properties)
    integrator.step(1)
    for name, length in zip(names, lengths):
        getattr(integrator, f"set{name}")(length)
    return force, integrator, context


@pytest.mark.parametrize("platform, threads", [*((name, 1) for name in PLATFORMS), ("CPU", 2)])
@pytest.mark.parametrize("kind", LONG)
def test_a_listener_ends_a_step(kind, platform, threads):
    force, integrator, context = createLong(kind, platform, threads)
    before, asked = stateOf(context, force), []

    def isToStop():
        asked.append(time.monotonic())
        return len(asked) == 2

    with interruptible(isToStop), pytest.raises(StepInterrupted):
        integrator.step(1)
    assert len(asked) == 2
    assert stateOf(context, force) == before


def test_a_signal_ends_a_step():
    force, integrator, context = createLong("flips")
    before = stateOf(context, force)
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        integrator.step(1)
    assert stateOf(context, force) == before


def test_only_the_thread_that_listens_is_asked():
    force, integrator, context = createLong("flips")
    ended = threading.Event()

    def other():
        with interruptible(ended.is_set), pytest.raises(StepInterrupted):
            integrator.step(1)

    thread = threading.Thread(target=other)
    with interruptible(lambda: pytest.fail("the other thread's step is none of ours")):
        thread.start()
        time.sleep(0.5)
    assert thread.is_alive()
    ended.set()
    thread.join(20)
    assert not thread.is_alive()


def test_after_an_interruption_the_step_is_the_same():
    """And one that is asked, and goes on, is that of which nobody asks."""

    def run(*answers):
        mesh, asked = createBlob(2), []
        force, integrator = createForce(mesh), mh.EdgeFlipIntegrator(300, 15000)
        integrator.setRandomNumberSeed(1)
        context = createContext(mesh, force, "CPU", integrator)
        for answer in answers:
            with interruptible(lambda answer=answer: asked.append(1) or answer):
                if answer:
                    with pytest.raises(StepInterrupted):
                        integrator.step(1)
                else:
                    integrator.step(1)
        assert len(asked) >= len(answers)
        return stateOf(context, force)

    assert run(True, False) == run(False)


def test_limits():
    with pytest.raises(mm.OpenMMException, match=r"steps per trajectory is 2e\+09; it must be at most 1e\+09"):
        longTrajectory().setStepsPerTrajectory(2 * 10**9)
    integrator = mh.EdgeFlipIntegrator(300, 1e12)
    force = createForce(createBlob(1))
    context = createContext(createBlob(1), force, "CPU", integrator)
    before = stateOf(context, force)
    with pytest.raises(mm.OpenMMException, match=r"number of attempts in a sweep is .* at most"):
        integrator.step(1)
    assert stateOf(context, force) == before


@pytest.mark.parametrize(
    "key, number",
    [
        ("flip_fraction = 1e6\nflip_probability = 1.0", signal.SIGINT),
        ("steps_per_trajectory = 1000000000", signal.SIGTERM),
    ],
)
def test_a_signal_ends_a_run(inFolder, key, number):
    """The run ends as the signal would have it, and goes on from the step that was given up."""
    with open("run.toml", "w") as file:
        file.write(f"[mesh]\nicosphere = 2\n[sampling]\nseed = 1\nsteps = 20\n{key}\n")
    command = [sys.executable, "-m", "openmmhelfrich.cli", "run", "run.toml"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not os.path.exists("run.checkpoint"):
        time.sleep(0.1)
    time.sleep(1)
    process.send_signal(number)
    output, errors = process.communicate(timeout=600)
    assert process.returncode == 128 + number and "Traceback" not in errors
    assert "resume run goes on" in output
    assert len(mh.Mesh.read("run.ply").triangles) == 320
