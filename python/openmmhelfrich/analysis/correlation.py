"""Correlation in time: autocorrelation times, means and their errors."""

import math

import numpy as np
from numpy.typing import ArrayLike

from ..optional import require


def autocorrelationTime(series: ArrayLike) -> float:
    """Return the integrated autocorrelation time 1 + 2 sum_t rho(t) of a series, in its steps: 1 if its values are
    independent.

    emcee computes it, with A. Sokal's automatic window.  Below some fifty times as many values as the result it is an
    underestimate.  Of the columns of an (n, k) array, which must be alike, the autocorrelation functions are averaged
    first.

    ::

        tau = mh.autocorrelationTime(np.random.default_rng(1).normal(size=1000))  # about 1

    Parameters
    ----------
    series : (n,) or (n, k) array
        values one after the other, or columns of such

    Raises
    ------
    ValueError
        if the series has fewer than two values, or one that is not finite, or emcee is not installed
    """
    series = np.asarray(series, dtype=float)
    if series.ndim not in (1, 2) or len(series) < 2 or not np.all(np.isfinite(series)):
        raise ValueError(
            f"autocorrelationTime: the series has the shape {series.shape}; it must be two or more finite numbers in a "
            "row"
        )
    if np.any(np.ptp(series, axis=0) == 0):
        return 1.0
    autocorr = require("emcee.autocorr", "computing autocorrelation times", "analysis")
    return max(1.0, float(autocorr.integrated_time(series, tol=0)[0]))


def meanAndError(series: ArrayLike) -> tuple:
    """Return the mean of a correlated series and its standard error, s sqrt(tau/n) with the integrated autocorrelation
    time tau.

    ::

        mean, error = mh.meanAndError(np.random.default_rng(1).normal(size=1000))

    Parameters
    ----------
    series : (n,) array
        values one after the other, in any unit, which is that of both results

    Raises
    ------
    ValueError
        as for :func:`autocorrelationTime`
    """
    return _meanErrorTime(series)[:2]


def meanErrorTimes(series: np.ndarray) -> np.ndarray:
    """Return the means of the columns of an array, their standard errors and autocorrelation times: a (3, k) array."""
    return np.array([_meanErrorTime(column) for column in series.T]).T


def _meanErrorTime(series: ArrayLike) -> tuple[float, float, float]:
    series = np.asarray(series, dtype=float)
    if len(series) < 2:
        return float(series.mean()), math.nan, math.nan
    time = autocorrelationTime(series)
    return float(series.mean()), float(series.std(ddof=1) * math.sqrt(time / len(series))), time
