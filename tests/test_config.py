"""Configurations: units, stages, defaults written out, and TriMem's converted."""

import datetime
import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from openmm import unit

import openmmhelfrich as mh
from conftest import together
from membranes import energyOf, forcesOf
from openmmhelfrich.geometry.measured import MeasuredMesh
from openmmhelfrich.runs import memory
from openmmhelfrich.runs.config import parseConfig, readConfig, stagesOf, tomllib
from openmmhelfrich.runs.configfile import defaultText, settingsText
from openmmhelfrich.runs.defaults import resolve
from openmmhelfrich.runs.meshsource import loadMesh
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.sections import (
    MembraneSection,
    MeshSection,
    OutputSection,
    SamplingSection,
    TetherSection,
)
from openmmhelfrich.runs.stagesettings import STAGES
from openmmhelfrich.runs.trimem import convertConfig
from openmmhelfrich.sampling.conditions import currentMesh

PEER = {
    case["name"]: case for case in json.loads((Path(__file__).parent / "data/peer_values.json").read_text())["cases"]
}


def parse(**sections):
    return parseConfig({"mesh": {"icosphere": 2}, **sections})


def complaintOf(**sections):
    with pytest.raises(ValueError) as error:
        parse(**sections)
    return str(error.value)


# --- numbers with units


@pytest.mark.parametrize(
    "text, kT",
    [
        ("20 kT", 20),
        ("20kT", 20),
        ("1e-19 J", 24.0886),
        ("100 zJ", 24.0886),
        ("100 pN nm", 24.0886),
        ("60.2214 kJ/mol", 24.0886),
        ("14.3933 kcal/mol", 24.0886),
        ("0.624151 eV", 24.0886),
        (60.2214 * unit.kilojoule_per_mole, 24.0886),
    ],
)
def testEnergies(text, kT):
    """At 300.679 K, kT is 2.5 kJ/mol."""
    config = parse(membrane={"bending_modulus": text}, sampling={"temperature": 2.5 / 0.00831446261815324})
    assert config.membrane.bending_modulus == pytest.approx(kT, rel=1e-5)


def testEnergiesFollowTheTemperature():
    cold, warm = (
        parse(membrane={"bending_modulus": "80 kJ/mol"}, sampling={"temperature": t}).membrane.bending_modulus
        for t in ("300 K", "600 K")
    )
    assert cold == pytest.approx(2 * warm, rel=1e-12) and cold == pytest.approx(80 / 2.494339, rel=1e-6)
    assert parse(sampling={"temperature": "37 C"}).sampling.temperature == pytest.approx(310.15)


def testLengths():
    config = parseConfig(
        {
            "mesh": {"icosphere": 2, "length_unit": "um"},
            "membrane": {"target_area": "12 um^2", "target_volume": "4 fL", "leaflet_separation": "2 nm"},
            "tether": {"min_length": "100 nm", "max_length": "2000 Å"},
            "sampling": {"step_size": "0.5 fs", "mass": "2 kDa"},
        }
    )
    assert (
        config.membrane.target_area,
        config.membrane.target_volume,
        config.membrane.leaflet_separation,
    ) == pytest.approx((12, 4, 0.002))
    assert (config.tether.min_length, config.tether.max_length) == pytest.approx((0.1, 0.2))
    assert (config.sampling.step_size, config.sampling.mass) == pytest.approx((0.0005, 2000))
    assert parse(stages=[{"kind": "sample", "target_area": 12 * unit.angstrom**2}]).stages[
        0
    ].target_area == pytest.approx(0.12)


@pytest.mark.parametrize(
    "sections, message",
    [
        (
            {"membrane": {"bending_modulus": "20 kN"}},
            "[membrane] bending_modulus is '20 kN'; 'kN' is not a unit of energy; write it like '80 kJ/mol'",
        ),
        (
            {"membrane": {"bending_modulus": "-1 kT"}},
            "[membrane] bending_modulus is -1.0; it must be greater than or equal to 0",
        ),
        ({"tether": {"min_length": "3 um^2"}}, "[tether] min_length is '3 um^2'; 'um^2' is not a unit of length"),
        ({"membrane": {"target_area": 3 * unit.nanometer}}, "[membrane] target_area is 3 nm; it must be an area"),
        (
            {"sampling": {"step_size": "automatic"}},
            "[sampling] step_size is 'automatic'; it must be a number, or a number with a unit in quotes, like '1 fs'",
        ),
        (
            {"sampling": {"step_size": -1.0}},
            "[sampling] step_size is -1.0; it must be a positive number, in ps, or 'auto'",
        ),
        ({"sampling": {"trajectory_jitter": 1.0}}, "[sampling] trajectory_jitter is 1.0"),
        ({"sampling": {"momentum_refreshment": 0.0}}, "[sampling] momentum_refreshment is 0.0"),
        ({"sampling": {"target_acceptance": 1.0}}, "[sampling] target_acceptance is 1.0"),
        ({"output": {"checkpoint_interval": 0}}, "[output] checkpoint_interval is 0"),
        (
            {"mesh": {"icosphere": 2, "length_unit": "R0"}, "tether": {"min_length": "100 nm"}},
            "the mesh's length_unit, 'R0', is not a length",
        ),
        ({"mesh": {"icosphere": 2, "file": "a.stl"}}, "[mesh] file and icosphere are both given"),
        ({"bending_modulus": 20}, "there is no section or key 'bending_modulus'; it belongs in [membrane]"),
        ({"membrane": {"chemical_potential": 1}}, "no key 'chemical_potential'; it belongs in [[species]]"),
        ({"system": {"fixed_box": [[0, 0, 0], [1, "x", 2]]}}, "[system] fixed_box[1][1] is 'x'; it must be a number"),
        ({"membrane": {"line_tension": {"a, b": "x"}}}, "[membrane] line_tension: the pair a, b has 'x'; it must be"),
        ({"sampling": {"steps": datetime.date(2020, 1, 2)}}, "[sampling] steps is 2020-01-02; it must be a whole"),
        ({"sampling": {"steps": True}}, "[sampling] steps is true; it must be a whole number"),
        ({"output": {"overwrite": "yes"}}, "[output] overwrite is 'yes'; it must be true or false"),
        (
            {"output": {"prefix": "a\0b"}},
            r"[output] prefix is 'a\x00b'; it must be the name of a file, which has no null",
        ),
        ({"mesh": {"file": "a\0b"}}, r"[mesh] file is 'a\x00b'; it must be the name of a file"),
        ({"system": {"forces": "a\0b"}}, r"[system] forces[0] is 'a\x00b'; it must be the name of a file"),
        ({"stages": [3]}, "stage 1 is 3; it must be a table of keys"),
        ({"sampling": {"windows": 3}}, "[sampling] has no key 'windows'; it belongs in a stage of kind continue"),
    ],
)
def testWrongNumbers(sections, message):
    assert message in complaintOf(**sections)


@pytest.mark.parametrize(
    ("section", "key", "value", "allowed"),
    [
        ("sampling", "momentum_refreshment", 1e-300, "it must be from 1e-30 to 1"),
        ("sampling", "target_acceptance", 1e-300, "it must be from 1e-30 to less than 1"),
        ("sampling", "trajectory_jitter", 1e-300, "it must be 0, or from 1e-30 to less than 1"),
        ("sampling", "shear_wave_cutoff", 1e31, "it must be from 1 to 1e+30"),
        ("sampling", "step_size", 1e-300, "it must be from 1e-30 to 1e+30"),
        ("sampling", "multilevel_weight", 1e-300, "it must be 0, or from 1e-30 to 1000"),
        ("membrane", "reduced_volume", [0.9, 1e-300], "each number must be from 1e-30 to 1"),
        ("membrane", "target_area_difference", -1e-300, "it must be from 1e-30 to 1e+30 in size"),
        ("membrane", "tension", 1e-300, "it must be 0, or from 1e-30 to 1e+30 in size"),
        ("membrane", "area_modulus", 1e31, "it must be 0, or from 1e-30 to 1e+30"),
    ],
)
def testNumbersTooSmallOrLargeAreToldWhatTheirKeyAllows(section, key, value, allowed):
    with pytest.raises(ValueError, match=rf"\[{section}\] {key} is .*; {re.escape(allowed)}$"):
        parse(**{section: {key: value}})


@pytest.mark.parametrize("settings", [MeshSection, MembraneSection, SamplingSection, TetherSection, OutputSection])
def testNoMessageAllowsAZeroThatIsRefused(settings):
    name = settings.__name__.removesuffix("Section").lower()

    def messageOf(key, value):
        try:
            parse(**{name: {key: value}})
        except ValueError as error:
            return str(error)
        return ""

    for key in settings.model_fields:
        if "must be 0, or" in messageOf(key, 1e-300):
            assert "must" not in messageOf(key, 0.0)


# --- stages


@pytest.mark.parametrize(
    "stage, message",
    [
        ({"steps": 3}, f"stage 1 has no kind; it must be one of {', '.join(STAGES)}"),
        ({"kind": "aneal"}, "stage 1 has the kind 'aneal'; did you mean 'anneal'?"),
        ({"kind": "sample", "stepz": 3}, "stage 1 (sample) has no key 'stepz'; did you mean 'steps'?"),
        (
            {"kind": "sample", "flip_fraction": 3},
            "stage 1 (sample) has no key 'flip_fraction'; it belongs in [sampling]",
        ),
        (
            {"kind": "minimize", "steps": 10},
            "stage 1 (minimize) has no key 'steps'; it belongs in a stage of kind sample, approach, anneal or "
            "continue; minimize has fluid, max_iterations, tolerance",
        ),
        (
            {"kind": "sample", "windows": 3},
            "stage 1 (sample) has no key 'windows'; it belongs in a stage of kind continue; sample has steps, "
            "temperature, step_size",
        ),
        (
            {"kind": "approach", "step_size": 0.1},
            "stage 1 (approach) has no key 'step_size'; it belongs in [sampling], or in a stage of kind sample",
        ),
        (
            {"kind": "minimize", "xyz": 3},
            "stage 1 (minimize) has no key 'xyz'; it has name, kind, fluid, max_iterations",
        ),
        ({"kind": "sample", "steps": 0}, "stage 1 (sample) steps is 0"),
        ({"kind": "sample", "reduced_volume": 1.1}, "stage 1 (sample) reduced_volume is 1.1"),
        ({"kind": "anneal"}, "stage 1 (anneal) end_temperature is missing; give it or a table"),
        ({"kind": "anneal", "end_temperature": 3, "rate": -1.0}, "stage 1 (anneal) rate is -1.0"),
        (
            {"kind": "anneal", "end_temperature": 600},
            "configuration: stage 1 (anneal) end_temperature is 600 K; it must be at most the temperature of "
            "[sampling], 300 K",
        ),
        (
            {"kind": "anneal", "start_temperature": 30, "end_temperature": 31},
            "stage 1 (anneal) end_temperature is 31 K; it must be at most the start_temperature, 30 K",
        ),
        (
            {"kind": "anneal", "end_temperature": 3, "cooling_start": 1000},
            "stage 1 (anneal) cooling_start is 1000; it must be less than the number of steps, 1000",
        ),
        (
            {"kind": "anneal", "end_temperature": 3, "table": [[0, 300]]},
            "stage 1 (anneal) table and end_temperature are both given",
        ),
        (
            {"kind": "anneal", "table": [[0, 300], [50, 30], [50, 3]]},
            "stage 1 (anneal) table has step 50 after step 50; steps must ascend",
        ),
        ({"kind": "anneal", "table": [[0, 300], [50, 0]]}, "stage 1 (anneal) table has the temperature 0 K at step 50"),
        (
            {"kind": "anneal", "table": [[0, 300, 1]]},
            "stage 1 (anneal) table has the row [0.0, 300.0, 1.0]; each must be [step, temperature]",
        ),
        (
            {"kind": "continue"},
            "stage 1 (continue) has no target to go to; give one of target_area, target_volume, reduced_volume, "
            "target_area_difference",
        ),
        ({"kind": "continue", "target_area": 9.0, "windows": 0}, "stage 1 (continue) windows is 0"),
        (
            {"kind": "continue", "target_area": 9.0, "windows": 2, "path": {"target_area": [0, 1]}},
            "path of target_area has 2 values; windows = 2 asks for 3",
        ),
        ({"kind": "anneal", "table": [[0, 300], [9, "x"]]}, "stage 1 (anneal) table[1][1] is 'x'; it must be a number"),
        (
            {"kind": "continue", "target_area": 9.0, "path": {"volume": [0, 1]}},
            "path has 'volume'; it must be a target that the stage gives: target_area",
        ),
    ],
)
def testWrongStages(stage, message):
    assert message in complaintOf(stages=[stage])


def testSectionsNamedForAKeyTakeIt():
    """What a message says of where a key of [sampling] belongs is no error there."""
    for kind, key in itertools.product(STAGES, SamplingSection.model_fields):
        if key not in STAGES[kind].model_fields:
            value = SamplingSection.model_fields[key].default
            goal = {"reduced_volume": 0.99, "end_temperature": 3} if kind == "anneal" else {"reduced_volume": 0.99}
            isNamed = "in [sampling]" in complaintOf(stages=[{"kind": kind, **goal, key: value}])
            assert isNamed == (key != "steps")
            if isNamed:
                stagesOf(parse(sampling={key: value}, stages=[{"kind": kind, **goal}]))


@pytest.mark.parametrize(
    "text, words",
    [
        ("[sampling]\nsteps = ten", "line 2, column 9): 'steps = ten'; lines are like [section], key = 20.5 and"),
        ("[membrane]\nbending_modulus = 20,5\n", "'bending_modulus = 20,5'; lines are like"),
        ('[output]\nprefix = "abc\n', """'prefix = "abc'; lines are like"""),
        ('{"mesh": {"icosphere": 2}}', """'{"mesh": {"icosphere": 2}}'; lines are like [section]"""),
        (
            "[mesh]\n\n[mesh]\n",
            "'[mesh]'; lines are like [section], key = 20.5 and key = \"text\", and each key stands once",
        ),
        ("[mesh", "not TOML"),
    ],
)
def testLinesThatAreNotTOML(tmp_path, text, words):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(ValueError) as error:
        readConfig(tmp_path / "a.toml")
    assert str(error.value).startswith(f"{tmp_path / 'a.toml'} is not TOML: ") and words in str(error.value)


@pytest.mark.parametrize("factor", [1e59, 1e-30])
def testMeshTooLargeOrSmallIsSaidToBe(tmp_path, factor):
    """The configuration's numbers, all defaults, are not."""
    mesh = mh.Mesh.icosphere(1)
    mh.Mesh(mesh.vertices * factor, mesh.triangles).write(tmp_path / "a.obj")
    (tmp_path / "a.toml").write_text('[mesh]\nfile = "a.obj"\n')
    length = f"{factor * mesh.edgeLengths.mean():.3g}"
    with pytest.raises(ValueError) as error:
        Scene.of(tmp_path / "a.toml")
    assert str(error.value).startswith(
        f"{tmp_path / 'a.toml'}: the edges of the mesh of {tmp_path / 'a.obj'} are {length} nm long on average; they "
        "must be from 1e-20 to 1e+20 nm"
    )


def testStepsAndStages():
    with pytest.raises(ValueError, match="stages have steps of their own"):
        stagesOf(parse(sampling={"steps": 10}, stages=[{"kind": "sample"}]))
    assert [stage.steps for stage in stagesOf(parse(sampling={"steps": 10}))] == [10]


# --- the tether


def tetherOf(scale, **tether):
    """Return the tether's energy in a configuration, of a sphere whose mesh is scaled, and the configuration with its
    defaults filled in.
    """
    config = parseConfig(
        {
            "mesh": {"icosphere": 2, "scale": scale},
            "tether": tether,
            "membrane": {f"{term}_modulus": 0.0 for term in ("bending", "area", "volume")},
        }
    )
    scene = Scene.of(config)
    return energyOf(scene.createSimulation(scene.createForce()).context), scene.config


@pytest.mark.parametrize("tether", [{}, {"modulus": 30.0, "length_scale": 0.31}, {"length_scale": 0.2}])
def testTetherHasNoUnit(tether):
    """By default, or if its lengths are scaled with it, the tether of a mesh that is scaled holds as much energy; what
    is written out says the same.
    """

    def scaled(factor):
        lengths = {
            "min_length": 0.3,
            "max_length": 0.31,
            **{name: length for name, length in tether.items() if name != "modulus"},
        }
        return tetherOf(factor, **{**tether, **{name: factor * length for name, length in lengths.items()}})

    (energy, first), (other, second) = scaled(1.0), scaled(0.07)
    assert energy > 1 and other == pytest.approx(energy, rel=1e-12)
    assert second.tether.length_scale == pytest.approx(
        0.07 * first.tether.length_scale
    ) and second.tether.modulus == pytest.approx(first.tether.modulus)
    assert second.sampling.step_size == pytest.approx(0.07 * first.sampling.step_size)
    assert tetherOf(0.07, **second.tether.model_dump())[0] == other


def testTetherWithAModulusMeansWhatItMeant():
    """Lengths are in the mesh's unit where a modulus is given, as in files from before there was a length scale."""
    assert tetherOf(1.0, modulus=3.0)[1].tether.length_scale == 1
    default = tetherOf(1.0)[1].tether
    assert default.length_scale == pytest.approx(
        loadMesh(parse()).edgeLengths.mean()
    ) and default.modulus == pytest.approx(50)
    assert tetherOf(1.0, length_scale=1.0)[1].tether.modulus == pytest.approx(default.modulus / default.length_scale**2)


def testUnevenMeshesStart(tmp_path):
    """By default, edges of a third to one and two thirds of the mean length come within the bounds, by trajectories
    that are accepted.
    """
    mesh = mh.Mesh.icosphere(2)
    vertices = mesh.vertices + 0.18 * mesh.edgeLengths.mean() * np.random.default_rng(1).normal(
        size=mesh.vertices.shape
    )
    mh.Mesh(vertices / np.linalg.norm(vertices, axis=1)[:, np.newaxis], mesh.triangles).write(tmp_path / "a.ply")
    config = parseConfig({"mesh": {"file": str(tmp_path / "a.ply")}, "sampling": {"seed": 1}})
    mesh = loadMesh(config)
    edges = mesh.edgeLengths / mesh.edgeLengths.mean()
    assert edges.min() < 0.4 and edges.max() > 1.5
    scene = Scene.of(config, mesh)
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    simulation.step(60)
    edges = currentMesh(simulation, force).edgeLengths / mesh.edgeLengths.mean()
    assert simulation.integrator.getAcceptanceRate() > 0.5 and edges.min() > 0.5 and edges.max() < 1.5


# --- files written


def testDefaultsWrittenOut():
    """The commented file has every key with its default, also in the stages when they are uncommented."""
    text = defaultText().replace("# file =", 'file = "a.stl"', 1)
    assert parseConfig(tomllib.loads(text)) == parseConfig({"mesh": {"file": "a.stl"}})
    start = text.index("# # " + next(iter(STAGES.values())).__doc__[:40])
    stages = "\n".join(line.removeprefix("# ") for line in text[start:].splitlines()).replace(
        "# end_temperature =", "end_temperature = 3.0"
    )
    for kind in ("approach", "continue"):
        stages = stages.replace(f'kind = "{kind}"', f'kind = "{kind}"\ntarget_area = 9.0')
    config = parseConfig(tomllib.loads(text[:start] + stages))
    assert [stage.kind for stage in config.stages] == list(STAGES)
    assert max(map(len, text.splitlines())) <= 122


def testSettingsReadBack():
    config = parse(
        sampling={"step_size": "auto", "seed": 3},
        output={"prefix": "a"},
        stages=[
            {"kind": "sample", "steps": 4},
            {"kind": "continue", "windows": 1, "target_area": 9.1, "path": {"target_area": [0.0, 1.0]}},
            {"kind": "anneal", "table": [[0, 300], [10, 30]]},
        ],
    )
    resolved = resolve(config, MeasuredMesh(loadMesh(config)))
    again = parseConfig(tomllib.loads(settingsText(resolved, ["a comment"])))
    assert again == resolved and resolved.membrane.target_area == loadMesh(config).area


# --- TriMem


def trimemText(mesh, case, kT, **values):
    """Return a configuration of TriMem for a membrane of the table of its energies, at another unit of energy."""
    targets = {
        "area_fraction": case["targets"]["area"] / case["area"],
        "volume_fraction": case["targets"]["volume"] / case["volume"],
        "curvature_fraction": case["targets"]["integratedMeanCurvature"] / case["integratedMeanCurvature"],
    }
    kappas = dict(zip(("kappa_b", "kappa_a", "kappa_v", "kappa_c", "kappa_t", "kappa_r"), case["moduli"].values()))
    bonds = {"bond_type": "Edge", "r": 2, "lc1": case["tether"]["minLength"], "lc0": case["tether"]["maxLength"]}
    repulsion = {"n_search": "cell-list", "rlist": 0.2, "lc1": case["repulsion"]["onset"], "r": 2, "exclusion_level": 2}
    sections = {
        "GENERAL": {"algorithm": "hmc", "input": mesh, "info": 5},
        "BONDS": bonds,
        "SURFACEREPULSION": repulsion,
        "ENERGY": {**kappas, **targets, "continuation_delta": 0.0, "continuation_lambda": 1.0},
        "MINIMIZATION": {"maxiter": 10, "out_every": 0},
        "HMC": {
            "num_steps": 100,
            "step_size": 1e-4,
            "traj_steps": 20,
            "momentum_variance": 2.0,
            "thin": 10,
            "flip_type": "parallel",
            "flip_ratio": 0.2,
            "initial_temperature": kT,
            "cooling_factor": 0.0,
        },
    }
    for name, value in values.items():
        next(section for section in sections.values() if name in section or section is sections["HMC"])[name] = value
    return "".join(
        f"[{name}]\n" + "".join(f"{key} = {value}  # a comment\n" for key, value in section.items())
        for name, section in sections.items()
    )


def convert(folder, case="sphere", kT=2.0, **values):
    """Convert a file of TriMem and return the Config that it becomes, and its text."""
    mh.Mesh(PEER[case]["vertices"], PEER[case]["triangles"]).write(folder / "cell.ply")
    (folder / "a.inp").write_text(trimemText(folder / "cell.ply", PEER[case], kT, **values))
    (folder / "a.toml").write_text(convertConfig(folder / "a.inp"))
    return readConfig(folder / "a.toml"), (folder / "a.toml").read_text()


def testSubdividedMesh(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    begun = {
        "mesh": {"icosphere": 1},
        "membrane": {"reduced_volume": 0.98},
        "sampling": {"steps": 20, "seed": 1},
        "output": {"prefix": "small"},
    }
    mh.run(begun)
    mesh = {"file": "small.ply", "subdivide": 2}
    begun["mesh"], begun["output"] = mesh, {"prefix": "large"}
    mh.run(begun)
    small, large = mh.Mesh.read("small.ply"), loadMesh(parseConfig({"mesh": mesh}))
    assert len(large.triangles) == 16 * len(small.triangles) == len(mh.Mesh.read("large.ply").triangles)
    assert (large.area, large.volume) == pytest.approx((small.area, small.volume), rel=1e-12)
    assert mh.resume("large", 5).steps == 25


def testSubdividedMeshThatTheMemoryDoesNotHold(tmp_path, monkeypatch):
    file = tmp_path / "small.ply"
    mh.Mesh.icosphere(2).write(file)
    monkeypatch.setattr(memory, "_freeMemory", lambda: 1e9)
    monkeypatch.setattr(mh.Mesh, "subdivided", lambda self, times: pytest.fail("it was subdivided") if times else self)
    expected = r"^\[mesh\] subdivide is 6: a run of 655362 vertices takes about 3.3 GB of memory"
    with pytest.raises(ValueError, match=expected):
        loadMesh(parseConfig({"mesh": {"file": str(file), "subdivide": 6}}))
    assert len(loadMesh(parseConfig({"mesh": {"file": str(file)}})).vertices) == 162


@pytest.mark.parametrize("subdivisions, default", [(1, 1e6), (4, 1e6), (5, 390 * 10242)])
def testModuliGrowWithTheLargestSurface(subdivisions, default):
    """The defaults only, and not where there is nothing to hold."""

    def moduliOf(mesh, **membrane):
        resolved = resolve(parseConfig({"mesh": {"icosphere": 1}, "membrane": membrane}), MeasuredMesh(mesh))
        return resolved.membrane.area_modulus, resolved.membrane.volume_modulus

    sphere, small = mh.Mesh.icosphere(subdivisions), mh.Mesh.icosphere(1)
    small.vertices[:, 0] += 5
    assert moduliOf(sphere) == moduliOf(together(small, sphere)) == (default, default)
    assert moduliOf(sphere, area_modulus=0.0) == (0, default)
    assert moduliOf(sphere, volume_modulus=2e6, area_modulus=1e6) == (1e6, 2e6)
    assert moduliOf(mh.Mesh.sheet(60, 60, 1.0)) == (0, 0)


@pytest.mark.parametrize("value", [0, 1.5, 7, "two"])
def testSubdividedNumberOfTheWrongKind(value):
    with pytest.raises(ValueError, match="subdivide"):
        parseConfig({"mesh": {"icosphere": 1, "subdivide": value}})


@pytest.mark.parametrize("case", PEER)
def testEnergiesOfTriMem(tmp_path, case):
    """The converted membrane has TriMem's energy and gradient, divided by its temperature."""
    config, _ = convert(tmp_path, case)
    config.sampling.approach = "none"  # the targets are TriMem's from the beginning
    mesh = loadMesh(config)
    scene = Scene.of(config, mesh)
    force = scene.createForce()
    context = scene.createSimulation(force).context
    kT = 300 * unit.kelvin * unit.MOLAR_GAS_CONSTANT_R / unit.kilojoule_per_mole
    assert energyOf(context) / kT == pytest.approx(PEER[case]["energy"] / 2, rel=1e-9)
    gradient = np.array(PEER[case]["gradient"]) / 2
    assert np.abs(forcesOf(context) / kT + gradient).max() < 1e-9 * np.abs(gradient).max()


def testStepsOfTriMem(tmp_path):
    """A free vertex with TriMem's thermal momentum goes as far in a step: sqrt(T/m) times the step size."""
    config, text = convert(tmp_path)
    sampling, kT = config.sampling, 300 * 0.00831446261815324
    assert sampling.step_size * np.sqrt(kT / sampling.mass) == pytest.approx(1e-4 * np.sqrt(2.0 / 2.0), rel=1e-12)
    assert (sampling.steps_per_trajectory, sampling.flip_fraction, sampling.flip_probability, sampling.temperature) == (
        20,
        0.2,
        0.5,
        300,
    )
    assert (config.output.trajectory_interval, config.output.observables_interval) == (10, 5)
    assert [(stage.kind, stage.steps) for stage in config.stages] == [("sample", 100)]
    assert "not needed: n_search, rlist" in text


def testStagesOfTriMem(tmp_path):
    config, _ = convert(tmp_path, cooling_factor=0.01, start_cooling=30)
    (stage,) = config.stages
    assert (stage.kind, stage.steps, stage.rate, stage.cooling_start) == (
        "anneal",
        100,
        0.01,
        30,
    ) and stage.end_temperature == pytest.approx(3e-4)
    config, text = convert(tmp_path, continuation_delta=0.025, continuation_lambda=0.0)
    move, sample = config.stages
    own, targets = PEER["sphere"], PEER["sphere"]["targets"]
    assert (move.kind, move.windows, move.totalSteps, sample.steps) == (
        "continue",
        19,
        40,
        60,
    ) and "lambda moves in 19 windows" in text
    assert (config.membrane.target_area, config.membrane.target_volume) == pytest.approx(
        (own["area"], own["volume"]), rel=1e-9
    )
    assert (move.target_area, move.target_volume) == pytest.approx((targets["area"], targets["volume"]), rel=1e-9)
    config, _ = convert(tmp_path, algorithm="minimize", maxiter=7)
    (stage,) = config.stages
    assert (stage.kind, stage.fluid, stage.max_iterations) == ("minimize", False, 7)
    config, text = convert(tmp_path, flip_type="none", kappa_d=3)
    assert config.sampling.flip_fraction == 0 and "Unknown, and left out: [HMC] kappa_d" in text


@pytest.mark.parametrize(
    "values, message",
    [
        ({"bond_type": "Area"}, "only tethers of edges"),
        ({"kappa_b": "x"}, r"\[ENERGY\] kappa_b is 'x'; it must be a number"),
        ({"initial_temperature": 0}, r"\[HMC\] initial_temperature is 0; it must be a number from 1e-30 to 1e\+30"),
        ({"input": "no.stl"}, "no mesh file no.stl"),
        ({"num_steps": 0}, r"\[HMC\] num_steps is 0; it must be a whole number from 1 to 1e\+15"),
        ({"num_steps": -5}, r"\[HMC\] num_steps is -5; it must be a whole number from 1"),
        ({"num_steps": 1.5}, r"\[HMC\] num_steps is '1.5'; it must be a whole number from 1"),
        ({"algorithm": "minimize", "maxiter": 0}, r"\[MINIMIZATION\] maxiter is 0; it must be a whole number from 1"),
        ({"algorithm": "HMC"}, r"\[GENERAL\] algorithm is 'HMC'; it must be one of hmc, minimize"),
        ({"flip_type": "batch"}, r"\[HMC\] flip_type is 'batch'; it must be one of none, serial, parallel"),
        ({"bond_type": "edge"}, r"\[BONDS\] bond_type is 'edge'; it must be one of Edge, Area"),
        ({"n_search": "tree"}, r"\[SURFACEREPULSION\] n_search is 'tree'; it must be one of cell-list, verlet-list"),
        ({"exclusion_level": 3}, r"\[SURFACEREPULSION\] exclusion_level is 3; it must be a whole number from 0 to 2"),
        ({"flip_ratio": -0.1}, r"\[HMC\] flip_ratio is -0.1; it must be a number from 0"),
        ({"momentum_variance": 0}, r"\[HMC\] momentum_variance is 0; it must be a number from 1e-30"),
        ({"cooling_factor": -1}, r"\[HMC\] cooling_factor is -1; it must be a number from 0"),
        ({"area_fraction": 0}, r"\[ENERGY\] area_fraction is 0; it must be a number from 1e-30"),
        ({"kappa_r": -1}, r"\[ENERGY\] kappa_r is -1; it must be a number from 0"),
        ({"continuation_delta": -0.1}, r"\[ENERGY\] continuation_delta is -0.1; it must be a number from 0"),
        ({"lc0": 0.1, "lc1": 0.5}, r"\[BONDS\] lc1 is 0.5 and lc0 0.1; lc1 must be less"),
        ({"kappa_c": 1, "curvature_fraction": 0}, r"\[ENERGY\] curvature_fraction is 0; it must not be"),
        ({"kappa_b": 1e-30}, r"\[ENERGY\] kappa_b is 1e-30, here 5e-31; it must be 0, or from"),
    ],
)
def testWrongFilesOfTriMem(tmp_path, values, message):
    """What is wrong is said of TriMem's own key, after the name of the file."""
    with pytest.raises((ValueError, FileNotFoundError), match=message) as error:
        convert(tmp_path, **values)
    assert f"{tmp_path / 'a.inp'}" in str(error.value)


def testKeysOfTheOtherAlgorithmMayBeAnything(tmp_path):
    assert convert(tmp_path, algorithm="minimize", num_steps=0)[0].stages[0].kind == "minimize"
    assert convert(tmp_path, maxiter=0)[0].stages[0].kind == "sample"


@pytest.mark.parametrize("steps", [1, 2, 3, 20, 21, 22, 30, 43, 100])
@pytest.mark.parametrize("delta", [0.001, 0.3, 2.0])
def testStepsOfAContinuationAddUp(tmp_path, steps, delta):
    """They are num_steps, and nearly all of those in which TriMem's lambda moves are in windows."""
    config, _ = convert(tmp_path, num_steps=steps, continuation_delta=delta, continuation_lambda=0.0)
    assert sum(stage.totalSteps for stage in config.stages) == steps
    path = [stage for stage in config.stages if stage.kind == "continue"]
    assert len(path) == (steps > 1)
    for stage in path:
        moving, own = min(int(np.ceil(1 / delta)), steps), PEER["sphere"]
        assert stage.windows <= 20 and abs(stage.totalSteps - moving) <= max(1, moving // 11)
        reached = min(1.0, moving * delta)
        target = (1 - reached) * own["area"] + reached * own["targets"]["area"]
        assert stage.target_area == pytest.approx(target, rel=1e-9)


def testContinuationOfSeveralSurfaces(tmp_path):
    """Each surface has a target of its own at the end of the path, too."""
    spheres = together(
        mh.Mesh.icosphere(1), mh.Mesh(3 + 2 * mh.Mesh.icosphere(1).vertices, mh.Mesh.icosphere(1).triangles)
    )
    spheres.write(tmp_path / "two.ply")
    config, _ = convert(
        tmp_path,
        input=tmp_path / "two.ply",
        kappa_c=0,
        continuation_delta=0.1,
        continuation_lambda=0.0,
        area_fraction=0.9,
    )
    areas = [surface.area for surface in spheres.components()]
    assert config.membrane.target_area == pytest.approx(areas)
    assert config.stages[0].target_area == pytest.approx([0.9 * area for area in areas])


def testUnknownSectionsOfTriMemAreSaid(tmp_path):
    """TriMem tells capitals from small letters in names of sections."""
    (tmp_path / "a.inp").write_text(f"[GENERAL]\ninput = {tmp_path / 'a.stl'}\n[ENERGY]\n[hmc]\nnum_steps = 3\n")
    mh.Mesh.icosphere(1).write(tmp_path / "a.stl")
    told = "Unknown, and left out: [hmc] num_steps (did you mean [HMC] num_steps?)."
    assert told in convertConfig(tmp_path / "a.inp")


def testNoFileOfTriMem(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no configuration file"):
        convertConfig(tmp_path / "a.inp")
    (tmp_path / "a.inp").write_text("kappa_b = 3\n")
    with pytest.raises(ValueError, match=r"a.inp is not a configuration of TriMem"):
        convertConfig(tmp_path / "a.inp")


def testNumbersOfNumPyTuplesAndPaths():
    """A dict may have what scripts have, and means what a file with the same text means."""
    script = {
        "mesh": {"icosphere": np.int64(1)},
        "membrane": {"reduced_volume": np.float32(0.5), "target_area": np.array([12.0])},
        "system": {"fixed": (np.int32(1), 2), "forces": [Path("a.xml")]},
        "sampling": {"steps": np.int64(7), "seed": np.uint8(3)},
        "output": {"prefix": Path("results") / "cell", "overwrite": np.True_},
    }
    file = {
        "mesh": {"icosphere": 1},
        "membrane": {"reduced_volume": 0.5, "target_area": [12.0]},
        "system": {"fixed": [1, 2], "forces": ["a.xml"]},
        "sampling": {"steps": 7, "seed": 3},
        "output": {"prefix": str(Path("results/cell")), "overwrite": True},
    }
    assert parseConfig(script) == parseConfig(file)
    with pytest.raises(ValueError, match=r"steps is 7\.5; it must be a whole number"):
        parseConfig({"mesh": {"icosphere": 1}, "sampling": {"steps": np.float64(7.5)}})
