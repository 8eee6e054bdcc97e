"""Diffusion of vertices along the surface."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ..display import Brief
from ..optional import dataFrame
from ..units import wholeNumber
from .frames import checkedFrames, trianglesOfEach


@dataclass(frozen=True, eq=False, repr=False)
class Diffusion(Brief):
    """Mean squared displacement of vertices along the surface, in nm^2, against the lag, in frames: 4D times the lag
    where they diffuse.
    """

    lags: np.ndarray
    meanSquaredDisplacements: np.ndarray

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each lag."""
        return dataFrame({"lag": self.lags, "meanSquaredDisplacement": self.meanSquaredDisplacements})


def vertexDiffusion(frames: ArrayLike, triangles: ArrayLike, maxLag: int | None = None) -> Diffusion:
    """Compute how far vertices move along the surface.

    Displacements are those that remain when the translation and rotation of the whole surface between two frames is
    taken out, projected to the tangent plane at the earlier position.  They must be small against the radius of the
    surface.

    ::

        random = np.random.default_rng(1)
        frames = mesh.vertices + np.cumsum(0.001 * random.normal(size=(20, *mesh.vertices.shape)), axis=0)
        diffusion = mh.vertexDiffusion(frames, mesh.triangles)
        print(diffusion.lags, diffusion.meanSquaredDisplacements)

    Parameters
    ----------
    frames : (n, N, 3) array
        positions, in nm
    triangles : (T, 3) or (n, T, 3) array of int
        the triangles of all frames, or of each: they give the normals
    maxLag : int
        the greatest lag, in frames; by default a quarter of their number
    """
    x = checkedFrames(frames)
    maxLag = max(1, len(x) // 4) if maxLag is None else maxLag
    maxLag = wholeNumber(maxLag, f"vertexDiffusion: of {len(x)} frames maxLag", 1, len(x) - 1)
    x = x - x.mean(axis=1, keepdims=True)
    normals = [_vertexNormals(frame, t) for frame, t in zip(x, trianglesOfEach(triangles, x))]

    def displacement(lag: int) -> float:
        return float(np.mean([_tangentialSquare(x[n], x[n + lag], normals[n]) for n in range(len(x) - lag)]))

    lags = np.arange(1, maxLag + 1)
    return Diffusion(lags, np.array([displacement(lag) for lag in lags.tolist()]))


def _tangentialSquare(start: np.ndarray, end: np.ndarray, normals: np.ndarray) -> float:
    rotation, _ = Rotation.align_vectors(start, end)
    displacement = rotation.apply(end) - start
    return float(np.mean(np.sum(displacement**2, axis=1) - np.sum(displacement * normals, axis=1) ** 2))


def _vertexNormals(x: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (x[triangles[:, i]] for i in range(3))
    normals, faces = np.zeros_like(x), np.cross(b - a, c - a)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], faces)
    return normals / np.linalg.norm(normals, axis=1)[:, np.newaxis]
