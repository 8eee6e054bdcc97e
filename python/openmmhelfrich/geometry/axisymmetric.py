"""Vesicles of least bending energy among surfaces of revolution: the numbers to compare minimum shapes of triangles
with.

Nothing here uses triangles.  The outline is its tangent angle psi(s), a sine series in the arc length s, and the
bending energy of the surface that it sweeps is minimized at fixed reduced volume (U. Seifert, K. Berndl and R.
Lipowsky, Phys. Rev. A 44, 1182 (1991), solve the Euler-Lagrange equations of the same energy).
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import optimize
from scipy.integrate import cumulative_simpson

from ..display import Brief
from .measures import reducedVolume as reducedVolumeOf
from .shapes import invaginatedSphere, spheroidAspectRatio

BRANCHES = ("prolate", "oblate", "stomatocyte")
_LEAST, _MOST = 0.3, {"prolate": 0.98, "oblate": 0.98, "stomatocyte": 0.65}
_MODES, _NODES = 128, 320


@dataclass(frozen=True, eq=False, repr=False)
class AxisymmetricShape(Brief):
    """An axisymmetric vesicle of area 4 pi.

    Attributes
    ----------
    energy : float
        the bending energy over 8 pi kappa_B
    areaDifference : float
        the reduced area difference: the integral of the mean curvature over 4 pi; 1 for a sphere
    outline : (n, 2) array
        distance from the axis and height of points of the outline, from one pole to the other, as
        :func:`surfaceOfRevolution` takes it.  The two poles of a thin oblate may have passed through each other (below
        v = 0.503): nothing here keeps a membrane from that
    """

    energy: float
    areaDifference: float
    outline: np.ndarray


@lru_cache
def axisymmetricMinimum(branch: str, reducedVolume: float) -> AxisymmetricShape:
    """Return the minimum of the bending energy among axisymmetric shapes of a branch at a reduced volume.

    ::

        minimum = mh.axisymmetricMinimum("oblate", 0.65)
        print(minimum.energy)  # over 8 pi kappa_B

    Parameters
    ----------
    branch : str
        "prolate" and "oblate", which are as high above their equator as below, or "stomatocyte"
    reducedVolume : float
        from 0.3 to 0.98, of stomatocytes to 0.65

    Raises
    ------
    ValueError
        if an argument is out of range, or no minimum was found
    """
    requireBranch(branch, reducedVolume)
    series = _TangentAngle(symmetric=branch != "stomatocyte")
    start = series.coefficients(
        _invaginated(reducedVolume) if branch == "stomatocyte" else _spheroid(branch, reducedVolume)
    )
    found = optimize.minimize(
        series.energy,
        start,
        jac=True,
        method="SLSQP",
        options={"maxiter": 1000, "ftol": 1e-12},
        constraints={
            "type": "eq",
            "fun": lambda c: series.constraints(c, reducedVolume)[0],
            "jac": lambda c: series.constraints(c, reducedVolume)[1],
        },
    )
    if not found.success:
        raise ValueError(
            f"axisymmetricMinimum: no {branch} was found at the reduced volume {reducedVolume}: {found.message}"
        )
    return series.shape(found.x)


def requireBranch(branch: str, reducedVolume: float) -> None:
    """Raise a ValueError if there is no such branch, or not at a reduced volume."""
    if branch not in BRANCHES:
        raise ValueError(f"axisymmetricMinimum: branch is '{branch}'; it must be one of {', '.join(BRANCHES)}")
    if not _LEAST <= reducedVolume <= _MOST[branch]:
        raise ValueError(
            f"axisymmetricMinimum: reducedVolume is {reducedVolume}; for the branch {branch} it must be from {_LEAST} "
            f"to {_MOST[branch]}"
        )


class _TangentAngle:
    """The outlines psi(s) = pi s + sum_k c_k sin(k pi s)/k of length 1, and their energy and constraints with
    derivatives with respect to c.

    The energy does not depend on the scale.  With the factor 1/k it is about as steep in every coefficient.  Integrals
    over s are sums over the nodes of a Gauss-Legendre rule, which leaves out the poles, where 0 is divided by 0.  The
    second pole is on the axis only if the constraints hold; until then a small part of its distance is taken off
    everywhere, so that the energy is finite.
    """

    def __init__(self, symmetric: bool) -> None:
        self._symmetric = symmetric
        self._modes = np.arange(2, _MODES + 1, 2) if symmetric else np.arange(1, _MODES + 1)
        t, weights = np.polynomial.legendre.leggauss(_NODES)
        self._s, self._w = (t + 1) / 2, weights / 2
        self._sines, self._cosines = self._basis(self._s)
        self._distance = _integrals(t, weights) / 2 - np.outer(self._s**3, self._w)

    def coefficients(self, outline: np.ndarray) -> np.ndarray:
        """Return the coefficients of a given outline, without the short waves of its corners."""
        step = np.diff(outline, axis=0)
        length = np.cumsum(np.hypot(*step.T))
        psi = np.interp(self._s, length / length[-1], np.unwrap(np.arctan2(-step[:, 1], step[:, 0])))
        return (
            2
            * self._modes
            * ((self._w * (psi - np.pi * self._s)) @ (self._sines * self._modes))
            * np.exp(-((self._modes / 30) ** 2))
        )

    def energy(self, c: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the bending energy over 8 pi kappa_B, (1/8) integral of (psi' + sin(psi)/x)^2 x ds."""
        psi, slope, x, dx = self._curve(c)
        if x.min() <= 0:  # a step of the line search that went too far
            return 1e3, np.zeros(len(c))
        sine, curvature = np.sin(psi), slope + np.sin(psi) / x
        gradient = (2 * self._w * curvature * x) @ (
            self._cosines + (np.cos(psi) / x)[:, np.newaxis] * self._sines - (sine / x**2)[:, np.newaxis] * dx
        ) + (self._w * curvature**2) @ dx
        return self._w @ (curvature**2 * x) / 8, gradient / 8

    def constraints(self, c: np.ndarray, reducedVolume: float) -> tuple[list[float], list[np.ndarray]]:
        """Return the excess of the reduced volume, and, where symmetry does not see to it, how far the second pole is
        from the axis.
        """
        psi, _, x, dx = self._curve(c)
        # A step that goes too far may even have a negative one.
        area, dArea = (
            2 * np.pi * max(self._w @ x, 1e-3),
            2 * np.pi * self._w @ dx,
        )
        volume = np.pi * self._w @ (x**2 * np.sin(psi))
        dVolume = np.pi * ((2 * self._w * x * np.sin(psi)) @ dx + (self._w * x**2 * np.cos(psi)) @ self._sines)
        v = reducedVolumeOf(area, volume)
        values, rows = (
            [v - reducedVolume, self._w @ np.cos(psi)],
            [v * (dVolume / volume - 1.5 * dArea / area), -(self._w * np.sin(psi)) @ self._sines],
        )
        return (values[:1], rows[:1]) if self._symmetric else (values, rows)

    def shape(self, c: np.ndarray, points: int = 8001) -> AxisymmetricShape:
        psi, slope, x, _ = self._curve(c)
        radius = math.sqrt(self._w @ x / 2)
        s = np.linspace(0, 1, points)
        psis = np.pi * s + self._basis(s)[0] @ c
        outline = (
            np.column_stack(
                (cumulative_simpson(np.cos(psis), x=s, initial=0), -cumulative_simpson(np.sin(psis), x=s, initial=0))
            )
            / radius
        )
        outline[-1, 0] = 0
        outline.setflags(write=False)  # minima are kept for whoever asks again
        return AxisymmetricShape(
            float(self.energy(c)[0]), float(self._w @ (slope * x + np.sin(psi)) / (4 * radius)), outline
        )

    def _curve(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        psi = np.pi * self._s + self._sines @ c
        return (
            psi,
            np.pi + self._cosines @ c,
            self._distance @ np.cos(psi),
            -self._distance @ (np.sin(psi)[:, np.newaxis] * self._sines),
        )

    def _basis(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        waves = np.pi * np.outer(s, self._modes)
        return np.sin(waves) / self._modes, np.pi * np.cos(waves)


def _integrals(t: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the matrix that takes values at the nodes of a Gauss-Legendre rule to integrals from -1 to each node."""
    legendre = np.polynomial.legendre
    degrees = np.arange(len(t))
    toSeries = (legendre.legvander(t, len(t) - 1) * weights[:, np.newaxis]).T * (degrees + 0.5)[:, np.newaxis]
    return legendre.legval(t, legendre.legint(np.eye(len(t)), lbnd=-1)).T @ toSeries


def _spheroid(kind: str, reducedVolume: float) -> np.ndarray:
    u = np.linspace(0, np.pi, 4001)
    return np.column_stack((np.sin(u), spheroidAspectRatio(reducedVolume, kind) * np.cos(u)))


def _invaginated(reducedVolume: float) -> np.ndarray:
    return invaginatedSphere(
        optimize.brentq(lambda r: (1 - r**3) / (1 + r**2) ** 1.5 - reducedVolume, 0.01, 0.99), opening=0.35
    )
