"""Names of atoms and an order of bonds that files of OpenMM keep."""

import numpy as np
from numpy.typing import NDArray

_ROUNDS = 1000
_DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"
_LETTERS = "VWXYZABCDEFGHIJKLMNOPQRSTU"


def nameOf(index: int) -> str:
    """Return the name of the atom of a vertex, unlike all others: a PDB file has one atom of each name in a residue.

    It has four letters and digits, which is all that a PDB file has room for, up to 1.2 million vertices: V000, V001.
    """
    block, rest = divmod(index, 36**3)
    if block >= len(_LETTERS):
        return f"V{index}"
    return _LETTERS[block] + _DIGITS[rest // 36**2] + _DIGITS[rest // 36 % 36] + _DIGITS[rest % 36]


def orderOfBonds(edges: NDArray[np.integer], numVertices: int) -> NDArray[np.integer]:
    """Return the edges in an order in which PDB files keep all as bonds: their own, if that will do.

    OpenMM's PDBFile writes three bonds of an atom with more than four and leaves out the fourth, again and again.  That
    is no loss where the other atom's record has the bond.  Those that neither would have go to one end or the other, at
    random, which puts others in their place: within some rounds none is left.
    """
    random = np.random.default_rng(0)
    for _ in range(_ROUNDS):
        isLost = np.all(_isLeftOut(edges, numVertices), axis=1)
        if not isLost.any():
            break
        place = np.where(isLost, random.integers(-1, 2, len(edges)), 0)
        edges = edges[np.argsort(place, kind="stable")]
    return edges


def _isLeftOut(edges: NDArray[np.integer], numVertices: int) -> NDArray[np.bool_]:
    """Return for either end of each bond whether the record of that atom leaves it out: an (E, 2) array."""
    ends = edges.ravel()
    counts = np.bincount(ends, minlength=numVertices)
    order = np.argsort(ends, kind="stable")
    rank = np.empty(len(ends), dtype=np.int64)
    rank[order] = np.arange(len(ends)) - np.repeat(np.cumsum(counts) - counts, counts)
    return ((rank % 4 == 3) & (rank < counts[ends] - 1)).reshape(-1, 2)
