"""Reweighting: what simulations at several temperatures say together, and whether one Boltzmann distribution fits them
all.

The energies of a System at the temperature T have the density Omega(E) exp(-E/kT)/Z(T), with one density of states
Omega for all T.  MBAR (M. R. Shirts and J. D. Chodera, J. Chem. Phys. 129, 124105, 2008) finds it from all samples at
once.  If moves of any kind were accepted at a wrong temperature, no Omega would fit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from openmm import unit
from scipy import stats
from scipy.special import expit, logsumexp

from ..display import Brief
from ..optional import dataFrame, require
from ..units import thermalEnergy, wholeNumber
from .correlation import autocorrelationTime

# Fewer counts than these are pooled with others of their bin: chi square needs numbers that are nearly Gaussian.
_LEAST_COUNT = 10


@dataclass(frozen=True, eq=False, repr=False)
class DensityOfStates(Brief):
    """The density of states in bins of energy, from all temperatures together and from each.

    Attributes
    ----------
    energies : (bins,) array of float
        the middle of each bin, in kJ/mol
    logDensity : (bins,) array of float
        ln Omega from all samples, up to a constant
    logDensities, errors : (temperatures, bins) arrays of float
        ln Omega from the histogram of one temperature, and its standard error; NaN where that has fewer than 10 samples
    residuals : (temperatures, bins) array of float
        the deviation of each histogram from the one that is expected of all samples, in standard errors; NaN as before
    chiSquared, degreesOfFreedom, pValue : float
        of the histograms of all temperatures against those expected; p is small if no density of states fits
    """

    energies: np.ndarray
    logDensity: np.ndarray
    logDensities: np.ndarray
    errors: np.ndarray
    residuals: np.ndarray
    chiSquared: float
    degreesOfFreedom: int
    pValue: float


@dataclass(frozen=True, eq=False, repr=False)
class Reweighting(Brief):
    """What the energies at several temperatures say together.

    Attributes
    ----------
    temperatures : (K,) array of float
        in K, ascending
    energies : list of arrays of float
        the samples of each temperature, in kJ/mol, thinned to one in an autocorrelation time
    autocorrelationTimes : (K,) array of float
        integrated autocorrelation times of the series that were given, in their steps
    freeEnergies, freeEnergyErrors : (K,) arrays of float
        -ln Z relative to the lowest temperature, with standard errors
    overlap : (K, K) array of float
        the overlap matrix: how probably a sample of one temperature could be one of another.  Neighbors should have
        0.03 or more (P. V. Klimovich, M. R. Shirts and D. L. Mobley, J. Comput.-Aided Mol. Des. 29, 397, 2015)
    ratios, ratioErrors : (K-1,) arrays of float
        what the energies at each temperature and the next say of 1/kT_i-1/kT_j, divided by what it is, with standard
        errors: 1 if both are Boltzmann distributed
    """

    temperatures: np.ndarray
    energies: list
    autocorrelationTimes: np.ndarray
    freeEnergies: np.ndarray
    freeEnergyErrors: np.ndarray
    overlap: np.ndarray
    ratios: np.ndarray
    ratioErrors: np.ndarray

    @property
    def numSamples(self) -> np.ndarray:
        """The number of independent samples of each temperature."""
        return np.array([len(e) for e in self.energies])

    def meanEnergy(self, temperature: float | unit.Quantity) -> float:
        """Return the mean energy, in kJ/mol, at a temperature in K between those sampled."""
        weights = self._logWeights(np.concatenate(self.energies)) - np.concatenate(self.energies) / thermalEnergy(
            temperature
        )
        return float(np.exp(weights - logsumexp(weights)) @ np.concatenate(self.energies))

    def densityOfStates(self, bins: int = 40) -> DensityOfStates:
        """Compare the histograms of all temperatures, reweighted to one density of states, in bins of equal width.

        Raises a ValueError if their number is no whole number, 1 or more.
        """
        bins = wholeNumber(bins, "densityOfStates: bins", 1)
        pooled = np.concatenate(self.energies)
        edges = np.linspace(pooled.min(), pooled.max(), bins + 1)
        place = np.clip(np.searchsorted(edges, pooled, side="right") - 1, 0, bins - 1)
        counts = np.array([np.histogram(e, edges)[0] for e in self.energies])
        weights = self._logWeights(pooled)
        logDensity = np.array(
            [logsumexp(weights[place == b]) if np.any(place == b) else -math.inf for b in range(bins)]
        ) - math.log(edges[1] - edges[0])
        beta = 1 / np.array([thermalEnergy(t) for t in self.temperatures])
        expected = np.array(
            [
                n * np.bincount(place, np.exp(f - b * pooled + weights), bins)
                for n, f, b in zip(self.numSamples, self.freeEnergies, beta)
            ]
        )
        seen = counts >= _LEAST_COUNT
        with np.errstate(divide="ignore", invalid="ignore"):
            residuals = (counts - expected) / np.sqrt(expected * (1 - expected / expected.sum(axis=0)))
            own = logDensity + np.log(counts / expected)
            errors = 1 / np.sqrt(counts)
        chiSquared, degrees = _chiSquared(counts, expected)
        own, errors, residuals = (np.where(seen, values, np.nan) for values in (own, errors, residuals))
        middles, pValue = (edges[1:] + edges[:-1]) / 2, float(stats.chi2.sf(chiSquared, degrees))
        return DensityOfStates(middles, logDensity, own, errors, residuals, chiSquared, degrees, pValue)

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each temperature; overlap and ratio are those with the next one."""
        last = [math.nan]
        return dataFrame(
            {
                "temperature": self.temperatures,
                "meanEnergy": [e.mean() for e in self.energies],
                "autocorrelationTime": self.autocorrelationTimes,
                "numSamples": self.numSamples,
                "freeEnergy": self.freeEnergies,
                "freeEnergyError": self.freeEnergyErrors,
                "overlap": [*np.diag(self.overlap, 1), *last],
                "ratio": [*self.ratios, *last],
                "ratioError": [*self.ratioErrors, *last],
            }
        )

    def _logWeights(self, energies: np.ndarray) -> np.ndarray:
        """Return the logarithm of the weight of samples in the density of states: MBAR's denominator."""
        terms = [
            math.log(n) + f - energies / thermalEnergy(t)
            for n, f, t in zip(self.numSamples, self.freeEnergies, self.temperatures)
        ]
        return -logsumexp(terms, axis=0)


def reweight(energies: Sequence[Any] | NDArray[Any], temperatures: Sequence[Any] | NDArray[Any]) -> Reweighting:
    """Combine the energies sampled at several temperatures.

    ::

        random = np.random.default_rng(1)
        energies = [random.gamma(50, 0.00831446 * T, size=500) for T in (300, 320)]  # 100 harmonic degrees of freedom
        result = mh.reweight(energies, [300, 320])
        print(result.ratios, result.meanEnergy(310))

    Parameters
    ----------
    energies : sequence of arrays of float
        for each temperature, the potential energy of successive samples, in kJ/mol, without those from before
        equilibrium.  It must be the whole energy that the simulation knows, with its tether and its constraints on area
        and volume
    temperatures : sequence of float or Quantity
        in K, ascending

    Raises
    ------
    ValueError
        if an argument is out of range, neighboring temperatures do not overlap, or pymbar or emcee is not installed
    """
    energies, kT = _checked(energies, temperatures)
    mbar = require("pymbar", "reweighting", "analysis").MBAR
    times = np.array([autocorrelationTime(e) for e in energies])
    thinned = [e[np.arange(0, len(e), time).astype(int)] for e, time in zip(energies, times)]
    ratios = np.array(
        [_betaDifference(thinned[k], thinned[k + 1], k) / (1 / kT[k] - 1 / kT[k + 1]) for k in range(len(kT) - 1)]
    )
    pooled, counts = np.concatenate(thinned), np.array([len(e) for e in thinned])
    # Free energies of thousands of kT, which cancel, would keep MBAR's equations from being solved.
    origin = pooled.mean()
    result = mbar((pooled - origin) / kT[:, np.newaxis], counts, initialize="BAR")
    differences = result.compute_free_energy_differences()
    freeEnergies = differences["Delta_f"][0] + origin * (1 / kT - 1 / kT[0])
    return Reweighting(
        kT / thermalEnergy(1),
        thinned,
        times,
        freeEnergies,
        differences["dDelta_f"][0],
        result.compute_overlap()["matrix"],
        ratios[:, 0],
        ratios[:, 1],
    )


def _betaDifference(cold: np.ndarray, hot: np.ndarray, index: int) -> np.ndarray:
    """Return what two sets of energies say of 1/kT_cold-1/kT_hot, and its standard error, in mol/kJ.

    The probability that an energy is one of the hot ones is logistic in E, and that difference its slope, whatever the
    density of states is: the maximum likelihood of M. R. Shirts, J. Chem. Theory Comput. 9, 909 (2013).
    """
    pooled = np.concatenate((cold, hot))
    center, scale = pooled.mean(), pooled.std()
    isHot = np.repeat([0.0, 1.0], [len(cold), len(hot)])
    design = np.column_stack((np.ones(len(pooled)), (pooled - center) / scale))
    if cold.max() < hot.min():
        raise ValueError(
            f"reweight: the energies at temperatures {index} and {index + 1} do not overlap; there must be "
            "temperatures between them, or more samples"
        )
    parameters = np.zeros(2)
    for _ in range(50):  # Newton's method
        p = expit(design @ parameters)
        hessian = (design * (p * (1 - p))[:, np.newaxis]).T @ design
        change = np.linalg.solve(hessian, design.T @ (isHot - p))
        parameters = parameters + change
        if np.abs(change).max() < 1e-10:
            break
    return np.array([parameters[1], math.sqrt(np.linalg.inv(hessian)[1, 1])]) / scale


def _chiSquared(counts: np.ndarray, expected: np.ndarray) -> tuple[float, int]:
    """Return chi square and its degrees of freedom for the histograms, with the small numbers of each bin taken
    together.
    """
    chiSquared, cells, bins = 0.0, 0, 0
    for n, e in zip(counts.T, expected.T):
        large = e >= _LEAST_COUNT
        n, e = np.append(n[large], n[~large].sum()), np.append(e[large], e[~large].sum())
        n, e = (n, e) if e[-1] >= _LEAST_COUNT / 2 else (n[:-1], e[:-1])
        if len(n) > 1:
            chiSquared += np.sum((n - e) ** 2 / e)
            cells, bins = cells + len(n), bins + 1
    # A density for each bin, and for each temperature but one a free energy, have been fitted.
    return float(chiSquared), max(1, cells - bins - (len(counts) - 1))


def _checked(energies: Any, temperatures: Any) -> tuple[list[np.ndarray], np.ndarray]:
    kT = np.array([thermalEnergy(t) for t in temperatures])
    if len(energies) != len(kT) or len(kT) < 2 or not np.all(np.diff(kT) > 0):
        raise ValueError(
            f"reweight: there are energies of {len(energies)} temperatures, and the temperatures {list(temperatures)}; "
            "there must be as many, two or more, ascending"
        )
    arrays = [np.asarray(e, dtype=float) for e in energies]
    for k, e in enumerate(arrays):
        if e.ndim != 1 or len(e) < 2 or not np.all(np.isfinite(e)):
            raise ValueError(
                f"reweight: the energies at temperature {k} have the shape {e.shape}; they must be two or more finite "
                "numbers in a row"
            )
    return arrays, kT
