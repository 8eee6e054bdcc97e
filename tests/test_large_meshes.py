"""Meshes of many vertices: pictures of a simplified surface, bounded memory, files that are left out."""

import os
import subprocess
import sys

import numpy as np
import pytest
from openmm import app
from typer.testing import CliRunner

import openmmhelfrich as mh
from conftest import together
from openmmhelfrich.cli import app as command
from openmmhelfrich.geometry import connectivity, quality
from openmmhelfrich.pictures import curvature
from openmmhelfrich.pictures.report import writeReport
from openmmhelfrich.runs import defaults
from test_mesh_trajectory import simulate
from test_report import partsOf

BYTES_A_VERTEX = (
    600  # that a check may take above the mesh, where blocks are small; without blocks it takes 800 or more
)
MEASURE = """
import resource, sys
import scipy.sparse.csgraph, scipy.spatial
import openmmhelfrich as mh
from openmmhelfrich.geometry import connectivity, quality

mesh = mh.Mesh.read(sys.argv[1])
quality.BLOCK = connectivity.BLOCK = 1 << 13
pages = int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + int(sys.argv[2]) * len(mesh.vertices),) * 2)
mesh.check()
quality._shapes(mesh), quality.closestPair(mesh), quality.crossings(mesh, quality.BLOCK)
print(len(mesh.vertices))
"""


def roughMesh(subdivisions):
    mesh = mh.Mesh.icosphere(subdivisions)
    noise = np.random.default_rng(3).normal(scale=0.05 * mesh.edgeLengths.mean(), size=mesh.vertices.shape)
    return mh.Mesh(mesh.vertices + noise, mesh.triangles)


# --- blocks


@pytest.mark.parametrize("size", [1, 7, 300])
def testBlocksChangeNoBit(monkeypatch, size):
    mesh = roughMesh(3)

    def everything():
        described = quality.assess(mesh)
        return [
            mesh.edgeLengths.tobytes(),
            mesh.triangleAreas.tobytes(),
            mesh.vertexMeanCurvatures.tobytes(),
            mesh.volume,
            described.angles.tobytes(),
            described.aspectRatios.tobytes(),
            described.lines(),
        ]

    expected = everything()
    monkeypatch.setattr(connectivity, "BLOCK", size)
    assert everything() == expected


@pytest.mark.parametrize("size", [30, 100, 1000])
def testSlabsFindEveryPair(size):
    """Spheres whose radii differ by much: the pairs that touch are those that all distances tell."""
    generator = np.random.default_rng(4)
    middles, radii = generator.normal(size=(700, 3)) * [3, 1, 1], 0.1 * np.exp(generator.normal(size=700))
    columns = np.ascontiguousarray(middles.T)
    found = np.sort(np.concatenate(list(quality._touching(columns, radii, size)), axis=1), axis=0).T
    a, b = np.triu_indices(700, 1)
    touches = np.linalg.norm(middles[a] - middles[b], axis=1) <= radii[a] + radii[b]
    assert len(found) == len(np.unique(found, axis=0)) == touches.sum() > 500
    assert set(map(tuple, found.tolist())) == set(zip(a[touches].tolist(), b[touches].tolist()))


def testVerticesOfManyNeighbors():
    """Two poles that share 300 neighbors are near to each other, however many ways lead from one to the other."""
    angle = 2 * np.pi * np.arange(300) / 300
    ring = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(300)))
    i, j = np.arange(300), np.roll(np.arange(300), -1)
    mesh = mh.Mesh(
        np.concatenate((ring, [[0, 0, 0.01], [0, 0, -0.01]])),
        np.concatenate((np.column_stack((i, j, 0 * i + 300)), np.column_stack((j, i, 0 * i + 301)))),
    )
    assert quality.closestPair(mesh) is None or quality.closestPair(mesh)[2] > 0.03


@pytest.mark.skipif(sys.platform != "linux", reason="it reads /proc, and address space is not limited elsewhere")
def testMemory(tmp_path):
    """What `check` computes of 163,842 vertices, under a limit."""
    roughMesh(7).write(tmp_path / "large.ply")
    result = subprocess.run(
        [sys.executable, "-c", MEASURE, str(tmp_path / "large.ply"), str(BYTES_A_VERTEX)],
        capture_output=True,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )
    assert result.stdout == "163842\n", result.stderr


@pytest.mark.parametrize("count", [1, 2])
def testASceneMeasuresAMeshOnce(monkeypatch, count):
    """Each of its surfaces, and all edges."""
    meshes = [mh.Mesh.icosphere(1) for _ in range(count)]
    for i, mesh in enumerate(meshes):
        mesh.vertices[:, 0] += 3 * i
    mesh, calls = together(*meshes), []

    def counted(name):
        compute = getattr(connectivity, name)
        return lambda *arguments: (calls.append(name), compute(*arguments))[1]

    expected = {"signedVolume": count, "triangleAreas": count, "pairHalfedges": count, "edgeLengthsOf": 1}
    for name in expected:
        monkeypatch.setattr(connectivity, name, counted(name))
    mh.Scene.of({"sampling": {"step_size": "auto"}, "membrane": {"area_difference_modulus": 1.0}}, mesh)
    assert {name: calls.count(name) for name in expected} == expected


# --- pictures


def testSimplifiedSurface(monkeypatch):
    """A sphere and a smaller one: their shapes, and the curvature, 1/R, of the vertices that became one."""
    monkeypatch.setattr(curvature, "MAX_VERTICES", 5000)
    monkeypatch.setattr(curvature, "SIMPLIFIED", 1500)
    small = mh.Mesh.icosphere(4, radius=0.5)
    small.vertices[:, 0] += 3
    mesh = together(mh.Mesh.icosphere(5), small)
    surface, colors = curvature.shownSurface(mesh)
    assert 1000 < len(surface.vertices) < 2000
    isLarge = surface.vertices[:, 0] < 2
    assert np.linalg.norm(surface.vertices[isLarge], axis=1) == pytest.approx(1, abs=0.01)
    assert colors[isLarge] == pytest.approx(1, rel=0.02) and colors[~isLarge] == pytest.approx(2, rel=0.02)
    assert surface.volume == pytest.approx(mesh.volume, rel=0.01)
    assert curvature.simplification(mesh, surface) == f"simplified to {len(surface.vertices)} of 12804 vertices"
    same, _ = curvature.shownSurface(small)
    assert same is small and curvature.simplification(small, same) is None


@pytest.mark.parametrize("triangles", [9000, 600])
def testWhichVertexEachBecame(triangles):
    """As the library tells it, also where small membranes vanish."""
    import fast_simplification

    parts = [mh.Mesh.icosphere(1) for _ in range(400)]
    for i, part in enumerate(parts):
        part.vertices += [3 * (i % 20), 3 * (i // 20), 0]
    mesh = together(*parts)
    points, _, collapses = fast_simplification.simplify(
        mesh.vertices, mesh.triangles, target_count=triangles, return_collapses=True
    )
    *_, expected = fast_simplification.replay_simplification(mesh.vertices, mesh.triangles, collapses)
    became = curvature._survivors(len(mesh.vertices), collapses)
    assert (expected.min() < 0) == (triangles == 600) == (became.max() >= len(points))
    assert np.array_equal(became, expected) or triangles == 600


def testManySmallMembranes(monkeypatch):
    """Some vanish from the picture; the others have their curvature."""
    monkeypatch.setattr(curvature, "MAX_VERTICES", 5000)
    monkeypatch.setattr(curvature, "SIMPLIFIED", 300)
    parts = [mh.Mesh.icosphere(1) for _ in range(400)]
    for i, part in enumerate(parts):
        part.vertices += [3 * (i % 20), 3 * (i // 20), 0]
    surface, colors = curvature.shownSurface(together(*parts))
    assert 0 < len(surface.vertices) < 4000 and len(colors) == len(surface.vertices) and np.all(np.isfinite(colors))


def testReportOfALargeMesh(inFolder, monkeypatch):
    """Its frames are simplified, and the page says so."""
    monkeypatch.setattr(curvature, "MAX_VERTICES", 2000)
    monkeypatch.setattr(curvature, "SIMPLIFIED", 1000)
    mesh = mh.Mesh.icosphere(4)
    mh.writeMeshTrajectory("run.vtkhdf", [mh.MeshFrame(i, mesh, {}) for i in range(3)])
    data, warnings, facts, _ = partsOf(writeReport("run"))
    assert facts["membrane"] == "2562 vertices, 5120 triangles" and len(data["shape"]["frames"]) == 3
    assert any("simplified to 1002 of 2562 vertices" in warning for warning in warnings)


# --- files and objects


def testTopologyIsMadeLater():
    """Atoms, residues and bonds are there for whoever asks, and only then."""
    mesh = together(mh.Mesh.icosphere(1), mh.Mesh.icosphere(0))
    topology = mesh.topology()
    assert topology.getNumAtoms() == 54 and "_bonds" not in vars(topology)
    mesh.triangles[:] = 0  # no longer its business
    assert topology.getNumBonds() == 120 + 30 and topology.getNumResidues() == 2 and topology.getNumAtoms() == 54
    assert isinstance(topology, app.Topology) and [atom.index for atom in topology.atoms()] == list(range(54))
    with pytest.raises(AttributeError, match="nothing"):
        topology.nothing  # noqa: B018


def testTopologyOfASimulation(inFolder, sphere):
    """Neither a Simulation nor a DCD file makes the objects."""
    simulation, _ = simulate(sphere)
    simulation.reporters.append(app.DCDReporter("run.dcd", 1))
    simulation.step(2)
    assert (inFolder / "run.dcd").exists() and "_chains" not in vars(simulation.topology)


@pytest.mark.parametrize("psf, isThere", [(None, False), (True, True), (False, False)])
def testPSF(inFolder, monkeypatch, psf, isThere):
    """Large membranes have none unless it is asked for, which is said; a run that goes on keeps to it."""
    monkeypatch.setattr(defaults, "MAX_PSF_VERTICES", 100)
    output = {"prefix": "run", **({} if psf is None else {"psf": psf})}
    summary = mh.run({"mesh": {"icosphere": 2}, "sampling": {"steps": 2, "steps_per_trajectory": 2}, "output": output})
    assert (inFolder / "run.psf").exists() == isThere and summary.config.output.psf is isThere
    assert any("psf = true" in text for _, text in summary.lines()) != isThere
    monkeypatch.undo()
    os.chdir(inFolder)
    mh.resume("run", steps=1)
    assert (inFolder / "run.psf").exists() == isThere
    result = CliRunner().invoke(command, ["resume", "run"])
    assert result.exit_code == 1 and "complete" in result.output
