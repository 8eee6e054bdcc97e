"""How far the vertices of a membrane have come, which some of them tell."""

import numpy as np
import openmm as mm
from numpy.typing import NDArray

from .conditions import positionsOf

# Of so many vertices it is remembered where they were.
MARKS = 100


def markedPositions(context: mm.Context, vertices: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return where some of these vertices are, in nm: an (n, 3) array."""
    chosen = np.unique(np.linspace(0, len(vertices) - 1, min(len(vertices), MARKS)).astype(int))
    return positionsOf(context)[vertices[chosen]]


def displacement(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Return the root mean square of the ways from some positions to others, without that of all, in nm."""
    moved = after - before
    moved -= moved.mean(axis=0)  # the whole membrane may drift
    return float(np.sqrt((moved**2).sum(axis=1).mean()))
