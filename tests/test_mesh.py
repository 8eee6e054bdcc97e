import importlib.util
import struct

import mdtraj
import meshio
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from openmm import app, unit
from scipy.spatial.transform import Rotation

import openmmhelfrich as mh
from conftest import together
from openmmhelfrich.geometry import connectivity, mending
from openmmhelfrich.geometry.quality import triangleAngles

FORMATS = ["stl", "ply", "obj", "off", "vtu", "vtk", "msh"]

# vertices, E_B/(8 pi kappa), A/(4 pi), V/(4 pi/3), M/(4 pi) of icospheres of radius 1
ICOSPHERES = [
    (162, 1.007489, 0.981178, 0.966161, 0.993699),
    (642, 1.001897, 0.995235, 0.991394, 0.998410),
    (2562, 1.000476, 0.998805, 0.997839, 0.999602),
    (10242, 1.000119, 0.999701, 0.999459, 0.999900),
    (40962, 1.000030, 0.999925, 0.999865, 0.999975),
]


@pytest.mark.parametrize("subdivisions, expected", list(enumerate(ICOSPHERES, start=2)))
def testIcosphere(subdivisions, expected):
    mesh = mh.Mesh.icosphere(subdivisions)
    mesh.check()
    curvatures = mesh.vertexMeanCurvatures
    values = (
        len(mesh.vertices),
        2 * np.sum(curvatures**2 / mesh.vertexAreas) / (8 * np.pi),
        mesh.area / (4 * np.pi),
        mesh.volume / (4 * np.pi / 3),
        curvatures.sum() / (4 * np.pi),
    )
    assert values == pytest.approx(expected, rel=1e-5)
    assert mesh.vertices.dtype == np.float64 and mesh.triangles.dtype == np.int32
    assert len(mesh.vertices) - len(mesh.edges) + len(mesh.triangles) == 2


@given(radius=st.floats(1e-3, 1e5), shift=st.floats(-10, 10), seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def testGeometryOfScaledRotatedAndShiftedMesh(radius, shift, seed):
    one = mh.Mesh.icosphere(2)
    one.vertices *= [1, 0.8, 0.5]
    other = mh.Mesh(radius * (Rotation.random(rng=seed).apply(one.vertices) + shift), one.triangles)
    assert other.area == pytest.approx(radius**2 * one.area, rel=1e-9)
    assert other.volume == pytest.approx(radius**3 * one.volume, rel=1e-9)
    assert other.reducedVolume == pytest.approx(one.reducedVolume, rel=1e-9)
    assert other.vertexMeanCurvatures == pytest.approx(radius * one.vertexMeanCurvatures, rel=1e-6, abs=1e-9 * radius)
    assert other.vertexAreas.sum() == pytest.approx(other.area, rel=1e-12)


def testGeometryIsThatOfTheForce(sphere):
    import openmm as mm

    sphere.vertices += np.random.default_rng(1).normal(0, 0.02, sphere.vertices.shape)
    force = mh.HelfrichForce()
    force.setTriangles(sphere.triangles)
    force.setBendingModulus(1)
    system = sphere.createSystem()
    system.addForce(force)
    context = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatformByName("Reference"))
    context.setPositions(sphere.vertices)
    geometry = force.getGeometryInContext(context)
    assert sphere.area == pytest.approx(geometry.area._value, rel=1e-12)
    assert sphere.volume == pytest.approx(geometry.volume._value, rel=1e-12)
    assert sphere.vertexMeanCurvatures == pytest.approx(
        np.asarray(geometry.vertexMeanCurvatures._value), rel=1e-9, abs=1e-12
    )


# --- files


@pytest.mark.parametrize("suffix", FORMATS)
def testRoundTrip(tmp_path, sphere, suffix):
    file = tmp_path / f"mesh.{suffix}"
    sphere.write(file)
    again = mh.Mesh.read(file)
    if suffix == "stl":  # single precision, vertices in order of first appearance
        sphere = mh.Mesh(*inOrderOfAppearance(sphere.vertices.astype(np.float32), sphere.triangles))
    assert np.array_equal(again.vertices, sphere.vertices)
    assert np.array_equal(again.triangles, sphere.triangles)
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def inOrderOfAppearance(vertices, triangles):
    _, first = np.unique(triangles, return_index=True)
    old = triangles.ravel()[np.sort(first)]
    new = np.empty(len(vertices), dtype=int)
    new[old] = np.arange(len(old))
    return vertices[old], new[triangles]


@pytest.mark.parametrize("binary", [False, True])
def testStlCornersAreMergedInOrderOfAppearance(tmp_path, binary):
    vertices, triangles = (
        np.array([(5.0, 0, 0), (0, 0, 3), (0, 4, 0), (0, 0, 0)]),
        np.array([(3, 2, 0), (3, 0, 1), (3, 1, 2), (0, 2, 1)]),
    )
    meshio.write(tmp_path / "a.stl", meshio.Mesh(vertices, [("triangle", triangles)]), binary=binary)
    mesh = mh.Mesh.read(tmp_path / "a.stl")
    mesh.check()
    assert np.array_equal(mesh.vertices, vertices[[3, 2, 0, 1]])
    assert np.array_equal(mesh.triangles, [(0, 1, 2), (0, 2, 3), (0, 3, 1), (2, 1, 3)])


def testUnits(tmp_path, sphere):
    sphere.write(tmp_path / "um.ply", unit=unit.micrometer)
    assert np.allclose(mh.Mesh.read(tmp_path / "um.ply").vertices, sphere.vertices / 1000, rtol=1e-15)
    for length in (unit.micrometer, 1000, 10000 * unit.angstrom):
        assert np.allclose(mh.Mesh.read(tmp_path / "um.ply", unit=length).vertices, sphere.vertices, rtol=1e-14)
    for wrong in (0, -1, float("nan"), unit.kelvin, "um"):
        with pytest.raises(ValueError, match="unit is"):
            mh.Mesh.read(tmp_path / "um.ply", unit=wrong)


def testUnusedVerticesPointsAndLinesAreLeftOut(tmp_path, sphere):
    points = np.concatenate(([(9.0, 9, 9)], sphere.vertices, [(8.0, 8, 8)]))
    cells = [("vertex", [[0]]), ("line", [[0, 1]]), ("triangle", sphere.triangles + 1)]
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(points, cells))
    mesh = mh.Mesh.read(tmp_path / "a.vtu")
    assert np.array_equal(mesh.vertices, sphere.vertices) and np.array_equal(mesh.triangles, sphere.triangles)


def testWriteFailsCleanly(tmp_path, sphere):
    with pytest.raises(ValueError, match=r"no mesh format has the suffix '.xyzzy'"):
        sphere.write(tmp_path / "a.xyzzy")
    with pytest.raises(OSError):
        sphere.write(tmp_path / "nowhere" / "a.ply")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("missing.stl", None, "there is no mesh file .*missing.stl"),
        ("empty.stl", b"", "empty.stl is empty"),
        ("text.stl", b"Dear Sir or Madam,\nthis is not a mesh.\n", "text.stl: "),
        (
            "text.ply",
            b"Dear Sir or Madam,\nthis is not a mesh.\n",
            "text.ply: line 1 is 'Dear Sir or Madam,'; it must be 'ply'",
        ),
        ("text.msh", b"Dear Sir or Madam,\nthis is not a mesh.\n", "text.msh: meshio cannot read it as MSH: "),
        ("mesh.docx", b"PK", "no mesh format has the suffix '.docx'; use one of .ply, .stl"),
        (
            "nan.off",
            b"OFF\n4 4 0\n0 0 0\n1 0 nan\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n",
            "position of vertex 1 is \\(1, 0, nan\\)",
        ),
        (
            "range.off",
            b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 4\n",
            "triangle 3 has the vertex 4; it must be from 0 to 3",
        ),
        ("points.obj", b"v 0 0 0\nv 1 0 0\n", "no triangles"),
    ],
)
def testUnreadableFiles(tmp_path, capfd, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(FileNotFoundError if content is None else ValueError, match=message):
        mh.Mesh.read(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def testFolderIsNoMesh(tmp_path):
    with pytest.raises(ValueError, match="not a file"):
        mh.Mesh.read(tmp_path)


def testBodiesAreRefused(tmp_path):
    for suffix, word in (("vtu", "VTK's type 10"), ("msh", "type tetra")):
        kind = "gmsh" if suffix == "msh" else suffix
        meshio.write(tmp_path / f"a.{suffix}", meshio.Mesh(CORNERS, [("tetra", [(0, 1, 2, 3)])]), file_format=kind)
        with pytest.raises(ValueError, match=f"cells of {word}; a surface has triangles"):
            mh.Mesh.read(tmp_path / f"a.{suffix}")


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def testTruncatedFileIsAnErrorOrComplete(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("cut")
    whole = mh.Mesh.icosphere(1)
    suffix = data.draw(st.sampled_from(FORMATS))
    file = folder / f"a.{suffix}"
    whole.write(file)
    content = file.read_bytes()
    file.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
    try:
        mesh = mh.Mesh.read(file)
        mesh.check()
    except ValueError:
        return
    assert mesh.vertices.shape == whole.vertices.shape and mesh.area == pytest.approx(whole.area, rel=1e-6)


@given(content=st.binary(max_size=300), suffix=st.sampled_from(FORMATS))
@settings(max_examples=60, deadline=None)
def testArbitraryBytesAreAnError(tmp_path_factory, content, suffix):
    file = tmp_path_factory.mktemp("junk") / f"a.{suffix}"
    file.write_bytes(content)
    with pytest.raises(ValueError):
        mh.Mesh.read(file).check()


# --- what a membrane must be

TETRAHEDRON = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
CORNERS = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])


def without(sphere):
    return mh.Mesh(sphere.vertices, sphere.triangles[1:])


def reversedTriangle(sphere):
    sphere.triangles[7] = sphere.triangles[7, ::-1]
    return sphere


def repeatedTriangle(sphere):
    return mh.Mesh(sphere.vertices, np.concatenate((sphere.triangles, sphere.triangles[[5]])))


def insideOut(sphere):
    return mh.Mesh(sphere.vertices, sphere.triangles[:, ::-1])


def flat(sphere):
    a, b, c = sphere.triangles[4]
    sphere.vertices[c] = (sphere.vertices[a] + sphere.vertices[b]) / 2
    return sphere


def repeatedVertex(sphere):
    sphere.triangles[3, 2] = sphere.triangles[3, 0]
    return sphere


def fin(sphere):
    a, b, _ = sphere.triangles[0]
    return mh.Mesh(
        np.concatenate((sphere.vertices, [(2, 2, 2)])),
        np.concatenate((sphere.triangles, [(a, b, len(sphere.vertices))])),
    )


def touching(sphere):
    """Two tetrahedra that share a vertex."""
    return mh.Mesh(
        np.concatenate((CORNERS, CORNERS[1:] + 5)),
        np.concatenate((TETRAHEDRON, np.where(TETRAHEDRON == 0, 0, TETRAHEDRON + 3))),
    )


def twoSided(sphere):
    return mh.Mesh(CORNERS[:3], [(0, 1, 2), (0, 2, 1)])


def loose(sphere):
    return mh.Mesh(np.concatenate((sphere.vertices, [(2, 2, 2)])), sphere.triangles)


def secondInsideOut(sphere):
    other = mh.Mesh(0.5 * sphere.vertices + 3, sphere.triangles[:, ::-1])
    return together(sphere, other)


def secondOpen(sphere):
    return together(sphere, mh.Mesh(sphere.vertices + 3, sphere.triangles[1:]))


@pytest.mark.parametrize(
    "spoil, message",
    [
        (without, r"the surface is open: edge \(\d+, \d+\) belongs to triangle \d+ only \(3 such edges\)"),
        (reversedTriangle, r"triangles \d+ and \d+ run along edge \(\d+, \d+\) in the same direction"),
        (repeatedTriangle, r"triangle 320 \(.*\) has the same three vertices as triangle 5"),
        (insideOut, r"^the membrane of vertex 0 is inside out"),
        (secondInsideOut, r"^surface 1, of 2: the membrane of vertex 162 is inside out"),
        (secondOpen, r"^surface 1, of 2: the surface is open"),
        (flat, r"triangle \d+ \(.*\) has no area"),
        (repeatedVertex, r"triangle 3 \(.*\) has the same vertex twice"),
        (fin, r"edge \(\d+, \d+\) belongs to 3 triangles \(0, \d+, 320\)"),
        (touching, r"the surface touches itself at vertex 0"),
        (twoSided, r"triangle 1 \(0, 2, 1\) has the same three vertices as triangle 0"),
        (loose, r"vertex 162 belongs to no triangle"),
    ],
)
def testCheckNamesWhatIsWrong(sphere, spoil, message):
    with pytest.raises(ValueError, match=message):
        spoil(sphere).check()


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("seed", range(5))
def testFlatSurfacesAreToldHoweverTheyAreTurned(sphere, kind, seed):
    """Rounding leaves them a volume of either sign; one that is merely thin is taken."""
    random = np.random.default_rng(seed)
    rotation, other = (np.linalg.qr(random.normal(size=(3, 3)))[0] for _ in range(2))
    for height, scale in ((0.0, 1e-6), (0.0, 1.0), (0.0, 1e6), (1e-4, 1.0)):
        shape = sphere.vertices @ rotation * [1, 1, height]  # along no axis of symmetry
        turned = scale * shape @ other * np.linalg.det(rotation @ other)
        mesh = mh.Mesh(turned.astype(kind).astype(float), sphere.triangles)
        if height > 0:
            mesh.check()
            continue
        assert mesh.volume != 0
        with pytest.raises(ValueError, match=r"^the membrane of vertex 0 is flat: it encloses no volume"):
            mesh.check()


def testCheckSeesCoordinatesThatWereChanged(sphere):
    sphere.vertices[17, 1] = np.inf
    with pytest.raises(ValueError, match="position of vertex 17"):
        sphere.check()


def testSpeciesGoWithTheirVertices(tmp_path, sphere):
    both = np.vstack([sphere.triangles, sphere.triangles + len(sphere.vertices)])
    vertices = np.vstack([sphere.vertices, sphere.vertices + 5])
    species = np.arange(len(vertices)) % 3
    mesh = mh.Mesh(vertices, both, species=species, speciesNames=("a", "b", "c"))
    parts = mesh.components()
    assert np.array_equal(np.concatenate([part.species for part in parts]), species)
    assert np.array_equal(mesh.reversed().species, species) and mesh.reversed().speciesNames == ("a", "b", "c")
    assert np.array_equal(mesh.repaired().species, species)  # where nothing is to be mended
    merged = mh.Mesh.merged(parts)
    assert np.array_equal(merged.species, species) and merged.speciesNames == ("a", "b", "c")
    assert mh.Mesh.merged([mesh, sphere]).species is None
    mesh.write(tmp_path / "a.ply", data={"Species": species.astype(float)})
    assert meshio.read(tmp_path / "a.ply").point_data["Species"].dtype.kind == "i"
    for name in ("a.stl", "a.off", "a.q", "a.h5"):
        mesh.write(tmp_path / name)
        assert mh.Mesh.read(tmp_path / name).species is None


def testSeveralMembranesPass(sphere):
    together(
        sphere, mh.Mesh(0.5 * sphere.vertices, sphere.triangles), mh.Mesh(sphere.vertices + 3, sphere.triangles)
    ).check()


@pytest.mark.parametrize(
    "vertices, triangles, message",
    [
        (CORNERS[:, :2], TETRAHEDRON, r"the vertices have the shape \(4, 2\)"),
        (CORNERS, TETRAHEDRON.ravel(), r"the triangles have the shape \(12,\)"),
        (CORNERS, TETRAHEDRON.astype(float), "the triangles are of type float64"),
        (CORNERS, [(0, 1), (0, 1, 2)], r"the triangles must be an array of integers"),
        (CORNERS, TETRAHEDRON - 1, r"triangle 0 has the vertex -1; it must be from 0 to 3"),
        ("abc", TETRAHEDRON, "array of numbers"),
        (CORNERS * np.nan, TETRAHEDRON, "position of vertex 0"),
    ],
)
def testArraysOfTheWrongKind(vertices, triangles, message):
    with pytest.raises(ValueError, match=message):
        mh.Mesh(vertices, triangles)


@pytest.mark.parametrize("arguments", [(-1, 1), (1.5, 1), (2, 0), (2, float("nan"))])
def testIcosphereOfTheWrongKind(arguments):
    with pytest.raises(ValueError, match="icosphere: "):
        mh.Mesh.icosphere(*arguments)


# --- subdivided


def createRough(kind):
    mesh = {
        "sphere": lambda: mh.Mesh.icosphere(2),
        "torus": lambda: mh.Mesh.torus(2, 1, 0.5),
        "sheet": lambda: mh.Mesh.sheet(6, 5, 1),
        "two": lambda: mh.Mesh.merged([mh.Mesh.icosphere(1), mh.Mesh.icosphere(1, 3)]),
    }[kind]()
    mesh.vertices += np.random.default_rng(1).normal(0, 0.03, mesh.vertices.shape)
    return mesh


@pytest.mark.parametrize("kind", ["sphere", "torus", "sheet", "two"])
def testSubdividedIsTheSameSurface(kind):
    mesh = createRough(kind)
    fine = mesh.subdivided(2)
    fine.check()
    count = len(mesh.vertices), len(mesh.edges), len(mesh.triangles)
    assert len(fine.triangles) == 16 * count[2]
    assert len(fine.vertices) - len(fine.edges) + len(fine.triangles) == count[0] - count[1] + count[2]
    assert np.array_equal(fine.vertices[: count[0]], mesh.vertices)
    assert fine.area == pytest.approx(mesh.area, rel=1e-12)
    if kind != "sheet":
        assert fine.volume == pytest.approx(mesh.volume, rel=1e-12)
    assert fine.vertexMeanCurvatures.sum() == pytest.approx(mesh.vertexMeanCurvatures.sum(), rel=1e-9)
    # Each triangle's parts are a quarter of it, twice.
    assert np.sort(fine.triangleAreas) == pytest.approx(np.repeat(np.sort(mesh.triangleAreas) / 16, 16), rel=1e-9)
    assert fine.isPeriodic == mesh.isPeriodic
    assert fine.edgeLengths.max() / fine.edgeLengths.mean() == pytest.approx(
        mesh.edgeLengths.max() / mesh.edgeLengths.mean(), rel=0.05
    )


def flatten(mesh, triangle, part=0.03):
    """Move a vertex of a triangle to nearly the middle of the side between the other two."""
    m, a, b = mesh.triangles[triangle]
    arms = connectivity.edgeVectors(mesh.vertices, np.array([m, m]), np.array([a, b]), mesh.images)
    mesh.vertices[m] += (1 - part) * arms.mean(axis=0)


@pytest.mark.parametrize("kind, triangle", [("sphere", 0), ("sheet", 0), ("two", 81)])
def testSubdividedFlipsFlatTriangles(kind, triangle):
    mesh = {"sphere": lambda: mh.Mesh.icosphere(2), "sheet": lambda: mh.Mesh.sheet(6, 5, 1)}.get(
        kind, lambda: mh.Mesh.merged([mh.Mesh.icosphere(1), mh.Mesh.icosphere(1, 3)])
    )()
    flatten(mesh, triangle)
    before = mesh.triangles.copy()
    fine = mesh.subdivided()
    fine.check()
    assert triangleAngles(mesh).max() > 172 > 160 > triangleAngles(fine).max()
    assert fine.notes == ["1 flat triangle was flipped before the mesh was subdivided"]
    assert np.array_equal(mesh.triangles, before) and not mesh.notes and not mesh.subdivided(0).notes
    assert np.array_equal(fine.vertices[: len(mesh.vertices)], mesh.vertices)
    assert fine.area == pytest.approx(mesh.area, rel=2e-3)
    if kind != "sheet":
        assert fine.volume == pytest.approx(mesh.volume, rel=2e-3)


def isFaceUp(mesh):
    return np.all(connectivity.triangleNormals(mesh.vertices, mesh.triangles, mesh.images)[:, 2] > 0)


@pytest.mark.parametrize("seed", range(12))
def testFlatTrianglesSideBySide(seed):
    """However many meet, those are flipped that can be, and none is turned over."""
    random, mesh = np.random.default_rng(seed), mh.Mesh.sheet(6, 6, 1)
    for triangle in random.choice(len(mesh.triangles), 12, replace=False):
        before = mesh.vertices.copy()
        flatten(mesh, triangle, 0.02)
        if not isFaceUp(mesh):
            mesh.vertices[:] = before
    fine = mesh.subdivided()
    assert fine.notes and isFaceUp(fine) and fine.area == pytest.approx(mesh.area, rel=1e-12)
    triangles, _ = mending.flipFlat(mesh.vertices, mesh.triangles, mesh.images)
    assert mending.flipFlat(mesh.vertices, triangles, mesh.images)[1] == 0


@pytest.mark.parametrize("c, isFlipped", [((1, -1, 0), True), ((-0.5, -0.02, 0), False)])
def testOnlyConvexPairsAreFlipped(c, isFlipped):
    """Another side of a pair that is not convex would turn a triangle over."""
    x = np.array([(0, 0, 0), (2, 0, 0), (1, 0.06, 0), c], dtype=float)
    triangles = np.array([(0, 1, 2), (1, 0, 3)])
    found, count = mending.flipFlat(x, triangles)
    assert count == isFlipped and np.array_equal(found, triangles) != isFlipped
    assert np.all(connectivity.triangleNormals(x, found)[:, 2] > 0)


def testSubdividedOfNothing():
    assert len(mh.Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int)).subdivided().triangles) == 0


def testSubdividedLeavesCreases():
    """A flat triangle beside the edge of a roof stays: flipped, it would cut the edge off."""
    x = np.array([[0, 0, 1], [2, 0, 1], [1, 1, 0], [1, -1, 0], [1, 0.02, 0.98], [1, 0, -1]], dtype=float)
    roof = [(0, 4, 1)[::-1], (0, 2, 4)[::-1], (2, 1, 4)[::-1], (0, 1, 3)[::-1]]
    below = [(0, 5, 2)[::-1], (2, 5, 1)[::-1], (1, 5, 3)[::-1], (3, 5, 0)[::-1]]
    mesh = mh.Mesh(x, [*roof, *below])
    mesh.check()
    fine = mesh.subdivided()
    assert triangleAngles(mesh).max() > 175 and triangleAngles(fine).max() > 175
    assert fine.volume == pytest.approx(mesh.volume, rel=1e-12) and not fine.notes


def testSubdividedKeepsWhatAMeshHas():
    mesh = mh.Mesh.icosphere(1)
    mesh.species, mesh.speciesNames = np.arange(len(mesh.vertices)) % 3, "ABC"
    mesh.beads, mesh.notes = np.ones((2, 3)), ["a note"]
    fine = mesh.subdivided()
    ends = {tuple(np.round((mesh.vertices[i] + mesh.vertices[j]) / 2, 12)): min(i, j) for i, j in mesh.edges}
    new = range(len(mesh.vertices), len(fine.vertices))
    assert [fine.species[k] for k in new] == [mesh.species[ends[tuple(np.round(fine.vertices[k], 12))]] for k in new]
    assert fine.speciesNames == ("A", "B", "C") and fine.notes == ["a note"]
    assert np.array_equal(fine.beads, mesh.beads)
    same = mesh.subdivided(0)
    assert np.array_equal(same.vertices, mesh.vertices) and np.array_equal(same.triangles, mesh.triangles)
    same.vertices[0], same.beads[0] = 0, 0
    assert mesh.vertices[0].any() and mesh.beads[0].any()


@pytest.mark.parametrize(
    "times, message", [(-1, "-1"), (1.5, "1.5"), ("2", "'2'"), (20, "about 1.76e.14 vertices"), (10**6, "more than")]
)
def testSubdividedOfTheWrongKind(sphere, times, message):
    with pytest.raises(ValueError, match=f"subdivided: .*{message}"):
        sphere.subdivided(times)


# --- to OpenMM


def testTopologyAndSystem(sphere):
    topology = sphere.topology()
    assert (topology.getNumAtoms(), topology.getNumResidues(), topology.getNumBonds()) == (162, 1, 480)
    assert sorted((a.index, b.index) for a, b in topology.bonds()) == list(map(tuple, sphere.edges))
    system = sphere.createSystem(mass=2 * unit.gram / unit.mole)
    assert (
        system.getNumParticles() == 162 and system.getNumForces() == 0 and system.getParticleMass(3) == 2 * unit.dalton
    )


def testTopologyHasAResidueAMembrane(sphere):
    mesh = together(sphere, mh.Mesh(sphere.vertices + 3, sphere.triangles))
    assert [len(list(residue.atoms())) for residue in mesh.topology().residues()] == [162, 162]
    # Membranes whose vertices alternate keep the order of their vertices.
    order = np.random.default_rng(1).permutation(324)
    mixed = mh.Mesh(mesh.vertices[np.argsort(order)], order[mesh.triangles])
    topology = mixed.topology()
    assert [atom.index for atom in topology.atoms()] == list(range(324))
    residueIds = np.array([atom.residue.id for atom in topology.atoms()])
    assert {len(set(residueIds[order[part]])) for part in (np.arange(162), np.arange(162, 324))} == {1}


def testLargeTopologyAndLargeCoordinates(tmp_path):
    one = mh.Mesh.icosphere(5, radius=1 * unit.micrometer)
    mesh = together(*(mh.Mesh(one.vertices + 3000 * i, one.triangles) for i in range(10)))  # 102,420 vertices
    topology = mesh.topology()
    mh.writePSF(tmp_path / "a.psf", topology)
    with open(tmp_path / "a.dcd", "wb") as file:
        app.DCDFile(file, topology, 1).writeModel(mesh.vertices * unit.nanometer)
    trajectory = mdtraj.load_dcd(str(tmp_path / "a.dcd"), top=str(tmp_path / "a.psf"))
    assert trajectory.n_residues == 10
    assert np.array_equal(sorted((a.index, b.index) for a, b in trajectory.topology.bonds), mesh.edges)
    assert np.abs(trajectory.xyz[0] - mesh.vertices).max() < 5e-3  # nm, in single precision of 27 um


def testOpenMMReadsThePsf(tmp_path, sphere):
    mh.writePSF(tmp_path / "a.psf", sphere.topology(), mass=12.5)
    psf = app.CharmmPsfFile(str(tmp_path / "a.psf"))
    assert [atom.mass for atom in psf.atom_list] == [12.5 * unit.dalton] * 162
    assert sorted((bond.atom1.idx, bond.atom2.idx) for bond in psf.bond_list) == list(map(tuple, sphere.edges))


# --- the red blood cell


def loadScript(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def testNodeWithAnAbsurdNumber(tmp_path):
    """The mesh library would make a table of 8 TiB."""
    file = tmp_path / "a.msh"
    mh.Mesh.icosphere(1).write(file)
    whole = file.read_bytes()
    file.write_bytes(whole.replace(struct.pack("<QQ", 41, 42), struct.pack("<QQ", 41, 2**40)))
    assert file.read_bytes() != whole
    with pytest.raises(
        ValueError, match="meshio cannot read it as MSH: a node has a number that is larger than the file"
    ):
        mh.Mesh.read(file)


def testRedBloodCell(examples):
    cell = mh.Mesh.read(examples / "red_blood_cell.stl")
    cell.check()
    assert len(cell.vertices) == 2562
    assert 134 < cell.area < 136 and 93 < cell.volume < 96
    assert np.ptp(cell.vertices, axis=0) == pytest.approx([7.82, 7.82, 2.565], rel=0.003)
    lengths, angles = cell.edgeLengths, anglesOf(cell)
    assert lengths.max() < 1.6 * lengths.min() and angles.min() > 40 and angles.max() < 90


def testRedBloodCellIsWhatItsScriptMakes(examples):
    made = loadScript(examples / "red_blood_cell.py").makeCell()
    made.vertices[:] = made.vertices.astype(np.float32)
    stored = mh.Mesh.read(examples / "red_blood_cell.stl")
    assert np.sort(stored.vertices.ravel()) == pytest.approx(np.sort(made.vertices.ravel()), abs=1e-4)
    assert stored.area == pytest.approx(made.area, rel=1e-5)


def anglesOf(mesh):
    """Return the angles of all triangles, in degrees."""
    x = mesh.vertices[mesh.triangles]
    a, b = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


def testMeshesThatAreMadeHaveABound():
    sphere = mh.Mesh.icosphere(2)
    for make, words in (
        (lambda: mh.Mesh.icosphere(12), "icosphere: subdivisions is 12, which makes about 1.68e.08 vertices"),
        (lambda: mh.Mesh.icosphere(10**9), "icosphere: subdivisions is 1000000000, which makes more than"),
        (lambda: mh.Mesh.torus(2, 0.5, 1e-6), "torus: edgeLength is 1e-06, which makes about 4.56e.13"),
        (lambda: mh.Mesh.torus(2, 0.5, 1e-300), "torus: edgeLength is 1e-300, which makes more than"),
        (lambda: mh.Mesh.sheet(100, 100, 1e-3), "sheet: edgeLength is 0.001, which makes about 1.15e.10"),
        (lambda: sphere.subdivided(9), "subdivided: times is 9, which makes about 4.19e.07 vertices"),
        (lambda: sphere.remeshed(10**9), "the number of vertices is 1000000000; .* from 12 to 20000000"),
        (lambda: sphere.remeshed(edgeLength=1e-200), "the edge length is .*, which makes more than"),
        (lambda: mh.spheroid(10**9, 2), "numVertices is 1000000000; .* from 12 to 20000000"),
    ):
        with pytest.raises(ValueError, match=words):
            make()
    assert connectivity.requireVertices(connectivity.MOST_VERTICES, "n is 2e7") is None


@pytest.mark.parametrize("kind", ["sphere", "torus", "sheet"])
def testHowManyVerticesAreMadeIsKnown(monkeypatch, kind):
    """The number that is refused is about that of the mesh."""
    make = {
        "sphere": lambda: mh.Mesh.icosphere(1).subdivided(),
        "torus": lambda: mh.Mesh.torus(2, 0.7, 0.2),
        "sheet": lambda: mh.Mesh.sheet(20, 30, 1),
    }[kind]
    count = len(make().vertices)
    monkeypatch.setattr(connectivity, "MOST_VERTICES", 1.05 * count)
    make()
    monkeypatch.setattr(connectivity, "MOST_VERTICES", 0.95 * count)
    with pytest.raises(ValueError, match="there may be at most"):
        make()
