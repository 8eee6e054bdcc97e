"""Triangulated membranes: made, read, written, checked, and handed to OpenMM."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import openmm as mm
from numpy.typing import ArrayLike, NDArray
from openmm import app, unit

from ..files import PathLike
from ..units import valueIn
from . import connectivity, meshfiles
from .measures import reducedVolume
from .topology import MeshTopology

Length: TypeAlias = unit.Unit | unit.Quantity | float


class Mesh:
    """A triangulated surface.

    Attributes
    ----------
    vertices : (N, 3) float64 array
        positions, in nm
    triangles : (T, 3) int32 array
        the vertices of each triangle, counter-clockwise seen from outside
    """

    def __init__(self, vertices: Any, triangles: ArrayLike):
        """Create a Mesh from arrays, which are copied.

        Parameters
        ----------
        vertices : (N, 3) array or Quantity
            positions, in nm unless they carry a unit
        triangles : (T, 3) array of integers
            the vertices of each triangle, counter-clockwise seen from outside

        Raises
        ------
        ValueError
            if a shape or type is wrong, a coordinate is not finite, or an index is out of range.  Whether the
            triangles form a closed surface is :meth:`check`'s question.
        """
        self.vertices = _floats(valueIn(vertices, unit.nanometer))
        self.triangles = _indices(triangles, len(self.vertices))

    @classmethod
    def icosphere(cls, subdivisions: int = 3, radius: float | unit.Quantity = 1.0) -> "Mesh":
        """Create a sphere by subdividing an icosahedron's triangles in four and projecting the new vertices.

        Parameters
        ----------
        subdivisions : int
            how often, n; the sphere has 10*4^n+2 vertices
        radius : float or Quantity
            its radius, in nm
        """
        if subdivisions < 0 or subdivisions != int(subdivisions):
            raise ValueError(f"icosphere: subdivisions is {subdivisions}; it must be a whole number, 0 or more")
        radius = _inUnit(radius, unit.nanometer)
        if not (math.isfinite(radius) and radius > 0):
            raise ValueError(f"icosphere: radius is {radius}; it must be positive")
        vertices, triangles = _icosahedron()
        for _ in range(int(subdivisions)):
            vertices, triangles = _subdivide(vertices, triangles)
            vertices /= np.linalg.norm(vertices, axis=1)[:, np.newaxis]
        return cls(radius * vertices, triangles)

    @classmethod
    def read(cls, file: PathLike, unit: Length = unit.nanometer) -> "Mesh":
        """Read a mesh from a file.

        The suffix of its name tells the format: STL, PLY, OBJ, OFF, VTU, VTK, GMSH (.msh) and every other that the
        meshio library reads.  The corners of an STL file's triangles are one vertex where their coordinates are equal,
        to the last bit; vertices are in order of first appearance.  Vertices that belong to no triangle are left out.
        Points and lines in the file are ignored; cells other than triangles are an error.

        Parameters
        ----------
        file : path
            the file to read
        unit : Unit, Quantity or float
            the length that 1 means in the file; a number is one in nm.  By default 1 is 1 nm

        Raises
        ------
        FileNotFoundError
            if there is no such file
        ValueError
            if it does not hold a triangle mesh
        """
        path = Path(file)
        if not path.exists():
            raise FileNotFoundError(f"there is no mesh file {path}")
        if not path.is_file() or path.stat().st_size == 0:
            raise ValueError(f"{path} is {'empty' if path.is_file() else 'not a file'}; it must be a mesh file")
        meshfiles.requireFormat(path)
        try:
            mesh = cls(*meshfiles.read(path))
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        mesh.vertices *= _lengthOf(unit)
        return mesh._withoutLooseVertices()

    def write(self, file: PathLike, unit: Length = unit.nanometer, data: Mapping[str, ArrayLike] | None = None) -> None:
        """Write the mesh to a file, replacing one that exists in a single step.

        The suffix of its name tells the format, as in :meth:`read`.  STL holds single precision; the others hold
        double.

        Parameters
        ----------
        file : path
            the file to write
        unit : Unit, Quantity or float
            the length that 1 means in the file; a number is one in nm.  By default 1 is 1 nm
        data : dict, optional
            arrays of shape (N,) by name, a value for each vertex; VTU, VTK and PLY files hold them, others leave them
            out

        Raises
        ------
        ValueError
            if no format has this suffix
        OSError
            if the file cannot be written
        """
        meshfiles.write(Path(file), self.vertices / _lengthOf(unit), self.triangles, data)

    def check(self) -> None:
        """Check that this is a set of closed, oriented, manifold surfaces, each with a positive volume.

        Raises
        ------
        ValueError
            in a sentence that names the first triangle, edge or vertex that is wrong, and what is allowed
        """
        if not np.all(np.isfinite(self.vertices)):
            raise ValueError(_notFinite(self.vertices))
        connectivity.check(self.vertices, self.triangles)

    def topology(self) -> app.Topology:
        """Create an openmm.app.Topology: a residue for each connected membrane, an atom for each vertex, a bond for
        each edge.

        A Topology keeps the atoms of a residue together; where the vertices of membranes alternate, so do residues of
        their ids.  Its objects are made when they are first asked for, which takes memory for a large mesh.
        """
        return MeshTopology(self.triangles, len(self.vertices))

    def createSystem(self, mass: float | unit.Quantity = 1.0) -> mm.System:
        """Create an openmm.System with a particle for each vertex and no forces.

        Parameters
        ----------
        mass : float or Quantity
            the mass of each particle, in Da.  Monte Carlo averages do not depend on it
        """
        mass = _inUnit(mass, unit.dalton)
        system = mm.System()
        for _ in range(len(self.vertices)):
            system.addParticle(mass)
        return system

    @property
    def edges(self) -> NDArray[np.int32]:
        """The vertices of each edge, smaller index first, in ascending order: an (E, 2) int32 array."""
        return connectivity.edges(self.triangles, len(self.vertices)).astype(np.int32)

    @property
    def edgeLengths(self) -> NDArray[np.float64]:
        """The length of each edge, in nm, in the order of :attr:`edges`."""
        edges = self.edges
        lengths = np.empty(len(edges))
        for block in connectivity.blocks(len(edges)):
            a, b = edges[block].T
            lengths[block] = np.linalg.norm(self.vertices[b] - self.vertices[a], axis=1)
        return lengths

    @property
    def triangleAreas(self) -> NDArray[np.float64]:
        """The area of each triangle, in nm^2."""
        areas = np.empty(len(self.triangles))
        for block in connectivity.blocks(len(areas)):
            areas[block] = np.linalg.norm(self._normals(block), axis=1) / 2
        return areas

    @property
    def area(self) -> float:
        """The total area A, in nm^2."""
        return float(self.triangleAreas.sum())

    @property
    def volume(self) -> float:
        """The enclosed volume V, in nm^3; negative if the surface is inside out."""
        return connectivity.signedVolume(self.vertices, self.triangles)

    @property
    def reducedVolume(self) -> float:
        """The reduced volume v = 6 sqrt(pi) V / A^(3/2), 1 for a sphere."""
        return reducedVolume(self.area, self.volume)

    @property
    def vertexAreas(self) -> NDArray[np.float64]:
        """The area of each vertex, a third of that of its triangles, in nm^2."""
        return _sums(self.triangles.ravel(), np.repeat(self.triangleAreas / 3, 3), len(self.vertices))

    @property
    def vertexMeanCurvatures(self) -> NDArray[np.float64]:
        """The integrated mean curvature of each vertex, a quarter of the sum of length times dihedral angle over its
        edges, in nm.

        They add up to 4 pi R on a sphere; divided by :attr:`vertexAreas` they are the local mean curvature, 1/R.  The
        surface must be closed.
        """
        first, second = connectivity.pairHalfedges(self.triangles, len(self.vertices))
        origin, target = (end[first] for end in connectivity.halfedges(self.triangles))
        normals, curvature = np.empty(self.triangles.shape), np.empty(len(first))
        for block in connectivity.blocks(len(normals)):
            some = self._normals(block)
            normals[block] = some / np.linalg.norm(some, axis=1)[:, np.newaxis]
        for block in connectivity.blocks(len(first)):
            edge = self.vertices[target[block]] - self.vertices[origin[block]]
            length = np.linalg.norm(edge, axis=1)
            nf, ng = normals[first[block] // 3], normals[second[block] // 3]
            sine = np.einsum("ei,ei->e", np.cross(nf, ng), edge) / length
            curvature[block] = length * np.arctan2(sine, np.einsum("ei,ei->e", nf, ng)) / 4
        return _sums(origin, curvature, len(self.vertices)) + _sums(target, curvature, len(self.vertices))

    def _normals(self, block: slice = slice(None)) -> np.ndarray:
        """Return the normals of some triangles, of twice their area."""
        x = self.vertices[self.triangles[block]]
        return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])

    def _withoutLooseVertices(self) -> "Mesh":
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self.triangles] = True
        return Mesh(self.vertices[used], (np.cumsum(used) - 1)[self.triangles])

    def __repr__(self) -> str:
        return f"<Mesh of {len(self.vertices)} vertices and {len(self.triangles)} triangles>"


def _sums(places: NDArray[np.integer], values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the sums of the values at each of a number of places."""
    return np.bincount(places, values, count).astype(np.float64, copy=False)


def _floats(vertices: Any) -> np.ndarray:
    try:
        with np.errstate(invalid="ignore"):  # what is no number is found later
            vertices = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("the vertices must be an array of numbers of shape (N, 3)") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"the vertices have the shape {vertices.shape}; it must be (N, 3)")
    if not np.all(np.isfinite(vertices)):
        raise ValueError(_notFinite(vertices))
    return vertices


def _notFinite(vertices: np.ndarray) -> str:
    v = np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0]
    return (
        f"the position of vertex {v} is ({', '.join(f'{c:g}' for c in vertices[v])}); every coordinate must be finite"
    )


def _indices(triangles: Any, numVertices: int) -> np.ndarray:
    try:
        triangles = np.asarray(triangles)
    except ValueError:
        raise ValueError("the triangles must be an array of integers of shape (T, 3)") from None
    if triangles.ndim != 2 or triangles.shape[1] != 3:
        raise ValueError(f"the triangles have the shape {triangles.shape}; it must be (T, 3)")
    if triangles.dtype.kind not in "iu":
        raise ValueError(f"the triangles are of type {triangles.dtype}; they must be integers")
    outside = np.argwhere((triangles < 0) | (triangles >= numVertices))
    if len(outside):
        t, corner = outside[0]
        raise ValueError(
            f"triangle {t} has the vertex {triangles[t, corner]}; it must be from 0 to {numVertices - 1}, for "
            f"{numVertices} vertices"
        )
    return triangles.astype(np.int32)


def _inUnit(value: Any, wanted: unit.Unit) -> float:
    return float(valueIn(value, wanted))


def _lengthOf(length: Any) -> float:
    """Return a length unit in nm."""
    try:
        value = float(
            (1 * length).value_in_unit(unit.nanometer) if unit.is_unit(length) else _inUnit(length, unit.nanometer)
        )
    except (TypeError, ValueError):
        raise ValueError(f"unit is {length}; it must be a length") from None
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"unit is {value} nm; it must be positive")
    return value


def _icosahedron() -> tuple[np.ndarray, np.ndarray]:
    g = (1 + math.sqrt(5)) / 2
    vertices = np.array(
        [
            (-1, g, 0),
            (1, g, 0),
            (-1, -g, 0),
            (1, -g, 0),
            (0, -1, g),
            (0, 1, g),
            (0, -1, -g),
            (0, 1, -g),
            (g, 0, -1),
            (g, 0, 1),
            (-g, 0, -1),
            (-g, 0, 1),
        ]
    )
    triangles = np.array(
        [
            (0, 11, 5),
            (0, 5, 1),
            (0, 1, 7),
            (0, 7, 10),
            (0, 10, 11),
            (1, 5, 9),
            (5, 11, 4),
            (11, 10, 2),
            (10, 7, 6),
            (7, 1, 8),
            (3, 9, 4),
            (3, 4, 2),
            (3, 2, 6),
            (3, 6, 8),
            (3, 8, 9),
            (4, 9, 5),
            (2, 4, 11),
            (6, 2, 10),
            (8, 6, 7),
            (9, 8, 1),
        ]
    )
    return vertices / math.sqrt(1 + g * g), triangles


def _subdivide(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Divide each triangle in four at the middles of its edges."""
    order, start = connectivity.groupHalfedges(triangles, len(vertices))
    middle = np.empty(len(order), dtype=np.int64)
    middle[order] = len(vertices) + np.repeat(np.arange(len(start)), np.diff(start, append=len(order)))
    origin, target = (end[order[start]] for end in connectivity.halfedges(triangles))
    a, b, c = triangles.T
    ab, bc, ca = middle.reshape(-1, 3).T
    parts = np.stack([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)])
    return np.concatenate((vertices, (vertices[origin] + vertices[target]) / 2)), parts.transpose(2, 0, 1).reshape(
        -1, 3
    )
