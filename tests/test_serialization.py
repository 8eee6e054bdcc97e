"""XML, copies and pickles of Systems, integrators and States with membranes."""

import copy
import os
import pickle
import re
import subprocess
import sys

import numpy as np
import openmm as mm
import pytest

import openmmhelfrich as mh
from test_wrapper import CORNERS, OCTAHEDRON, contextOf, octahedronForce


def completeForce():
    force = octahedronForce()
    force.setName('a "membrane" & more')
    force.setForceGroup(5)
    force.setAreaModulus(0.1)
    force.setTargetArea(1 / 3)
    force.setVolumeModulus(0.2)
    force.setTargetVolume(2 / 3)
    force.setAreaDifferenceModulus(0.3)
    force.setTargetAreaDifference(-4 / 3)
    force.setLeafletSeparation(3.5)
    force.setTether(0.4, 0.5, 1.5, 3)
    force.setTetherLengthScale(0.7)
    force.setRepulsion(0.6, 0.35, 4, 2)
    force.setRepulsionLengthScale(0.9)
    force.setTension(-0.8)
    force.setPressure(0.9)
    force.addFixedEdge(2, 0)
    return force


def forceOfSurfaces():
    force = completeForce()
    force.setTargetArea(1 / 7, surface=0)
    force.setTargetVolume(2 / 7, surface=0)
    force.setTargetAreaDifference(-3 / 7, surface=0)
    return force


def hybridIntegrator(engine="native"):
    integrator = mh.HybridMonteCarloIntegrator(310.5, 0.003, 42, 0.2, 0.3, engine)
    if engine == "native":
        integrator.setSplitting("bcss2")
        integrator.setTrajectoryJitter(0.25)
    integrator.setRandomNumberSeed(17)
    return integrator


def otherIntegrator():
    return mh.HybridMonteCarloIntegrator(
        mm.LangevinMiddleIntegrator(300, 1, 0.002), mh.EdgeFlipIntegrator(290, 0.5), 0.7
    )


def waveIntegrator():
    waves = mh.ShearWaveIntegrator(300.1, 0.015, 1 / 3, 2.5, 17)
    waves.setRandomNumberSeed(8)
    return waves


def integratorWithWaves():
    integrator = hybridIntegrator()
    integrator.addShearWaves(waveIntegrator(), 0.25)
    return integrator


MAKERS = [
    completeForce,
    forceOfSurfaces,
    mh.HelfrichForce,
    lambda: mh.EdgeFlipIntegrator(300.1, 0.15),
    lambda: mh.HamiltonianTrajectoryIntegrator(300.1, 0.02, 11),
    hybridIntegrator,
    lambda: hybridIntegrator("custom"),
    otherIntegrator,
    waveIntegrator,
    integratorWithWaves,
]


def properties(object):
    """All that the getters of an object return."""
    getters = [name for name in dir(object) if name.startswith("get")]
    result = {}
    for name in getters:
        try:
            value = getattr(object, name)()
        except (TypeError, mm.OpenMMException):  # it has arguments, or nothing to return
            continue
        if not isinstance(value, mm.Integrator):
            result[name] = value.tolist() if isinstance(value, np.ndarray) else value
    return result


def throughXml(object):
    return type(object).cast(mm.XmlSerializer.deserialize(mm.XmlSerializer.serialize(object)))


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize(
    "copied", [throughXml, copy.copy, copy.deepcopy, lambda object: pickle.loads(pickle.dumps(object))]
)
def test_copies_are_equal_and_independent(make, copied):
    original = make()
    xml = mm.XmlSerializer.serialize(original)
    duplicate = copied(original)
    assert type(duplicate) is type(original)
    assert properties(duplicate) == properties(original)
    assert mm.XmlSerializer.serialize(duplicate) == xml
    if isinstance(original, mm.Force):
        duplicate.setBendingModulus(99)
        duplicate.setTriangles([])
    else:
        duplicate.setTemperature(99)
    assert mm.XmlSerializer.serialize(original) == xml


def test_copies_keep_subclass_and_attributes():
    class NamedForce(mh.HelfrichForce):
        pass

    force = NamedForce()
    force.notes = ["vesicle"]
    duplicate = copy.deepcopy(force)
    assert type(duplicate) is NamedForce
    assert duplicate.notes == ["vesicle"] and duplicate.notes is not force.notes


def test_system_round_trip_keeps_the_energy():
    force = completeForce()
    context = contextOf(force)
    system = mm.XmlSerializer.deserialize(mm.XmlSerializer.serialize(context.getSystem()))
    again = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference"))
    again.setPositions(CORNERS)
    assert again.getState(energy=True).getPotentialEnergy() == context.getState(energy=True).getPotentialEnergy()
    copied = copy.deepcopy(system)
    assert mh.HelfrichForce.cast(copied.getForce(0)).getTriangles().tolist() == OCTAHEDRON


def test_xml_needs_nothing_but_openmm(tmp_path):
    system = mm.System()
    system.addForce(completeForce())
    (tmp_path / "system.xml").write_text(mm.XmlSerializer.serialize(system))
    (tmp_path / "integrator.xml").write_text(mm.XmlSerializer.serialize(hybridIntegrator()))
    program = (
        "import openmm as mm\n"
        'system = mm.XmlSerializer.deserialize(open("system.xml").read())\n'
        'integrator = mm.XmlSerializer.deserialize(open("integrator.xml").read())\n'
        "print(system.getForce(0).getName(), integrator.getStepSize())\n"
    )
    output = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert output.strip() == 'a "membrane" & more 0.003 ps'


def test_kernels_load_where_openmm_looks_elsewhere(tmp_path):
    program = (
        "import openmmhelfrich as mh, openmm as mm\n"
        'print(mm.Platform.getPlatform("Reference").supportsKernels(["CalcHelfrichForce"]))'
    )
    environment = dict(os.environ, OPENMM_PLUGIN_DIR=str(tmp_path))
    output = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert output.strip() == "True"


def test_triangles_are_one_text():
    force = completeForce()
    xml = mm.XmlSerializer.serialize(force)
    assert " ".join(map(str, np.ravel(OCTAHEDRON))) in xml
    assert len(xml.splitlines()) < 10


def test_many_triangles():
    triangles = np.arange(600_000, dtype=np.int32).reshape(-1, 3)
    force = mh.HelfrichForce()
    force.setTriangles(triangles)
    assert np.array_equal(throughXml(force).getTriangles(), triangles)


@pytest.mark.parametrize(
    "make, versions",
    [
        (forceOfSurfaces, "1 to 7"),
        (completeForce, "1 to 7"),
        (lambda: mh.EdgeFlipIntegrator(300, 0.1), "1"),
        (lambda: mh.HamiltonianTrajectoryIntegrator(300, 0.1), "1"),
        (hybridIntegrator, "1 to 2"),
    ],
)
def test_other_versions_are_refused(make, versions):
    original = make()
    lines = mm.XmlSerializer.serialize(original).splitlines()
    lines[1] = re.sub(r'version="\d"', 'version="9"', lines[1])
    with pytest.raises(
        mm.OpenMMException, match=type(original).__name__ + ": unsupported version 9.*reads version " + versions
    ):
        mm.XmlSerializer.deserialize("\n".join(lines))


@pytest.mark.parametrize(
    "damage, problem",
    [
        (lambda text: text.replace("0 2 4 2 1 4", "0 2 4 2 1"), "not complete"),
        (lambda text: text.replace("0 2 4", "0 x 4"), "something else than an integer"),
        (lambda text: text.replace("0 2 4", "0 2.0 4"), "something else than an integer"),
        (lambda text: text.replace("0 2 4", "0 99999999999 4"), "something else than an integer"),
        (lambda text: text.replace("particles=", "corners="), "particles"),
        (lambda text: text.replace("<Repulsion", "<Attraction"), "Repulsion"),
        (lambda text: text.replace('areaModulus="', 'areaModulus="-'), "odulus"),
    ],
)
def test_damaged_xml_is_refused(damage, problem):
    xml = mm.XmlSerializer.serialize(completeForce())
    damaged = damage(xml)
    assert damaged != xml
    with pytest.raises(mm.OpenMMException, match=problem):
        mm.XmlSerializer.deserialize(damaged)
