"""Periodic membranes: a sheet in a box has the energies, forces and flips of the same sheet without an end."""

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
from membranes import PLATFORMS, createContext, energyOf, forcesOf, kelvin, positionsOf
from openmmhelfrich.geometry import quality
from openmmhelfrich.geometry.measured import MeasuredMesh
from openmmhelfrich.io.dcdframes import DCDTrajectory
from openmmhelfrich.runs.stages import checkStages
from openmmhelfrich.runs.surfaces import leastAreas

TERMS = ["bending", "area", "areaDifference", "tether", "repulsion", "tension", "gaussian", "line", "pair"]


def createSheet(side=(9.0, 8.0), seed=1, noise=0.12):
    """Return a rough sheet with long waves, whose vertices are anywhere beside the borders of the box."""
    mesh = mh.Mesh.sheet(*side, 1.0)
    random = np.random.default_rng(seed)
    x = mesh.vertices + random.uniform(-noise, noise, mesh.vertices.shape)
    phases = 2 * np.pi * x[:, :2] / np.diag(mesh.box)[:2]
    x[:, 2] += 0.5 * np.sin(phases[:, 0]) + 0.4 * np.cos(phases[:, 1])
    return mh.Mesh(x + np.array([0.3, -0.2, 0.5]), mesh.triangles, mesh.box)


def createForce(mesh, terms=TERMS, exclusionLevel=1):
    """Return a periodic force with some terms, each far from its minimum."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setUsesPeriodicBoundaryConditions(True)
    isMixed = bool({"gaussian", "line", "pair"} & set(terms))
    if isMixed:
        for modulus, curvature, gaussian in ((20.0, 0.3, -9.0), (12.0, -0.6, 5.0), (27.0, 1.1, -3.0)):
            force.addSpecies(modulus * ("bending" in terms), curvature, gaussian * ("gaussian" in terms))
        force.setVertexSpecies(np.arange(len(mesh.vertices)) // 3 % 3)
        for a, b in ((0, 1), (0, 2), (1, 2)):
            force.setLineTension(a, b, (5 + a + 3 * b) * ("line" in terms))
            force.setPairEnergy(a, b, (2 + a - b) * ("pair" in terms))
    elif "bending" in terms:
        force.setBendingModulus(20)
        force.setSpontaneousCurvature(0.2)
    if "area" in terms:
        force.setAreaModulus(3000)
        force.setTargetArea(1.1 * mesh.area)
    if "areaDifference" in terms:
        force.setAreaDifferenceModulus(2)
        force.setTargetAreaDifference(3)
    if "tether" in terms:
        force.setTether(7, 0.95, 1.1, 3)
    if "repulsion" in terms:
        force.setRepulsion(0.5, 1.9, 2, exclusionLevel)
    if "tension" in terms:
        force.setTension(30)
    return force


SCENES = (
    [([term], 1) for term in TERMS] + [(["bending", "tether", "area"], 1)] + [(TERMS, level) for level in (0, 1, 2)]
)


def wrapped(mesh):
    """Return the positions with each vertex in the box, and a few boxes more for some."""
    lengths = np.diag(mesh.box)
    inside = mesh.vertices - np.floor(mesh.vertices / lengths) * lengths
    return inside + lengths * np.random.default_rng(3).integers(-1, 2, mesh.vertices.shape)


@pytest.mark.parametrize("terms, level", SCENES)
def test_forces_are_derivatives_of_the_energy(terms, level):
    mesh = createSheet((6.0, 6.0))
    context = createContext(mesh, createForce(mesh, terms, level))
    forces, h = forcesOf(context), 1e-5
    scale = max(np.abs(forces).max(), 1e-3)
    for vertex in (0, 4, 17, len(mesh.vertices) - 1):
        for axis in range(3):
            energies = []
            for sign in (1, -1):
                x = wrapped(mesh)
                x[vertex, axis] += sign * h
                context.setPositions(x)
                energies.append(energyOf(context))
            assert (energies[1] - energies[0]) / (2 * h) == pytest.approx(forces[vertex, axis], abs=2e-6 * scale)


@pytest.mark.parametrize("terms, level", SCENES)
def test_platforms_agree(terms, level):
    mesh = createSheet()
    contexts = [createContext(mesh, createForce(mesh, terms, level), platform) for platform in PLATFORMS]
    reference, cpu = (energyOf(context) for context in contexts)
    assert cpu == pytest.approx(reference, rel=1e-10, abs=1e-10)
    forces, own = (forcesOf(context) for context in contexts)
    assert np.abs(forces - own).max() < 1e-10 * max(np.abs(forces).max(), 1)


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("level", [1, 2])
def test_translations_and_images_change_nothing(platform, level):
    mesh = createSheet()
    force = createForce(mesh, TERMS, level)
    context = createContext(mesh, force, platform)
    energy, forces = energyOf(context), forcesOf(context)
    moved = mesh.vertices + np.array([1.7, -40.1, 3.3])
    for positions in (moved, mesh.vertices + mesh.box[0] - 2 * mesh.box[1], wrapped(mesh)):
        context.setPositions(positions)
        assert energyOf(context) == pytest.approx(energy, rel=1e-10)
        assert np.abs(forcesOf(context) - forces).max() < 1e-9 * np.abs(forces).max()


def tiled(mesh):
    """Return four copies of a sheet side by side, in a box of twice the width and height."""
    n, lengths = len(mesh.vertices), np.diag(mesh.box)
    places = [(i, j) for i in (0, 1) for j in (0, 1)]
    inside = mesh.vertices - np.floor(mesh.vertices / lengths) * lengths
    x = np.concatenate([inside + lengths * np.array([i, j, 0]) for i, j in places])
    images = np.rint((mesh.vertices[mesh.triangles[:, :1]] - mesh.vertices[mesh.triangles]) / lengths).astype(int)
    corners = np.floor(mesh.vertices / lengths).astype(int)[mesh.triangles]
    images = images + corners - corners[:, :1]
    triangles = []
    for i, j in places:
        tile = (images[..., 0] + i) % 2 * 2 + (images[..., 1] + j) % 2
        triangles.append(mesh.triangles + n * tile)
    return mh.Mesh(x, np.concatenate(triangles), np.diag(lengths * [2, 2, 1]))


@pytest.mark.parametrize("platform", PLATFORMS)
def test_four_tiles_have_four_times_the_energy(platform):
    mesh = createSheet((6.0, 6.0))
    terms = ["bending", "tether", "repulsion", "tension"]
    one = energyOf(createContext(mesh, createForce(mesh, terms), platform))
    four = tiled(mesh)
    assert four.area == pytest.approx(4 * mesh.area, rel=1e-12)
    assert energyOf(createContext(four, createForce(four, terms), platform)) == pytest.approx(4 * one, rel=1e-10)


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("terms, level", SCENES)
def test_each_flip(platform, terms, level):
    """After each flip, energy and forces are those of a new Context with its triangles."""
    mesh = createSheet((6.0, 6.0))
    force = createForce(mesh, terms, level)
    flips = mh.EdgeFlipIntegrator(kelvin(500), 1 / len(mesh.edges))
    flips.setRandomNumberSeed(5)
    context = createContext(mesh, force, platform, flips)
    context.setPositions(wrapped(mesh))
    for _ in range(40):
        accepted = flips.getNumAccepted()
        flips.step(1)
        if flips.getNumAccepted() == accepted:
            continue
        fresh = createForce(mesh, terms, level)
        fresh.setTriangles(force.getTrianglesInContext(context))
        other = createContext(mesh, fresh, platform)
        assert energyOf(context) == pytest.approx(energyOf(other), rel=1e-11, abs=1e-11)
    assert flips.getNumAccepted() > 8


@pytest.mark.parametrize("level", [1, 2])
def test_platforms_and_threads_make_the_same_flips_and_exchanges(level):
    mesh = createSheet((16, 17))
    outcomes = []
    for platform, threads in (("Reference", None), ("CPU", 1), ("CPU", 2)):
        force = createForce(mesh, TERMS, level)
        exchange = mh.SpeciesExchangeIntegrator(kelvin(20), 0.3)
        compound = mm.CompoundIntegrator()
        flips = mh.EdgeFlipIntegrator(kelvin(50), 0.5)
        for move in (flips, exchange):
            move.setRandomNumberSeed(7)
            compound.addIntegrator(move)
        properties = {} if threads is None else {"Threads": str(threads)}
        context = createContext(mesh, force, platform, compound, properties)
        context.setPositions(wrapped(mesh))
        for i in (0, 1, 0, 1):
            compound.setCurrentIntegrator(i)
            compound.step(1)
        assert flips.getNumAccepted() > 20 and exchange.getNumAccepted() > 20
        outcomes.append((force.getTrianglesInContext(context), force.getVertexSpeciesInContext(context)))
    for triangles, species in outcomes[1:]:
        assert np.array_equal(triangles, outcomes[0][0]) and np.array_equal(species, outcomes[0][1])


def createHmc(seed=2, **settings):
    hmc = mh.HybridMonteCarloIntegrator(300, settings.get("stepSize", 0.02), 20, 0.3, 0.5)
    hmc.setRandomNumberSeed(seed)
    hmc.setForcePrecision(settings.get("precision", "double"))
    hmc.setMultilevelWeight(settings.get("weight", 0.0))
    return hmc


@pytest.mark.parametrize("precision", ["double", "mixed"])
@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_trajectories_conserve_energy_and_do_not_see_the_box(precision, weight):
    """Positions that are images of each other give the same chain."""
    mesh = createSheet((12, 11), noise=0.05)
    terms, ends = ["bending", "tether", "tension", "repulsion"], []
    for positions in (mesh.vertices, wrapped(mesh)):
        hmc = createHmc(precision=precision, weight=weight, stepSize=0.003)
        context = createContext(mesh, createForce(mesh, terms), "CPU", hmc)
        context.setPositions(positions)
        start = energyOf(context)
        hmc.step(6)
        assert energyOf(context) != start
        assert hmc.getAcceptanceRate() > 0.5
        ends.append((positionsOf(context) - positions, energyOf(context)))
    tolerance = 1e-9 if precision == "double" else 1e-4
    assert np.abs(ends[0][0] - ends[1][0]).max() < tolerance
    assert ends[0][1] == pytest.approx(ends[1][1], rel=tolerance)


def test_checkpoints_and_xml_keep_it():
    mesh = createSheet()
    force = createForce(mesh)
    copy = mm.XmlSerializer.deserialize(mm.XmlSerializer.serialize(force))
    assert copy.usesPeriodicBoundaryConditions()
    assert not mm.XmlSerializer.deserialize(
        mm.XmlSerializer.serialize(mh.HelfrichForce())
    ).usesPeriodicBoundaryConditions()
    hmc = createHmc(stepSize=0.003)
    context = createContext(mesh, force, "CPU", hmc)
    hmc.step(2)
    checkpoint = context.createCheckpoint()
    hmc.step(3)
    end = energyOf(context)
    other = createHmc(stepSize=0.003)
    resumed = createContext(mesh, copy, "CPU", other)
    resumed.loadCheckpoint(checkpoint)
    other.step(3)
    assert energyOf(resumed) == end


@pytest.mark.parametrize("platform", PLATFORMS)
def test_geometry_of_mesh_and_force(platform):
    mesh = createSheet()
    force = createForce(mesh, ["bending"])
    geometry = force.getGeometryInContext(createContext(mesh, force, platform))
    assert geometry.area.value_in_unit(unit.nanometer**2) == pytest.approx(mesh.area, rel=1e-12)
    assert geometry.volume.value_in_unit(unit.nanometer**3) == 0
    assert np.allclose(geometry.vertexMeanCurvatures.value_in_unit(unit.nanometer), mesh.vertexMeanCurvatures)


def test_meshes_of_sheets():
    mesh = mh.Mesh.sheet(12, 9, 1.0)
    mesh.check()
    assert mesh.isPeriodic and np.allclose(mesh.vertexMeanCurvatures, 0)
    assert mesh.area == pytest.approx(12 * 9, rel=1e-12)
    assert mesh.edgeLengths.mean() == pytest.approx(1, rel=0.05) and mesh.edgeLengths.std() < 0.05
    assert len(mesh.vertices) - len(mesh.edges) + len(mesh.triangles) == 0
    vectors = mesh.createSystem().getDefaultPeriodicBoxVectors()
    assert np.array_equal([vector / unit.nanometer for vector in vectors], mesh.box)
    with pytest.raises(ValueError, match="encloses no volume"):
        mesh.volume  # noqa: B018
    for width, edge, problem in ((0, 1, "must be positive"), (9, 2, "at most a fifth"), (9, 0, "at most a fifth")):
        with pytest.raises(ValueError, match=problem):
            mh.Mesh.sheet(width, 9, edge)


def test_the_box_changes_no_measure_of_a_mesh():
    """Lengths, areas, angles, curvatures and what is close do not depend on which image of a vertex is taken."""
    mesh = createSheet()
    other = mh.Mesh(wrapped(mesh), mesh.triangles, mesh.box)
    assert other.isPeriodic
    for name in ("edgeLengths", "triangleAreas", "vertexMeanCurvatures"):
        assert np.allclose(getattr(mesh, name), getattr(other, name), atol=1e-12)
    one, two = quality.assess(mesh), quality.assess(other)
    assert np.allclose(one.angles, two.angles) and np.allclose(one.dihedrals, two.dihedrals)
    assert one.closestPair == pytest.approx(two.closestPair)
    assert len(one.crossings) == len(two.crossings) == 0
    open_ = other.unwrapped()
    assert open_.area == pytest.approx(mesh.area, rel=1e-12) and open_.edgeLengths.max() < 2 * mesh.edgeLengths.max()
    assert np.ptp(open_.vertices[:, 2]) == pytest.approx(np.ptp(mesh.vertices[:, 2]))


def test_crossings_through_the_border():
    """A sheet so rough that it passes through itself everywhere does so as often in each of its tiles."""
    mesh = createSheet(noise=0.7)
    count = len(quality.crossings(mesh))
    assert count > 10
    assert len(quality.crossings(mh.Mesh(wrapped(mesh), mesh.triangles, mesh.box))) == count
    assert len(quality.crossings(tiled(mesh))) == 4 * count


@pytest.mark.parametrize("suffix", ["tsi", "q", "ply"])
def test_files_keep_the_box(tmp_path, suffix):
    mesh = createSheet()
    mesh.write(tmp_path / f"sheet.{suffix}")
    read = mh.Mesh.read(tmp_path / f"sheet.{suffix}")
    assert read.isPeriodic and np.allclose(read.box, mesh.box) and np.array_equal(read.triangles, mesh.triangles)
    assert read.area == pytest.approx(mesh.area, rel=1e-6)
    with pytest.raises(ValueError, match=r"files of this format have no box; use one of .*, or \.vtkhdf"):
        mesh.write(tmp_path / "sheet.stl")
    with pytest.raises(ValueError, match=r"no mesh format has the suffix '\.gro'"):
        mesh.write(tmp_path / "sheet.gro")
    with pytest.raises(ValueError, match="periodic"):
        read.remeshed(100)


def test_trajectories_keep_the_box(tmp_path):
    mesh = createSheet()
    frames = [mh.meshFrame(step, mh.Mesh(mesh.vertices + step, mesh.triangles, mesh.box)) for step in range(3)]
    mh.writeMeshTrajectory(tmp_path / "sheet.vtkhdf", frames)
    for frame in mh.readMeshTrajectory(tmp_path / "sheet.vtkhdf"):
        assert frame.mesh.isPeriodic and frame.mesh.area == pytest.approx(mesh.area, rel=1e-12)
    with pytest.raises(ValueError, match="another periodic box"):
        other = mh.meshFrame(3, mh.Mesh(2 * mesh.vertices, mesh.triangles, 2 * mesh.box))
        mh.writeMeshTrajectory(tmp_path / "sheet.vtkhdf", [*frames, other])


REFUSED = [
    (lambda force: force.setVolumeModulus(1) or force.setTargetVolume(1), "volume term is on.*encloses no volume"),
    (lambda force: force.setPressure(1), "pressure term is on.*encloses no volume"),
    (lambda force: force.setRepulsion(1, 4, 2), "repulsion's onset 4 nm; it must be at most a third"),
]


@pytest.mark.parametrize("change, problem", REFUSED)
def test_what_has_no_meaning_is_refused(change, problem):
    mesh = createSheet()
    force = createForce(mesh, ["bending"])
    change(force)
    with pytest.raises(mm.OpenMMException, match=problem):
        energyOf(createContext(mesh, force))


def test_boxes_and_moves_that_are_refused():
    mesh = createSheet()
    force = createForce(mesh, ["bending"])
    context = createContext(mesh, force)
    energy = energyOf(context)
    lengths = np.diag(mesh.box)
    for box, problem in (
        (np.diag(lengths / 4), "at least twice as long as any edge"),
        (np.diag(lengths) + np.eye(3, k=-1)[[0, 1, 0]], r"box vector b is \(1, .* needs a rectangular box"),
    ):
        context.setPeriodicBoxVectors(*box)
        with pytest.raises(mm.OpenMMException, match=problem):
            energyOf(context)
    context.setPeriodicBoxVectors(*mesh.box)
    assert energyOf(context) == energy
    context.setParameter(force.getPressureParameter(), 1)
    with pytest.raises(mm.OpenMMException, match="pressure term is on"):
        energyOf(context)
    with pytest.raises(mm.OpenMMException, match="is periodic, and waves in any direction would tear it"):
        createContext(mesh, createForce(mesh, ["bending"]), "CPU", mh.ShearWaveIntegrator(300, 0.1, 0.1, 1))


def test_sheets_do_not_tear():
    """Without a tether edges would grow beyond half the box, where nearest images no longer make triangles."""
    mesh = mh.Mesh.sheet(5, 5, 1.0)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setUsesPeriodicBoundaryConditions(True)
    force.setBendingModulus(0.5)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.001, 100, flipFraction=0)
    integrator.setRandomNumberSeed(3)
    system = mesh.createSystem()
    system.addForce(force)
    context = mm.Context(system, integrator, mm.Platform.getPlatformByName("CPU"), {"Threads": "1"})
    context.setPositions(mesh.vertices)
    integrator.step(300)
    assert integrator.getNumAcceptedTrajectories() > 5 and integrator.getNumDivergedTrajectories() > 0
    assert np.isfinite(energyOf(context))  # which a sheet that is torn has not
    torn = mesh.vertices.copy()
    torn[0] += [2.5, 0, 0]
    context.setPositions(torn)
    with pytest.raises(mm.OpenMMException, match="make no triangle: the box must be that of the mesh"):
        energyOf(context)


def test_meshes_that_are_torn_are_refused():
    mesh = mh.Mesh.sheet(5, 5, 1.0)
    mesh.check()
    mesh.vertices[0] += [2.5, 0, 0]
    with pytest.raises(ValueError, match=r"triangle .* is torn: the nearest images of its vertices in the box of 5"):
        mesh.check()


def test_runs_of_sheets(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = {
        "mesh": {"sheet": [8, 8, 1.0]},
        "sampling": {"steps": 30, "step_size": 0.004, "seed": 3},
        "output": {"prefix": "sheet", "trajectory_interval": 5, "observables_interval": 1},
    }
    summary = mh.run(config)
    assert "volume" not in summary.table and "reducedVolume" not in summary.table
    trajectory = mh.readMeshTrajectory("sheet.vtkhdf")
    assert trajectory[-1].mesh.isPeriodic
    assert mh.Mesh.read("sheet.ply").area == pytest.approx(summary.table["area"][-1], rel=1e-5)
    mh.resume("sheet", 10)
    assert mh.readObservables("sheet.csv")["step"][-1] == 40
    for section, key, value, problem in (
        ("membrane", "volume_modulus", 10.0, "encloses no volume"),
        ("membrane", "reduced_volume", 0.9, "encloses no volume"),
        ("membrane", "pressure", 0.1, "encloses no volume"),
        ("sampling", "shear_wave_probability", 0.1, "would tear it"),
        ("tether", "max_length", 4.01, "max_length is 4.01; it must be at most half of the shortest side"),
    ):
        with pytest.raises(ValueError, match=problem):
            mh.Scene.of({**config, section: {**config.get(section, {}), key: value}})


def sheetWith(membrane, *stages):
    """Check the configuration of a sheet of 8 by 8."""
    config = {"mesh": {"sheet": [8, 8, 1.0]}, "membrane": membrane, "sampling": {"seed": 1}}
    checkStages(mh.Scene.of({**config, **({"stages": list(stages)} if stages else {})}))


def test_a_target_area_below_that_of_the_box_is_refused():
    """No shape of a sheet has it, be it of [membrane], or of a stage; of several surfaces each has its own."""
    held, words = {"area_modulus": 1e5}, r"it must be at least 64, the area of the sheet when it is flat across"
    with pytest.raises(ValueError, match=rf"\[membrane\] target_area is 60; {words}"):
        sheetWith({**held, "target_area": 60.0})
    for kind in ("sample", "approach", "continue"):
        with pytest.raises(ValueError, match=rf"stage 1 \({kind}\): target_area is 50; {words}"):
            sheetWith(held, {"kind": kind, "steps": 10, "target_area": 50.0})
    sheetWith({**held, "target_area": 63.8})  # a rounded number
    sheetWith({**held, "target_area": 70.0}, {"kind": "continue", "steps": 10, "target_area": 64.0})
    sheet = mh.Mesh.sheet(8, 8, 1.0)
    lower = mh.Mesh(sheet.vertices + np.array([0, 0, 3]), sheet.triangles[:, ::-1].copy(), sheet.box)
    with pytest.raises(ValueError, match=rf"target_area\[1\] is 60; {words}"):
        mh.Scene.of({"membrane": {**held, "target_area": [65.0, 60.0]}}, mh.Mesh.merged([sheet, lower]))


def test_the_least_area_of_a_sheet_is_that_of_its_box_whatever_its_shape():
    sheet = createSheet()
    assert sheet.area > 75 and leastAreas(MeasuredMesh(sheet)) == {"area": pytest.approx(72, rel=1e-12)}
    assert leastAreas(MeasuredMesh(mh.Mesh.icosphere(1))) == {}  # a closed surface has none


def test_an_area_difference_that_a_flat_sheet_has_not_is_asked_for():
    """What is named is the modulus that is given, and not a target that is not."""
    held, words = {"area_difference_modulus": 100.0}, "give such a target_area_difference, or an .*modulus of 0"
    with pytest.raises(ValueError, match=rf"\[membrane\] area_difference_modulus is 100, .*is 0; its size.*{words}"):
        sheetWith(held)
    with pytest.raises(ValueError, match=rf"stage 1 \(sample\): area_difference_modulus is 100, .*is 0; .*{words}"):
        sheetWith({}, {"kind": "sample", "steps": 10, **held})
    target = {"target_area_difference": 0.5}
    path = r"stage 1 \(continue\): the path to target_area_difference = 0.5 begins with an area difference of 0"
    with pytest.raises(ValueError, match=rf"{path}, (?!.*unit of length).*stage of kind sample before it give"):
        sheetWith({}, {"kind": "continue", "steps": 10, **held, **target})
    sheetWith({**held, **target}, {"kind": "continue", "steps": 10, "target_area_difference": 1.0})


@pytest.mark.parametrize("target", [1.0, -1.0])
def test_a_flat_sheet_is_minimized_to_an_area_difference(inFolder, target):
    """No force leads there, whose sides are alike."""
    config = {
        "mesh": {"sheet": [10, 10, 1.0]},
        "membrane": {"area_difference_modulus": 1000.0, "target_area_difference": target},
        "sampling": {"seed": 1},
        "stages": [{"kind": "minimize", "fluid": False}],
        "output": {"prefix": "sheet"},
    }
    result = mh.run(config)
    assert result.mean("areaDifference") == pytest.approx(target, rel=0.05) and result.verdict.level == "good"


def test_bending_keeps_a_sheet_flat_where_the_modulus_of_its_area_is_soft(inFolder):
    """The advice is a larger modulus, by which the sheet buckles: nothing else brings it to its target."""

    def verdictWith(modulus):
        return mh.run(
            {
                "mesh": {"sheet": [8, 8, 1.0]},
                "membrane": {"area_modulus": modulus, "target_area": 70.0},
                "sampling": {"seed": 1},
                "stages": [{"kind": "minimize"}],
                "output": {"prefix": "sheet", "overwrite": True},
            }
        ).verdict

    soft = verdictWith(100.0)
    assert soft.level == "doubtful" and str(soft).endswith("too soft to hold it; a larger area_modulus holds it")
    assert verdictWith(1e5).level == "good"


def test_a_box_that_is_not_rectangular_is_refused_by_the_mesh():
    sheet = mh.Mesh.sheet(9, 8, 1.0)
    shear = np.array([[1, 0, 0], [0.25, 1, 0], [0, 0, 1]])
    mesh = mh.Mesh(sheet.vertices @ shear, sheet.triangles, sheet.box @ shear)
    assert mesh.isPeriodic and mesh.area == pytest.approx(72, rel=1e-12)
    for use in (mesh.check, mesh.unwrapped):
        with pytest.raises(ValueError, match="needs a rectangular one"):
            use()


def mixed(mesh):
    """Return a mesh with a species 1 where it is higher than on average."""
    mesh.species = (mesh.vertices[:, 2] > mesh.vertices[:, 2].mean()).astype(np.intc)
    return mesh


def test_profiles_and_places_do_not_depend_on_images():
    """Where vertices are along an axis, and which are in a region or a box, is the same for all images of them."""
    mesh = mixed(createSheet())
    other = mh.Mesh(wrapped(mesh), mesh.triangles, mesh.box, None, mesh.species)
    for axis in ((0, 0, 1), (1, 2, 0)):
        (heights, parts), (others, own) = (mh.compositionProfile(m, 1, axis) for m in (mesh, other))
        assert np.allclose(heights, others) and np.allclose(parts, own, equal_nan=True)
    (heights, parts), top = mh.compositionProfile(mesh, 1), mesh.vertices[:, 2]
    assert heights[0] >= top.min() and heights[-1] <= top.max() and np.allclose(parts[[0, -1]], [0, 1])
    outcomes = []
    for m in (mesh, other):
        m = mh.Mesh(m.vertices, m.triangles, m.box)
        fixed = mh.Scene.of({"system": {"fixed_box": [[-1, -1, -1], [1.5, 1.5, 2]]}}, m).config.system.fixed
        outcomes.append([fixed])
        for region in ("cap", "stripe", "patch"):
            species = [{"name": "a", "fraction": 0.3, "region": region, "direction": [1, 2, 0]}, {"name": "b"}]
            outcomes[-1].append(mh.Scene.of({"species": species}, m).vertexSpecies.tolist())
    assert outcomes[0] == outcomes[1]
    inside = np.all(
        np.abs(
            mesh.vertices - [0.25, 0.25, 0.5] - np.diag(mesh.box) * [[[0, 0, 0]], [[1, 0, 0]], [[0, 1, 0]], [[1, 1, 0]]]
        )
        <= [1.25, 1.25, 1.5],
        axis=-1,
    ).any(axis=0)
    assert outcomes[0][0] == np.flatnonzero(inside).tolist()


@pytest.mark.parametrize("region", ["cap", "stripe"])
def test_a_region_along_an_axis_on_which_all_are_the_same_is_refused(region):
    species = [{"name": "a", "fraction": 0.3, "region": region}, {"name": "b"}]
    with pytest.raises(ValueError, match=f"species a is in a {region} along .* and the mesh is flat there"):
        mh.Scene.of({"species": species}, mh.Mesh.sheet(9, 8, 1.0))


def test_a_psf_file_has_no_box(tmp_path, monkeypatch):
    pytest.importorskip("mdtraj")
    monkeypatch.chdir(tmp_path)
    mh.run(
        {
            "mesh": {"sheet": [8, 8, 1.0]},
            "sampling": {"steps": 4, "step_size": 0.004, "seed": 3, "flip_probability": 0.0},
            "output": {"prefix": "sheet", "trajectory_interval": 2},
        }
    )
    assert DCDTrajectory("sheet.dcd", "sheet.ply")[-1].mesh.isPeriodic
    with pytest.raises(ValueError, match="folded into a periodic box, which a PSF file does not have"):
        DCDTrajectory("sheet.dcd", "sheet.psf")


def test_boxes_waves_and_frames_of_heights():
    mesh = createSheet()
    frames = mesh.vertices + 0.1 * np.random.default_rng(1).normal(size=(5, len(mesh.vertices), 3))
    spectrum = mh.heightSpectrum(frames, mesh.box)
    for box in (mesh.createSystem().getDefaultPeriodicBoxVectors(), 10 * np.diag(mesh.box) * unit.angstrom):
        assert np.allclose(mh.heightSpectrum(frames, box).series, spectrum.series)
    for box in ([9, np.inf, 9], [9, np.nan, 9], [9, 8], [9, 0, 9]):
        with pytest.raises(ValueError, match="it must be rectangular, with positive sides"):
            mh.heightSpectrum(frames, box)
    for most in (-1, 0, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"maxWaveNumber is .* it must be positive and finite"):
            mh.heightSpectrum(frames, mesh.box, most)
    flat = mh.Mesh.sheet(9, 8, 1.0).vertices[:, [0, 2, 1]]
    with pytest.raises(ValueError, match="they must be all over the x-y plane"):
        mh.heightSpectrum([flat, flat], [9, 9, 8])


def test_heights_of_known_waves():
    """Waves of known amplitudes are found, whichever images the vertices are, and the fit finds what made them."""
    mesh = mh.Mesh.sheet(14, 12, 1.0)
    random, lengths = np.random.default_rng(2), np.diag(mesh.box)
    kappa, sigma, area = 20.0, 1.5, lengths[0] * lengths[1]
    waves = [(i, j) for i in range(4) for j in range(-3, 4) if (i > 0 or j > 0)]
    q = 2 * np.pi * np.array(waves) / lengths[:2]
    sizes = np.linalg.norm(q, axis=1)
    deviations = np.sqrt(1 / (area * (kappa * sizes**4 + sigma * sizes**2)) / 2)
    frames = []
    for _ in range(200):
        h = deviations * (random.normal(size=len(q)) + 1j * random.normal(size=len(q)))
        x = mesh.vertices + random.uniform(-0.3, 0.3, (len(mesh.vertices), 3)) * [1, 1, 0]
        x[:, 2] = 2 * np.real(np.exp(1j * x[:, :2] @ q.T) @ h) + 5 * random.normal()
        frames.append(x + lengths * random.integers(-2, 3, x.shape))
    spectrum = mh.heightSpectrum(frames, mesh.box, 0.9 * sizes.min() * 3)
    expected = 1 / (area * (kappa * spectrum.waveNumbers**4 + sigma * spectrum.waveNumbers**2))
    assert np.abs((spectrum.powers - expected) / spectrum.errors).max() < 4
    fit = spectrum.fit()
    assert abs(fit.bendingModulus - kappa) < 4 * fit.bendingModulusError < 0.2 * kappa
    assert abs(fit.tension - sigma) < 4 * fit.tensionError
    for box, most, problem in ((mesh.box, 0.1, "at least"), (mesh.box, 9, "fewer than"), ([1, 2], None, "rectangular")):
        with pytest.raises(ValueError, match=problem):
            mh.heightSpectrum(frames[:2], box, most)


def test_undulations_have_the_spectrum_of_theory():
    """<|h_q|^2> = kT/(A (kappa q^4 + sigma q^2)), for a stiff sheet under a tension that outweighs that of its mesh."""
    mesh = mh.Mesh.sheet(8, 8, 1.0)
    kappa, tension = 10.0, 4.0
    scene = mh.Scene.of(
        {
            "membrane": {"bending_modulus": kappa, "tension": tension},
            "sampling": {"seed": 4, "steps_per_trajectory": 60, "flip_probability": 0.2, "step_size": 0.006},
            "platform": {"threads": 1},
        },
        mesh,
    )
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    simulation.step(100)
    frames = []
    for _ in range(1500):
        simulation.step(1)
        frames.append(positionsOf(simulation.context))
    spectrum = mh.heightSpectrum(frames, mesh.box, 1.2)
    q = spectrum.waveNumbers
    expected = spectrum.theory(q, kappa, tension, mesh.edgeLengths.mean())
    assert len(q) == 2
    assert spectrum.theory(q, kappa, tension) == pytest.approx(1 / (64 * (kappa * q**4 + tension * q**2)))
    assert np.all(np.abs(spectrum.powers - expected) < 4 * spectrum.errors + 0.08 * expected)
    assert np.all(spectrum.errors < 0.1 * expected)


def test_lengths_of_a_sheet_are_of_their_file(tmp_path):
    for lengths, words in (("[3, 3, 5]", "edgeLength is 5"), ("[100, 100, 0.001]", "edgeLength is 0.001")):
        (tmp_path / "a.toml").write_text(f"[mesh]\nsheet = {lengths}\n")
        with pytest.raises(ValueError, match=rf"a\.toml: \[mesh\] sheet: {words}"):
            mh.Scene.of(tmp_path / "a.toml")
