"""Fluctuations of periodic sheets, on plane waves."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from openmm import unit

from ..display import Brief
from ..units import valueIn
from .correlation import meanErrorTimes
from .fluctuations import fitLine, softness, tableOf
from .frames import checkedFrames


@dataclass(frozen=True, eq=False, repr=False)
class HeightSpectrum(Brief):
    """Fluctuations of a periodic sheet, z = sum_q h_q exp(i q.r) over the waves that fit into the box.

    Attributes
    ----------
    area : float
        of the box across the sheet, in nm^2
    waveNumbers : array of float
        q of each group of waves that are equally long, in 1/nm, ascending
    powers : array of float
        mean of |h_q|^2 over the waves of a group and the frames, in nm^2
    errors : array of float
        their standard errors, from the autocorrelation of each group's |h_q|^2 along the trajectory; NaN of a
        single frame
    autocorrelationTimes : array of float
        integrated autocorrelation times of the groups, in frames
    series : (frames, groups) array of float
        the mean of |h_q|^2 over the waves of a group in each frame
    """

    area: float
    waveNumbers: np.ndarray
    powers: np.ndarray
    errors: np.ndarray
    autocorrelationTimes: np.ndarray
    series: np.ndarray

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each wave number."""
        return tableOf(self, "waveNumber", self.waveNumbers)

    def theory(
        self, waveNumbers: ArrayLike, bendingModulus: float, tension: float = 0, edgeLength: Any = 0
    ) -> NDArray[np.float64]:
        """Return what the powers should be: kT/(A (kappa q^4 + sigma q^2)).

        Parameters
        ----------
        waveNumbers : array of float
            q, in 1/nm
        bendingModulus, tension : float
            kappa in kT, and sigma in kT/nm^2
        edgeLength : float or Quantity
            see :meth:`fit`

        Returns
        -------
        (n,) array
            mean |h_q|^2, in nm^2
        """
        q = np.asarray(waveNumbers, dtype=float)
        bending = bendingModulus * softness(q * float(valueIn(edgeLength, unit.nanometer))) * q**4
        return 1 / (self.area * (bending + tension * q**2))

    def fit(self, maxWaveNumber: float | unit.Quantity = math.inf, edgeLength: Any = 0) -> "HeightFit":
        """Fit kT/(A (kappa q^4 + sigma q^2)) (Helfrich, Z. Naturforsch. 33a, 305, 1978).

        The fit is linear: 1/(A q^2 <|h_q|^2>) = (kappa/kT) q^2 + sigma/kT, weighted by the errors.

        Parameters
        ----------
        maxWaveNumber : float or Quantity
            the greatest wave number to use, in 1/nm; at least two must be left
        edgeLength : float or Quantity
            mean of the mesh's edge lengths, in nm, a: a mesh is softer than a continuous membrane, by the factor
            (4 [1-J_0(qa)]/(qa)^2)^2 of :func:`meshStiffness`; 0 (the default) takes it for continuous

        Raises
        ------
        ValueError
            if an argument is out of range
        """
        most = float(valueIn(maxWaveNumber, unit.nanometer**-1))
        chosen = self.waveNumbers <= most * (1 + 1e-9)
        if chosen.sum() < 2 or not np.all(self.errors[chosen] > 0):
            raise ValueError(
                f"fit: {chosen.sum()} wave numbers up to {most:g} per nm; there must be two or more, with errors "
                "above 0, which take two frames or more"
            )
        q, power, error = self.waveNumbers[chosen], self.powers[chosen], self.errors[chosen]
        y = 1 / (self.area * q**2 * power)
        bending = q**2 * softness(q * float(valueIn(edgeLength, unit.nanometer)))
        (kappa, sigma), covariance = fitLine(bending, y, power / (y * error))
        return HeightFit(float(kappa), math.sqrt(covariance[0, 0]), float(sigma), math.sqrt(covariance[1, 1]))


@dataclass(frozen=True)
class HeightFit:
    """Bending modulus in kT and tension in kT/nm^2, with standard errors."""

    bendingModulus: float
    bendingModulusError: float
    tension: float
    tensionError: float


def heightSpectrum(frames: ArrayLike, box: Any, maxWaveNumber: Any = None) -> HeightSpectrum:
    """Compute the spectrum of a periodic sheet's heights over the x-y plane, on the waves that fit into its box.

    In each frame the heights of the vertices are fitted by plane waves, by least squares.  It does not matter in which
    image of the box a vertex is, nor are triangles needed.

    ::

        sheet, random = mh.Mesh.sheet(12, 12, 1.0), np.random.default_rng(1)
        frames = sheet.vertices + 0.1 * random.normal(size=(20, len(sheet.vertices), 3))
        spectrum = mh.heightSpectrum(frames, sheet.box)
        print(spectrum.waveNumbers, spectrum.powers)

    Parameters
    ----------
    frames : (n, N, 3) array
        positions, in nm, of a sheet without overhangs. A single one has powers without errors
    box : (3, 3) array, three lengths, or Quantity
        the periodic box, rectangular, in nm
    maxWaveNumber : float or Quantity, optional
        the greatest wave number to fit, in 1/nm; by default such that there are eight vertices for each wave

    Raises
    ------
    ValueError
        if an argument is out of range, or the vertices are too few for the waves
    """
    frames = checkedFrames(frames)
    lengths = _lengthsOf(box)
    most = (
        math.sqrt(math.pi * frames.shape[1] / (2 * lengths[0] * lengths[1]))
        if maxWaveNumber is None
        else float(valueIn(maxWaveNumber, unit.nanometer**-1))
    )
    if not (math.isfinite(most) and most > 0):
        raise ValueError(f"heightSpectrum: maxWaveNumber is {most:g}; it must be positive and finite")
    waves = _waves(lengths, most)
    if len(waves) == 0 or 2 * len(waves) + 1 >= frames.shape[1]:
        raise ValueError(
            f"heightSpectrum: maxWaveNumber is {most:g}; that asks for {2 * len(waves)} waves, which must be at least "
            f"one and fewer than the {frames.shape[1]} vertices"
        )
    sizes = np.linalg.norm(waves, axis=1)
    numbers, group = np.unique(np.round(sizes / sizes[0], 9), return_inverse=True)
    each = np.array([_powers(x, waves, lengths) for x in frames])
    series = np.array([each[:, group == g].mean(axis=1) for g in range(len(numbers))]).T
    mean, error, time = meanErrorTimes(series)
    return HeightSpectrum(float(lengths[0] * lengths[1]), numbers * sizes[0], mean, error, time, series)


def _lengthsOf(box: Any) -> NDArray[np.float64]:
    if isinstance(box, (list, tuple)):  # the vectors of a System are Quantities, each by itself
        box = [valueIn(vector, unit.nanometer) for vector in box]
    values = np.asarray(valueIn(box, unit.nanometer), dtype=float)
    lengths = np.diag(values) if values.shape == (3, 3) else values
    isPositive = lengths.shape == (3,) and np.all(np.isfinite(lengths) & (lengths > 0))
    if not isPositive or (values.ndim == 2 and np.any(values != np.diag(lengths))):
        raise ValueError(f"heightSpectrum: the box is {values.tolist()}; it must be rectangular, with positive sides")
    return lengths


def _waves(lengths: NDArray[np.float64], most: float) -> NDArray[np.float64]:
    """Return the wave vectors up to a wave number, one of each and its opposite, by their lengths."""
    counts = np.floor(most * (1 + 1e-9) * lengths[:2] / (2 * np.pi)).astype(int)
    i, j = (n.ravel() for n in np.mgrid[0 : counts[0] + 1, -counts[1] : counts[1] + 1])
    isFirst = (i > 0) | (j > 0)
    vectors = 2 * np.pi * np.column_stack((i, j))[isFirst] / lengths[:2]
    sizes = np.linalg.norm(vectors, axis=1)
    return vectors[np.argsort(sizes, kind="stable")][: int(np.sum(sizes <= most * (1 + 1e-9)))]


def _powers(x: NDArray[np.float64], waves: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return |h_q|^2 of each wave, where a wave's amplitudes of sine and cosine are 2 Re h_q and 2 Im h_q."""
    z = x[:, 2] - x[0, 2]
    z -= lengths[2] * np.rint(z / lengths[2])
    phases = x[:, :2] @ waves.T
    design = np.column_stack((np.ones(len(x)), np.cos(phases), np.sin(phases)))
    coefficients, _, rank, _ = np.linalg.lstsq(design, z, rcond=None)
    if rank < design.shape[1]:
        raise ValueError(
            f"heightSpectrum: the vertices tell no more than {rank} of {design.shape[1]} coefficients of the waves; "
            "they must be all over the x-y plane, or maxWaveNumber less"
        )
    return np.sum(coefficients[1:].reshape(2, -1) ** 2, axis=0) / 4
