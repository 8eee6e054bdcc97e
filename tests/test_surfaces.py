"""Several connected surfaces in one force: each is held to targets of its own, and all of them repel each other."""

import copy

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
from conftest import together
from membranes import PLATFORMS, createBlob, createContext, createForce, energyOf, positionsOf
from openmmhelfrich.geometry.quality import assess
from openmmhelfrich.pictures.report import writeReport
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.studies import resume, run
from openmmhelfrich.runs.sweeps import observe
from openmmhelfrich.sampling.observables import observablesIn
from openmmhelfrich.sampling.targets import absoluteTargets, currentTargets, listedTargets, setTargets
from test_restarted_runs import StopAt, assertSame, contentsOf


def moved(mesh, shift=(0, 0, 0), scale=1.0):
    return mh.Mesh(mesh.vertices * scale + shift, mesh.triangles)


def nested():
    """A blob in a rough sphere, and another beside it, whose triangles come first."""
    blob, sphere = createBlob(1), mh.Mesh.icosphere(2, 1.1)
    sphere.vertices = sphere.vertices + np.random.default_rng(2).uniform(-0.03, 0.03, sphere.vertices.shape)
    return together(moved(blob, (2.2, 0, 0)), sphere, moved(blob, (-0.2, 0.1, -0.3), 0.6))


def createSurfacesForce(mesh):
    force = createForce(mesh)
    for k, surface in enumerate(mesh.components()):
        force.setTargetArea(1.1 * surface.area, surface=k)
        force.setTargetVolume((1.2 - 0.2 * k) * surface.volume, surface=k)
    return force


def test_geometry_of_each_surface():
    mesh = nested()
    force = createSurfacesForce(mesh)
    context = createContext(mesh, force, "CPU")
    geometry, surfaces = force.getGeometryInContext(context), mesh.components()
    assert force.getNumSurfacesInContext(context) == len(surfaces) == len(geometry.surfaces) == 3
    assert [len(surface.vertices) for surface in surfaces] == [42, 162, 42]
    for found, surface in zip(geometry.surfaces, surfaces):
        curvature = surface.vertexMeanCurvatures.sum()
        assert found.area / unit.nanometer**2 == pytest.approx(surface.area, rel=1e-12)
        assert found.volume / unit.nanometer**3 == pytest.approx(surface.volume, rel=1e-12)
        assert found.integratedMeanCurvature / unit.nanometer == pytest.approx(curvature, rel=1e-12)
        assert found.areaDifference / unit.nanometer**2 == pytest.approx(0.2 * curvature, rel=1e-12)
    assert geometry.volume / unit.nanometer**3 == pytest.approx(mesh.volume, rel=1e-12)


def test_flips_are_the_same_on_both_platforms():
    """Each surface has its own totals, from which the change of energy of a flip comes."""
    mesh, found = nested(), {}
    for platform in PLATFORMS:
        force, flips = createSurfacesForce(mesh), mh.EdgeFlipIntegrator(30000, 1.0)
        flips.setRandomNumberSeed(3)
        context = createContext(mesh, force, platform, flips)
        flips.step(4)
        assert flips.getNumAccepted() > 100
        found[platform] = force.getTrianglesInContext(context)
        own = mh.Mesh(mesh.vertices, found[platform])
        for surface, expected in zip(force.getGeometryInContext(context).surfaces, own.components()):
            assert surface.volume / unit.nanometer**3 == pytest.approx(expected.volume, rel=1e-12)
    assert np.array_equal(found["Reference"], found["CPU"])


@pytest.mark.parametrize("platform", PLATFORMS)
def test_targets_go_with_files_and_states(platform):
    mesh = nested()
    force = createSurfacesForce(mesh)
    context, xml = createContext(mesh, force, platform), mm.XmlSerializer.serialize(force)
    for other in (copy.copy(force), mh.HelfrichForce.cast(mm.XmlSerializer.deserialize(xml))):
        assert other.getTargetVolume(surface=2) == force.getTargetVolume(surface=2) != force.getTargetVolume()
        assert energyOf(createContext(mesh, other, platform)) == energyOf(context)
    context.setParameter(force.getTargetVolumeParameter(surface=1), 4.0)
    state, checkpoint = context.getState(positions=True, parameters=True), context.createCheckpoint()
    for load in (lambda context: context.setState(state), lambda context: context.loadCheckpoint(checkpoint)):
        again = createContext(mesh, copy.copy(force), platform)
        assert energyOf(again) != energyOf(context)
        load(again)
        assert energyOf(again) == energyOf(context)


def test_one_particle_in_two_forces():
    mesh = mh.Mesh.icosphere(1)
    first, second = createForce(mesh, ["bending"]), createForce(mesh, ["area"])
    second.setName("Other")
    with pytest.raises(mm.OpenMMException, match=r"particle 0 belongs to two HelfrichForces, .*a vertex of one only"):
        createContext(mesh, [first, second])


def test_names_of_targets():
    mesh = nested()
    force = createForce(mesh)
    context = createContext(mesh, force, "CPU")
    assert list(currentTargets(context, force)) == ["area", "volume", "areaDifference"]
    force = copy.copy(force)
    force.setTargetVolume(3.0, surface=1)
    context = createContext(mesh, force, "CPU")
    targets = currentTargets(context, force)
    assert list(targets) == ["area", "volume", "volume[1]", "areaDifference"] and targets["volume[1]"] == 3
    setTargets(context, force, {"volume": 1.0, "volume[1]": 2.0})
    assert context.getParameter("HelfrichForceTargetVolume") == 1
    assert context.getParameter("HelfrichForceTargetVolume1") == 2
    force = createSurfacesForce(mesh)
    targets = currentTargets(createContext(mesh, force, "CPU"), force)
    assert listedTargets(targets, "volume") == [targets[f"volume[{k}]"] for k in range(3)]


def test_targets_of_every_surface_and_of_each():
    start = {"area[0]": 12.0, "area[1]": 3.0, "volume[0]": 4.0, "volume[1]": 0.5}
    assert absoluteTargets({"volume": 2.0}, start) == {"volume[0]": 2, "volume[1]": 2}
    assert absoluteTargets({"volume": [2.0, 0.4]}, start) == {"volume[0]": 2, "volume[1]": 0.4}
    assert absoluteTargets({"volume[1]": 0.4}, start) == {"volume[1]": 0.4}
    reduced = absoluteTargets({"reducedVolume": 0.8, "area": [10.0, 3.0]}, start)
    assert reduced["volume[0]"] / reduced["volume[1]"] == pytest.approx((10 / 3) ** 1.5)
    reduced = absoluteTargets({"reducedVolume": [0.8, 0.4]}, start)
    assert reduced["volume[0]"] / reduced["volume[1]"] == pytest.approx(2 * 4**1.5)
    with pytest.raises(ValueError, match="the target volume has 3 values, for 2 surfaces"):
        absoluteTargets({"volume": [1, 2, 3]}, start)
    with pytest.raises(ValueError, match="one volume target in common"):
        absoluteTargets({"reducedVolume": 0.8}, {"area[0]": 12.0, "area[1]": 3.0, "volume": 4.0})


def test_continuation_of_each_surface():
    """The two go to volumes of their own, window by window."""
    mesh = together(mh.Mesh.icosphere(1), moved(mh.Mesh.icosphere(1), (3, 0, 0), 0.8))
    config = {"mesh": {"file": "unused"}, "sampling": {"seed": 2, "step_size": 1e-3}, "platform": {"threads": 1}}
    scene = Scene.of(parseConfig(config), mesh)
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    path = {"reducedVolume": [0, 0.5, 1]}
    result = mh.continueTo(simulation, force, {"reducedVolume": [0.9, 0.85]}, 2, 20, 10, path=path, interval=5)
    assert result.windows["reducedVolume[0]"][-1] == pytest.approx(0.9, abs=0.01)
    assert result.windows["reducedVolume[1]"][-1] == pytest.approx(0.85, abs=0.01)
    assert "reducedVolume" not in result.windows


def configure(folder, mesh, **sections):
    mesh.write(folder / "start.ply")
    config = {
        "mesh": {"file": str(folder / "start.ply")},
        "sampling": {"seed": 4, "steps": 300, "step_size": "auto", "steps_per_trajectory": 40},
        "platform": {"threads": 1},
        "output": {"prefix": str(folder / "run"), "trajectory_interval": 100, "observables_interval": 5},
    }
    for name, values in sections.items():
        config[name] = {**config.get(name, {}), **values}
    return parseConfig(config)


def pair(level=1):
    return together(mh.Mesh.icosphere(level), moved(mh.Mesh.icosphere(level), (3, 0, 0), 0.8))


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The summary of a run that leads two surfaces far, each to its own reduced volume."""
    config = configure(tmp_path_factory.mktemp("surfaces"), pair(2), membrane={"reduced_volume": [0.65, 0.8]})
    return run(config)


def test_a_run_brings_each_surface_to_its_targets(done):
    for k, (v, area) in enumerate(zip((0.65, 0.8), (surface.area for surface in pair(2).components()))):
        assert done.mean(f"reducedVolume[{k}]") == pytest.approx(v, abs=0.005)
        assert done.mean(f"area[{k}]") == pytest.approx(area, rel=0.01)
        assert done.drift(f"volume[{k}]") < 0.03
    assert done.acceptance > 0.2 and "reducedVolume" not in done.table
    assert np.array_equal(done.table["area"], done.table["area[0]"] + done.table["area[1]"])
    first = done.table.where(done.table["step"] == 5)
    assert first["targetVolume[0]"] > 1.3 * done.table["targetVolume[0]"][-1]  # which it is led to
    assert not np.any(done.table["equilibrated"][done.table["stage"] == 1])
    assert [stage.kind for stage in done.config.stages] == ["approach", "sample"]


def test_results_are_those_of_each_surface(done):
    labels = [label for label, _ in done.lines()]
    assert {"area of surface 0", "area of surface 1", "volume of surface 1", "reduced volume of surface 0"} <= {*labels}
    assert "area" not in labels and len(done.shapeClasses) == 2
    names = [observable.name for observable in observablesIn(done.table)]
    assert names.index("volume[1]") == names.index("volume[0]") + 1 and "volume" not in names
    page = writeReport(done.config.output.prefix).read_text()
    assert "reduced volume of surface 1" in page and "shape of surface 1" in page
    result = observe(done.config)
    assert result["shapeClass"] == ", ".join(done.shapeClasses)
    assert {"reducedVolume[0]", "reducedAreaDifference[1]", "volume[1] (nm^3)"} <= {*result}
    assert done.config.stages[0].target_volume == pytest.approx(
        [done.table[f"targetVolume[{k}]"][-1] for k in range(2)], rel=1e-15
    )


def test_a_run_that_was_stopped_goes_on_as_if_it_had_not_been(tmp_path):
    """Also one that was stopped while targets were led from where the membrane was."""
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
    membrane, sampling = {"reduced_volume": [0.7, 0.8]}, {"steps": 60, "burn_in": None, "steps_per_trajectory": 10}

    def config(name):
        return configure(tmp_path / name, pair(), membrane=membrane, sampling=sampling)

    run(config("whole"))
    prefix = config("parts").output.prefix
    run(config("parts"), progress=StopAt(3))
    resume(prefix, progress=StopAt(31))
    resume(prefix)
    assertSame(prefix, contentsOf(config("whole").output.prefix))

    # More steps do not lead it once more.

    table = resume(prefix, steps=100).table
    assert np.ptp(table.where(table["stage"] == 2)["targetVolume[1]"]) == 0


@pytest.mark.parametrize(
    "membrane, message",
    [
        ({"target_volume": [1.0, 2.0, 3.0]}, r"\[membrane\] target_volume has 3 values, for 2 surfaces"),
        ({"reduced_volume": [0.8, 1.2]}, "reduced_volume is .*must be less than or equal to 1"),
        ({"target_area": []}, "target_area is .*a number for each surface"),
        ({"target_area": [1.0, "two"]}, "target_area is .*"),
        ({"target_area_difference": [1.0, 0.0]}, "target_area_difference is 0"),
    ],
)
def test_lists_that_do_not_fit(tmp_path, membrane, message):
    with pytest.raises(ValueError, match=message):
        run(configure(tmp_path, pair(), membrane=membrane))


def test_a_list_of_a_stage_that_does_not_fit(tmp_path):
    config = configure(tmp_path, mh.Mesh.icosphere(1))
    stages = [{"kind": "sample", "steps": 5}, {"kind": "continue", "reduced_volume": [0.9, 0.8]}]
    config = parseConfig({"mesh": {"file": config.mesh.file}, "output": {"prefix": "unused"}, "stages": stages})
    with pytest.raises(ValueError, match="continue: reduced_volume has 2 values, for 1 surface"):
        run(config)


def test_description_of_each_surface():
    lines = dict(assess(nested()).lines())
    assert lines["vertices"].split() == ["42", "162", "42"] and lines["genus"].split() == ["0", "0", "0"]
    assert lines["reduced volume"].split()[1].startswith("0.98") and "area" not in lines


def pressOutwards(repulsion):
    """Return a sphere and one in it that wants to be larger than the first, after a while, and their mean edge."""
    outer, inner = mh.Mesh.icosphere(2), mh.Mesh.icosphere(2, 0.7)
    mesh, edge = together(outer, inner), outer.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(50)
    force.setAreaModulus(1000)
    force.setTargetArea(outer.area)
    force.setTargetArea(1.3 * outer.area, surface=1)
    force.setVolumeModulus(1000)
    force.setTargetVolume(outer.volume)
    force.setTargetVolume(1.4 * outer.volume, surface=1)
    force.setTether(50, 0.5 * edge, 1.5 * edge, 2)
    force.setTetherLengthScale(edge)
    force.setRepulsion(repulsion, 0.8 * edge, 2)
    integrator = mh.HybridMonteCarloIntegrator(300, 3e-4, 50, 0.3, 0.3)
    integrator.setRandomNumberSeed(6)
    context = createContext(mesh, force, "CPU", integrator)
    integrator.step(300)
    assert integrator.getAcceptanceRate() > 0.3
    return mh.Mesh(positionsOf(context), force.getTrianglesInContext(context)), edge


def test_nested_surfaces_keep_apart():
    """Only where vertices of different surfaces repel each other."""
    mesh, edge = pressOutwards(1.0)
    outer, inner = mesh.components()
    closest = np.linalg.norm(outer.vertices[:, np.newaxis] - inner.vertices, axis=2).min()
    assert not len(assess(mesh).crossings) and 0.4 * edge < closest < 0.8 * edge
    assert 8 < inner.area < outer.area
    assert len(assess(pressOutwards(0.0)[0]).crossings) > 10
