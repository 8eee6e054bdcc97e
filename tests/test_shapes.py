"""What the commands check, convert, plot and render make of meshes and trajectories."""

import sys

import mdtraj
import meshio
import numpy as np
import pytest
from openmm import app as openmmapp
from PIL import Image
from typer.testing import CliRunner

import openmmhelfrich as mh
from conftest import together
from openmmhelfrich.cli import app
from openmmhelfrich.geometry.connectivity import trianglesFromEdges
from openmmhelfrich.geometry.quality import assess, closestPair, crossings
from openmmhelfrich.io.conversion import convert
from openmmhelfrich.pictures.rendering import canRender
from test_mesh_trajectory import same, simulate

in3D = pytest.mark.skipif(not canRender(), reason="there is no pyvista, or nothing that it could draw with")


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def torus(around=24, across=12, radius=1.0, thickness=0.4):
    """Return a torus around the z axis."""
    u, v = np.meshgrid(2 * np.pi * np.arange(around) / around, 2 * np.pi * np.arange(across) / across, indexing="ij")
    ring = radius + thickness * np.cos(v)
    vertices = np.stack((ring * np.cos(u), ring * np.sin(u), thickness * np.sin(v)), axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))

    def at(i, j):
        return (i % around) * across + j % across

    return mh.Mesh(
        vertices,
        np.concatenate(
            (
                np.column_stack((at(i, j), at(i + 1, j), at(i + 1, j + 1))),
                np.column_stack((at(i, j), at(i + 1, j + 1), at(i, j + 1))),
            )
        ),
    )


@pytest.fixture
def folder(inFolder, frames):
    """A working folder with a trajectory of six frames and a mesh."""
    mh.writeMeshTrajectory("run.vtkhdf", frames, lengthUnit="um")
    frames[0].mesh.write("start.ply")
    return inFolder


# --- the quality of a mesh


def testGenusAndShapes():
    for mesh, genera in (
        (mh.Mesh.icosphere(2), [0]),
        (torus(), [1]),
        (together(mh.Mesh.icosphere(1), torus()), [0, 1]),
    ):
        assert assess(mesh).genera == genera
    quality = assess(mh.Mesh.icosphere(0))
    assert (
        quality.angles == pytest.approx(60)
        and quality.aspectRatios == pytest.approx(1)
        and set(quality.valences) == {5}
    )


def testAnglesAndAspectRatiosOfAnyTriangle():
    mesh = mh.Mesh.icosphere(2)
    mesh.vertices *= [1, 2, 0.3]
    quality = assess(mesh)
    assert quality.angles.sum(axis=1) == pytest.approx(180)
    halves = np.radians(quality.angles) / 2  # r/R = 4 sin(A/2) sin(B/2) sin(C/2)
    assert quality.aspectRatios == pytest.approx(1 / (8 * np.sin(halves).prod(axis=1)))


def testSheetsThatComeClose():
    """The ends of a bowl's rim, two spheres side by side: near in space, far apart on the surface."""
    pair = together(mh.Mesh.icosphere(2), mh.Mesh.icosphere(2))
    pair.vertices[162:, 0] += 2.1
    a, b, distance = closestPair(pair)
    assert distance == pytest.approx(0.1, abs=1e-9) and {a < 162, b < 162} == {True, False}
    assert closestPair(mh.Mesh.icosphere(2)) is None and len(crossings(pair)) == 0


@pytest.mark.parametrize("other", [mh.Mesh.icosphere(1), mh.Mesh.icosphere(0, radius=7)])
def testCrossingsAreThoseOfAllPairs(other):
    """Two spheres that meet, of similar or different triangles: as many crossings as trying every edge with every
    triangle finds.
    """
    mesh = together(mh.Mesh.icosphere(1), other)
    mesh.vertices[42:] += np.array([0.68, 0.45, 0.26]) * np.linalg.norm(other.vertices[0])
    found = {tuple(row) for row in crossings(mesh, block=50).tolist()}
    expected = set()

    def volume(*points):
        return np.linalg.det(mesh.vertices[list(points[1:])] - mesh.vertices[points[0]])

    for a, b in mesh.edges.tolist():
        for t, triangle in enumerate(mesh.triangles.tolist()):
            if not {a, b} & set(triangle):
                x, y, z = triangle
                sides = [volume(a, b, x, y) > 0, volume(a, b, y, z) > 0, volume(a, b, z, x) > 0]
                if len(set(sides)) == 1 and (volume(x, y, z, a) > 0) != (volume(x, y, z, b) > 0):
                    expected.add((a, b, t))
    assert found == expected and len(expected) > 5


def testCheckCommand(inFolder):
    mh.Mesh.icosphere(3).write("sphere.ply")
    result = invoke("check", "sphere.ply", "--length-unit", "um")
    assert result.exit_code == 0
    for text in (
        "642 vertices, 1920 edges, 1280 triangles",
        "one membrane of genus 0",
        f"{mh.Mesh.icosphere(3).area:.6g} um^2",
        "5 to 6 of a vertex",
        "min_length 0.1",
        "ps by default",
        "no vertices that",
    ):
        assert text in result.output
    assert "warning" not in result.output


def testCheckCommandWarns(inFolder):
    mesh = together(mh.Mesh.icosphere(2), mh.Mesh.icosphere(2))
    mesh.vertices[162:, 0] += 1.92
    mesh.vertices *= 1000
    mesh.write("pair.ply")
    result = invoke("check", "pair.ply")
    assert result.exit_code == 0 and "2 membranes of genus 0" in result.output
    assert "the surface passes through itself" in result.output and "tether" in result.output
    assert result.output.split()[-2:] == ["verdict", "ready"]


def testCheckCommandRefuses(inFolder):
    mesh = mh.Mesh.icosphere(2)
    mh.Mesh(mesh.vertices, mesh.triangles[1:]).write("open.ply")
    mh.Mesh(mesh.vertices, mesh.triangles[:, ::-1]).write("inverted.ply")
    for name, message in (
        ("open.ply", "reason  the surface is open"),
        ("inverted.ply", "is inside out"),
        ("none.ply", "there is no mesh file none.ply"),
    ):
        result = invoke("check", name)
        assert result.exit_code == 1 and message in result.output and "Traceback" not in result.output


# --- conversion


def testEveryFormatHoldsTheFrame(folder, frames):
    mesh = frames[4].mesh
    for suffix in ("vtu", "ply", "stl", "obj", "off", "vtk", "msh"):
        assert convert("run.vtkhdf", f"a.{suffix}", frame=4) == [folder.relative_to(folder) / f"a.{suffix}"]
        again = mh.Mesh.read(f"a.{suffix}")
        assert again.area == pytest.approx(mesh.area, rel=1e-6) and again.volume == pytest.approx(mesh.volume, rel=1e-6)
        if suffix != "stl":  # its corners come in another order
            assert np.array_equal(again.triangles, mesh.triangles)
    for suffix in ("vtu", "ply", "vtk"):
        data = meshio.read(f"a.{suffix}").point_data
        assert (
            data["MeanCurvature"].ravel() == pytest.approx(frames[4].data["MeanCurvature"], rel=1e-6) and "Area" in data
        )


def testSeries(folder, frames):
    pyvista = pytest.importorskip("pyvista")
    files = convert("run.vtkhdf", "a.pvd", every=2)
    assert [file.name for file in files] == ["a.pvd", "a_0000.vtu", "a_0002.vtu", "a_0004.vtu"]
    reader = pyvista.get_reader("a.pvd")
    assert reader.time_values == [0, 20, 40]
    reader.set_active_time_value(20)
    shape = reader.read()[0]
    assert np.array_equal(shape.points, frames[2].mesh.vertices) and np.array_equal(
        shape.cells.reshape(-1, 4)[:, 1:], frames[2].mesh.triangles
    )
    assert [file.name for file in convert("run.vtkhdf", "b.ply")] == [f"b_{i:04}.ply" for i in range(6)]
    assert (
        same(mh.readMeshTrajectory(convert("run.vtkhdf", "c.vtkhdf", frame=-1)[0])[0], frames[5])
        and mh.readMeshTrajectory("c.vtkhdf").lengthUnit == "um"
    )


def testXYZ(folder, frames):
    convert("run.vtkhdf", "a.xyz")
    trajectory = mdtraj.formats.XYZTrajectoryFile("a.xyz").read()
    assert trajectory == pytest.approx(np.array([10 * frame.mesh.vertices for frame in frames]), abs=1e-5)


@pytest.fixture
def dcd(inFolder, sphere):
    """A folder with a DCD trajectory without flips, its topologies, and the mesh trajectory beside it."""
    pair = together(sphere, mh.Mesh(sphere.vertices + np.array([0, 0, 3]), sphere.triangles))
    simulation, force = simulate(pair)
    simulation.integrator.setFlipProbability(0)
    simulation.reporters += [openmmapp.DCDReporter("a.dcd", 5), mh.MeshReporter("true.vtkhdf", 5, force)]
    simulation.step(20)
    simulation.reporters[1].close()
    simulation.reporters.clear()
    mh.writePSF("a.psf", simulation.topology)
    pair.write("a.ply")
    return inFolder


def _rolled(triangles):
    """Return triangles sorted, each from its smallest vertex on."""
    return sorted(tuple(np.roll(t, -t.argmin())) for t in triangles)


@pytest.mark.parametrize("topology", ["a.psf", "a.ply"])
def testDCD(dcd, topology):
    result = invoke("convert", "a.dcd", "a.vtkhdf", "--topology", topology)
    assert result.exit_code == 0, result.output
    for frame, true in zip(mh.readMeshTrajectory("a.vtkhdf"), mh.readMeshTrajectory("true.vtkhdf"), strict=True):
        frame.mesh.check()
        assert frame.step == true.step and _rolled(frame.mesh.triangles) == _rolled(true.mesh.triangles)
        assert frame.mesh.vertices == pytest.approx(true.mesh.vertices, abs=1e-6)
        assert frame.data["MeanCurvature"] == pytest.approx(true.data["MeanCurvature"], abs=1e-3)


def testBondsThatDoNotTellTriangles():
    """Of the edges of two tetrahedra glued on a face three are in three rings: one of the rings is no triangle."""
    edges = np.array([(0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3), (0, 4), (1, 4), (2, 4)])
    with pytest.raises(ValueError, match=r"the bond \(0, 1\) belongs to 3 rings of three bonds.*give a mesh file"):
        trianglesFromEdges(edges, np.random.default_rng(1).random((5, 3)))


def testBadDCD(dcd):
    mh.Mesh.icosphere(1).write("small.ply")
    (dcd / "torn.dcd").write_bytes((dcd / "a.dcd").read_bytes()[:150])
    (dcd / "text.psf").write_text("PSF\n\nnothing")
    for source, topology, message in (
        ("a.dcd", None, "a.dcd has no triangles; give a topology"),
        ("a.dcd", "small.ply", "small.ply has 42 vertices and a.dcd has 324 atoms"),
        ("torn.dcd", "a.ply", "torn.dcd is not a complete DCD file"),
        ("none.dcd", "a.ply", "there is no file none.dcd"),
        ("a.dcd", "none.ply", "there is no file none.ply"),
        ("a.dcd", "text.psf", "text.psf"),
        ("a.ply", "a.psf", "is not a DCD file; only those need one"),
    ):
        result = invoke("convert", source, "out.vtkhdf", *(("--topology", topology) if topology else ()))
        assert result.exit_code == 1 and message in result.output and "Traceback" not in result.output
        assert not (dcd / "out.vtkhdf").exists()


def testWithoutMdtraj(dcd, monkeypatch):
    monkeypatch.setitem(sys.modules, "mdtraj", None)
    result = invoke("convert", "a.dcd", "out.vtkhdf", "--topology", "a.psf")
    assert (
        result.exit_code == 1
        and "reading DCD files needs mdtraj" in result.output
        and "openmm-helfrich[looking]" in result.output
    )


def testNothingIsOverwritten(folder):
    (folder / "b_0003.ply").write_text("mine")
    for arguments in (
        ("run.vtkhdf", "start.ply", "--frame", 0),
        ("run.vtkhdf", "b.ply"),
        ("start.ply", "start.ply", "--overwrite"),
        ("run.vtkhdf", "run.vtkhdf", "--overwrite"),
    ):
        before = {path.name: path.read_bytes() for path in folder.iterdir()}
        result = invoke("convert", *arguments)
        assert result.exit_code == 1 and "choose another name" in result.output
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert invoke("convert", "run.vtkhdf", "b.ply", "--overwrite").exit_code == 0
    assert mh.Mesh.read("b_0003.ply").triangles.shape == (320, 3)


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("run.vtkhdf", "a.ply", "--frame", 6), "run.vtkhdf has no frame 6; it has 6: 0 to 5, or -1 for the last"),
        (("run.vtkhdf", "a.ply", "--frame", -7), "has no frame -7"),
        (("run.vtkhdf", "a.ply", "--frame", 1, "--every", 2), "frame 1 and every 2 are both given"),
        (("run.vtkhdf", "a.foo"), "no format has the suffix '.foo'"),
        (("run.vtkhdf", "a"), "no format has the suffix ''"),
        (("run.foo", "a.ply"), "there is no mesh file run.foo"),
        (("run.vtkhdf", "nowhere/a.ply", "--frame", 0), "nowhere"),
        (("torn.vtkhdf", "a.ply"), "torn.vtkhdf is not a VTKHDF file, or not a complete one"),
    ],
)
def testBadConversion(folder, arguments, message):
    (folder / "torn.vtkhdf").write_bytes((folder / "run.vtkhdf").read_bytes()[:9000])
    before = sorted(path.name for path in folder.iterdir())
    result = invoke("convert", *arguments)
    assert result.exit_code == 1 and message in result.output and "Traceback" not in result.output
    assert sorted(path.name for path in folder.iterdir()) == before


# --- plot and render


def testPlotCommand(inFolder, sphere):
    simulation, force = simulate(sphere)
    simulation.reporters.append(mh.ObservablesReporter("run.csv", 2, force, 300, "um"))
    simulation.step(10)
    for source, output in (("run", "run_plot.png"), ("run.csv", "other.png")):
        result = invoke("plot", source, *(() if source == "run" else ("-o", output)))
        assert result.exit_code == 0 and result.output.strip() == output
        pixels = np.asarray(Image.open(output).convert("RGB"))
        assert min(pixels.shape[:2]) > 400 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
    (inFolder / "strange.csv").write_text("a,b\n1,2\n")
    for arguments, message in (
        (("run",), "run_plot.png exists already"),
        (("nothing",), "there is no table of observables nothing.csv"),
        (("strange",), "strange.csv is not a table of observables"),
    ):
        result = invoke("plot", *arguments)
        assert result.exit_code == 1 and message in result.output


def colorsOf(image):
    """Return the part of a picture that is not white, and how much of it is red rather than blue."""
    pixels = np.asarray(image.convert("RGB")).astype(int)
    seen = pixels.min(axis=2) < 235
    return seen.mean(), (pixels[seen][:, 0] > pixels[seen][:, 2] + 20).mean()


@in3D
def testRenderedPicture(folder, examples):
    assert invoke("render", examples / "red_blood_cell.stl", "-o", "cell.png").exit_code == 0
    seen, red = colorsOf(Image.open("cell.png"))
    assert 0.2 < seen < 0.8 and 0.5 < red < 0.98, "a convex rim around a dimple should fill the picture"
    assert invoke("render", "run.vtkhdf", "--frame", 2).exit_code == 0 and Image.open("run.png").size == (1024, 768)


@in3D
def testCutPicture(inFolder):
    """Of a sphere around a smaller one, the cut shows the smaller one, which is curved more."""
    inner = mh.Mesh.icosphere(3, radius=0.6)
    together(mh.Mesh.icosphere(3), mh.Mesh(inner.vertices, inner.triangles[:, ::-1])).write("nested.ply")
    for name, options in (("whole", ()), ("cut", ("--cut",))):
        assert invoke("render", "nested.ply", "-o", f"{name}.png", *options).exit_code == 0
    blue = {name: colorsOf(Image.open(f"{name}.png"))[1] for name in ("whole", "cut")}
    assert blue["whole"] > 0.9 > 0.8 > blue["cut"], "the inner sphere, turned inside out, should be blue"


@in3D
def testRenderedFilm(folder):
    assert invoke("render", "run.vtkhdf", "-o", "run.gif", "--every", 2).exit_code == 0
    film = Image.open("run.gif")
    images = []
    for i in range(film.n_frames):
        film.seek(i)
        images.append(np.asarray(film.convert("RGB")))
    assert len(images) == 3 and all(colorsOf(Image.fromarray(image))[0] > 0.2 for image in images)
    assert not np.array_equal(images[0], images[2])
    imageio = pytest.importorskip("imageio.v2")
    pytest.importorskip("imageio_ffmpeg")
    assert invoke("render", "run.vtkhdf", "-o", "run.mp4", "--every", 3).exit_code == 0
    assert imageio.get_reader("run.mp4").count_frames() == 2


@pytest.mark.parametrize("missing", ["pyvista", "an OpenGL library"])
def testRenderWithout(folder, monkeypatch, missing):
    if missing == "pyvista":
        monkeypatch.setitem(sys.modules, "pyvista", None)
    else:
        pytest.importorskip("pyvista")
        monkeypatch.setattr("openmmhelfrich.pictures.rendering._hasOpenGL", lambda: False)
    assert invoke("render", "run.vtkhdf").exit_code == 0
    assert colorsOf(Image.open("run.png"))[0] > 0.1
    for arguments in (("-o", "run.gif"), ("-o", "cut.png", "--cut")):
        result = invoke("render", "run.vtkhdf", *arguments)
        assert (
            result.exit_code == 1
            and f"rendering needs {missing}" in result.output
            and not (folder / arguments[1]).exists()
        )


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("run.vtkhdf", "-o", "a.txt"), "no picture has the suffix '.txt'; use one of .png"),
        (("run.vtkhdf", "-o", "start.ply"), "no picture has the suffix '.ply'"),
        (("run.vtkhdf", "--frame", 9), "has no frame 9"),
        (("run.vtkhdf", "-o", "there.png"), "there.png exists already"),
        (("none.vtkhdf",), "there is no mesh trajectory none.vtkhdf"),
        (("run.dcd",), "run.dcd has no triangles"),
    ],
)
def testBadRendering(folder, arguments, message):
    (folder / "there.png").write_text("mine")
    result = invoke("render", *arguments)
    assert result.exit_code == 1 and message in result.output and "Traceback" not in result.output
    assert (folder / "there.png").read_text() == "mine"
