"""Species and spontaneous curvature in a configuration: which vertices have them, and what a run makes of them."""

import base64
import itertools
import re
import signal

import h5py
import meshio
import numpy as np
import openmm as mm
import pytest
from openmm import app

import openmmhelfrich as mh
from openmmhelfrich.geometry.formats import vtkfiles
from openmmhelfrich.pictures.look import Look, speciesColors, speciesCount, speciesLegend
from openmmhelfrich.pictures.plots import drawMesh
from openmmhelfrich.pictures.rendering import render
from openmmhelfrich.pictures.report import writeReport
from openmmhelfrich.runs.checkpoint import loadSimulation
from openmmhelfrich.runs.config import asDict, parseConfig, readTOML
from openmmhelfrich.runs.configfile import configText
from openmmhelfrich.runs.material import placeSpecies
from openmmhelfrich.runs.sections import SpeciesSection
from openmmhelfrich.runs.stages import checkStages
from openmmhelfrich.sampling.conditions import flatEnergy
from openmmhelfrich.sampling.observables import OBSERVABLES, PANELS, curves, observableUnits
from openmmhelfrich.units import thermalEnergy
from test_report import partsOf

MESH = mh.Mesh.icosphere(2, 2.0)
LO_LD = [{"name": "lo", "fraction": 0.25, "bending_modulus": 40}, {"name": "ld", "spontaneous_curvature": 0.3}]


def place(species, seed=1):
    return placeSpecies([SpeciesSection(**each) for each in species], MESH, seed)


def configOf(**sections):
    return {"mesh": {"icosphere": 2}, "sampling": {"seed": 1, "steps": 4}, "platform": {"threads": 1}, **sections}


@pytest.mark.parametrize("region", ["random", "cap", "patch", "stripe"])
def test_fractions_are_met_and_the_rest_is_the_others(region):
    species = place([{"name": "a", "fraction": 0.3, "region": region}, {"name": "b"}])
    assert np.count_nonzero(species == 0) == round(0.3 * len(MESH.vertices)) and set(species) == {0, 1}


def test_fractions_that_add_up_to_one_leave_no_vertex():
    species = place([{"name": str(i), "fraction": 1 / 7} for i in range(7)])
    counts = np.bincount(species)
    assert counts.sum() == len(MESH.vertices) and np.ptp(counts) <= 1


def test_regions_are_where_they_are_said_to_be():
    x, direction = MESH.vertices, [1.0, 0.0, 0.0]
    cap = place([{"name": "a", "fraction": 0.2, "region": "cap", "direction": direction}, {"name": "b"}])
    assert x[cap == 0, 0].min() >= x[cap == 1, 0].max()
    stripe = place([{"name": "a", "fraction": 0.2, "region": "stripe", "direction": direction}, {"name": "b"}])
    assert abs(x[stripe == 0, 0]).max() <= abs(x[stripe == 1, 0]).min() + 1e-12
    patch = place([{"name": "a", "fraction": 0.2, "region": "patch", "direction": direction}, {"name": "b"}])
    assert x[patch == 0, 0].min() > 0.5 and patch[np.argmax(x[:, 0])] == 0


def test_vertices_come_before_places_and_places_before_chance():
    species = place(
        [
            {"name": "random", "fraction": 0.5},
            {"name": "cap", "fraction": 0.2, "region": "cap"},
            {"name": "own", "vertices": [int(np.argmax(MESH.vertices[:, 2]))]},
            {"name": "rest"},
        ]
    )
    top = np.argsort(-MESH.vertices[:, 2], kind="stable")
    assert species[top[0]] == 2 and np.all(species[top[1:20]] == 1)


def test_chance_follows_the_seed():
    assert np.array_equal(place(LO_LD, 1), place(LO_LD, 1)) and not np.array_equal(place(LO_LD, 1), place(LO_LD, 2))


def test_a_scene_gives_the_force_its_species():
    scene = mh.Scene.of(
        configOf(
            species=LO_LD,
            membrane={"bending_modulus": 20, "line_tension": 1.5, "pair_energies": {"ld,lo": 2.0, "lo, lo": -1.0}},
        )
    )
    force, kT = scene.createForce(), scene.kT
    plain = [[value._value for value in force.getSpeciesParameters(i)] for i in range(2)]
    np.testing.assert_allclose(plain, [[40 * kT, 0, 0], [20 * kT, 0.3, 0]])
    assert force.getLineTension(0, 1)._value == 1.5 * kT and force.getPairEnergy(1, 0)._value == 2 * kT
    assert force.getPairEnergy(0, 0)._value == -kT and force.getPairEnergy(1, 1)._value == 0
    assert force.getVertexSpecies().tolist() == scene.vertexSpecies.tolist()
    assert parseConfig(asDict(scene.config)).species == scene.config.species


def test_spontaneous_curvature_without_species():
    scene = mh.Scene.of(configOf(membrane={"spontaneous_curvature": "0.5 1/nm", "gaussian_modulus": -10}))
    force = scene.createForce()
    assert force.getSpontaneousCurvature()._value == 0.5 and force.getNumSpecies() == 0
    assert force.getGaussianModulus()._value == -10 * scene.kT
    simulation = scene.createSimulation(force)
    assert flatEnergy(simulation.context, force, MESH) == pytest.approx(20 * scene.kT * 0.5**2 / 2 * MESH.area)


def test_the_energy_of_a_flat_mesh_is_that_of_the_species_it_has():
    scene = mh.Scene.of(configOf(species=LO_LD, membrane={"spontaneous_curvature": 0.1}))
    force = scene.createForce()
    context, kT = scene.createSimulation(force).context, scene.kT
    areas = scene.mesh.vertexAreas
    for species in (scene.vertexSpecies, 1 - scene.vertexSpecies):
        force.setVertexSpeciesInContext(context, species)
        mesh = mh.Mesh(scene.mesh.vertices, scene.mesh.triangles, species=species)
        lo, ld = areas[species == 0].sum(), areas[species == 1].sum()
        expected = kT * (40 * 0.1**2 / 2 * lo + 20 * 0.4**2 / 2 * ld)
        assert flatEnergy(context, force, mesh) == pytest.approx(expected)


def test_a_run_with_exchanges_goes_on_to_the_same_bits(tmp_path):
    sampling = {"seed": 5, "steps": 12, "exchange_probability": 0.4, "steps_per_trajectory": 5}
    config = configOf(species=LO_LD, membrane={"line_tension": 1.0}, sampling=sampling)
    whole = mh.run({**config, "output": {"prefix": str(tmp_path / "whole"), "observables_interval": 1}})
    part = {
        **config,
        "sampling": {**sampling, "steps": 7},
        "output": {"prefix": str(tmp_path / "part"), "observables_interval": 1},
    }
    mh.run(part)
    resumed = mh.resume(tmp_path / "part", steps=5)
    assert whole.table["E_line"][-1] == resumed.table["E_line"][-1] != 0
    assert whole.table["exchangeAcceptance"][-1] == resumed.table["exchangeAcceptance"][-1] > 0


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"species": [{"name": "a"}, {"name": "b"}]}, "the species a, b have neither fraction nor vertices"),
        ({"species": [{"name": "a"}, {"name": "a", "fraction": 0.1}]}, "there are 2 species called 'a'"),
        ({"species": [{"name": "a", "fraction": 0.7}, {"name": "b", "fraction": 0.7}]}, "add up to 1.4"),
        ({"species": [{"name": "a", "fraction": 0.7}]}, "the fractions of the species add up to 0.7"),
        ({"species": [{"name": "a", "vertices": [1]}]}, "161 of 162 vertices are of no species"),
        ({"species": [{"name": "a", "vertices": [162]}, {"name": "b"}]}, "the species a has the vertex 162"),
        (
            {"species": [{"name": "a", "vertices": [1]}, {"name": "b", "vertices": [1]}, {"name": "c"}]},
            "the vertex 1 is of the species a and of b",
        ),
        ({"species": [{"name": "a", "fraction": 2}]}, "species.* 1 fraction is 2"),
        ({"species": [{"name": "a", "region": "cap"}]}, "there is no fraction"),
        ({"species": [{"name": "a", "bending": 3}]}, "has no key 'bending'; did you mean 'bending_modulus'"),
        ({"species": [{"name": "a", "bending_modulus": -3}]}, "bending_modulus is -3"),
        ({"membrane": {"line_tension": 2}}, "line_tension has no effect without"),
        ({"species": LO_LD, "membrane": {"line_tension": {"lo, le": 2}}}, "no species is called 'le'"),
        ({"species": LO_LD, "membrane": {"pair_energies": {"lo": 2}}}, "separated by a comma"),
        ({"species": LO_LD, "membrane": {"line_tension": {"lo, lo": 2}}}, "two different species"),
        ({"sampling": {"exchange_probability": 0.2}}, "exchange_probability has no effect without"),
        ({"sampling": {"exchange_probability": 0.7}, "species": LO_LD}, "must not add up to more than 1"),
        ({"membrane": {"spontaneous_curvature": "3 nm"}}, "is not a unit of curvature"),
        ({"species": [{"name": ""}]}, r"\[\[species\]\] 1 name is ''; it must not be empty"),
        ({"species": [{"name": "a", "direction": [1.0, 2.0]}]}, r"direction is \[1.0, 2.0\]; it must have at least 3"),
        ({"species": [{"name": "a", "direction": [1.0] * 4}]}, "it must have at most 3 values"),
        ({"species": {"name": "a"}}, r"it must be a list of tables, each under \[\[species\]\]"),
        ({"membrane": {"pair_energies": 3}}, "pair_energies is 3; it must be a table"),
    ],
)
def test_mistakes_are_named(sections, message):
    with pytest.raises(ValueError, match=message) as found:
        mh.Scene.of(configOf(**sections))
    assert "validation" not in str(found.value)


ONE = [{"name": "a"}]


def withSpecies(**keys):
    return [{"name": "a", "fraction": 0.5}, {"name": "b", **keys}]


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"species": withSpecies(direction=[0.0, 1.0, 0.0])}, r"direction is \[0.0, 1.0, 0.0\], and has no effect"),
        ({"species": withSpecies(chemical_potential=1.0)}, "chemical_potential of the species b has no effect without"),
        (
            {"species": withSpecies(chemical_potential=1.0), "sampling": {"exchange_probability": 0.2}},
            "chemical_potential of the species b has no effect without mutations",
        ),
        ({"sampling": {"exchange_proposal": "anywhere"}}, "exchange_proposal has no effect without"),
        ({"sampling": {"exchange_fraction": 0.5}, "species": ONE}, "exchange_fraction has no effect with one"),
        ({"sampling": {"exchange_fraction": 0.5}, "species": LO_LD}, "since exchange_probability is 0; give it"),
        ({"species": ONE, "membrane": {"line_tension": 2}}, "line_tension has no effect with one of"),
        ({"species": ONE, "membrane": {"pair_energies": {"a, a": 2}}}, "pair_energies has no effect with one of"),
        (
            {"species": [{**each, "gaussian_modulus": 1.0} for each in LO_LD], "membrane": {"gaussian_modulus": 2.0}},
            "gaussian_modulus has no effect, since each of",
        ),
        (
            {"species": withSpecies(spontaneous_curvature=1.0, bending_modulus=0.0)},
            "spontaneous_curvature of the species b has no effect, since its bending_modulus is 0",
        ),
        (
            {"membrane": {"spontaneous_curvature": 1.0, "bending_modulus": 0.0}},
            "spontaneous_curvature has no effect, since the bending_modulus is 0",
        ),
    ],
)
def test_settings_without_effect_are_told(sections, message):
    """And so they are in what is read back of a resolved configuration, which has all defaults."""
    with pytest.raises(ValueError, match=message):
        parseConfig(configOf(**sections))


def test_a_curvature_may_wait_for_its_modulus():
    membrane = {"spontaneous_curvature": 1.0, "bending_modulus": 0.0}
    stage = {"kind": "sample", "bending_modulus": 5.0}
    sampling = {"seed": 1}
    checkStages(mh.Scene.of(configOf(membrane=membrane, stages=[stage], sampling=sampling)))
    stage = {"kind": "sample", "spontaneous_curvature": 5.0}
    with pytest.raises(
        ValueError, match=r"stage 1 \(sample\): it has a spontaneous_curvature, and the bending_modulus is"
    ):
        checkStages(mh.Scene.of(configOf(membrane={"bending_modulus": 0.0}, stages=[stage], sampling=sampling)))


@pytest.mark.parametrize("place", ["membrane", "species", "stage", "species of a stage"])
def test_a_curvature_that_no_edge_can_follow_is_told(place):
    """Of the membrane with its species, and of stages; what is a few edges' is taken."""
    for curvature, isRight in ((1e9, False), (-100.0, False), (5.0, True)):
        own, sections = {"spontaneous_curvature": curvature}, {"sampling": {"seed": 1}}
        sections["mesh"] = {"icosphere": 2, "length_unit": "um"}
        if "species" in place:
            sections["species"] = [{"name": "a", "fraction": 0.5}, {"name": "b", **(own if place == "species" else {})}]
        if place == "membrane":
            sections["membrane"] = own
        if "stage" in place:
            change = own if place == "stage" else {"species": {"b": own}}
            sections["stages"] = [{"kind": "sample", "steps": 10, **change}]
        if isRight:
            checkStages(mh.Scene.of(configOf(**sections)))
            continue
        value = re.escape(f"{curvature:g} 1/um")
        with pytest.raises(ValueError, match=rf"curvature.* is {value}; its size must be at most .*0\.1 of .* um"):
            checkStages(mh.Scene.of(configOf(**sections)))


@pytest.mark.parametrize("isEarlierStage", [False, True])
def test_a_stage_s_curvature_is_told_with_what_species_add(isEarlierStage):
    """Each of the two could be followed by edges alone."""
    half = {"spontaneous_curvature": -50.0}
    stages = [{"kind": "sample", "steps": 10, "species": {"b": half}}] if isEarlierStage else []
    species = [{"name": "a", "fraction": 0.5}, {"name": "b", **({} if isEarlierStage else half)}]
    config = {"species": species, "sampling": {"seed": 1}}
    checkStages(mh.Scene.of(configOf(**config, stages=[*stages, {"kind": "sample", "steps": 10}])))
    message = r"its spontaneous_curvature of 'b', with the membrane's own, is -100 1/nm; its size must be at most"
    with pytest.raises(ValueError, match=rf"stage {len(stages) + 1} \(sample\): {message}"):
        checkStages(mh.Scene.of(configOf(**config, stages=[*stages, {"kind": "sample", "steps": 10, **half}])))


def test_arrays_of_numpy_are_lists():
    species = [
        {"name": "a", "fraction": np.float32(0.25), "region": "cap", "direction": np.array([1, 0, 0])},
        {"name": "b", "vertices": np.arange(np.int64(3))},
        {"name": "c"},
    ]
    config = configOf(species=species, sampling={"seed": np.int64(1)}, membrane={"target_volume": np.array([4.0])})
    scene = mh.Scene.of(config)
    assert np.all(scene.vertexSpecies[:3] == 1) and np.count_nonzero(scene.vertexSpecies == 0) == round(0.25 * 162)
    assert parseConfig(config) == parseConfig(asDict(parseConfig(config)))


def test_axes_of_a_sweep_name_one_species(tmp_path):
    (tmp_path / "base.toml").write_text(configText(configOf(species=LO_LD)))

    def points(key):
        (tmp_path / "grid.toml").write_text(f'base = "base.toml"\n[grid]\n{key} = [10.0, 20.0]\n')
        return mh.readGrid(tmp_path / "grid.toml")

    assert [point.config.species[1].bending_modulus for point in points("species.ld.bending_modulus")] == [10, 20]
    assert [point.config.species[0].bending_modulus for point in points("species.1.bending_modulus")] == [10, 20]
    for key, message in (
        ("species.lx.bending_modulus", "does not name one of the species; the species are 1 .lo., 2 .ld."),
        (
            "species.bending_modulus",
            "it is written like species.NAME.bending_modulus, with the species' name or number",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            points(key)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The files of a short run with species that exchange."""
    prefix = tmp_path_factory.mktemp("species") / "run"
    sampling = {"seed": 5, "steps": 4, "exchange_probability": 0.5, "steps_per_trajectory": 5}
    output = {"prefix": str(prefix), "trajectory_interval": 1}
    return mh.run(configOf(species=LO_LD, membrane={"line_tension": 1.0}, sampling=sampling, output=output)), prefix


def test_files_have_the_species(results):
    frames = mh.readMeshTrajectory(f"{results[1]}.vtkhdf")
    assert [np.count_nonzero(frame.mesh.species == 0) for frame in frames] == [40] * len(frames)
    assert frames[0].mesh.speciesNames == ("lo", "ld")
    assert np.any(frames[0].mesh.species != frames[-1].mesh.species)
    final = meshio.read(f"{results[1]}.ply")
    assert np.array_equal(final.point_data["Species"], frames[-1].mesh.species)
    assert not {o.name for o in OBSERVABLES if o.condition} & set(results[0].table)
    assert results[0].table["E_line"].min() > 0 and np.ptp(results[0].table["E_line"]) > 0


def test_a_summary_tells_of_exchanges(results):
    summary, table = results[0], results[0].table
    accepted, alike = table["exchangeAcceptance"][-1], table["exchangesAlike"][-1]
    assert f"exchanges  {accepted:.1%} accepted, {alike:.1%} of alike species, since the start" in str(summary)
    assert accepted > 0 and alike > 0


def test_types_of_atoms_are_the_species_at_the_start(results, tmp_path):
    species = mh.Scene.of(configOf(species=LO_LD, sampling={"seed": 5})).vertexSpecies
    rows = [line.split() for line in results[1].with_suffix(".psf").read_text().splitlines() if " MEM " in line]
    assert [row[5] for row in rows] == [LO_LD[i]["name"] for i in species]
    mh.writePSF(tmp_path / "a.psf", MESH.topology(), types=["two words of it", ""])
    rows = [line.split() for line in (tmp_path / "a.psf").read_text().splitlines() if " MEM " in line]
    assert [row[5] for row in rows[:3]] == ["two_", "X", "V002"] and len({len(row) for row in rows}) == 1
    assert app.CharmmPsfFile(str(tmp_path / "a.psf")).topology.getNumBonds() == len(MESH.edges)


@pytest.mark.parametrize("name", ["a.png", "a.gif"])
def test_pictures_color_by_species(results, tmp_path, name):
    frames, pictures = mh.readMeshTrajectory(f"{results[1]}.vtkhdf"), []
    for colored in ("auto", "species", "curvature"):
        render(frames, tmp_path / name, look=Look(size=(200, 160), colorBy=colored))
        pictures.append((tmp_path / name).read_bytes())
    assert pictures[0] == pictures[1] != pictures[2]


def test_species_are_not_asked_of_a_mesh_without(tmp_path):
    with pytest.raises(ValueError, match="there are no species to color it by"):
        drawMesh(MESH, tmp_path / "a.png", look=Look(colorBy="species"))


def test_a_report_names_the_species(results):
    page = writeReport(results[1]).read_text()
    assert (
        '"legend": [["lo", "#1f77b4"], ["ld", "#ff7f0e"]]' in page
        or '"legend":[["lo","#1f77b4"],["ld","#ff7f0e"]]' in page
    )
    assert '"species":' in page


def withSpecies642(numbers, names=()):
    mesh = mh.Mesh.icosphere(3)
    mesh.speciesNames, mesh.species = names, numbers(mesh)
    return mesh


def test_few_species_have_colors_of_their_own_and_many_a_scale():
    for count in (1, 2, 10, 11, 40, 642, 5000):
        colors = speciesColors(np.arange(count), count)
        assert len(np.unique(colors, axis=0)) >= min(count, 100)
    few = withSpecies642(lambda mesh: np.arange(642) % 12 % 10)
    assert [label for label, _ in speciesLegend(few, speciesCount(few))] == [f"species {k}" for k in range(10)]
    names = [f"C0 = {k}" for k in range(33)]
    many = withSpecies642(lambda mesh: np.arange(642) % 30, names)
    legend = speciesLegend(many, speciesCount(many))
    assert [label for label, _ in legend] == ["C0 = 0", "C0 = 8", "C0 = 16", "C0 = 24", "C0 = 32"]
    assert np.array_equal([color for _, color in legend], speciesColors(np.arange(0, 33, 8), 33))


def test_a_field_of_a_species_each_is_shown_where_numbers_say_something():
    byHeight = withSpecies642(lambda mesh: np.argsort(np.argsort(mesh.vertices[:, 2])))
    anyhow = withSpecies642(lambda mesh: np.random.default_rng(1).permutation(642))
    mixed = withSpecies642(lambda mesh: np.random.default_rng(1).integers(0, 12, 642))
    assert Look().species(byHeight) is not None and Look().species(mixed) is not None
    assert Look().species(anyhow) is None and Look(colorBy="species").species(anyhow) is not None


def test_a_report_shows_many_species_by_a_scale(tmp_path):
    frames = [mh.meshFrame(k, withSpecies642(lambda mesh: np.argsort(np.argsort(mesh.vertices[:, 2])))) for k in (0, 1)]
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", frames)
    shape = partsOf(writeReport(tmp_path / "a"))[0]["shape"]
    places = np.frombuffer(base64.b64decode(shape["frames"][0]["species"]), np.uint8)
    order = np.argsort(frames[0].mesh.species)
    assert len(shape["speciesColors"]) == 256 and places.min() == 0 and places.max() == 255
    assert np.all(np.diff(places[order].astype(int)) >= 0)
    assert [label for label, _ in shape["legend"]] == [f"species {k}" for k in (0, 160, 320, 481, 641)]


STAGES = [
    {"kind": "sample", "steps": 2, "volume_modulus": 0, "pressure": 3},
    {
        "kind": "continue",
        "windows": 2,
        "equilibration": 1,
        "steps": 2,
        "spontaneous_curvature": 0.4,
        "line_tension": 4,
        "there_and_back": True,
        "path": {"line_tension": [0, 0.25, 1]},
    },
    {"kind": "approach", "steps": 4, "area_difference_modulus": 100},
]


def runStages(prefix, stages=STAGES, **sections):
    sampling = {"seed": 5, "flip_probability": 0.3, "steps_per_trajectory": 5}
    output = {"prefix": str(prefix), "observables_interval": 1}
    membrane = {"line_tension": 2.0}
    return mh.run(
        configOf(sampling=sampling, species=LO_LD, output=output, stages=stages, membrane=membrane, **sections)
    )


def test_stages_change_moduli_and_the_like(tmp_path):
    runStages(tmp_path / "run")
    simulation, force = loadSimulation(tmp_path / "run.checkpoint", mm.Platform.getPlatformByName("CPU"), {})
    kT = thermalEnergy(300)
    ask = simulation.context.getParameter
    assert force.getVolumeModulus()._value == 0 and ask(force.getPressureParameter()) == pytest.approx(3 * kT)
    assert ask(force.getSpontaneousCurvatureParameter()) == pytest.approx(0, abs=1e-15)  # there and back
    assert force.getLineTension(0, 1)._value == pytest.approx(2 * kT)
    assert force.getAreaDifferenceModulus()._value == pytest.approx(100 * kT)


def test_tables_have_what_stages_change(tmp_path):
    """And nothing else; windows have it too, and plots a panel where it changes."""
    summary = runStages(tmp_path / "run")
    table = summary.table
    first, second, third = (table["stage"] == k for k in (1, 2, 3))
    names = {o.name for o in OBSERVABLES if o.condition} & set(table)
    assert names == {"volumeModulus", "pressure", "spontaneousCurvature", "lineTension", "areaDifferenceModulus"}
    assert np.all(table["volumeModulus"][1:] == 0) and table["volumeModulus"][0] == pytest.approx(1e6)
    assert np.allclose(table["pressure"][1:], 3)
    windows = table["window"][second].astype(int)
    assert np.allclose(table["spontaneousCurvature"][second], np.array([0, 0.2, 0.4, 0.2, 0])[windows])
    assert np.allclose(table["lineTension"][second], np.array([2, 2.5, 4, 2.5, 2])[windows])
    assert np.all(table["lineTension"][first] == table["lineTension"][third][-1])
    assert np.allclose(table["areaDifferenceModulus"][third], [25, 50, 75, 100])
    path = mh.readObservables(tmp_path / "run_path.csv")
    assert np.allclose(path["lineTension"], [2, 2.5, 4, 2.5, 2]) and np.allclose(path["lineTensionDeviation"], 0)
    units = observableUnits(tmp_path / "run.csv")
    assert [units[name] for name in ("spontaneousCurvature", "lineTension", "pressure")] == ["1/nm", "kT/nm", "kT/nm^3"]
    drawn = [panel.title for panel in PANELS if curves(panel, table)]
    assert "line tension" in drawn and "volume modulus" in drawn and "tension" not in drawn


def test_a_path_of_a_line_tension_is_the_one_given(tmp_path):
    table = runStages(tmp_path / "run").table
    # The line energy over the line tension is a length, which changes little in so few steps.
    windows = [table["E_line"][(table["stage"] == 2) & (table["window"] == k)].mean() for k in range(5)]
    lengths = np.divide(windows, [2, 2.5, 4, 2.5, 2])
    assert np.ptp(lengths) < 0.2 * lengths.mean()


def test_a_run_whose_stages_change_moduli_goes_on_to_the_same_bits(tmp_path):
    whole = runStages(tmp_path / "whole")
    steps = itertools.count()

    def progress(*_):
        if next(steps) == 8:
            signal.raise_signal(signal.SIGINT)

    config = configOf(
        sampling={"seed": 5, "flip_probability": 0.3, "steps_per_trajectory": 5},
        species=LO_LD,
        membrane={"line_tension": 2.0},
        output={"prefix": str(tmp_path / "part"), "observables_interval": 1, "checkpoint_interval": 1},
        stages=STAGES,
    )
    assert mh.run(config, progress=progress).interrupted
    resumed = mh.resume(tmp_path / "part")
    for name in ("energy", "E_line", "E_bending", "lineTension", "spontaneousCurvature"):
        assert np.array_equal(whole.table[name], resumed.table[name])


OWN = [
    {"kind": "sample", "steps": 2, "species": {"lo": {"bending_modulus": 10, "gaussian_modulus": -3}}},
    {
        "kind": "continue",
        "windows": 2,
        "equilibration": 1,
        "steps": 1,
        "line_tension": {"ld,lo": 4.0},
        "pair_energies": {"lo, lo": -0.5},
        "species": {"ld": {"spontaneous_curvature": 0.7}},
        "path": {"line_tension[ld, lo]": [0, 0.25, 1]},
    },
    {"kind": "approach", "steps": 2, "species": {"lo": {"bending_modulus": 20}}},
]


def test_stages_change_what_single_species_have(tmp_path):
    """From what these have, at once and along a path; tables and the resolved configuration have it."""
    summary = runStages(tmp_path / "run", OWN)
    table, first, second = summary.table, summary.table["stage"] == 1, summary.table["stage"] == 2
    windows = table["window"][second].astype(int)
    assert np.allclose(table["bendingModulus[0]"], [40, 10, 10, *[10] * len(windows), 15, 20])
    assert np.allclose(table["gaussianModulus[0]"][1:], -3) and np.all(table["lineTension[0,1]"][first] == 2)
    assert np.allclose(table["lineTension[0,1]"][second], np.array([2, 2.5, 4])[windows])
    assert np.allclose(table["pairEnergy[0,0]"][second], np.array([0, -0.25, -0.5])[windows])
    assert np.allclose(table["spontaneousCurvature[1]"][second], np.array([0.3, 0.5, 0.7])[windows])
    assert table["E_pair"][-1] < 0 and "spontaneousCurvature" not in table and "lineTension" not in table
    units = observableUnits(tmp_path / "run.csv")
    assert (units["lineTension[0,1]"], units["spontaneousCurvature[1]"]) == ("kT/nm", "1/nm")
    drawn = {panel.title: [o.label for o in curves(panel, table)] for panel in PANELS}
    assert drawn["bending modulus"] == ["species 0"] and drawn["line tension"] == ["species 0,1"]
    simulation, force = loadSimulation(tmp_path / "run.checkpoint", mm.Platform.getPlatformByName("CPU"), {})
    kT = thermalEnergy(300)
    plain = [[value._value for value in force.getSpeciesParameters(i)] for i in range(2)]
    np.testing.assert_allclose(plain, [[20 * kT, 0, -3 * kT], [20 * kT, 0.7, 0]])
    config = readTOML(tmp_path / "run.resolved.toml")
    config["output"]["prefix"] = str(tmp_path / "again")
    mh.run(config)
    assert (tmp_path / "run.csv").read_bytes() == (tmp_path / "again.csv").read_bytes()
    again = mh.resume(tmp_path / "run", steps=2)
    assert again.table["bendingModulus[0]"][-1] == table["bendingModulus[0]"][-1]


def test_step_sizes_follow_the_stiffest_species_of_a_stage():
    stages = [{"kind": "sample", "steps": 2, "species": {"ld": {"bending_modulus": 90}}}]
    stiff = [LO_LD[0], {**LO_LD[1], "bending_modulus": 90}]
    sizes = [
        mh.Scene.of(configOf(species=s, stages=st, sampling={"seed": 1})).stepSize
        for s, st in ((LO_LD, stages), (stiff, stages), (LO_LD, [{"kind": "sample"}]))
    ]
    assert sizes[0] == sizes[1] < sizes[2]


@pytest.mark.parametrize(
    ("stage", "message"),
    [
        ({"species": {"lx": {"bending_modulus": 3}}}, r"stage 1 \(sample\): it has a bending_modulus of 'lx', and no"),
        ({"species": {"lo": {"bending_modulus": -3}}}, r"stage 1 \(sample\) species lo bending_modulus is -3"),
        ({"species": {"lo": {"bending": 3}}}, r"stage 1 \(sample\) species lo has no key 'bending'; did you mean"),
        ({"species": {"lo": {"chemical_potential": 3}}}, "no key 'chemical_potential'; it has bending_modulus, spont"),
        ({"species": {"lo": {}}}, r"stage 1 \(sample\) species lo has nothing to change; give one of bending_modulus"),
        ({"species": {"": {"bending_modulus": 3}}}, r"stage 1 \(sample\) species: the name of a species is empty"),
        ({"line_tension": {"lo": 3}}, r"stage 1 \(sample\) line_tension: each key must be the names of two species"),
        ({"line_tension": {"lo, ld": 3, "ld,lo": 2}}, r"line_tension: the pair ld, lo is given twice"),
        (
            {"species": {"lo": {"bending_modulus": 0, "spontaneous_curvature": 3}}},
            "it has a spontaneous_curvature of 'lo', whose bending_modulus is 0; give it one",
        ),
        (
            {"kind": "continue", "windows": 1, "line_tension": 3, "path": {"line_tension": [0, 1e300]}},
            r"stage 1 \(continue\) path: each number must be 0, or from 1e-30 to",
        ),
        ({"line_tension": {"lo, lx": 3}}, "it has a line_tension of 'lo, lx', and no species is called 'lx'"),
        ({"line_tension": {"lo, lo": 3}}, "it has a line_tension of 'lo, lo'; it must be of two different species"),
        ({"pair_energies": {"lx, lx": 3}}, "it has a pair_energy of 'lx, lx', and no species is called 'lx'"),
        (
            {
                "kind": "continue",
                "windows": 1,
                "species": {"lo": {"bending_modulus": 0}},
                "path": {"bending_modulus[lo]": [0, 2]},
            },
            r"the path of bending_modulus\[lo\] leads to -40; it must not be negative",
        ),
    ],
)
def test_mistakes_of_species_in_stages_are_named(tmp_path, stage, message):
    with pytest.raises(ValueError, match=message):
        runStages(tmp_path / "run", [{"kind": "sample", **stage}])


@pytest.mark.parametrize(
    ("stage", "message"),
    [
        ({"bending_modulus": 3}, "the membrane has species, each of which has its own"),
        ({"area_modulus": -3}, "area_modulus is -3"),
        ({"kind": "continue"}, "has no target to go to"),
        (
            {"kind": "continue", "area_modulus": 0, "path": {"area_modulus": [0, 1.5]}, "windows": 1},
            r"stage 1 \(continue\): the path of area_modulus leads to -500000; it must not be negative",
        ),
        ({"kind": "continue", "line_tension": 2, "path": {"tension": [0, 1]}, "windows": 1}, "path has 'tension'"),
    ],
)
def test_mistakes_of_stages_are_named(tmp_path, stage, message):
    with pytest.raises(ValueError, match=message):
        runStages(tmp_path / "run", [{"kind": "sample", **stage}])


@pytest.mark.parametrize("suffix", ["ply", "vtu", "vtk"])
def test_a_field_of_the_mesh_file_says_where_species_are(tmp_path, suffix):
    own, file = (np.arange(len(MESH.vertices)) % 2).astype(np.intc), tmp_path / f"mesh.{suffix}"
    mh.Mesh(MESH.vertices, MESH.triangles, species=own).write(file)
    mesh = {"file": str(file), "species_field": "Species"}
    scene = mh.Scene.of(configOf(mesh=mesh, species=[{"name": "a"}, {"name": "b"}]))
    assert np.array_equal(scene.vertexSpecies, own)
    for change, message in (
        ({"species": [{"name": "a"}]}, r"species_field Species has the number 1; with 1 \[\[species\]\]"),
        ({"mesh": {**mesh, "species_field": "x"}}, "has no array of vertices called 'x': it has Species"),
        ({"species": [{"name": "a", "fraction": 0.5}, {"name": "b"}]}, "has a fraction or vertices of its own"),
        ({"species": []}, "species_field has no effect without"),
        ({"mesh": {"icosphere": 1, "species_field": "x"}}, "there is no file that has it"),
    ):
        with pytest.raises(ValueError, match=message):
            mh.Scene.of(configOf(**{"mesh": mesh, "species": [{"name": "a"}, {"name": "b"}], **change}))


def withOwnSpecies():
    return mh.Mesh(MESH.vertices, MESH.triangles, species=np.arange(len(MESH.vertices)) % 3)


@pytest.mark.parametrize("suffix", ["ply", "vtu", "vtk"])
@pytest.mark.parametrize("hasVTK", [True, False])
def test_files_bring_species_back(tmp_path, monkeypatch, suffix, hasVTK):
    """Those of write() by themselves, and those of another array by its name."""
    if not hasVTK:
        monkeypatch.setattr(vtkfiles, "_hasVTK", lambda: False)
    mesh, file = withOwnSpecies(), tmp_path / f"a.{suffix}"
    others = {"kind": np.arange(162) % 2, "height": MESH.vertices[:, 2]}
    mesh.write(file, unit=2.0, data=others)
    read = mh.Mesh.read(file, unit=2.0)
    assert np.array_equal(read.species, mesh.species) and not read.notes and read.species.dtype == np.intc
    np.testing.assert_allclose(read.vertices, mesh.vertices, rtol=1e-15)
    assert np.array_equal(mh.Mesh.read(file, speciesField="kind").species, others["kind"])
    assert np.array_equal(mh.Mesh.read(file, repair=True).species, mesh.species)
    with pytest.raises(ValueError, match=r"the file has no array of vertices called 'x': it has .*kind"):
        mh.Mesh.read(file, speciesField="x")
    with pytest.raises(ValueError, match=r"the array height has the value 1\.70\d+, which is no number of a species"):
        mh.Mesh.read(file, speciesField="height")
    mh.Mesh(MESH.vertices, MESH.triangles).write(file, data={"Species": others["height"]})
    read = mh.Mesh.read(file)
    assert read.species is None and "which is no number of a species: whole, and 0 or more; it was" in read.notes[0]


def test_a_file_without_species_has_none(tmp_path):
    withOwnSpecies().write(tmp_path / "a.stl")
    assert mh.Mesh.read(tmp_path / "a.stl").species is None
    with pytest.raises(ValueError, match="called 'Species': it has none"):
        mh.Mesh.read(tmp_path / "a.stl", speciesField="Species")


def test_species_follow_the_vertices_that_are_left(tmp_path):
    mesh = withOwnSpecies()
    two = mh.Mesh.merged([mesh, mh.Mesh(mesh.vertices + 9.0, mesh.triangles)])
    two.species = np.repeat([0, 1], len(mesh.vertices))
    two.triangles = two.triangles[len(mesh.triangles) :]
    two.write(tmp_path / "a.ply")
    read = mh.Mesh.read(tmp_path / "a.ply")
    assert len(read.vertices) == 162 and set(read.species) == {1}
    assert "vertices of no face were left out" in read.notes[0]
    corner = mh.Mesh(
        np.append(mesh.vertices, mesh.vertices[:1], axis=0), mesh.triangles, species=np.append(mesh.species, 0)
    )
    corner.triangles[0, corner.triangles[0] == corner.triangles[0, 0]] = 162
    mended = corner.repaired()
    assert mended.species is None and "the species were left out, since vertices have changed" in mended.notes


def test_a_trajectory_brings_species_and_names_back(tmp_path):
    mesh = withOwnSpecies()
    mesh.speciesNames = ("a", "b", "c")
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", [mh.meshFrame(0, mesh)])
    with mh.readMeshTrajectory(tmp_path / "a.vtkhdf") as frames:
        read = frames[0].mesh
    assert np.array_equal(read.species, mesh.species) and read.speciesNames == mesh.speciesNames


def test_no_two_species_have_the_same_name(tmp_path):
    """When names are assigned, and when a mesh is made of them; a file that has them so is read without."""
    mesh = mh.Mesh(MESH.vertices, MESH.triangles, species=[0, 1] * 81, speciesNames=("a", "b"))
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", [mh.meshFrame(0, mesh)])
    for assign in (
        lambda: setattr(mesh, "speciesNames", ["a", "a"]),
        lambda: mh.Mesh(MESH.vertices, MESH.triangles, speciesNames=("a", "b", "a")),
    ):
        with pytest.raises(ValueError, match="speciesNames has 'a' twice; each species must have a name of its own"):
            assign()
    assert mesh.speciesNames == ("a", "b")
    with h5py.File(tmp_path / "a.vtkhdf", "a") as file:
        file.attrs["speciesNames"] = "a, a"
    with mh.readMeshTrajectory(tmp_path / "a.vtkhdf") as frames:
        assert frames[0].mesh.speciesNames == () and np.array_equal(frames[0].mesh.species, mesh.species)


@pytest.mark.parametrize(
    ("species", "message"),
    [
        ([0, 1], r"the species have the shape \(2,\); there must be one for each of 162 vertices"),
        ([[0]] * 162, r"the shape \(162, 1\)"),
        ([0.0] * 162, "the species are of type float64; they must be whole numbers"),
        ([0] * 161 + [-1], "the species of vertex 161 is -1; it must be a whole number, 0 or more"),
        (["a"] * 161 + ["x"], "the species of vertex 161 is 'x'; they are called a, b"),
        ([None] * 162, "the species are of type object"),
        ([[0], [0, 1]], "must be an array of whole numbers"),
        ([2**40] * 162, "the species of vertex 0 is 1099511627776"),
    ],
)
def test_species_that_are_none_are_refused(species, message):
    """When they are assigned, and when a mesh is made of them; the mesh then has those that it had."""
    mesh = mh.Mesh(MESH.vertices, MESH.triangles, species=["a", "b"] * 81, speciesNames=("a", "b"))
    for assign in (
        lambda: setattr(mesh, "species", species),
        lambda: mh.Mesh(MESH.vertices, MESH.triangles, species=species, speciesNames=("a", "b")),
    ):
        with pytest.raises(ValueError, match=message):
            assign()
    assert mesh.species.tolist() == [0, 1] * 81
    mesh.species = None
    assert mesh.species is None


def test_a_mesh_with_species_keeps_them():
    own = (np.arange(len(MESH.vertices)) % 2).astype(np.intc)
    mesh, sampling = mh.Mesh(MESH.vertices, MESH.triangles, species=own), {"seed": 1}
    two = [{"name": "a"}, {"name": "b"}]
    assert np.array_equal(mh.Scene.of({"species": two, "sampling": sampling}, mesh).vertexSpecies, own)
    for species, message in (
        (two[:1], r"the mesh has species, of which one has the number 1; with 1 \[\[species\]\]"),
        (LO_LD, "the mesh has species of its own, and the species lo has a fraction or vertices"),
    ):
        with pytest.raises(ValueError, match=message):
            mh.Scene.of({"species": species, "sampling": sampling}, mesh)


def test_a_sweep_over_species_goes_on(tmp_path):
    """Axes may be membrane.line_tension and membrane.spontaneous_curvature; a second command finds every point done."""
    (tmp_path / "base.toml").write_text(
        configText(configOf(species=LO_LD, sampling={"seed": 1, "steps": 2, "exchange_probability": 0.5}))
    )
    (tmp_path / "grid.toml").write_text(
        'base = "base.toml"\n[grid]\nmembrane.line_tension = [1, 2]\nmembrane.spontaneous_curvature = [0.1]\n'
    )
    tables = []
    for _ in range(2):
        found = mh.sweep(tmp_path / "grid.toml", tmp_path / "out", workers=1)
        tables.append(found.table.read_text())
    assert tables[0] == tables[1] and tables[0].count("\n") == 3


@pytest.mark.parametrize("tensions", [{"a, b": 2.0, "a, c": 1.0, "b, c": 1.0}, {"a, b": 2.0}])
def test_no_stage_leads_line_tensions_that_differ(tensions):
    species = [{"name": "a", "fraction": 0.3}, {"name": "b", "fraction": 0.3}, {"name": "c"}]
    stages = [{"kind": "approach", "line_tension": 3.0, "steps": 5}]
    membrane = {"line_tension": tensions}
    config = configOf(species=species, membrane=membrane, stages=stages, sampling={"seed": 1})
    with pytest.raises(ValueError, match=r"stage 1 \(approach\): it leads all line tensions to one value"):
        checkStages(mh.Scene.of(config))
    checkStages(mh.Scene.of({**config, "membrane": {"line_tension": 2.0}}))
    checkStages(mh.Scene.of({**config, "stages": [{"kind": "sample", "steps": 1, "line_tension": 2.0}, *stages]}))


def test_what_follows_a_way_there_and_back_has_the_moduli_before_it():
    there = {"kind": "continue", "volume_modulus": 0, "there_and_back": True, "windows": 1, "steps": 1}
    after = {"kind": "sample", "steps": 1, "reduced_volume": 0.97}
    scene = mh.Scene.of(configOf(stages=[there, after], sampling={"seed": 1, "approach": "none"}))
    checkStages(scene)
    with pytest.raises(ValueError, match="volume, whose modulus is 0"):
        checkStages(
            mh.Scene.of({**configOf(stages=[{**there, "there_and_back": False}, after]), "sampling": {"seed": 1}})
        )


@pytest.mark.parametrize("unit", ["nm", "100 nm"])
def test_the_lambdas_of_a_path_have_no_unit(unit):
    stage = {"kind": "continue", "target_area": 50.0, "path": {"target_area": [0, 0.25, 1]}, "windows": 2}
    mesh = {"icosphere": 2, "scale": 2.0, "length_unit": unit}
    config = configOf(stages=[stage], mesh=mesh, sampling={"seed": 1})
    checkStages(mh.Scene.of(config))
    assert parseConfig(config).stages[0].path == {"target_area": [0, 0.25, 1]}
    with pytest.raises(ValueError, match="must be a number"):
        parseConfig({**config, "stages": [{**stage, "path": {"target_area": [0, "0.5 nm^2", 1]}}]})


@pytest.mark.parametrize("value", ["5 kT", True, [1], {"lo, ld": "five"}, float("nan")])
def test_a_line_tension_that_is_none_is_one_line(value):
    with pytest.raises(ValueError, match=r"\[membrane\] line_tension") as found:
        parseConfig(configOf(species=LO_LD, membrane={"line_tension": value}))
    assert len(str(found.value).splitlines()) == 1 and "function" not in str(found.value)


def test_pairs_of_very_many_species_are_refused():
    """A plain line tension stands for each pair."""
    species = [{"name": f"s{i}", "vertices": [i]} for i in range(2562)]
    with pytest.raises(ValueError, match="line_tension is 1 between all of 2562 species, which makes 3280641 pairs"):
        mh.Scene.of({"membrane": {"line_tension": 1.0}, "species": species}, mh.Mesh.icosphere(4)).createForce()
