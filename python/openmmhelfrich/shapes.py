"""Meshes of simple shapes to begin with, or to test against."""
import math

import numpy as np
import openmm as mm
from scipy.optimize import brentq
from scipy.spatial import ConvexHull, KDTree

from .helfrich import EdgeFlipIntegrator, HelfrichForce
from .mesh import Mesh, reducedVolume


def surfaceOfRevolution(outline, numVertices: int, rounds: int = 100) -> Mesh:
    """Create a closed surface of revolution about the z axis, of nearly equal edges.

    The vertices begin on a spiral of the golden angle, at equal areas.  Then every edge is a spring that pulls towards the mean length, edges flip where that
    makes them shorter, and vertices stay on the surface.

    Parameters
    ----------
    outline : (n, 2) array
        distance from the axis and height of points of the outline, in nm, close together, from one pole to the other; both poles are on the axis, and
        z falls at the first, whose outside is up
    numVertices : int
        the number of vertices, at least 12
    rounds : int
        how often the vertices move

    Raises
    ------
    ValueError
        if an argument is out of range
    """
    outline = np.array(outline, dtype=float)
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3 or not np.all(np.isfinite(outline)):
        raise ValueError(f"surfaceOfRevolution: the outline has the shape {outline.shape}; it must be finite and of shape (n, 2), with at least 3 points")
    if np.any(outline[1:-1, 0] <= 0) or np.any(np.abs(outline[[0, -1], 0]) > 1e-9*outline[:, 0].max()):
        raise ValueError("surfaceOfRevolution: the outline must begin and end on the axis, and touch it nowhere else")
    if numVertices < 12:
        raise ValueError(f"surfaceOfRevolution: numVertices is {numVertices}; it must be at least 12")
    outline[[0, -1], 0] = 0
    x, flip, tree = _spiral(outline, numVertices), _EdgeShortener(numVertices), KDTree(outline)
    triangles = flip(x, sweeps=20)
    for _ in range(rounds):
        x = _project(_evenOut(x, Mesh(x, triangles).edges), outline, tree)
        triangles = flip(x, sweeps=2)
    return Mesh(x, triangles)


def spheroid(numVertices: int, aspectRatio: float, area: float = 4*math.pi) -> Mesh:
    """Create a spheroid of nearly equal edges about the z axis.

    Parameters
    ----------
    numVertices : int
        the number of vertices, at least 12
    aspectRatio : float
        length along the axis over width: above 1 the spheroid is prolate, below 1 oblate; see :func:`spheroidAspectRatio`
    area : float
        the area of the triangles, in nm^2; by default that of a unit sphere

    Raises
    ------
    ValueError
        if an argument is out of range
    """
    if not 0.02 <= aspectRatio <= 50 or not (math.isfinite(area) and area > 0):
        raise ValueError(f"spheroid: aspectRatio is {aspectRatio} and area {area}; they must be from 0.02 to 50, and positive")
    u = np.linspace(0, np.pi, 20001)
    mesh = surfaceOfRevolution(np.column_stack((np.sin(u), aspectRatio*np.cos(u))), numVertices)
    mesh.vertices *= math.sqrt(area/mesh.area)
    return mesh


def spheroidAspectRatio(reducedVolume: float, kind: str) -> float:
    """Return the aspect ratio of the "prolate" or "oblate" spheroid that has a reduced volume."""
    ranges = {"prolate": (1.0, 50.0), "oblate": (0.02, 1.0)}
    if kind not in ranges:
        raise ValueError(f"spheroidAspectRatio: kind is '{kind}'; it must be 'prolate' or 'oblate'")
    low, high = ranges[kind]
    least = _spheroidReducedVolume(high if kind == "prolate" else low)
    if not least < reducedVolume <= 1:
        raise ValueError(f"spheroidAspectRatio: reducedVolume is {reducedVolume}; it must be above {least:.3f} and at most 1")
    return 1.0 if reducedVolume == 1 else brentq(lambda a: _spheroidReducedVolume(a)-reducedVolume, low, high)


def _spheroidReducedVolume(a):
    e = math.sqrt(1-min(a, 1/a)**2)
    if e < 1e-6:
        return 1.0
    area = 2*math.pi*(1+a/e*math.asin(e) if a > 1 else 1+a*a/e*math.atanh(e))
    return reducedVolume(area, 4*math.pi/3*a)


def _goldenAngles(number):
    return np.arange(number)*np.pi*(3-math.sqrt(5))


def _spiral(outline, number):
    """Return points on a surface of revolution, each of an equal part of the area, a golden angle from one to the next."""
    part = np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1)*(outline[1:, 0]+outline[:-1, 0]))
    fraction = np.concatenate(([0], part/part[-1]))
    r, z = (np.interp((np.arange(number)+0.5)/number, fraction, column) for column in outline.T)
    angle = _goldenAngles(number)
    return np.column_stack((r*np.cos(angle), r*np.sin(angle), z))


def _evenOut(x, edges):
    """Move vertices along their edges, as springs that pull towards the mean length do."""
    a, b = edges.T
    edge = x[b]-x[a]
    length = np.linalg.norm(edge, axis=1)
    pull = 0.1*edge*(1-length.mean()/length)[:, np.newaxis]
    return x+np.column_stack([np.bincount(a, pull[:, i], len(x))-np.bincount(b, pull[:, i], len(x)) for i in range(3)])


def _project(x, outline, tree):
    """Move points to the nearest of the surface of revolution."""
    axis = np.hypot(x[:, 0], x[:, 1])
    r, z = outline[tree.query(np.column_stack((axis, x[:, 2])))[1]].T
    scale = np.divide(r, axis, out=np.zeros_like(r), where=axis > 0)
    return np.column_stack((x[:, 0]*scale, x[:, 1]*scale, z))


class _EdgeShortener:
    """Keeps the triangles of a sphere's golden spiral, and flips edges where that makes them shorter."""

    def __init__(self, numVertices):
        height = 1-2*(np.arange(numVertices)+0.5)/numVertices
        r, angle = np.sqrt(1-height**2), _goldenAngles(numVertices)
        points = np.column_stack((r*np.cos(angle), r*np.sin(angle), height))
        triangles = ConvexHull(points).simplices
        a, b, c = (points[triangles[:, i]] for i in range(3))
        inwards = np.einsum("ti,ti->t", np.cross(b-a, c-a), a) < 0
        triangles[inwards] = triangles[inwards][:, ::-1]
        self._force = HelfrichForce()
        self._force.setTriangles(triangles)
        self._force.setTether(1, 1e-12, 2e-12, 2)  # in effect the sum of squares of the edges' lengths
        system = Mesh(points, triangles).createSystem()
        system.addForce(self._force)
        self._flips = EdgeFlipIntegrator(0, 1)
        self._flips.setRandomNumberSeed(1)
        self._context = mm.Context(system, self._flips, mm.Platform.getPlatform("Reference"))

    def __call__(self, x, sweeps):
        self._context.setPositions(x)
        self._flips.step(sweeps)
        return self._force.getTrianglesInContext(self._context)
