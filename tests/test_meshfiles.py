"""Readers of mesh files: every dialect gives the same triangles, and every damaged file a sentence."""

import io
import json
import os
import resource
import sys
import time
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from openmm import unit

import openmmhelfrich as mh
from meshdialects import DIALECTS, INDICES, XYZ, binarySTL, checkpoint, gltf, obj, ownVTU, ply, text, textSTL
from openmmhelfrich.geometry import connectivity, formats
from openmmhelfrich.geometry.formats import meshiofiles, vtkfiles
from openmmhelfrich.geometry.formats.content import Content
from openmmhelfrich.geometry.quality import assess

WRITTEN = ["stl", "ply", "obj", "off", "vtu", "vtk", "msh", "tsi", "q", "h5"]
# Those whose writers have no more than eleven digits, or whose format has single precision.
ROUNDED = {name for name in DIALECTS if name.startswith(("vtk: polyData", "vtk: grid")) and "binary" not in name}


def randomMesh(seed):
    """Return closed surfaces of random shape, size and numbering, in single precision."""
    random = np.random.default_rng(seed)
    mesh = mh.Mesh.icosphere(int(random.integers(0, 3)))
    vertices = mesh.vertices * random.uniform(0.5, 2, 3) + random.uniform(-0.05, 0.05, mesh.vertices.shape)
    vertices = (vertices * 10.0 ** random.integers(-2, 4) + random.uniform(-1, 1, 3)).astype(np.float32)
    order = random.permutation(len(vertices))
    triangles = np.argsort(order)[mesh.triangles][random.permutation(len(mesh.triangles))]
    return mh.Mesh(vertices[order], triangles)


def emptyCheckpoint():
    """Return a checkpoint of TriMem that claims 100 million vertices, and has none."""
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        for name, kind in (("points", "f8"), ("cells", "i4")):
            file.create_dataset(name, shape=(10**8, 3), dtype=kind, chunks=True)
    return out.getvalue()


def facets(vertices, triangles):
    """Return the corners of all triangles, each from its least corner on, sorted."""
    corners = np.asarray(vertices, dtype=np.float64)[triangles].tolist()
    turned = [c[i:] + c[:i] for c in corners for i in [c.index(min(c))]]
    return np.array(sorted(turned))


def read(folder, suffix, content):
    file = folder / f"a.{suffix}"
    file.write_bytes(content)
    return mh.Mesh.read(file)


@pytest.mark.parametrize("name", DIALECTS)
def testDialect(tmp_path, name):
    suffix, write = DIALECTS[name]
    mesh = randomMesh(sum(map(ord, name)))
    again = read(tmp_path, suffix, write(mesh.vertices, mesh.triangles))
    again.check()
    assert len(again.vertices) == len(mesh.vertices) and len(again.triangles) == len(mesh.triangles)
    if name in ROUNDED:
        assert again.area == pytest.approx(mesh.area, rel=1e-8) and again.volume == pytest.approx(mesh.volume, rel=1e-6)
    else:
        assert np.array_equal(facets(again.vertices, again.triangles), facets(mesh.vertices, mesh.triangles))
    assert bool(again.notes) == any(
        word in name
        for word in (
            "bytes after",
            "not counted",
            "other elements",
            "points and lines",
            "inclusions",
            "vector fields",
            "several pieces",
            "sections",
        )
    )


@given(seed=st.integers(0, 10**9), name=st.sampled_from([n for n in DIALECTS if not n.startswith(("vt", "msh"))]))
@settings(max_examples=100, deadline=None)
def testRandomMeshInARandomDialect(tmp_path_factory, seed, name):
    suffix, write = DIALECTS[name]
    mesh = randomMesh(seed)
    again = read(tmp_path_factory.mktemp("dialects"), suffix, write(mesh.vertices, mesh.triangles))
    assert np.array_equal(facets(again.vertices, again.triangles), facets(mesh.vertices, mesh.triangles))


@given(seed=st.integers(0, 10**9), suffix=st.sampled_from(WRITTEN))
@settings(max_examples=40, deadline=None)
def testWhatIsWrittenIsRead(tmp_path_factory, seed, suffix):
    mesh, file = randomMesh(seed), tmp_path_factory.mktemp("written") / f"a.{suffix}"
    mesh.write(file)
    again = mh.Mesh.read(file)
    assert again.notes == [] and np.array_equal(
        facets(again.vertices, again.triangles), facets(mesh.vertices, mesh.triangles)
    )


@pytest.mark.parametrize("suffix", sorted({*formats.WRITTEN, *meshiofiles.WRITTEN}))
def testEveryFormatThatIsWrittenIsRead(tmp_path, suffix):
    """Small numbers too, and from a single file, wherever it is moved."""
    mesh = mh.Mesh.icosphere(1)
    mesh.vertices = (mesh.vertices @ np.diag([7, -7e-7, 7e7])[[1, 2, 0]]).astype(np.float32).astype(float)
    (tmp_path / "there").mkdir()
    mesh.write(tmp_path / f"a{suffix}")
    assert [file.name for file in tmp_path.glob("*a*")] == [f"a{suffix}"]
    again = mh.Mesh.read((tmp_path / f"a{suffix}").replace(tmp_path / "there" / f"b{suffix}"))
    assert facets(again.vertices, again.triangles) == pytest.approx(facets(mesh.vertices, mesh.triangles), rel=1e-15)


def testWhatIsNotWrittenIsSaid(tmp_path, monkeypatch, sphere):
    for name in ("nas", "bdf", "ugrid", "su2", "cgns", "f3grid", "exo", "wkt"):
        with pytest.raises(ValueError, match=rf"a.{name}: {name.upper()} files are read, not written; use one of .ply"):
            sphere.write(tmp_path / f"a.{name}")
    for name in ("svg", "node", "ele"):  # the last two have volumes only
        (tmp_path / f"a.{name}").write_text("# nothing\n")
        for act in (sphere.write, mh.Mesh.read):
            with pytest.raises(ValueError, match=rf"a.{name}: no mesh format has the suffix '.{name}'"):
                act(tmp_path / f"a.{name}")

    def fail(*arguments, **options):
        raise AssertionError

    monkeypatch.setattr("meshio.write", fail)
    with pytest.raises(ValueError, match=r"b.inp: meshio cannot write it as INP: "):
        sphere.write(tmp_path / "b.inp")


def testPathsThatAreNone(tmp_path, sphere):
    for none in (None, b"a.ply", 3):
        for act, name in ((mh.Mesh.read, "read"), (sphere.write, "write")):
            with pytest.raises(
                TypeError, match=rf"{name}: file is {none!r}; it must be a path: a str or a pathlib.Path"
            ):
                act(none)
    for suffix in formats.WRITTEN:
        with pytest.raises(FileNotFoundError) as caught:
            sphere.write(tmp_path / "nope" / f"a{suffix}")
        assert caught.value.filename == str(tmp_path / "nope")


# --- what is beside triangles


def testBoxOfFreeDTS(tmp_path, sphere):
    for suffix in ("tsi", "q"):
        mesh = mh.Mesh(sphere.vertices, sphere.triangles, (5, 6, 70 * unit.angstrom / unit.nanometer))
        mesh.write(tmp_path / f"a.{suffix}", unit=0.1)
        again = mh.Mesh.read(tmp_path / f"a.{suffix}", unit=0.1)
        assert again.box == pytest.approx(np.diag([5, 6, 7])) and again.vertices == pytest.approx(sphere.vertices)
        sphere.write(tmp_path / f"b.{suffix}")
        assert mh.Mesh.read(tmp_path / f"b.{suffix}").box == pytest.approx(np.diag(2 * np.ptp(sphere.vertices, axis=0)))
    sheared = mh.Mesh(sphere.vertices, sphere.triangles, [(5, 0, 0), (1, 5, 0), (0, 0, 5)])
    with pytest.raises(ValueError, match="FreeDTS has rectangular boxes only"):
        sheared.write(tmp_path / "c.tsi")
    assert not (tmp_path / "c.tsi").exists()


@given(seed=st.integers(0, 10**9), suffix=st.sampled_from(["tsi", "q"]), room=st.none() | st.floats(1.01, 30))
@settings(max_examples=30, deadline=None)
def testFreeDTSFindsAllVerticesInItsBox(tmp_path_factory, seed, suffix, room):
    """Numbers in the file are from 0 to the box's lengths, and the mesh is read where it was."""
    plain, file = randomMesh(seed), tmp_path_factory.mktemp("boxes") / f"a.{suffix}"
    mesh = mh.Mesh(plain.vertices, plain.triangles, None if room is None else room * np.ptp(plain.vertices, axis=0))
    assume(not mesh.isPeriodic)  # as one is with an edge longer than half of its box
    mesh.write(file)
    lines = [line.split() for line in file.read_text().splitlines()]
    first = 3 if suffix == "tsi" else 2
    box = np.array(lines[first - 2][-3:], dtype=float)
    points = np.array([line[1:4] for line in lines[first : first + len(mesh.vertices)]], dtype=float)
    assert np.all(points >= 0) and np.all(points < box)
    again = mh.Mesh.read(file)
    assert again.vertices == pytest.approx(mesh.vertices, rel=1e-12, abs=1e-13 * box.max())
    if np.all((plain.vertices >= 0) & (plain.vertices < box)):
        assert np.array_equal(points, plain.vertices)


@pytest.mark.parametrize("suffix", ["tsi", "q"])
def testFreeDTSFindsASheetInItsBox(tmp_path, suffix):
    """A periodic membrane that undulates around z = 0, and has moved out of the box, is folded into it."""
    sheet = mh.Mesh.sheet(8, 8, 1)
    x = sheet.vertices + np.array([5.3, -2.9, 0.0])
    x[:, 2] = 0.4 * np.sin(2 * np.pi * x[:, 0] / sheet.box[0, 0])
    mh.Mesh(x, sheet.triangles, sheet.box).write(tmp_path / f"a.{suffix}")
    again = mh.Mesh.read(tmp_path / f"a.{suffix}")
    lengths = np.diag(sheet.box)
    assert again.isPeriodic and np.all(again.vertices >= 0) and np.all(again.vertices < lengths)
    away = (again.vertices - x) / lengths
    assert away == pytest.approx(np.round(away), abs=1e-12) and np.any(np.round(away))


def testABoxThatIsTooSmallForFreeDTS(tmp_path, sphere):
    with pytest.raises(
        ValueError, match=r"the sizes of the mesh and its box are 2 x .* and 1.5 x 9 x 9; FreeDTS needs"
    ):
        mh.Mesh(sphere.vertices * 2 / np.ptp(sphere.vertices, axis=0), sphere.triangles, (1.5, 9, 9)).write(
            tmp_path / "a.tsi"
        )
    assert not (tmp_path / "a.tsi").exists()


def testNumbersOfFreeDTS(tmp_path):
    content = "version 1.1\nbox 9 9 9\nvertex 4\n7 0 0 0\n3 1 0 0\n5 0 1 0\n9 0 0 1\n"
    content += "triangle 4\n0 7 5 3\n1 7 3 9\n2 7 9 5\n3 3 5 9\n"
    mesh = read(tmp_path, "tsi", content.encode())
    mesh.check()
    assert mesh.volume == pytest.approx(1 / 6)
    with pytest.raises(ValueError, match="a triangle has the vertex 4; no vertex has that number"):
        read(tmp_path, "tsi", content.replace("3 3 5 9\n", "3 3 5 4\n").encode())


def polygons(sphere):
    """Return faces of three to six corners: the triangles of a sphere, some of them joined around a vertex."""
    taken, faces = np.zeros(len(sphere.triangles), dtype=bool), []
    for v in (0, 40, 80, 120):
        mine = np.flatnonzero(np.any(sphere.triangles == v, axis=1))
        if not taken[mine].any():
            taken[mine] = True
            after = {}
            for t in sphere.triangles[mine].tolist():
                i = t.index(v)
                after[t[(i + 1) % 3]] = t[(i + 2) % 3]
            ring = [next(iter(after))]
            while len(ring) < len(mine):
                ring.append(after[ring[-1]])
            faces.append(ring)
    for t in range(0, 320, 7):
        u = next(
            (u for u in range(t) if not taken[[t, u]].any() and len({*sphere.triangles[t], *sphere.triangles[u]}) == 4),
            None,
        )
        if u is not None:
            taken[[t, u]] = True
            a, b = sphere.triangles[t].tolist(), sphere.triangles[u].tolist()
            i = next(i for i in range(3) if a[i] not in b)
            faces.append([a[i], a[(i + 1) % 3], next(v for v in b if v not in a), a[(i + 2) % 3]])
    return faces + sphere.triangles[~taken].tolist()


@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "big.ply", "ascii.ply", "vtp", "vtu", "vtk"])
def testPolygonsAreDivided(tmp_path, sphere, suffix):
    faces = polygons(sphere)
    assert {len(face) for face in faces} == {3, 4, 5, 6}
    rows = [" ".join(map(str, face)) for face in faces]
    points = [f"{a:.17g} {b:.17g} {c:.17g}" for a, b, c in sphere.vertices.tolist()]
    if suffix == "obj":
        content = text(*(f"v {p}" for p in points), *("f " + " ".join(str(i + 1) for i in face) for face in faces))
    elif suffix == "off":
        content = text("OFF", f"162 {len(faces)} 0", *points, *(f"{len(f)} {row}" for f, row in zip(faces, rows)))
    elif suffix.endswith("ply"):
        kind = {"ply": "binary_little_endian", "big.ply": "binary_big_endian", "ascii.ply": "ascii"}[suffix]
        content = ply(kind, [("vertex", XYZ, sphere.vertices.tolist()), ("face", [INDICES], [(f,) for f in faces])])
    else:
        import pyvista

        cells = [i for face in faces for i in (len(face), *face)]
        data = pyvista.PolyData(sphere.vertices, cells)
        if suffix == "vtu":
            data = pyvista.UnstructuredGrid(cells, [7] * len(faces), sphere.vertices)
        data.save(tmp_path / f"b.{suffix}")
        content = (tmp_path / f"b.{suffix}").read_bytes()
    mesh = read(tmp_path, suffix, content)
    mesh.check()
    assert len(mesh.triangles) == sum(len(face) - 2 for face in faces)
    assert mesh.volume == pytest.approx(sphere.volume, rel=0.02)
    assert mesh.notes[0].startswith("faces were divided into triangles: ") and "of 4 corners" in mesh.notes[0]


@given(seed=st.integers(0, 10**6), corners=st.integers(4, 12))
@settings(max_examples=50, deadline=None)
def testFaceThatIsNotConvex(tmp_path_factory, seed, corners):
    """A flat star-shaped face: its triangles have its area and none is turned over."""
    random = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(corners) + random.uniform(0, 0.8, corners)) / corners
    radii = random.uniform(0.2, 1, corners)
    x = np.column_stack((radii * np.cos(angles), radii * np.sin(angles), np.zeros(corners)))
    area = 0.5 * np.sum(x[:, 0] * np.roll(x[:, 1], -1) - x[:, 1] * np.roll(x[:, 0], -1))
    content = text(*(f"v {a:.17g} {b:.17g} 0" for a, b, _ in x), "f " + " ".join(str(i + 1) for i in range(corners)))
    if np.diff(angles, append=angles[0] + 2 * np.pi).max() > 3:
        return  # the origin is not inside
    mesh = read(tmp_path_factory.mktemp("face"), "obj", content)
    normals = connectivity.triangleNormals(mesh.vertices, mesh.triangles)[:, 2]
    assert normals.min() > -1e-12 and normals.sum() / 2 == pytest.approx(area)


@given(seed=st.integers(0, 10**6), corners=st.integers(5, 40), flat=st.booleans())
@settings(max_examples=50, deadline=None)
def testFaceOfAnyCornersKeepsItsBorder(seed, corners, flat):
    """Triangles of a face that crosses itself, or is not flat, have its edges once, and each other edge twice."""
    x = np.random.default_rng(seed).normal(size=(corners, 3)) * [1, 1, not flat]
    triangles = Content(x, np.arange(corners), np.array([corners])).triangles()
    assert len(triangles) == corners - 2
    edges = Counter(zip(*(ends.tolist() for ends in connectivity.halfedges(triangles))))
    border = Counter((i, (i + 1) % corners) for i in range(corners))
    assert edges - Counter({(j, i): n for (i, j), n in edges.items()}) == border


@pytest.mark.parametrize("corners", [16, 32, 1000])
def testFacesOfManyCorners(tmp_path, corners):
    """Cylinders as Blender and CAD programs write them, with a face at each end, on a slope."""
    angles, i = 2 * np.pi * np.arange(corners) / corners, np.arange(corners)
    ends = [np.column_stack((np.cos(angles), np.sin(angles), np.full(corners, z))) for z in (0, 2)]
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    sides = np.column_stack((i, (i + 1) % corners, corners + (i + 1) % corners, corners + i)).tolist()
    faces = [i[::-1].tolist(), (corners + i).tolist(), *sides]
    points = np.concatenate(ends) @ turn * np.linalg.det(turn)
    rows = ["f " + " ".join(str(v + 1) for v in face) for face in faces]
    mesh = read(tmp_path, "obj", text(*(f"v {a:.17g} {b:.17g} {c:.17g}" for a, b, c in points), *rows))
    mesh.check()
    assert len(mesh.triangles) == 4 * corners - 4
    assert mesh.volume == pytest.approx(corners * np.sin(2 * np.pi / corners))


def testStripsAreUnfolded(tmp_path, sphere):
    import pyvista

    strips = pyvista.PolyData(sphere.vertices, np.column_stack((np.full(320, 3), sphere.triangles)).ravel()).strip()
    assert strips.n_strips > 0
    strips.save(tmp_path / "a.vtp")
    mesh = mh.Mesh.read(tmp_path / "a.vtp")
    mesh.check()
    points = np.asarray(strips.points, dtype=np.float64)
    assert np.array_equal(facets(mesh.vertices, mesh.triangles), facets(points, sphere.triangles))
    rows = [([0, 1, 2, 3, -1, 3, 2, 1],)]
    content = ply(
        "ascii", [("vertex", XYZ, np.eye(4)[:, :3].tolist()), ("tristrips", ["list int int vertex_indices"], rows)]
    )
    assert read(tmp_path, "ply", content).triangles.tolist() == [[0, 1, 2], [2, 1, 3], [3, 2, 1]]


def testScenesOfGltf(tmp_path, sphere):
    sphere.vertices = sphere.vertices.astype(np.float32).astype(float)
    moved = read(tmp_path, "glb", gltf(sphere.vertices + 1, sphere.triangles, True, (0.5, 0.25, -2)))
    assert moved.vertices.mean(axis=0) == pytest.approx([1, 1, 1], abs=1e-6)
    assert moved.volume == pytest.approx(sphere.volume, rel=1e-6)
    loose = sphere.vertices[sphere.triangles].reshape(-1, 3)
    assert len(read(tmp_path, "glb", gltf(loose, np.arange(960).reshape(-1, 3), True)).vertices) == 162
    for suffix in ("gltf", "glb", "vtp"):
        with pytest.raises(ValueError, match=f"{suffix.upper()} files are read, not written"):
            sphere.write(tmp_path / f"b.{suffix}")


def testPiecesOfAClosedSurfaceAreJoined(tmp_path, sphere):
    mesh = read(tmp_path, "vtu", ownVTU(sphere.vertices, sphere.triangles))
    mesh.check()
    assert any("welded" in note for note in mesh.notes)


def testWhatIsNoMeshFileIsSaid(tmp_path, sphere):
    content = bytearray(binarySTL(sphere.vertices, sphere.triangles))
    content[80:84] = content[83:79:-1]
    tree = json.loads(gltf(sphere.vertices, sphere.triangles, False))
    tree["buffers"][0]["uri"] = "gone.bin"
    for suffix, some, message in (
        ("stl", bytes(content), "byte order of big-endian machines"),
        ("gltf", json.dumps(tree).encode(), "refers to another file, gone.bin, which is not there"),
        ("ply", b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 9\n", "a pointer of Git LFS"),
    ):
        with pytest.raises(ValueError, match=message):
            read(tmp_path, suffix, some)


def testWithoutVTK(tmp_path, sphere, monkeypatch):
    """What has been read by meshio is read without VTK, and what has not is a sentence that names the extra."""
    names = {"vtp": "vtp: with points and lines", "vtk": "vtk: polyData text 4.2", "vtu": "vtu: several pieces"}
    contents = {suffix: DIALECTS[name][1](sphere.vertices, sphere.triangles) for suffix, name in names.items()}
    monkeypatch.setitem(sys.modules, "vtkmodules", None)
    monkeypatch.setattr(vtkfiles, "_hasVTK", lambda: False)
    for suffix in ("vtu", "vtk"):
        sphere.write(tmp_path / f"a.{suffix}")
        assert np.array_equal(mh.Mesh.read(tmp_path / f"a.{suffix}").triangles, sphere.triangles)
    for suffix, content in contents.items():
        with pytest.raises(ValueError, match=r"pip install 'openmm-helfrich\[looking]' brings it"):
            read(tmp_path, suffix, content)


# --- what cannot be read

TETRAHEDRON = (
    np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]),
    np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]),
)
OFF = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
OBJ, STL = obj(*TETRAHEDRON), textSTL(*TETRAHEDRON)
IMAGE = b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 1 1 1\n"
IMAGE += b"ORIGIN 0 0 0\nSPACING 1 1 1\n"
TSI = b"version 1.1\nbox 9 9 9\nvertex 1\n0 0 0 0\ntriangle 1\n0 0 0 0\n"


@pytest.mark.parametrize(
    "name, content, message",
    [
        (
            "a.off",
            OFF.replace(b"1 0 0\n0 1", b"1 zero 0\n0 1"),
            r"line 4 is '1 zero 0'; it must be 3 numbers: the coordinates",
        ),
        ("a.off", OFF[:-20], r"it is not complete: it ends after 2 of 4 "),
        ("a.off", OFF.replace(b"OFF", b"4OFF"), "line 1 is '4OFF'; it must be OFF, STOFF"),
        ("a.off", OFF.replace(b"OFF", b"OFF BINARY"), "line 1 is 'OFF BINARY'"),
        ("a.off", OFF.replace(b"4 4 0", b"4"), "line 2 is '4'; it must be the numbers of vertices and faces"),
        (
            "a.off",
            OFF.replace(b"3 1 2 3", b"4 1 2 3"),
            "line 10 is '4 1 2 3'; it must be the number of a face's corners",
        ),
        ("a.obj", OBJ.replace(b"f 2 3 4", b"f 2 3 5"), "line 8 is 'f 2 3 5'; it must be of vertices from 1 to 4"),
        ("a.obj", OBJ.replace(b"f 2 3 4", b"f 2 3 0"), "but one is 0"),
        ("a.obj", OBJ.replace(b"f 2 3 4", b"f 2 b 4"), "line 8 is 'f 2 b 4'; it must be f and the number"),
        ("a.obj", OBJ.replace(b"v 1 0 0", b"v 1 0"), "line 2 is 'v 1 0'; it must be 3 numbers after 1 words"),
        ("a.obj", b"this is text\n", "it has no vertices: no line begins with 'v'"),
        ("a.stl", STL.replace(b"endloop", b"the end", 1), "line 7 is 'the end'; it must be a line of a facet"),
        ("a.stl", STL.replace(b"vertex 0 1 0", b"vertex 0 l 0", 1), "line 5 is 'vertex 0 l 0'"),
        ("a.stl", STL.replace(b"    vertex 0 1 0\n", b"", 1), "line 7 is 'endfacet'; .* not 2"),
        ("a.stl", STL[:43], "it is not complete: it ends within a facet"),
        ("a.stl", binarySTL(*TETRAHEDRON)[:-60], "it is not complete: it ends after 2 of 4 facets"),
        ("a.ply", ply("ascii", [("vertex", XYZ, [])])[:-8], "it is not complete: it ends before 'end_header'"),
        ("a.ply", ply("ascii", [("vertex", XYZ[:2], [(1, 2)])]), "no element 'vertex' with the properties x, y and z"),
        ("a.ply", ply("ascii", [("vertex", XYZ, [(1, 2, 3)])]), "the mesh has no triangles"),
        (
            "a.ply",
            ply("ascii", [("vertex", ["quad x"], [])]),
            "line 5 is 'property quad x'; it must be format, element",
        ),
        ("a.ply", ply("ascii", [("vertex", XYZ, [(1, 2, 3)])]).replace(b"1 2 3", b"1 two 3"), "line 9 is '1 two 3'"),
        (
            "a.ply",
            ply("ascii", [("vertex", XYZ, [(1, 2, 3)]), ("face", ["list uchar int corners"], [([0, 0, 0],)])]),
            "its element 'face' has no list vertex_indices or vertex_index",
        ),
        (
            "a.ply",
            ply("binary_big_endian", [("vertex", XYZ, np.ones((9, 3))), ("face", [INDICES], [([0, 1, 2],)] * 5)])[:-20],
            "it is not complete: it ends after 3 of 5 elements 'face'",
        ),
        ("a.tsi", TSI[:-9], "it is not complete: it ends after 0 of 1 lines of the section triangle"),
        ("a.tsi", TSI.replace(b"box 9 9 9", b"box 9 9 -9"), "the box is 9 x 9 x -9; its lengths must be positive"),
        ("a.tsi", TSI.replace(b"box 9 9 9\n", b""), "it has no section 'box'"),
        ("a.tsi", TSI + b"# origin 1 2 x\n", "its origin is '1 2 x'; it must be three numbers"),
        (
            "a.tsi",
            TSI.replace(b"vertex 1\n", b"vertex 2\n1 1 1 1\n") + b"vector_fields 2\n1 1 0 0 1 0 0\n",
            "it is not complete: it ends after 1 of 2 lines of the section vector_fields",
        ),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "it is not an HDF5 file, or not a complete one: "),
        ("a.h5", checkpoint(points=np.eye(3)), "it has no dataset 'cells'; a checkpoint of TriMem has 'points' and"),
        ("a.h5", checkpoint(points=np.ones(3)), r"'points' has the shape \(3,\) of float64; it must be \(N, 3\), of n"),
        ("a.h5", checkpoint(points=np.eye(3), cells=np.eye(3)), "'cells' .* float64; it must be .* of integers"),
        ("a.h5", emptyCheckpoint(), "'points' claims 2400000000 bytes, of which "),
        ("a.q", b"9 9 9\nfour\n", "line 2 is 'four'; it must be the number of vertices"),
        ("a.vtk", IMAGE, "vtkStructuredPoints; it must hold"),
        ("a.vtu", b"<?xml version='1.0'?>\n<VTKFile>\n<a></b>\n", "VTK cannot read it: "),
        ("a.vtp", b"<html></html>", "it begins neither with '# vtk DataFile' nor with the element VTKFile"),
        ("a.glb", b"glTF", "it cannot be read as GLB: "),
    ],
)
def testWhatIsWrongIsNamed(tmp_path, capfd, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message) as error:
        mh.Mesh.read(tmp_path / name).check()
    assert str(error.value).startswith(str(tmp_path / name)) and "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("suffix", sorted({*WRITTEN} - {"stl"}))
def testHugeNumbersAreRefusedBeforeTheyAreMultiplied(tmp_path, suffix):
    """A mesh of any size that is taken can be measured, without overflows."""
    mesh, file = mh.Mesh.icosphere(2), tmp_path / f"a.{suffix}"
    vertices = mesh.vertices.copy()
    for factor in (1e61, 1e150, 1e300):
        mesh.vertices[:] = factor * vertices
        mesh.write(file)
        for repair in (False, True):
            with pytest.raises(ValueError, match=r"a\.\w+: .*(every coordinate|the box).* 1e\+60"):
                mh.Mesh.read(file, repair=repair)
        with pytest.raises(ValueError, match="every coordinate must be a number from"):
            mesh.check()
    mesh.vertices[:] = 1e59 * vertices
    mesh.write(file)
    with pytest.raises(ValueError, match="every coordinate must be a number from"):
        mh.Mesh.read(file, unit=1e300)
    found = mh.Mesh.read(file, repair=True)
    quality = assess(found)
    assert found.reducedVolume == pytest.approx(mh.Mesh.icosphere(2).reducedVolume, rel=1e-3)
    assert np.all(np.isfinite(quality.aspectRatios)) and not len(quality.crossings) and quality.lines()


def damaged(content, random):
    """Return a file's bytes cut, with bytes changed, or with digits changed."""
    content = bytearray(content)
    if random.random() < 0.3:
        return bytes(content[: random.integers(1, len(content))])
    for _ in range(random.choice([1, 3, 30])):
        place = random.integers(min(len(content), random.choice([300, 10**6])))
        isDigit = content[place : place + 1].isdigit() and random.random() < 0.7
        content[place] = ord("0") + random.integers(10) if isDigit else random.integers(256)
    return bytes(content)


@pytest.mark.parametrize("suffix", sorted({suffix for suffix, _ in DIALECTS.values()}))
def testDamagedFilesAreASentence(tmp_path, suffix):
    """In a process with 2 GB to spare, every damaged file is read or a sentence, within ten seconds of computing."""
    mesh, writers = mh.Mesh.icosphere(1), [write for s, write in DIALECTS.values() if s == suffix]
    random = np.random.default_rng(len(suffix))
    count = int(os.environ.get("OPENMM_HELFRICH_DAMAGED_FILES", 4 if suffix in ("vtk", "vtu", "vtp") else 60))
    contents = [write(mesh.vertices, mesh.triangles) for write in writers]
    cases = [damaged(contents[i % len(contents)], random) for i in range(count)]
    child = os.fork()
    if child == 0:
        os._exit(_readAll(cases, tmp_path / f"a.{suffix}"))
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0, f"damaged files: {(tmp_path / 'failure').read_text()}"


def _readAll(cases, file):
    """Read damaged files and return 0 if all went as it must."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2 * 10**9, used + 2 * 10**9))
    for i, content in enumerate(cases):
        file.write_bytes(content)
        start, failure = time.process_time(), None
        try:
            mh.Mesh.read(file, repair=True)
        except ValueError as error:
            failure = f"several lines: {error}" if "\n" in str(error) else None
        except BaseException as error:
            failure = f"{type(error).__name__}: {error}"
        if failure or time.process_time() - start > 10:
            file.with_name("failure").write_text(f"number {i}: {failure}")
            return 1
    return 0
