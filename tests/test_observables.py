"""Observables: the columns of tables, and what plots, pages, summaries and sweeps make of them."""

import numpy as np
import pytest

import openmmhelfrich as mh
from openmmhelfrich.pictures.plots import plotObservables, plotPath
from openmmhelfrich.pictures.report import writeReport
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.studies import run
from openmmhelfrich.runs.sweeps import observe
from openmmhelfrich.sampling.averages import lateRows
from openmmhelfrich.sampling.observables import DEFAULT_OBSERVABLES, ENERGY_TERMS, OBSERVABLES
from openmmhelfrich.tables import Table
from test_mesh_trajectory import simulate
from test_report import partsOf


def test_names_are_different_and_refer_to_each_other():
    names = [observable.name for observable in OBSERVABLES]
    assert len(set(names)) == len(names)
    assert {observable.target for observable in OBSERVABLES if observable.target} < set(names)


def test_energy_terms_are_those_of_the_force(sphere):
    simulation, force = simulate(sphere)
    assert tuple(force.getEnergyTermsInContext(simulation.context)) == ENERGY_TERMS


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
    expected = [observable.name for observable in older if not observable.name.startswith("wave")]  # there are no waves
    assert list(table["step"]) == [2, 4, 6, 8] and list(table) == expected
    lines = (tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text(
        "\n".join([lines[0] + ",novelty (nm)", *(line + ",1" for line in lines[1:])]) + "\n"
    )
    reporter = mh.ObservablesReporter(tmp_path / "a.csv", 2, force, append=True)
    with pytest.raises(ValueError, match=r"the table has the column 'novelty \(nm\)'; the simulation has step, energy"):
        reporter.report(simulation, None)
    reporter.close()


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
    assert list(lateRows(table)["step"]) == [10, 11]  # the second half of the last window is 9 to 11
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
