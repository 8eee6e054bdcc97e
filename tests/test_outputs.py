import io

import mdtraj
import numpy as np
import openmm as mm
import pytest
from openmm import app, unit
from PIL import Image

import openmmhelfrich as mh
from openmmhelfrich.runs.config import asDict, parseConfig
from openmmhelfrich.runs.studies import resume, run

TERMS = ["E_bending", "E_area", "E_volume", "E_areaDifference", "E_tether", "E_repulsion"]


def configure(folder, prefix, **sections):
    """Return a Config of a short run with every term on."""
    mesh = mh.Mesh.icosphere(2)
    mesh.vertices *= [1, 1, 0.7]
    mesh.write(folder / "start.ply")
    config = {
        "mesh": {"file": str(folder / "start.ply")},
        "membrane": {"area_modulus": 1e5, "volume_modulus": 1e5, "area_difference_modulus": 1e4},
        "repulsion": {"modulus": 10.0},
        "sampling": {"steps": 60, "seed": 5},
        "platform": {"threads": 1},
        "output": {"prefix": str(folder / prefix), "trajectory_interval": 20, "observables_interval": 10},
    }
    for name, values in sections.items():
        config.setdefault(name, {}).update(values)
    return parseConfig(config)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The summary of a run."""
    return run(configure(tmp_path_factory.mktemp("run"), "out/a"))


def testEverythingIsWritten(done):
    names = [
        "a.checkpoint",
        "a.csv",
        "a.dcd",
        "a.ply",
        "a.psf",
        "a.resolved.toml",
        "a.vtkhdf",
        "a_observables.png",
        "a_shape.png",
    ]
    assert sorted(path.name for path in done.outputs.table.parent.iterdir()) == names
    assert done.steps == 60 and done.numVertices == 162 and 0 < done.acceptance <= 1 and 0 < done.flipAcceptance < 1


def testTotalIsTheSumOfItsParts(done):
    table = done.table
    assert np.array_equal(table["step"], np.arange(0, 61, 10))
    assert table["energy"] == pytest.approx(sum(table[name] for name in TERMS), rel=1e-14)
    assert np.all(table["E_bending"] > 8 * np.pi * 20 * 0.99) and np.all(table["E_area"][1:] > 0)
    assert table["reducedVolume"] == pytest.approx(
        6 * np.sqrt(np.pi) * table["volume"] / table["area"] ** 1.5, rel=1e-14
    )
    assert table["areaDifference"] == pytest.approx(2 * table["meanCurvature"], rel=1e-14)


def testTrajectoryHasItsTopology(done):
    trajectory = mdtraj.load_dcd(str(done.outputs.trajectory), top=str(done.outputs.topology))
    start = mh.Mesh.read(done.config.mesh.file)
    assert trajectory.xyz.shape == (3, 162, 3)
    assert sorted((a.index, b.index) for a, b in trajectory.topology.bonds) == list(map(tuple, start.edges))
    final = mh.Mesh.read(done.outputs.mesh)
    assert np.abs(trajectory.xyz[-1] - final.vertices).max() < 1e-6


def testFinalMeshIsTheLastState(done):
    final = mh.Mesh.read(done.outputs.mesh)
    final.check()
    assert not np.array_equal(final.edges, mh.Mesh.read(done.config.mesh.file).edges), "edges should have flipped"
    assert (final.area, final.volume) == pytest.approx((done.table["area"][-1], done.table["volume"][-1]), rel=1e-12)
    bending = 2 * 20 * np.sum(final.vertexMeanCurvatures**2 / final.vertexAreas)
    assert bending == pytest.approx(done.table["E_bending"][-1], rel=1e-9)


def testPicturesShowSomething(done):
    for file in (done.outputs.plot, done.outputs.picture):
        pixels = np.asarray(Image.open(file).convert("RGB"))
        assert min(pixels.shape[:2]) > 400 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50


def testSummaryTellsWhatWasDone(done):
    text = "\n".join(" ".join(line) for line in done.lines())
    for word in (
        "162 vertices",
        "60 steps in",
        "seed 5",
        "area",
        "volume",
        "reduced volume",
        "trajectories",
        "flips",
        "E_B/8 pi kappa",
        "a.dcd",
    ):
        assert word in text
    late = done.table["area"][len(done.table["area"]) // 2 :]
    assert done.mean("area") == pytest.approx(late.mean())
    assert done.drift("area") == pytest.approx(np.abs(late / mh.Mesh.read(done.config.mesh.file).area - 1).max())


def testWhatALoneMinimizationShows(tmp_path):
    """The energy by iteration, and the start and the end of all else, also where the picture is drawn again: no
    averages, which there are none of.
    """
    config = configure(tmp_path, "a", sampling={"seed": 5})
    stages = [{"kind": "minimize", "max_iterations": 40}]
    config = parseConfig({**asDict(config), "sampling": {"seed": 5}, "stages": stages})
    done = run(config)
    text = "\n".join(" ".join(line) for line in done.lines())
    iterations, energies = done.descent["iteration"], done.descent["energy"]
    assert np.array_equal(iterations, np.arange(len(iterations))) and 2 < len(iterations) <= 41
    assert energies[[0, -1]] == pytest.approx(done.table["energy"][[0, -1]], rel=1e-9) and energies[0] > energies[-1]
    for word in (
        f"values after {len(iterations) - 1} iterations, and at the start:",
        f", from {done.table['area'][0]:.6g}",
    ):
        assert word in text
    assert not any(word in text for word in ("average", "always", "undulations", "steps"))
    first, *others = done.plot().figure.axes
    (line,) = (line for line in first.lines if len(line.get_xdata()) == len(iterations))
    assert np.array_equal(line.get_ydata(), energies) and "iteration" in others[-1].get_xlabel()
    assert all(each.lines[0].get_xdata().tolist() == [0, len(iterations) - 1] for each in others)

    def stop(study):
        if study.stage.position == 3:
            raise KeyboardInterrupt

    config.output.prefix = str(tmp_path / "stopped")
    ((_, values),) = (line for line in run(config, stop).lines() if line[0] == "values")
    assert values.startswith("at the start")
    drawn = done.outputs.plot.read_bytes()
    done.outputs.plot.write_bytes(b"")
    again = resume(done.config.output.prefix)
    assert np.array_equal(again.descent["energy"], energies) and again.outputs.plot.read_bytes() == drawn


def testRatesOfFlipsAreThoseOfSampling(tmp_path):
    """Minimizations try flips, too, which rates leave out, also in a run that was stopped after them."""
    low, sample = {"kind": "minimize", "max_iterations": 30}, {"kind": "sample", "steps": 12}
    plain = asDict(configure(tmp_path, "a", sampling={"seed": 5, "flip_probability": 0.5}))
    del plain["sampling"]["steps"]
    plain["output"]["observables_interval"], plain["membrane"]["bending_modulus"] = 1, 2.0

    def configOf(prefix):
        return parseConfig({**plain, "stages": [low, sample, low], "output": {**plain["output"], "prefix": prefix}})

    def stop(study):
        if study.simulation.currentStep == 9:
            raise KeyboardInterrupt

    done = run(configOf(str(tmp_path / "whole")))
    table = done.table
    for name in ("flipAcceptance", "flipRate", "flipsForbidden"):
        assert np.all(table[name][table["stage"] == 1] == 0)
        assert table[name][-1] == table[name][-2]  # the second minimization
    assert 0.01 < done.flipAcceptance < 1 and done.flipAcceptance == table["flipAcceptance"][-1]
    assert done.acceptance == table["acceptance"][-1] > 0
    prefix = str(tmp_path / "parts")
    stopped = run(configOf(prefix), stop)
    assert stopped.interrupted and ("averages", "over the second half of the last stage:") in stopped.lines()
    again = resume(prefix)
    assert again.outputs.table.read_bytes() == done.outputs.table.read_bytes()
    assert again.flipAcceptance == done.flipAcceptance


def testSameSeedSameResultWhateverTheThreads(done, tmp_path):
    again = run(configure(tmp_path, "a", platform={"threads": 2}))
    assert again.outputs.table.read_bytes() == done.outputs.table.read_bytes()
    assert again.outputs.trajectory.read_bytes() == done.outputs.trajectory.read_bytes()
    assert np.array_equal(mh.Mesh.read(again.outputs.mesh).triangles, mh.Mesh.read(done.outputs.mesh).triangles)
    other = run(configure(tmp_path, "b", sampling={"seed": 6}))
    assert other.outputs.table.read_bytes() != done.outputs.table.read_bytes()


def testTargetsFromTheConfiguration(tmp_path):
    summary = run(configure(tmp_path, "a", membrane={"target_area": 9.0, "reduced_volume": 0.9}, sampling={"steps": 2}))
    assert summary.targets["area"] == pytest.approx(9)
    assert summary.targets["volume"] == pytest.approx(0.9 * 9**1.5 / (6 * np.sqrt(np.pi)))


def testScaleAndLengthUnit(tmp_path):
    summary = run(configure(tmp_path, "a", mesh={"scale": 0.5, "length_unit": "um"}, sampling={"steps": 2}))
    assert "area (um^2)" in summary.outputs.table.read_text()
    assert summary.table["area"][0] == pytest.approx(mh.Mesh.read(summary.config.mesh.file).area / 4)


def testInterruptedRunIsComplete(tmp_path):
    def interrupt(study):
        if study.simulation.currentStep == 30:
            raise KeyboardInterrupt

    summary = run(configure(tmp_path, "a"), interrupt)
    assert summary.interrupted and summary.steps == 30 and summary.table["step"][-1] == 30
    assert mdtraj.load_dcd(str(summary.outputs.trajectory), top=str(summary.outputs.topology)).n_frames == 1
    assert all(path.exists() for path in summary.outputs.paths())


# --- the reporter in a plain script


def simulate(sphere, integrator):
    force = mh.HelfrichForce()
    force.setTriangles(sphere.triangles)
    force.setBendingModulus(30)
    force.setVolumeModulus(1000)
    force.setTargetVolume(4)
    system = sphere.createSystem(mass=1)
    system.addForce(force)
    simulation = app.Simulation(sphere.topology(), system, integrator, mm.Platform.getPlatformByName("Reference"))
    simulation.context.setPositions(sphere.vertices)
    return simulation, force


def testReporterWithAnotherIntegrator(sphere):
    simulation, force = simulate(sphere, mm.VerletIntegrator(1e-4))
    out, table = io.StringIO(), io.StringIO()
    simulation.reporters += [
        mh.ObservablesReporter(out, 5, force),
        mh.ObservablesReporter(table, 5, force, temperature=300 * unit.kelvin),
    ]
    simulation.step(10)
    names, *rows = [line.split(",") for line in out.getvalue().splitlines()]
    assert (
        names[:2] == ["step", "energy (kJ/mol)"]
        and "acceptance" not in names
        and [row[0] for row in rows] == ["5", "10"]
    )
    energy = simulation.context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoules_per_mole)
    assert float(rows[-1][1]) == pytest.approx(energy, rel=1e-12)
    kT = (300 * unit.kelvin * unit.MOLAR_GAS_CONSTANT_R).value_in_unit(unit.kilojoules_per_mole)
    assert float(table.getvalue().splitlines()[-1].split(",")[1]) == pytest.approx(energy / kT, rel=1e-12)


def testReporterAppends(sphere, tmp_path):
    simulation, force = simulate(sphere, mm.VerletIntegrator(1e-4))
    for append in (False, True):
        simulation.reporters = [mh.ObservablesReporter(tmp_path / "a.csv", 2, force, append=append)]
        simulation.step(4)
    assert list(mh.readObservables(tmp_path / "a.csv")["step"]) == [2, 4, 6, 8]
