"""Units and sizes: membranes of edges from 1e-6 to 1e6 have the same physics, and results are in the user's unit."""

import math

import numpy as np
import openmm as mm
import pytest
from openmm import unit
from typer.testing import CliRunner

import openmmhelfrich as mh
from membranes import uvSphere
from openmmhelfrich.cli import app
from openmmhelfrich.io.vtkhdf import readMeshTrajectory
from openmmhelfrich.runs.config import asDict, parseConfig
from openmmhelfrich.runs.meshsource import loadMesh
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.studies import run
from openmmhelfrich.runs.trimem import convertConfig
from openmmhelfrich.sampling.observables import observableUnits, readObservables

ROUGH = mh.Mesh(
    mh.Mesh.icosphere(2).vertices * (1 + 0.05 * np.random.default_rng(1).normal(size=(162, 1))),
    mh.Mesh.icosphere(2).triangles,
)
MIXTURE = {"integrator": "bcss2", "tether_substeps": 2, "shear_wave_probability": 0.2, "shear_waves_per_step": 5}


def study(folder, factor, stages=None, **sections):
    """Run with a mesh that is scaled, and everything else by default but for what is given in its edge lengths."""
    mesh = mh.Mesh(factor * ROUGH.vertices, ROUGH.triangles)
    mesh.write(folder / "mesh.ply")
    length = factor * ROUGH.edgeLengths.mean()
    config = {
        "mesh": {"file": str(folder / "mesh.ply"), "length_unit": "R0"},
        "membrane": {"reduced_volume": 0.97},
        "repulsion": {"modulus": 5.0, "onset": 2.2 * length, "length_scale": length},
        "sampling": {
            "steps": 30,
            "seed": 3,
            "steps_per_trajectory": 20,
            "shear_wave_probability": 0.0,
            "shear_wave_amplitude": 0.1 * factor,
        },
        "platform": {"threads": 1},
        "output": {"prefix": str(folder / "a"), "observables_interval": 1, "overwrite": True},
    }
    for name, keys in sections.items():
        config[name] = {**config[name], **keys}
    if stages:
        del config["sampling"]["steps"]
        config["stages"] = stages
    run(config)
    return readObservables(folder / "a.csv")


def assertSame(table, other, **tolerance):
    """Compare energies, rates and reduced observables, which have no unit of length."""
    names = [name for name in table if name.startswith("E_") or name in ("energy", "acceptance", "flipAcceptance")]
    for name in [*names, "reducedVolume", "reducedAreaDifference", "diverged"]:
        if tolerance:
            np.testing.assert_allclose(other[name], table[name], err_msg=name, **tolerance)
        else:
            np.testing.assert_array_equal(other[name], table[name], err_msg=name)


@pytest.mark.parametrize(
    "sampling, precision", [({}, "double"), ({}, "mixed"), (MIXTURE, "double")], ids=["plain", "mixed", "mixture"]
)
def test_runs_at_powers_of_two_are_the_same_to_the_last_bit(tmp_path, sampling, precision):
    tables = [
        study(tmp_path, factor, sampling=sampling, platform={"precision": precision})
        for factor in (1.0, 2.0**-22, 2.0**22)
    ]
    assert tables[0]["acceptance"][-1] > 0.3 and np.all(tables[0]["E_repulsion"] > 0)
    for table in tables[1:]:
        assertSame(tables[0], table)


@pytest.mark.parametrize("factor", [1e-6, 0.1, 1e3, 1e6])
def test_runs_at_powers_of_ten_are_the_same_to_rounding(tmp_path, factor):
    """To 1e-12 at first; later the rounding of the coordinates grows as every other disturbance does."""
    table, other = (study(tmp_path, f, sampling={"steps": 3, "flip_probability": 0}) for f in (1.0, factor))
    assertSame(table.where(table["step"] < 2), other.where(other["step"] < 2), rtol=1e-12, atol=1e-12)
    assertSame(table, other, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("factor", [2.0**-22, 2.0**22])
def test_automatic_step_sizes_and_amplitudes_scale(tmp_path, factor):
    automatic = {"step_size": "auto", "shear_wave_amplitude": "auto", "steps": 60, "burn_in": 40, **MIXTURE}
    table, other = (study(tmp_path, f, sampling=automatic) for f in (1.0, factor))
    # Adapters hold logarithms, whose rounding is not that of powers of two.
    assertSame(table.where(table["step"] < 5), other.where(other["step"] < 5), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(other["stepSize"], factor * table["stepSize"], rtol=1e-5)
    np.testing.assert_allclose(other["waveAmplitude"], factor * table["waveAmplitude"], rtol=1e-5)


@pytest.mark.parametrize("fluid", [False, True])
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_minima_are_the_same(tmp_path, fluid, factor):
    stages = [{"kind": "minimize", "fluid": fluid}]
    table, other = (study(tmp_path, f, stages, repulsion={"modulus": 0.0}) for f in (1.0, factor))
    assert table["energy"][-1] < 0.9 * table["energy"][0]
    assert other["energy"][-1] == pytest.approx(table["energy"][-1], rel=2e-3)


# --- units


def organelle(folder):
    """A vesicle of radius 100 nm."""
    mh.Mesh.icosphere(2, 100).write(folder / "cell.ply")
    return mh.Mesh.icosphere(2, 100).area


@pytest.mark.parametrize(
    "mesh, name, size",
    [
        ({}, "nm", 1),
        ({"scale": 0.01}, "nm", 1),
        ({"scale": 0.01, "length_unit": "100 nm"}, "nm", 1),
        ({"scale": 0.001, "length_unit": "um"}, "um", 1e3),
        ({"scale": 1e-5, "length_unit": "0.1 mm"}, "mm", 1e6),
        ({"scale": 10.0, "length_unit": "angstrom"}, "angstrom", 0.1),
        ({"scale": 0.001, "length_unit": "10 nm"}, "nm", 0.1),
    ],
)
def test_results_are_in_the_unit_of_the_user(inFolder, mesh, name, size):
    """Whatever the scale, the vesicle has its area, and a target with a unit is what it says."""
    area = organelle(inFolder)
    if size == 0.1 and name == "nm":
        area, size = area * 1e-4, 1  # the vesicle has a radius of 1 nm
    config = {
        "mesh": {"file": "cell.ply", **mesh},
        "membrane": {"target_area": f"{area * 1.01} nm^2"},
        "sampling": {"steps": 2, "seed": 1},
        "output": {"prefix": "a", "trajectory_interval": 1},
    }
    summary = run(config)
    table = readObservables("a.csv")
    assert observableUnits("a.csv")["area"] == f"{name}^2"
    assert table["area"][0] * size**2 == pytest.approx(area, rel=1e-9)
    assert table["targetArea"][0] * size**2 == pytest.approx(1.01 * area, rel=1e-9)
    (text,) = [text for label, text in summary.lines() if label == "area"]
    assert float(text.split()[0]) * size**2 == pytest.approx(area, rel=0.03) and f" {name}^2" in text
    assert mh.Mesh.read("a.ply").area * size**2 == pytest.approx(area, rel=0.03)
    trajectory = readMeshTrajectory("a.vtkhdf")
    assert trajectory.lengthUnit == name
    assert trajectory[0].mesh.area * size**2 == pytest.approx(area, rel=0.03)


def test_scales_of_earlier_configurations_mean_the_same(inFolder):
    """With a scale and no length_unit results are in the file's nm; plain numbers, step sizes too, mean what they did
    when coordinates were scaled: as they do still with a length_unit.
    """
    organelle(inFolder)

    def tableOf(unit):
        run(
            {
                "mesh": {"file": "cell.ply", "scale": 1 / 128, **unit},
                "membrane": {"target_area": 7.4, "tension": 3.0},
                "tether": {"modulus": 50.0, "min_length": 0.15},
                "repulsion": {"modulus": 2.0, "onset": 0.25},
                "sampling": {"step_size": 4e-4, "seed": 1, "steps": 20},
                "platform": {"threads": 1},
                "output": {"prefix": "a", "overwrite": True, "observables_interval": 1},
            }
        )
        return readObservables("a.csv")

    table, other = tableOf({}), tableOf({"length_unit": "R0"})
    assertSame(table, other, rtol=1e-9, atol=1e-9)
    assert 0 < table["acceptance"][-1] < 1
    np.testing.assert_allclose(table["area"], 128**2 * other["area"], rtol=1e-9)


def test_plain_numbers_are_in_multiples(inFolder):
    organelle(inFolder)
    config = parseConfig(
        {
            "mesh": {"file": "cell.ply", "scale": 0.01, "length_unit": "100 nm"},
            "membrane": {"target_area": 12.0, "target_volume": 4, "tension": 3.0, "pressure": 5.0},
            "tether": {"modulus": 2.0, "min_length": 0.2, "max_length": "40 nm"},
            "repulsion": {"modulus": 1.0, "onset": 0.1},
            "stages": [
                {"kind": "minimize", "tolerance": 7.0},
                {"kind": "continue", "windows": 1, "target_area": 11.0, "path": {"target_area": [0, 1.0]}},
            ],
        }
    )
    assert (config.mesh.scale, config.mesh.length_unit) == (1.0, "nm")
    assert (config.membrane.target_area, config.membrane.target_volume) == (12e4, 4e6)
    assert (config.membrane.tension, config.membrane.pressure) == pytest.approx((3e-4, 5e-6))
    assert (config.tether.min_length, config.tether.max_length) == pytest.approx((20, 40))
    # What is 1 by default is 1 of the file's unit.
    assert (config.tether.length_scale, config.membrane.leaflet_separation) == (100, 100)
    assert (config.repulsion.onset, config.repulsion.length_scale) == pytest.approx((10, 100))
    minimize, proceed = config.stages
    assert minimize.tolerance == pytest.approx(0.07)
    assert (proceed.target_area, proceed.path) == (11e4, {"target_area": [0.0, 1.0]})  # lambdas have no unit
    assert parseConfig(asDict(config)) == config


def test_multiples_change_no_energy(inFolder):
    """The same file in units and in multiples of a unit has the same energies."""
    organelle(inFolder)

    def energies(scale, name):
        config = parseConfig(
            {
                "mesh": {"file": "cell.ply", "scale": scale, "length_unit": name},
                "membrane": {"target_area_difference": 20.0 * (0.01 / scale) ** -2, "area_difference_modulus": 3.0},
                "tether": {"modulus": 2.0, "min_length": 0.2, "max_length": 0.25},
                "repulsion": {"modulus": 1.0, "onset": 0.6, "exclusion_level": 0},
            }
        )
        scene = Scene.of(config)
        force = scene.createForce()
        terms = force.getEnergyTermsInContext(scene.createSimulation(force).context)
        return {name: energy.value_in_unit(unit.kilojoules_per_mole) for name, energy in terms.items()}

    plain, multiple = energies(0.01, "R0"), energies(0.01, "100 nm")
    assert plain == pytest.approx(multiple, rel=1e-9) and min(plain["tether"], plain["repulsion"]) > 1


def test_spheres_have_no_file_whose_unit_could_be_nm():
    config = parseConfig({"mesh": {"icosphere": 2, "scale": 0.5}})
    assert config.mesh.scale == 0.5 and loadMesh(config).area == pytest.approx(mh.Mesh.icosphere(2, 0.5).area)


@pytest.mark.parametrize("name", ["a b", "", " ", "0 nm", "-1 nm", "nm um pm", "1e999 nm"])
def test_units_that_are_none(name):
    with pytest.raises(ValueError, match=r"\[mesh\] length_unit is"):
        parseConfig({"mesh": {"icosphere": 2, "length_unit": name}})


def test_check_has_the_same_units(inFolder):
    area = organelle(inFolder)
    for options, factor in (([], 1), (["--scale", "0.01"], 1), (["--scale", "0.001", "--length-unit", "um"], 1e-6)):
        output = CliRunner().invoke(app, ["check", "cell.ply", *options]).output
        line = next(line.split() for line in output.splitlines() if line.split()[:1] == ["area"])
        assert float(line[1]) == pytest.approx(area * factor, rel=1e-5) and line[2] in ("nm^2", "um^2")


# --- membranes in Angstrom


MOSAIC = """
[GENERAL]
algorithm = minimize
input = mesh.stl
output_prefix = out
[BONDS]
bond_type = Edge
lc0 = 70
lc1 = 30
[SURFACEREPULSION]
lc1 = 15
[ENERGY]
kappa_b = 300.0
kappa_a = 1e6
kappa_v = 1e6
kappa_c = 0
kappa_t = 1e5
kappa_r = 1e3
area_fraction = 1.2
volume_fraction = 1.2
[MINIMIZATION]
maxiter = 5000
"""


def mosaic(folder, mesh):
    """Write a mesh with edges of 42 Angstrom, and its configuration as the program Mosaic writes them for tomograms."""
    mesh = mh.Mesh(mesh.vertices * 42 / mesh.edgeLengths.mean(), mesh.triangles)
    mesh.write(folder / "mesh.stl")
    (folder / "conf.ini").write_text(MOSAIC)
    (folder / "conf.toml").write_text(convertConfig("conf.ini"))
    return mesh


@pytest.mark.parametrize("roughness, stretch", [(0, 1), (0.2, 1), (0, 2)])
def test_configuration_of_trimem_in_angstrom_runs_as_it_stands(inFolder, roughness, stretch):
    sphere = mh.Mesh.icosphere(3)
    noise = roughness * sphere.edgeLengths.mean() * np.random.default_rng(1).normal(size=sphere.vertices.shape)
    mesh = mosaic(inFolder, mh.Mesh((sphere.vertices + noise) * (1, 1, stretch), sphere.triangles))
    assert (mesh.edgeLengths.min() < 30) == (roughness > 0 or stretch > 1)
    result = CliRunner().invoke(app, ["run", "conf.toml"])
    assert result.exit_code == 0, result.output
    made = mh.Mesh.read("out.ply")
    assert made.edgeLengths.min() > 30 and made.edgeLengths.max() < 70
    assert made.area == pytest.approx(1.2 * mesh.area, rel=0.05)
    assert made.volume == pytest.approx(1.2 * mesh.volume, rel=0.05)


def test_edges_that_do_not_come_within_the_bounds_are_said(inFolder):
    mosaic(inFolder, uvSphere(32, 16))
    result = CliRunner().invoke(app, ["run", "conf.toml"])
    assert result.exit_code == 1
    assert "edges are beyond the bounds of the tether, 30 to 70 nm" in result.output
    assert "mesh_even.ply --vertices 482" in result.output and "remesh = 482 in [mesh]" in result.output


def test_few_iterations_are_no_error(inFolder):
    """TriMem makes 10 by default; what is left is a note then; the verdict is that of a shape far from a minimum."""
    mosaic(inFolder, uvSphere(32, 16))
    (inFolder / "conf.toml").write_text(
        convertConfig("conf.ini").replace("max_iterations = 5000", "max_iterations = 2")
    )
    result = CliRunner().invoke(app, ["run", "conf.toml"])
    assert result.exit_code == 3 and "edges are beyond the bounds of the tether" in result.output


def test_no_tether_has_no_bounds(inFolder):
    mosaic(inFolder, mh.Mesh.icosphere(1))
    (inFolder / "conf.ini").write_text(MOSAIC.replace("kappa_t = 1e5", "kappa_t = 0"))
    assert "within_bounds = false" in convertConfig("conf.ini")
    (inFolder / "conf.toml").write_text(
        convertConfig("conf.ini").replace("within_bounds = false", "within_bounds = true")
    )
    result = CliRunner().invoke(app, ["run", "conf.toml"])
    assert result.exit_code == 1 and "within_bounds is true, and [tether] modulus is 0" in result.output


@pytest.mark.parametrize("platform", ["CPU", "Reference"])
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_forces_scale(platform, factor):
    """Energies of a whole force are the same, and forces are those over the factor, on both platforms."""

    def evaluate(s):
        force = mh.HelfrichForce()
        force.setTriangles(ROUGH.triangles)
        length = s * ROUGH.edgeLengths.mean()
        for name, value in (("Bending", 20), ("Area", 1e4), ("Volume", 1e4), ("AreaDifference", 100)):
            getattr(force, f"set{name}Modulus")(value)
        force.setTargetArea(0.9 * s**2 * ROUGH.area)
        force.setTargetVolume(0.9 * s**3 * ROUGH.volume)
        force.setTargetAreaDifference(20 * s**2)
        force.setLeafletSeparation(s)
        force.setTension(3 / s**2)
        force.setPressure(5 / s**3)
        force.setTether(7, 0.9 * length, 1.1 * length, 3)
        force.setTetherLengthScale(length)
        force.setRepulsion(2, 2 * length, 4)
        force.setRepulsionLengthScale(length)
        system = ROUGH.createSystem()
        system.addForce(force)
        context = mm.Context(system, mm.VerletIntegrator(1), mm.Platform.getPlatformByName(platform))
        context.setPositions(s * ROUGH.vertices)
        state = context.getState(energy=True, forces=True)
        forces = state.getForces(asNumpy=True).value_in_unit(unit.kilojoules_per_mole / unit.nanometer)
        return state.getPotentialEnergy().value_in_unit(unit.kilojoules_per_mole), s * forces

    (energy, forces), (other, otherForces) = evaluate(1.0), evaluate(factor)
    assert math.isclose(other, energy, rel_tol=1e-12)
    np.testing.assert_allclose(otherForces, forces, rtol=1e-9, atol=1e-9 * np.abs(forces).max())
