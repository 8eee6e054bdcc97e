"""Continuation: targets go where they should, by the path they should, and a membrane that follows them comes back."""

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.studies import run
from openmmhelfrich.sampling.continuation import ContinuationPath, requireOneSign
from openmmhelfrich.sampling.targets import absoluteTargets

START = {"area": 12.0, "volume": 4.0, "areaDifference": 25.0}


def createSimulation():
    mesh = mh.Mesh.icosphere(1)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(50)
    force.setAreaModulus(1e5)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(1e5)
    force.setTargetVolume(mesh.volume)
    length = mesh.edgeLengths.mean()
    force.setTether(1000, 0.75 * length, 1.4 * length, 2)
    system = mesh.createSystem()
    system.addForce(force)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.001, 50)
    integrator.setRandomNumberSeed(2)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("Reference"))
    simulation.context.setPositions(mesh.vertices)
    return mesh, force, simulation


# --- the path


def testStraightPath():
    path = ContinuationPath(START, {"volume": 2.0}, 4)
    assert np.array_equal(path.lambdas, [0, 0.25, 0.5, 0.75, 1])
    assert [path.targets(i) for i in range(5)] == [{"volume": v} for v in (4.0, 3.5, 3.0, 2.5, 2.0)]


def testThereAndBackByTheSameWindows():
    path = ContinuationPath(START, {"volume": 2.0, "area": 10.0}, 3, True, {"volume": [0.0, 0.1, 0.7, 1.0]})
    assert np.array_equal(path.lambdas, [0, 1 / 3, 2 / 3, 1, 2 / 3, 1 / 3, 0])
    targets = [path.targets(i) for i in range(7)]
    assert (
        targets == targets[::-1]
        and targets[0] == {"volume": 4.0, "area": 12.0}
        and targets[3] == {"volume": 2.0, "area": 10.0}
    )
    assert targets[1]["volume"] == pytest.approx(0.1 * 2 + 0.9 * 4) and targets[1]["area"] == pytest.approx(
        10 / 3 + 2 / 3 * 12
    )


@pytest.mark.parametrize(
    "arguments, message",
    [
        (({"volume": -1.0}, 2), "leads to a target volume of -1; it must be positive"),
        (({"areaDifference": -25.0}, 2), "leads to a target area difference of 0"),
        (({"volume": 2.0}, 0), "windows is 0"),
        (({"volume": 2.0}, 2, False, {"volume": [0, 1]}), "path of volume has 2 values; it must have 3"),
        (({"volume": 2.0}, 2, False, {"area": [0, 1, 1]}), "path has 'area'"),
        (({"volume": 2.0}, 1, False, {"volume": [0, np.nan]}), "finite"),
        (({"volume": 2.0}, 1, False, {"volume": [0, 3]}), "target volume of -2"),
    ],
)
def testWrongPaths(arguments, message):
    with pytest.raises(ValueError, match=message):
        ContinuationPath(START, *arguments)


@pytest.mark.parametrize("windows", [2, 3])
def testNoPathOfAnAreaDifferenceLeadsThroughZero(windows):
    """However few windows: none has to be at 0.  One that is about 0, as a flat sheet's, has no sign."""
    going = {"steps": 2, "target_area_difference": -20.0}
    along = {"windows": windows, "equilibration": 1, "path": {"target_area_difference": [0.0, *[1.0] * windows]}}
    for stage in ({"kind": "approach", **going}, {"kind": "continue", **going, **along}):
        config = {
            "mesh": {"icosphere": 1},
            "membrane": {"area_difference_modulus": 1e3},
            "stages": [stage],
            "output": {"prefix": "nowhere"},
        }
        with pytest.raises(ValueError, match=r"stage 1 .* would go from 2\d\.\d+ to -20, and through 0"):
            run(config)
    _, force, simulation = createSimulation()
    force.setAreaDifferenceModulus(1e3)
    force.updateParametersInContext(simulation.context)
    with pytest.raises(ValueError, match=r"would go from .* through 0, where its energy has no bound"):
        mh.continueTo(simulation, force, {"areaDifference": -20.0}, 3)
    requireOneSign("areaDifference", [1e-15, -20.0])
    requireOneSign("areaDifference", [-25.0, -20.0])


def testTargetsWithUnits():
    assert absoluteTargets({"area": 900 * unit.angstrom**2}, START) == {"area": pytest.approx(9)}
    assert absoluteTargets({"area": 9.0, "reducedVolume": 0.5}, START)["volume"] == pytest.approx(
        0.5 * 27 / (6 * np.sqrt(np.pi))
    )
    assert absoluteTargets({"reducedVolume": 1.0}, START)["volume"] == pytest.approx(12**1.5 / (6 * np.sqrt(np.pi)))
    for targets, message in (
        ({}, "none"),
        ({"height": 1}, "height"),
        ({"volume": 1, "reducedVolume": 1}, "both"),
        ({"reducedVolume": 1.2}, "1.2"),
        ({"area": np.inf}, "inf"),
    ):
        with pytest.raises(ValueError, match=message):
            absoluteTargets(targets, START)


# --- the Python call


def testContinueTo():
    mesh, force, simulation = createSimulation()
    done = []
    result = mh.continueTo(
        simulation,
        force,
        {"reducedVolume": 0.8},
        windows=4,
        equilibration=60,
        steps=12,
        interval=3,
        temperature=300 * unit.kelvin,
        progress=lambda *counts: done.append(counts),
    )
    assert simulation.currentStep == 5 * 72 and done == [(i, 5) for i in range(1, 6)]
    assert len(result.rows["step"]) == 20 and list(result.rows["step"][:5]) == [63, 66, 69, 72, 135]
    windows = result.windows
    assert np.array_equal(windows["lambda"], np.linspace(0, 1, 5)) and np.all(windows["samples"] == 4)
    assert np.all(np.diff(windows["reducedVolume"]) < 0) and windows["reducedVolume"][-1] < 0.9
    assert windows["energy"][2] == pytest.approx(result.rows["energy"][8:12].mean()) and windows["energyDeviation"][
        2
    ] == pytest.approx(result.rows["energy"][8:12].std())
    assert list(result.toDataFrame()["window"]) == [0, 1, 2, 3, 4]
    assert simulation.context.getParameter(force.getTargetVolumeParameter()) == pytest.approx(
        0.8 * mesh.area**1.5 / (6 * np.sqrt(np.pi))
    )


def testThereAndBackInPython():
    mesh, force, simulation = createSimulation()
    result = mh.continueTo(
        simulation,
        force,
        {"volume": 0.8 * mesh.volume * unit.nanometer**3},
        windows=2,
        equilibration=5,
        steps=2,
        thereAndBack=True,
    )
    assert np.array_equal(result.windows["lambda"], [0, 0.5, 1, 0.5, 0])
    assert simulation.context.getParameter(force.getTargetVolumeParameter()) == mesh.volume
    with pytest.raises(ValueError, match="with this interval: steps is 2; it must be a whole number, 3 or"):
        mh.continueTo(simulation, force, {"volume": 3.0}, equilibration=5, steps=2, interval=3)


# --- stages


def testProlateBranchThereAndBack(tmp_path):
    """A prolate vesicle that is deflated from a reduced volume of 0.9 to 0.75 and inflated again has its energy back,
    within 1%.
    """
    stages = [
        {"kind": "sample", "steps": 800, "reduced_volume": 0.9},
        {"kind": "anneal", "steps": 800, "end_temperature": 100.0},
        {
            "kind": "continue",
            "temperature": 100.0,
            "windows": 6,
            "equilibration": 150,
            "steps": 150,
            "reduced_volume": 0.75,
            "there_and_back": True,
        },
    ]
    summary = run(
        parseConfig(
            {
                "mesh": {"icosphere": 2},
                "platform": {"threads": 1},
                "stages": stages,
                "output": {"prefix": str(tmp_path / "a")},
                "sampling": {"step_size": "auto", "steps_per_trajectory": 50, "seed": 1},
            }
        )
    )
    windows = mh.readObservables(summary.outputs.path)
    energy, v = windows["energy"], windows["reducedVolume"]
    assert v[[0, 6, 12]] == pytest.approx([0.9, 0.75, 0.9], rel=0.01)
    assert energy[-1] == pytest.approx(energy[0], rel=0.01)
    assert energy[6] > 1.2 * energy[0] and np.all(np.diff(energy[:7]) > 0) and np.all(np.diff(energy[6:]) < 0)
    final = mh.Mesh.read(summary.outputs.mesh).vertices
    axes = np.sqrt(np.linalg.eigvalsh(np.cov(final.T)))
    assert axes[2] > 1.5 * axes[1] and axes[1] < 1.1 * axes[0], "it should be prolate"
    assert summary.outputs.pathPlot.exists()


def testEachWindowIsEquilibratedAndThenRecorded(tmp_path):
    stage = {
        "kind": "continue",
        "windows": 2,
        "equilibration": 4,
        "steps": 6,
        "target_area": 12.0,
        "target_volume": 3.0,
        "path": {"target_area": [0.0, 0.0, 1.0]},
    }
    summary = run(
        parseConfig(
            {
                "mesh": {"icosphere": 1},
                "platform": {"name": "Reference"},
                "stages": [stage],
                "output": {"prefix": str(tmp_path / "a"), "observables_interval": 1},
                "sampling": {"steps_per_trajectory": 5, "seed": 1},
            }
        )
    )
    table, mesh = summary.table, mh.Mesh.icosphere(1)
    assert list(table["window"][1:]) == [0] * 10 + [1] * 10 + [2] * 10
    assert list(table["equilibrated"][1:]) == 3 * (4 * [0] + 6 * [1])
    assert table["targetVolume"][1:] == pytest.approx(np.repeat([mesh.volume, (mesh.volume + 3) / 2, 3], 10))
    assert table["targetArea"][1:] == pytest.approx(np.repeat([mesh.area, mesh.area, 12], 10))
    windows = mh.readObservables(summary.outputs.path)
    assert (
        np.all(windows["samples"] == 6)
        and np.all(windows["stage"] == 1)
        and windows["energy"][1] == pytest.approx(table["energy"][15:21].mean())
    )


def testSeveralPathsInARun(tmp_path):
    stages = [
        {"kind": "continue", "windows": 1, "equilibration": 1, "steps": 2, "target_volume": v} for v in (3.5, 3.0)
    ]
    summary = run(
        parseConfig(
            {
                "mesh": {"icosphere": 1},
                "platform": {"name": "Reference"},
                "stages": stages,
                "output": {"prefix": str(tmp_path / "a")},
                "sampling": {"steps_per_trajectory": 5, "seed": 1},
            }
        )
    )
    windows = mh.readObservables(summary.outputs.path)
    assert list(windows["stage"]) == [1, 1, 2, 2] and list(windows["window"]) == [0, 1, 0, 1]
    assert windows["targetVolume"] == pytest.approx([mh.Mesh.icosphere(1).volume, 3.5, 3.5, 3.0])
