"""Fluctuations of quasi-spherical vesicles, on spherical harmonics."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from openmm import unit
from scipy.spatial import ConvexHull
from scipy.special import j0

from ..display import Brief
from ..optional import dataFrame
from ..units import valueIn, wholeNumber
from .correlation import meanErrorTimes
from .frames import checkedFrames


@dataclass(frozen=True, eq=False, repr=False)
class FluctuationSpectrum(Brief):
    """Fluctuations of a quasi-spherical vesicle, r = R (1 + sum_lm u_lm Y_lm), with its mean radius R.

    Attributes
    ----------
    radius : float
        mean of R over the frames, in nm
    degrees : array of int
        l, from 2
    powers : array of float
        mean of |u_lm|^2 over m and the frames
    errors : array of float
        their standard errors, from the autocorrelation of each degree's |u_lm|^2 along the trajectory; NaN of a
        single frame
    autocorrelationTimes : array of float
        integrated autocorrelation times of the degrees, in frames
    series : (frames, degrees) array of float
        the mean of |u_lm|^2 over m in each frame
    """

    radius: float
    degrees: np.ndarray
    powers: np.ndarray
    errors: np.ndarray
    autocorrelationTimes: np.ndarray
    series: np.ndarray

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each degree."""
        return tableOf(self, "degree", self.degrees)

    def fit(self, minDegree: int = 2, maxDegree: int | None = None, edgeLength: float = 0) -> "SpectrumFit":
        """Fit kT/(kappa (l-1)(l+2)[l(l+1)+sigma]) (Milner and Safran, Phys. Rev. A 36, 4371, 1987).

        The fit is linear: 1/[(l-1)(l+2)<|u_lm|^2>] = (kappa/kT) l(l+1) + (kappa/kT) sigma, weighted by the errors.

        Parameters
        ----------
        minDegree, maxDegree : int
            the degrees to use; at least two of them.  The high ones see the mesh: stay where l is small against pi R
            over the edge length
        edgeLength : float or Quantity
            mean of the mesh's edge lengths, in nm, with which kappa is multiplied by :func:`meshStiffness`; 0 (the
            default) takes the membrane for continuous

        Raises
        ------
        ValueError
            if an argument is out of range
        """
        minDegree = wholeNumber(minDegree, "fit: minDegree", 0)
        maxDegree = wholeNumber(self.degrees[-1] if maxDegree is None else maxDegree, "fit: maxDegree", 0)
        chosen = (self.degrees >= minDegree) & (self.degrees <= maxDegree)
        if chosen.sum() < 2 or not np.all(self.errors[chosen] > 0):
            raise ValueError(
                f"fit: {chosen.sum()} degrees from {minDegree} to {maxDegree}; there must be two or more, with errors "
                "above 0, which take two frames or more"
            )
        l, power, error = self.degrees[chosen], self.powers[chosen], self.errors[chosen]
        y = 1 / ((l - 1) * (l + 2) * power * meshStiffness(l, float(valueIn(edgeLength, unit.nanometer)) / self.radius))
        (kappa, product), covariance = fitLine(l * (l + 1), y, power / (y * error))
        sigma = product / kappa
        slope = np.array([-sigma, 1]) / kappa
        return SpectrumFit(
            float(kappa), math.sqrt(covariance[0, 0]), float(sigma), math.sqrt(slope @ covariance @ slope)
        )


def tableOf(spectrum: Any, head: str, waves: np.ndarray) -> Any:
    """Return a pandas.DataFrame with a row for each group of waves of a spectrum, and what they are under a head."""
    return dataFrame(
        {
            head: waves,
            "power": spectrum.powers,
            "error": spectrum.errors,
            "autocorrelationTime": spectrum.autocorrelationTimes,
        }
    )


def fitLine(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the slope and the height at 0 of the line through points of weights that are one over their errors, and
    the covariance of both.
    """
    design = np.column_stack((x, np.ones(len(x)))) * weight[:, np.newaxis]
    covariance = np.linalg.inv(design.T @ design)
    return covariance @ (design.T @ (y * weight)), covariance


def meshStiffness(degrees: ArrayLike, edgeLength: float) -> np.ndarray:
    """Return by which factor a mesh is softer than a continuous membrane against undulations of a degree.

    The mean curvature of a vertex sees its six neighbors at the distance a: against a wave of the number k it is 4
    [1-J_0(ka)]/a^2 instead of k^2, averaged over directions, and the bending energy the square of that.  On a sphere
    k^2 = (l-1)(l+2)/R^2.  Up to l = 8 the energies of undulated icospheres of 162, 642 and 2,562 vertices follow it to
    3%, 0.8% and 0.3%.

    Parameters
    ----------
    degrees : array of int
        l
    edgeLength : float
        a/R, at most 3.8 over the root of (l-1)(l+2), where the wave is as short as the mesh can have; 0 for a
        continuous membrane
    """
    k = np.sqrt((np.asarray(degrees) - 1) * (np.asarray(degrees) + 2.0))
    if not 0 <= edgeLength <= 3.8 / k.max():
        raise ValueError(
            f"meshStiffness: the edge length over the radius is {edgeLength}; it must be from 0 to {3.8 / k.max():.3g} "
            "for these degrees"
        )
    return softness(k * edgeLength)


def softness(x: np.ndarray) -> np.ndarray:
    """Return the factor of the bending energy of waves on a mesh, at x = ka: see :func:`meshStiffness`."""
    x = np.maximum(x, 1e-3)  # below which the factor is 1, and the formula 0/0
    return (4 * (1 - j0(x)) / x**2) ** 2


@dataclass(frozen=True)
class SpectrumFit:
    """Bending modulus in kT and reduced tension sigma, with standard errors."""

    bendingModulus: float
    bendingModulusError: float
    tension: float
    tensionError: float


def fluctuationSpectrum(frames: ArrayLike, maxDegree: int = 10) -> FluctuationSpectrum:
    """Compute the spectrum of a quasi-spherical vesicle's fluctuations on spherical harmonics.

    In each frame the radii of the vertices, seen from the center of volume, are fitted by spherical harmonics up to a
    degree, by least squares weighted with the solid angle of each vertex.  The triangles are those of the directions'
    convex hull, so that none are needed.

    ::

        random = np.random.default_rng(1)
        frames = mesh.vertices * (1 + 0.01 * random.normal(size=(20, len(mesh.vertices), 1)))
        spectrum = mh.fluctuationSpectrum(frames, maxDegree=6)
        print(spectrum.powers, spectrum.fit(2, 4).bendingModulus)

    Parameters
    ----------
    frames : (n, N, 3) array
        positions, in nm, of a surface that every ray from its center meets once. A single one has powers without errors
    maxDegree : int
        the highest degree to fit, at least 2; (maxDegree+1)^2 coefficients must be fewer than the vertices

    Raises
    ------
    ValueError
        if an argument is out of range, or emcee is not installed, which the extra analysis brings
    """
    frames = checkedFrames(frames)
    maxDegree = wholeNumber(maxDegree, "fluctuationSpectrum: maxDegree", 2)
    if (maxDegree + 1) ** 2 >= frames.shape[1]:
        raise ValueError(
            f"fluctuationSpectrum: maxDegree is {maxDegree}; its {(maxDegree + 1) ** 2} coefficients must "
            f"be fewer than the {frames.shape[1]} vertices"
        )
    degrees = np.arange(2, maxDegree + 1)
    expansions = [_expand(x, maxDegree) for x in frames]
    series = np.array([[np.mean(u[l * l : (l + 1) ** 2] ** 2) for l in degrees] for _, u in expansions])
    mean, error, time = meanErrorTimes(series)
    return FluctuationSpectrum(float(np.mean([radius for radius, _ in expansions])), degrees, mean, error, time, series)


def sphericalHarmonicCoefficients(vertices: ArrayLike, maxDegree: int) -> np.ndarray:
    """Return the coefficients u_lm of r = R (1 + sum_lm u_lm Y_lm) for real, orthonormal spherical harmonics, an array
    in the order l^2+l+m.

    See :func:`fluctuationSpectrum` for the method.  Sums over m of their squares are those of the complex coefficients.
    R is the mean radius, so that u_00 is 0: the radius of the sphere of the same volume differs from it in second
    order, and the volume of a mesh would be too small.
    """
    return _expand(vertices, maxDegree)[1]


def _expand(vertices: ArrayLike, maxDegree: int) -> tuple[float, np.ndarray]:
    """Return R and the coefficients."""
    x = np.asarray(vertices, dtype=float)
    x = x - x.mean(axis=0)
    for _ in range(2):  # the center of volume, and then the triangles seen from there
        triangles = _starTriangles(x)
        a, b, c = (x[triangles[:, i]] for i in range(3))
        volumes = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6
        x = x - np.einsum("t,ti->i", volumes, a + b + c) / (4 * volumes.sum())
    r = np.linalg.norm(x, axis=1)
    directions = x / r[:, np.newaxis]
    harmonics = realHarmonics(directions, maxDegree)
    weighted = harmonics * _solidAngles(directions, triangles)[:, np.newaxis]
    # Nearly orthonormal, so that the normal equations lose nothing and take a fraction of the time.
    coefficients = np.linalg.solve(harmonics.T @ weighted, weighted.T @ r)
    radius = coefficients[0] / math.sqrt(4 * math.pi)
    coefficients[0] = 0
    return radius, coefficients / radius


def _starTriangles(x: np.ndarray) -> np.ndarray:
    """Return the triangles of points' directions from the origin, counter-clockwise seen from outside."""
    directions = x / np.linalg.norm(x, axis=1)[:, np.newaxis]
    triangles = ConvexHull(directions).simplices
    a, b, c = (directions[triangles[:, i]] for i in range(3))
    inwards = np.einsum("ti,ti->t", a, np.cross(b, c)) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return triangles


def _solidAngles(directions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the solid angle of each vertex, a third of that of its triangles (van Oosterom and Strackee, IEEE Trans.

    Biomed. Eng. 30, 125, 1983).
    """
    a, b, c = (directions[triangles[:, i]] for i in range(3))
    triple = np.einsum("ti,ti->t", a, np.cross(b, c))
    angles = 2 * np.arctan2(triple, 1 + np.sum(a * b + b * c + c * a, axis=1))
    return np.bincount(triangles.ravel(), np.repeat(angles / 3, 3), len(directions))


def realHarmonics(directions: np.ndarray, maxDegree: int) -> np.ndarray:
    """Return the real spherical harmonics at directions: an (N, (maxDegree+1)^2) array."""
    try:
        from scipy.special import sph_harm_y
    except ImportError:  # scipy before 1.15
        from scipy.special import sph_harm

        def sph_harm_y(l: int, m: int, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
            return sph_harm(m, l, phi, theta)

    theta, phi = np.arccos(np.clip(directions[:, 2], -1, 1)), np.arctan2(directions[:, 1], directions[:, 0])
    columns = []
    for l in range(maxDegree + 1):
        positive = [math.sqrt(2) * (-1) ** m * sph_harm_y(l, m, theta, phi) for m in range(1, l + 1)]
        columns += (
            [y.imag for y in reversed(positive)] + [sph_harm_y(l, 0, theta, phi).real] + [y.real for y in positive]
        )
    return np.column_stack(columns)
