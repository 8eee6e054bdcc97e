"""Trajectories as arrays of positions."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from openmm import unit

from ..units import valueIn


def checkedFrames(frames: ArrayLike) -> NDArray[np.float64]:
    """Return positions, in nm, as an (n, N, 3) array; raise a ValueError if they are not such."""
    x = np.asarray(valueIn(frames, unit.nanometer), dtype=float)
    if x.ndim != 3 or x.shape[2] != 3 or len(x) == 0:
        raise ValueError(f"the frames have the shape {x.shape}; it must be (n, N, 3), with at least one frame")
    if not np.all(np.isfinite(x)):
        raise ValueError(f"frame {np.argwhere(~np.isfinite(x))[0, 0]} has a coordinate that is not finite")
    return x


def trianglesOfEach(triangles: ArrayLike, count: int) -> NDArray[np.integer]:
    """Return the triangles of each of a number of frames, (n, T, 3), which may be the same for all: (T, 3)."""
    return np.broadcast_to(np.asarray(triangles), (count, *np.shape(triangles)[-2:]))
