"""What must end in a sentence or go on as if nothing had been: numbers at the extremes, stages that cannot be, too
little of memory, disk and threads, damaged files, and the screen, locale and settings of the user's system.
"""

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
from typer.testing import CliRunner

import openmmhelfrich as mh
from openmmhelfrich.cli import app
from openmmhelfrich.messages import MOST_CHARACTERS
from openmmhelfrich.runs import memory, room
from openmmhelfrich.runs.checkpoint import RECORD
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.stages import checkStages

COMMAND = [sys.executable, "-m", "openmmhelfrich.cli"]


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def configOf(**sections):
    return {"mesh": {"icosphere": 1}, "sampling": {"steps": 4, "seed": 1}, "output": {"prefix": "run"}, **sections}


def assertSaid(result, *words):
    """A command ended with a readable line, or a few."""
    assert result.exit_code == 1 and isinstance(result.exception, SystemExit), result.output
    assert all(line.startswith("openmm-helfrich: ") for line in result.output.splitlines())
    for word in words:
        assert word in result.output


def start(*arguments, **options):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.Popen([*COMMAND, *map(str, arguments)], text=True, **pipes)


@pytest.fixture
def folder(inFolder):
    """A working folder with the configuration of a short run."""
    write("run.toml", configOf())
    return inFolder


def write(name, config):
    from openmmhelfrich.runs.configfile import configText

    Path(name).write_text(configText(config), encoding="utf-8")


# --- numbers at the extremes

EXTREMES = [
    ("platform", "threads", 100000, "the number of threads is 100000; it must be at most"),
    ("sampling", "step_size", 1e150, "[sampling] step_size is 1e+150; it must be"),
    ("sampling", "step_size", 1e20, "[sampling] step_size is 1e+20; it must be within a factor"),
    ("sampling", "mass", 1e300, "[sampling] mass is 1e+300; it must be"),
    ("sampling", "temperature", 1e-300, "[sampling] temperature is 1e-300; it must be"),
    ("sampling", "temperature", 1e300, "[sampling] temperature is 1e+300; it must be"),
    ("sampling", "steps", 10**23, "[sampling] steps is 100000000000000000000000; it must be at most"),
    ("sampling", "flip_fraction", 1e12, "[sampling] flip_fraction is 1e+12; with the mesh's 120 edges"),
    ("sampling", "steps_per_trajectory", 10**10, "[sampling] steps_per_trajectory is 10000000000; it must be"),
    ("sampling", "shear_wave_amplitude", 1e200, "[sampling] shear_wave_amplitude is 1e+200; it must be"),
    ("membrane", "target_volume", 1e-200, "[membrane] target_volume is 1e-200; it must be"),
    ("membrane", "target_volume", 1e-20, "[membrane] target_volume is 1e-20; it must be within a factor"),
    ("membrane", "target_area", 1e20, "[membrane] target_area is 1e+20; it must be within a factor"),
    ("membrane", "bending_modulus", 1e305, "[membrane] bending_modulus is 1e+305; it must be"),
    ("membrane", "leaflet_separation", 1e300, "[membrane] leaflet_separation is 1e+300; it must be"),
    ("tether", "min_length", 1e-20, "[tether] min_length is 1e-20; it must be within a factor"),
    ("tether", "length_scale", 1e-100, "[tether] length_scale is 1e-100; it must be"),
    ("repulsion", "onset", 1e29, "[repulsion] onset is 1e+29; it must be within a factor"),
    ("output", "trajectory_interval", 10**24, "[output] trajectory_interval is 1000000000000000000000000; it must be"),
    ("output", "checkpoint_seconds", 1e300, "[output] checkpoint_seconds is 1e+300; it must be"),
]


@pytest.mark.parametrize("section, key, value, words", EXTREMES)
def test_extreme_numbers(folder, section, key, value, words):
    config = configOf()
    config.setdefault(section, {})[key] = value
    with pytest.raises((ValueError, mm.OpenMMException), match=re.escape(words)):
        mh.run(config)
    assert os.listdir() == ["run.toml"]


def test_numbers_that_overflow_together(folder):
    with pytest.raises(ValueError, match=r"overflow.*\[tether\] length_scale = 1e-06"):
        mh.run(configOf(tether={"length_scale": 1e-6, "exponent": 100}))


@pytest.mark.parametrize("mass, temperature", [(1e30, 300.0), (1e-30, 300.0), (1.0, 1e-30), (1.0, 1e30)])
def test_mass_and_temperature_only_set_scales(folder, mass, temperature):
    config = configOf()
    config["sampling"] |= {"mass": mass, "temperature": temperature, "steps": 20}
    assert mh.run(config).acceptance > 0.5


def test_messages_name_the_file_and_cut_long_values(folder):
    for edit in (
        {"mesh": {"icosphere": 1, "length_unit": "x" * 10**6, "scale": "1 " + "y" * 10**6}},
        {"z" * 10**6: {}},
        {"mesh": {"icosphere": 1, "w" * 10**6: 1}},
        {"stages": [{"kind": "v" * 10**6}]},
        {"membrane": {"bending_modulus": "1 " + "u" * 10**6}},
        {"sampling": list(range(10**5))},
    ):
        write("run.toml", {**configOf(), **edit})
        result = invoke("run", "run.toml")
        assertSaid(result, "run.toml")
        assert max(map(len, result.output.splitlines())) < 5 * MOST_CHARACTERS


# --- every stage is checked before the first one begins

SAMPLE = {"kind": "sample", "steps": 4}
WRONG = [
    (
        {"kind": "anneal", "steps": 4, "end_temperature": 400.0},
        {},
        "stage 3 (anneal) end_temperature is 400 K; it must be at most the temperature of [sampling], 300 K",
    ),
    ({"kind": "sample", "steps": 4, "target_volume": 1e-20}, {}, "the target volume is 1e-20; it must be within"),
    ({"kind": "continue", "target_area_difference": 3.0}, {}, "target for the area difference, whose modulus is 0"),
    (
        {"kind": "continue", "target_volume": 3.0, "windows": 2, "path": {"target_volume": [0.0, 9.0, 1.0]}},
        {},
        "the path leads to a target volume",
    ),
    ({"kind": "sample", "steps": 4, "step_size": 1e20}, {}, "step_size is 1e+20; it must be within"),
    ({"kind": "sample", "steps": 4, "step_size": "auto"}, {"flip_probability": 1.0}, "they must leave trajectories"),
]


def stagesOf(wrong, sampling):
    return configOf(sampling={"seed": 1, **sampling}, stages=[SAMPLE, SAMPLE, wrong])


@pytest.mark.parametrize("wrong, sampling, words", WRONG)
def test_a_wrong_third_stage(folder, wrong, sampling, words):
    config = stagesOf(wrong, sampling)
    with pytest.raises(ValueError, match=re.escape(words)) as error:
        mh.run(config)
    assert f"stage 3 ({wrong['kind']})" in str(error.value) and os.listdir() == ["run.toml"]
    write("base.toml", config)
    Path("grid.toml").write_text('base = "base.toml"\nseeds = 2\n')
    assertSaid(invoke("sweep", "grid.toml"), words, "every point")
    assert not os.path.exists("grid")


def test_a_stage_of_a_resumed_run(folder):
    """What a run of an earlier version took, and cannot be, is told before the run goes on."""
    mh.run(configOf(stages=[SAMPLE, SAMPLE], sampling={"seed": 1}))
    edit("run.checkpoint", lambda run: run["config"]["stages"].append({**SAMPLE, "target_volume": 1e-20}))
    before = Path("run.csv").read_bytes()
    assertSaid(invoke("resume", "run"), "stage 3 (sample)", "the target volume is 1e-20")
    assert Path("run.csv").read_bytes() == before


def test_targets_are_followed_from_stage_to_stage():
    """A reduced volume is that of the area of the stages before, and a way there and back ends where it began."""
    scene = Scene.of(
        parseConfig(
            configOf(
                sampling={"seed": 1, "approach": "none"},
                stages=[
                    {**SAMPLE, "target_area": 10.0},
                    {**SAMPLE, "reduced_volume": 0.5},
                    {"kind": "continue", "reduced_volume": 0.8, "there_and_back": True},
                ],
            )
        )
    )
    targets = checkStages(scene)
    assert targets[0] == scene.targets and targets[1] == scene.targets | {"area": 10.0}
    assert targets[2]["volume"] == pytest.approx(0.5 * 10**1.5 / (6 * np.sqrt(np.pi)))
    assert targets[3] == targets[2]
    assert checkStages(scene, 2, targets[2]) == targets[2:]


# --- memory, disk, threads


def test_room_on_the_disk(folder, monkeypatch):
    usage = shutil.disk_usage(folder)
    config = configOf(output={"prefix": "run", "trajectory_interval": 1})
    config["sampling"]["steps"] = 10**6
    size = room.diskSize(Scene.of(parseConfig(config)).config, 42)
    assert size > 10**6 * 12 * 42
    monkeypatch.setattr(room.shutil, "disk_usage", lambda _: usage._replace(free=int(size) - 1))
    with pytest.raises(ValueError, match=r"results take at least .* GB, and .* GB are free in"):
        mh.run(config)
    write("base.toml", config)
    Path("grid.toml").write_text('base = "base.toml"\nseeds = 2\n')
    assertSaid(invoke("sweep", "grid.toml"), "results take at least")
    assert sorted(os.listdir()) == ["base.toml", "grid.toml", "run.toml"]


def test_the_estimate_is_not_more_than_a_run_takes(folder):
    config = configOf(output={"prefix": "run", "trajectory_interval": 1, "observables_interval": 1})
    config["mesh"], config["sampling"]["steps"] = {"icosphere": 3}, 30
    summary = mh.run(config)
    written = sum(path.stat().st_size for path in summary.outputs.paths())
    twins = summary.outputs.meshTrajectory.stat().st_size + summary.outputs.checkpoint.stat().st_size
    assert 0.6 * (written + twins) < room.diskSize(summary.config, 642) < 1.1 * (written + twins)


def test_memory(folder, monkeypatch):
    monkeypatch.setattr(memory, "_freeMemory", lambda: 1e6)
    with pytest.raises(ValueError, match=r"a run of 42 vertices takes about .* of memory, and 1.0 MB are free"):
        mh.run(configOf())
    assert os.listdir() == ["run.toml"]


def test_little_memory_is_a_sentence(folder):
    for megabytes in (200, 720):

        def limit(size=megabytes << 20):
            resource.setrlimit(resource.RLIMIT_AS, (size, size))

        write("run.toml", configOf(mesh={"icosphere": 7, "scale": 10.0}))
        process = start("run", "run.toml", preexec_fn=limit)
        _, errors = process.communicate(timeout=600)
        assert process.returncode == 1 and "memory" in errors and "Traceback" not in errors


def test_threads_that_the_system_does_not_start(folder, monkeypatch):
    def refuse(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("threading.Thread.start", refuse)
    with pytest.raises(ValueError, match=r"number of threads is 2, and the system lets this program start 0"):
        mh.run(configOf(platform={"threads": 2}))


# --- damaged files


def edit(file, change, **parts):
    """Change the state of the run that a checkpoint holds, and other parts of it."""
    with zipfile.ZipFile(file) as archive:
        texts = {name: archive.read(name) for name in archive.namelist()}
    run = json.loads(texts["run.json"])
    change(run)
    texts |= {"run.json": json.dumps(run).encode(), **{name: text.encode() for name, text in parts.items()}}
    texts.pop(RECORD, None)  # so that the run is not complete
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name, text)


HUGE = "\x7f" * 8  # 1.4e306


def test_checkpoints_of_something_else(folder):
    mh.run(configOf())
    whole = Path("run.checkpoint").read_bytes()
    verlet = mm.XmlSerializer.serialize(mm.VerletIntegrator(0.001))
    system = mm.XmlSerializer.serialize(mm.System())
    for change, parts in (
        (lambda run: None, {"integrator.xml": verlet}),
        (lambda run: None, {"system.xml": system}),
        (lambda run: None, {"state.xml": system}),
        (lambda run: None, {"integrator.xml": system}),
        (lambda run: None, {"positions": "short"}),
        (lambda run: None, {"positions": HUGE * 3 * 42}),
        (lambda run: None, {"velocities": HUGE * 3 * 42}),
        (lambda run: run.update(stage=99), {}),
        (lambda run: run.update(step="x"), {}),
        (lambda run: run["stageState"].pop("startTargets"), {}),
        (lambda run: run["stageState"].update(startTargets={"area": "x"}), {}),
        (lambda run: run["stageState"].update(position=-3), {}),
        (lambda run: run["stageState"].update(startConditions={"tension": 1.0}), {}),
    ):
        Path("run.checkpoint").write_bytes(whole)
        edit("run.checkpoint", change, **parts)
        assertSaid(invoke("resume", "run", "--steps", 2), "run.checkpoint")
    Path("run.checkpoint").write_bytes(whole)
    assert invoke("resume", "run", "--steps", 2).exit_code == 0


def test_a_checkpoint_that_claims_gigabytes(folder):
    mh.run(configOf())
    edit("run.checkpoint", lambda run: None, **{"state.xml": " " * (300 << 20)})
    assert os.stat("run.checkpoint").st_size < 1 << 20
    assertSaid(invoke("resume", "run", "--steps", 2), "run.checkpoint is not a checkpoint")


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_mesh_that_claims_gigabytes(folder, kind):
    head = f"ply\nformat {kind} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 800000000\nproperty list uchar int vertex_indices\nend_header\n"
    Path("big.ply").write_bytes(head.encode() + bytes(100))

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))

    process = start("check", "big.ply", preexec_fn=limit)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 1 and errors.startswith("openmm-helfrich: big.ply") and "Traceback" not in errors


TABLES = {
    "a,b\n1,2\n": "is not a table of observables; it has no columns",
    "": "is not a table of observables",
    "step,energy (kT),area (nm^2)\n1,2\n": "has 2 values in line 2; its first line names 3",
    "step,energy (kT),area (nm^2)\n1,x,3\n": "energy (kT) is 'x' in line 2; it must be a number",
    "step,energy (kT),area (nm^2)\n1,2,3\ninf,3,4\n": "step is inf in line 3; it must be a number from -1e15 to 1e15",
    "step,energy (kT),area (nm^2)\nnan,2,3\n": "step is nan in line 2; it must be a number from -1e15 to 1e15",
}


@pytest.mark.parametrize("text", TABLES)
def test_tables(folder, text):
    Path("run.csv").write_text(text)
    assertSaid(invoke("plot", "run.csv"), "run.csv", TABLES[text])
    assertSaid(invoke("report", "run"), "run.csv", TABLES[text])
    assert not os.path.exists("run_plot.png")


def test_columns_that_a_table_lacks(folder):
    Path("run.csv").write_text("step,energy (kT),area (nm^2)\n1,2,3\n")
    with pytest.raises(ValueError, match=r"run.csv has no column 'volume'; it has step, energy, area"):
        mh.readObservables("run.csv")["volume"]


# --- the screen and the system around


def test_nobody_reads_the_screen(folder):
    """The run goes on, and ends as it would."""
    config = configOf()
    config["sampling"]["steps"] = 300
    write("run.toml", config)
    run = " ".join([*COMMAND, "run", "run.toml"])
    script = f"set -o pipefail; {run} 2>&1 | head -1"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0 and "Traceback" not in done.stderr
    assert mh.readObservables("run.csv")["step"][-1] == 300 and os.path.exists("run_shape.png")
    done = subprocess.run(["bash", "-c", f"{run} --output closed >&- 2>&- <&-"], timeout=600)
    assert done.returncode == 0
    for suffix in (".dcd", ".csv"):
        assert Path("closed" + suffix).read_bytes() == Path("run" + suffix).read_bytes()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full here")
def test_what_is_printed_to_a_full_disk_is_an_error(folder):
    with open("/dev/full", "w") as full:
        process = start("config", stdout=full)
        _, errors = process.communicate(timeout=600)
    assert process.returncode == 1 and errors == "openmm-helfrich: No space left on device\n"


def test_a_locale_without_letters(folder):
    """Files are UTF-8 all the same, and equal to those of another locale."""
    write("run.toml", configOf(mesh={"icosphere": 1, "length_unit": "µm"}))
    for prefix, environment in (
        ("ascii", {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}),
        ("utf8", {"LC_ALL": "C.UTF-8"}),
    ):
        process = start("run", "run.toml", "--output", prefix, env={**os.environ, **environment})
        output, errors = process.communicate(timeout=600)
        assert process.returncode == 0, errors
        assert ("\\xb5m^2" if prefix == "ascii" else "µm^2") in output
    assert Path("ascii.csv").read_bytes() == Path("utf8.csv").read_bytes()
    assert "area (µm^2)" in Path("ascii.csv").read_text(encoding="utf-8")
    assert 'length_unit = "µm"' in Path("ascii.resolved.toml").read_text(encoding="utf-8")


def test_without_docstrings(folder):
    """Nothing depends on docstrings and assertions."""
    environment = {**os.environ, "PYTHONOPTIMIZE": "2"}
    for arguments in (["run", "run.toml"], ["config"]):
        process = start(*arguments, env=environment)
        output, errors = process.communicate(timeout=600)
        assert process.returncode == 0 and "Traceback" not in errors
    parseConfig({"mesh": {"icosphere": 1}})  # what was printed last has every key
    assert all(f"[{name}]" in output for name in ("mesh", "membrane", "tether", "sampling", "output"))


def test_pictures_have_a_style_of_their_own(folder):
    """Whatever a user's settings of matplotlib are, and without a touch to them."""
    import matplotlib

    mesh = mh.Mesh.icosphere(1)
    summary = mh.run(configOf())
    own = Path("run_observables.png").read_bytes()
    from openmmhelfrich.pictures.plots import drawMesh, plotObservables

    with matplotlib.rc_context({"text.usetex": True, "font.size": 30, "axes.facecolor": "red"}):
        plotObservables(summary.table, "again.png")
        drawMesh(mesh, "shape.png")
        assert matplotlib.rcParams["text.usetex"] and matplotlib.rcParams["font.size"] == 30
    assert Path("again.png").read_bytes() == own


def test_units_are_no_markup_and_no_formula(folder):
    pytest.importorskip("plotly")
    unit = "<!--<script>$_{^"
    config = configOf(mesh={"icosphere": 1, "length_unit": unit})
    mh.run(config)
    assert invoke("report", "run").exit_code == 0
    page = Path("run_report.html").read_text(encoding="utf-8")
    assert "<!--" not in page.split("</head>")[1]
    data = page.split('<script type="application/json" id="data">')[1].split("</script>")[0]
    assert "<" not in data and json.loads(data)["shape"]["lengthUnit"] == "&lt;!--&lt;script&gt;$_{^"


def test_interrupted_while_modules_are_imported(folder):
    """At any time of the start: a line, the exit code of the signal, and nothing of the run."""
    program = """
import os, signal, sys
from openmmhelfrich import cli

module = sys.argv.pop(1)

class Finder:
    @staticmethod
    def find_spec(name, *_):
        if name == module:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder)
cli.main()
"""
    for module in ("typer", "numpy", "openmmhelfrich.runs.studies"):
        done = subprocess.run(
            [sys.executable, "-c", program, module, "run", "run.toml"], capture_output=True, text=True
        )
        assert (done.returncode, done.stderr) == (130, "openmm-helfrich: interrupted\n"), module
    assert os.listdir() == ["run.toml"]


def test_a_folder_deleted_during_a_run_is_not_called_safe(folder):
    config = configOf(output={"prefix": "results/run", "checkpoint_interval": 20})
    config["sampling"]["steps"] = 10**5
    write("run.toml", config)
    process = start("run", "run.toml")
    while not os.path.exists("results/run.checkpoint"):
        time.sleep(0.1)
        assert process.poll() is None
    time.sleep(0.5)
    while os.path.exists("results"):
        shutil.rmtree("results", ignore_errors=True)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 1 and "deleted meanwhile" in errors and "safe" not in errors
