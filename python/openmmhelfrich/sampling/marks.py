"""How far the vertices of a membrane have come, which some of them tell."""

import numpy as np
import openmm as mm
from numpy.typing import NDArray

from .conditions import positionsOf

# Of so many vertices it is remembered where they were.
MARKS = 100


def markedPositions(context: mm.Context, vertices: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return where some of these vertices are that can move, in nm: an (n, 3) array.

    They are seen from their center, since the whole membrane may drift, unless some particles are held where they are.
    """
    isHeld = heldParticles(context.getSystem())
    free = vertices[~isHeld[vertices]]
    chosen = np.unique(np.linspace(0, len(free) - 1, min(len(free), MARKS)).astype(int))
    positions = positionsOf(context)[free[chosen]]
    return positions if np.any(isHeld) else positions - positions.mean(axis=0)


def heldParticles(system: mm.System) -> NDArray[np.bool_]:
    """Return which particles have no mass, and so stay where they are, unless others carry them."""
    particles = range(system.getNumParticles())
    return np.array([system.getParticleMass(i)._value == 0 and not system.isVirtualSite(i) for i in particles])


def displacement(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Return the root mean square of the ways from some marked positions to later ones, in nm."""
    return float(np.sqrt(((after - before) ** 2).sum(axis=1).mean()))
