"""Starts from whose symmetry forces do not lead, and the ways out of it."""

import numpy as np

# What differs by rounding, also that of files in single precision, as a part of the whole.
_ROUNDING = 1e-6
# How far vertices move out of a symmetry, in mean edge lengths: steep penalties held some spheres at a tenth.
_OUT = 0.3


def displacementsOut(positions: np.ndarray, forces: np.ndarray, triangles: np.ndarray, length: float) -> np.ndarray:
    """Return displacements that lengthen a surface whose positions and forces have the symmetry of a regular solid, or
    zeros for any other.

    No such forces lengthen it: it would stay as long as wide and high, as an icosphere does, and end in dents.  The
    axis is in no plane of symmetry.

    Parameters
    ----------
    positions, forces : array
        of the vertices of a closed surface, of shape (N, 3)
    triangles : array of int
        the numbers of the corners of its triangles among the vertices, of shape (T, 3)
    length : float
        the mean edge length
    """
    arms = positions - positions.mean(axis=0)
    radii = np.linalg.norm(arms, axis=1)
    if not (_isIsotropic(arms, arms) and _isIsotropic(forces, arms) and np.all(radii > 0)):
        return np.zeros(positions.shape)
    directions = arms / radii[:, np.newaxis]
    axis = np.array([3.0, 2.0, 1.0]) @ directions[triangles[0]]
    cosines = directions @ (axis / np.linalg.norm(axis))
    return _OUT * length * (1.5 * cosines**2 - 0.5)[:, np.newaxis] * directions


def bendsOut(positions: np.ndarray, sides: np.ndarray, box: np.ndarray) -> list[np.ndarray]:
    """Return displacements that bend a flat sheet, or none for any other surface: by the longest wave of its box, of
    size 1; and by a bump to either side, which has an area difference, of size 3, as that grows with the cube.

    No force leads out of the plane, where the energy may have a saddle.

    Parameters
    ----------
    positions : array
        of the vertices of a periodic surface, of shape (N, 3)
    sides : array
        the vectors along the sides of its triangles, of shape (T, 3, 3)
    box : array
        the vectors of the box, of shape (3, 3)
    """
    normals = np.cross(sides[:, 0], sides[:, 1])
    sizes = np.linalg.norm(normals, axis=1)
    normal = normals.sum(axis=0) / sizes.sum()
    if np.linalg.norm(normal) < 1 - _ROUNDING:
        return []
    waves = np.linalg.inv(box).T
    inPlane = [wave for wave in waves if np.linalg.norm(np.cross(wave, normal)) > 0.5 * np.linalg.norm(wave)]
    longest = min(inPlane, key=lambda wave: float(np.linalg.norm(wave)))
    bump = 3 * np.exp(sum(np.cos(2 * np.pi * positions @ wave) - 1 for wave in inPlane))
    heights = np.cos(2 * np.pi * positions @ longest), bump, -bump
    return [height[:, np.newaxis] * normal for height in heights]


def _isIsotropic(vectors: np.ndarray, arms: np.ndarray) -> bool:
    """Return whether the symmetric part of the sum of products of vectors and arms is a multiple of the identity."""
    products = vectors.T @ arms
    eigenvalues = np.linalg.eigvalsh((products + products.T) / 2)
    return bool(np.ptp(eigenvalues) <= _ROUNDING * np.linalg.norm(vectors) * np.linalg.norm(arms))
