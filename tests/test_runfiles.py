"""A run's files are found by the name of any of them, and files that are none of what is wanted are told so."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import openmmhelfrich as mh
from openmmhelfrich.cli import app
from openmmhelfrich.io.runfiles import prefixOf, shapesOf

CONFIG = {
    "mesh": {"icosphere": 2},
    "sampling": {"steps": 300, "seed": 2},
    "platform": {"threads": 1},
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    mh.run({**CONFIG, "output": {"prefix": str(folder / "cell.v2")}})
    return folder


@pytest.fixture
def prefix(finished, tmp_path):
    shutil.copytree(finished, tmp_path / "r")
    return tmp_path / "r" / "cell.v2"


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_each_file_tells_the_prefix(prefix):
    files = sorted(prefix.parent.iterdir())
    assert len(files) == 9
    assert {prefixOf(file) for file in files} == {prefix} == {prefixOf(prefix), prefixOf(prefix.parent)}
    assert prefixOf(f"{prefix}.toml") == prefix  # its configuration
    assert prefixOf("other.csv") == Path("other.csv")


def test_a_folder_of_several_runs_is_not_guessed(prefix):
    shutil.copy(f"{prefix}.checkpoint", prefix.parent / "other.checkpoint")
    with pytest.raises(ValueError, match=r"has several runs: .*cell.v2, .*other; name one"):
        prefixOf(prefix.parent)


@pytest.mark.parametrize("ending", ["", ".csv", ".dcd", ".psf", ".resolved.toml", "_shape.png"])
def test_commands_take_any_file_of_a_run(prefix, ending, tmp_path):
    name = f"{prefix}{ending}"
    for command, output in (("plot", "plot.png"), ("convert", "shape.ply"), ("report", "page.html")):
        last = ("--frame", "-1") if command == "convert" else ()
        where = (tmp_path / output,) if command == "convert" else ("-o", tmp_path / output)
        result = invoke(command, name, *where, *last)
        assert result.exit_code == 0, result.output
        assert (tmp_path / output).exists()
    assert (
        mh.Mesh.read(tmp_path / "shape.ply").triangles == mh.readMeshTrajectory(f"{prefix}.vtkhdf")[-1][1].triangles
    ).all()
    result = invoke("resume", name)
    assert result.exit_code == 1
    assert f"the run {prefix} is complete" in result.output
    assert invoke("resume", name, "--steps", "10").exit_code == 0


def test_shapes_of_a_run_without_a_trajectory(prefix):
    Path(f"{prefix}.vtkhdf").unlink()
    assert shapesOf(f"{prefix}.csv") == Path(f"{prefix}.ply")
    Path(f"{prefix}.ply").unlink()
    with pytest.raises(FileNotFoundError, match=r"neither a mesh trajectory .* nor a final mesh"):
        shapesOf(prefix)


def test_triangles_that_have_flipped_are_not_drawn_with_those_of_the_start(prefix, tmp_path):
    result = invoke("render", f"{prefix}.dcd", "--topology", f"{prefix}.psf", "-o", tmp_path / "shredded.png")
    assert result.exit_code == 1
    assert re.search(
        r"does not have the triangles of the last frame .*: edges have flipped since; .*\.vtkhdf has those",
        result.output,
    )
    assert not (tmp_path / "shredded.png").exists()
    topology = shapesOf(prefix).with_name("last.ply")
    mh.readMeshTrajectory(f"{prefix}.vtkhdf")[-1].mesh.write(topology)
    assert (
        invoke("convert", f"{prefix}.dcd", tmp_path / "a.ply", "--topology", topology, "--frame", "-1").exit_code == 0
    )


def test_libraries_say_nothing_on_the_screen(prefix, tmp_path):
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "openmmhelfrich.cli",
            "convert",
            f"{prefix}.dcd",
            tmp_path / "a.ply",
            "--topology",
            f"{prefix}.ply",
            "--frame",
            "-1",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == (f"{tmp_path / 'a.ply'}\n", "")


@pytest.mark.parametrize("content", [b"solid\0\xff", b"solid cell\nfacet normal 0 0 1\n"])
def test_a_mesh_is_no_configuration(tmp_path, content):
    (tmp_path / "cell.stl").write_bytes(content)
    result = invoke("run", tmp_path / "cell.stl")
    assert result.exit_code == 1
    assert "cell.stl is a mesh; a configuration is expected" in result.output
    assert "[mesh]" in result.output


def test_equal_runs_have_equal_final_files(prefix, tmp_path):
    again = tmp_path / "again" / "cell.v2"
    mh.run({**CONFIG, "output": {"prefix": str(again)}})
    for ending in (".ply", ".csv", ".dcd", ".psf", "_shape.png", "_observables.png"):
        assert Path(f"{again}{ending}").read_bytes() == Path(f"{prefix}{ending}").read_bytes(), ending


@pytest.mark.parametrize("suffix", ["ply", "obj", "off", "stl", "vtu", "vtk", "msh", "tsi", "q", "h5"])
def test_equal_meshes_become_equal_files(tmp_path, suffix, monkeypatch):
    import datetime

    class Later(datetime.datetime):
        @classmethod
        def now(cls, tz=None):
            return cls(2001, 2, 3)

    mesh = mh.Mesh.icosphere(1)
    mesh.write(tmp_path / f"a.{suffix}")
    monkeypatch.setattr(datetime, "datetime", Later)
    mesh.write(tmp_path / f"b.{suffix}")
    assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()
