"""What the stages of a run do, as its table and trajectories show it."""

import numpy as np
import pytest

import openmmhelfrich as mh
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.studies import run


def runStages(prefix, stages, progress=None, **sampling):
    return run(
        parseConfig(
            {
                "mesh": {"icosphere": 2},
                "platform": {"threads": 1},
                "stages": stages,
                "sampling": {"seed": 3, "steps_per_trajectory": 20, "approach": "none", **sampling},
                "output": {"prefix": str(prefix), "observables_interval": 1, "trajectory_interval": 10},
            }
        ),
        progress,
    )


@pytest.mark.parametrize("fluid", [True, False])
def testMinimize(tmp_path, fluid):
    """A rough vesicle becomes smooth; the result is a row and a frame, and the run goes on from there."""
    stages = [
        {"kind": "sample", "steps": 100, "reduced_volume": 0.9},
        {"kind": "minimize", "fluid": fluid, "max_iterations": 400},
        {"kind": "sample", "steps": 5},
    ]
    summary = runStages(tmp_path / "a", stages)
    table = summary.table
    assert list(table["step"]) == list(range(107)) and list(table["stage"]) == 101 * [1] + [2] + 5 * [3]
    assert table["energy"][101] < 0.9 * table["energy"][100] and table["reducedVolume"][101] == pytest.approx(
        0.9, abs=0.005
    )
    with mh.readMeshTrajectory(summary.outputs.meshTrajectory) as frames:
        assert list(frames.steps) == [*range(10, 101, 10), 101]
        assert frames[-1].mesh.area == pytest.approx(table["area"][101], rel=1e-12)
        assert np.array_equal(frames[-1].mesh.triangles, frames[-2].mesh.triangles) != fluid
    assert any("stage 2, minimize: " in note and "iterations" in note for note in summary.notes)


def testTolerance(tmp_path):
    """In kT per unit of length: a looser one ends earlier."""
    iterations = []
    for tolerance in (20.0, 1.0):
        stages = [{"kind": "sample", "steps": 20}, {"kind": "minimize", "fluid": False, "tolerance": tolerance}]
        runStages(
            tmp_path / f"a{tolerance}",
            stages,
            lambda study: iterations.append(study.stage.position) if study.stage.isDone and study.index == 1 else None,
        )
    assert 0 < iterations[0] < iterations[1]


def testConditionsOfEachStage(tmp_path):
    stages = [
        {"kind": "sample", "steps": 4, "target_area": 12.0},
        {"kind": "sample", "steps": 3, "temperature": 100.0, "step_size": 1e-4},
        {"kind": "anneal", "steps": 5, "end_temperature": 30.0, "cooling_start": 1},
        {"kind": "anneal", "steps": 3, "table": [[0, 40], [2, 20]]},
        {"kind": "sample", "steps": 2, "reduced_volume": 0.9},
    ]
    summary = runStages(tmp_path / "a", stages)
    table = summary.table
    assert list(table["stage"]) == 5 * [1] + 3 * [2] + 5 * [3] + 3 * [4] + 2 * [5]
    cooling = 300 * 0.1 ** (np.arange(4) / 4)
    assert table["temperature"] == pytest.approx([*5 * [300], *3 * [100], 300, *cooling, 40, 30, 20, 300, 300])
    assert list(table["stepSize"][5:8]) == 3 * [1e-4] and table["stepSize"][-1] == table["stepSize"][0]
    assert table["targetArea"][0] == pytest.approx(mh.Mesh.icosphere(2).area) and np.all(table["targetArea"][1:] == 12)
    assert table["targetVolume"][-1] == pytest.approx(0.9 * 12**1.5 / (6 * np.sqrt(np.pi)))


def testAutomaticStepSize(tmp_path):
    """It changes in the burn-in, whose rows are marked, and not after; trajectories are then accepted as often as they
    should be.
    """
    summary = runStages(
        tmp_path / "a",
        [{"kind": "sample", "steps": 2400, "step_size": "auto"}],
        burn_in=1600,
        target_acceptance=0.6,
        step_size=1e-5,
    )
    table = summary.table
    first = int(np.argmax(table["equilibrated"]))
    assert first == 1601 and np.all(table["equilibrated"][first:] == 1) and np.all(table["equilibrated"][:first] == 0)
    frozen = table["stepSize"][first:]
    assert np.all(frozen == frozen[0]) and len(np.unique(table["stepSize"][:first])) > 100
    assert summary.acceptance == pytest.approx(0.6, abs=3 * np.sqrt(0.24 / 400))
    (note,) = summary.notes
    assert (
        f"step size {frozen[0]:.4g} ps, chosen for an acceptance of 60%" in note
        and note in summary.outputs.settings.read_text().replace("\n# ", " ")
    )


def testBurnInThatIsTooShort(tmp_path):
    summary = runStages(tmp_path / "a", [{"kind": "sample", "steps": 3}], burn_in=2, step_size="auto")
    assert any("no step size has been chosen" in note for note in summary.notes)
    assert np.all(summary.table["equilibrated"] == 0)


def testAnnealingKeepsTheAcceptance(tmp_path):
    accepted = []

    def progress(study):
        integrator = study.simulation.integrator
        accepted.append((integrator.getNumTrajectories(), integrator.getNumAcceptedTrajectories()))

    summary = runStages(
        tmp_path / "a",
        [{"kind": "anneal", "steps": 1500, "start_temperature": 3000.0, "end_temperature": 3.0}],
        progress,
    )
    trajectories, good = np.array(accepted).T
    for start in (300, 900):
        count = trajectories[start + 600 - 1] - trajectories[start]
        assert (good[start + 600 - 1] - good[start]) / count == pytest.approx(0.75, abs=0.12)
    assert summary.table["temperature"][-1] == pytest.approx(3, rel=0.01)


def testTrajectoriesOfRandomLength(tmp_path):
    """Lengths are uniform from 70% to 130%, the same for the same seed, and others for another."""

    def lengthsOf(name, **sampling):
        lengths = []
        runStages(
            tmp_path / name,
            [{"kind": "sample", "steps": 400}],
            lambda study: lengths.append(study.simulation.integrator.getMove(0).getLastNumSteps()),
            flip_probability=0.0,
            **sampling,
        )
        return lengths

    lengths = lengthsOf("a", trajectory_jitter=0.3)
    counts = np.bincount(lengths)[14:]
    assert min(lengths) == 14 and max(lengths) == 26 and counts.sum() == 400
    # The 0.5% point of chi square with 12 degrees of freedom.
    assert np.sum((counts - 400 / 13) ** 2 / (400 / 13)) < 28.3
    assert lengthsOf("b", trajectory_jitter=0.3) == lengths != lengthsOf("c", trajectory_jitter=0.3, seed=4)
    assert set(lengthsOf("d")) == {20}
