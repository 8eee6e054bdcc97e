"""The coarser meshes of setMultilevelWeight() as matrices, for what is not a trajectory."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

# A surface that has so few vertices has no coarser mesh, and one of a coarser mesh none that is coarser yet.
_LEAST, _LEAST_COARSE = 4, 48


@dataclass(frozen=True)
class CoarseMeshes:
    """How vertices of coarser meshes move those of a mesh: by B y, with a vector for each vertex of every level in y.

    The meshes are those of HamiltonianTrajectoryIntegrator.setMultilevelWeight().  Where a smooth wave of wave number q
    is concerned, B B^T is proportional to 1/q^2 with a weight of 1, and to 1/q^4 with 4: near the inverse of an elastic
    energy.

    Attributes
    ----------
    prolongations : list of scipy.sparse.csr_matrix
        from each level to the next finer one
    scales : array of float
        the factor of each level, the square root of its weight
    sizes : list of int
        the number of vertices of each level, the mesh itself first
    surfaces : array of int
        for each vertex of the mesh the number of the connected surface that it is on
    """

    prolongations: list
    scales: np.ndarray
    sizes: list
    surfaces: np.ndarray

    @property
    def size(self) -> int:
        """The number of vertices of all levels."""
        return sum(self.sizes)

    def move(self, y: np.ndarray) -> np.ndarray:
        """Return B y, an (N, 3) array, of vectors of all levels."""
        levels = np.split(y.reshape(-1, 3), np.cumsum(self.sizes)[:-1])
        motion = self.scales[-1] * levels[-1]
        for prolongation, scale, level in zip(self.prolongations[::-1], self.scales[-2::-1], levels[-2::-1]):
            motion = prolongation @ motion + scale * level
        return motion

    def gather(self, vectors: np.ndarray) -> np.ndarray:
        """Return B^T of (N, 3) vectors, of all levels one after the other."""
        levels = [self.scales[0] * vectors]
        for prolongation, scale in zip(self.prolongations, self.scales[1:]):
            vectors = prolongation.T @ vectors
            levels.append(scale * vectors)
        return np.concatenate(levels)


def makeCoarseMeshes(triangles: np.ndarray, numVertices: int, weight: float, isFixed: np.ndarray) -> CoarseMeshes:
    """Return the coarser meshes of a mesh.

    Parameters
    ----------
    triangles : (T, 3) array of int
        numbers of vertices
    numVertices : int
        the number of vertices; those that no triangle has move by themselves alone
    weight : float
        the weight of a level, as a multiple of that of the next finer one
    isFixed : (N,) array of bool
        vertices that do not move
    """
    ends = np.roll(triangles, -1, axis=1).ravel()
    bonds = sparse.coo_matrix((np.ones(triangles.size), (triangles.ravel(), ends)), (numVertices, numVertices))
    bonds = ((bonds + bonds.T) > 0).astype(float).tocsr()
    surfaces = ofVertices = connected_components(bonds)[1]
    prolongations: list[sparse.csr_matrix] = []
    sizes = [numVertices]
    while True:
        isLarge = np.bincount(surfaces)[surfaces] > (_LEAST_COARSE if prolongations else _LEAST)
        joined, chosen = _join(bonds, isLarge)
        if len(chosen) == 0:
            break
        n, m = sizes[-1], len(chosen)
        select = sparse.coo_matrix((np.ones(m), (chosen, np.arange(m))), (n, m)).tocsr()
        steps = bonds + sparse.identity(n)
        ways = steps @ (steps @ select)
        totals = np.asarray(ways.sum(axis=1)).ravel()
        moving = np.ones(n) if prolongations else (~isFixed).astype(float)
        prolongations.append((sparse.diags(moving / np.maximum(totals, 1)) @ ways).tocsr())
        member = np.flatnonzero(joined >= 0)
        members = sparse.coo_matrix((np.ones(len(member)), (member, joined[member])), (n, m)).tocsr()
        bonds = (members.T @ bonds @ members).tolil()
        bonds.setdiag(0)
        bonds = (bonds.tocsr() > 0).astype(float)
        surfaces = surfaces[chosen]
        sizes.append(m)
    return CoarseMeshes(prolongations, weight ** (0.5 * np.arange(len(sizes))), sizes, ofVertices)


def _join(bonds: sparse.csr_matrix, isLarge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each vertex the number of the chosen one that it joined, -1 for none, and the chosen ones."""
    starts, neighbors, large = bonds.indptr.tolist(), bonds.indices.tolist(), isLarge.tolist()
    joined: list[int] = [-1] * len(large)
    chosen: list[int] = []
    for i in range(len(large)):
        if joined[i] < 0 and large[i]:
            joined[i] = len(chosen)
            for neighbor in neighbors[starts[i] : starts[i + 1]]:
                if joined[neighbor] < 0:
                    joined[neighbor] = len(chosen)
            chosen.append(i)
    return np.array(joined), np.array(chosen, int)
