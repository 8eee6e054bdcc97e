"""A run that is stopped, killed or extended leaves the files that it would have left had it never been stopped."""

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import h5py
import numpy as np
import openmm as mm
import pytest

import openmmhelfrich as mh
from openmmhelfrich.runs.checkpoint import loadRunState, loadSimulation
from openmmhelfrich.runs.config import parseConfig, readConfig
from openmmhelfrich.runs.outputs import Recorder
from openmmhelfrich.runs.studies import resume, run

STAGES = [
    {"kind": "sample", "steps": 60},
    {"kind": "minimize", "max_iterations": 200, "reduced_volume": 0.95},
    {"kind": "anneal", "steps": 40, "end_temperature": 30.0},
    {"kind": "continue", "windows": 2, "reduced_volume": 0.9, "equilibration": 5, "steps": 10, "there_and_back": True},
]


def configure(prefix, stages=STAGES, **sections):
    config = {
        "mesh": {"icosphere": 2},
        "repulsion": {"modulus": 10.0},
        "platform": {"threads": 1},
        "sampling": {
            "seed": 4,
            "steps_per_trajectory": 10,
            "trajectory_jitter": 0.3,
            "integrator": "bcss3",
            "step_size": "auto",
            "burn_in": 30,
            "shear_wave_probability": 0.2,
            "shear_waves_per_step": 5,
        },
        "output": {"prefix": str(prefix), "trajectory_interval": 7, "observables_interval": 3},
        "stages": stages,
    }
    for name, values in sections.items():
        config[name] = {**config[name], **values}
    return parseConfig(config)


def datasetsOf(file):
    """Return all datasets and attributes of a HDF5 file, wherever in it they are."""
    found = {}

    def keep(name, item):
        values = (item.dtype.str, item.shape, item[()].tobytes()) if isinstance(item, h5py.Dataset) else ()
        found[name] = (values, {key: np.asarray(value).tolist() for key, value in item.attrs.items()})

    with h5py.File(file) as content:
        keep("/", content)
        content.visititems(keep)
    return found


def contentsOf(prefix):
    """Return everything that runs with equal results must have in common."""
    files = {ending: Path(f"{prefix}.{ending}").read_bytes() for ending in ("dcd", "psf")}
    final = mh.Mesh.read(f"{prefix}.ply")
    with zipfile.ZipFile(f"{prefix}.checkpoint") as checkpoint:
        state = [checkpoint.read(name) for name in ("state.xml", "positions", "velocities")]
    return {
        "rows": Path(f"{prefix}.csv").read_text().split("\n"),  # one by one, so that a test says which is another
        **files,
        "meshes": datasetsOf(f"{prefix}.vtkhdf"),
        "vertices": final.vertices.tobytes(),
        "triangles": final.triangles.tobytes(),
        "state": state,
    }


def assertSame(prefix, expected):
    wasStopped = not loadRunState(f"{prefix}.checkpoint").isComplete
    assert not wasStopped, f"a signal from elsewhere ended the run {prefix}"  # it makes no error
    found = contentsOf(prefix)
    for name, value in expected.items():
        assert found[name] == value, name


class StopAt:
    """Ends a run at a step, as a progress callback."""

    def __init__(self, *steps):
        self._steps = steps

    def __call__(self, study):
        if study.simulation.currentStep in self._steps:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("run") / "a"
    summary = run(configure(prefix))
    assert not summary.interrupted and summary.steps == 176
    return contentsOf(prefix)


@pytest.mark.parametrize("steps", [1, 20, 60, 61, 62, 120])
def testStoppedAndResumed(uninterrupted, tmp_path, steps):
    summary = run(configure(tmp_path / "a"), StopAt(steps))
    assert summary.interrupted and summary.steps == steps
    summary = resume(tmp_path / "a")
    assert not summary.interrupted and summary.steps == 176 and summary.newSteps == 176 - steps
    assertSame(tmp_path / "a", uninterrupted)


def testStoppedWhileItMinimizes(uninterrupted, tmp_path):
    """A minimization is done as a whole: it begins anew where it was stopped."""

    def stop(study):
        if study.stage.title == "minimize" and study.stage.position == 50:
            raise KeyboardInterrupt

    summary = run(configure(tmp_path / "a"), stop)
    assert summary.interrupted and summary.steps == 60
    assert resume(tmp_path / "a").steps == 176
    assertSame(tmp_path / "a", uninterrupted)


def testWhenCheckpointsAreWrittenChangesNothing(uninterrupted, tmp_path):
    run(
        configure(tmp_path / "a", output={"checkpoint_interval": 1, "checkpoint_seconds": 1e-6}),
        lambda study: study.status(),
    )
    assertSame(tmp_path / "a", uninterrupted)


def testWhatWasWrittenAfterTheCheckpointIsDropped(uninterrupted, tmp_path):
    class Killed(Exception):
        pass

    def kill(study):
        if study.simulation.currentStep == 110:
            raise Killed

    with pytest.raises(Killed):
        run(configure(tmp_path / "a", output={"checkpoint_interval": 25}), kill)
    for ending in ("csv", "dcd"):  # a record that was cut short
        with open(tmp_path / f"a.{ending}", "ab") as file:
            file.write(b"17,0.3")
    (tmp_path / "a.psf").unlink()
    resume(tmp_path / "a")
    assertSame(tmp_path / "a", uninterrupted)


def testMoreSteps(tmp_path):
    stages = [{"kind": "sample", "steps": 40}]
    run(configure(tmp_path / "a", stages))
    expected = contentsOf(tmp_path / "a")
    run(configure(tmp_path / "b", [{"kind": "sample", "steps": 25}]))
    assert resume(tmp_path / "b", steps=15).steps == 40
    assertSame(tmp_path / "b", expected)


def testMoreStepsAfterAnotherKindOfStage(tmp_path):
    run(configure(tmp_path / "a", STAGES[2:3]))
    summary = resume(tmp_path / "a", steps=10)
    assert (
        summary.steps == 50 and list(summary.table["stage"][-2:]) == [2, 2] and summary.table["temperature"][-1] == 300
    )


def testRunThatIsComplete(tmp_path):
    run(configure(tmp_path / "a", STAGES[2:3]))
    with pytest.raises(ValueError, match="complete, at step 40; ask for more steps"):
        resume(tmp_path / "a")
    (tmp_path / "a_shape.png").unlink()  # a run that was killed while it drew
    resume(tmp_path / "a")
    assert (tmp_path / "a_shape.png").exists()


def testCheckpointsOfTheFirstFormat(uninterrupted, tmp_path):
    """They have positions and velocities in the State."""
    run(configure(tmp_path / "a"), StopAt(20))
    file = tmp_path / "a.checkpoint"
    simulation, _ = loadSimulation(file, mm.Platform.getPlatform("CPU"), {"Threads": "1"})
    simulation.saveState(str(tmp_path / "state.xml"))
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in ("run.json", "system.xml", "integrator.xml")}
    parts["run.json"] = parts["run.json"].replace(b'"format": 2', b'"format": 1')
    parts["state.xml"] = (tmp_path / "state.xml").read_bytes()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    assert resume(tmp_path / "a").steps == 176
    assertSame(tmp_path / "a", uninterrupted)


def testNothingToResume(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no checkpoint .*a.checkpoint.*start one with run"):
        resume(tmp_path / "a")
    (tmp_path / "a.toml").write_text("[mesh]\nicosphere = 1\n")
    with pytest.raises(FileNotFoundError, match=r"no checkpoint .*a.checkpoint beside .*a.toml: .*--output"):
        resume(tmp_path / "a.toml")
    (tmp_path / "a.checkpoint").write_text("no ZIP file")
    with pytest.raises(ValueError, match=r"a.checkpoint is not a checkpoint of openmm-helfrich, or is damaged"):
        resume(tmp_path / "a")


@pytest.mark.parametrize(
    "old, new", [(b'"startTargets":', b'"starttargets":'), (b'"position":', b'"positiom":'), (b'"area"', b'"aarea"')]
)
def testCheckpointThatMakesNoSense(tmp_path, old, new):
    """What is damaged in what a checkpoint says of the run is told with its name, before anything is written."""
    run(configure(tmp_path / "a"), StopAt(50))
    file = tmp_path / "a.checkpoint"
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    assert old in parts["run.json"]
    parts["run.json"] = parts["run.json"].replace(old, new)
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.suffix in (".csv", ".dcd", ".vtkhdf")}
    with pytest.raises(ValueError, match=r"a\.checkpoint"):
        resume(tmp_path / "a")
    assert before == {name: (tmp_path / name).read_bytes() for name in before}


@pytest.mark.parametrize("ending", ["csv", "dcd", "vtkhdf"])
def testFileThatWasCut(tmp_path, ending):
    run(configure(tmp_path / "a"), StopAt(50))
    file = tmp_path / f"a.{ending}"
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(ValueError, match=f"a.{ending} "):
        resume(tmp_path / "a")


def testOtherVersionsAndPlatformsAreNotSilent(tmp_path):
    run(configure(tmp_path / "a"), StopAt(50))
    file = tmp_path / "a.checkpoint"
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    parts["run.json"] = parts["run.json"].replace(b'"OpenMM": "', b'"OpenMM": "1')
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    notes = "\n".join(resume(tmp_path / "a", platform="Reference").notes)
    assert "from step 50 on platform Reference instead of CPU" in notes and "from step 50 with OpenMM 8" in notes
    assert notes.splitlines()[0] in (tmp_path / "a.resolved.toml").read_text().replace("\n# ", " ")


def testFullDisk(uninterrupted, tmp_path, monkeypatch):
    """The checkpoint before stays, and the run goes on from it."""
    original = Recorder.sync

    def sync(self):
        if self._simulation.currentStep >= 75:
            raise OSError(28, "No space left on device")
        return original(self)

    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "sync", sync)
        with pytest.raises(OSError, match="the disk is full; everything up to step 60 is safe: openmm-helfrich resume"):
            run(configure(tmp_path / "a", output={"checkpoint_interval": 25}))
    with zipfile.ZipFile(tmp_path / "a.checkpoint") as checkpoint:
        assert json.loads(checkpoint.read("run.json"))["step"] == 60
    resume(tmp_path / "a")
    assertSame(tmp_path / "a", uninterrupted)


def testFileThatCannotGrow(uninterrupted, tmp_path):
    """A write that does fail, in the midst of a frame or a row."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    config = configure(tmp_path / "a", output={"checkpoint_interval": 25})
    resource.setrlimit(resource.RLIMIT_FSIZE, (40000, hard))
    try:
        with pytest.raises(OSError, match="cannot be written: File too large; everything up to step"):
            run(config)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    resume(tmp_path / "a")
    assertSame(tmp_path / "a", uninterrupted)


def testSettingsRepeatTheRun(uninterrupted, tmp_path):
    run(configure(tmp_path / "a"))
    again = readConfig(tmp_path / "a.resolved.toml")
    again.output.prefix = str(tmp_path / "b")
    run(again)
    assertSame(tmp_path / "b", uninterrupted)


LONG = """
[mesh]
icosphere = 2
[repulsion]
modulus = 10
[platform]
threads = 1
[sampling]
seed = 3
steps_per_trajectory = 50
step_size = "auto"
trajectory_jitter = 0.3
[output]
trajectory_interval = 20
observables_interval = 5
checkpoint_interval = 100
[[stages]]
kind = "minimize"
max_iterations = 1000
reduced_volume = 0.97
[[stages]]
kind = "sample"
steps = 2600
[[stages]]
kind = "anneal"
steps = 600
end_temperature = 30
[[stages]]
kind = "continue"
windows = 3
reduced_volume = 0.9
steps = 80
equilibration = 40
there_and_back = true
"""


def command(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "openmmhelfrich.cli", *arguments, "--quiet"], stderr=subprocess.PIPE, text=True
    )


def testKilledAtRandomMoments(inFolder):
    """SIGKILL, 20 times, at any moment from the start of the interpreter on: some before there is anything, some while
    the run goes on.
    """
    Path("run.toml").write_text(LONG)
    start = time.monotonic()
    reference = command("run", "run.toml", "--output", "reference")
    while not os.path.exists("reference.checkpoint"):
        assert reference.poll() is None, reference.stderr.read()
    startUp = time.monotonic() - start
    assert reference.wait() == 0, reference.stderr.read()
    expected, moments = contentsOf("reference"), random.Random(1)
    kills, prefix = 0, "a"
    while kills < 20 or os.path.exists(f"{prefix}.checkpoint"):
        process = command(
            *(["resume", prefix] if os.path.exists(f"{prefix}.checkpoint") else ["run", "run.toml", "--output", prefix])
        )
        try:
            process.wait(moments.uniform(0, 1.6 * startUp) if kills < 20 else None)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            kills += 1
        else:  # it came to its end, now or just before the last kill
            message = process.stderr.read()
            assert process.returncode == 0 or "is complete" in message, message
            assertSame(prefix, expected)
            prefix += "a"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def testSignalsEndARunAfterACheckpoint(inFolder, number):
    Path("run.toml").write_text(LONG.replace("steps = 2600", "steps = 100000"))
    process = command("run", "run.toml")
    while not os.path.exists("run.csv") or os.path.getsize("run.csv") < 3000:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(number)
    assert process.wait() == 128 + number, process.stderr.read()
    with zipfile.ZipFile("run.checkpoint") as checkpoint:
        state = json.loads(checkpoint.read("run.json"))
    assert 0 <= state["step"] - mh.readObservables("run.csv")["step"][-1] < 5
    assert state["sizes"]["table"] == os.path.getsize("run.csv") and state["sizes"]["trajectory"] == os.path.getsize(
        "run.dcd"
    )
    assert np.all(np.isfinite(mh.Mesh.read("run.ply").vertices))
