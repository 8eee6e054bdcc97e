"""Energies at several temperatures: known densities of states come out, and a chain that is not Boltzmann distributed
is seen.
"""

import math

import numpy as np
import openmm as mm
import pytest

import openmmhelfrich as mh
from membranes import createContext, energyOf, kelvin
from test_flips import octahedron, softForce

pytest.importorskip("pymbar")
pytest.importorskip("emcee")

KT = np.array([1.0, 1.15, 1.3, 1.5])


def gammaEnergies(kT=KT, shape=100, samples=2000, seed=1):
    """Return energies of a System of 2*shape harmonic degrees of freedom, whose density of states is E^(shape-1)."""
    random = np.random.default_rng(seed)
    return [random.gamma(shape, t, samples) for t in kT]


def test_a_known_density_of_states():
    result = mh.reweight(gammaEnergies(), [kelvin(t) for t in KT])
    exact = -100 * np.log(KT)
    assert (
        np.all(np.abs(result.freeEnergies - exact) < 3 * result.freeEnergyErrors + 1e-9)
        and 0 < result.freeEnergyErrors[1:].max() < 0.1
    )
    assert np.all(np.abs(result.ratios - 1) < 3 * result.ratioErrors) and result.ratioErrors.max() < 0.05
    assert result.overlap.sum(axis=1) == pytest.approx(np.ones(4)) and np.all(result.overlap > 0)
    assert result.meanEnergy(kelvin(1.2)) == pytest.approx(120, rel=0.005)
    density = result.densityOfStates(30)
    assert density.pValue > 0.01 and density.degreesOfFreedom > 20
    populated = np.isfinite(density.residuals).any(axis=0)
    half = (density.energies[1] - density.energies[0]) / 2
    difference = (
        density.logDensity
        - np.log(((density.energies + half) ** 100 - (density.energies - half) ** 100) / (200 * half))
    )[populated]
    assert np.all(
        np.abs(difference - np.median(difference))
        < 3 * np.nanmin(density.errors[:, populated], axis=0) + 3 * result.freeEnergyErrors[-1]
    )
    assert 0.7 < np.nanstd(density.residuals) < 1.2
    deviations = (density.logDensities - density.logDensity) / density.errors
    assert np.nanmax(np.abs(deviations)) < 4
    frame = result.toDataFrame()
    assert list(frame["temperature"]) == pytest.approx([kelvin(t) for t in KT]) and math.isnan(frame["ratio"].iloc[-1])


def test_a_wrong_temperature_is_seen():
    energies = gammaEnergies()
    energies[2] *= 1.03
    result = mh.reweight(energies, [kelvin(t) for t in KT])
    deviations = np.abs(result.ratios - 1) / result.ratioErrors
    assert deviations[0] < 3 and min(deviations[1:]) > 4
    assert result.densityOfStates(30).pValue < 1e-6


def test_correlated_samples_count_less():
    """Each sample five times over, so that one in five is independent."""
    energies = [np.repeat(e, 5) for e in gammaEnergies(samples=1500)]
    result = mh.reweight(energies, [kelvin(t) for t in KT])
    assert result.autocorrelationTimes == pytest.approx([5] * 4, rel=0.2)
    assert result.numSamples == pytest.approx([1500] * 4, rel=0.25) and result.densityOfStates(30).pValue > 0.01


def energiesOf(kT, flipTemperature, samples=8000):
    """Return the energies of an octahedron whose vertices hang on springs, with trajectories and flips, each at a
    temperature: a good part of its energy depends on the triangulation.
    """
    mesh = octahedron()
    edge = mesh.edgeLengths.mean()
    force = softForce(mesh, False)
    force.setBendingModulus(0.15)
    force.setTether(0.03, 0.8 * edge, 1.2 * edge, 2)
    springs = mm.CustomExternalForce("50*((x-x0)^2+(y-y0)^2+(z-z0)^2)")
    for name in ("x0", "y0", "z0"):
        springs.addPerParticleParameter(name)
    for i, x in enumerate(mesh.vertices):
        springs.addParticle(i, x)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(kT), 0.015, 8, 1)
    integrator.setRandomNumberSeed(1 if kT == 1 else 2)
    integrator.getFlipIntegrator().setTemperature(kelvin(flipTemperature))
    context = createContext(mesh, [force, springs], "Reference", integrator)
    integrator.step(300)
    energies = []
    for _ in range(samples):
        integrator.step(4)
        energies.append(energyOf(context))
    assert integrator.getAcceptanceRate() > 0.6 and integrator.getFlipAcceptanceRate() > 0.1
    return energies


@pytest.mark.parametrize("flipTemperature", [1.6, 1.0])
def test_the_temperature_of_flips(flipTemperature):
    """Flips at the temperature of the trajectories sample the density of states, and flips at T = 1, whatever that
    temperature is, do not.
    """
    result = mh.reweight([energiesOf(1.0, 1.0), energiesOf(1.6, flipTemperature)], [kelvin(1.0), kelvin(1.6)])
    deviation, p = (result.ratios[0] - 1) / result.ratioErrors[0], result.densityOfStates(30).pValue
    assert result.ratioErrors[0] < 0.03
    if flipTemperature == 1.6:
        assert abs(deviation) < 3 and p > 0.01
    else:
        assert deviation < -5 and p < 1e-6


@pytest.mark.parametrize(
    "energies, temperatures, problem",
    [
        ([[1, 2, 3]], [300], "two or more, ascending"),
        ([[1, 2], [2, 3]], [300, 200], r"the temperatures \[300, 200\]"),
        ([[1, 2], [2, 3], [3, 4]], [300, 400], "energies of 3 temperatures"),
        ([[1, 2], [2, math.nan]], [300, 400], "energies at temperature 1 .* finite"),
        ([[1, 2, 1], [[2], [3]]], [300, 400], r"temperature 1 have the shape \(2, 1\)"),
        ([[1, 2], [2, 3]], [300, -1], "the temperature is -1"),
        ([[1, 2, 3, 2], [11, 12, 13, 11]], [300, 400], "temperatures 0 and 1 do not overlap"),
    ],
)
def test_bad_input(energies, temperatures, problem):
    with pytest.raises(ValueError, match=problem):
        mh.reweight(energies, temperatures)
