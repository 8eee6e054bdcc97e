"""What correlated series say: means, errors, and correlation times, also those that are longer than the series."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..analysis.correlation import autocorrelationTime

LONGEST_LAG = 1 / 8  # of a series, at which it is seen how far it moves
DECAYED = 1 - 1 / math.e


@dataclass
class SeriesStatistics:
    """Statistics of a correlated series, of which time is the integrated autocorrelation time in Monte Carlo steps, and
    timeError its relative standard error.
    """

    mean: float
    deviation: float
    time: float
    timeError: float
    error: float


@dataclass
class Motion:
    """How far a series moves in a time, from which correlation times follow that are longer than the series.

    The mean square displacement is 2 sigma^2 (1-C(t)).  Where the variance sigma^2 is known, from another run that
    samples the same distribution faster, a lag t at which an observable has not come far says how slowly C decays.  A
    decay exp(-t/T) has an integrated autocorrelation time of 2T; where slower ones mix in, it is more than what comes
    out here.

    Attributes
    ----------
    interval : int
        Monte Carlo steps between values
    length : int
        number of values
    lags : list of int
        in values, each twice the one before
    displacements : list of list of float
        mean square displacements of each column of the series, by lag
    variances : list of float
        of the columns, about their means in the series
    """

    interval: int
    length: int
    lags: list
    displacements: list
    variances: list

    @classmethod
    def of(cls, series: NDArray[np.float64], interval: int = 1) -> "Motion":
        """Return the Motion of an (n, k) array of columns that decay alike."""
        lags = [2**i for i in range(max(1, int(LONGEST_LAG * len(series))).bit_length())]
        displacements = [np.mean((series[lag:] - series[:-lag]) ** 2, axis=0).tolist() for lag in lags]
        return cls(interval, len(series), lags, displacements, series.var(axis=0).tolist())

    def time(self, variances: Sequence[float], variancesError: float) -> tuple[float, float]:
        """Return the integrated autocorrelation time in Monte Carlo steps and its relative standard error, or (inf,
        inf) if nothing moved.

        The lag is the longest one in which the correlation has not fallen to 1/e.  The error of a mean square
        displacement is that of a random walk (H. Qian et al., Biophys. J. 60, 910, 1991).

        Parameters
        ----------
        variances : list of float
            the true ones
        variancesError : float
            their relative standard error
        """
        decayed = np.mean(np.divide(self.displacements, 2 * np.array(variances)), axis=1)
        far = np.flatnonzero(decayed > DECAYED)
        index = len(decayed) - 1 if len(far) == 0 else max(0, far[0] - 1)
        if not 0 < decayed[index] < 1:
            return math.inf, math.inf
        lag, x = self.lags[index], decayed[index]
        error = math.hypot(math.sqrt(4 * lag / (3 * self.length * len(variances))), variancesError)
        return -2 * lag * self.interval / math.log1p(-x), error * x / ((1 - x) * -math.log1p(-x))


def statisticsOf(series: NDArray[np.float64], interval: int = 1) -> SeriesStatistics:
    """Return the :class:`SeriesStatistics` of a series, or of the columns of one that are alike, with as many Monte
    Carlo steps between its values as interval says.
    """
    columns = series.reshape(len(series), -1)
    count = columns.shape[1]
    frames = autocorrelationTime(columns if count > 1 else columns[:, 0])
    deviation = float(np.sqrt(columns.var(axis=0).mean()))
    # A. Sokal's error of a time with a window of five times its length; columns count as independent.
    timeError = math.sqrt(2 * (10 * frames + 1) / (len(series) * count))
    return SeriesStatistics(
        float(columns.mean()),
        deviation,
        frames * interval,
        timeError,
        deviation * math.sqrt(frames / (len(series) * count)),
    )


def shapeSeries(tensors: NDArray[np.float64], isSphere: bool) -> NDArray[np.float64]:
    """Return what stands for the lowest modes of the shape: columns of a series of gyration tensors.

    For a nearly spherical membrane these are the five components of the tensor's deviator, to first order the five
    modes of degree l = 2.  Those of other shapes would turn with them, and the eigenvalues are taken.

    Parameters
    ----------
    tensors : (n, 3, 3) array
        gyration tensors, in nm^2
    isSphere : bool
        whether the membrane is nearly spherical
    """
    if not isSphere:
        return np.asarray(np.linalg.eigvalsh(tensors), dtype=np.float64)
    x, y, z = (tensors[:, i, i] for i in range(3))
    return np.column_stack(
        (tensors[:, 0, 1], tensors[:, 1, 2], tensors[:, 0, 2], (x - y) / 2, (2 * z - x - y) / math.sqrt(12))
    )
