"""Trajectories as arrays of positions."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from openmm import unit

from ..geometry.connectivity import edgeLengthsOf, edgesOf
from ..units import valueIn

_LONG = 4  # median lengths of edges: no edge of a membrane with a tether is so long


def checkedFrames(frames: ArrayLike) -> NDArray[np.float64]:
    """Return positions, in nm, as an (n, N, 3) array; raise a ValueError if they are not such."""
    each: Any = frames
    if isinstance(each, (list, tuple)):  # each may be a Quantity by itself
        each = [valueIn(frame, unit.nanometer) for frame in each]
    try:
        x = np.asarray(valueIn(each, unit.nanometer), dtype=float)
    except (TypeError, ValueError):
        raise ValueError(
            f"the frames are {_inWords(each)}; they must be positions in nm, an array of shape (n, N, 3): of a mesh "
            "trajectory np.array([frame.mesh.vertices for frame in trajectory])"
        ) from None
    if x.ndim != 3 or x.shape[2] != 3 or len(x) == 0:
        raise ValueError(f"the frames have the shape {x.shape}; it must be (n, N, 3), with at least one frame")
    if not np.all(np.isfinite(x)):
        raise ValueError(f"frame {np.argwhere(~np.isfinite(x))[0, 0]} has a coordinate that is not finite")
    return x


def _inWords(frames: Any) -> str:
    """Return what frames are that are no array of numbers."""
    if not isinstance(frames, (list, tuple)):
        return f"a {type(frames).__name__}"
    counts = {len(frame) for frame in frames if isinstance(frame, (np.ndarray, list, tuple))}
    if len(counts) > 1:
        return f"of {min(counts)} to {max(counts)} points"
    return f"a list of {' and '.join(sorted({type(frame).__name__ for frame in frames}))}"


def trianglesOfEach(triangles: ArrayLike, frames: NDArray[np.float64]) -> NDArray[np.integer]:
    """Return the triangles of each of some frames, (n, T, 3), which may be the same for all: (T, 3).

    Raises a ValueError if edges of the first frame are as long as those through the sides of a periodic box.
    """
    each = np.broadcast_to(np.asarray(triangles), (len(frames), *np.shape(triangles)[-2:]))
    lengths = edgeLengthsOf(frames[0], edgesOf(each[0], frames.shape[1]))
    longest, usual = lengths.max(initial=0), np.median(lengths) if len(lengths) else 0
    if longest > max(_LONG * usual, 0.4 * np.ptp(frames[0], axis=0).max()):
        raise ValueError(
            f"an edge is {longest:.4g} nm long, and the median {usual:.4g} nm, as in a periodic box; this takes closed "
            "surfaces that are not folded into one"
        )
    return each
