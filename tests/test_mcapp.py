"""Runs of TriMem's configurations in the place of TriMem's command, as a program sees them that calls it."""

import ast
import configparser
import contextlib
import io
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import openmmhelfrich as mh
from conftest import ROOT
from membranes import uvSphere
from openmmhelfrich.analysis import verdict
from openmmhelfrich.cli import app
from openmmhelfrich.runs.config import Config, readConfig
from openmmhelfrich.runs.mcapp import Checkpoints, backUp, runLikeTriMem
from openmmhelfrich.runs.stagesettings import ApproachStage, MinimizeStage, SampleStage
from openmmhelfrich.runs.trimem import _KEYS, Source, converted

MOSAIC = """\
[GENERAL]
        algorithm = minimize
        info = 100
        input = {input}
        output_format = vtu

        [BONDS]
        bond_type = Edge
        r = 2
        lc0 = {upper}
        lc1 = {lower}

        [SURFACEREPULSION]
        n_search = cell-list
        rlist = 0.2
        exclusion_level = 2
        refresh = 10
        r = 2

        [ENERGY]
        kappa_a = 1000000.0
        kappa_b = 300.0
        kappa_c = 0.0
        kappa_v = 1000000.0
        kappa_t = 100000.0
        kappa_r = 1000.0
        area_fraction = 1.2
        volume_fraction = 1.2
        curvature_fraction = 1.0
        continuation_delta = 0.0
        continuation_lambda = 1.0

        [MINIMIZATION]
        maxiter = 2000
        out_every = 0
"""
SAMPLING = """\
[GENERAL]
input = cell.stl
info = 2
[BONDS]
bond_type = Edge
[SURFACEREPULSION]
lc1 = 0.0
[ENERGY]
kappa_b = 20.0
kappa_a = 1.0e5
kappa_v = 1.0e5
kappa_c = 0.0
kappa_t = 50.0
volume_fraction = 0.9
continuation_delta = 0.1
continuation_lambda = 0.0
[HMC]
num_steps = 6
step_size = 1.0e-4
traj_steps = 5
thin = 2
cooling_factor = 0.05
start_cooling = 8
"""


def blocksOf(page, language):
    """Return the blocks of code of a how-to page."""
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / "docs/how-to" / page).read_text(), re.DOTALL)


@pytest.fixture
def cell(inFolder):
    """The names of a configuration for sampling, and of its mesh, in the working folder."""
    mh.Mesh.icosphere(1).write("cell.stl")
    (inFolder / "cell.conf").write_text(SAMPLING)
    return inFolder / "cell.conf"


def invoke(*arguments):
    return CliRunner().invoke(app, ["mc-app", *map(str, arguments)])


def mesh(file):
    with h5py.File(file, "r") as checkpoint:
        return mh.Mesh(checkpoint["points"][()], checkpoint["cells"][()])


def configurationOf(file):
    """Return the mesh's file and the configuration that TriMem finds in a checkpoint: its elements by their places."""
    points, cells, config = ElementTree.parse(file).getroot()
    assert [part.tag for part in (points, cells, config)] == ["points", "cells", "config"]
    parser = configparser.ConfigParser()
    parser.read_string(json.loads(config.text))
    names = {part.text.split(":/")[0] for part in (points, cells)}
    with h5py.File(file.with_name(*names), "r") as data:
        for part in (points, cells):
            values = data[part.text.split(":/")[-1]]
            assert (
                values.shape == tuple(map(int, part.attrib["shape"].split())) and values.dtype == part.attrib["dtype"]
            )
    return parser


def testAProgramThatCallsTriMem(tmp_path):
    """Mosaic's configuration, by a command of TriMem's name on the path: what it reads afterwards is there, and has
    edges within the bounds that it asked for.
    """
    (text,) = [block for block in blocksOf("from-mosaic.md", "bash") if "mc_app" in block and "cat" in block]
    (tmp_path / "bin").mkdir()
    path = {"HOME": str(tmp_path), "PATH": f"{tmp_path / 'bin'}:{os.path.dirname(sys.executable)}:{os.environ['PATH']}"}
    subprocess.run(["bash", "-ec", text.replace("~/.local/bin", "bin")], cwd=tmp_path, env=path, check=True)
    random, sphere = np.random.default_rng(1), mh.Mesh.icosphere(3)
    rough = mh.Mesh(280 * sphere.vertices + random.normal(scale=4, size=sphere.vertices.shape), sphere.triangles)
    rough.write(tmp_path / "tmpx1y2.stl")
    assert rough.edgeLengths.min() < 30 and rough.edgeLengths.max() > 52
    config = textwrap.dedent(MOSAIC.format(input=tmp_path / "tmpx1y2.stl", lower=30.0, upper=52.0)).strip()
    (tmp_path / "tmpab_c.conf").write_text(config)
    command = ["mc_app", "run", "--conf", str(tmp_path / "tmpab_c.conf")]
    done = subprocess.run(command, capture_output=True, env=os.environ | path)
    assert done.returncode == 0, done.stderr
    result = mesh(tmp_path / "tmpab_c.cpt.p0.h5")
    result.check()
    assert len(result.vertices) == 642 and result.area > 1.05 * rough.area
    assert result.edgeLengths.min() >= 30 and result.edgeLengths.max() <= 52
    assert configurationOf(tmp_path / "tmpab_c.p0.cpt")["HMC"]["init_step"] == "{}"
    again = mh.Mesh.read(tmp_path / "tmpab_c.cpt.p0.h5")
    assert np.array_equal(again.vertices, result.vertices) and np.array_equal(again.triangles, result.triangles)


def testRestartsGoOn(cell):
    """Lambda, the steps that count for cooling, and the shape go on; a restart makes the steps of its file."""
    assert invoke("run", "--conf", cell).exit_code == 0
    first = configurationOf(cell.with_name("cell.p0.cpt"))
    assert float(first["ENERGY"]["continuation_lambda"]) == pytest.approx(0.6)
    assert sum(json.loads(first["HMC"]["init_step"]).values()) == 6
    assert invoke("run", "--conf", cell, "--restart").exit_code == 0
    moving, cooling = readConfig("cell.p1.resolved.toml").stages[-2:]
    assert moving.target_volume == pytest.approx(0.9 * mh.Mesh.read("cell.stl").volume)
    assert (moving.totalSteps, cooling.steps, cooling.cooling_start, cooling.start_temperature) == (4, 2, 0, 300)
    assert np.array_equal(mesh("cell.cpt.p1.h5").triangles, mh.Mesh.read("cell.p1.ply").triangles)
    second = configurationOf(cell.with_name("cell.p1.cpt"))
    assert float(second["ENERGY"]["continuation_lambda"]) == 1
    assert sum(json.loads(second["HMC"]["init_step"]).values()) == 12
    for name in ("cell", "cell.p1"):
        stages = readConfig(f"{name}.resolved.toml").stages
        assert sum(stage.totalSteps for stage in stages if stage.kind != "approach") == 6
        made = np.loadtxt(f"{name}.csv", delimiter=",", skiprows=1)[-1, 0]
        assert made == sum(stage.totalSteps for stage in stages)
    assert not list(cell.parent.glob("#*"))


def testWhatARestartTakes(cell):
    source = Source(cell)
    source.goOnFrom({"continuation_lambda": "0.6", "continuation_delta": "0.1", "init_step": '{"move": 20, "flip": 8}'})
    data, _ = converted(source)
    assert data["membrane"]["target_volume"] == pytest.approx(0.94 * mh.Mesh.read("cell.stl").volume)
    assert data["stages"][-1]["start_temperature"] == pytest.approx(300 * np.exp(-0.05 * 20))
    cell.write_text(SAMPLING + 'init_step = {"move": 3}\n')
    source = Source(cell)
    source.goOnFrom({"continuation_lambda": "1.0", "continuation_delta": "0.1", "init_step": '{"move": 20, "flip": 8}'})
    (cooling,) = converted(source)[0]["stages"]
    assert cooling["cooling_start"] == 5 and cooling["start_temperature"] == 300


def testCheckpointsOfTriMemAreRead(cell):
    """A checkpoint as TriMem writes it: all of its defaults in the configuration, and JSON within XML."""
    sphere = mh.Mesh.icosphere(1, 1.01)
    with h5py.File("cell.cpt.p3.h5", "w") as data:
        for name, values in (("points", sphere.vertices), ("cells", sphere.triangles)):
            data.create_dataset(name, data=values, compression="gzip", compression_opts=4)
    config = configparser.ConfigParser()
    config.read_string(SAMPLING)
    config.read_dict({"DEFAULT": {"init_step": "{}", "input": "cell.stl", "output_prefix": "cell", "lc0": 0.4}})
    config.read_dict({"ENERGY": {"continuation_lambda": 1.0}, "HMC": {"init_step": '{"move": 20, "flip": 8}'}})
    text = io.StringIO()
    config.write(text)
    root = ElementTree.Element("cpt", Version="0.1")
    ElementTree.SubElement(root, "points", shape="42 3", dtype="float64").text = "cell.cpt.p3.h5:/points"
    ElementTree.SubElement(root, "cells", shape="80 3", dtype="int32").text = "cell.cpt.p3.h5:/cells"
    ElementTree.SubElement(root, "config").text = json.dumps(text.getvalue())
    ElementTree.ElementTree(root).write("cell.p3.cpt")
    summary = runLikeTriMem(cell, restart=3)
    stage = summary.config.stages[-1]
    assert (stage.kind, stage.steps) == ("anneal", 6) and "continue" not in {s.kind for s in summary.config.stages}
    assert stage.start_temperature == pytest.approx(300 * np.exp(-0.05 * 20))
    assert summary.table["area"][0] == pytest.approx(sphere.area) and mesh("cell.cpt.p4.h5").area < 1.01 * sphere.area


def testEarlierFilesAreKept(cell):
    """Of runs one after the other the earlier files have other names, and the same bytes; the mesh stays."""
    mh.Mesh.icosphere(1).write("cell.ply")
    cell.write_text(SAMPLING.replace("cell.stl", "cell.ply"))
    own, before = cell.with_name("cell.ply").read_bytes(), {}
    for _ in range(2):
        before = {path.name: path.read_bytes() for path in cell.parent.glob("cell*") if path.suffix != ".conf"}
        assert invoke("run", "--conf", cell).exit_code == 0
    assert before.pop("cell.ply") == own == cell.with_name("cell.ply").read_bytes() and before.pop("cell.stl")
    assert {"cell.csv", "cell.checkpoint", "cell.p0.cpt", "cell.cpt.p0.h5", "cell.vtu"} <= set(before)
    assert all(cell.with_name(f"#{name}.0#").read_bytes() == content for name, content in before.items())
    assert len(list(cell.parent.glob("#*"))) == len(before) and len(mh.Mesh.read("cell.vtu").vertices) == 42


def testAStoppedRunLeavesACheckpoint(cell):
    cell.write_text(SAMPLING.replace("num_steps = 6", "num_steps = 1000000").replace("delta = 0.1", "delta = 0.0"))
    command = [sys.executable, "-m", "openmmhelfrich.cli", "mc-app", "run", "--conf", "cell.conf"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not os.path.exists("cell.csv") or os.path.getsize("cell.csv") < 1000:
        time.sleep(0.05)
        assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    assert process.wait() == 128 + signal.SIGTERM
    assert sum(json.loads(configurationOf(cell.with_name("cell.p0.cpt"))["HMC"]["init_step"]).values()) > 1
    mesh("cell.cpt.p0.h5").check()


@pytest.mark.parametrize(
    "arguments, code, message",
    [
        ((), 2, "Missing option '--conf'"),
        (("--conf", "cell.conf", 3), 2, "number of a checkpoint"),
        (("--conf", "no.conf"), 1, "there is no configuration file no.conf"),
        (("--conf", "cell.conf", "--restart"), 1, "there is no checkpoint .*cell.p0.cpt to restart from"),
        (("--conf", "cell.conf", "--restart", 9), 1, "there is no checkpoint .*cell.p9.cpt"),
        (("--conf", "bad.conf", "--restart", 0), 1, "bad.p0.cpt is not a checkpoint of TriMem: "),
        (("--conf", "bad.conf", "--restart", 1), 1, "bad.p1.cpt is not a checkpoint of TriMem: "),
        (("--conf", "bad.conf", "--restart", 2), 1, "bad.p2.cpt is not a checkpoint of TriMem: "),
        (("--conf", "count.conf"), 1, r"\[HMC\] init_step is 'many'; it must be like {\"move\": 10, \"flip\": 5}"),
        (("--conf", "open.conf"), 1, "open.stl: "),
        (("--conf", "none.conf"), 1, r"none.conf: \[HMC\] num_steps is 0; it must be a whole number from 1 to "),
        (("--conf", "none.conf", "--restart", 3), 1, r"none.conf: \[HMC\] num_steps is 0; it must be a whole number"),
        (
            ("--conf", "far.conf"),
            1,
            r"far.conf: \[ENERGY\] volume_fraction is 1e9, here .*; it must be within a factor",
        ),
    ],
)
def testWhatIsWrongIsSaid(cell, arguments, code, message):
    cell.with_name("bad.conf").write_text(SAMPLING)
    cell.with_name("bad.p0.cpt").write_text("<cpt><points>a:/points</points></cpt>")
    cell.with_name("bad.p1.cpt").write_text("no XML")
    cell.with_name("bad.p2.cpt").write_text("<cpt><points>a/b:/points</points><config>[[1]]</config></cpt>")
    cell.with_name("count.conf").write_text(SAMPLING + "init_step = many\n")
    cell.with_name("none.conf").write_text(SAMPLING.replace("num_steps = 6", "num_steps = 0"))
    Checkpoints(cell.with_name("none")).write(3, mh.Mesh.icosphere(1), "[ENERGY]\n[HMC]\n")
    far = SAMPLING.replace("volume_fraction = 0.9", "volume_fraction = 1e9")
    cell.with_name("far.conf").write_text(far.replace("continuation_lambda = 0.0", "continuation_lambda = 1.0"))
    cell.with_name("open.conf").write_text(SAMPLING.replace("cell.stl", "open.stl"))
    mh.Mesh(mh.Mesh.icosphere(2).vertices, mh.Mesh.icosphere(2).triangles[1:]).write("open.stl")
    before = set(os.listdir())
    result = invoke("run", *arguments)
    assert result.exit_code == code and set(os.listdir()) == before
    assert re.search(message, " ".join(result.output.split()))


def adviceOf(result):
    """Return what is to be done by the message of a run with an uneven mesh, without what is wrong."""
    problem, *advice = result.output.replace("openmm-helfrich: ", "").splitlines()
    assert result.exit_code == 1 and problem.endswith("it is ready after") and "[mesh]" not in result.output
    return advice


def do(command):
    assert CliRunner().invoke(app, shlex.split(command)[1:]).exit_code == 0


@pytest.fixture
def uneven(cell):
    """The name of a configuration whose mesh is uneven, and does not cool."""
    uvSphere(32, 16).write("cell.stl")
    text = re.sub("cooling_factor = .*", "cooling_factor = 0", SAMPLING.replace("kappa_t = 50.0", "kappa_t = 5e3"))
    cell.write_text(text.replace("fraction = 0.9", "fraction = 1"))
    return cell


def testAdviceOnAnUnevenMeshNamesTrimemsKeys(uneven):
    """What the message says can be done, and the configuration runs then."""
    command, last = adviceOf(invoke("run", "--conf", uneven))
    key, file = re.fullmatch(rf"and with (input = (.*)) in \[GENERAL\] of {re.escape(str(uneven))}", last).groups()
    do(command)
    assert mh.Mesh.read(file).triangles.shape == (960, 3)
    uneven.write_text(uneven.read_text().replace("input = cell.stl", key))
    assert invoke("run", "--conf", uneven).exit_code == 0


def testAdviceOnAnUnevenCheckpointMendsIt(uneven):
    """A restart does not begin with the mesh of the configuration, so that this one need not be made anew."""
    mh.Mesh.icosphere(2).write("cell.stl")
    assert invoke("run", "--conf", uneven).exit_code == 0
    uvSphere(32, 16).write("cell.cpt.p0.h5")
    for command in adviceOf(invoke("run", "--conf", uneven, "--restart")):
        do(command)
    assert invoke("run", "--conf", uneven, "--restart").exit_code == 0


def wordsOfAdvice():
    """Return the texts of the module of verdicts, without its descriptions."""
    tree = ast.parse(Path(verdict.__file__).read_text(encoding="utf-8"))
    described = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in described:
            yield node.value


def testAdviceNamesTrimemsKeys(cell):
    """All that a verdict can say, once and again."""
    source, advice = Source(cell), [text for text in wordsOfAdvice() if " " in text]
    ours = {
        name for section in Config.model_fields.values() for name in getattr(section.annotation, "model_fields", ())
    }
    ours |= {name for kind in (MinimizeStage, SampleStage, ApproachStage) for name in kind.model_fields}
    unknown = {name for name in ours if "_" in name} - {name for keys in _KEYS.values() for name in keys}
    isOurs = re.compile(rf"\b({'|'.join(unknown)})\b|stages? of kind|sampling\.|\[output\]")
    assert len(unknown) > 40 and sum(bool(isOurs.search(text)) for text in advice) > 10
    for text in advice:
        told = source.inItsWords(text)
        assert not isOurs.search(told) and source.inItsWords(told) == told, told


@pytest.mark.parametrize("algorithm", ["hmc", "minimize"])
def testARunTellsItsNotesAndItsVerdictInTrimemsWords(cell, algorithm):
    """While it goes on, at its end, and where nothing shows it; files that a run of ours goes on with keep our keys."""
    volume, its, ours = {
        "hmc": ("0.98", "[GENERAL] info is 1, and not 5", "observables_interval"),
        "minimize": ("0.7", "(maxiter)", "max_iterations"),
    }[algorithm]
    text = SAMPLING.replace("info = 2", f"info = 5\nalgorithm = {algorithm}").replace("num_steps = 6", "num_steps = 4")
    text = text.replace("volume_fraction = 0.9", f"volume_fraction = {volume}").replace(
        "_lambda = 0.0", "_lambda = 0.5"
    )
    cell.write_text(text + "[MINIMIZATION]\nmaxiter = 2\n")
    with pytest.warns(UserWarning) if algorithm == "minimize" else contextlib.nullcontext() as warned:
        summary = runLikeTriMem(cell)
    told = [
        str(summary),
        "\n".join([*summary.notes, str(summary.verdict)]),
        *(str(each.message) for each in warned or ()),
    ]
    command = [sys.executable, "-m", "openmmhelfrich.cli", "mc-app", "run", "--conf", str(cell)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    for shown in [*told, done.stdout, *([done.stderr] if algorithm == "hmc" else [])]:
        assert its in shown and ours not in shown
    assert ours in Path("cell.resolved.toml").read_text()


def testUnknownKeysAreAmongTheNotesOfARun(cell):
    """They are left out, as TriMem leaves them: who reads what the run came to sees it, too."""
    cell.write_text(cell.read_text().replace("kappa_b", "kapa_b") + "[hmc]\nnum_steps = 3\n")
    told = "Unknown, and left out: [ENERGY] kapa_b (did you mean [ENERGY] kappa_b?), [hmc] num_steps"
    assert runLikeTriMem(cell).notes[-1].startswith(told)
    result = invoke("run", "--conf", cell)
    assert told in " ".join(result.stdout.split()), result.output


def testBackupsHaveFreeNames(inFolder):
    for text in ("a", "b", "c"):
        for name in ("x.csv", "x.ply"):
            (inFolder / name).write_text(text)
        backUp([inFolder / "x.csv", inFolder / "x.ply", inFolder / "no"], inFolder / "x.ply")
    assert {path.name: path.read_text() for path in inFolder.iterdir()} == {
        "#x.csv.0#": "a",
        "#x.csv.1#": "b",
        "#x.csv.2#": "c",
        "x.ply": "c",
    }
