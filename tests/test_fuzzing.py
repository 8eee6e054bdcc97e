"""Files and texts that are damaged: errors, never a crash, a hang or a simulation that cannot go on.

The C++ side of this is tests/fuzz.
"""

import contextlib
import math
import zipfile
from xml.etree import ElementTree

import numpy as np
import openmm as mm
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import openmmhelfrich as mh
from membranes import PLATFORMS, createBlob, createContext, createForce, energyOf
from openmmhelfrich.runs.checkpoint import loadRunState, loadSimulation
from openmmhelfrich.runs.config import parseConfig, readConfig
from openmmhelfrich.runs.configfile import defaultText
from openmmhelfrich.runs.studies import run

few = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
numbers = st.one_of(
    st.integers().map(str),
    st.floats().map(repr),
    st.sampled_from(["", " ", "nan", "-inf", "1e999", "0x10", "1 2 3", "--1", "9" * 40, "true"]),
)
values = st.one_of(numbers, st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), max_size=20))


def damage(data, content):
    """Return bytes with some changed, or without their end, but not as they were."""
    edited = bytearray(content)
    for _ in range(data.draw(st.integers(0, 4))):
        edited[data.draw(st.integers(0, len(edited) - 1))] = data.draw(st.integers(0, 255))
    if edited == content:
        del edited[data.draw(st.integers(0, len(edited) - 1)) :]
    return bytes(edited)


def damageNode(data, root):
    """Change an attribute of an XML node or of one below it, or remove such a node."""
    nodes = list(root.iter())
    node = data.draw(st.sampled_from(nodes))
    if len(node) and data.draw(st.integers(0, 3)) == 0:
        node.remove(data.draw(st.sampled_from(list(node))))
    elif node.attrib:
        name = data.draw(st.sampled_from(sorted(node.attrib)))
        whole, start = node.attrib[name], data.draw(st.integers(0, len(node.attrib[name])))
        node.attrib[name] = data.draw(
            st.one_of(values, numbers.map(lambda text: whole[:start] + text + whole[start + len(text) :]))
        )


def assertGoesOn(context):
    assert math.isfinite(energyOf(context))
    context.getIntegrator().step(2)
    assert math.isfinite(energyOf(context))


def createHybrid():
    integrator = mh.HybridMonteCarloIntegrator(300, 1e-4, 2, 0.5, 0.5)
    integrator.setRandomNumberSeed(1)
    return integrator


def createRunningContext(platform):
    mesh = createBlob(1)
    context = createContext(mesh, createForce(mesh), platform, createHybrid())
    context.getIntegrator().step(3)
    return context


@given(data=st.data())
@few
def testXmlOfSystems(data):
    mesh = createBlob(1)
    force = createForce(mesh)
    force.addFixedEdge(*mesh.edges[0].tolist())
    system = mesh.createSystem()
    system.addForce(force)
    root = ElementTree.fromstring(mm.XmlSerializer.serialize(system))
    damageNode(data, next(root.iter("Force")))
    try:
        system = mm.XmlSerializer.deserialize(ElementTree.tostring(root, encoding="unicode"))
        context = mm.Context(system, createHybrid(), mm.Platform.getPlatform("Reference"))
        context.setPositions(mesh.vertices)
        energy = energyOf(context)
    except mm.OpenMMException:
        return
    assert math.isfinite(energy)
    assertGoesOn(context)


@pytest.mark.parametrize("platform", PLATFORMS)
@given(data=st.data())
@few
def testXmlOfStates(platform, data):
    context = createRunningContext(platform)
    state = context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    root = ElementTree.fromstring(mm.XmlSerializer.serialize(state))
    damageNode(data, root.find("IntegratorParameters"))
    with contextlib.suppress(mm.OpenMMException):
        context.setState(mm.XmlSerializer.deserialize(ElementTree.tostring(root, encoding="unicode")))
    assertGoesOn(context)


@pytest.mark.parametrize("platform", PLATFORMS)
@given(data=st.data())
@few
def testCheckpoints(platform, data):
    """What OpenMM writes before it, and reads without looking, is left alone: only the integrators' part is damaged."""
    context = createRunningContext(platform)
    checkpoint = context.createCheckpoint()
    ours = 80 + 3 * 4 * 80 + 4 * 42
    with contextlib.suppress(mm.OpenMMException):
        context.loadCheckpoint(checkpoint[:-ours] + damage(data, checkpoint[-ours:]))
    assertGoesOn(context)


@given(data=st.data())
@few
def testCheckpointsWithoutTheirEnd(data):
    context = createRunningContext("Reference")
    checkpoint = context.createCheckpoint()
    with pytest.raises(mm.OpenMMException):
        context.loadCheckpoint(checkpoint[: data.draw(st.integers(0, len(checkpoint) - 1))])
    context.loadCheckpoint(checkpoint)
    assertGoesOn(context)


@pytest.fixture(scope="module")
def checkpointOfARun(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("fuzzed") / "a"
    run(
        parseConfig(
            {
                "mesh": {"icosphere": 1},
                "platform": {"threads": 1},
                "sampling": {"steps": 4, "seed": 1, "step_size": 1e-4},
                "output": {"prefix": str(prefix)},
            }
        )
    )
    return (prefix.parent / "a.checkpoint").read_bytes()


@given(data=st.data())
@few
def testCheckpointsOfRuns(tmp_path, checkpointOfARun, data):
    file = tmp_path / "b.checkpoint"
    file.write_bytes(damage(data, checkpointOfARun))
    try:
        state = loadRunState(file)
        simulation, _ = loadSimulation(file, mm.Platform.getPlatform("Reference"), {})
    except ValueError as error:
        assert "b.checkpoint is " in str(error)
        return
    # What was damaged is of no account, as times of files in an archive are.
    assert state.step == simulation.currentStep == 4


@given(
    text=st.one_of(
        st.text(max_size=40),
        st.dictionaries(st.text(max_size=8), st.integers()).map(repr),
        st.sampled_from(["[]", "null", '{"format": 1}', '{"format": 2}']),
    )
)
@few
def testRunStatesOfOtherContent(tmp_path, text):
    file = tmp_path / "b.checkpoint"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("run.json", text)
    with pytest.raises(ValueError, match=r"b.checkpoint is (not )?a checkpoint of"):
        loadRunState(file)


DEFAULTS = [line for line in defaultText().splitlines() if not line.startswith("# ") or "=" in line]


@given(data=st.data())
@settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def testConfigurations(tmp_path, data):
    lines = [line.removeprefix("# ") for line in DEFAULTS]
    keys = [i for i, line in enumerate(lines) if " =" in line]
    literals = st.one_of(
        st.integers(),
        st.floats(),
        st.booleans(),
        st.lists(st.integers(), max_size=3),
        st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=8),
    )
    for i in data.draw(st.lists(st.sampled_from(keys), min_size=1, max_size=3)):
        value = data.draw(
            st.one_of(
                literals.map(lambda literal: str(literal).lower() if isinstance(literal, bool) else repr(literal)),
                values,
            )
        )
        lines[i] = f"{lines[i].split(' =')[0]} = {value}"
    kept = [line for line in lines if not line.rstrip().endswith("=")]
    file = tmp_path / "a.toml"
    file.write_text("\n".join(kept), encoding="utf-8")
    try:
        readConfig(file)
    except ValueError as error:
        assert str(error)


def testMeshTooLarge():
    mesh = mh.Mesh.icosphere(1)
    mesh.vertices[3, 1] = 1e200
    with pytest.raises(ValueError, match=r"vertex 3 is .*; every coordinate must be a number from -1e\+60 to 1e\+60"):
        mesh.check()


@pytest.mark.parametrize(
    "text",
    ["a = " + "[" * 100000, "[" * 100000, '"' * 3 + "a" * 10, "a = 1\na = 2", "\ufeff[mesh]", "[mesh]\nfile = 1e999"],
)
def testConfigurationsOfOtherShapes(tmp_path, text):
    file = tmp_path / "a.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"a.toml"):
        readConfig(file)


@given(data=st.data())
@settings(max_examples=120, deadline=None, derandomize=True)
def testDamagedMeshes(tmp_path_factory, data):
    file = (
        tmp_path_factory.mktemp("mesh")
        / f"a.{data.draw(st.sampled_from(['stl', 'ply', 'obj', 'off', 'vtu', 'vtk', 'msh']))}"
    )
    whole = mh.Mesh.icosphere(1)
    whole.write(file)
    file.write_bytes(damage(data, file.read_bytes()))
    try:
        mesh = mh.Mesh.read(file)
        mesh.check()
    except ValueError as error:
        assert str(error)
        return
    # A digit of a coordinate may have changed: what is left is a surface.
    assert mesh.volume > 0 and np.all(np.isfinite(mesh.vertices))
