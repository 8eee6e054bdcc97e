"""Meshes made anew: the same surface and genus, as many vertices as asked for, even triangles; tori; merged meshes."""

import sys

import numpy as np
import pytest
from openmm import unit
from typer.testing import CliRunner

import openmmhelfrich as mh
from membranes import cube, uvSphere
from openmmhelfrich.cli import app
from openmmhelfrich.geometry import connectivity, remeshing
from openmmhelfrich.geometry.relaxation import Triangulation
from openmmhelfrich.geometry.remeshing import tried
from openmmhelfrich.geometry.shapes import invaginatedSphere, spheroid, surfaceOfRevolution
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.meshsource import loadMesh

pytest.importorskip("mmgpy")
pytest.importorskip("igl")


def genus(mesh):
    return connectivity.genus(mesh.triangles, len(mesh.vertices))


def pointsOn(mesh):
    """Return the vertices of a mesh and three random points on each triangle."""
    weights = np.random.default_rng(1).dirichlet((1, 1, 1), (len(mesh.triangles), 3))
    points = np.einsum("tpc,tci->tpi", weights, mesh.vertices[mesh.triangles]).reshape(-1, 3)
    return np.concatenate((mesh.vertices, points))


def distance(mesh, other):
    """Return the greatest distance between two surfaces, by VTK, of points on each to the other."""
    pyvista = pytest.importorskip("pyvista")
    found = [
        pyvista.PolyData(pointsOn(a)).compute_implicit_distance(
            pyvista.PolyData.from_regular_faces(b.vertices, b.triangles)
        )["implicit_distance"]
        for a, b in ((mesh, other), (other, mesh))
    ]
    return np.abs(np.concatenate(found)).max()


def assertEven(mesh, least=0.6, most=1.5):
    lengths = mesh.edgeLengths / mesh.edgeLengths.mean()
    assert least <= lengths.min() and lengths.max() <= most


SURFACES = {
    "uneven sphere": (lambda: uvSphere(32, 16), 482),
    "finer": (lambda: uvSphere(32, 16), 1500),
    "coarser": (lambda: mh.Mesh.icosphere(4), 500),
    "of the same size": (lambda: mh.Mesh.icosphere(4), 2500),
    "prolate": (lambda: spheroid(1500, 2.5), 1000),
    "stomatocyte": (lambda: surfaceOfRevolution(invaginatedSphere(0.5, 0.6), 2500, 30), 1500),
    "torus": (lambda: mh.Mesh.torus(1.5, 0.5, 0.08), 1000),
}


@pytest.mark.parametrize("name", SURFACES)
def test_same_surface_and_even_triangles(name):
    create, number = SURFACES[name]
    mesh = create()
    made = mesh.remeshed(number)
    made.check()
    assert len(made.vertices) == number and genus(made) == genus(mesh)
    assert made.area == pytest.approx(mesh.area, rel=0.01)
    assert made.volume == pytest.approx(mesh.volume, rel=0.01)
    assertEven(made)
    assert distance(made, mesh) < 0.1 * made.edgeLengths.mean()


def test_edge_length():
    mesh = mh.Mesh.icosphere(3, 100)
    for length in (12.0, 12 * unit.nanometer, 120 * unit.angstrom):
        assert mesh.remeshed(edgeLength=length).edgeLengths.mean() == pytest.approx(12, rel=0.03)


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_size_does_not_matter(scale):
    mesh = mh.Mesh.icosphere(3)
    made, other = mesh.remeshed(200), mh.Mesh(scale * mesh.vertices, mesh.triangles).remeshed(200)
    np.testing.assert_array_equal(made.triangles, other.triangles)
    np.testing.assert_allclose(other.vertices, scale * made.vertices, rtol=1e-14)


def test_place_does_not_matter():
    mesh = mh.Mesh.icosphere(3)
    made = mh.Mesh(mesh.vertices + np.array([300, -200, 500]), mesh.triangles).remeshed(200)
    assert made.volume == pytest.approx(mesh.volume, rel=0.01) and made.vertices.mean(axis=0) == pytest.approx(
        [300, -200, 500], abs=0.01
    )
    assertEven(made)


def test_every_surface_stays():
    one, other = uvSphere(24, 12), mh.Mesh.torus(1.0, 0.4, 0.15)
    mesh = mh.Mesh.merged([one, mh.Mesh(other.vertices + np.array([4, 0, 0]), other.triangles)])
    parts = mesh.remeshed(900).components()
    assert [genus(part) for part in parts] == [0, 1]
    for part, given in zip(parts, (one, other)):
        assert part.area == pytest.approx(given.area, rel=0.01)
        assertEven(part, 0.5, 1.6)


def test_what_corners_do_not_let_be_is_said():
    with pytest.warns(UserWarning, match=r"the surface is up to 0\.\d+ mean edge lengths from the input"):
        made = cube().remeshed(300)
    made.check()
    assert made.volume == pytest.approx(1, rel=0.01)
    assert made.notes[0].startswith("remeshed: 300 vertices, 596 triangles; area ")
    assert any("corners or features that are finer than the edges" in note for note in made.notes)


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({}, "the number of vertices or the edge length"),
        ({"numVertices": 100, "edgeLength": 1.0}, "the number of vertices or the edge length"),
        ({"numVertices": 11}, "the number of vertices is 11; it must be a whole number from 12 to 20000000"),
        ({"numVertices": 100.5}, "100.5; it must be a whole number"),
        ({"edgeLength": 0}, "the edge length must be positive"),
        ({"edgeLength": float("nan")}, "the edge length must be positive"),
        ({"edgeLength": 50.0}, "there must be at least 12"),
    ],
)
def test_arguments_out_of_range(sphere, arguments, message):
    with pytest.raises(ValueError, match=message):
        sphere.remeshed(**arguments)


def test_surfaces_that_cannot_be_covered(sphere):
    with pytest.raises(ValueError, match="the surface is open"):
        mh.Mesh(sphere.vertices, sphere.triangles[1:]).remeshed(100)
    with pytest.raises(ValueError, match="1 handle, of which some are thinner than the new edges"):
        mh.Mesh.torus(5, 0.5, 0.2).remeshed(12)


@pytest.mark.parametrize("library", ["mmgpy", "igl"])
def test_missing_library_names_the_extra(sphere, monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ValueError, match=rf"needs {library}.*pip install 'openmm-helfrich\[remesh\]'"):
        sphere.remeshed(100)


def test_command(inFolder):
    uvSphere(32, 16).write("cell.stl")
    arguments = ["remesh", "cell.stl", "even.ply", "--vertices", "400"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0 and "400 vertices" in result.output and "even.ply" in result.output
    made = mh.Mesh.read("even.ply")
    assert len(made.vertices) == 400
    assertEven(made)
    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 1 and "even.ply exists already" in again.output
    for options in ([], ["--vertices", "400", "--edge-length", "0.1"]):
        result = CliRunner().invoke(app, ["remesh", "cell.stl", "b.ply", *options])
        assert result.exit_code == 1 and "give one of --vertices and --edge-length" in result.output


def test_configuration(inFolder):
    uvSphere(32, 16).write("cell.stl")
    mesh = loadMesh(parseConfig({"mesh": {"file": "cell.stl", "remesh": 300, "scale": 2.0, "length_unit": "um"}}))
    assert len(mesh.vertices) == 300 and mesh.area == pytest.approx(4 * uvSphere(32, 16).area, rel=0.01)
    assert any("remeshed: 300 vertices" in note for note in mesh.notes)
    with pytest.raises(ValueError, match=r"\[mesh\] remesh is 5; it must be greater than or equal to 12"):
        parseConfig({"mesh": {"file": "cell.stl", "remesh": 5}})


# --- tori and merged meshes


@pytest.mark.parametrize("R, r, length", [(1.5, 0.5, 0.1), (3, 1, 0.4), (10, 1, 0.4), (1.2, 1, 0.15)])
def test_torus(R, r, length):
    mesh = mh.Mesh.torus(R, r, length)
    mesh.check()
    assert genus(mesh) == 1
    assert mesh.volume == pytest.approx(2 * np.pi**2 * R * r**2, rel=2e-3)
    assert mesh.area == pytest.approx(4 * np.pi**2 * R * r, rel=0.01)
    assert mesh.edgeLengths.mean() == pytest.approx(length, rel=0.05)
    assertEven(mesh)


def test_torus_of_quantities():
    mesh = mh.Mesh.torus(0.15 * unit.micrometer, 500 * unit.angstrom, 10 * unit.nanometer)
    other = mh.Mesh.torus(150, 50, 10)
    np.testing.assert_allclose(mesh.vertices, other.vertices, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    "arguments", [(1, 1, 0.1), (1, 0, 0.1), (1, 2, 0.1), (np.inf, 1, 0.1), (1, 0.5, 0), (3, 1, 1.1)]
)
def test_torus_out_of_range(arguments):
    with pytest.raises(ValueError, match="torus: "):
        mh.Mesh.torus(*arguments)


def test_merged():
    one, other = mh.Mesh.icosphere(1), mh.Mesh.torus(3, 1, 0.5)
    both = mh.Mesh.merged([one, other])
    both.check()
    assert both.area == pytest.approx(one.area + other.area)
    for part, given in zip(both.components(), (one, other)):
        np.testing.assert_array_equal(part.vertices, given.vertices)
        np.testing.assert_array_equal(part.triangles, given.triangles)
    with pytest.raises(ValueError, match="there are no meshes"):
        mh.Mesh.merged([])


def test_merged_meshes_keep_box_and_notes():
    sphere = mh.Mesh.icosphere(1)
    inBox = mh.Mesh(sphere.vertices, sphere.triangles, 5.0)
    inBox.notes = ["a note"]
    both = mh.Mesh.merged([sphere, inBox, inBox.reversed()])
    assert np.array_equal(both.box, 5 * np.eye(3)) and both.notes == ["a note", "a note"]
    with pytest.raises(ValueError, match="different periodic boxes"):
        mh.Mesh.merged([inBox, mh.Mesh(sphere.vertices, sphere.triangles, 6.0)])


def test_surface_that_is_too_thin():
    """What is made of it is turned over, and the message does not blame the surface that was given."""
    sphere = mh.Mesh.icosphere(2)
    thin = mh.Mesh(sphere.vertices * [1, 1, 1e-6], sphere.triangles).repaired()
    thin.check()
    with pytest.raises(ValueError, match=r"remesh: the surface is too thin, .* no membrane .*; ask for more vertices"):
        thin.remeshed(162)


def test_what_is_too_thin_for_so_few_vertices_is_said():
    """Before the library takes all time and memory for a needle; surfaces that are far apart are not long."""
    sphere = mh.Mesh.icosphere(1)
    sphere.vertices[np.argmax(sphere.vertices[:, 2]), 2] += 1e6
    with pytest.raises(ValueError, match="too long and thin for so few vertices"):
        sphere.remeshed(162)
    small = mh.Mesh.icosphere(2)
    apart = mh.Mesh.merged([small, mh.Mesh(small.vertices + 1000, small.triangles)])
    assert len(apart.remeshed(300).vertices) == 300


def test_large_surfaces_are_tried_as_far_as_the_library_shows_at_once(sphere, monkeypatch):
    made = tried(Triangulation(sphere.vertices, sphere.triangles), 200)
    assert made is not None and len(made.triangulation.vertices) == 200
    monkeypatch.setattr(remeshing, "_MOST_TRIED", 199)
    assert tried(Triangulation(sphere.vertices, sphere.triangles), 200) is None
    with pytest.raises(ValueError, match="too long and thin for so few vertices"):
        tried(Triangulation(sphere.vertices * [1, 1, 1000], sphere.triangles), 200)
