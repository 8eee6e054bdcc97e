"""Axisymmetric minima against known numbers, and minimum shapes of triangles against them."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import check_grad
from typer.testing import CliRunner

import openmmhelfrich as mh
from openmmhelfrich.analysis.convergence import (
    REDUCED_VOLUMES,
    DiscreteMinimum,
    discreteMinimum,
    extrapolatedEnergy,
    orderOfConvergence,
)
from openmmhelfrich.cli import app
from openmmhelfrich.geometry import axisymmetric
from openmmhelfrich.pictures import sections

POINTS = [(branch, v) for branch, volumes in REDUCED_VOLUMES.items() for v in volumes]


def references():
    with open(Path(__file__).parent / "data" / "axisymmetric_minima.csv", newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {
            (row["branch"], float(row["v"])): (float(row["energy_over_8pi_kappa"]), float(row["delta_a"]))
            for row in rows
        }


# --- axisymmetric shapes


def test_every_reference_is_compared():
    assert sorted(references()) == sorted(POINTS)


@pytest.mark.parametrize("branch, v", POINTS)
def test_axisymmetric_minimum(branch, v):
    """To the digits that are known; but the energies known of stomatocytes are a little above the least."""
    shape, (energy, areaDifference) = mh.axisymmetricMinimum(branch, v), references()[branch, v]
    if branch == "stomatocyte":
        assert energy - 0.0016 < shape.energy < energy and shape.areaDifference == pytest.approx(
            areaDifference, abs=0.013
        )
    else:
        assert shape.energy == pytest.approx(energy, abs=6e-6) and shape.areaDifference == pytest.approx(
            areaDifference, abs=6e-5
        )
    (r0, z0), (r1, z1) = shape.outline[:-1].T, shape.outline[1:].T
    area, volume = (
        np.sum(np.pi * (r0 + r1) * np.hypot(r1 - r0, z1 - z0)),
        np.sum(np.pi / 3 * (r0**2 + r0 * r1 + r1**2) * (z0 - z1)),
    )
    assert area == pytest.approx(4 * np.pi, rel=1e-6) and volume == pytest.approx(4 * np.pi / 3 * v, rel=1e-5)


def test_more_modes_change_nothing(monkeypatch):
    minimum = mh.axisymmetricMinimum.__wrapped__  # which remembers nothing
    few = minimum("stomatocyte", 0.55)
    monkeypatch.setattr(axisymmetric, "_MODES", 160)
    monkeypatch.setattr(axisymmetric, "_NODES", 420)
    many = minimum("stomatocyte", 0.55)
    assert 0 < abs(many.energy - few.energy) < 1e-5 and many.areaDifference == pytest.approx(
        few.areaDifference, abs=1e-4
    )


def test_branches_begin_at_the_sphere():
    """E/8 pi kappa of prolates and oblates tends to 1 with v, and falls as v grows."""
    for branch in ("prolate", "oblate"):
        energies = [mh.axisymmetricMinimum(branch, v).energy for v in (0.96, 0.98)]
        assert energies[0] > energies[1] > 1 and 2 * energies[1] - energies[0] == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("symmetric", [True, False])
def test_derivatives_of_the_outline(symmetric, monkeypatch):
    monkeypatch.setattr(axisymmetric, "_MODES", 20)
    monkeypatch.setattr(axisymmetric, "_NODES", 60)
    series = axisymmetric._TangentAngle(symmetric)
    random = np.random.default_rng(1)
    c = series.coefficients(axisymmetric._spheroid("oblate", 0.6)) + random.normal(0, 0.05, len(series._modes))
    assert check_grad(lambda c: series.energy(c)[0], lambda c: series.energy(c)[1], c) < 1e-5 * np.linalg.norm(
        series.energy(c)[1]
    )
    for i, row in enumerate(series.constraints(c, 0.6)[1]):
        assert check_grad(
            lambda c, i=i: series.constraints(c, 0.6)[0][i], lambda c, i=i: series.constraints(c, 0.6)[1][i], c
        ) < 1e-6 * np.linalg.norm(row)


def test_poles_of_a_thin_oblate_pass_through_each_other():
    gap = {v: -np.diff(mh.axisymmetricMinimum("oblate", v).outline[[0, -1], 1])[0] for v in (0.5, 0.51)}
    assert gap[0.5] < 0 < gap[0.51]


@pytest.mark.parametrize(
    "branch, v, problem",
    [
        ("pear", 0.8, "branch is 'pear'"),
        ("prolate", 1, "reducedVolume is 1"),
        ("oblate", 0.2, "reducedVolume is 0.2"),
        ("stomatocyte", 0.7, "from 0.3 to 0.65"),
        ("prolate", math.nan, "reducedVolume is nan"),
    ],
)
def test_refused(branch, v, problem):
    with pytest.raises(ValueError, match=problem):
        mh.axisymmetricMinimum(branch, v)


# --- triangles


@pytest.mark.parametrize("branch, v", [point for point in POINTS if point != ("prolate", 0.5)])
def test_minimum_of_642_vertices(branch, v):
    minimum = discreteMinimum(branch, v, 642)
    assert minimum.result.converged and not minimum.result.warnings
    energy, areaDifference = references()[branch, v]
    assert minimum.energy == pytest.approx(energy, rel=0.01) and minimum.areaDifference == pytest.approx(
        areaDifference, abs=0.025
    )
    assert minimum.mesh.reducedVolume == pytest.approx(v, rel=2e-4)
    minimum.mesh.check()


def test_thin_tube():
    """What limits a narrow tube is the volume that its triangles cut off: the energy is that of the reduced volume with
    this added.
    """
    minimum = discreteMinimum("prolate", 0.5, 642)
    assert minimum.result.converged and -0.02 < minimum.energyError < -0.01
    standsFor = mh.axisymmetricMinimum("prolate", 0.5 + (0.5 - minimum.inscribedVolume))
    assert minimum.energy == pytest.approx(standsFor.energy, rel=0.004) and minimum.areaDifference == pytest.approx(
        standsFor.areaDifference, abs=0.004
    )


def test_convergence():
    coarse, fine = (discreteMinimum("prolate", 0.9, n) for n in (162, 642))
    assert 0.5 < orderOfConvergence(coarse, fine) < 1.5
    assert abs(extrapolatedEnergy(coarse, fine) / fine.continuum.energy - 1) < 0.5 * abs(fine.energyError)


def test_order_and_extrapolation_of_an_exact_law():
    continuum = axisymmetric.AxisymmetricShape(1.5, 1.0, None)
    a, b, c = (
        DiscreteMinimum("prolate", 0.8, n, 1.5 - 3 / n**p, 1.0, continuum, 0.8, None, None, 0.0)
        for n, p in ((100, 1), (400, 1), (400, 2))
    )
    assert orderOfConvergence(a, b) == pytest.approx(1) and extrapolatedEnergy(a, b) == pytest.approx(1.5)
    above = DiscreteMinimum("prolate", 0.8, 400, 1.6, 1.0, continuum, 0.8, None, None, 0.0)
    assert orderOfConvergence(a, c) > 2 and math.isnan(orderOfConvergence(a, above))


# --- the command


def invoke(*arguments):
    return CliRunner().invoke(app, ["minima", *map(str, arguments)])


def test_command(inFolder):
    command = (
        "--branch",
        "prolate",
        "--volume",
        0.9,
        "--vertices",
        642,
        "--vertices",
        162,
        "--out",
        "a.csv",
        "--picture",
        "a.png",
    )
    result = invoke(*command)
    assert result.exit_code == 0, result.output
    header, coarse, fine, convergence = result.output.splitlines()
    assert (
        coarse.split()[:3] == ["prolate", "0.9", "162"]
        and fine.split()[4] == "1.18964"
        and "order in 1/N: 0." in convergence
    )
    with open("a.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["numVertices"] for row in rows] == ["162", "642"] and float(rows[1]["energyError"]) == pytest.approx(
        -0.0015, abs=5e-4
    )
    assert (inFolder / "a.png").stat().st_size > 5000
    before = (inFolder / "a.csv").read_bytes()
    result = invoke(*command)
    assert (
        result.exit_code == 1
        and "a.csv, a.png exist already" in result.output
        and (inFolder / "a.csv").read_bytes() == before
    )


@pytest.mark.parametrize(
    "arguments, problem",
    [
        (("--branch", "pear"), "branch is 'pear'"),
        (("--branch", "stomatocyte", "--volume", 0.8), "from 0.3 to 0.65"),
        (("--volume", 0.1), "from 0.3 to 0.98"),
    ],
)
def test_command_refuses(arguments, problem):
    result = invoke(*arguments)
    assert (
        result.exit_code == 1
        and problem in result.output
        and "E/8" not in result.output
        and "Traceback" not in result.output
    )


def test_section_of_a_sphere():
    """Every point of the section is in the plane, and nearly on the circle."""
    lines = sections._section(mh.Mesh.icosphere(3))
    lengths = np.linalg.norm(lines[:, 0] - lines[:, 1], axis=1)
    assert np.linalg.norm(lines.reshape(-1, 2), axis=1) == pytest.approx(
        1, abs=0.01
    ) and lengths.sum() == pytest.approx(2 * np.pi, rel=0.01)
