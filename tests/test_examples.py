import re
import subprocess
import sys

import mdtraj
import numpy as np
import pytest

import openmmhelfrich as mh
from conftest import ROOT
from openmmhelfrich.pictures.rendering import canRender
from openmmhelfrich.runs.config import readConfig
from openmmhelfrich.runs.studies import run


def execute(folder, *arguments):
    done = subprocess.run([sys.executable, *map(str, arguments)], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def testVesicle(tmp_path, examples):
    script = examples / "vesicle.py"
    assert len(script.read_text().splitlines()) <= 40
    out = execute(tmp_path, script)
    trajectory = mdtraj.load_dcd(str(tmp_path / "vesicle.dcd"), top=str(tmp_path / "vesicle.psf"))
    assert trajectory.n_frames == 50 and trajectory.n_atoms == 642 and trajectory.topology.n_bonds == 1920
    names, *rows = [line.split(",") for line in out.splitlines() if "," in line and not line.startswith("area")]
    reducedVolume = [float(row[names.index("reducedVolume")]) for row in rows]
    assert reducedVolume[-1] == pytest.approx(0.8, rel=0.02) and reducedVolume[0] > 0.9
    assert 0.3 < float(rows[-1][names.index("acceptance")]) < 1


needsPictures = pytest.mark.skipif(not canRender(), reason="there is no pyvista, or nothing that it could draw with")


@needsPictures
def testFromBlender(tmp_path, examples):
    out = execute(tmp_path, examples / "blender.py", "--vertices", 300, "--steps", 30)
    assert "faces were divided into triangles: 448 of 4 corners" in out and "remeshed: 300 vertices" in out
    assert len(mh.Mesh.read(tmp_path / "blender/sphere.obj").vertices) == 482
    mh.Mesh.read(tmp_path / "blender/sphere.ply").check()
    assert (tmp_path / "blender/blender.png").stat().st_size > 10000


@needsPictures
def testFromASegmentation(tmp_path, examples):
    distance = np.sqrt(((np.mgrid[:24, :24, :24] - 11.5) ** 2).sum(axis=0))
    labels = distance < 9
    labels[1:3, 1:3, 1:3] = True
    np.save(tmp_path / "labels.npy", labels)
    options = ["--voxels", "labels.npy", "--voxel-size", 2, "--vertices", 300, "--steps", 30]
    out = execute(tmp_path, examples / "segmentation.py", *options)
    assert "remeshed: 300 vertices" in out and "accepted: " in out
    final = mh.Mesh.read(tmp_path / "segmentation/cell.ply")
    assert final.volume == pytest.approx(4 / 3 * np.pi * 18**3, rel=0.1)
    assert (tmp_path / "segmentation/segmentation.png").stat().st_size > 10000


def testRedBloodCell(tmp_path, examples):
    config = readConfig(examples / "red_blood_cell.toml")
    config.sampling.steps, config.sampling.seed, config.output.prefix = 60, 1, str(tmp_path / "cell")
    summary = run(config)
    assert summary.numVertices == 2562 and config.membrane.bending_modulus == 20
    assert 134 < summary.mean("area") < 136 and 93 < summary.mean("volume") < 96
    assert summary.drift("area") < 0.01 and summary.drift("volume") < 0.01
    assert 0.3 < summary.acceptance <= 1 and 0.02 < summary.flipAcceptance < 1
    trajectory = mdtraj.load_dcd(str(summary.outputs.trajectory), top=str(summary.outputs.topology))
    assert trajectory.topology.n_bonds == 7680 and np.ptp(trajectory.xyz[-1], axis=0).max() == pytest.approx(
        7.9, abs=0.4
    )
    mh.Mesh.read(summary.outputs.mesh).check()


def runSmall(file, prefix, **steps):
    """Do the run of a configuration with stages on a sphere of 162 vertices, with fewer steps in each stage."""
    config = readConfig(file)
    (
        config.mesh.icosphere,
        config.output.prefix,
        config.sampling.steps_per_trajectory,
        config.output.trajectory_interval,
    ) = 2, str(prefix), 50, 20
    for stage in config.stages:
        for name, value in steps[stage.kind].items():
            setattr(stage, name, value)
    return run(config)


def testStomatocyte(tmp_path, examples):
    """At this size and haste it is a dented sphere: turned inwards, deflated and cold."""
    summary = runSmall(
        examples / "stomatocyte.toml",
        tmp_path / "a",
        **{"continue": {"windows": 10, "equilibration": 100}, "anneal": {"steps": 300}, "sample": {"steps": 100}},
    )
    assert summary.mean("reducedVolume") == pytest.approx(0.55, abs=0.05) and summary.mean("areaDifference") < 20
    assert list(np.unique(summary.table["stage"])) == [1, 2, 3] and summary.table["temperature"][-1] == 3
    assert summary.mean("E_bending") < summary.table["E_bending"][summary.table["stage"] == 1][-1], (
        "it should have relaxed"
    )
    with mh.readMeshTrajectory(summary.outputs.meshTrajectory) as frames:
        assert not np.array_equal(frames[0].mesh.triangles, frames[-1].mesh.triangles)


def testHysteresis(tmp_path, examples):
    summary = runSmall(
        examples / "hysteresis.toml",
        tmp_path / "a",
        **{
            "continue": {"windows": 3, "equilibration": 50, "steps": 50},
            "anneal": {"steps": 200},
            "sample": {"steps": 200},
        },
    )
    windows = mh.readObservables(summary.outputs.path)
    assert (
        list(windows["window"]) == list(range(7))
        and windows["reducedVolume"][3] < 0.75 < 0.85 < windows["reducedVolume"][[0, 6]].min()
    )


def testStudiesScript(tmp_path, examples):
    lines = execute(tmp_path, examples / "studies.py", 2, 30).splitlines()
    assert [float(line[7:11]) for line in lines[1:-1]] == [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0]
    assert lines[0].startswith("step size") and lines[-1].startswith("at 3.0 K")


def testFluctuations(tmp_path, examples):
    """At this size and length it shows that the parts fit together; test_analysis.py has the known answers."""
    lines = execute(tmp_path, examples / "fluctuations.py", 300, 2).splitlines()
    modulus, error, continuous = map(
        float, re.match(r"l = 2 to 6: kappa = (\S+) \+- (\S+) kT.* continuous (\S+) \+-", lines[2]).groups()
    )
    assert 0 < error < 3 and abs(modulus - 20) < 3 * error and continuous < 0.8 * modulus
    assert (tmp_path / "fluctuations.png").stat().st_size > 10000


def testBoltzmann(tmp_path, examples):
    """The same run, done in one go and in two, prints the same table.

    It is too short for its numbers to mean much; test_reweighting.py has the known answers.
    """
    (tmp_path / "parts").mkdir()
    whole = execute(tmp_path, examples / "boltzmann.py", 40, 1, 2)
    execute(tmp_path / "parts", examples / "boltzmann.py", 24, 1)
    assert execute(tmp_path / "parts", examples / "boltzmann.py", 40, 1) == whole
    rows = np.array([line.split() for line in whole.splitlines()[1:9]], dtype=float)
    assert rows.shape == (8, 9) and np.all(np.isfinite(rows)) and np.all(np.diff(rows[:, 1]) > 0)
    assert (tmp_path / "boltzmann.png").stat().st_size > 10000


def testFluidity(tmp_path, examples):
    """Without flips vertices go nowhere, and with more of them further."""
    names, *rows = [line.split(",") for line in execute(tmp_path, examples / "fluidity.py", 800, 2).splitlines()]
    rows = np.array(rows, dtype=float)
    fraction, flipRate, acceptance, forbidden, perStep, error, perSweep = rows.T[:7]
    assert names[:3] == ["fraction", "flipRate", "acceptance"] and list(fraction) == [0, 0.01, 0.03, 0.1, 0.3, 1]
    assert flipRate == pytest.approx(fraction * acceptance, rel=0.05) and np.allclose(perSweep, 2 * perStep, rtol=0.02)
    assert perStep[-1] > 5 * error[-1] and perStep[-1] > 2 * abs(perStep[0])


def testRedBloodCellScript(tmp_path, examples):
    assert "2562 vertices, area 134.09 um^2" in execute(tmp_path, examples / "red_blood_cell.py", tmp_path / "cell.stl")
    assert mh.Mesh.read(tmp_path / "cell.stl").area == pytest.approx(134.09, rel=1e-3)


def testScriptOfTheReadme(tmp_path):
    (script,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    (tmp_path / "script.py").write_text(script)
    execute(tmp_path, "script.py")
    frames = mh.readMeshTrajectory(tmp_path / "vesicle.vtkhdf")
    assert len(frames) > 10 and frames[-1].mesh.reducedVolume == pytest.approx(0.8, abs=0.01)
    assert (tmp_path / "vesicle.png").stat().st_size > 10000


def testScriptOfReplicaExchange(tmp_path):
    """A fair part of the exchanges between neighbors succeeds."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/how-to/free-energies.md").read_text(), re.DOTALL)
    (tmp_path / "script.py").write_text("\n".join(blocks))
    sections = "[mesh]\nicosphere = 2\n[sampling]\nsteps = 20\n[output]\ntrajectory_interval = 5\n"
    (tmp_path / "vesicle.toml").write_text(sections)
    rates = [float(rate) for rate in execute(tmp_path, "script.py").splitlines()[0].strip(" []").split()]
    assert len(rates) == 3 and 0.1 < min(rates) <= max(rates) < 0.7
    assert (tmp_path / "exchange.zip").stat().st_size > 10000


def testBeads(tmp_path, examples):
    lines = execute(tmp_path, examples / "beads.py", 2, 20).splitlines()
    assert any("1 bead, " in line and "fixed vert" in line for line in lines)
    numbers = re.findall(r"(\d\.\d\d) nm", lines[-1])
    assert len(numbers) == 2 and min(map(float, numbers)) > 2.1  # of a sphere it is 2
    assert (tmp_path / "beads_pulled.png").stat().st_size > 5000


def testLooking(tmp_path, examples):
    lines = execute(tmp_path, examples / "looking.py", 20).splitlines()
    assert len(lines) == 10 and lines[-1].startswith("step 20: reduced volume 0.9")
    assert {path.name for path in tmp_path.iterdir()} == {"looking.vtkhdf", "looking.ply", "looking.png"}
    assert np.array_equal(
        mh.Mesh.read(tmp_path / "looking.ply").triangles,
        mh.readMeshTrajectory(tmp_path / "looking.vtkhdf")[-1].mesh.triangles,
    )


@needsPictures
@pytest.mark.parametrize("kind", ["volume", "area-difference"])
def testPhaseDiagrams(tmp_path, examples, kind):
    """The results of a sweep of two points are drawn, whatever their volumes, one of them cut open."""
    names = "variant,reduced_volume,target_area_difference,status,verdict,steps,shapeClass,E_bending/8 pi kappa"
    rows = [
        "oblate,0.6,1.1,done,good,10,oblate,1.9,0.6,1.04,a",
        "stomatocyte,0.6,0.5,done,good,10,stomatocyte,2,0.6,0.5,b",
    ]
    (tmp_path / "grid").mkdir()
    (tmp_path / "grid/summary.csv").write_text(
        "\n".join([f"{names},reducedVolume,reducedAreaDifference,folder", *rows])
    )
    for folder in "ab":
        (tmp_path / "grid" / folder).mkdir()
        mh.spheroid(162, 0.5).write(tmp_path / "grid" / folder / "run.ply")
    execute(tmp_path, examples / "phase_diagrams.py", kind, "grid")
    assert (tmp_path / "grid_shapes.png").stat().st_size > 5000
