"""Results that are damaged: what does not go together is told by name, and nothing is written before."""

import json
import shutil
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

import openmmhelfrich as mh
from openmmhelfrich.messages import inLine
from openmmhelfrich.pictures.plots import plotObservables
from openmmhelfrich.pictures.report import writeReport
from openmmhelfrich.runs.config import readConfig
from openmmhelfrich.runs.sweeps import observe
from openmmhelfrich.tables import PLACES, plainName

CONFIG = """
[mesh]
icosphere = 1
[sampling]
seed = 1
steps = 6
steps_per_trajectory = 2
[output]
psf = true
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a run."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "run.toml").write_text(CONFIG)
    config = readConfig(folder / "run.toml")
    config.output.prefix = str(folder / "run")
    mh.run(config)
    return folder


@pytest.fixture
def folder(made, inFolder):
    """A working folder with a run."""
    shutil.copytree(made, inFolder, dirs_exist_ok=True)
    return inFolder


def changeRun(place, value):
    """Change what the checkpoint says of the run."""
    with zipfile.ZipFile("run.checkpoint") as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    run = part = json.loads(parts["run.json"])
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    with zipfile.ZipFile("run.checkpoint", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in {**parts, "run.json": json.dumps(run)}.items():
            archive.writestr(name, content)


# --- checkpoints

DISAGREEING = {
    ("config", "mesh", "length_unit"): ("um", r"run\.csv has the column 'area \(nm\^2\)'; .* has 'area \(um\^2\)'$"),
    ("config", "platform", "name"): ("x" * 500, r"\[platform\] name is 'xxx.*\(502 characters\); it must be one of"),
    ("config", "platform", "threads"): (80000, r"the number of threads is 80000; it must be at most"),
    ("config", "stages", 0, "steps"): (10**14, r"the results take at least"),
    ("sizes", "table"): (10**8, r"run\.csv has \d+ bytes, and had 100000000 at the last checkpoint"),
    ("sizes", "trajectory"): (10**8, r"run\.dcd has \d+ bytes, and had 100000000 at the last checkpoint"),
    ("sizes", "meshFrames"): (50, r"run\.vtkhdf has \d+ frames; it should have 50 or more"),
}


@pytest.mark.parametrize("place", DISAGREEING)
def testCheckpointsThatAFileDisagreesWith(folder, place):
    """Both are named, and no file is changed but by dropping what would be made again."""
    value, message = DISAGREEING[place]
    changeRun(place, value)
    before = {file: file.read_bytes() for file in folder.iterdir()}
    with pytest.raises(ValueError, match=rf"^run\.checkpoint: {message}") as caught:
        mh.resume("run", steps=2)
    assert max(map(len, str(caught.value).splitlines())) < 500
    assert {file: file.read_bytes() for file in folder.iterdir()} == before


def testATableOfOtherColumns(folder):
    Path("run.csv").write_text(Path("run.csv").read_text().replace("reducedVolume", "longerVolume5"))
    with pytest.raises(ValueError, match=r"^run\.checkpoint: run\.csv has the column 'longerVolume5'; .* no such"):
        mh.resume("run", steps=2)


def testATableThatAnotherProgramSaved(folder):
    """It is longer than it was, with other ends of lines: what is at the place where it ended is no end of a row."""
    content = Path("run.csv").read_bytes().replace(b"\n", b"\r\n")
    Path("run.csv").write_bytes(content)
    with pytest.raises(
        ValueError, match=r"^run\.checkpoint: run\.csv has no end of a line at byte \d+, where it ended"
    ):
        mh.resume("run", steps=2)
    assert Path("run.csv").read_bytes() == content


def testWhatLibrariesSayIsOneLine():
    assert inLine(ValueError("a\n\tb \x00\x1b")) == "a b ??"
    assert len(inLine("b" * 10**6)) < 400


# --- tables


@pytest.mark.parametrize("value", ["-inf", "nan", "1e308"])
def testNumbersOfTables(folder, value):
    """Whatever numbers are in a table, it is shown without a warning, and its verdict says what is not finite."""
    table = mh.readObservables("run.csv")
    write({*table} - {*PLACES}, value)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = writeReport("run", overwrite=True)
        plotObservables(mh.readObservables("run.csv"), "table.svg")
        observe(readConfig("run.toml"))
    assert ("are not finite numbers" in page.read_text(encoding="utf-8")) != np.isfinite(float(value))


@pytest.mark.parametrize("value", ["inf", "nan", "1e16"])
@pytest.mark.parametrize("head", PLACES)
def testPlacesInTables(folder, head, value):
    write({head}, value)
    with pytest.raises(ValueError, match=rf"^run\.csv: {head} is \S+ in line 2; it must be a number from -1e15 to"):
        mh.readObservables("run.csv")


def write(changed, value):
    """Write the table with other numbers in some columns, in every second row with the other sign."""
    heads, *rows = [line.split(",") for line in Path("run.csv").read_text().splitlines()]
    for k, row in enumerate(rows):
        other = value.removeprefix("-") if value.startswith("-") else f"-{value}"
        rows[k] = [(value, other)[k % 2] if plainName(head) in changed else text for head, text in zip(heads, row)]
    Path("run.csv").write_text("".join(",".join(row) + "\n" for row in [heads, *rows]))


# --- meshes


def testALongNameInAMesh(inFolder):
    """A file that names another one, which no system could have, is refused in a line."""
    Path("mesh.gltf").write_text(
        json.dumps({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 9, "uri": "a" * 5000}]})
    )
    with pytest.raises(ValueError, match=r"^mesh\.gltf: ") as caught:
        mh.Mesh.read("mesh.gltf")
    assert len(str(caught.value)) < 500
