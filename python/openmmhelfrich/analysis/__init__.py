"""What shapes and trajectories of membranes say: size and form, fluctuations, correlation in time, diffusion.

Trajectories are arrays of positions of shape (frames, N, 3), in nm, wherever they come from: ``mdtraj.load_dcd(...).xyz`` is one.  Functions that need triangles take
one set for all frames or one for each; a DCD file has none, so that those of a fluid membrane come from a MeshReporter's file.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Optional

import numpy as np
from openmm import unit
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from scipy.special import j0

from ..geometry.mesh import Mesh
from ..optional import dataFrame, require
from ..units import valueIn


@dataclass(frozen=True, eq=False)
class ShapeDescription:
    """Size and form of a closed surface.

    Attributes
    ----------
    area, volume : float
        A, in nm^2, and V, in nm^3
    reducedVolume : float
        v = 6 sqrt(pi) V/A^(3/2), 1 for a sphere
    reducedAreaDifference : float
        M/(4 pi R_A), with the integrated mean curvature M and R_A = sqrt(A/4 pi): 1 for a sphere (Seifert, Berndl and Lipowsky, Phys. Rev. A 44, 1182, 1991)
    gyrationTensor : (3, 3) array of float
        S = 1/A int (x-c)(x-c)^T dA over the triangles, with their centre of area c, in nm^2
    radiusOfGyration : float
        sqrt(tr S), in nm
    asphericity : float
        l_1-(l_2+l_3)/2 with the eigenvalues l_1 >= l_2 >= l_3 of S, in nm^2 (Theodorou and Suter, Macromolecules 18, 1206, 1985)
    relativeShapeAnisotropy : float
        1-3 (l_1 l_2+l_2 l_3+l_3 l_1)/(tr S)^2: 0 for a sphere, 1 for points on a line (the same source)
    shapeClass : str
        "sphere", "prolate", "oblate", "stomatocyte" or "budded": see :func:`classifyShape`
    """

    area: float
    volume: float
    reducedVolume: float
    reducedAreaDifference: float
    gyrationTensor: np.ndarray
    radiusOfGyration: float
    asphericity: float
    relativeShapeAnisotropy: float
    shapeClass: str


def describeShape(mesh: Mesh) -> ShapeDescription:
    """Return size and form of a closed mesh."""
    tensor = gyrationTensor(mesh)
    l3, l2, l1 = np.linalg.eigvalsh(tensor)
    trace = l1 + l2 + l3
    return ShapeDescription(
        mesh.area,
        mesh.volume,
        mesh.reducedVolume,
        reducedAreaDifference(mesh),
        tensor,
        math.sqrt(trace),
        float(l1 - (l2 + l3) / 2),
        float(1 - 3 * (l1 * l2 + l2 * l3 + l3 * l1) / trace**2),
        classifyShape(mesh),
    )


def describeTrajectory(frames: Iterable, triangles) -> list:
    """Return the :class:`ShapeDescription` of each frame.

    Parameters
    ----------
    frames : (n, N, 3) array
        positions, in nm
    triangles : (T, 3) or (n, T, 3) array of int
        the triangles of all frames, or of each
    """
    frames = _frames(frames)
    triangles = np.broadcast_to(triangles, (len(frames), *np.shape(triangles)[-2:]))
    return [describeShape(Mesh(x, t)) for x, t in zip(frames, triangles)]


def toDataFrame(descriptions):
    """Return a pandas.DataFrame with a row for each :class:`ShapeDescription`, without the tensors."""
    return dataFrame(
        [{name: value for name, value in vars(d).items() if name != "gyrationTensor"} for d in descriptions]
    )


def reducedAreaDifference(mesh: Mesh) -> float:
    """Return M/(4 pi R_A) of a closed mesh: see :class:`ShapeDescription`."""
    return float(mesh.vertexMeanCurvatures.sum() / (4 * math.pi * math.sqrt(mesh.area / (4 * math.pi))))


def gyrationTensor(mesh: Mesh) -> np.ndarray:
    """Return the gyration tensor of a surface, (3, 3) in nm^2: the integral over its flat triangles is exact.  See :class:`ShapeDescription`."""
    corners, areas = mesh.vertices[mesh.triangles], mesh.triangleAreas
    corners = corners - np.average(corners.mean(axis=1), axis=0, weights=areas)
    sums = corners.sum(axis=1)
    moments = np.einsum("tci,tcj->tij", corners, corners) + np.einsum("ti,tj->tij", sums, sums)
    return np.einsum("t,tij->ij", areas, moments) / (12 * areas.sum())


def classifyShape(mesh: Mesh) -> str:
    """Name the form of a closed, connected surface.

    With the square roots a >= b >= c of the gyration tensor's eigenvalues, the first of these that applies:

    - "stomatocyte": the reduced area difference is below 0.8.  Along the axisymmetric branches it is at most 0.51 for stomatocytes, and above 1.02 for oblates and prolates
    - "budded": along the longest axis there is a neck, a place at which the mean distance of the surface from the axis is less than half of its greatest
      value on either side
    - "sphere": c > 0.9 a
    - "prolate": a-b > b-c
    - "oblate": otherwise
    """
    if reducedAreaDifference(mesh) < 0.8:
        return "stomatocyte"
    values, axes = np.linalg.eigh(gyrationTensor(mesh))
    if _hasNeck(mesh, axes[:, 2]):
        return "budded"
    c, b, a = np.sqrt(values)
    if c > 0.9 * a:
        return "sphere"
    return "prolate" if a - b > b - c else "oblate"


def _hasNeck(mesh, axis):
    """Return whether the distance from an axis through the centre has a minimum below half of the maxima on either side."""
    x = mesh.vertices - np.average(mesh.vertices, axis=0, weights=mesh.vertexAreas)
    height = x @ axis
    distance = np.linalg.norm(x - np.outer(height, axis), axis=1)
    # As wide as two edges, so that none is empty, and not so wide that it hides a neck.
    bins = max(8, int(np.ptp(height) / (2 * mesh.edgeLengths.mean())))
    place = np.minimum(((height - height.min()) / np.ptp(height) * bins).astype(int), bins - 1)
    weight = np.bincount(place, mesh.vertexAreas, bins)
    filled = weight > 0
    profile = np.bincount(place, mesh.vertexAreas * distance, bins)[filled] / weight[filled]
    before, after = np.maximum.accumulate(profile), np.maximum.accumulate(profile[::-1])[::-1]
    return bool(np.any(profile < 0.5 * np.minimum(before, after)))


@dataclass(frozen=True, eq=False)
class FluctuationSpectrum:
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
        their standard errors, from the autocorrelation of each degree's |u_lm|^2 along the trajectory
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

    def toDataFrame(self):
        """Return a pandas.DataFrame with a row for each degree."""
        return dataFrame(
            {
                "degree": self.degrees,
                "power": self.powers,
                "error": self.errors,
                "autocorrelationTime": self.autocorrelationTimes,
            }
        )

    def fit(self, minDegree: int = 2, maxDegree: int | None = None, edgeLength: float = 0) -> "SpectrumFit":
        """Fit kT/(kappa (l-1)(l+2)[l(l+1)+sigma]) (Milner and Safran, Phys. Rev. A 36, 4371, 1987).

        The fit is linear: 1/[(l-1)(l+2)<|u_lm|^2>] = (kappa/kT) l(l+1) + (kappa/kT) sigma, weighted by the errors.

        Parameters
        ----------
        minDegree, maxDegree : int
            the degrees to use; at least two of them.  The high ones see the mesh: stay where l is small against pi R over the edge length
        edgeLength : float or Quantity
            mean of the mesh's edge lengths, in nm, with which kappa is multiplied by :func:`meshStiffness`; 0 (the default) takes the membrane for continuous

        Raises
        ------
        ValueError
            if an argument is out of range
        """
        maxDegree = self.degrees[-1] if maxDegree is None else maxDegree
        chosen = (self.degrees >= minDegree) & (self.degrees <= maxDegree)
        if chosen.sum() < 2 or not np.all(self.errors[chosen] > 0):
            raise ValueError(
                f"fit: {chosen.sum()} degrees from {minDegree} to {maxDegree}; there must be two or more, with errors that are not 0"
            )
        l, power, error = self.degrees[chosen], self.powers[chosen], self.errors[chosen]
        y = 1 / ((l - 1) * (l + 2) * power * meshStiffness(l, float(valueIn(edgeLength, unit.nanometer)) / self.radius))
        weight = power / (y * error)
        design = np.column_stack((l * (l + 1), np.ones(len(l)))) * weight[:, np.newaxis]
        covariance = np.linalg.inv(design.T @ design)
        kappa, product = covariance @ (design.T @ (y * weight))
        sigma = product / kappa
        slope = np.array([-sigma, 1]) / kappa
        return SpectrumFit(
            float(kappa), math.sqrt(covariance[0, 0]), float(sigma), math.sqrt(slope @ covariance @ slope)
        )


def meshStiffness(degrees, edgeLength: float) -> np.ndarray:
    """Return by which factor a mesh is softer than a continuous membrane against undulations of a degree.

    The mean curvature of a vertex sees its six neighbours at the distance a: against a wave of the number k it is 4 [1-J_0(ka)]/a^2 instead of k^2, averaged over directions, and
    the bending energy the square of that.  On a sphere k^2 = (l-1)(l+2)/R^2.  Up to l = 8 the energies of undulated icospheres of 162, 642 and 2,562
    vertices follow it to 3%, 0.8% and 0.3%.

    Parameters
    ----------
    degrees : array of int
        l
    edgeLength : float
        a/R, at most 3.8 over the root of (l-1)(l+2), where the wave is as short as the mesh can have; 0 for a continuous membrane
    """
    k = np.sqrt((np.asarray(degrees) - 1) * (np.asarray(degrees) + 2.0))
    if not 0 <= edgeLength <= 3.8 / k.max():
        raise ValueError(
            f"meshStiffness: the edge length over the radius is {edgeLength}; it must be from 0 to {3.8 / k.max():.3g} for these degrees"
        )
    x = np.maximum(k * edgeLength, 1e-3)  # below which the factor is 1, and the formula 0/0
    return (4 * (1 - j0(x)) / x**2) ** 2


@dataclass(frozen=True)
class SpectrumFit:
    """Bending modulus in kT and reduced tension sigma, with standard errors."""

    bendingModulus: float
    bendingModulusError: float
    tension: float
    tensionError: float


def fluctuationSpectrum(frames, maxDegree: int = 10) -> FluctuationSpectrum:
    """Compute the spectrum of a quasi-spherical vesicle's fluctuations on spherical harmonics.

    In each frame the radii of the vertices, seen from the centre of volume, are fitted by spherical harmonics up to a degree, by least squares weighted with
    the solid angle of each vertex.  The triangles are those of the directions' convex hull, so that none are needed.

    Parameters
    ----------
    frames : (n, N, 3) array
        positions, in nm, of a surface that every ray from its centre meets once
    maxDegree : int
        the highest degree to fit, at least 2; (maxDegree+1)^2 coefficients must be fewer than the vertices

    Raises
    ------
    ValueError
        if an argument is out of range
    """
    frames = _frames(frames)
    if maxDegree < 2 or (maxDegree + 1) ** 2 >= frames.shape[1]:
        raise ValueError(
            f"fluctuationSpectrum: maxDegree is {maxDegree}; it must be at least 2, and its {(maxDegree + 1) ** 2} coefficients fewer than the {frames.shape[1]} vertices"
        )
    degrees = np.arange(2, maxDegree + 1)
    expansions = [_expand(x, maxDegree) for x in frames]
    series = np.array([[np.mean(u[l * l : (l + 1) ** 2] ** 2) for l in degrees] for _, u in expansions])
    mean, error, time = np.array([_meanErrorTime(column) for column in series.T]).T
    return FluctuationSpectrum(float(np.mean([radius for radius, _ in expansions])), degrees, mean, error, time, series)


def sphericalHarmonicCoefficients(vertices, maxDegree: int) -> np.ndarray:
    """Return the coefficients u_lm of r = R (1 + sum_lm u_lm Y_lm) for real, orthonormal spherical harmonics, an array in the order l^2+l+m.

    See :func:`fluctuationSpectrum` for the method.  Sums over m of their squares are those of the complex coefficients.  R is the mean radius, so that u_00 is 0: the radius
    of the sphere of the same volume differs from it in second order, and the volume of a mesh would be too small.
    """
    return _expand(vertices, maxDegree)[1]


def _expand(vertices, maxDegree):
    """Return R and the coefficients."""
    x = np.asarray(vertices, dtype=float)
    x = x - x.mean(axis=0)
    for _ in range(2):  # the centre of volume, and then the triangles seen from there
        triangles = _starTriangles(x)
        a, b, c = (x[triangles[:, i]] for i in range(3))
        volumes = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6
        x = x - np.einsum("t,ti->i", volumes, a + b + c) / (4 * volumes.sum())
    r = np.linalg.norm(x, axis=1)
    directions = x / r[:, np.newaxis]
    harmonics = _realHarmonics(directions, maxDegree)
    weighted = harmonics * _solidAngles(directions, triangles)[:, np.newaxis]
    # Nearly orthonormal, so that the normal equations lose nothing and take a fraction of the time.
    coefficients = np.linalg.solve(harmonics.T @ weighted, weighted.T @ r)
    radius = coefficients[0] / math.sqrt(4 * math.pi)
    coefficients[0] = 0
    return radius, coefficients / radius


def _starTriangles(x):
    """Return the triangles of points' directions from the origin, counter-clockwise seen from outside."""
    directions = x / np.linalg.norm(x, axis=1)[:, np.newaxis]
    triangles = ConvexHull(directions).simplices
    a, b, c = (directions[triangles[:, i]] for i in range(3))
    inwards = np.einsum("ti,ti->t", a, np.cross(b, c)) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return triangles


def _solidAngles(directions, triangles):
    """Return the solid angle of each vertex, a third of that of its triangles (van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 125, 1983)."""
    a, b, c = (directions[triangles[:, i]] for i in range(3))
    triple = np.einsum("ti,ti->t", a, np.cross(b, c))
    angles = 2 * np.arctan2(triple, 1 + np.sum(a * b + b * c + c * a, axis=1))
    return np.bincount(triangles.ravel(), np.repeat(angles / 3, 3), len(directions))


def _realHarmonics(directions, maxDegree):
    """Return the real spherical harmonics at directions: an (N, (maxDegree+1)^2) array."""
    try:
        from scipy.special import sph_harm_y
    except ImportError:  # scipy before 1.15
        from scipy.special import sph_harm

        def sph_harm_y(l, m, theta, phi):
            return sph_harm(m, l, phi, theta)

    theta, phi = np.arccos(np.clip(directions[:, 2], -1, 1)), np.arctan2(directions[:, 1], directions[:, 0])
    columns = []
    for l in range(maxDegree + 1):
        positive = [math.sqrt(2) * (-1) ** m * sph_harm_y(l, m, theta, phi) for m in range(1, l + 1)]
        columns += (
            [y.imag for y in reversed(positive)] + [sph_harm_y(l, 0, theta, phi).real] + [y.real for y in positive]
        )
    return np.column_stack(columns)


def autocorrelationTime(series) -> float:
    """Return the integrated autocorrelation time 1 + 2 sum_t rho(t) of a series, in its steps: 1 if its values are independent.

    emcee computes it, with A. Sokal's automatic window.  Below some fifty times as many values as the result it is an underestimate.  Of the columns of an (n, k) array,
    which must be alike, the autocorrelation functions are averaged first.

    Raises
    ------
    ValueError
        if the series has fewer than two values, or one that is not finite, or emcee is not installed
    """
    series = np.asarray(series, dtype=float)
    if series.ndim not in (1, 2) or len(series) < 2 or not np.all(np.isfinite(series)):
        raise ValueError(
            f"autocorrelationTime: the series has the shape {series.shape}; it must be two or more finite numbers in a row"
        )
    if np.any(np.ptp(series, axis=0) == 0):
        return 1.0
    autocorr = require("emcee.autocorr", "computing autocorrelation times", "analysis")
    return max(1.0, float(autocorr.integrated_time(series, tol=0)[0]))


def meanAndError(series) -> tuple:
    """Return the mean of a correlated series and its standard error, s sqrt(tau/n) with the integrated autocorrelation time tau."""
    return _meanErrorTime(series)[:2]


def _meanErrorTime(series):
    series = np.asarray(series, dtype=float)
    if len(series) < 2:
        return float(series.mean()), math.nan, math.nan
    time = autocorrelationTime(series)
    return float(series.mean()), float(series.std(ddof=1) * math.sqrt(time / len(series))), time


@dataclass(frozen=True, eq=False)
class Diffusion:
    """Mean squared displacement of vertices along the surface, in nm^2, against the lag, in frames: 4D times the lag where they diffuse."""

    lags: np.ndarray
    meanSquaredDisplacements: np.ndarray

    def toDataFrame(self):
        """Return a pandas.DataFrame with a row for each lag."""
        return dataFrame({"lag": self.lags, "meanSquaredDisplacement": self.meanSquaredDisplacements})


def vertexDiffusion(frames, triangles, maxLag: int | None = None) -> Diffusion:
    """Compute how far vertices move along the surface.

    Displacements are those that remain when the translation and rotation of the whole surface between two frames is taken out, projected to the tangent plane at the
    earlier position.  They must be small against the radius of the surface.

    Parameters
    ----------
    frames : (n, N, 3) array
        positions, in nm
    triangles : (T, 3) or (n, T, 3) array of int
        the triangles of all frames, or of each: they give the normals
    maxLag : int
        the greatest lag, in frames; by default a quarter of their number
    """
    frames = _frames(frames)
    maxLag = max(1, len(frames) // 4) if maxLag is None else maxLag
    if not 1 <= maxLag < len(frames):
        raise ValueError(
            f"vertexDiffusion: maxLag is {maxLag}; it must be from 1 to {len(frames) - 1}, for {len(frames)} frames"
        )
    frames = frames - frames.mean(axis=1, keepdims=True)
    triangles = np.broadcast_to(triangles, (len(frames), *np.shape(triangles)[-2:]))
    normals = [_vertexNormals(x, t) for x, t in zip(frames, triangles)]
    lags = np.arange(1, maxLag + 1)
    return Diffusion(
        lags,
        np.array(
            [
                np.mean([_tangentialSquare(frames[n], frames[n + lag], normals[n]) for n in range(len(frames) - lag)])
                for lag in lags
            ]
        ),
    )


def _tangentialSquare(start, end, normals):
    rotation, _ = Rotation.align_vectors(start, end)
    displacement = rotation.apply(end) - start
    return np.mean(np.sum(displacement**2, axis=1) - np.sum(displacement * normals, axis=1) ** 2)


def _vertexNormals(x, triangles):
    a, b, c = (x[triangles[:, i]] for i in range(3))
    normals, faces = np.zeros_like(x), np.cross(b - a, c - a)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], faces)
    return normals / np.linalg.norm(normals, axis=1)[:, np.newaxis]


def _frames(frames):
    frames = np.asarray(valueIn(frames, unit.nanometer), dtype=float)
    if frames.ndim != 3 or frames.shape[2] != 3 or len(frames) == 0:
        raise ValueError(f"the frames have the shape {frames.shape}; it must be (n, N, 3), with at least one frame")
    if not np.all(np.isfinite(frames)):
        raise ValueError(f"frame {np.argwhere(~np.isfinite(frames))[0, 0]} has a coordinate that is not finite")
    return frames
