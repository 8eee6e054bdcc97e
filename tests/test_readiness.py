"""What check says of a mesh, and that a run whose trajectories would not be accepted stops before it begins."""

import re
import shlex
import sys
from fractions import Fraction
from importlib import util
from itertools import product

import numpy as np
import openmm as mm
import pytest
from hypothesis import given, settings, strategies as st
from typer.testing import CliRunner

import openmmhelfrich as mh
from membranes import cube, uvSphere
from openmmhelfrich.cli import app
from openmmhelfrich.geometry.predicates import orientations
from openmmhelfrich.geometry.quality import assess, crossings, dihedralAngles, triangleAngles
from openmmhelfrich.runs import readiness
from openmmhelfrich.sampling.observables import readObservables


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def shifted(mesh, *shift):
    return mh.Mesh(mesh.vertices + shift, mesh.triangles)


# --- predicates


def exactOrientation(points):
    a, b, c, d = ([Fraction(float(x)) for x in point] for point in points)
    u, v, w = ([p[k] - d[k] for k in range(3)] for p in (a, b, c))
    determinant = sum(u[i] * (v[j] * w[k] - v[k] * w[j]) for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)))
    return (determinant > 0) - (determinant < 0)


coordinates = st.one_of(
    st.integers(-3, 3).map(float),
    st.sampled_from([0.1, 0.2, 0.3, 1 / 3, 1 + 2.0**-52, 1e-300, -1e15]),
    st.floats(-1, 1),
)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=4, max_size=4))
def test_orientations_are_exact(points):
    found = orientations(*(np.array([point]) for point in points))
    assert found.tolist() == [exactOrientation(points)]


def test_points_in_a_plane_to_the_last_bit():
    """A point that is next to a plane by one unit in the last place is on its side."""
    a, b, c = (np.array([x], dtype=float) for x in ([0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [0.1, 0.7, 0.1]))
    for z in (np.nextafter(0.1, 0), 0.1, np.nextafter(0.1, 1)):
        assert orientations(a, b, c, np.array([[0.2, 0.3, z]])).tolist() == [np.sign(0.1 - z)]


# --- crossings


@pytest.mark.parametrize(
    "corner, side",
    [((1, 0, 0), 1), ((1, 0.3, 0.2), 1), ((1, 0.25, 0.25), 0.5), ((1, 1, 0), 1), ((1, 1, 1), 1), ((0.2, 0.3, 1), 0.3)],
)
def test_what_touches_or_lies_in_a_plane_does_not_cross(corner, side):
    assert len(crossings(mh.Mesh.merged([cube(), cube(side, corner)]))) == 0


@pytest.mark.parametrize("shift", [(1, 0, 0), (0.7, 0, 0), (0, 0, 1.5), (0.5, 0.5, 0), (1, 0.1, 0.05)])
def test_spheres_that_meet_cross(shift):
    """Also where, by symmetry, edges meet edges."""
    sphere = mh.Mesh.icosphere(2)
    assert len(crossings(mh.Mesh.merged([sphere, shifted(sphere, *shift)]))) > 20
    assert len(crossings(mh.Mesh.merged([sphere, shifted(sphere, *(3 * np.array(shift)))]))) == 0


@pytest.mark.parametrize("gap, isCrossing", [(-0.01, True), (0.0, False), (0.01, False)])
def test_ridge_across_ridge(gap, isCrossing):
    roof = mh.Mesh([[-1, 0, 0], [1, 0, 0], [0, 1, -1], [0, -1, -1]], [(0, 1, 2), (1, 0, 3), (0, 2, 3), (1, 3, 2)])
    other = mh.Mesh(roof.vertices[:, [1, 0, 2]] * [1, 1, -1] + [0, 0, gap], roof.triangles)
    assert (len(crossings(mh.Mesh.merged([roof, other]))) > 0) == isCrossing


# --- facts


def test_angles():
    for angle, expected in ((triangleAngles(cube()).max(), 90), (dihedralAngles(cube()).max(), 90)):
        assert angle == pytest.approx(expected)
    flat = dihedralAngles(cube())
    assert np.isclose(flat, 0).sum() == 6 and np.isclose(flat, 90).sum() == 12


def test_columns_and_specks():
    sphere, ring = mh.Mesh.icosphere(2, 50), mh.Mesh.torus(150, 40, 20)
    speck = mh.Mesh.icosphere(0, 2)
    quality = assess(mh.Mesh.merged([sphere, ring, shifted(speck, 300, 0, 0)]))
    assert quality.genera == [0, 1, 0]
    lines = quality.lines()
    cells = {label: text.split() for label, text in lines}
    assert cells["surface"] == ["0", "1", "2"] and cells["genus"] == ["0", "1", "0"]
    assert [float(x) for x in cells["area, nm^2"]] == pytest.approx([m.area for m in (sphere, ring, speck)], rel=1e-5)
    assert [float(x) for x in cells["reduced volume"]] == pytest.approx(
        [m.reducedVolume for m in (sphere, ring, speck)], abs=1e-4
    )
    assert [text for _, text in lines if "speck" in text] == [quality.warnings()[0]]


def test_doubled_facets():
    sphere = mh.Mesh.icosphere(1, 100)
    x = sphere.vertices.copy()
    a, b, c = sphere.triangles[0]
    neighbor = next(t for t in sphere.triangles[1:] if {a, b} < set(t.tolist()))
    (apex,) = set(neighbor.tolist()) - {a, b}
    x[apex] = 0.999 * x[c] + 0.001 * x[a]
    quality = assess(mh.Mesh(x, sphere.triangles))
    assert any("one facet lies on another" in text for text in quality.warnings())


@pytest.mark.parametrize(
    "radius, unit, looksWrong",
    [
        (1, "nm", True),
        (50, "nm", False),
        (50, "angstrom", False),
        (1, "um", False),
        (1e4, "um", True),
        (1, "R0", False),
    ],
)
def test_units_that_look_wrong(radius, unit, looksWrong):
    warnings = assess(mh.Mesh.icosphere(1, radius)).warnings(unit)
    assert any("across" in text for text in warnings) == looksWrong


# --- verdicts


def commandsOf(output):
    return [line for line in output.splitlines() if line.startswith("openmm-helfrich ")]


def test_ready(inFolder):
    mh.Mesh.icosphere(2, 50).write("cell.ply")
    result = invoke("check", "cell.ply")
    assert result.exit_code == 0 and result.output.split()[-2:] == ["verdict", "ready"]


@pytest.mark.parametrize("mesh", [cube(), mh.Mesh.icosphere(0), mh.Mesh.icosphere(1)])
def test_too_few_vertices_are_ready_and_not_to_be_trusted(inFolder, mesh):
    """With the advice the warning is gone."""
    mesh.write("cell.ply")
    result = invoke("check", "cell.ply")
    assert result.exit_code == 0 and f"{len(mesh.vertices)} vertices are too few for" in result.output
    assert "Do not trust energies and shapes" in result.output
    (times,) = re.findall(r"subdivide = (\d) in \[mesh\]", result.output)
    for k, isEnough in ((int(times) - 1, False), (int(times), True)):
        (mesh.subdivided(k) if k else mesh).write("fine.ply")
        assert ("too few" not in invoke("check", "fine.ply").output) == isEnough
    configure(mesh=f'file = "cell.ply"\nsubdivide = {times}')
    assert "too few" not in invoke("run", "run.toml").output


@pytest.fixture
def unevenFolder(inFolder):
    pytest.importorskip("mmgpy")
    uvSphere(32, 16).write("cell.stl")
    return inFolder


def test_ready_after_remesh_as_the_command_says(unevenFolder):
    result = invoke("check", "cell.stl")
    assert (
        result.exit_code == 1 and "trajectories from this mesh are not accepted: its edges are 0.0382" in result.output
    )
    (command,) = commandsOf(result.output)
    assert command == "openmm-helfrich remesh cell.stl cell_even.ply --vertices 482"
    assert invoke(*shlex.split(command)[1:]).exit_code == 0
    assert invoke("check", "cell_even.ply").exit_code == 0


@pytest.mark.parametrize(
    "stretching, most, isReady, count",
    [
        (2.0, np.inf, True, 3),  # the first three are accepted
        (8.0, np.inf, False, 5),  # the first five have no chance
        (8.0, 1e3, False, 22),  # three can no longer be accepted of 24
    ],
)
def test_trajectories_are_tried_until_the_answer_is_certain(monkeypatch, stretching, most, isReady, count):
    sphere, tried, original = mh.Mesh.icosphere(2), [], readiness._nextEnergyChange

    def nextEnergyChange(simulation, trajectories):
        tried.append(min(original(simulation, trajectories), most))
        return tried[-1]

    monkeypatch.setattr(readiness, "_nextEnergyChange", nextEnergyChange)
    mesh = mh.Mesh(sphere.vertices * [1, 1, stretching], sphere.triangles)
    found = readiness._readinessAsItIs(mesh, "nm")
    assert (found.reason is None) == isReady and len(tried) == count


@pytest.mark.parametrize("stretching", [2.3, 2.8])
def test_check_and_runs_of_any_seed_have_one_answer(stretching):
    """For meshes of which some random numbers have enough trajectories accepted, and others have not."""
    sphere = mh.Mesh.icosphere(2)
    mesh = mh.Mesh(sphere.vertices * [1, 1, stretching], sphere.triangles)
    answers = {readiness.readinessOf(mesh, "cell.ply").reason}
    for seed in range(1, 7):
        scene = mh.Scene.of({"sampling": {"seed": seed}}, mesh)
        force = scene.createForce()
        answers.add(readiness.obstacle(scene, scene.createSimulation(force), force))
    assert len(answers) == 1


def apart(level, other, size=1.0):
    """Return two spheres that are far from each other."""
    sphere = mh.Mesh.icosphere(other)
    return mh.Mesh.merged([mh.Mesh.icosphere(level), mh.Mesh(size * sphere.vertices + [5, 0, 0], sphere.triangles)])


@pytest.mark.parametrize("mesh, number", [(apart(3, 2), 1), (apart(2, 3), 0), (apart(2, 2, 0.6), 1)])
def test_a_surface_with_which_the_tether_does_not_go_is_named(inFolder, mesh, number):
    """By check and by a run, though trajectories of such a mesh are accepted; with the command that mends it."""
    pytest.importorskip("mmgpy")
    mesh.write("cell.stl")
    configure()
    tether, mean = mh.Scene.of("run.toml").tether, mesh.components()[number].edgeLengths.mean()
    sentence = (
        f"the tether does not go with the edges of surface {number}: their mean length is {mean:.4g} nm, where the "
        f"tether keeps edges from {tether.minLength:.4g} to {tether.maxLength:.4g}; all surfaces must have edges of "
        "about one length"
    )
    checked, run = invoke("check", "cell.stl"), invoke("run", "run.toml")
    for result in (checked, run):
        assert result.exit_code == 1 and sentence in result.output
    (command,) = commandsOf(checked.output)
    assert command.endswith(f" --vertices {len(mesh.vertices)}") and "remesh = " in run.output
    assert invoke(*shlex.split(command)[1:]).exit_code == 0
    assert invoke("check", "cell_even.ply").exit_code == 0
    lengths = [surface.edgeLengths.mean() for surface in mh.Mesh.read("cell_even.ply").components()]
    assert max(lengths) < 1.05 * min(lengths)


@pytest.mark.parametrize("size", [0.8, 0.65])
def test_surfaces_of_somewhat_other_edges_are_ready(size):
    """Also where the mean is a little beyond the bounds: such runs came to good verdicts."""
    assert readiness.readinessOf(apart(2, 2, size), "two.ply").reason is None


def obstacleOf(mesh, least=0.15, most=0.25, **more):
    """Return the obstacle to a run, with bounds below the edges of icosphere(2) unless others are given."""
    tether = {"min_length": least, "max_length": most, **more.pop("tether", {})}
    config = {"tether": tether, "sampling": {"seed": 1, **more.pop("sampling", {})}, **more}
    scene = mh.Scene.of(config, mesh)
    force = scene.createForce()
    return readiness.obstacle(scene, scene.createSimulation(force), force)


@pytest.mark.filterwarnings("ignore:targets are more than")
def test_given_bounds_that_do_not_go_with_the_edges():
    """The bounds that are told do.  A target of the volume, which a stage leads there, changes nothing."""
    sentence = obstacleOf(mh.Mesh.icosphere(2))
    assert sentence.startswith("the tether does not go with the edges of the surface: their mean length is 0.2993 nm")
    (bounds,) = re.findall(r"; \[tether\] min_length = (\S+) and max_length = (\S+) go with them$", sentence)
    assert obstacleOf(mh.Mesh.icosphere(2), *map(float, bounds)) is None
    assert obstacleOf(mh.Mesh.icosphere(2), membrane={"reduced_volume": 0.8}) == sentence
    both = mh.Mesh.merged([apart(2, 2), shifted(mh.Mesh.icosphere(2, 0.9), 0, 5, 0)])
    (bounds,) = re.findall(r"min_length = (\S+) and max_length = (\S+) go with them$", obstacleOf(both))
    assert obstacleOf(both, *map(float, bounds)) is None


@pytest.mark.filterwarnings("ignore:targets are more than")
@pytest.mark.parametrize(
    "more",
    [
        {"tether": {"modulus": 0.0}},
        {"membrane": {"area_modulus": 0.0}},
        {"membrane": {"target_area": 5.0}},
        {"stages": [{"kind": "continue", "windows": 2, "target_area": 5.0}]},
        {"sampling": {"approach": "none"}, "membrane": {"target_area": 5.0}},
        {"sampling": {"flip_probability": 1.0}},
    ],
)
def test_bounds_that_edges_are_led_to_or_that_hold_nothing_are_no_obstacle(more):
    assert "does not go" not in str(obstacleOf(mh.Mesh.icosphere(2), **more))


def test_ready_after_repair_as_the_command_says(inFolder):
    sphere = mh.Mesh.icosphere(2)
    mh.Mesh(sphere.vertices, sphere.triangles[:, ::-1]).write("cell.ply")
    result = invoke("check", "cell.ply")
    assert result.exit_code == 1 and "is inside out" in result.output
    assert commandsOf(result.output) == ["openmm-helfrich repair cell.ply cell_repaired.ply"]


def test_ready_after_both(unevenFolder):
    mesh = uvSphere(32, 16)
    mh.Mesh(mesh.vertices, mesh.triangles[:, ::-1]).write("cell.stl")
    first, second = commandsOf(invoke("check", "cell.stl").output)
    assert first == "openmm-helfrich repair cell.stl cell_repaired.ply"
    assert second == "openmm-helfrich remesh cell_repaired.ply cell_repaired_even.ply --vertices 482"


def test_ready_after_closing_holes_as_the_command_says(inFolder):
    sphere = mh.Mesh.icosphere(3, 50)
    top = np.any(sphere.triangles == sphere.vertices[:, 2].argmax(), axis=1)
    mh.Mesh(sphere.vertices, sphere.triangles[~top]).write("a cell.ply")
    result = invoke("check", "a cell.ply")
    assert result.exit_code == 1 and "the surface is open" in result.output
    assert "a hole of 6 edges" in result.output and "around (" in result.output and "was closed" in result.output
    (command,) = commandsOf(result.output)
    assert command == "openmm-helfrich repair 'a cell.ply' 'a cell_repaired.ply' --close-holes"
    assert invoke(*shlex.split(command)[1:]).exit_code == 0
    assert invoke("check", "a cell_repaired.ply").exit_code == 0


def moebius(n=40):
    """A strip with one side."""
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    ends = [[(2 + s * np.cos(u / 2)) * np.cos(u), (2 + s * np.cos(u / 2)) * np.sin(u), s * np.sin(u / 2)]
            for u in turn for s in (-0.5, 0.5)]  # fmt: skip
    quads = [[2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2] for i in range(n - 1)] + [[2 * n - 2, 2 * n - 1, 0, 1]]
    return mh.Mesh(ends, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def test_what_nothing_mends(inFolder):
    moebius().write("cell.ply")
    result = invoke("check", "cell.ply")
    assert result.exit_code == 1 and "the surface is open" in result.output and not commandsOf(result.output)
    assert "but not all" in result.output


def test_surfaces_that_pass_through_themselves_all_over(inFolder):
    """Two copies of a surface that differ by noise are mended; two spheres that overlap nothing mends."""
    sphere, noise = mh.Mesh.icosphere(2), np.random.default_rng(1).normal(size=(162, 3))
    mh.Mesh.merged([sphere, mh.Mesh(sphere.vertices + 2e-6 * noise, sphere.triangles)]).write("twice.vtu")
    found = readiness.readinessOf(mh.Mesh.read("twice.vtu"), "twice.vtu")
    assert "passes through itself" in found.reason and found.commands[0].startswith("openmm-helfrich repair")
    mended = mh.Mesh.read("twice.vtu", repair=True)
    assert len(mended.triangles) == 320 and readiness.readinessOf(mended, "twice.vtu").reason is None
    small = mh.Mesh.icosphere(1)
    for shift, isReady in ((0.8, False), (1.9, True)):
        overlapping = mh.Mesh.merged([small, shifted(small, shift, 0.02, 0.05)])
        found = readiness.readinessOf(overlapping, "two.ply")
        assert len(crossings(overlapping)) and not found.commands
        assert found.reason is None if isReady else "part or merge what overlaps" in found.reason


def test_handles_that_are_too_thin_to_remesh_are_said(inFolder):
    """As noise in a segmentation makes them; no command is promised that would fail."""
    pytest.importorskip("mmgpy")
    pyvista = pytest.importorskip("pyvista")
    n = 20
    distance = np.sqrt(((np.mgrid[:n, :n, :n] - (n - 1) / 2) ** 2).sum(axis=0))
    field = pyvista.ImageData(dimensions=(n, n, n))
    field["value"] = (8 - distance + 0.8 * np.random.default_rng(0).normal(size=distance.shape)).ravel(order="F")
    noisy = field.contour([0.0])
    mh.Mesh(noisy.points, noisy.faces.reshape(-1, 4)[:, 1:]).write("noisy.ply")
    result = invoke("check", "noisy.ply")
    assert result.exit_code == 1 and not commandsOf(result.output)
    assert "handles, of which some are thinner" in result.output and "smooth the segmentation" in result.output


def test_periodic_meshes_are_replaced_and_not_remeshed(inFolder):
    """No advice is given that fails: remesh takes no periodic mesh."""
    sheet = mh.Mesh.sheet(10, 10, 1)
    x, wave = sheet.vertices.copy(), 2 * np.pi / 10
    x[:, 0] += 0.97 * np.sin(wave * x[:, 0]) / wave
    mh.Mesh(x, sheet.triangles, sheet.box).write("cell.ply")
    checked = invoke("check", "cell.ply")
    configure(mesh='file = "cell.ply"')
    run = invoke("run", "run.toml")
    tether = "[tether]\nmodulus = 10\nmin_length = 0.3\nmax_length = 0.5\n"
    configure(f"{tether}[[stages]]\nkind = 'minimize'\nwithin_bounds = true\n", "sheet = [10, 10, 1]")
    minimized = invoke("run", "run.toml")
    for result, source, length in (
        (checked, "cell.ply", 1.09),
        (run, "cell.ply", 1.09),
        (minimized, "[mesh] sheet", 0.4),
    ):
        assert result.exit_code == 1 and f"{source}: " in result.output and not commandsOf(result.output)
        assert f"begin with another mesh, with even edges about {length} nm long" in result.output


def test_lengths_are_in_the_unit_of_the_user(unevenFolder):
    result = invoke("check", "cell.stl", "--length-unit", "angstrom")
    assert "0.0382 to 0.276 angstrom long" in result.output


def test_run_with_repair_names_both_commands(unevenFolder):
    mesh = uvSphere(32, 16)
    mh.Mesh(mesh.vertices, mesh.triangles[:, ::-1]).write("cell.stl")
    configure(mesh='file = "cell.stl"\nrepair = true')
    result = invoke("run", "run.toml")
    first, second = (line.removeprefix("openmm-helfrich: ") for line in result.output.splitlines()[-3:-1])
    assert first.endswith("cell.stl " + str(unevenFolder / "cell_repaired.ply")) and "cell_repaired_even.ply" in second
    for command in (first, second):
        assert invoke(*shlex.split(command)[1:]).exit_code == 0
    assert invoke("check", "cell_repaired_even.ply").exit_code == 0


# --- runs


def configure(stages="[sampling]\nsteps = 100\nseed = 1\n", mesh='file = "cell.stl"'):
    with open("run.toml", "w") as file:
        file.write(f"[mesh]\n{mesh}\n[platform]\nthreads = 1\n{stages}")


@pytest.mark.parametrize("stepSize", ["", 'step_size = "auto"\n'])
def test_run_says_the_same_and_leaves_no_files(unevenFolder, stepSize):
    configure(f"[sampling]\nsteps = 100\nseed = 1\n{stepSize}")
    before = sorted(path.name for path in unevenFolder.iterdir())
    result = invoke("run", "run.toml")
    assert result.exit_code == 1 and "trajectories from this mesh are not accepted" in result.output
    assert "cell_even.ply --vertices 482" in result.output and "remesh = 482 in [mesh]" in result.output
    assert sorted(path.name for path in unevenFolder.iterdir()) == before


def test_remeshed_run_samples(unevenFolder):
    configure(mesh='file = "cell.stl"\nremesh = 482')
    result = invoke("run", "run.toml")
    assert result.exit_code == 0 and "remeshed: 482 vertices" in result.output
    assert readObservables("run.csv")["acceptance"][-1] > 0.6


def test_minimum_that_cannot_be_sampled_is_kept(unevenFolder):
    """A minimization makes the mesh no more even; the run stops before it samples, with the minimum written."""
    configure('[sampling]\nseed = 1\n[[stages]]\nkind = "minimize"\n[[stages]]\nkind = "sample"\nsteps = 100\n')
    result = invoke("run", "run.toml")
    assert result.exit_code == 1 and "trajectories from this mesh are not accepted" in result.output
    assert (unevenFolder / "run.checkpoint").exists() and len(readObservables("run.csv")["step"]) == 2
    again = invoke("resume", "run")
    assert again.exit_code == 1 and "trajectories from this mesh are not accepted" in again.output


@pytest.mark.parametrize("library", ["mmgpy", "igl"])
def test_an_extra_that_is_missing_is_named_with_the_command(inFolder, monkeypatch, library):
    """And not where nothing is missing, or what is told needs no library."""
    extra = "with the libraries that pip install 'openmm-helfrich[remesh]' brings"
    uvSphere(32, 16).write("cell.stl")
    configure()
    config, inverted = {"mesh": {"icosphere": 3}, "tether": {"min_length": 0.26, "max_length": 0.33}}, "inverted.ply"
    mh.Mesh.icosphere(2).reversed().write(inverted)
    for isMissing in (False, True) if util.find_spec("mmgpy") and util.find_spec("igl") else (True,):
        if isMissing:
            monkeypatch.setitem(sys.modules, library, None)
        assert (f"verdict  ready after, {extra}\n" in invoke("check", "cell.stl").output) == isMissing
        assert (f"it is ready after, {extra}\n" in invoke("run", "run.toml").output) == isMissing
        with pytest.raises(ValueError, match=r"it is ready with remesh = \d+ in \[mesh\]") as caught:
            mh.run({**config, "sampling": {"steps": 1}, "output": {"prefix": "a"}})
        assert str(caught.value).endswith(extra) == isMissing
        assert "verdict  ready after\n" in invoke("check", inverted).output


def test_small_steps_are_left_to_the_user(unevenFolder):
    """With a step size that an uneven mesh takes it runs; the verdict says what comes of it."""
    configure("[sampling]\nsteps = 20\nseed = 1\nstep_size = 1e-7\n")
    result = invoke("run", "run.toml")
    assert result.exit_code == 3 and "verdict  failed" in result.output
    assert readObservables("run.csv")["step"][-1] == 20


# --- flips of flat patches


@pytest.mark.parametrize("platform", ["CPU", "Reference"])
def test_flips_make_no_triangle_without_area(platform):
    """On the faces of a cube of a grid many flips would give three points on a line."""
    n = 6
    grid = np.linspace(0, 1, n + 1)
    side = np.array([[x, y] for x in grid for y in grid])
    square = [
        t
        for i in range(n)
        for j in range(n)
        for a in [i * (n + 1) + j]
        for t in [(a, a + n + 1, a + n + 2), (a, a + n + 2, a + 1)]
    ]
    faces = []
    for axis, level in product(range(3), (0, 1)):
        x = np.insert(side, axis, level, axis=1)
        outward = (level == 1) != (axis == 1)
        faces.append(mh.Mesh(x, np.array(square)[:, :: 1 if outward else -1]))
    mesh = mh.Mesh.merged(faces)
    vertices, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    mesh = mh.Mesh(vertices, number.ravel()[mesh.triangles])
    mesh.check()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(1)
    system = mesh.createSystem()
    system.addForce(force)
    flips = mh.EdgeFlipIntegrator(300, 1)
    flips.setRandomNumberSeed(1)
    context = mm.Context(system, flips, mm.Platform.getPlatformByName(platform))
    context.setPositions(mesh.vertices)
    flips.step(20)
    assert flips.getNumAccepted() > 100
    mh.Mesh(mesh.vertices, force.getTrianglesInContext(context)).check()


def test_advice_on_a_subdivided_mesh_leaves_subdivide_out(tmp_path):
    mesh = mh.Mesh.icosphere(2)
    mesh.vertices *= [1, 1, 4]
    mesh.write(tmp_path / "long.ply")
    with pytest.raises(
        ValueError, match=r"ready after, without subdivide,\n.* --vertices 642\nor with remesh = 642 in"
    ):
        mh.run(
            {"mesh": {"file": str(tmp_path / "long.ply"), "subdivide": 1}, "output": {"prefix": str(tmp_path / "a")}}
        )


def test_a_tether_that_no_mesh_of_the_surface_goes_with_is_to_have_other_lengths(inFolder):
    """Those that are told do, and so does one that only another mesh goes with."""

    def begin(level, least, most):
        tether = {"min_length": least, "max_length": most}
        mh.run({"mesh": {"icosphere": level}, "tether": tether, "sampling": {"steps": 1}, "output": {"prefix": "a"}})

    with pytest.raises(ValueError, match=r"a surface has at most [0-9] vertices, and must have 162 or more") as caught:
        begin(2, 2.0, 3.0)
    message = str(caught.value)
    assert "remesh" not in message
    begin(2, *map(float, re.search(r"edges that there are, (\S+) and (\S+) nm$", message).groups()))
    with pytest.raises(ValueError, match=r"it is ready with remesh = 1\d\d in \[mesh\]"):
        begin(3, 0.26, 0.33)


@pytest.mark.parametrize("stretching", [(1, 1, 0.1), (1, 1, 0.003), (1, 1, 0.001), (1, 0.02, 0.02), (1, 1, 12)])
@pytest.mark.parametrize("level", [2, 3])
def test_commands_for_thin_surfaces_are_tried(inFolder, stretching, level):
    """None is given that fails, takes the shape away, or makes nothing that is ready."""
    pytest.importorskip("mmgpy")
    sphere = mh.Mesh.icosphere(level, 50)
    mesh = mh.Mesh(sphere.vertices * stretching, sphere.triangles)
    mesh.write("thin.ply")
    result = invoke("check", "thin.ply")
    assert result.exit_code == 1 and "trajectories from this mesh are not accepted" in result.output
    for command in commandsOf(result.output):
        assert invoke(*shlex.split(command)[1:]).exit_code == 0
        assert mh.Mesh.read("thin_even.ply").volume == pytest.approx(mesh.volume, rel=0.1)
        assert invoke("check", "thin_even.ply").exit_code == 0
    assert bool(commandsOf(result.output)) == (stretching in ((1, 1, 0.1), (1, 1, 12)))
    assert bool(commandsOf(result.output)) != ("; and " in result.output)


def test_runs_name_no_remesh_that_fails(inFolder):
    pytest.importorskip("mmgpy")
    sphere = mh.Mesh.icosphere(2, 50)
    mh.Mesh(sphere.vertices * [1, 1, 0.003], sphere.triangles).write("cell.stl")
    configure()
    result = invoke("run", "run.toml")
    assert result.exit_code == 1 and "remesh with 162 vertices changes its area by -" in result.output
    assert "ready" not in result.output and "openmm-helfrich remesh" not in result.output


def test_needles_that_cannot_be_remeshed_are_said(inFolder):
    """No command is given that would fail."""
    pytest.importorskip("mmgpy")
    mesh = mh.Mesh.icosphere(2)
    mh.Mesh(mesh.vertices * [1, 1, 1000], mesh.triangles).write("needle.ply")
    result = invoke("check", "needle.ply")
    assert result.exit_code == 1 and "too long and thin for so few vertices" in result.output
    assert "ready after" not in result.output


# --- copies


def smoothed(mesh):
    """Return a mesh with each vertex moved halfway to the mean of its neighbors."""
    a, b = np.concatenate((mesh.edges, mesh.edges[:, ::-1])).T
    sums = np.column_stack([np.bincount(a, mesh.vertices[b, k]) for k in range(3)])
    return mh.Mesh((mesh.vertices + sums / np.bincount(a)[:, np.newaxis]) / 2, mesh.triangles)


def turned(mesh):
    """Return a mesh of the same shape, if it is a sphere, with triangles in other places."""
    c, s = np.cos(0.3), np.sin(0.3)
    return mh.Mesh(mesh.vertices @ [[c, s, 0], [-s, c, 0], [0, 0, 1]], mesh.triangles)


@pytest.mark.parametrize("other", [smoothed, lambda m: mh.Mesh(0.999 * m.vertices, m.triangles)])
def test_copies_are_ready_with_a_warning(inFolder, other):
    sphere = mh.Mesh.icosphere(2, 50)
    mh.Mesh.merged([shifted(sphere, 200, 0, 0), sphere, other(sphere)]).write("two.ply")
    result = invoke("check", "two.ply")
    assert result.exit_code == 0 and "surfaces 1 and 2 are within" in result.output
    assert "leave one out, by repair --keep or in the program that exported the file" in result.output


@pytest.mark.parametrize("suffix", ["ply", "stl"])
@pytest.mark.parametrize(
    "other", [turned(mh.Mesh.icosphere(3, 50)), mh.Mesh.icosphere(3, 50), mh.Mesh.icosphere(1, 50)]
)
def test_copies_that_cross_or_touch_are_named(inFolder, suffix, other):
    mh.Mesh.merged([mh.Mesh.icosphere(2, 50), other]).write(f"two.{suffix}")
    result = invoke("check", f"two.{suffix}")
    assert result.exit_code == 1 and not commandsOf(result.output)
    assert "surfaces 0 and 1 are within" in result.output and "mends this" not in result.output


def test_repair_tells_what_it_leaves(inFolder):
    """Of copies that cross, and of those that do not."""
    sphere = mh.Mesh.icosphere(2, 50)
    for other, code in ((turned(mh.Mesh.icosphere(3, 50.02)), 1), (mh.Mesh.icosphere(2, 49.9), 0)):
        mh.Mesh.merged([sphere, other]).write("two.ply")
        result = invoke("repair", "two.ply", "out.ply", "--overwrite")
        assert result.exit_code == code and "surfaces 0 and 1 are within" in result.output
        assert ("passes through itself" in result.output) == (code == 1)
        kept = invoke("repair", "two.ply", "out.ply", "--overwrite", "--keep", "1")
        assert kept.exit_code == 0 and "surfaces" not in kept.output


def test_the_distance_of_copies_is_known():
    """And each pair is told, however the surfaces are divided into triangles."""
    sphere = mh.Mesh.icosphere(3, 50)
    for step in (0.1, 0.5):
        ((first, second, distance, part),) = assess(
            mh.Mesh.merged([sphere, mh.Mesh((1 - step / 50) * sphere.vertices, sphere.triangles)])
        ).copies
        assert (first, second) == (0, 1) and distance == pytest.approx(step, rel=0.02)
        assert part == pytest.approx(step / sphere.edgeLengths.mean(), rel=0.03)
    three = assess(mh.Mesh.merged([sphere, shifted(turned(sphere), 0.2, -0.1, 0.1), shifted(sphere, 0.1, 0.2, 0.1)]))
    assert [(c.first, c.second) for c in three.copies] == [(0, 1), (0, 2), (1, 2)]
    assert "the first of 3 pairs" in three.copied()
    sheet = mh.Mesh.sheet(10, 10, 1)
    for step, count in ((0.05, 1), (0.5, 0)):
        both = mh.Mesh.merged([sheet, mh.Mesh(sheet.vertices + np.array([4.3, 0.2, step]), sheet.triangles, sheet.box)])
        assert len(assess(both).copies) == count


@pytest.mark.parametrize("gap", [0.5, 1.0])
def test_what_lies_beside_is_no_copy(gap):
    """Nested vesicles and leaflets, of equal and other edges, neighbors, small vesicles at the side of a large one."""
    sphere, small = mh.Mesh.icosphere(3, 50), mh.Mesh.icosphere(2, 10)
    gap *= float(sphere.edgeLengths.mean())
    for others in (
        [mh.Mesh.icosphere(3, 50 - gap)],
        [mh.Mesh.icosphere(2, 50 - gap)],
        [mh.Mesh.icosphere(4, 50 - gap)],
        [turned(mh.Mesh.icosphere(3, 50 - gap))],
        [shifted(sphere, 100 + 0.01 * gap, 0, 0)],
        [shifted(small, 39.7, 0, 0), shifted(small, 0, 0, -60.1)],
    ):
        assert assess(mh.Mesh.merged([sphere, *others])).copied() is None


def test_what_repair_closes_and_leaves_overlapping_is_said(inFolder):
    sphere = mh.Mesh.icosphere(2, 50)
    top = sphere.triangles[sphere.vertices[sphere.triangles].mean(axis=1)[:, 2] > 0]
    mh.Mesh.merged([sphere, shifted(mh.Mesh(sphere.vertices, top), 1, 0, 0)]).write("two.ply")
    result = invoke("check", "two.ply")
    assert result.exit_code == 1 and not commandsOf(result.output)
    assert "; but then the surface passes through itself" in result.output


def test_surfaces_without_size_are_no_copies():
    point = mh.Mesh(np.zeros((4, 3)), [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
    found = readiness.readinessOf(mh.Mesh.merged([point, point]), "two.ply")
    assert "has no area" in found.reason and "copies" not in found.reason
