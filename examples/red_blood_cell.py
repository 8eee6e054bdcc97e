"""Make red_blood_cell.stl, the outline of a resting human red blood cell as a closed mesh in micrometers.

The outline is the average one of E. Evans and Y. C. Fung, "Improved measurements of the erythrocyte geometry",
Microvascular Research 4, 335 (1972): a body of revolution of diameter D whose half-thickness at distance r from the
axis is, with s = 2r/D, z = sqrt(1-s^2) (C0 + C1 s^2 + C2 s^4) / 2.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from openmmhelfrich import Mesh

D, C0, C1, C2 = 7.82, 0.81, 7.83, -4.39  # micrometers


def profile(u):
    """Return (r, z) on the outline, where s = sin(u): u = 0 is the upper pole and u = pi the lower one."""
    s = np.sin(u)
    return np.column_stack((D / 2 * s, np.cos(u) * (C0 + C1 * s**2 + C2 * s**4) / 2))


def wrap(sphere, outline):
    """Map the vertices of a unit sphere to the cell so that equal areas go to equal areas."""
    step = np.linalg.norm(np.diff(outline, axis=0), axis=1)
    ring = step * (outline[1:, 0] + outline[:-1, 0])  # the area of each ring of the body, but for a factor pi
    fraction = np.concatenate(([0], np.cumsum(ring))) / ring.sum()
    place = np.interp((1 - sphere[:, 2]) / 2, fraction, np.arange(len(outline)))
    r, z = (np.interp(place, np.arange(len(outline)), column) for column in outline.T)
    axis = np.hypot(sphere[:, 0], sphere[:, 1])
    around = np.divide(
        sphere[:, :2], axis[:, np.newaxis], out=np.zeros_like(sphere[:, :2]), where=axis[:, np.newaxis] > 0
    )
    return np.column_stack((r[:, np.newaxis] * around, z))


def areaOf(outline):
    """Return the area of the body of revolution."""
    return np.pi * np.sum(np.linalg.norm(np.diff(outline, axis=0), axis=1) * (outline[1:, 0] + outline[:-1, 0]))


def relax(x, edges, outline, steps=200):
    """Even out the triangles: every edge is a spring that pulls towards the mean length, and vertices stay on the
    surface.
    """
    tree = KDTree(outline)
    a, b = edges.T
    for _ in range(steps):
        d = x[b] - x[a]
        length = np.linalg.norm(d, axis=1)
        pull = 0.15 * d * (1 - length.mean() / length)[:, np.newaxis]
        for i in range(3):
            x[:, i] += np.bincount(a, pull[:, i], len(x)) - np.bincount(b, pull[:, i], len(x))
        axis = np.hypot(x[:, 0], x[:, 1])
        r, z = outline[tree.query(np.column_stack((axis, x[:, 2])))[1]].T
        x[:, :2] *= np.divide(r, axis, out=np.zeros_like(r), where=axis > 0)[:, np.newaxis]
        x[:, 2] = z
    return x


def makeCell(subdivisions=4):
    """Return the cell as a Mesh of 10*4^subdivisions+2 vertices, 1 nm of which stands for 1 um."""
    outline = profile(np.linspace(0, np.pi, 100001))
    sphere = Mesh.icosphere(subdivisions)
    cell = Mesh(relax(wrap(sphere.vertices, outline), sphere.edges, outline), sphere.triangles)
    cell.vertices *= np.sqrt(areaOf(outline) / cell.area)  # flat triangles cut corners: 0.09% at 2562 vertices
    cell.check()
    return cell


if __name__ == "__main__":
    file = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".stl"))
    cell = makeCell()
    cell.write(file)
    print(
        f"{file}: {len(cell.vertices)} vertices, area {cell.area:.2f} um^2, volume {cell.volume:.2f} um^3, "
        f"edges {cell.edgeLengths.min():.3f} to {cell.edgeLengths.max():.3f} um"
    )
