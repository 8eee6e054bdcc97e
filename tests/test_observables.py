"""Observables: the columns of tables, and what plots, pages, summaries and sweeps make of them."""

import io

import numpy as np
import openmm as mm
import pytest
from openmm import app

import openmmhelfrich as mh
from membranes import TERMS
from openmmhelfrich.pictures.plots import plotObservables, plotPath
from openmmhelfrich.pictures.report import writeReport
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.studies import run
from openmmhelfrich.runs.sweeps import observe
from openmmhelfrich.sampling.averages import lateRows
from openmmhelfrich.sampling.observables import DEFAULT_OBSERVABLES, OBSERVABLES
from openmmhelfrich.tables import Table
from test_mesh_trajectory import simulate
from test_report import partsOf


def test_names_are_different_and_refer_to_each_other():
    names = [observable.name for observable in OBSERVABLES]
    assert len(set(names)) == len(names)
    assert {observable.target for observable in OBSERVABLES if observable.target} < set(names)


def createWaves():
    return mh.ShearWaveIntegrator(300, 0.001, 1, 3, 2)


def createMixture(*arguments, waves=None, **keywords):
    integrator = mh.HybridMonteCarloIntegrator(*arguments, **keywords)
    if waves is not None:
        integrator.addShearWaves(createWaves(), waves)
    return integrator


def createDynamics():
    return mm.LangevinMiddleIntegrator(300, 1, 1e-4), mh.EdgeFlipIntegrator(300, 0.1)


# What version 0.1.0 wrote: the columns of every table, and after them those of the integrator.
EVERY_TABLE = (
    "step,energy (kT),E_bending (kT),E_area (kT),E_volume (kT),E_areaDifference (kT),E_tether (kT),E_repulsion (kT),"
    "area (nm^2),volume (nm^3),reducedVolume,areaDifference (nm^2),meanCurvature (nm)"
)
MIXTURE = "acceptance,flipAcceptance,flipRate,flipsForbidden,diverged"
WITH_WAVES = "acceptance,flipAcceptance,waveAcceptance,waveAmplitude (nm),flipRate,flipsForbidden,diverged"
COLUMNS = {
    "native": (lambda: createMixture(300, 1e-3, 3), MIXTURE),
    "custom": (lambda: createMixture(300, 1e-3, 3, engine="custom"), MIXTURE),
    "native and waves": (lambda: createMixture(300, 1e-3, 3, waves=0.3), WITH_WAVES),
    "waves that are never made": (lambda: createMixture(300, 1e-3, 3, waves=0), WITH_WAVES),
    "custom and waves": (lambda: createMixture(300, 1e-3, 3, engine="custom", waves=0.3), WITH_WAVES),
    "dynamics": (lambda: createMixture(*createDynamics()), MIXTURE),
    "dynamics and waves": (lambda: createMixture(*createDynamics(), waves=0.3), WITH_WAVES),
    "flips alone": (lambda: mh.EdgeFlipIntegrator(300, 0.1), "flipRate,flipsForbidden"),
    "trajectories alone": (lambda: mh.HamiltonianTrajectoryIntegrator(300, 1e-3, 3), ""),
    "waves alone": (createWaves, ""),
    "dynamics alone": (lambda: mm.VerletIntegrator(1e-4), ""),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_are_those_of_version_0_1_0(name, sphere):
    create, columns = COLUMNS[name]
    simulation, force = simulate(sphere, integrator=create())
    table = io.StringIO()
    simulation.reporters.append(mh.ObservablesReporter(table, 2, force, 300))
    simulation.step(2)
    later = [f"E_{term} (kT)" for term in mh.HelfrichForce.getTermNames() if term not in TERMS]
    heads = [head for head in table.getvalue().splitlines()[0].split(",") if head not in later]
    assert heads == (f"{EVERY_TABLE},{columns}" if columns else EVERY_TABLE).split(",")


def test_a_table_goes_on_with_the_columns_that_it_has(sphere, tmp_path):
    """Those of a table from before there was an observable stay what they are."""
    simulation, force = simulate(sphere)
    older = tuple(observable for observable in DEFAULT_OBSERVABLES if observable.name != "reducedVolume")
    for observables, append in ((older, False), (DEFAULT_OBSERVABLES, True)):
        reporter = mh.ObservablesReporter(tmp_path / "a.csv", 2, force, append=append, observables=observables)
        simulation.reporters = [reporter]
        simulation.step(4)
        reporter.close()
    table = mh.readObservables(tmp_path / "a.csv")
    # There are no waves, no exchanges, no tension and no pressure, and all vertices are alike.
    absent = ("wave", "exchange", "E_tension", "E_pressure", "E_gaussian", "E_line", "E_pair")
    expected = [observable.name for observable in older if not observable.name.startswith(absent)]
    assert list(table["step"]) == [2, 4, 6, 8] and list(table) == expected
    lines = (tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text(
        "\n".join([lines[0] + ",novelty (nm)", *(line + ",1" for line in lines[1:])]) + "\n"
    )
    reporter = mh.ObservablesReporter(tmp_path / "a.csv", 2, force, append=True)
    with pytest.raises(ValueError, match=r"a\.csv has the column 'novelty \(nm\)'; the simulation has no such thing"):
        reporter.report(simulation, None)
    reporter.close()


@pytest.mark.parametrize("isAppended", [False, True])
def test_a_table_keeps_the_energy_of_a_term_that_is_turned_off(tmp_path, isAppended):
    mesh, force = mh.Mesh.icosphere(1), mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    for _ in range(2):
        force.addSpecies(20.0, 0.0)
    force.setVertexSpecies(np.arange(len(mesh.vertices)) % 2)
    force.setLineTension(0, 1, 3.0)
    system = mesh.createSystem()
    system.addForce(force)
    integrator = mh.HybridMonteCarloIntegrator(300, 1e-4)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    file = tmp_path / "a.csv"
    simulation.reporters.append(mh.ObservablesReporter(file, 1, force))
    simulation.step(2)
    if isAppended:
        simulation.reporters.pop().close()
        simulation.reporters.append(mh.ObservablesReporter(file, 1, force, append=True))
    force.setLineTension(0, 1, 0.0)
    force.updateParametersInContext(simulation.context)
    simulation.step(1)
    energies = mh.readObservables(file)["E_line"]
    assert np.all(energies[:2] > 0) and energies[2] == 0


def test_pictures_of_what_a_table_has(tmp_path):
    """Tables of other versions may lack columns."""
    values = np.linspace(1, 2, 4)
    table = Table(dict.fromkeys(("step", "energy", "E_bending", "area", "volume", "acceptance"), values))
    plotObservables(table, tmp_path / "plot.png")
    windows = {"lambda": values - 1, "E_bending": values, "E_bendingDeviation": values}
    plotPath(Table(windows), tmp_path / "path.png")
    assert (tmp_path / "plot.png").stat().st_size > 1e4 and (tmp_path / "path.png").stat().st_size > 5e3


def test_late_rows():
    table = Table(
        step=np.arange(12),
        stage=np.repeat([1, 2], [4, 8]),
        window=np.array([0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1]),
        equilibrated=np.array([0, 0, 1, 1, 0, 1, 0, 0, 0, 0, 1, 1]),
    )
    assert list(lateRows(table)["step"]) == [10, 11]  # of the last window
    early = table | {"equilibrated": np.array([0, 0, 1, 1, 0, 1, 0, 1, 1, 1, 1, 1])}
    assert list(lateRows(Table(early))["step"]) == [7, 8, 9, 10, 11]  # as in the table of the path
    assert list(lateRows(table.where(np.arange(10)))["step"]) == [8, 9]  # which is not equilibrated yet
    assert list(lateRows(table.where(np.arange(4)))["step"]) == [2, 3]
    assert list(lateRows(Table(step=np.arange(5)))["step"]) == [2, 3, 4]


def test_averages_after_a_continuation(inFolder):
    """Summary, page and sweep average over the last window, where it is equilibrated, and not over the whole path."""
    stages = [
        {"kind": "sample", "steps": 20},
        {"kind": "continue", "windows": 2, "equilibration": 24, "steps": 8, "reduced_volume": 0.8},
    ]
    config = parseConfig(
        {
            "mesh": {"icosphere": 2},
            "sampling": {"seed": 3, "steps_per_trajectory": 20},
            "platform": {"threads": 1},
            "stages": stages,
            "output": {"prefix": "run", "observables_interval": 1, "mesh_trajectory": False},
        }
    )
    summary, results = run(config), observe(config)
    table = mh.readObservables("run.csv")
    last = (table["stage"] == 2) & (table["window"] == 2) & (table["equilibrated"] == 1)
    assert last.sum() == 8
    facts = partsOf(writeReport("run"))[2]
    for name, title, head in (
        ("volume", "volume", "volume (nm^3)"),
        ("reducedVolume", "reduced volume", "reducedVolume"),
        ("energy", "energy", "energy (kT)"),
    ):
        expected = table[name][last].mean()
        assert summary.mean(name) == pytest.approx(expected, rel=1e-12)
        assert results[head] == pytest.approx(expected, rel=1e-12)
        assert facts[title].split(" ± ")[0] == f"{expected:.5g}"
    assert facts["averages"].endswith(f"from step {table['step'][last][0]:.0f} on")
    assert summary.mean("reducedVolume") == pytest.approx(0.8, abs=0.01)
    assert summary.drift("volume") == np.abs(table["volume"][last] / table["targetVolume"][last] - 1).max()


def test_reduced_area_difference(inFolder):
    """Runs have M/sqrt(4 pi A) in table, summary and page: 1 for a sphere of any radius."""
    for scale in (1.0, 3.0):
        config = parseConfig(
            {
                "mesh": {"icosphere": 3, "scale": scale},
                "sampling": {"seed": 3, "steps_per_trajectory": 5},
                "platform": {"threads": 1},
                "stages": [{"kind": "sample", "steps": 4}],
                "output": {"prefix": "run", "observables_interval": 1, "mesh_trajectory": False, "overwrite": True},
            }
        )
        summary, table = run(config), mh.readObservables("run.csv")
        expected = table["meanCurvature"] / np.sqrt(4 * np.pi * table["area"])
        assert table["reducedAreaDifference"] == pytest.approx(expected, rel=1e-6)
        assert table["reducedAreaDifference"][0] == pytest.approx(1, abs=0.01)
        assert summary.mean("reducedAreaDifference") == pytest.approx(expected[len(expected) // 2 :].mean(), rel=1e-6)
        assert partsOf(writeReport("run", overwrite=True))[2]["reduced area difference"].startswith("1.")
