"""The pages for those who come from other programs: their commands run as they stand, and their factors are right."""

import re
import shlex
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
from typer.testing import CliRunner

import openmmhelfrich as mh
from conftest import ROOT
from openmmhelfrich.cli import app
from openmmhelfrich.runs.config import parseConfig, tomllib

PAGES = ROOT / "docs/how-to"
TRIMEM = """\
[GENERAL]
algorithm = minimize
input = inp.stl
[BONDS]
bond_type = Edge
[SURFACEREPULSION]
lc1 = 0.0
[ENERGY]
kappa_c = 0.0
[MINIMIZATION]
maxiter = 5
"""


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", (PAGES / page).read_text(), re.DOTALL)


@pytest.mark.parametrize("page", ["from-trimem.md", "from-freedts.md", "from-mosaic.md"])
def testCommands(inFolder, page):
    """Each command works after those before it, in a folder with the files that the page begins with."""
    sphere = mh.Mesh.icosphere(2)
    for file in ("inp.stl", "vesicle.tsi", *(["cell.ply"] if page != "from-trimem.md" else [])):
        sphere.write(file)
    Path("inp.conf").write_text(TRIMEM)
    runner, count = CliRunner(), 0
    with mh.readMeshTrajectory(_trajectory(sphere)) as frames:
        assert len(frames) == 2
    for command in [line for block in blocks(page, "bash") for line in block.splitlines()]:
        program, *arguments = shlex.split(command)
        if program != "openmm-helfrich":
            continue  # of the script that test_mcapp.py runs
        words, _, out = " ".join(arguments).partition(" > ")
        result = runner.invoke(app, words.split())
        assert result.exit_code == 0, f"{command}: {result.output}"
        if out:
            Path(out).write_text(result.stdout)
        count += 1
    assert count >= 2


def _trajectory(mesh):
    mh.writeMeshTrajectory("run.vtkhdf", [mh.meshFrame(i, mesh) for i in range(2)])
    return "run.vtkhdf"


@pytest.mark.parametrize("page", ["from-freedts.md", "from-mosaic.md"])
def testConfigurationsAndScripts(inFolder, page):
    """Configurations run, and scripts too."""
    sphere = mh.Mesh.icosphere(3, 8.6)
    rough = sphere.vertices + np.random.default_rng(1).normal(scale=0.1, size=sphere.vertices.shape)
    mh.Mesh(rough, sphere.triangles).write("vesicle.q")
    assert mh.Mesh.read("vesicle.q").edgeLengths.min() < 1
    mh.Mesh.icosphere(3, 280).write("mesh_equilibrated.stl")
    for text in blocks(page, "toml"):
        data = tomllib.loads(text)
        isMinimization = "stages" in data
        steps = {} if isMinimization else {"steps": 3, "steps_per_trajectory": 10}
        data.setdefault("sampling", {}).update(steps, seed=1, approach="none")
        summary = mh.run(parseConfig({**data, "output": {"prefix": "a", "overwrite": True}}))
        assert summary.steps == (1 if isMinimization else 3)
        if isMinimization:  # FreeDTS takes it
            lengths = mh.Mesh.read("a.ply").edgeLengths
            assert lengths.min() > 1 and lengths.max() < np.sqrt(3)
    for text in blocks(page, "python"):
        exec(compile(text, page, "exec"), {})


def freeDTS(mesh, K, gamma=None, v=None, C=None):
    """Return the energy of a coupling of FreeDTS, as its sources have it."""
    area, curvature = mesh.area, 2 * mesh.vertexMeanCurvatures.sum()
    if gamma is not None:
        return K * len(mesh.triangles) / 2 * (area / freeDTSArea(mesh, gamma) - 1) ** 2
    if v is not None:
        return K / 2 * (mesh.volume / (area**1.5 / (6 * np.sqrt(np.pi))) - v) ** 2
    return K / (2 * area) * (curvature - C * area) ** 2


def freeDTSArea(mesh, gamma):
    return (1 + 2 * gamma) * len(mesh.triangles) * np.sqrt(3) / 4


def testFactorsOfFreeDTS():
    """The table's moduli give FreeDTS's energies, those of volume and area difference where the area is the target."""
    sphere = mh.Mesh.icosphere(2)
    K, gamma, v, C = 700.0, 0.3, 0.8, 2.3
    mesh = mh.Mesh(sphere.vertices * [1, 1.1, 1.5], sphere.triangles)
    scale = np.sqrt(freeDTSArea(mesh, gamma) / mesh.area)
    for factor in (scale, 1.03 * scale):
        shape = mh.Mesh(factor * mesh.vertices, mesh.triangles)
        force = mh.HelfrichForce()
        force.setTriangles(shape.triangles)
        target = freeDTSArea(shape, gamma)
        force.setAreaModulus(K * len(shape.triangles) / 2)
        force.setTargetArea(target)
        force.setVolumeModulus(K * v**2 / 2)
        force.setTargetVolume(v * target**1.5 / (6 * np.sqrt(np.pi)))
        force.setAreaDifferenceModulus(K * C**2 * target / 2)
        force.setTargetAreaDifference(C * target)
        system = shape.createSystem()
        system.addForce(force)
        context = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference"))
        context.setPositions(shape.vertices)
        terms = {name: value._value for name, value in force.getEnergyTermsInContext(context).items()}
        assert terms["area"] == pytest.approx(freeDTS(shape, K, gamma=gamma), abs=1e-6)
        if factor == scale:
            assert terms["volume"] == pytest.approx(freeDTS(shape, K, v=v), rel=1e-9)
            assert terms["areaDifference"] == pytest.approx(freeDTS(shape, K, C=C), rel=1e-9)


def testThePageHasTheNumbers():
    """The input file that the page translates: its numbers by the table."""
    (text,) = (block for block in blocks("from-freedts.md", "toml") if "stages" not in block)
    data, mesh = tomllib.loads(text), mh.Mesh.icosphere(3)
    assert data["membrane"]["area_modulus"] == 1000 * len(mesh.triangles) / 2
    assert data["membrane"]["target_area"] == pytest.approx(freeDTSArea(mesh, 0.34), rel=1e-5)
    assert data["membrane"]["volume_modulus"] == pytest.approx(10000 * 0.7**2 / 2)
    assert data["tether"]["max_length"] == pytest.approx(np.sqrt(3)) and data["tether"]["min_length"] == 1


def testTheTableOfKeysIsWhole():
    """The page on TriMem has every key of TriMem's default configuration."""
    keys = (
        "input output_prefix info checkpoint_every output_format restart_prefix algorithm bond_type r lc0 lc1 n_search "
        "rlist exclusion_level refresh kappa_b kappa_a kappa_v kappa_c kappa_t kappa_r area_fraction volume_fraction "
        "curvature_fraction continuation_delta continuation_lambda num_steps init_step step_size traj_steps "
        "momentum_variance thin flip_ratio flip_type initial_temperature cooling_factor start_cooling maxiter out_every"
    )
    page = (PAGES / "from-trimem.md").read_text()
    assert not [key for key in keys.split() if not re.search(rf"`[^`]*\b{key}\b", page)]
