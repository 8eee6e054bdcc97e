"""Files that version 0.1.0 wrote are read, and simulations go on from them as they would have gone on then: see
data/0.1.0/README.md.
"""

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
from membranes import PLATFORMS

FOLDER = Path(__file__).resolve().parent / "data" / "0.1.0"
TERMS = ["bending", "area", "volume", "areaDifference", "tether", "repulsion"]
STEPS = 16  # from the files to what they are compared with
CLASSES = {
    "flips": mh.EdgeFlipIntegrator,
    "trajectories": mh.HamiltonianTrajectoryIntegrator,
    "mixed": mh.HamiltonianTrajectoryIntegrator,
    "waves": mh.ShearWaveIntegrator,
    "native": mh.HybridMonteCarloIntegrator,
    "native_waves": mh.HybridMonteCarloIntegrator,
    "custom": mh.HybridMonteCarloIntegrator,
    "langevin": mh.HybridMonteCarloIntegrator,
    "compound": mm.CompoundIntegrator,
    "two_membranes": mh.HybridMonteCarloIntegrator,
}
PROPERTIES = {
    "flips": {"Temperature": 320, "Fraction": 0.3, "RandomNumberSeed": 7},
    "trajectories": {
        "Temperature": 310,
        "StepSize": 0.012,
        "StepsPerTrajectory": 6,
        "ForcePrecision": "double",
        "Splitting": "bcss3",
        "TetherSubsteps": 2,
        "TrajectoryJitter": 0.5,
        "MomentumRefreshment": 0.6,
        "RandomNumberSeed": 7,
    },
    "mixed": {"Temperature": 300, "StepSize": 0.01, "ForcePrecision": "mixed", "Splitting": "leapfrog"},
    "waves": {
        "Temperature": 305,
        "Amplitude": 0.3,
        "MinWaveNumber": 0.4,
        "MaxWaveNumber": 1.2,
        "MovesPerStep": 3,
        "RandomNumberSeed": 7,
    },
    "native": {
        "Temperature": 300,
        "StepSize": 0.015,
        "StepsPerTrajectory": 6,
        "FlipFraction": 0.3,
        "FlipProbability": 0.4,
        "RandomNumberSeed": 7,
    },
    "native_waves": {"Temperature": 310, "StepSize": 0.012, "StepsPerTrajectory": 6, "FlipProbability": 0.4},
    "custom": {
        "Temperature": 300,
        "StepSize": 0.01,
        "StepsPerTrajectory": 5,
        "FlipFraction": 0.3,
        "FlipProbability": 0.4,
        "RandomNumberSeed": 7,
    },
    "langevin": {"Temperature": 300, "StepSize": 0.002, "FlipFraction": 1, "FlipProbability": 0.4},
    "two_membranes": {"Temperature": 310, "StepSize": 0.012, "StepsPerTrajectory": 6, "FlipProbability": 0.4},
}


def plain(value):
    """Return what a Quantity holds, with no conversion that could round it."""
    return value.value_in_unit(value.unit) if unit.is_quantity(value) else value


def load(scene, part):
    """Return the System or the integrator of a scene, as objects of their own classes."""
    item = mm.XmlSerializer.deserialize((FOLDER / f"{scene}.{part}.xml").read_text())
    return CLASSES[scene].cast(item) if part == "integrator" and hasattr(CLASSES[scene], "cast") else item


def membranesOf(system):
    return [mh.HelfrichForce.cast(force) for force in system.getForces() if mh.HelfrichForce.isinstance(force)]


def createContext(scene, platform):
    """Return a Context of the XML of a scene, its integrator and its HelfrichForces."""
    system, integrator = load(scene, "system"), load(scene, "integrator")
    properties = {"Threads": "1"} if platform == "CPU" else {}
    context = mm.Context(system, integrator, mm.Platform.getPlatformByName(platform), properties)
    return context, integrator, membranesOf(context.getSystem())


def restore(context, name, form):
    if form == "checkpoint":
        context.loadCheckpoint((FOLDER / f"{name}.checkpoint").read_bytes())
    else:
        context.setState(mm.XmlSerializer.deserialize((FOLDER / f"{name}.state.xml").read_text()))


def advance(scene, integrator, steps):
    """Make steps, with OpenMM's CompoundIntegrator in turns of its two integrators."""
    if scene != "compound":
        integrator.step(steps)
        return
    for i in range(steps):
        integrator.setCurrentIntegrator(i % 2)
        integrator.step(1)


def countersOf(integrator):
    """Return the numbers of moves, or their ratios, that an integrator tells."""
    if isinstance(integrator, mm.CompoundIntegrator) and not hasattr(integrator, "getAcceptanceRate"):
        integrator = mh.EdgeFlipIntegrator.cast(integrator.getIntegrator(0))
    names = ("getNumAttempted", "getNumAccepted", "getAcceptanceRate", "getFlipAcceptanceRate")
    return {name: getattr(integrator, name)() for name in names if hasattr(integrator, name)}


def describe(context, integrator, forces):
    """Return everything about a Context that is compared, as JSON can hold it."""
    # No kinetic energy: that of a CustomIntegrator takes random numbers from OpenMM's generator.
    state = context.getState(positions=True, velocities=True, parameters=True)
    return {
        "triangles": [force.getTrianglesInContext(context).tolist() for force in forces],
        "positions": plain(state.getPositions(asNumpy=True)).tolist(),
        "velocities": plain(state.getVelocities(asNumpy=True)).tolist(),
        "energies": [[plain(force.getEnergyTermsInContext(context)[term]) for term in TERMS] for force in forces],
        "parameters": dict(sorted(state.getParameters().items())),
        "time": plain(state.getTime()),
        "stepCount": context.getStepCount(),
        "counters": countersOf(integrator),
    }


def assertAgrees(found, expected, tolerance):
    """Compare with what is right, to the last bit but for positions, velocities, time and energies."""
    assert found["triangles"] == expected["triangles"]
    later = {name: value for name, value in found["parameters"].items() if name not in expected["parameters"]}
    assert {**found["parameters"], **expected["parameters"]} == found["parameters"] and not any(later.values())
    assert found["stepCount"] == expected["stepCount"]
    assert found["counters"].items() >= expected["counters"].items()
    assert np.allclose(found["energies"], expected["energies"], rtol=max(1e-9, tolerance), atol=1e-9)
    for name in ("positions", "velocities", "time"):
        assert np.allclose(found[name], expected[name], rtol=tolerance, atol=tolerance), name


@pytest.mark.parametrize("scene", PROPERTIES)
def test_integrators_from_xml(scene):
    integrator = load(scene, "integrator")
    for name, value in PROPERTIES[scene].items():
        assert plain(getattr(integrator, f"get{name}")()) == value, name


@pytest.mark.parametrize("scene", CLASSES)
def test_forces_from_xml(scene):
    numVesicles = 2 if scene == "two_membranes" else 1
    system = load(scene, "system")
    forces = membranesOf(system)
    nodes = ElementTree.parse(FOLDER / f"{scene}.system.xml").findall(".//Force[@type='HelfrichForce']")
    assert len(forces) == len(nodes) == numVesicles
    for i, (force, node) in enumerate(zip(forces, nodes)):
        level = i if numVesicles == 2 else 1
        assert force.getName() == (f"Vesicle{i}" if numVesicles == 2 else "HelfrichForce")
        assert force.getForceGroup() == level
        triangles = [force.getTriangleParameters(t) for t in range(force.getNumTriangles())]
        assert " ".join(str(v) for triangle in triangles for v in triangle) == node.find("Triangles").get("particles")
        edges = [force.getFixedEdgeParameters(e) for e in range(force.getNumFixedEdges())]
        assert " ".join(str(v) for edge in edges for v in edge) == node.find("FixedEdges").get("particles")
        assert len(triangles) in (80, 320) and len(edges) in (6, 24)
        for target in ("Area", "Volume", "AreaDifference"):
            assert plain(getattr(force, f"getTarget{target}")()) == float(node.get(f"target{target}"))
            assert getattr(force, f"getTarget{target}Parameter")() == f"{force.getName()}Target{target}"
        moduli = force.getBendingModulus(), force.getAreaModulus(), force.getVolumeModulus()
        assert [plain(modulus) for modulus in moduli] == [30, 2000, 1500]
        assert [plain(force.getAreaDifferenceModulus()), plain(force.getLeafletSeparation())] == [100, 0.2]
        assert [plain(value) for value in force.getTether()] == [60, 0.75, 1.35, 3]
        assert plain(force.getTetherLengthScale()) == 1.1
        assert plain(force.getTension()) == plain(force.getPressure()) == 0
        assert [plain(value) for value in force.getRepulsion()] == [3, (1.0, 1.6, 2.6)[level], 4, level]


@pytest.mark.parametrize("form", ["state.xml", "checkpoint"])
@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("scene", CLASSES)
def test_contexts_go_on(scene, platform, form):
    name = f"{scene}.{platform}"
    expected = json.loads((FOLDER / f"{name}.json").read_text())
    context, integrator, forces = createContext(scene, platform)
    restore(context, name, form)
    assertAgrees(describe(context, integrator, forces), expected["saved"], 0)
    advance(scene, integrator, STEPS)
    found, expected = describe(context, integrator, forces), expected[form]
    # Version 0.1.0 counted a trajectory as one of its steps.
    assert found["time"] >= expected.pop("time")
    assertAgrees(
        {**found, "time": 0}, {**expected, "time": 0}, 1e-3 if scene == "mixed" and platform == "CPU" else 1e-9
    )


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("scene, other", [("flips", "trajectories"), ("trajectories", "flips"), ("native", "waves")])
def test_a_checkpoint_of_another_class_is_refused(scene, other, platform):
    context = mm.Context(load(scene, "system"), load(other, "integrator"), mm.Platform.getPlatformByName(platform))
    with pytest.raises(mm.OpenMMException, match=r"of another class|ends too early"):
        restore(context, f"{scene}.{platform}", "checkpoint")


def test_a_run_is_resumed(tmp_path):
    """It was stopped in the burn-in of its second stage, and goes on through two more."""
    for ending in ("checkpoint", "csv", "dcd", "vtkhdf"):
        shutil.copy(FOLDER / f"study.{ending}", tmp_path)
    expected = json.loads((FOLDER / "study.json").read_text())
    mh.resume(tmp_path / "study")
    table = mh.readObservables(tmp_path / "study.csv")
    for name, column in expected["table"].items():
        assert np.allclose(table[name], column, rtol=1e-9, atol=1e-9), name
    final = mh.Mesh.read(tmp_path / "study.ply")
    assert final.triangles.tolist() == expected["triangles"]
    assert np.allclose(final.vertices, expected["vertices"], rtol=0, atol=1e-8)
    with mh.readMeshTrajectory(tmp_path / "study.vtkhdf") as frames:
        assert [frame.step for frame in frames] == expected["steps"]
