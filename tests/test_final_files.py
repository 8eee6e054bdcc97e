"""Nobody is told that a run is complete unless its meshes, tables and pictures are those of its last step."""

import builtins
import errno
import io
import json
import os
import shutil
import zipfile
from pathlib import Path

import pytest

import openmmhelfrich as mh
from openmmhelfrich.pictures.plots import saveFigure
from openmmhelfrich.runs import outputs, studies
from openmmhelfrich.runs.checkpoint import addRecord, loadRunState
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.outputs import Outputs
from openmmhelfrich.runs.studies import resume, run

PATH = {"kind": "continue", "windows": 2, "reduced_volume": 0.9, "equilibration": 2, "steps": 4}
DRAWN = (".ply", "_observables.png", "_shape.png", "_path.csv", "_path.png")
WHOLE = (*DRAWN, ".psf", ".resolved.toml")


class Killed(Exception):
    pass


def configure(prefix, stages, **sections):
    return parseConfig(
        {
            "mesh": {"icosphere": 1},
            "platform": {"threads": 1},
            "sampling": {"seed": 4, "steps_per_trajectory": 5},
            "stages": stages,
            **sections,
            "output": {
                "prefix": str(prefix),
                "trajectory_interval": 4,
                "observables_interval": 2,
                **sections.get("output", {}),
            },
        }
    )


def contentsOf(prefix):
    """Return everything that equal runs have in common."""
    final = mh.Mesh.read(f"{prefix}.ply")
    endings = (".csv", ".dcd", ".psf", *(ending for ending in DRAWN[1:] if Path(f"{prefix}{ending}").exists()))
    with zipfile.ZipFile(f"{prefix}.checkpoint") as checkpoint:
        state = checkpoint.read("state.xml")
    return {
        **{ending: Path(f"{prefix}{ending}").read_bytes() for ending in endings},
        "vertices": final.vertices.tobytes(),
        "triangles": final.triangles.tobytes(),
        "state": state,
    }


def assertSame(prefix, expected):
    found = contentsOf(prefix)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == value, name


def assertRedrawn(prefix, expected):
    """Go on with a run that has only its drawings left to do: nothing is simulated, and then it is complete."""
    assert resume(prefix).newSteps == 0
    assertSame(prefix, expected)
    with pytest.raises(ValueError, match="is complete"):
        resume(prefix)


def killDrawing(monkeypatch, after, work):
    """Kill a run after so many of its final files: all simulated, some drawn."""
    with monkeypatch.context() as patch:
        count = 0

        def dieAfter(draw):
            def wrapped(*arguments):
                nonlocal count
                count += 1
                if count > after:
                    raise Killed
                draw(*arguments)

            return wrapped

        for name in ("drawMesh", "plotObservables", "plotPath"):
            patch.setattr(studies, name, dieAfter(getattr(studies, name)))
        with pytest.raises(Killed):
            work()


def stopAt(step):
    def stop(study):
        if study.simulation.currentStep == step:
            raise KeyboardInterrupt

    return stop


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """A run of 24 steps, and its contents."""
    prefix = tmp_path_factory.mktemp("complete") / "a"
    run(configure(prefix, [{"kind": "sample", "steps": 6}, PATH]))
    return prefix, contentsOf(prefix)


@pytest.fixture
def copied(complete, tmp_path):
    """A copy of it: results may be moved."""
    for file in complete[0].parent.iterdir():
        shutil.copy(file, tmp_path)
    with pytest.raises(ValueError, match="complete, at step 24"):
        resume(tmp_path / "a")
    return tmp_path / "a", complete[1]


def testRecord(complete):
    """What is in the documentation: the checkpoint says of which run and step the files are."""
    prefix, _ = complete
    with zipfile.ZipFile(f"{prefix}.checkpoint") as checkpoint:
        record, state = json.loads(checkpoint.read("record.json")), json.loads(checkpoint.read("run.json"))
    assert record["run"] == state["run"] and len(record["run"]) == 32 and record["step"] == state["step"] == 24
    sizes = {f"a{ending}": Path(f"{prefix}{ending}").stat().st_size for ending in (*WHOLE, ".csv", ".dcd", ".vtkhdf")}
    paths = vars(Outputs.of(configure(prefix, [PATH])))
    assert {paths[name].name: file["size"] for name, file in record["files"].items()} == sizes
    assert sorted(path.name for path in prefix.parent.iterdir()) == sorted([*sizes, "a.checkpoint"])


@pytest.mark.parametrize("after", [0, 1, 2])
def testKilledWhileItDrew(complete, tmp_path, monkeypatch, after):
    config = configure(tmp_path / "a", [{"kind": "sample", "steps": 6}, PATH])
    killDrawing(monkeypatch, after, lambda: run(config))
    assertRedrawn(tmp_path / "a", complete[1])


def testStoppedThenKilledWhileItDrew(complete, tmp_path, monkeypatch):
    """All files exist, of an earlier step."""
    prefix = tmp_path / "a"
    assert run(configure(prefix, [{"kind": "sample", "steps": 6}, PATH]), stopAt(15)).interrupted
    assert all(Path(f"{prefix}{ending}").exists() for ending in WHOLE)
    killDrawing(monkeypatch, 0, lambda: resume(prefix))
    assertRedrawn(prefix, complete[1])


def testMoreStepsThenKilledWhileItDrew(tmp_path, monkeypatch):
    run(configure(tmp_path / "a", [{"kind": "sample", "steps": 20}]))
    expected = contentsOf(tmp_path / "a")
    run(configure(tmp_path / "b", [{"kind": "sample", "steps": 10}]))
    before = loadRunState(tmp_path / "b.checkpoint").run
    killDrawing(monkeypatch, 0, lambda: resume(tmp_path / "b", steps=10))
    assertRedrawn(tmp_path / "b", expected)
    assert loadRunState(tmp_path / "b.checkpoint").run == before != loadRunState(tmp_path / "a.checkpoint").run


def testMoreStepsThenKilledBeforeACheckpoint(copied):
    """It goes back to the end of the steps before, and so do the files."""
    prefix, expected = copied

    def kill(study):
        if study.simulation.currentStep == 30:
            raise Killed

    with pytest.raises(Killed):
        resume(prefix, steps=10, progress=kill)
    assertRedrawn(prefix, expected)


def testOverwritten(copied, monkeypatch):
    """Nothing of the earlier run is taken for this one's, also what this one would not write."""
    prefix, expected = copied
    other = configure(
        prefix,
        [{"kind": "sample", "steps": 6}],
        sampling={"seed": 9, "steps_per_trajectory": 5},
        output={"mesh_format": "off", "mesh_trajectory": False, "overwrite": True},
    )
    killDrawing(monkeypatch, 0, lambda: run(other))
    left = {path.name for path in prefix.parent.iterdir()}
    assert left == {"a.checkpoint", "a.csv", "a.dcd", "a.off", "a.psf", "a.resolved.toml"}
    assert resume(prefix).newSteps == 0
    again = configure(prefix, [{"kind": "sample", "steps": 6}, PATH], output={"overwrite": True})
    run(again)
    assertSame(prefix, expected)
    assert not Path(f"{prefix}.off").exists()


def testMeshOfTheEarlierRunIsKept(tmp_path):
    """A run may begin from the mesh that the one before left, and be overwritten again."""
    run(configure(tmp_path / "a", [{"kind": "sample", "steps": 2}]))
    before = (tmp_path / "a.ply").read_bytes()
    for _ in range(2):
        output = {"mesh_format": "off", "overwrite": True}
        run(
            configure(
                tmp_path / "a", [{"kind": "sample", "steps": 2}], mesh={"file": str(tmp_path / "a.ply")}, output=output
            )
        )
        assert (tmp_path / "a.ply").read_bytes() == before


def testFailureBeforeTheFirstCheckpointLeavesTheEarlierRun(copied, monkeypatch):
    prefix, expected = copied

    def fail(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(studies, "saveCheckpoint", fail)
        with pytest.raises(OSError, match="No space left"):
            run(configure(prefix, [{"kind": "sample", "steps": 6}], output={"overwrite": True}))
    assertSame(prefix, expected)
    with pytest.raises(ValueError, match="is complete"):
        resume(prefix)


def testFailureBeforeTheFirstFrame(tmp_path, monkeypatch):
    """Files that were not there yet are not said to have been deleted: the run goes on from its first checkpoint."""

    def fail(*_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    config = configure(tmp_path / "a", [{"kind": "sample", "steps": 6}])
    with monkeypatch.context() as patch:
        patch.setattr(outputs, "TrajectoryReporter", fail)
        with pytest.raises(OSError, match="everything up to step 0 is safe: openmm-helfrich resume"):
            run(config)
    assert not (tmp_path / "a.dcd").exists()
    assert resume(tmp_path / "a").steps == 6 and mh.readMeshTrajectory(tmp_path / "a.vtkhdf")[-1].step == 4


def testAnErrorWhileTheRecordIsAdded(copied, monkeypatch):
    """The checkpoint is as it was: zipfile, if it cannot open a file, begins another."""
    file, original = Path(f"{copied[0]}.checkpoint"), io.open
    before = file.read_bytes()

    def fail(name, mode="r", *arguments, **options):
        if mode == "r+b":
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return original(name, mode, *arguments, **options)

    with monkeypatch.context() as patch, pytest.raises(OSError):
        for module in (io, builtins):
            patch.setattr(module, "open", fail)
        addRecord(file, {})
    assert file.read_bytes() == before


def testFilesThatAreNotTheRuns(copied):
    """Each that is missing, torn, changed or of another run is noticed by itself."""
    prefix, _ = copied
    outputs, record = Outputs.of(configure(prefix, [PATH])), loadRunState(f"{prefix}.checkpoint").record
    for ending in WHOLE:
        file = Path(f"{prefix}{ending}")
        content, middle = file.read_bytes(), file.stat().st_size // 2
        changed = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
        for damaged in (None, b"", content[:-1], changed, b"another run's"):
            file.unlink() if damaged is None else file.write_bytes(damaged)
            assert not outputs.match(record), (ending, damaged)
        file.write_bytes(content)
        assert outputs.match(record)


@pytest.mark.parametrize("isDeleted", [True, False])
def testFilesAreWrittenAgain(copied, isDeleted):
    prefix, expected = copied
    for file in (Path(f"{prefix}{ending}") for ending in WHOLE):
        file.unlink() if isDeleted else file.write_bytes(b"another run's")
    assertRedrawn(prefix, expected)


@pytest.mark.parametrize("ending", ["csv", "dcd", "vtkhdf"])
def testTablesAndTrajectories(copied, ending):
    """What they have too much is dropped; what they lack is told, and no drawing hides it."""
    prefix, expected = copied
    file = Path(f"{prefix}.{ending}")
    content = file.read_bytes()
    if ending != "vtkhdf":
        file.write_bytes(content + b"17,0.3")
        assertRedrawn(prefix, expected)
    file.write_bytes(content[: len(content) // 2])
    for _ in range(2):
        with pytest.raises(ValueError, match=f"a.{ending} "):
            resume(prefix)


def testRunOfVersion010(copied):
    """It has no record, nor a name: its files are drawn again, once."""
    prefix, expected = copied
    with zipfile.ZipFile(f"{prefix}.checkpoint") as archive:
        parts = {name: archive.read(name) for name in archive.namelist() if name != "record.json"}
    state = json.loads(parts["run.json"])
    del state["run"]
    parts["run.json"] = json.dumps(state).encode()
    with zipfile.ZipFile(f"{prefix}.checkpoint", "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    assertRedrawn(prefix, expected)


def testPictureThatFails(tmp_path):
    """The old one stays, and nothing else."""
    from matplotlib.figure import Figure

    class Broken(Figure):
        def savefig(self, file, **options):
            file.write(b"half of a pict")
            raise OSError(28, "No space left on device")

    saveFigure(Figure(), tmp_path / "a.png")
    before = (tmp_path / "a.png").read_bytes()
    with pytest.raises(OSError, match="No space"):
        saveFigure(Broken(), tmp_path / "a.png")
    saveFigure(Figure(), tmp_path / "withoutSuffix")
    assert (tmp_path / "a.png").read_bytes() == before == (tmp_path / "withoutSuffix").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "withoutSuffix"]
