"""A run that is continued from a checkpoint, a State or after reinitialize() is the uninterrupted one."""

import re
import struct
import subprocess
import sys

import numpy as np
import openmm as mm
import pytest
from openmm import app

import openmmhelfrich as mh
from membranes import PLATFORMS, TERMS, createBlob, createForce, energyOf, forcesOf

DRIVERS = ["native", "custom", "flips", "langevin"]


def createIntegrator(driver, seed=7):
    flips = mh.EdgeFlipIntegrator(3000, 0.1)
    if driver == "langevin":
        langevin = mm.LangevinMiddleIntegrator(3000, 50, 0.0001)
        langevin.setRandomNumberSeed(seed)
        integrator = mh.HybridMonteCarloIntegrator(langevin, flips, 0.3)
    else:
        integrator = flips if driver == "flips" else mh.HybridMonteCarloIntegrator(3000, 0.0001, 10, 0.1, 0.3, driver)
    if driver == "native":
        integrator.setSplitting("bcss2")
        integrator.setTrajectoryJitter(0.5)
        integrator.setTetherSubsteps(2)
        integrator.setMomentumRefreshment(0.4)
        integrator.addShearWaves(mh.ShearWaveIntegrator(3000, 0.001, 1, 3, 4), 0.3)
    integrator.setRandomNumberSeed(seed)
    return integrator


def createSimulation(driver, platform, seed=7, threads="1"):
    mesh = createBlob(2)
    system = mesh.createSystem()
    force = createForce(mesh, TERMS, 1)
    system.addForce(force)
    properties = {} if platform == "Reference" else {"Threads": threads}
    simulation = app.Simulation(
        mesh.topology(), system, createIntegrator(driver, seed), mm.Platform.getPlatform(platform), properties
    )
    simulation.context.setPositions(mesh.vertices)
    return simulation, force


def flipsOf(integrator):
    return integrator if isinstance(integrator, mh.EdgeFlipIntegrator) else integrator.getFlipIntegrator()


def countersOf(integrator):
    flips = flipsOf(integrator)
    counters = [flips.getNumSweeps(), flips.getNumAttempted(), flips.getNumAccepted(), flips.getNumForbidden()]
    if isinstance(integrator, mh.HybridMonteCarloIntegrator):
        counters += [
            integrator.getNumTrajectories(),
            integrator.getNumAcceptedTrajectories(),
            integrator.getNumDivergedTrajectories(),
        ]
        if integrator.getShearWaveProbability() > 0:
            waves = integrator.getShearWaveIntegrator()
            counters += [waves.getNumAttempted(), waves.getNumAccepted(), waves.getNumDiverged()]
    return counters


def stateOf(simulation, force):
    """Return everything that a run changes, as arrays to compare bit by bit."""
    context = simulation.context
    state = context.getState(positions=True, velocities=True, parameters=True)
    return {
        "positions": state.getPositions(asNumpy=True)._value,
        "velocities": state.getVelocities(asNumpy=True)._value,
        "triangles": force.getTrianglesInContext(context),
        "counters": np.array(countersOf(simulation.integrator)),
        "parameters": np.array(sorted(state.getParameters().items())),
        "step": np.array(context.getStepCount()),
        "time": np.array(context.getTime()._value),
    }


def assertSame(found, expected, names=None):
    for name in names or expected:
        assert np.array_equal(found[name], expected[name]), name


def changeTargets(simulation, force):
    """Change the targets, as an annealing schedule does: a restart must know them."""
    simulation.context.setParameter(force.getTargetVolumeParameter(), 1.1 * force.getTargetVolume()._value)
    simulation.context.setParameter(
        force.getTargetAreaDifferenceParameter(), 0.9 * force.getTargetAreaDifference()._value
    )


def runInFreshProcess(driver, platform, action, output):
    """Run this file's main() in another process."""
    result = subprocess.run(
        [sys.executable, __file__, driver, platform, action, str(output)], capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr
    return np.load(output)


def load(simulation, action):
    kind, file = action.split(":", 1)
    if kind == "checkpoint":
        simulation.loadCheckpoint(file)
    elif kind == "state":
        simulation.loadState(file)


def main(driver, platform, action, output):
    """Continue a run from a checkpoint or a State for 40 steps, with another seed and another number of threads, which
    must not matter.
    """
    # The random numbers of OpenMM's Langevin integrator do depend on the number of threads.
    simulation, force = createSimulation(driver, platform, seed=99, threads="1" if driver == "langevin" else "2")
    load(simulation, action)
    simulation.step(40)
    np.savez(output, **stateOf(simulation, force))


def startRun(driver, platform):
    simulation, force = createSimulation(driver, platform)
    simulation.step(30)
    changeTargets(simulation, force)
    simulation.step(5)
    return simulation, force


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_checkpoint_in_a_fresh_process(driver, platform, tmp_path):
    simulation, force = startRun(driver, platform)
    start = force.getTriangles()
    file = tmp_path / "run.chk"
    simulation.saveCheckpoint(str(file))
    middle = stateOf(simulation, force)
    simulation.step(40)
    end = stateOf(simulation, force)
    # Otherwise there would be nothing to restore.
    assert not np.array_equal(middle["triangles"], start)
    assert not np.array_equal(middle["triangles"], end["triangles"])
    assert driver == "flips" or not np.array_equal(middle["positions"], end["positions"])
    assert np.all(end["counters"][[0, 1, 2, 3]] > 0)
    assertSame(runInFreshProcess(driver, platform, f"checkpoint:{file}", tmp_path / "end.npz"), end)


@pytest.mark.parametrize("driver", ["native", "flips"])
@pytest.mark.parametrize("platform", PLATFORMS)
def test_state_xml_in_a_fresh_process(driver, platform, tmp_path):
    """The integrators with random numbers of their own continue from a State, too, to the last bit."""
    simulation, force = startRun(driver, platform)
    file = tmp_path / "state.xml"
    simulation.saveState(str(file))
    simulation.step(40)
    assertSame(runInFreshProcess(driver, platform, f"state:{file}", tmp_path / "end.npz"), stateOf(simulation, force))


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_going_back_in_the_same_context(driver, platform, tmp_path):
    simulation, force = startRun(driver, platform)
    simulation.saveCheckpoint(str(tmp_path / "run.chk"))
    middle = stateOf(simulation, force)
    energy, forces = energyOf(simulation.context), forcesOf(simulation.context)
    simulation.step(40)
    end = stateOf(simulation, force)
    simulation.loadCheckpoint(str(tmp_path / "run.chk"))
    assertSame(stateOf(simulation, force), middle)
    assert energyOf(simulation.context) == energy
    assert np.array_equal(forcesOf(simulation.context), forces)
    simulation.step(40)
    assertSame(stateOf(simulation, force), end)


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_state_restores_all_but_openmms_random_numbers(driver, platform, tmp_path):
    simulation, force = startRun(driver, platform)
    simulation.saveState(str(tmp_path / "state.xml"))
    saved = stateOf(simulation, force)
    other, otherForce = createSimulation(driver, platform, seed=99)
    other.loadState(str(tmp_path / "state.xml"))
    assertSame(stateOf(other, otherForce), saved)
    # The flips continue with the seed of the run that was saved.
    flipsOf(simulation.integrator).step(3)
    flipsOf(other.integrator).step(3)
    assertSame(stateOf(other, otherForce), stateOf(simulation, force), ["triangles", "counters"])


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("platform", PLATFORMS)
def test_reinitialize(driver, platform):
    simulation, force = startRun(driver, platform)
    other, otherForce = startRun(driver, platform)
    before = stateOf(simulation, force)
    simulation.context.reinitialize(preserveState=True)
    assertSame(stateOf(simulation, force), before)
    flipsOf(simulation.integrator).step(3)
    flipsOf(other.integrator).step(3)
    assert np.array_equal(
        force.getTrianglesInContext(simulation.context), otherForce.getTrianglesInContext(other.context)
    )
    simulation.context.reinitialize(preserveState=False)
    assert np.array_equal(force.getTrianglesInContext(simulation.context), force.getTriangles())
    assert np.all(np.array(countersOf(simulation.integrator)) == 0)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_system_integrator_and_state_from_xml(platform):
    """XML alone continues a run: nothing of the script that began it is needed."""
    simulation, force = startRun("native", platform)
    context = simulation.context
    texts = [
        mm.XmlSerializer.serialize(item)
        for item in (
            simulation.system,
            simulation.integrator,
            context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True),
        )
    ]
    system, integrator, state = map(mm.XmlSerializer.deserialize, texts)
    integrator = mh.HybridMonteCarloIntegrator.cast(integrator)
    copy = app.Simulation(simulation.topology, system, integrator, mm.Platform.getPlatform(platform))
    copy.context.setState(state)
    copyForce = mh.HelfrichForce.cast(system.getForce(0))
    assertSame(stateOf(copy, copyForce), stateOf(simulation, force))
    simulation.step(40)
    copy.step(40)
    assertSame(stateOf(copy, copyForce), stateOf(simulation, force))


@pytest.mark.parametrize("form", ["checkpoint", "state"])
@pytest.mark.parametrize("threads", ["1", "2"])
def test_flips_continue_on_another_number_of_threads(threads, form, tmp_path):
    """In the middle of a run of sweeps over a membrane large enough for several threads to share the work."""
    mesh = createBlob(4)

    def create(threads, seed):
        system = mesh.createSystem()
        force = createForce(mesh, TERMS, 2)
        system.addForce(force)
        flips = mh.EdgeFlipIntegrator(3000, 0.3)
        flips.setRandomNumberSeed(seed)
        simulation = app.Simulation(
            mesh.topology(), system, flips, mm.Platform.getPlatform("CPU"), {"Threads": threads}
        )
        simulation.context.setPositions(mesh.vertices)
        return simulation, force

    simulation, force = create(threads, 7)
    simulation.step(5)
    file = str(tmp_path / form)
    simulation.saveCheckpoint(file) if form == "checkpoint" else simulation.saveState(file)
    middle = force.getTrianglesInContext(simulation.context)
    simulation.step(5)
    assert not np.array_equal(middle, force.getTrianglesInContext(simulation.context))
    for others in "1", "2", "3":
        other, otherForce = create(others, 99)
        load(other, f"{form}:{file}")
        other.step(5)
        assertSame(stateOf(other, otherForce), stateOf(simulation, force))


@pytest.mark.parametrize("sweeps", [990, 1010])
@pytest.mark.parametrize("form", ["checkpoint", "state"])
def test_restart_beside_a_new_order_of_the_vertices(sweeps, form, tmp_path):
    """Long after the start a platform may store vertices in another order, which changes the last bits of sums: a
    restart must know it.
    """
    simulation, force = createSimulation("native", "CPU")
    flipsOf(simulation.integrator).step(sweeps)
    file = str(tmp_path / form)
    simulation.saveCheckpoint(file) if form == "checkpoint" else simulation.saveState(file)
    other, otherForce = createSimulation("native", "CPU", seed=99)
    load(other, f"{form}:{file}")
    for s in simulation, other:
        s.integrator.setStepSize(0.000005)
        flipsOf(s.integrator).step(20)
        s.step(20)
    assert np.array_equal(forcesOf(other.context), forcesOf(simulation.context))
    assert simulation.integrator.getNumAcceptedTrajectories() > 0
    assertSame(stateOf(other, otherForce), stateOf(simulation, force))


def test_chosen_seed_is_kept():
    """With seed 0 each Context has a seed of its own, and a checkpoint carries it."""
    results = []
    for _ in range(2):
        simulation, force = createSimulation("native", "Reference", seed=0)
        simulation.step(20)
        checkpoint = simulation.context.createCheckpoint()
        simulation.step(20)
        end = stateOf(simulation, force)
        simulation.context.loadCheckpoint(checkpoint)
        simulation.step(20)
        assertSame(stateOf(simulation, force), end)
        results.append(end)
    assert not np.array_equal(results[0]["triangles"], results[1]["triangles"])


def test_a_checkpoint_of_another_mesh_is_refused():
    simulation, force = createSimulation("flips", "Reference")
    other = createBlob(1)
    system = other.createSystem()
    system.addForce(createForce(other))
    context = mm.Context(system, mh.EdgeFlipIntegrator(300, 0.1), mm.Platform.getPlatform("Reference"))
    context.setPositions(other.vertices)
    with pytest.raises(mm.OpenMMException):
        simulation.context.loadCheckpoint(context.createCheckpoint())


MOVES = {
    "EdgeFlipIntegrator": lambda: mh.EdgeFlipIntegrator(300, 0.1),
    "HamiltonianTrajectoryIntegrator": lambda: mh.HamiltonianTrajectoryIntegrator(300, 0.001, 2),
    "CustomTrajectoryIntegrator": lambda: mh.CustomTrajectoryIntegrator(300, 0.001, 2),
    "ShearWaveIntegrator": lambda: mh.ShearWaveIntegrator(300, 0.001, 1, 3, 4),
    "HybridMonteCarloIntegrator": lambda: mh.HybridMonteCarloIntegrator(300, 0.001, 2),
}


def contextOf(name):
    mesh = createBlob(1)
    system = mesh.createSystem()
    system.addForce(createForce(mesh))
    context = mm.Context(system, MOVES[name](), mm.Platform.getPlatform("Reference"))
    context.setPositions(mesh.vertices)
    return context


def withoutNames(checkpoint):
    """Return a checkpoint as it was before classes wrote their names; a mixture wrote "HlfMoves"."""
    mixture = b"HlfMove:" + struct.pack("i", len("HybridMonteCarloIntegrator")) + b"HybridMonteCarloIntegrator"
    old = re.sub(rb"HlfMove:....[A-Za-z]+Integrator", b"", checkpoint.replace(mixture, b"HlfMoves"), flags=re.DOTALL)
    assert len(old) < len(checkpoint)
    return old


@pytest.mark.parametrize("writer", MOVES)
def test_a_checkpoint_of_another_class_is_refused(writer):
    written = contextOf(writer)
    written.getIntegrator().step(3)
    checkpoint = written.createCheckpoint()
    for reader in MOVES:
        context = contextOf(reader)
        if reader == writer:
            context.loadCheckpoint(checkpoint)
            assert context.createCheckpoint() == checkpoint
        else:
            with pytest.raises(mm.OpenMMException, match=f"{reader}: the checkpoint is of the class {writer}"):
                context.loadCheckpoint(checkpoint)


@pytest.mark.parametrize("move", MOVES)
def test_a_checkpoint_without_names_is_read(move):
    written, context = contextOf(move), contextOf(move)
    written.getIntegrator().step(3)
    context.loadCheckpoint(withoutNames(written.createCheckpoint()))
    assert context.createCheckpoint() == written.createCheckpoint()


def test_a_damaged_name_is_refused():
    context = contextOf("EdgeFlipIntegrator")
    damaged = context.createCheckpoint().replace(b"EdgeFlip", b"\xff\x00\x01Flip ")
    with pytest.raises(mm.OpenMMException, match="EdgeFlipIntegrator: the checkpoint is damaged"):
        context.loadCheckpoint(damaged)


def test_a_state_of_another_class_is_refused():
    flips, waves = contextOf("EdgeFlipIntegrator"), contextOf("ShearWaveIntegrator")
    with pytest.raises(mm.OpenMMException, match="another class of Integrator: it has no 'numDiverged'"):
        waves.setState(flips.getState(integratorParameters=True))


def test_a_state_of_another_mesh_is_refused():
    simulation, force = createSimulation("flips", "Reference")
    text = mm.XmlSerializer.serialize(simulation.context.getState(integratorParameters=True))
    first = " ".join(map(str, force.getTriangles()[0]))
    for wrong, words in (("0 0 1", "triangle 0.*repeats"), ("0 1 162", "index 162.*0 to 161"), ("0 1 x", "near 'x ")):
        state = mm.XmlSerializer.deserialize(text.replace(first, wrong, 1))
        before = force.getTrianglesInContext(simulation.context)
        with pytest.raises(mm.OpenMMException, match=words):
            simulation.context.setState(state)
        assert np.array_equal(force.getTrianglesInContext(simulation.context), before)


if __name__ == "__main__":
    main(*sys.argv[1:])
