"""Energies and forces against independent numbers, and the platforms against each other."""

import csv
import json
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
from membranes import (
    PLATFORMS,
    TERMS,
    TERMS_OF_SPECIES,
    createBlob,
    createContext,
    createForce,
    energyOf,
    forcesOf,
    termsOf,
)

DATA = Path(__file__).parent / "data"
PEER = {case["name"]: case for case in json.loads((DATA / "peer_values.json").read_text())["cases"]}


def readTable(name):
    with open(DATA / name) as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("subdivisions, row", list(enumerate(readTable("icosphere.csv"), start=2)))
def test_icosphere(platform, subdivisions, row):
    mesh = mh.Mesh.icosphere(subdivisions)
    assert len(mesh.vertices) == int(row["vertices"])
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(1 / (8 * np.pi))
    context = createContext(mesh, force, platform)
    geometry = force.getGeometryInContext(context)
    assert energyOf(context) == pytest.approx(float(row["energy_over_8pi"]), rel=1e-5)
    assert geometry.area / unit.nanometer**2 == pytest.approx(4 * np.pi * float(row["area_over_4pi"]), rel=1e-5)
    assert geometry.volume / unit.nanometer**3 == pytest.approx(
        4 * np.pi / 3 * float(row["volume_over_4pi_3"]), rel=1e-5
    )
    assert geometry.integratedMeanCurvature / unit.nanometer == pytest.approx(
        4 * np.pi * float(row["curvature_over_4pi"]), rel=1e-5
    )


def createPeerForce(case, terms=TERMS):
    mesh = mh.Mesh(case["vertices"], case["triangles"])
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    moduli = {term: modulus if term in terms else 0 for term, modulus in case["moduli"].items()}
    tether, repulsion, targets = case["tether"], case["repulsion"], case["targets"]
    force.setBendingModulus(moduli["bending"])
    force.setAreaModulus(moduli["area"])
    force.setTargetArea(targets["area"])
    force.setVolumeModulus(moduli["volume"])
    force.setTargetVolume(targets["volume"])
    force.setAreaDifferenceModulus(moduli["areaDifference"])
    force.setTargetAreaDifference(2 * targets["integratedMeanCurvature"])
    force.setTether(moduli["tether"], tether["minLength"], tether["maxLength"], tether["exponent"])
    force.setRepulsion(moduli["repulsion"], repulsion["onset"], repulsion["exponent"], repulsion["exclusionLevel"])
    return mesh, force


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("case", PEER.values(), ids=PEER.keys())
def test_peer_values(platform, case):
    mesh, force = createPeerForce(case)
    context = createContext(mesh, force, platform)
    terms, geometry = termsOf(force, context), force.getGeometryInContext(context)
    assert geometry.area / unit.nanometer**2 == pytest.approx(case["area"], rel=1e-9)
    assert geometry.volume / unit.nanometer**3 == pytest.approx(case["volume"], rel=1e-9)
    assert geometry.integratedMeanCurvature / unit.nanometer == pytest.approx(case["integratedMeanCurvature"], rel=1e-9)
    for term in ("bending", "tether", "repulsion"):
        assert terms[term] == pytest.approx(case["moduli"][term] * case[term + "OverKappa"], rel=1e-9)
    assert energyOf(context) == pytest.approx(case["energy"], rel=1e-9)
    gradient = np.array(case["gradient"])
    assert np.abs(forcesOf(context) + gradient).max() < 1e-9 * np.abs(gradient).max()


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("terms", [[term] for term in TERMS] + [TERMS], ids=[*TERMS, "all"])
def test_central_differences(platform, terms):
    mesh = createBlob(1)
    context = createContext(mesh, createForce(mesh, terms), platform)
    forces = forcesOf(context)
    h = 2e-5

    def energyAt(i, d, distance):
        x = mesh.vertices.copy()
        x[i, d] += distance
        context.setPositions(x)
        return energyOf(context)

    numeric = [
        [
            (8 * (energyAt(i, d, h) - energyAt(i, d, -h)) - energyAt(i, d, 2 * h) + energyAt(i, d, -2 * h)) / (12 * h)
            for d in range(3)
        ]
        for i in range(len(mesh.vertices))
    ]
    assert np.abs(forces).max() > 1
    assert np.abs(forces + numeric).max() < 1e-6 * np.abs(forces).max()


@pytest.mark.parametrize(
    "terms, exclusionLevel", [([term], 1) for term in TERMS] + [(TERMS, level) for level in (0, 1, 2)]
)
@pytest.mark.parametrize(
    "mesh", [createBlob(1), createBlob(3), createBlob(4)], ids=lambda mesh: str(len(mesh.vertices))
)
def test_platforms_agree(terms, exclusionLevel, mesh):
    reference, cpu = (createContext(mesh, createForce(mesh, terms, exclusionLevel), platform) for platform in PLATFORMS)
    assert energyOf(cpu) == pytest.approx(energyOf(reference), rel=1e-10)
    expected = forcesOf(reference)
    assert np.abs(forcesOf(cpu) - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("instructions", ["Baseline", "AVX2", "AVX512"])
def test_instruction_sets_agree(instructions, monkeypatch):
    mesh = createBlob(3)
    monkeypatch.setenv("OPENMM_HELFRICH_SIMD", instructions)
    try:
        cpu = createContext(mesh, createForce(mesh), "CPU")
    except mm.OpenMMException as error:
        assert instructions != "Baseline" and "Baseline" in str(error)
        pytest.skip(str(error))
    reference = createContext(mesh, createForce(mesh), "Reference")
    assert energyOf(cpu) == pytest.approx(energyOf(reference), rel=1e-10)
    expected = forcesOf(reference)
    assert np.abs(forcesOf(cpu) - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("exclusionLevel", [0, 1, 2])
def test_threads_agree_exactly(exclusionLevel):
    mesh = createBlob(4)
    serial, *parallel = (
        createContext(mesh, createForce(mesh, TERMS, exclusionLevel), "CPU", properties={"Threads": threads})
        for threads in ("1", "2", "4", "5")
    )
    for context in parallel:
        assert energyOf(context) == energyOf(serial)
        assert np.array_equal(forcesOf(context), forcesOf(serial))


@pytest.mark.parametrize("platform", PLATFORMS)
def test_terms_add_up(platform):
    mesh = createBlob(2)
    force = createForce(mesh)
    context = createContext(mesh, force, platform)
    terms = termsOf(force, context)
    assert list(terms) == [*TERMS, *TERMS_OF_SPECIES]
    assert all(terms.pop(name) == 0 for name in TERMS_OF_SPECIES)  # test_species.py has them
    assert all(energy > 1 for energy in terms.values())
    assert sum(terms.values()) == pytest.approx(energyOf(context), rel=1e-15)
    for term in TERMS:
        alone = createForce(mesh, [term])
        context = createContext(mesh, alone, platform)
        assert termsOf(alone, context) == pytest.approx(
            {name: terms[name] if name == term else 0 for name in (*TERMS, *TERMS_OF_SPECIES)}, rel=1e-13
        )


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_term_that_is_off_needs_no_target(platform):
    mesh = createBlob(2)
    force = createForce(mesh, ["bending"])
    context = createContext(mesh, force, platform)
    assert context.getParameter(force.getTargetVolumeParameter()) == 0
    assert energyOf(context) == termsOf(force, context)["bending"]


@pytest.mark.parametrize("platform", PLATFORMS)
def test_continuation(platform):
    """Targets change in a live Context, from one value to another by way of all between."""
    mesh = createBlob(2)
    force = createForce(mesh, ["volume"])
    context = createContext(mesh, force, platform)
    start, end = 1.3 * mesh.volume, 0.8 * mesh.volume
    for progress in np.linspace(0, 1, 5):
        target = progress * end + (1 - progress) * start
        context.setParameter(force.getTargetVolumeParameter(), target)
        assert energyOf(context) == pytest.approx(2000 * (mesh.volume / target - 1) ** 2, rel=1e-12)
