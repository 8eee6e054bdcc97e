"""Sweeps give what plain runs of their points give, whatever happens to workers, and to the sweep itself."""

import asyncio
import contextlib
import csv
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import psutil
import pytest
from distributed import LocalCluster, Security
from distributed.comm import connect
from typer.testing import CliRunner

import openmmhelfrich as mh
from openmmhelfrich.cli import app
from openmmhelfrich.io.locks import locked
from openmmhelfrich.runs import studies, sweeps
from openmmhelfrich.runs.config import readConfig
from openmmhelfrich.runs.grids import readGrid

INTERVAL = 40
GRID = f"""
seeds = 2
[base]
mesh.icosphere = 2
sampling = {{seed = 5, steps_per_trajectory = 30, step_size = "auto", trajectory_jitter = 0.3, approach = "none"}}
output = {{trajectory_interval = 50, mesh_trajectory = false, checkpoint_interval = {INTERVAL}}}
[[base.stages]]
kind = "sample"
steps = 300
[[base.stages]]
name = "cool"
kind = "anneal"
steps = 150
end_temperature = 30
[grid]
membrane.reduced_volume = [0.8, 0.95]
"""


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    file = tmp_path_factory.mktemp("grid") / "grid.toml"
    file.write_text(GRID)
    return file


@pytest.fixture(scope="module")
def expected(grid, tmp_path_factory):
    """What plain runs of the points give, without a sweep."""
    folder = tmp_path_factory.mktemp("plain")
    for point in readGrid(grid):
        point.config.output.prefix = str(folder / point.name / "run")
        studies.run(point.config)
    return contentsOf(folder, grid)


@pytest.fixture(scope="module")
def cluster():
    """A cluster of one worker with two threads, each of which may run a point."""
    with LocalCluster(
        n_workers=1, threads_per_worker=2, dashboard_address="127.0.0.1:0", silence_logs="CRITICAL"
    ) as cluster:
        yield cluster


def contentsOf(folder, grid):
    """Return everything that equal results have in common, by point."""
    contents = {}
    for point in readGrid(grid):
        prefix = folder / point.name / "run"
        mesh = mh.Mesh.read(f"{prefix}.ply")
        with zipfile.ZipFile(f"{prefix}.checkpoint") as checkpoint:
            state = checkpoint.read("state.xml")
        contents[point.name] = [
            *(Path(f"{prefix}.{ending}").read_bytes() for ending in ("csv", "dcd", "psf")),
            mesh.vertices.tobytes(),
            mesh.triangles.tobytes(),
            state,
        ]
    return contents


def assertDone(folder, grid, expected):
    assert contentsOf(folder, grid) == expected
    rows = summary(folder)
    assert [row["folder"] for row in rows] == list(expected) and all(row["status"] == "done" for row in rows)


def summary(folder):
    with open(folder / "summary.csv", newline="") as file:
        return list(csv.DictReader(file))


def command(grid, folder, *options):
    return subprocess.Popen(
        [sys.executable, "-m", "openmmhelfrich.cli", "sweep", str(grid), "--output", str(folder), "--quiet", *options],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def checkpointSteps(folder):
    """Return the step of the last checkpoint of each point that has one."""
    steps = {}
    for file in folder.glob("*/run.checkpoint"):
        with zipfile.ZipFile(file) as checkpoint:
            steps[file.parent.name] = json.loads(checkpoint.read("run.json"))["step"]
    return steps


def waitUntil(condition, process):
    while not condition():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)


def isUnderWay(folder, least):
    """Return a condition: some point has made a number of steps and is not finished."""
    return lambda: any(
        step >= least and not (folder / name / "result.json").exists() for name, step in checkpointSteps(folder).items()
    )


def workersOf(process):
    return [child for child in psutil.Process(process.pid).children() if isWorker(child)]


def isWorker(process):
    try:
        return any("spawn_main" in part for part in process.cmdline())
    except psutil.NoSuchProcess:  # it has just ended
        return False


def testKilledWorkersAndKilledSweep(grid, expected, tmp_path):
    """SIGKILL, twice to a worker and then to the sweep: each loses one checkpoint interval at most."""
    process, moments = command(grid, tmp_path, "--workers", "2"), random.Random(2)
    for least in (1, 2 * INTERVAL):
        waitUntil(isUnderWay(tmp_path, least), process)
        waitUntil(lambda: len(workersOf(process)) == 2, process)
        before = checkpointSteps(tmp_path)
        moments.choice(workersOf(process)).kill()
    waitUntil(lambda: any(step > before.get(name, 0) for name, step in checkpointSteps(tmp_path).items()), process)
    workers = workersOf(process)
    process.kill()
    process.wait()
    psutil.wait_procs(workers, timeout=30)
    assert not any(isWorker(worker) for worker in workers)  # they end with the sweep
    for name, step in checkpointSteps(tmp_path).items():
        assert step >= before.get(name, 0)  # nothing begins anew
        assert mh.readObservables(tmp_path / name / "run.csv")["step"][-1] <= step + INTERVAL
    finished = {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/result.json")}
    process = command(grid, tmp_path, "--workers", "2")
    assert process.wait() == 0, process.stderr.read()
    assertDone(tmp_path, grid, expected)
    assert all(file.stat().st_mtime_ns == moment for file, moment in finished.items())


def listeners(process):
    """Return the addresses at which a process and its children wait for connections."""
    everyone = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
    return {c.laddr for p in everyone for c in p.net_connections("inet") if c.status == psutil.CONN_LISTEN}


def isOpenTo(address, security):
    """Return whether Dask, with a Security, can talk to who listens at an address."""

    async def talk():
        comm = await connect(address, 3, **security.get_connection_args("client"))
        comm.abort()

    try:
        asyncio.run(talk())
    except OSError:
        return False
    return True


def answersHTTP(address):
    with socket.create_connection(address, timeout=10) as client:
        client.sendall(b"GET / HTTP/1.0\r\n\r\n")
        try:
            return client.recv(4) == b"HTTP"
        except ConnectionError:
            return False


def testNobodyElseReachesTheProcessesOfASweep(grid, tmp_path):
    """A scheduler, a worker and its nanny listen, on this machine alone, and only to those of the same certificate."""
    process = command(grid, tmp_path, "--workers", "1")
    try:
        waitUntil(isUnderWay(tmp_path, 1), process)
        waitUntil(lambda: len(listeners(process)) == 3, process)
        for address in listeners(process):
            assert address.ip == "127.0.0.1" and not answersHTTP(address)
            assert not isOpenTo(f"tcp://127.0.0.1:{address.port}", Security())
            assert not isOpenTo(f"tls://127.0.0.1:{address.port}", Security.temporary())
    finally:
        process.terminate()
    assert process.wait() == 128 + signal.SIGTERM


def testWhoIsOpenIsFoundOut(cluster):
    """What tells that a sweep's processes are not open does find one that is."""
    assert isOpenTo(cluster.scheduler_address, Security())


def testStoppedSweepGoesOnElsewhere(grid, expected, tmp_path, cluster):
    """Ctrl-C reaches every process of a terminal's group; each point that runs leaves a checkpoint of its last step."""
    process = command(grid, tmp_path, "--workers", "1")
    waitUntil(isUnderWay(tmp_path, INTERVAL), process)
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait() == 128 + signal.SIGINT, process.stderr.read()
    # On a busy machine the first point may be done before the signal comes.
    unfinished = {row["folder"] for row in summary(tmp_path) if row["status"] == "unfinished"}
    assert unfinished
    for name, step in checkpointSteps(tmp_path).items():
        assert 0 <= step - mh.readObservables(tmp_path / name / "run.csv")["step"][-1] < 10
        assert name in unfinished or (tmp_path / name / "result.json").exists()
    result = CliRunner().invoke(
        app, ["sweep", str(grid), "--output", str(tmp_path), "--scheduler", cluster.scheduler_address]
    )
    assert result.exit_code == 0 and "4 points: 4 done" in result.output, result.output
    assertDone(tmp_path, grid, expected)


def testPointThatAnotherProcessRuns(grid, expected, tmp_path, cluster):
    """It is left alone, and comes last; the others do not wait for it."""
    name, order, released, lock = next(iter(expected)), [], [], contextlib.ExitStack()
    (tmp_path / name).mkdir()
    lock.enter_context(locked(tmp_path / name / "run"))

    def progress(states):
        order.extend(state.point.name for state in states if state.status == "done" and state.point.name not in order)
        if len(order) == 3 and not released:
            released.append((tmp_path / name / "run.checkpoint").exists())
            lock.close()

    sweeps.sweep(grid, tmp_path, cluster.scheduler_address, progress=progress)
    assert len(order) == 4 and order[-1] == name and released == [False]
    assertDone(tmp_path, grid, expected)


def testPointsWhoseFilesAreOfAnotherStep(grid, expected, tmp_path, cluster, monkeypatch):
    """None is done before its mesh is that of its last step, whatever files and checkpoints are there."""

    def stop(study):
        if study.simulation.currentStep == 120:
            raise KeyboardInterrupt

    def fail(*_):
        raise OSError("killed")

    sweeps.sweep(grid, tmp_path, cluster.scheduler_address)
    rows, points = summary(tmp_path), readGrid(grid)
    torn, stopped, old, light = (tmp_path / point.name for point in points)
    with open(torn / "run.ply", "r+b") as file:
        file.truncate(1000)
    points[1].config.output.prefix, points[1].config.output.overwrite = str(stopped / "run"), True
    studies.run(points[1].config, stop)
    with monkeypatch.context() as patch:
        patch.setattr(studies, "drawMesh", fail)
        patch.setattr(mh.Mesh, "write", fail)
        with pytest.raises(OSError, match="killed"):
            studies.resume(stopped / "run")
    (stopped / "result.json").unlink()
    (old / "result.json").write_text(json.dumps({"steps": 450, "shapeClass": "prolate"}))  # as of version 0.1.0
    (light / "run.checkpoint").unlink()  # to save room
    assert checkpointSteps(tmp_path) == {point.name: 450 for point in points[:3]}
    untouched = {file: file.stat().st_mtime_ns for file in light.iterdir()}
    again = []
    sweeps.sweep(grid, tmp_path, cluster.scheduler_address, progress=lambda states: again.append(states))
    assert summary(tmp_path) == rows and again
    assert {file: file.stat().st_mtime_ns for file in light.iterdir()} == untouched
    shutil.copy(torn / "run.checkpoint", light / "run.checkpoint")  # for its form alone
    found = contentsOf(tmp_path, grid)
    assert all(found[point.name] == expected[point.name] for point in points[:3])
    monkeypatch.setattr(sweeps, "_client", fail)
    assert sweeps.sweep(grid, tmp_path).count("done") == 4  # nothing is left to do


def testThreadsOfEachPoint(grid, expected, tmp_path, cluster):
    """They are those of the option, also of a point that goes on, and change nothing."""

    def stop(study):
        if study.simulation.currentStep == 120:
            raise KeyboardInterrupt

    options = ["--output", str(tmp_path), "--scheduler", cluster.scheduler_address, "--threads"]
    points = readGrid(grid)
    points[0].config.output.prefix = str(tmp_path / points[0].name / "run")
    studies.run(points[0].config, stop)
    result = CliRunner().invoke(app, ["sweep", str(grid), *options, "2"])
    assert result.exit_code == 0, result.output
    assertDone(tmp_path, grid, expected)
    for point in points:
        assert readConfig(tmp_path / point.name / "run.resolved.toml").platform.threads == 2


@pytest.mark.parametrize(
    "base, threads, message",
    [
        ("", 0, "sweep: threads is 0; it must be a whole number, 1 or more"),
        ("", 10**6, "the number of threads is 1000000; it must be at most"),
        ("platform.threads = 1000000", None, "the number of threads is 1000000; it must be at most"),
        ('platform.name = "Reference"', 2, r"\[platform\] threads is 2; only the CPU platform has threads, not Refer"),
        ('platform.name = "GPU"', None, r"\[platform\] name is 'GPU'; it must be one of"),
    ],
)
def testThreadsAndPlatformsThatAreNotThere(tmp_path, base, threads, message):
    """They are told before anything is written."""
    grid = tmp_path / "grid.toml"
    grid.write_text(f"[base]\nmesh.icosphere = 1\n{base}\n[grid]\nmembrane.reduced_volume = [0.9, 0.8]\n")
    with pytest.raises(ValueError, match=message):
        sweeps.sweep(grid, tmp_path / "results", threads=threads)
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("library", ["distributed", "dask", "cryptography"])
def testASweepWithoutItsExtra(tmp_path, monkeypatch, library):
    """It says how to get what is missing before it reads or makes anything."""
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ValueError, match=rf"a sweep needs {library}, .* pip install 'openmm-helfrich\[sweep\]' brings"):
        mh.sweep(tmp_path / "grid.toml", tmp_path / "results")
    assert list(tmp_path.iterdir()) == []


def testPointThatFails(tmp_path, cluster):
    """Its reason is told; the others are done, and it is tried again by the next sweep."""
    grid = tmp_path / "grid.toml"
    grid.write_text(
        "[base]\nmesh.icosphere = 1\nsampling.steps = 10\n"
        "tether = {modulus = 50.0, length_scale = 1e-5, min_length = 0.2, exponent = 60}\n"
        "[grid]\ntether.max_length = [10.0, 0.3]\n"
    )
    folder = tmp_path / "results"
    result = CliRunner().invoke(
        app, ["sweep", str(grid), "--output", str(folder), "--scheduler", cluster.scheduler_address]
    )
    assert result.exit_code == 1 and "2 points: 1 done, 1 failed" in result.output
    good, bad = summary(folder)
    assert good["status"] == "done" and bad["status"] == "failed"
    assert "finite" in bad["reason"] and f"point {bad['folder']} failed: {bad['reason']}" in " ".join(
        result.output.split()
    )


def testSummary(grid, expected, tmp_path, cluster):
    result = sweeps.sweep(grid, tmp_path, cluster.scheduler_address)
    row, point = summary(tmp_path)[2], result.points[2].point
    table, mesh = mh.readObservables(tmp_path / point.name / "run.csv"), mh.Mesh.read(tmp_path / point.name / "run.ply")
    late = {name: values[table["stage"] == 2][(table["stage"] == 2).sum() // 2 :] for name, values in table.items()}
    assert (row["reduced_volume"], row["seed"], row["steps"], row["shapeClass"]) == (
        "0.95",
        "1",
        "450",
        mh.classifyShape(mesh),
    )
    assert float(row["E_bending/8 pi kappa"]) == pytest.approx(late["E_bending"].mean() / (8 * np.pi * 20), rel=1e-12)
    assert float(row["reducedVolume"]) == pytest.approx(late["reducedVolume"].mean(), rel=1e-12)
    assert float(row["reducedAreaDifference"]) == pytest.approx(mh.describeShape(mesh).reducedAreaDifference, rel=0.02)
    assert float(row["acceptance"]) == table["acceptance"][-1]
    assert float(row["energy (kT)"]) == pytest.approx(
        sum(float(value) for name, value in row.items() if name.startswith("E_") and name.endswith("(kT)")), rel=1e-9
    )


def testGridThatGrows(tmp_path):
    """Points keep names, and with them seeds and folders, when an axis has more values."""
    few, many = tmp_path / "few.toml", tmp_path / "many.toml"
    few.write_text(GRID)
    many.write_text(
        GRID.replace("[0.8, 0.95]", "{start = 0.95, stop = 0.75, step = -0.05}").replace("seeds = 2", "seeds = 3")
    )
    seeds = [{point.name: point.config.sampling.seed for point in readGrid(file)} for file in (few, many)]
    assert len(seeds[0]) == 4 and len(seeds[1]) == 15 and seeds[0].items() <= seeds[1].items()
    assert len(set(seeds[1].values())) == 15


def testAxes(tmp_path):
    mh.Mesh.icosphere(1).write(tmp_path / "a.ply")
    (tmp_path / "base.toml").write_text(
        '[mesh]\nfile = "a.ply"\n[[stages]]\nkind = "sample"\nsteps = 5\n[[stages]]\nname = "cold"\nkind = "sample"\n'
    )
    (tmp_path / "grid.toml").write_text("""
base = "base.toml"
[grid]
stages.1.temperature = [300, "37 C"]
stages.cold.temperature = [30.0]
sampling.seed = [7, 8]
[variants.soft]
membrane.bending_modulus = 5
[variants.hard]
membrane = {bending_modulus = 50, reduced_volume = 0.9}
""")
    points = readGrid(tmp_path / "grid.toml")
    assert [point.name for point in points[:2]] == [
        f"variant=soft,stages.1.temperature=300,stages.cold.temperature=30,seed={seed}" for seed in (7, 8)
    ]
    assert len({point.name for point in points}) == 8
    config = points[-1].config
    assert (
        [stage.temperature for stage in config.stages] == [310.15, 30]
        and config.sampling.seed == 8
        and config.stages[1].steps == 1000
    )
    assert (config.membrane.bending_modulus, config.membrane.reduced_volume) == (50, 0.9) and config.mesh.file == str(
        tmp_path / "a.ply"
    )
    assert points[-1].parameters["variant"] == "hard" and points[-1].parameters["seed"] == 8
    assert not set(points[-1].name) & set("/ '")


def testExamples(examples):
    points = readGrid(examples / "volume_diagram.toml")
    assert len(points) == 4 * 34 and points[-1].name == "variant=stomatocyte,reduced_volume=1,seed=1"
    config = points[-1].config
    assert config.membrane.area_difference_modulus > 0
    assert [(s.name, s.reduced_volume, s.area_difference_modulus) for s in config.stages[1:3]] == [
        ("let go", None, 0),
        ("arrive", 1, None),
    ]
    for config in (point.config for point in points):  # walls that are pressed together stay apart, and triangles whole
        assert config.repulsion.onset >= 0.7 * config.tether.max_length
        assert 2 * config.tether.min_length >= 1.2 * config.tether.max_length
    points = readGrid(examples / "area_difference_diagram.toml")
    assert len(points) == 27 and {point.parameters["target_area_difference"] for point in points} == {
        1.0,
        1.1,
        1.2,
        1.3,
        1.4,
        1.5,
        1.6,
        1.7,
        1.8,
    }
    sphere = mh.Mesh.icosphere(3)
    assert 2 * points[0].config.membrane.leaflet_separation * sphere.vertexMeanCurvatures.sum() == pytest.approx(
        mh.analysis.reducedAreaDifference(sphere), rel=1e-4
    )


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("seeds = 2", "sedes = 2", "there is no key 'sedes'; did you mean 'seeds'"),
        ("seeds = 2", "seeds = 0", "seeds is 0; it must be greater than or equal to 1"),
        (
            "seeds = 2",
            "[tether]\nexponent = 2",
            r"there is no key 'tether'; a configuration goes into \[base\]: \[base.tether\]",
        ),
        (
            "membrane.reduced_volume",
            "membrane.reduced_volum",
            r"\[membrane\] has no key 'reduced_volum'; did you mean 'reduced_volume'\? \(every point\)",
        ),
        (
            "0.95]",
            "1.95]",
            r"\[membrane\] reduced_volume is 1.95; it must be less than or equal to 1 \(point "
            r"reduced_volume=1.95,seed=1 and 1 more\)",
        ),
        (
            "[0.8, 0.95]",
            "0.8",
            "membrane.reduced_volume is 0.8; it must be a list of values, or a table of start, stop and step",
        ),
        ("[0.8, 0.95]", "[]", r"membrane.reduced_volume is \[\]; it must be a list"),
        ("0.95]", "0.80]", "membrane.reduced_volume has the value 0.8 twice"),
        (
            "[0.8, 0.95]",
            "{start = 0.8, stop = 0.9, stp = 0.1}",
            "membrane.reduced_volume has no (key 'stp'; did you mean 'step'|step)",
        ),
        (
            "[0.8, 0.95]",
            "{start = 0.8, stop = 0.9, step = -0.1}",
            "membrane.reduced_volume leads from 0.8 to 0.9 by steps of -0.1, which never arrive",
        ),
        ("[0.8, 0.95]", "{start = 0.8, stop = 0.9, step = 0}", "by steps of 0, which never arrive"),
        ("[0.8, 0.95]", "{start = 0, stop = 1, step = 1e-9}", "has more than 100000 values"),
        (
            "membrane.reduced_volume",
            "stages.heat.temperature",
            r"'stages.heat.temperature' does not name one stage; the stages are 1 \(sample\), 2 \(cool\)",
        ),
        ("membrane.reduced_volume", "volume", "'volume' names no section"),
        ("membrane.reduced_volume", "stages", "'stages' names no section"),
        ("membrane.reduced_volume", "sampling.seed", "seeds and the axis sampling.seed are both given"),
        ("membrane.reduced_volume", "output.prefix", "output.prefix is an axis"),
        ("mesh.icosphere = 2", 'mesh.file = "nothing.stl"', r"nothing.stl.*\(every point\)"),
        (
            "mesh.icosphere = 2",
            "mesh.icosphere = 2\ntether.min_length = 1",
            r"\[tether\] min_length is 1 and max_length",
        ),
    ],
)
def testBadGrid(tmp_path, old, new, message):
    (tmp_path / "grid.toml").write_text(GRID.replace(old, new, 1))
    with pytest.raises((ValueError, OSError), match=message):
        sweeps.sweep(tmp_path / "grid.toml", tmp_path / "results")
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    "text, message",
    [
        ('base = "nothing.toml"', "there is no configuration file .*nothing.toml"),
        ("base = 3", "base is 3; it must be the name of a configuration file, or a table"),
        ("seeds = 2", "base is missing"),
        ("base = ", "is not TOML"),
        ("[base]\nmesh.icosphere = 1\n[grid]\nstages = 3", "stages is 3; it must be a list"),
    ],
)
def testBadFile(tmp_path, text, message):
    (tmp_path / "grid.toml").write_text(text)
    with pytest.raises((ValueError, OSError), match=message):
        readGrid(tmp_path / "grid.toml")


def testOtherSettingsThanBefore(grid, tmp_path):
    """A sweep that has begun is not mixed with another."""
    point = readGrid(grid)[0]
    sweeps._place(point, tmp_path / "results")
    (tmp_path / "results" / point.name).mkdir(parents=True)
    sweeps._writeSettings(point.config)
    sweeps._place(readGrid(grid)[0], tmp_path / "results")
    other = tmp_path / "grid.toml"
    other.write_text(GRID.replace("end_temperature = 30", "end_temperature = 3"))
    with pytest.raises(
        ValueError,
        match=r"point reduced_volume=0.8,seed=1 was begun with other settings: stage 2 end_temperature is 3.0, and was "
        r"30.0; choose another",
    ):
        sweeps.sweep(other, tmp_path / "results")


def testSchedulerThatIsNotThere(grid, tmp_path):
    result = CliRunner().invoke(
        app, ["sweep", str(grid), "--output", str(tmp_path / "a"), "--scheduler", "tcp://127.0.0.1:1", "--workers", "2"]
    )
    assert result.exit_code == 1 and "a scheduler has workers of its own" in result.output
    result = CliRunner().invoke(app, ["sweep", str(grid), "--output", str(tmp_path / "a"), "--scheduler", "nowhere"])
    assert result.exit_code == 1 and "no Dask scheduler answers at nowhere" in result.output
