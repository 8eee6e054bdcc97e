"""On which side of a plane a point is, decided without rounding errors."""

import numpy as np
from numpy.typing import NDArray

# J. R. Shewchuk, Discrete Comput. Geom. 18, 305 (1997): a determinant that is larger than this part of the sum of its
# terms' sizes has the right sign.
_BOUND = (7 + 56 * 2.0**-53) * 2.0**-53


def orientations(*points: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return 1 where the last of four points is on the side of the plane of the others from which these are clockwise,
    -1 where it is on the other side, and 0 where the four are in a plane, exactly.

    Parameters
    ----------
    points : four (n, 3) arrays
        positions
    """
    a, b, c, d = points
    u, v, w = (a - d).T, (b - d).T, (c - d).T
    terms = [(u[i] * v[j], u[j] * v[i], w[k]) for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))]
    determinant = sum((first - second) * third for first, second, third in terms)
    size = sum((np.abs(first) + np.abs(second)) * np.abs(third) for first, second, third in terms)
    signs = np.sign(determinant).astype(np.int8)
    unsure = np.flatnonzero(np.abs(determinant) <= _BOUND * size)
    if len(unsure):
        signs[unsure] = _exactly(*(each[unsure] for each in points))
    return signs


def _exactly(*points: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return the signs by whole numbers of any size."""
    # All coordinates as multiples of the same power of 2.
    mantissa, exponent = np.frexp(np.array(points))
    shift = exponent - exponent[mantissa != 0].min(initial=0)
    whole = np.ldexp(mantissa, 53).astype(np.int64).astype(object) * (2 ** np.maximum(shift, 0).astype(object))
    u, v, w = (np.moveaxis(whole[i] - whole[3], -1, 0) for i in range(3))
    determinant = (
        (u[0] * v[1] - u[1] * v[0]) * w[2] + (u[1] * v[2] - u[2] * v[1]) * w[0] + (u[2] * v[0] - u[0] * v[2]) * w[1]
    )
    return np.array([(value > 0) - (value < 0) for value in determinant], dtype=np.int8)
