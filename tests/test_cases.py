"""Files as users have them, in tests/data/cases: each is read as what it is, in Python and by the command."""

import re
import shutil
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit
from typer.testing import CliRunner

import openmmhelfrich as mh
from conftest import together
from membranes import flipped
from openmmhelfrich.cli import app as command
from openmmhelfrich.geometry.atomnames import nameOf, orderOfBonds
from openmmhelfrich.pictures.curvature import smoothMeanCurvature

CASES = Path(__file__).resolve().parent / "data" / "cases"
DIALECTS = (
    "obj_texture_normals ply_face_properties ply_vertex_index vtk_polydata vtu_own_section off_dialects stl_dialects"
)
ICOSAHEDRA = [
    f"{folder}/{file.name}" for folder in [*DIALECTS.split(), "freedts"] for file in sorted((CASES / folder).iterdir())
]


def invoke(*arguments):
    return CliRunner().invoke(command, list(map(str, arguments)))


def measured(mesh):
    return len(mesh.vertices), len(mesh.triangles), round(mesh.area, 4), round(mesh.volume, 4)


@pytest.mark.parametrize("name", ICOSAHEDRA)
def testIcosahedra(name):
    mesh = mh.Mesh.read(CASES / name)
    mesh.check()
    assert len(mesh.vertices) == 12 and len(mesh.triangles) == 20
    assert mesh.area == pytest.approx(9.574541, rel=1e-6) and mesh.volume == pytest.approx(2.536151, rel=1e-6)
    assert mesh.notes == (["bytes after the last facet were left out: 1"] if "bytes_after" in name else [])
    if "freedts" in name:
        assert mesh.vertices.mean(axis=0) == pytest.approx([5, 5, 5]) and np.array_equal(mesh.box, 10 * np.eye(3))
    assert mesh.repaired().notes == mesh.notes


@pytest.mark.parametrize("name", ["obj_texture_normals/vt_vn.obj", "vtk_polydata/polydata.vtp", "freedts/vesicle.tsi"])
def testIcosahedraByTheCommand(name):
    done = invoke("check", CASES / name)
    assert done.exit_code == 0 and "12 vertices, 30 edges, 20 triangles" in done.output and "9.5745" in done.output


def testCornersThatDifferInTheLastBit():
    mesh = mh.Mesh.read(CASES / "stl_last_bit/last_bit.stl")
    mesh.check()
    assert measured(mesh) == (42, 80, 11.6659, 3.6587)
    assert mesh.notes == ["174 corners were welded to another that is closer than 1e-06"]
    assert "174 corners were welded" in invoke("check", CASES / "stl_last_bit/last_bit.stl").output


def testQuads():
    mesh = mh.Mesh.read(CASES / "quads/cube.obj")
    mesh.check()
    assert measured(mesh) == (8, 12, 6, 1)
    assert mesh.notes == ["faces were divided into triangles: 6 of 4 corners"]
    assert "6 of 4 corners" in invoke("check", CASES / "quads/cube.obj").output


def testConversionSaysWhatReadingDid(inFolder):
    done = invoke("convert", CASES / "quads/cube.obj", "a.ply")
    assert done.output.splitlines() == ["faces were divided into triangles: 6 of 4 corners", "a.ply"]
    assert invoke("convert", "a.ply", "b.stl").output.splitlines() == ["b.stl"]


def testInsideOut(inFolder):
    source = CASES / "inside_out/inside_out.stl"
    refused = invoke("check", source)
    assert refused.exit_code == 1 and "inside out" in refused.output and "'openmm-helfrich repair'" in refused.output
    for mesh in (mh.Mesh.read(source, repair=True), mh.Mesh.read(source).reversed(), mh.Mesh.read(source).repaired()):
        mesh.check()
        assert measured(mesh) == (42, 80, 11.6659, 3.6587)
    for options in ([], ["--reverse"]):
        assert invoke("repair", source, "a.stl", "--overwrite", *options).exit_code == 0
        assert invoke("check", "a.stl").exit_code == 0


def testFoldedIntoABox(inFolder):
    source = CASES / "inside_out/periodic_box.vtu"
    refused = invoke("check", source)
    assert refused.exit_code == 1 and "edges are nearly as long as the mesh along x" in refused.output
    with pytest.raises(ValueError, match="folded into a periodic box; the lengths of the box must be given"):
        mh.Mesh.read(source, repair=True)
    assert invoke("repair", source, "a.vtu", "--box", 4).exit_code == 0
    assert mh.Mesh.read("a.vtu").volume == pytest.approx(mh.Mesh.icosphere(2).volume, rel=1e-6)


def testFacetWithoutArea(inFolder):
    source = CASES / "degenerate_facet/degenerate_facet.stl"
    refused = invoke("check", source)
    assert refused.exit_code == 1 and "the same vertex twice" in refused.output and "repair" in refused.output
    mesh = mh.Mesh.read(source, repair=True)
    mesh.check()
    assert measured(mesh) == (12, 20, 9.5745, 2.5362) and mesh.notes == ["1 facet without area was taken away"]
    assert "1 facet without area was taken away" in invoke("repair", source, "a.stl").output


def testConfigurationWithAByteOrderMark(inFolder):
    shutil.copy(CASES / "windows_text/bom.toml", "bom.toml")
    assert Path("bom.toml").read_bytes().startswith(b"\xef\xbb\xbf")
    assert invoke("run", "bom.toml").exit_code == 0


# --- triangles that are flat


def ofTheForce(mesh, platform="Reference"):
    """Return the curvatures and areas of the vertices as the force has them."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(1)
    system = mesh.createSystem()
    system.addForce(force)
    context = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform(platform))
    context.setPositions(mesh.vertices)
    geometry = force.getGeometryInContext(context)
    return np.asarray(geometry.vertexMeanCurvatures._value), np.asarray(geometry.vertexAreas._value)


def collapsed():
    """Return meshes on a lattice, where rounding makes no sign: with triangles on a line, in a point, and folded.

    The force takes no edge whose ends are in one place, and so none of the second.
    """
    cube = mh.Mesh.read(CASES / "quads/cube.obj")
    onLine, inPoint = (mh.Mesh(cube.vertices, cube.triangles) for _ in range(2))
    onLine.vertices[0] = (cube.vertices[1] + cube.vertices[2]) / 2
    inPoint.vertices[[1, 2]] = inPoint.vertices[0]
    rim = [(0, 1), (1, 2), (2, 3), (3, 0)]
    folded = mh.Mesh(
        [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 0), (0, 0, 0)],
        [t for a, b in rim for t in ((a, b, 4), (b, a, 5))],
    )
    return [onLine, inPoint, folded]


@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def testCurvatureIsThatOfTheForceAlsoWhereTrianglesAreFlat(platform):
    for mesh in [mh.Mesh.read(CASES / "voxel_ball/voxel_ball.stl"), *collapsed()[::2]]:
        curvatures, areas = ofTheForce(mesh, platform)
        assert np.all(np.isfinite(mesh.vertexMeanCurvatures))
        assert mesh.vertexMeanCurvatures == pytest.approx(curvatures, rel=1e-9, abs=1e-9)
        assert mesh.vertexAreas == pytest.approx(areas, rel=1e-9, abs=1e-12)


def testPicturesOfFlatTriangles(inFolder):
    for mesh in collapsed():
        assert np.all(np.isfinite(smoothMeanCurvature(mesh)))
        assert np.all(np.isfinite(mh.meshFrame(0, mesh).data["MeanCurvature"]))
        mesh.write("a.ply")
        assert invoke("render", "a.ply", "--overwrite").exit_code == 0
        with pytest.raises(ValueError, match=r"has no area|inside out|is flat|same vertex"):
            mesh.check()


def testRunOfABallOfVoxels(inFolder):
    for file in (CASES / "voxel_ball").iterdir():
        shutil.copy(file, file.name)
    done = invoke("run", "voxel_ball.toml", "--steps", 20)
    assert done.exit_code == 0 and "nan" not in done.output.lower()
    table = mh.readObservables("voxel_ball.csv")
    assert all(np.all(np.isfinite(table[name])) for name in ("area", "volume", "energy"))


def torus(n=24, m=12):
    u, v = (2 * np.pi * k.ravel() for k in np.meshgrid(np.arange(n) / n, np.arange(m) / m, indexing="ij"))
    ring = 2 + 0.7 * np.cos(v)
    vertices = np.column_stack((ring * np.cos(u), ring * np.sin(u), 0.7 * np.sin(v)))
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a, b, c, d = (((i + p) % n) * m + (j + q) % m for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return mh.Mesh(vertices, np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))))


def testHandlesAreNamed(sphere):
    ring = torus()
    ring.check()
    assert mh.classifyShape(ring) == "genus 1" and mh.describeShape(ring).shapeClass == "genus 1"
    assert mh.classifyShape(together(ring, mh.Mesh(ring.vertices + 9, ring.triangles))) == "genus 2"
    assert mh.classifyShape(mh.Mesh([*sphere.vertices, (9, 9, 9)], sphere.triangles)) == "sphere"


# --- OpenMM's own files


def bondsOf(topology):
    return {tuple(sorted((a.index, b.index))) for a, b in topology.bonds()}


@pytest.mark.parametrize("make", [lambda: mh.Mesh.icosphere(2), lambda: mh.spheroid(700, 0.6), torus])
def testFilesOfOpenMMKeepAtomsAndBonds(tmp_path, make):
    mesh = make()
    mesh = together(mesh, mh.Mesh(mesh.vertices + 10, mesh.triangles))
    topology, edges = mesh.topology(), set(map(tuple, mesh.edges.tolist()))
    assert len({atom.name for atom in topology.atoms()}) == len(mesh.vertices)
    for kind, name in ((app.PDBFile, "a.pdb"), (app.PDBxFile, "a.cif")):
        with open(tmp_path / name, "w") as file:
            kind.writeFile(topology, mesh.vertices * unit.nanometer, file)
        again = kind(str(tmp_path / name))
        assert again.topology.getNumAtoms() == len(mesh.vertices) and again.topology.getNumResidues() == 2
        assert again.topology.getNumBonds() == len(edges) and bondsOf(again.topology) == edges
        positions = np.array(again.positions.value_in_unit(unit.nanometer))
        assert positions == pytest.approx(mesh.vertices, abs=1e-3)


def testFilesOfMoreAtomsThanPDBHoldsKeepAtomsAndBonds(tmp_path):
    """A PDB file has room for 99,999 atoms, PDBx/mmCIF for any number."""
    mesh = torus(1001, 100)
    topology, edges = mesh.topology(), set(map(tuple, mesh.edges.tolist()))
    with open(tmp_path / "a.cif", "w") as file:
        app.PDBxFile.writeFile(topology, mesh.vertices * unit.nanometer, file)
    again = app.PDBxFile(str(tmp_path / "a.cif")).topology
    assert again.getNumAtoms() == len(mesh.vertices) == 100100
    assert again.getNumBonds() == len(edges) == 300300 and bondsOf(again) == edges


@pytest.mark.parametrize("seed", range(12))
def testNoBondIsLeftOutByBothOfItsEnds(seed):
    """OpenMM's PDBFile leaves out the fourth of an atom's bonds, the eighth and so on, but not its last."""
    mesh = flipped(mh.Mesh.icosphere(seed % 4), 5 * seed, seed + 1)
    records: list[list[int]] = [[] for _ in mesh.vertices]
    for a, b in orderOfBonds(mesh.edges, len(mesh.vertices)).tolist():
        records[a].append(b)
        records[b].append(a)
    written = {
        (a, b) for a, bonded in enumerate(records) for k, b in enumerate(bonded) if k % 4 != 3 or k == len(bonded) - 1
    }
    assert {tuple(sorted(bond)) for bond in written} == set(map(tuple, mesh.edges.tolist()))


def testNamesOfAtoms():
    names = [nameOf(i) for i in (*range(50000), 26 * 36**3 - 1, 26 * 36**3)]
    assert len(set(names)) == len(names) and all(re.fullmatch("[A-Z][0-9A-Z]{3}", name) for name in names[:-1])
