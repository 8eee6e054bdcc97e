"""The page about a run: what it holds, and what a browser makes of it."""

import base64
import html
import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import openmmhelfrich as mh
import openmmhelfrich.pictures.report as report
from conftest import together
from openmmhelfrich.analysis.verdict import Verdict
from openmmhelfrich.cli import app
from openmmhelfrich.pictures.curvature import smoothMeanCurvature
from openmmhelfrich.pictures.report import writeReport
from test_mesh_trajectory import simulate

pytest.importorskip("plotly")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def invoke(*arguments):
    return CliRunner().invoke(app, ["report", *map(str, arguments)])


@pytest.fixture
def results(inFolder, sphere):
    """The results of a short run, in a folder of their own."""
    simulation, force = simulate(sphere)
    simulation.reporters += [
        mh.MeshReporter("run.vtkhdf", 4, force, lengthUnit="um"),
        mh.ObservablesReporter("run.csv", 2, force, 300, "um"),
    ]
    simulation.step(20)
    simulation.reporters[0].close()
    (inFolder / "run.resolved.toml").write_text('# versions: OpenMM 8.6\n[mesh]\nfile = "</script><b>&"\n')
    return inFolder


def partsOf(page):
    """Return the data of a page, its warnings, its facts, and its settings."""
    text = page.read_text(encoding="utf-8")
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)[1])

    def inner(pattern):
        return [html.unescape(found) for found in re.findall(pattern, text, re.DOTALL)]

    facts = dict(zip(inner("<tr><th>(.*?)</th>"), inner("<td>(.*?)</td>")))
    return data, inner("<li>(.*?)</li>"), facts, inner('<pre id="settings">(.*?)</pre>')[0]


def decode(text, kind):
    return np.frombuffer(base64.b64decode(text), dtype=kind)


def testThePageHoldsTheFrames(results):
    page = writeReport("run")
    assert page.name == "run_report.html"
    shape, trajectory = partsOf(page)[0]["shape"], mh.readMeshTrajectory("run.vtkhdf")
    assert (
        [frame["step"] for frame in shape["frames"]] == [4, 8, 12, 16, 20]
        and shape["lengthUnit"] == "µm"
        and not shape["wide"]
    )
    for shown, frame in zip(shape["frames"], trajectory, strict=True):
        positions = decode(shown["positions"], "<u2").reshape(3, -1).T / 65535 * shape["size"] + shape["low"]
        assert np.abs(positions - frame.mesh.vertices).max() < shape["size"] / 65535
        assert np.array_equal(decode(shown["triangles"], "<u2").reshape(3, -1).T, frame.mesh.triangles)
        curvature = shape["bound"] * (decode(shown["curvatures"], "<u1") / 127.5 - 1)
        assert curvature == pytest.approx(
            np.clip(smoothMeanCurvature(frame.mesh), -shape["bound"], shape["bound"]), abs=shape["bound"] / 255
        )


def testThePageHoldsTheTableAndTheSettings(results):
    data, warnings, facts, settings = partsOf(writeReport("run"))
    table = mh.readObservables("run.csv")
    assert data["panels"]["steps"] == table["step"].tolist() and warnings == []
    panels = {
        panel["title"]: {curve["name"]: curve["values"] for curve in panel["curves"]}
        for panel in data["panels"]["panels"]
    }
    assert list(panels) == ["energy (kT)", "area (µm²)", "volume (µm³)", "reduced volume", "accepted so far"]
    assert set(panels["energy (kT)"]) == {"total", "bending", "tether"} and set(panels["accepted so far"]) == {
        "trajectories",
        "flips",
    }
    assert panels["energy (kT)"]["bending"] == pytest.approx(table["E_bending"], rel=1e-6)
    assert settings == (results / "run.resolved.toml").read_text()
    assert (
        facts["table"] == "up to 20 steps"
        and facts["frames"] == "5"
        and "µm²" in facts["area"]
        and mh.__version__ in facts["this page"]
    )


def testMinimizationsAreNoSteps(inFolder):
    """Neither on the page, nor in what a run tells at its end."""
    few = {"kind": "minimize", "max_iterations": 2}
    for stages, made in (
        ([few], "1 minimization"),
        ([few, few], "2 minimizations"),
        ([{"kind": "sample", "steps": 3}, few, few], "3 steps and 2 minimizations"),
        ([few, {"kind": "sample", "steps": 1}], "1 step and 1 minimization"),
    ):
        output = {"prefix": "run", "overwrite": True, "observables_interval": 1}
        config = {
            "mesh": {"icosphere": 1},
            "sampling": {"steps_per_trajectory": 10},
            "stages": stages,
            "output": output,
        }
        summary = mh.run(config)
        assert f"vertices, {made}, energy" in repr(summary)
        assert len(stages) == 1 or dict(summary.lines())["made"].startswith(f"{made} in ")
        assert partsOf(writeReport("run", overwrite=True))[2]["table"] == f"up to {made}"
    more = mh.resume("run", steps=2)
    assert dict(more.lines())["made"].startswith("3 steps and 1 minimization, of which 2 steps in ")


def testThePageNeedsNothingElse(results):
    text = writeReport("run").read_text(encoding="utf-8")
    outside = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=|url\(|@import", outside) and text.count("</script>") == text.count("<script")


def testSize(results, monkeypatch):
    """A hundred and one frames of 2,562 vertices stay below 20 MB; of more than fit, some are shown."""
    mesh, generator = mh.Mesh.icosphere(4), np.random.default_rng(1)
    many = [
        mh.MeshFrame(
            i,
            mh.Mesh(mesh.vertices * (1 + 0.05 * generator.random((2562, 1))), generator.permutation(mesh.triangles)),
            {},
        )
        for i in range(3)
    ] * 40
    mh.writeMeshTrajectory("run.vtkhdf", many)
    page = writeReport("run")
    data, warnings, *_ = partsOf(page)
    assert (
        page.stat().st_size < 12e6
        and len(data["shape"]["frames"]) == 101
        and "The page shows 101 of 120 frames." in warnings
    )
    assert [data["shape"]["index"][i] for i in (0, -1)] == [0, 119]
    monkeypatch.setattr(report, "MAX_BYTES", 6e6)
    page = writeReport("run", "small.html")
    assert 5e6 < page.stat().st_size < 6e6 and 5 < len(partsOf(page)[0]["shape"]["frames"]) < 20
    monkeypatch.setattr(report, "MAX_BYTES", 5e6)
    data, warnings, *_ = partsOf(writeReport("run", "none.html"))
    assert data["shape"] is None and "The page shows 0 of 120 frames." in warnings


def testManyVerticesAndManyRows(results, monkeypatch):
    monkeypatch.setattr(report, "_judge", lambda *_: Verdict())
    large = mh.Mesh.icosphere(6)
    large.vertices *= 2
    mesh = together(large, mh.Mesh.icosphere(6))
    mh.writeMeshTrajectory("run.vtkhdf", [mh.MeshFrame(7, mesh, {})])
    lines = (results / "run.csv").read_text().splitlines()
    (results / "run.csv").write_text(
        "\n".join([lines[0]] + [f"{step}," + lines[1].split(",", 1)[1] for step in range(5000)])
    )
    data = partsOf(writeReport("run"))[0]
    assert data["shape"]["wide"] and np.array_equal(
        decode(data["shape"]["frames"][0]["triangles"], "<u4").reshape(3, -1).T, mesh.triangles
    )
    assert len(data["panels"]["steps"]) == 2000 and data["panels"]["steps"][-1] == 4999


def testWarnings(results):
    pair = together(mh.Mesh.icosphere(2), mh.Mesh.icosphere(2))
    pair.vertices[162:, 0] += 1.01
    pair.write("run.ply")
    for name in ("run.vtkhdf", "run.resolved.toml"):
        (results / name).unlink()
    lines = (results / "run.csv").read_text().splitlines()
    columns = lines[0].split(",")
    bad = dict(
        zip(columns, lines[-1].split(",")),
        **{"step": "2", "energy (kT)": "nan", "acceptance": "0.05", "flipAcceptance": "0.0", "diverged": "3"},
    )
    (results / "run.csv").write_text("\n".join([*lines, ",".join(bad.values())]))
    data, warnings, *_ = partsOf(writeReport("run"))
    for text in (
        "no mesh trajectory run.vtkhdf",
        "no settings run.resolved.toml",
        "passes through itself",
        "not finite numbers: energy",
        "do not ascend",
        "only 5.0% of the trajectories",
        "trajectories diverged",
        "only 0.00% of the flips",
    ):
        assert sum(text in warning for warning in warnings) == 1
    assert len(data["shape"]["frames"]) == 1 and data["panels"]["panels"][0]["curves"][0]["values"][-1] is None


def testPartsThatAreMissing(results):
    (results / "run.csv").rename("other.csv")
    data, warnings, *_ = partsOf(writeReport("run"))
    assert data["panels"] is None and warnings == ["There is no table of observables run.csv."]
    data, warnings, *_ = partsOf(writeReport("other"))
    assert data["shape"] is None and len(warnings) == 2


def testCommand(results):
    result = invoke("run")
    assert result.exit_code == 0 and re.match(r"run_report.html, \d\.\d MB", result.output)
    before = (results / "run_report.html").read_bytes()
    (results / "torn.vtkhdf").write_bytes((results / "run.vtkhdf").read_bytes()[:5000])
    (results / "empty.csv").write_text((results / "run.csv").read_text().splitlines()[0])
    for arguments, message in (
        (("run",), "run_report.html exists already"),
        (("nothing",), "there are no results nothing.vtkhdf"),
        (("torn",), "torn.vtkhdf is not a VTKHDF file"),
        (("empty",), "empty.csv has no rows"),
        (("run", "-o", "nowhere/page.html"), "nowhere"),
    ):
        result = invoke(*arguments)
        assert result.exit_code == 1 and message in result.output and "Traceback" not in result.output
    assert (results / "run_report.html").read_bytes() == before and invoke(
        "run", "--overwrite", "--max-frames", 2
    ).exit_code == 0
    assert [path.name for path in results.glob("*.html")] == ["run_report.html"] and not list(results.glob(".*"))


def testWithoutPlotly(results, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    result = invoke("run")
    assert result.exit_code == 1 and "writing a report needs plotly" in result.output


@pytest.mark.skipif(BROWSER is None, reason="there is no browser")
def testInABrowser(results):
    """The page opens offline at the frame that its address names, without errors, and draws the shape, and a mark for a
    value that no line leads to.
    """
    head, *rows = (results / "run.csv").read_text().splitlines()
    at = head.replace('"', "").split(",").index("acceptance")
    cells = [row.split(",") for row in rows]
    for k, row in enumerate(cells):
        row[at] = "0.0" if k < len(cells) - 1 else "0.5"
    (results / "run.csv").write_text("\n".join([head, *map(",".join, cells)]) + "\n")
    page = writeReport("run", overwrite=True)
    options = [
        "--headless=new",
        "--no-sandbox",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        f"--user-data-dir={results / 'profile'}",
        "--window-size=1300,1000",
        "--virtual-time-budget=30000",
        "--enable-logging=stderr",
    ]

    def browse(option, frame):
        address = f"file://{results / page}#frame={frame}"
        return subprocess.run([BROWSER, *options, option, address], capture_output=True, text=True, timeout=120)

    dom = browse("--dump-dom", 3)
    assert 'data-ready="yes"' in dom.stdout and "step 16, frame 3" in dom.stdout
    assert dom.stdout.count('class="point"') == 1
    assert not [
        line
        for line in dom.stderr.splitlines()
        if "CONSOLE" in line and re.search("error|uncaught", line, re.IGNORECASE)
    ]
    pictures = []
    for frame in (0, 3):
        browse(f"--screenshot={results / 'page.png'}", frame)
        pictures.append(np.asarray(Image.open("page.png").convert("RGB")).astype(int)[100:600, :600])
    for picture in pictures:
        assert (np.ptp(picture, axis=2) > 60).mean() > 0.05, "the shape should be there, in color"
    assert np.abs(pictures[0] - pictures[1]).max() > 50
