"""What repair does: faults made on a sound mesh are mended and said; sound meshes stay as they are."""

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from openmm import unit
from typer.testing import CliRunner

import openmmhelfrich as mh
from conftest import together
from openmmhelfrich.cli import app

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
# The faces of a voxel, counter-clockwise from outside, and the direction of each.
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
DIRECTIONS = [(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)]


def voxelSurface(grid):
    """Return the surface of the voxels of a boolean array, with a vertex for each corner of the lattice."""
    grid = np.pad(grid, 1)
    corners = []
    for place in np.argwhere(grid):
        for face, direction in zip(FACES, DIRECTIONS):
            if not grid[tuple(place + direction)]:
                a, b, c, d = CUBE[list(face)] + place
                corners += [(a, b, c), (a, c, d)]
    vertices, triangles = np.unique(np.reshape(corners, (-1, 3)), axis=0, return_inverse=True)
    return mh.Mesh(vertices, triangles.reshape(-1, 3))


def repairedAndChecked(mesh, **options):
    mended = mesh.repaired(**options)
    mended.check()
    assert mended.repaired(**options).notes == mended.notes, "there is nothing left to mend"
    return mended


def testSoundMeshStaysAsItIs(sphere):
    for mesh in (sphere, together(sphere, mh.Mesh(sphere.vertices * 0.5, sphere.triangles)), mh.Mesh.icosphere(0)):
        mended = repairedAndChecked(mesh)
        assert mended.notes == []
        assert np.array_equal(mended.vertices, mesh.vertices) and np.array_equal(mended.triangles, mesh.triangles)


@given(seed=st.integers(0, 1000), part=st.sampled_from([0.01, 0.3, 0.7, 1.0]))
@settings(max_examples=20, deadline=None)
def testFacetsAreTurnedOutwards(seed, part):
    sphere = mh.Mesh.icosphere(2)
    turned = np.random.default_rng(seed).random(320) < part
    sphere.triangles[turned] = sphere.triangles[turned, ::-1]
    inner = mh.Mesh(sphere.vertices * 0.5, sphere.triangles)
    mended = repairedAndChecked(together(sphere, inner))
    assert [part.volume for part in mended.components()] == pytest.approx([4.0471, 4.0471 / 8], rel=1e-3)
    assert all("turned" in note for note in mended.notes) and bool(mended.notes) == bool(turned.any())


def testReverse(sphere):
    insideOut = sphere.reversed()
    assert insideOut.volume == pytest.approx(-sphere.volume, rel=1e-12) and insideOut.area == sphere.area
    assert np.array_equal(insideOut.reversed().triangles, sphere.triangles)
    assert insideOut.repaired(reverse=True).volume == pytest.approx(sphere.volume, rel=1e-12)
    assert sphere.repaired(reverse=True).volume == pytest.approx(-sphere.volume, rel=1e-12)
    assert "all facets were turned round" in sphere.repaired(reverse=True).notes[0]


@given(seed=st.integers(0, 1000), noise=st.floats(0, 1e-4), scale=st.sampled_from([1e-4, 1.0, 1e5]))
@settings(max_examples=15, deadline=None)
def testCornersAreWelded(seed, noise, scale):
    """Triangles with corners of their own, which differ a little."""
    sphere = mh.Mesh.icosphere(2, radius=scale)
    corners = sphere.vertices[sphere.triangles].reshape(-1, 3)
    corners = corners + scale * noise * np.random.default_rng(seed).uniform(-0.5, 0.5, corners.shape)
    loose = mh.Mesh(corners, np.arange(960).reshape(-1, 3))
    with pytest.raises(ValueError, match=r"the surface is open.*'openmm-helfrich repair'.* mends this"):
        loose.check()
    mended = repairedAndChecked(loose)
    assert len(mended.vertices) == 162 and mended.area == pytest.approx(sphere.area, rel=1e-2)
    assert mended.notes[0].startswith("798 corners were welded to another")
    assert not any("another surface" in note for note in mended.notes)


def testCornersThatAreFarApartAreNotWelded(sphere):
    corners = sphere.vertices[sphere.triangles].reshape(-1, 3)
    corners = corners + np.random.default_rng(1).uniform(-0.01, 0.01, corners.shape)
    loose = mh.Mesh(corners, np.arange(960).reshape(-1, 3))
    assert len(loose.repaired(smallest=0).vertices) == 960
    assert len(loose.repaired(tolerance=0.1).vertices) == 162


def withCaps(sphere, count):
    """Return a sphere with a vertex in the middle of some sides of triangles, and a flat triangle beside each."""
    vertices, triangles, more = [*sphere.vertices], [*sphere.triangles.tolist()], []
    for t in range(0, 40 * count, 40):
        a, b, c = triangles[t]
        m = len(vertices)
        vertices.append((sphere.vertices[a] + sphere.vertices[b]) / 2)
        triangles[t] = [a, m, c]
        more += [[m, b, c], [a, b, m]]
    return mh.Mesh(vertices, triangles + more)


def withNeedles(sphere, count):
    """Return a sphere with some vertices divided in two that are close to each other, and two needles between them."""
    vertices, triangles = [*sphere.vertices], sphere.triangles.tolist()
    for a, b, c in [triangles[t] for t in range(0, 40 * count, 40)]:
        m = len(vertices)
        vertices.append(sphere.vertices[a] + 1e-13 * (sphere.vertices[c] - sphere.vertices[a]))
        other = next(t for t in triangles if {a, c} <= set(t) and b not in t)
        third = next(v for v in other if v not in (a, c))
        triangles[triangles.index([a, b, c])] = [m, b, c]
        triangles[triangles.index(other)] = [m if v == a else v for v in other]
        triangles += [[a, b, m], [a, m, third]]
    return mh.Mesh(vertices, triangles)


@pytest.mark.parametrize("make", [withCaps, withNeedles])
def testFacetsWithoutAreaAreTakenAway(sphere, make):
    for count in (1, 8):
        flat = make(sphere, count)
        with pytest.raises(ValueError, match=r"has no area.*mends this"):
            flat.check()
        mended = repairedAndChecked(flat)
        assert mended.area == pytest.approx(sphere.area, rel=1e-6)
        assert mended.volume == pytest.approx(sphere.volume, rel=1e-6)
        assert any("without area" in note for note in mended.notes)


def testFacetsWithoutAreaInARow(sphere):
    """Several vertices on one side, and flat triangles among them only."""
    a, b, c = sphere.triangles[0]
    x = sphere.vertices
    row = [x[a] + f * (x[b] - x[a]) for f in (0.2, 0.5, 0.9)]
    m, n, o = 162, 163, 164
    pieces = [(a, m, c), (m, n, c), (n, o, c), (o, b, c), (a, n, m), (n, b, o), (a, b, n)]
    mended = repairedAndChecked(mh.Mesh([*x, *row], [*sphere.triangles[1:], *pieces]))
    assert len(mended.vertices) == 165 and mended.volume == pytest.approx(sphere.volume, rel=1e-9)
    assert mended.triangleAreas.min() > 1e-3 * mended.triangleAreas.mean()


def testFacetsThatLieOnOthers(sphere):
    t = sphere.triangles
    twice = repairedAndChecked(mh.Mesh(sphere.vertices, np.concatenate((t, t[[5, 7]]))))
    twoSided = repairedAndChecked(mh.Mesh(sphere.vertices, np.concatenate((t, t[:, ::-1]))))
    for mended, count in ((twice, 2), (twoSided, 320)):
        assert mended.volume == pytest.approx(sphere.volume, rel=1e-12) and len(mended.triangles) == 320
        assert f"{count} facets were taken away that lay on another" in mended.notes[0]
    a, b, _ = t[0]
    fin = mh.Mesh([*sphere.vertices, (1.2, 1.2, 1.2)], [*t, (a, b, 162)])
    flap = mh.Mesh([*sphere.vertices, (1.2, 1.2, 1.2)], [*t, (a, b, 162), (b, a, 162)])
    for mesh in (fin, flap):
        mended = repairedAndChecked(mesh)
        assert np.array_equal(mended.triangles, t) and "stuck out" in mended.notes[0]


@given(seed=st.integers(0, 10**6), size=st.integers(1, 4), fill=st.floats(0.1, 0.9))
@example(seed=250, size=3, fill=0.5625)  # cavities that touch the surface, of several patches
@example(seed=182, size=4, fill=0.5)
@settings(max_examples=40, deadline=None)
def testVoxelsThatTouch(seed, size, fill):
    """Voxels touch along edges and at corners, where each gets vertices of its own: the surface is one of solids."""
    grid = np.random.default_rng(seed).random((size, size, size)) < fill
    if not grid.any():
        return
    surface = voxelSurface(grid)
    mended = surface.repaired(smallest=0)
    inner = [part for part in mended.components() if part.volume > 0]
    assert len(inner) == len(mended.components()), "each is turned outwards, also the surface of a cavity"
    mended.check()
    if not mended.notes:
        assert np.array_equal(mended.triangles, surface.triangles)
    assert mended.area == pytest.approx(surface.area, rel=0.15)


def testSheetsThatCannotBeToldStayTogether():
    """Three lids on one rim: which two are one surface is anyone's guess; it is named, and no hole is made."""
    rim = [(0, 1), (1, 2), (2, 3), (3, 0)]
    lids = [*((a, b, 4) for a, b in rim), *((b, a, 5) for a, b in rim), *((a, b, 6) for a, b in rim)]
    vertices = [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, 0, 0.4)]
    mended = mh.Mesh(vertices, lids).repaired()
    assert mended.notes == ["4 edges were left with more than two facets, one of them at (1, 0, 0)"]
    assert len(mended.triangles) == 12 and len(mended.vertices) == 7


def testTwoCubesThatShareAnEdgeArePartedAsTheyAre():
    grid = np.zeros((2, 2, 1), dtype=bool)
    grid[0, 0], grid[1, 1] = True, True
    mended = repairedAndChecked(voxelSurface(grid))
    parts = mended.components()
    assert [len(part.vertices) for part in parts] == [8, 8] and [part.volume for part in parts] == pytest.approx(
        [1, 1], rel=0.1
    )
    assert mended.notes == [
        "2 vertices were added where the surface touched itself, whose sheets were moved apart by 0.1 of an edge"
    ]


def testSpecksAreNamed(sphere):
    speck = mh.Mesh.icosphere(1, radius=0.05)
    mesh = together(mh.Mesh(speck.vertices + 3, speck.triangles), sphere)
    mended = repairedAndChecked(mesh)
    assert np.array_equal(mended.vertices, sphere.vertices)
    assert mended.notes == ["a speck of 80 facets and area 0.0292 was left out, at (3, 3, 3)"]
    assert len(mesh.repaired(smallest=0).vertices) == 204
    assert np.array_equal(mesh.repaired(keep=[0]).vertices, mesh.vertices[:42])
    with pytest.raises(ValueError, match="surface 2 is to be kept; there are surfaces from 0 to 1"):
        mesh.repaired(keep=[2])
    many = together(sphere, *(mh.Mesh(speck.vertices + 3 * i, speck.triangles) for i in range(1, 15)))
    assert len(many.repaired().notes) == 11 and "4 more specks were left out" in many.repaired().notes[-1]


def testComponents(sphere):
    order = np.random.default_rng(1).permutation(324)
    mesh = together(sphere, mh.Mesh(sphere.vertices * 2, sphere.triangles))
    mixed = mh.Mesh(mesh.vertices[np.argsort(order)], order[mesh.triangles][::-1])
    parts = mixed.components()
    assert [len(part.vertices) for part in parts] == [162, 162]
    assert [part.area for part in parts] == pytest.approx([4 * sphere.area, sphere.area], rel=1e-12)
    assert len(sphere.components()) == 1 and np.array_equal(sphere.components()[0].triangles, sphere.triangles)


def testHoles(sphere):
    top, bottom = sphere.vertices[:, 2].argmax(), sphere.vertices[:, 2].argmin()
    isCut = np.any((sphere.triangles == top) | (sphere.triangles == bottom), axis=1)
    holed = mh.Mesh(sphere.vertices, sphere.triangles[~isCut])
    mended = holed.repaired()
    assert len(mended.notes) == 2 and all("is left open" in note for note in mended.notes)
    ring = holed.vertices[np.unique(sphere.triangles[np.any(sphere.triangles == top, axis=1)])]
    height = np.sort(ring[:, 2])[:-1].mean()
    assert any(f"{height:.4g}" in note for note in mended.notes)
    with pytest.raises(
        ValueError, match=r"the surface is open.*repair --close-holes' or Mesh.repaired\(closeHoles=True\)"
    ):
        holed.check()
    closed = holed.repaired(closeHoles=True)
    closed.check()
    assert len(closed.vertices) == 162 and closed.volume == pytest.approx(sphere.volume, rel=0.02)
    triangle = mh.Mesh(sphere.vertices, sphere.triangles[1:]).repaired(closeHoles=True)
    triangle.check()
    assert len(triangle.triangles) == 320 and triangle.volume == pytest.approx(sphere.volume, rel=1e-12)


def testAnOpenSurfaceThatCannotBeMendedIsToldOnce(sphere):
    """What is wrong is said once, and what closing it leaves, if that is something else."""
    corners = np.array([(x, y, 0.0) for x in range(3) for y in range(3)])
    square = mh.Mesh(corners, [t for i in (0, 1, 3, 4) for t in ((i, i + 3, i + 1), (i + 1, i + 3, i + 4))])
    fin = mh.Mesh(sphere.vertices, [*sphere.triangles[1:], (0, 50, 100)])
    around = [(a, a + 2, a + 1) for a in range(0, 8, 2)] + [(a + 1, a + 2, a + 3) for a in range(0, 8, 2)]
    twisted = np.array([(np.cos(t), np.sin(t), z) for t in range(5) for z in (-1, 1)])
    moebius = mh.Mesh(twisted, [*around, (8, 1, 9), (9, 1, 0)])
    for mesh, rest in (
        (square, "but not all: .*is flat: it encloses no volume"),
        (fin, "but not all: triangle"),
        (moebius, "does not"),
    ):
        with pytest.raises(ValueError, match=rf"^the surface is open: .*'openmm-helfrich repair.*{rest}") as error:
            mesh.check()
        assert str(error.value).count("the surface is open") == 1


@given(shift=st.tuples(*[st.floats(-50, 50)] * 3), seed=st.integers(0, 100))
@settings(max_examples=25, deadline=None)
def testUnfolding(shift, seed):
    lengths = np.random.default_rng(seed).uniform(2.6, 5, 3)
    sphere = mh.Mesh.icosphere(2)
    place = sphere.vertices + shift
    folded = mh.Mesh(np.mod(place, lengths), sphere.triangles)
    isFolded = np.any(np.ptp(np.floor(place / lengths), axis=0) > 0)
    mended = folded.repaired(box=lengths)
    assert mended.vertices - mended.vertices[0] == pytest.approx(sphere.vertices - sphere.vertices[0], abs=1e-9)
    assert any("unfolded" in note for note in mended.notes) == isFolded
    assert np.array_equal(mended.box, np.diag(lengths))
    sides = np.floor(place / lengths)
    if any(10 < np.sum(side != side[0]) < 152 for side in sides.T):
        for mesh in (folded, mh.Mesh(folded.vertices, folded.triangles, lengths)):
            with pytest.raises(ValueError, match=r"folded.*unfolds it"):
                mesh.check()
        with pytest.raises(ValueError, match="the lengths of the box must be given"):
            folded.repaired()
        assert mh.Mesh(folded.vertices, folded.triangles, lengths).repaired().volume == pytest.approx(sphere.volume)


def testSurfaceThroughTheBox():
    """A tube that goes through the whole box is no vesicle."""
    n, m = 12, 8
    grid = np.array([(np.cos(2 * np.pi * i / m), np.sin(2 * np.pi * i / m), k / 2) for k in range(n) for i in range(m)])
    at = lambda k, i: (k % n) * m + i % m  # noqa: E731
    triangles = [t for k in range(n) for i in range(m) for t in ((at(k, i), at(k, i + 1), at(k + 1, i)),
                 (at(k, i + 1), at(k + 1, i + 1), at(k + 1, i)))]  # fmt: skip
    with pytest.raises(ValueError, match="goes through the whole periodic box"):
        mh.Mesh(grid, triangles, (9, 9, n / 2)).repaired()


@pytest.mark.parametrize("stretch", [(1, 1, 30), (1, 1, 0.02), (5, 1, 1)], ids=["long", "flat", "ellipsoid"])
@pytest.mark.parametrize("subdivisions", [0, 1, 3])
def testLongBodiesAreNotFolded(stretch, subdivisions):
    mesh = mh.Mesh.icosphere(subdivisions)
    mesh.vertices *= stretch
    mesh.check()
    capsule = mh.Mesh.icosphere(3)
    capsule.vertices[:, 2] += np.where(capsule.vertices[:, 2] > 1e-9, 20.0, 0.0)
    capsule.check()


def testArgumentsOfTheWrongKind(sphere):
    for options, message in (
        ({"tolerance": -1}, "tolerance is -1; it must be at least 0 and less than 1"),
        ({"smallest": 1}, "smallest is 1; it must be at least 0 and less than 1"),
        ({"box": (1, 2)}, "the box is .*; it must be three vectors, three lengths, or one"),
        ({"box": -1}, "all positive"),
        ({"keep": []}, "surface none is to be kept"),
    ):
        with pytest.raises(ValueError, match=message):
            sphere.repaired(**options)
    assert np.array_equal(sphere.repaired(box=90 * unit.angstrom).box, 9 * np.eye(3))


# --- by the command and in a configuration


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def testCommand(inFolder, sphere):
    mh.Mesh(sphere.vertices, sphere.triangles[:, ::-1]).write("in.ply")
    done = invoke("repair", "in.ply", "out.stl")
    assert done.exit_code == 0 and done.output.splitlines() == [
        "1 surface was inside out and turned",
        "out.stl: 162 vertices, 320 triangles",
    ]
    mh.Mesh.read("out.stl").check()
    assert invoke("repair", "in.ply", "reversed.ply", "--reverse").exit_code == 0
    assert mh.Mesh.read("reversed.ply").volume > 0
    again = invoke("repair", "in.ply", "out.stl")
    assert again.exit_code == 1 and "out.stl exists already" in again.output
    assert "nothing was to be mended" in invoke("repair", "out.stl", "again.off").output
    itself = invoke("repair", "in.ply", "in.ply", "--overwrite")
    assert itself.exit_code == 1 and "would replace in.ply" in itself.output


@pytest.mark.filterwarnings("error")
def testMeshWithoutTrianglesIsTold():
    with pytest.raises(ValueError, match=r"^the mesh has no triangles$"):
        mh.Mesh(CUBE, np.zeros((0, 3), dtype=int)).repaired()


def testCommandOfWhatCannotBeMended(inFolder, sphere):
    mh.Mesh(sphere.vertices, sphere.triangles[1:]).write("in.ply")
    done = invoke("repair", "in.ply", "out.ply")
    assert done.exit_code == 1 and "a hole of 3 edges" in done.output
    assert "out.ply is written, but cannot be simulated: the surface is open" in done.output
    assert invoke("repair", "in.ply", "closed.ply", "--close-holes").exit_code == 0
    mh.Mesh.read("closed.ply").check()


def testCommandKeeps(inFolder, sphere):
    mh.Mesh.merged([sphere, mh.Mesh(0.5 * sphere.vertices + 3, sphere.triangles)]).write("in.ply")
    done = invoke("repair", "in.ply", "out.ply", "--keep", 1)
    assert done.exit_code == 0 and "a surface of 320 facets and area" in done.output
    assert mh.Mesh.read("out.ply").area == pytest.approx(sphere.area / 4)
    wrong = invoke("repair", "in.ply", "out.ply", "--keep", 2, "--overwrite")
    assert wrong.exit_code == 1 and "in.ply: surface 2 is to be kept; there are surfaces from 0 to 1" in wrong.output


def testCommandUnfolds(inFolder, sphere):
    mh.Mesh(np.mod(sphere.vertices, 4), sphere.triangles).write("in.vtu")
    assert "box" in invoke("repair", "in.vtu", "out.vtu").output
    assert invoke("repair", "in.vtu", "out.vtu", "--box", "4,4,4").exit_code == 0
    assert mh.Mesh.read("out.vtu").volume == pytest.approx(sphere.volume)
    wrong = invoke("repair", "in.vtu", "out.vtu", "--box", "four", "--overwrite")
    assert wrong.exit_code == 1 and "--box is 'four'" in wrong.output


def testRunRepairs(inFolder, sphere):
    sphere.reversed().write("in.ply")
    text = '[mesh]\nfile = "in.ply"\n{}\n[sampling]\nsteps = 2\nseed = 1\n'
    (inFolder / "a.toml").write_text(text.format(""))
    refused = invoke("run", "a.toml")
    assert refused.exit_code == 1 and "inside out" in refused.output and "repair = true in [mesh]" in refused.output
    (inFolder / "a.toml").write_text(text.format("repair = true"))
    done = invoke("run", "a.toml")
    assert done.exit_code == 0 and "1 surface was inside out and turned" in done.output


@pytest.mark.parametrize("noise", [0, 1e-8])
@pytest.mark.parametrize("turned", [False, True])
def testSurfaceThatIsThereTwice(noise, turned):
    """An object that a program exported twice: the second one is a fault, which is mended by leaving it out."""
    sphere, order = mh.Mesh.icosphere(2), np.random.default_rng(1).permutation(162)
    moved = sphere.vertices[order] + noise * np.random.default_rng(2).uniform(-1, 1, (162, 3))
    again = mh.Mesh(moved, np.argsort(order)[sphere.triangles][:, :: -1 if turned else 1])
    apart = mh.Mesh(sphere.vertices + 5, sphere.triangles)
    twice = mh.Mesh.merged([apart, sphere, again])
    if not turned:
        words = (
            r"surface 2, of 3: vertices \d+ and \d+ of two surfaces are in the same place \(162 such pairs\).*repair"
        )
        with pytest.raises(ValueError, match=words):
            twice.check()
    mended = twice.repaired()
    mended.check()
    assert len(mended.triangles) == 640 and mended.volume == pytest.approx(2 * sphere.volume)
    assert mended.notes[0].startswith("162 vertices were welded to another surface's that is closer than")
    assert mended.notes[1].startswith("320 facets were taken away that lay on another")


def testSurfacesThatTouchAtAVertex():
    sphere = mh.Mesh.icosphere(2)
    touching = mh.Mesh.merged([sphere, mh.Mesh(sphere.vertices + 2 * sphere.vertices[0], sphere.triangles)])
    with pytest.raises(ValueError, match=r"are in the same place \(1 such pair\)"):
        touching.check()
    mended = touching.repaired()
    mended.check()
    assert len(mended.components()) == 2 and mended.volume == pytest.approx(2 * sphere.volume, rel=0.01)


def lower(sphere, bound, factor):
    """Return a sphere whose part below a height is stretched."""
    z = sphere.vertices[:, 2]
    stretched = np.column_stack((sphere.vertices[:, :2], np.where(z < bound, bound + factor * (z - bound), z)))
    return mh.Mesh(stretched, sphere.triangles)


@pytest.mark.parametrize("suffix", ["ply", "stl"])
@pytest.mark.parametrize("bound", [-0.8, 0.0, 0.5])
@pytest.mark.parametrize("factor", [0.5, 1.5])
def testSurfacesThatShareAPartAreNotMended(tmp_path, suffix, bound, factor):
    """With vertices of their own, or in a file in which they have vertices in common: nothing is promised."""
    sphere, path = mh.Mesh.icosphere(2), tmp_path / f"two.{suffix}"
    mh.Mesh.merged([sphere, lower(sphere, bound, factor)]).write(path)
    mesh = mh.Mesh.read(path)
    with pytest.raises(ValueError, match=r"does not mend this|but not all: edge"):
        mesh.check()
    for closeHoles in (False, True):
        mended = mesh.repaired(closeHoles=closeHoles)
        assert mended.notes and not any("hole" in note for note in mended.notes)
        with pytest.raises(ValueError, match=r"in the same place|belongs to 3 triangles"):
            mended.check()


@pytest.mark.parametrize("suffix", ["ply", "stl"])
@pytest.mark.parametrize("levels", [(1, 2), (2, 1), (2, 3)])
def testCopiesOfOtherResolutionAreNotMended(tmp_path, suffix, levels):
    """Nothing is promised, and one can be chosen."""
    path = tmp_path / f"two.{suffix}"
    mh.Mesh.merged([mh.Mesh.icosphere(level) for level in levels]).write(path)
    mesh = mh.Mesh.read(path)
    for surface in (mesh, mesh.repaired()):
        with pytest.raises(ValueError, match="'openmm-helfrich repair' does not mend this"):
            surface.check()
    for k, level in enumerate(levels):
        kept = mesh.repaired(keep=[k])
        kept.check()
        assert len(kept.vertices) == 10 * 4**level + 2


def testAPartThatIsThereTwiceIsMended():
    """Half of a sphere, with vertices of its own, on a whole one; beside surfaces of which nothing is mended."""
    sphere = mh.Mesh.icosphere(2)
    top = sphere.triangles[sphere.vertices[sphere.triangles].mean(axis=1)[:, 2] > 0]
    part = mh.Mesh(sphere.vertices, top).repaired()
    twice = mh.Mesh.merged([sphere, part])
    mended = twice.repaired()
    mended.check()
    assert len(mended.triangles) == 320
    spoiled = [mh.Mesh(m.vertices + 5, m.triangles) for m in (sphere, lower(sphere, 0.5, 1.5))]
    left = mh.Mesh.merged([*spoiled, twice]).repaired()
    assert len(left.triangles) == 3 * 320
    assert any(note.startswith("43 vertices were left where another surface's is") for note in left.notes)
