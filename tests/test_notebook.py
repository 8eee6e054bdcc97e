"""How objects show themselves, what bars show, and what editors and type checkers find."""

import ast
import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
from rich.console import Console
from typing_extensions import assert_type

import openmmhelfrich as mh
from openmmhelfrich.runs import progress
from openmmhelfrich.runs.mcapp import runLikeTriMem

ROOT = Path(__file__).resolve().parent.parent
STAGES = [{"kind": "minimize", "max_iterations": 5}, {"kind": "sample", "steps": 12}]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    prefix = str(tmp_path_factory.mktemp("run") / "a")
    sampling = {"seed": 2, "steps_per_trajectory": 5}
    return mh.run({"mesh": {"icosphere": 1}, "sampling": sampling, "stages": STAGES, "output": {"prefix": prefix}})


def simulation():
    scene = mh.Scene.of({"sampling": {"seed": 1, "shear_wave_probability": 0.25}}, mh.Mesh.icosphere(1))
    force = scene.createForce()
    return scene, force, scene.createSimulation(force)


def test_objects_are_a_line(result):
    scene, force, made = simulation()
    named = scene.createForce()
    named.setName("inner")
    minimum = mh.minimize(made, force, maxIterations=3)
    spectrum = mh.fluctuationSpectrum([scene.mesh.vertices] * 3, maxDegree=3)
    for thing, words in (
        (named, "<HelfrichForce 'inner': 80 triangles, bending 49.887 kJ/mol, area 2.4943e+06 kJ/mol"),
        (made.integrator, "<HybridMonteCarloIntegrator at 300 K: 25% trajectories of 100 steps of "),
        (made.integrator.getMove(1), "<EdgeFlipIntegrator at 300 K: sweeps of flips over 0.3 of the edges>"),
        (mh.HybridMonteCarloIntegrator(mm.VerletIntegrator(0.1)), " 100% VerletIntegrator>"),
        (force.getGeometryInContext(made.context), "<HelfrichGeometry: area 11"),
        (scene.mesh, "<Mesh of 42 vertices and 80 triangles>"),
        (scene, "<Scene: 42 vertices, sample, steps of "),
        (result, "<Summary: 42 vertices, 12 steps and 1 minimization, energy "),
        (result.table, "<Table of 3 rows: step, energy, "),
        (minimum, "<MinimizationResult: energies bending: "),
        (spectrum, "powers array of shape (2,)"),
        (mh.continueTo(made, force, {"volume": 3.6}, 1, 1, 1), "windows Table of 2 rows, rows Table of 2 rows"),
        (result.verdict, "<Verdict: doubtful; "),
    ):
        text = repr(thing)
        assert words in text and "\n" not in text and len(text) < 700, text
        assert "0x" not in text


def test_results_are_tables_in_notebooks(result):
    table = result._repr_html_()
    assert table.count("<tr>") == len(result.lines()) and "&lt;" not in table
    assert str(result).splitlines()[0].strip() == "membrane  42 vertices, 80 triangles"
    assert result.verdict._repr_html_().count("<tr>") == 1 + len(result.verdict.findings)
    rows = result.table._repr_html_()
    assert rows.count("<tr>") == 4 and f"{result.table['energy'][-1]:.5g}" in rows
    long = mh.readObservables.__globals__["Table"]({"a": np.arange(100.0)})
    assert long._repr_html_().count("<tr>") == 12 and "100 rows" in long._repr_html_()


def test_what_is_shown_is_escaped():
    from openmmhelfrich.display import htmlTable

    assert "<b>" not in htmlTable([("<b>", "a & b")]) and "a &amp; b" in htmlTable([("<b>", "a & b")])


@pytest.mark.parametrize("plot", ["mesh", "result"])
def test_pictures_are_shown_and_saved(result, plot, tmp_path):
    mesh = mh.Mesh(mh.Mesh.icosphere(1).vertices, mh.Mesh.icosphere(1).triangles, beads=[[0, 0, 1.5]])
    picture = mesh.plot(scaleBar=True) if plot == "mesh" else result.plot()
    assert picture._repr_png_().startswith(b"\x89PNG") and "inches" in repr(picture)
    for suffix, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")):
        picture.save(tmp_path / f"a{suffix}")
        assert (tmp_path / f"a{suffix}").read_bytes().startswith(start)
    with pytest.raises(ValueError, match=r"no plot has the suffix '.xyz'; use one of .*\.png"):
        picture.save(tmp_path / "a.xyz")
    with pytest.raises(ValueError, match=r"plot has no colour; it has elevation, .*scaleBar and lengthUnit"):
        mesh.plot(colour="red")


@pytest.mark.parametrize("width", [80, 140])
def test_bars_show_steps_rate_and_time(width, tmp_path, monkeypatch):
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_UPDATES", 0)
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=width, color_system=None)
    config = {"mesh": {"icosphere": 2}, "sampling": {"seed": 1}, "output": {"prefix": str(tmp_path / "a")}}
    with progress.RunProgress(console=console) as bars:
        mh.run({**config, "stages": [{"kind": "minimize"}, {"kind": "sample", "steps": 120000 // 10000}]}, bars)
    lines = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", out.getvalue()).replace("\r", "\n").splitlines()
    last = next(line for line in reversed(lines) if "sample" in line)
    assert all(len(line) <= width for line in lines)
    assert re.search(r"2/2 sample(, doubtful)? +━+ 12/12 +[\d.e+]+ steps/s +\d\d:\d\d", last), last
    assert last.count("doubtful") == 1 and ("sample, doubtful" in last) == (width == 80)
    assert ("accepted" in last) == (width == 140)


def test_progress_is_a_switch(tmp_path, capfd):
    """True is what the command shows: off a terminal, lines."""
    config = {"mesh": {"icosphere": 1}, "sampling": {"seed": 1, "steps": 3}}
    mh.run({**config, "output": {"prefix": str(tmp_path / "a")}}, progress=True)
    assert "sample: step 3 of 3" in capfd.readouterr().err
    mh.run({**config, "output": {"prefix": str(tmp_path / "b")}}, progress=False)
    assert capfd.readouterr().err == ""


def test_completion_knows_the_names():
    names = dir(mh)
    assert {"HelfrichForce", "Mesh", "Scene", "run", "sweep", "pictures", "__version__"} <= set(names)
    assert not {"Any", "os", "import_module", "_HOMES"} & set(names)


def test_stubs_are_up_to_date():
    done = subprocess.run([sys.executable, "wrappers/stubs.py", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_stubs_have_what_classes_have():
    """Every public method of every class is in the stub, with the same arguments, and nothing else is."""
    import inspect

    tree = ast.parse((ROOT / "python" / "openmmhelfrich" / "helfrich.pyi").read_text())
    stubs = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    from openmmhelfrich import helfrich

    for name in [name for name in vars(helfrich) if isinstance(getattr(helfrich, name), type) and name[0] != "_"]:
        kind = getattr(helfrich, name)
        if kind.__module__ != helfrich.__name__:
            continue
        methods = {part.name: part for part in stubs[name].body if isinstance(part, ast.FunctionDef)}
        found = {key for key, value in vars(kind).items() if key[0] != "_" and not isinstance(value, property)}
        fields = set(getattr(kind, "__dataclass_fields__", {}))
        lent = {key for key in methods if key not in vars(kind)} if name == "HybridMonteCarloIntegrator" else set()
        assert found - fields - {"thisown"} == set(methods) - {"__init__"} - lent, name
        assert all(hasattr(kind, key) for key in lent), name
        for key in set(methods) - {"__init__"} - lent:
            own = [p for p in inspect.signature(getattr(kind, key)).parameters if p != "self"]
            stub = methods[key].args
            given = [a.arg for a in (*stub.args, *([stub.vararg] if stub.vararg else [])) if a.arg != "self"]
            assert own == given, (name, key)


def test_a_type_checker_finds_the_types() -> None:
    """mypy, which the lint runs, knows these types, and finds the mistakes that it is told to expect."""
    mesh, force = mh.Mesh.icosphere(1), mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    assert_type(force.getNumTriangles(), int)
    assert_type(force.getTriangleParameters(0), list[int])
    assert_type(mh.Mesh.icosphere(1), mh.Mesh)
    assert_type(mh.HybridMonteCarloIntegrator(300, 0.1).getFlipFraction(), float)
    with pytest.raises((TypeError, ValueError)):
        force.setBendingModulus(None)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        mh.EdgeFlipIntegrator(300)  # type: ignore[call-arg]
    with pytest.raises(AttributeError):
        mh.Mesh.icospher(2)  # type: ignore[attr-defined]


@pytest.mark.parametrize("call", [mh.run, mh.resume, mh.sweep, runLikeTriMem])
def testProgressThatIsNoFunction(tmp_path, call):
    with pytest.raises(TypeError, match="progress is 'bar'; it must be a function, True for bars, or None"):
        call(tmp_path / "run.toml", progress="bar")
    assert list(tmp_path.iterdir()) == []


def testProgressOfFunctionsWithoutBars(tmp_path):
    """It is refused before anything is done: the arguments before it would not do either."""
    force = mh.HelfrichForce()
    calls = [
        lambda progress: mh.minimize(None, force, progress=progress),
        lambda progress: mh.minimizeFluid(None, force, progress=progress),
        lambda progress: mh.adaptStepSize(None, 10, progress=progress),
        lambda progress: mh.anneal(None, 10, 300, progress=progress),
        lambda progress: mh.continueTo(None, force, {"volume": 1.0}, progress=progress),
        lambda progress: mh.tradeoff.tradeoff({}, tmp_path / "scene", progress=progress),
    ]
    for call in calls:
        for wrong in ("bar", True, 0):
            with pytest.raises(TypeError, match=f"^progress is {wrong!r}; it must be a function or None$"):
                call(wrong)
    assert list(tmp_path.iterdir()) == []
