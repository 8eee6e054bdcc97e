"""Triangulated membranes: made, read, written, checked, and handed to OpenMM."""

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import openmm as mm
from numpy.typing import ArrayLike, NDArray
from openmm import app, unit

from ..display import drawing
from ..files import PathLike, pathOf
from ..units import realNumber, valueIn, wholeNumber
from . import connectivity, mending, meshfiles
from .formats.content import Content
from .measures import reducedVolume
from .relaxation import TorusSurface, Triangulation, relax, torusTriangulation
from .remeshing import remesh
from .topology import MeshTopology

Length: TypeAlias = unit.Unit | unit.Quantity | float

GREATEST = 1e60  # coordinate, in size, so that areas, volumes and their squares are numbers

# What the array of files is called that has the numbers of species.
SPECIES_FIELD = "Species"


class Mesh:
    """A triangulated surface.

    ::

        mesh = mh.Mesh.icosphere(subdivisions=2, radius=10)
        mesh.write("sphere.ply")
        mesh = mh.Mesh.read("sphere.ply")
        print(mesh.area, mesh.volume, mesh.edgeLengths.mean())

    Attributes
    ----------
    vertices : (N, 3) float64 array
        positions, in nm
    triangles : (T, 3) int32 array
        the vertices of each triangle, counter-clockwise seen from outside
    box : (3, 3) float64 array or None
        the vectors of the periodic box, in nm, if there is one
    isPeriodic : bool
        whether the surface goes through the whole box, as a :meth:`sheet` does; it encloses no volume then
    beads : (B, 3) float64 array
        positions, in nm, of what else there is: particles that are no vertices, in the frames and pictures of a run
    species : (N,) array of int, or None
        the number of the species of each vertex, from 0.  An array of their names may be assigned, too; one that is
        neither of these is a ValueError
    speciesNames : tuple of str
        what the species are called, each unlike the others; empty if they have numbers only
    notes : list of str
        what :meth:`read` left out or changed, and what :meth:`repaired` and :meth:`remeshed` did, each in a sentence
    """

    def __init__(
        self,
        vertices: Any,
        triangles: ArrayLike,
        box: Any = None,
        beads: Any = None,
        species: ArrayLike | None = None,
        speciesNames: Iterable[str] = (),
    ):
        """Create a Mesh from arrays, which are copied.

        Parameters
        ----------
        vertices : (N, 3) array or Quantity
            positions, in nm unless they carry a unit
        triangles : (T, 3) array of integers
            the vertices of each triangle, counter-clockwise seen from outside
        box : (3, 3) array or Quantity, optional
            the vectors of a periodic box, in nm unless they carry a unit
        beads : (B, 3) array or Quantity, optional
            the positions of particles that are no vertices
        species : (N,) array of integers or names, optional
            the number of the species of each vertex, from 0, or its name; an empty one is like None
        speciesNames : iterable of str
            what they are called

        Raises
        ------
        ValueError
            if a shape or type is wrong, a coordinate is no number from -1e60 to 1e60, an index is out of range, or two
            species have the same name.  Whether the triangles form a closed surface is :meth:`check`'s question.
        """
        self.vertices = _floats(valueIn(vertices, unit.nanometer, "vertices"))
        self.triangles = _indices(triangles, len(self.vertices))
        self.box = None if box is None else _boxVectors(valueIn(box, unit.nanometer, "box"))
        self.isPeriodic = self.box is not None and mending.isPeriodic(self.vertices, self.triangles, self.box)
        self.beads = np.empty((0, 3)) if beads is None else _floats(valueIn(beads, unit.nanometer, "beads"))
        self._speciesNames = _namesOf(speciesNames)
        self._species = _speciesOf(species, len(self.vertices), self.speciesNames)
        self.notes: list[str] = []

    @property
    def speciesNames(self) -> tuple[str, ...]:
        return self._speciesNames

    @speciesNames.setter
    def speciesNames(self, names: Iterable[str]) -> None:
        self._speciesNames = _namesOf(names)

    @property
    def species(self) -> NDArray[np.intc] | None:
        return self._species

    @species.setter
    def species(self, species: Any) -> None:
        self._species = _speciesOf(species, len(self.vertices), self.speciesNames)

    @classmethod
    def icosphere(cls, subdivisions: int = 3, radius: float | unit.Quantity = 1.0) -> "Mesh":
        """Create a sphere by subdividing an icosahedron's triangles in four and projecting the new vertices.

        Parameters
        ----------
        subdivisions : int
            how often, n; the sphere has 10*4^n+2 vertices, of which there may be 2e7
        radius : float or Quantity
            its radius, in nm
        """
        subdivisions = wholeNumber(subdivisions, "icosphere: subdivisions", 0)
        radius = realNumber(radius, "radius", unit.nanometer)
        if not (math.isfinite(radius) and radius > 0):
            raise ValueError(f"icosphere: radius is {radius}; it must be positive")
        connectivity.requireVertices(10 * _fourTo(subdivisions) + 2, f"icosphere: subdivisions is {subdivisions}")
        sphere = cls(*_icosahedron())
        for _ in range(subdivisions):
            sphere = sphere.subdivided()
            sphere.vertices /= np.linalg.norm(sphere.vertices, axis=1)[:, np.newaxis]
        return cls(radius * sphere.vertices, sphere.triangles)

    @classmethod
    def torus(cls, R: float | unit.Quantity, r: float | unit.Quantity, edgeLength: float | unit.Quantity) -> "Mesh":
        """Create a torus about the z axis of nearly equal edges.

        Its volume is 2 pi^2 R r^2, and its area a little more than 4 pi^2 R r: the vertices are a little outside of the
        torus, and the triangles as far outside as inside.

        Parameters
        ----------
        R : float or Quantity
            the radius of the ring, from the axis to the middle of the tube, in nm
        r : float or Quantity
            the radius of the tube, in nm, less than R
        edgeLength : float or Quantity
            the mean length of the edges, in nm, met to within a few percent; at most r, and at most R-r

        Raises
        ------
        ValueError
            if an argument is out of range
        """
        given = {"R": R, "r": r, "edgeLength": edgeLength}
        R, r, length = (realNumber(value, name, unit.nanometer) for name, value in given.items())
        if not (math.isfinite(R) and 0 < r < R):
            raise ValueError(f"torus: R is {R:g} and r {r:g}; r must be positive and less than R")
        if not 0 < length <= min(r, R - r):
            raise ValueError(f"torus: edgeLength is {length:g}; it must be positive and at most {min(r, R - r):g} here")
        count = 8 * math.pi**2 / math.sqrt(3) * (R / length) * (r / length)  # of even triangles
        connectivity.requireVertices(count, f"torus: edgeLength is {length:g}")
        return cls(*relax(torusTriangulation(R, r, length), TorusSurface(R, r), rounds=40))

    @classmethod
    def sheet(
        cls, width: float | unit.Quantity, height: float | unit.Quantity, edgeLength: float | unit.Quantity
    ) -> "Mesh":
        """Create a flat periodic sheet in the plane z = 0, of triangles that are as even as the box lets them be.

        ::

            sheet = mh.Mesh.sheet(20, 20, 1.0)
            print(sheet.isPeriodic, sheet.area, sheet.box)

        It has no border: it goes on across the periodic :attr:`box`, and is a torus for the connectivity.  Its outside
        is above.  The box is as high as it is wide, so that images of the sheet above and below are far away.

        Parameters
        ----------
        width, height : float or Quantity
            its sides along x and y, in nm
        edgeLength : float or Quantity
            about the length of the edges, in nm, such that a whole number of them, and an even number of rows, fit
            into the box; at most a fifth of the shorter side

        Raises
        ------
        ValueError
            if an argument is out of range
        """
        sides = [realNumber(width, "width", unit.nanometer), realNumber(height, "height", unit.nanometer)]
        length = realNumber(edgeLength, "edgeLength", unit.nanometer)
        if not (all(map(math.isfinite, sides)) and min(sides) > 0):
            raise ValueError(f"sheet: width is {sides[0]:g} and height {sides[1]:g}; they must be positive")
        if not 0 < length <= min(sides) / 5:
            raise ValueError(
                f"sheet: edgeLength is {length:g}; it must be positive and at most a fifth of the shorter side, "
                f"{min(sides) / 5:g} here"
            )
        count = 2 / math.sqrt(3) * (sides[0] / length) * (sides[1] / length)
        connectivity.requireVertices(count, f"sheet: edgeLength is {length:g}")
        numColumns = round(sides[0] / length)
        numRows = 2 * max(3, round(sides[1] / (math.sqrt(3) * length)))
        row, column = (index.ravel() for index in np.mgrid[:numRows, :numColumns])
        vertices = np.column_stack(
            ((column + row % 2 / 2) * sides[0] / numColumns, row * sides[1] / numRows, np.zeros(len(row)))
        )

        def number(row: np.ndarray, column: np.ndarray) -> np.ndarray:
            return row % numRows * numColumns + column % numColumns

        # Above the edge from a vertex to the next one is that of the following row between them.
        right, above = number(row, column + 1), number(row + 1, column + row % 2)
        before = number(row + 1, column + row % 2 - 1)
        here = number(row, column)
        triangles = np.concatenate((np.column_stack((here, right, above)), np.column_stack((here, above, before))))
        return cls(vertices, triangles, np.diag([*sides, max(sides)]))

    @classmethod
    def merged(cls, meshes: Iterable["Mesh"]) -> "Mesh":
        """Create one mesh of several, whose vertices, triangles and notes follow one another in their order, and their
        species where all have some.

        Raises
        ------
        ValueError
            if there are none, or they have different periodic boxes
        """
        meshes = list(meshes)
        if not meshes:
            raise ValueError("merged: there are no meshes; give at least one")
        boxes = [mesh.box for mesh in meshes if mesh.box is not None]
        if any(not np.array_equal(box, boxes[0]) for box in boxes):
            raise ValueError("merged: the meshes have different periodic boxes; they must have the same, or none")
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        result = cls(
            np.concatenate([mesh.vertices for mesh in meshes]),
            np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, first)]),
            boxes[0] if boxes else None,
        )
        if all(mesh.species is not None for mesh in meshes):
            result.species = np.concatenate([mesh.species for mesh in meshes if mesh.species is not None])
            names = max((mesh.speciesNames for mesh in meshes), key=len)
            result.speciesNames = names
        result.notes = [note for mesh in meshes for note in mesh.notes]
        return result

    @classmethod
    def read(
        cls, file: PathLike, unit: Length = unit.nanometer, repair: bool = False, speciesField: str | None = None
    ) -> "Mesh":
        """Read a mesh from a file.

        The suffix of its name tells the format: STL, PLY, OBJ, OFF, VTU, VTP, VTK, GMSH (.msh), glTF (.gltf, .glb), the
        topologies of FreeDTS (.tsi, .q), checkpoints of TriMem (.h5), and every other that the meshio library reads.
        The corners of an STL file's triangles are one vertex where their coordinates are equal; vertices are in order
        of first appearance.  Faces of more than three corners are divided.  Vertices that belong to no face, points and
        lines are left out.  :attr:`notes` says what was divided or left out.

        Parameters
        ----------
        file : path
            the file to read
        unit : Unit, Quantity or float
            the length that 1 means in the file; a number is one in nm.  By default 1 is 1 nm
        repair : bool
            mend what can be mended, as :meth:`repaired` does
        speciesField : str, optional
            the name of an array of a VTU, VTK or PLY file with the number of the species of each vertex; by default
            "Species", which :meth:`write` makes, if there is one

        Raises
        ------
        FileNotFoundError
            if there is no such file
        ValueError
            if it does not hold a mesh
        TypeError
            if `file` is no path
        """
        path = pathOf(file, "read: file")
        if not path.exists():
            raise FileNotFoundError(f"there is no mesh file {path}")
        if not path.is_file() or path.stat().st_size == 0:
            raise ValueError(f"{path} is {'empty' if path.is_file() else 'not a file'}; it must be a mesh file")
        meshfiles.requireFormat(path)
        length = _lengthOf(unit)
        try:
            content = meshfiles.read(path)
            mesh = cls(content.points, content.triangles(), content.box)
            isUsed = connectivity.isUsed(mesh.triangles, len(mesh.vertices))
            content.noteLeftOut(int(np.count_nonzero(~isUsed)), "vertices of no face")
            mesh.species = _speciesIn(content, speciesField)
            mesh = mesh._scaled(length)._withoutLooseVertices(content.notes)
            return mesh.repaired() if repair else mesh
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

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
            arrays of shape (N,) by name, a value for each vertex; VTU, VTK and PLY files hold them, and the species of
            the mesh, others leave them out

        Raises
        ------
        ValueError
            if no format that is written has this suffix, a number has no room in it, or the mesh is periodic and the
            format has no box: PLY, TSI and Q have
        OSError
            if the file cannot be written
        TypeError
            if `file` is no path
        """
        path, length = pathOf(file, "write: file"), _lengthOf(unit)
        if self.isPeriodic and path.suffix.lower() not in meshfiles.WITH_BOX:
            meshfiles.requireWritten(path)
            raise ValueError(
                f"{file}: the mesh is periodic, and files of this format have no box; use one of "
                f"{', '.join(meshfiles.WITH_BOX)}, or .vtkhdf ('openmm-helfrich convert' or writeMeshTrajectory()); or "
                "write unwrapped() to look at it"
            )
        box = None if self.box is None else self.box / length
        own = {} if self.species is None else {SPECIES_FIELD: self.species}
        meshfiles.write(
            path, self.vertices / length, self.triangles, {**(data or {}), **own} or None, box, self.isPeriodic
        )

    def repaired(
        self,
        tolerance: float = 1e-3,
        smallest: float = 0.01,
        keep: Sequence[int] | None = None,
        box: Any = None,
        closeHoles: bool = False,
        reverse: bool = False,
    ) -> "Mesh":
        """Return a mesh with the faults mended that files of meshes have; its :attr:`notes` say each thing that was
        done in a sentence.

        A surface that is folded into a periodic box is unfolded.  Corners along open edges that are close to each other
        are welded, and so are those of two surfaces in the same place.  Facets that have no area, lie on another one or
        stick to the surface by an edge are taken away.  All facets are turned the same way, outwards.  Where the
        surface touches itself, its sheets are parted.  Specks are left out.  Holes are noted.

        Parameters
        ----------
        tolerance : float
            how close corners must be to be welded, in parts of the median length of an edge
        smallest : float
            what is a speck: a connected surface with less than this part of the area of the largest.  0 keeps all
        keep : list of int, optional
            instead, the numbers of the surfaces to keep, in the order of :meth:`components`
        box : (3, 3) array, three numbers, one number, or Quantity, optional
            vectors or lengths of the periodic box into which the surface is folded, in nm; by default :attr:`box`
        closeHoles : bool
            close holes with flat fans of triangles
        reverse : bool
            turn all facets round, instead of turning surfaces outwards

        Raises
        ------
        ValueError
            if an argument is not as it must be, or the surface is folded into a periodic box that is not known
        """
        if self.isPeriodic and box is None:
            raise ValueError("repaired: the surface goes through the whole periodic box; this mends closed ones")
        for name, value in (("tolerance", tolerance), ("smallest", smallest)):
            if not 0 <= value < 1:
                raise ValueError(f"repaired: {name} is {value}; it must be at least 0 and less than 1")
        vectors = self.box if box is None else _boxVectors(valueIn(box, unit.nanometer, "box"))
        wanted = mending.Wanted(tolerance, smallest, None if keep is None else list(keep), closeHoles, reverse)
        vertices, triangles, notes = mending.repair(self.vertices, self.triangles, vectors, wanted)
        result = Mesh(vertices, triangles, vectors, None, None if notes else self.species, self.speciesNames)
        return result._withoutLooseVertices([*self.notes, *notes, *self._speciesLeft(result)])

    def reversed(self) -> "Mesh":
        """Return the mesh with all triangles turned round, so that inside and outside change places."""
        result = self._with(slice(None), self.triangles[:, ::-1])
        result.notes = list(self.notes)
        return result

    def unwrapped(self) -> "Mesh":
        """Return a periodic mesh as an open surface to look at, with the vertices beside the borders of the box twice,
        so that no triangle crosses them; any other mesh as it is.
        """
        if not self.isPeriodic:
            return self
        patch = connectivity.patchOf(self.vertices, self.triangles, np.asarray(self.box))
        species = None if self.species is None else self.species[patch.vertexOf]
        return Mesh(patch.vertices, patch.triangles, None, self.beads, species, self.speciesNames)

    def components(self) -> "list[Mesh]":
        """Return each connected surface as a mesh, in the order of their first triangles.

        They keep the species of their vertices; beads belong to none of several.
        """
        count, label = mending.surfaces(self.triangles, len(self.vertices))
        if count == 1:
            return [self]
        order = np.argsort(label, kind="stable")
        parts = np.split(self.triangles[order], np.cumsum(np.bincount(label, minlength=count))[:-1])
        whole = (np.unique(part, return_inverse=True) for part in parts)
        return [self._with(used, part.reshape(-1, 3)) for used, part in whole]

    def check(self) -> None:
        """Check that this is a set of closed, oriented, manifold surfaces, each with a positive volume, or periodic.

        Raises
        ------
        ValueError
            in a sentence that names the first triangle, edge or vertex that is wrong, and what is allowed
        """
        _requireSizes(self.vertices)
        if self.isPeriodic:
            connectivity.lengthsOf(np.asarray(self.box))
        folded = None if self.isPeriodic else mending.foldedEdges(self.vertices, self.triangles, self.box)
        if (sentence := folded) is not None:
            raise ValueError(f"{sentence}; 'openmm-helfrich repair' unfolds it, with --box if the file has none")
        try:
            connectivity.check(self.vertices, self.triangles, self.images)
        except ValueError as error:
            if self.isPeriodic:
                raise
            place = self._surfaceOf(error.vertex) if isinstance(error, connectivity.Fault) else ""
            raise ValueError(f"{place}{error}{self._remedy(str(error))}") from None
        if self.isPeriodic:
            self._requireWhole()

    def _surfaceOf(self, vertex: int) -> str:
        """Return which of several surfaces a vertex belongs to, as the beginning of a sentence."""
        count, label = mending.surfaces(self.triangles, len(self.vertices))
        mine = label[np.any(self.triangles == vertex, axis=1)][0]
        return f"surface {mine}, of {count}: " if count > 1 else ""

    def _remedy(self, fault: str) -> str:
        """Return what to do about a fault, to go on its sentence."""
        if not len(self.triangles):
            return ""
        left = self._leftBy()
        if left is None:
            return "; 'openmm-helfrich repair', Mesh.repaired() or repair = true in [mesh] mends this"
        closed = self._leftBy(closeHoles=True)
        if closed is None:
            return (
                "; 'openmm-helfrich repair --close-holes' or Mesh.repaired(closeHoles=True) mends this, with flat lids"
            )
        option = "" if closed == left else " --close-holes"
        rest = "" if closed == fault else f" mends what can be mended, but not all: {closed.partition('; ')[0]}"
        return f"; 'openmm-helfrich repair{option}'{rest or ' does not mend this'}"

    def _leftBy(self, **arguments: Any) -> str | None:
        """Return what is wrong still after :meth:`repaired` with some arguments, or None if nothing is."""
        try:
            mended = self.repaired(**arguments)
            connectivity.check(mended.vertices, mended.triangles)
        except ValueError as error:
            return str(error)
        return None

    def remeshed(self, numVertices: int | None = None, edgeLength: float | unit.Quantity | None = None) -> "Mesh":
        """Return a mesh of even triangles on the same surface, of the same genus.

        Area and volume change by less than 1%, the surface by less than a tenth of an edge, and edges are from 0.6 to
        1.5 of their mean.  Where the surface has features that are finer than the edges, and so does not let that be,
        a warning says by how much.  The new mesh has the figures in its notes.  Takes mmgpy and libigl, which come with
        pip install 'openmm-helfrich[remesh]'.

        Parameters
        ----------
        numVertices : int, optional
            the number of vertices
        edgeLength : float or Quantity, optional
            instead: the mean length of edges, in nm, met to within a few percent

        Raises
        ------
        ValueError
            if the mesh is not closed, an argument is out of range, so few vertices do not cover the surface, or a
            library is missing
        """
        self.check()
        if self.isPeriodic:
            raise ValueError("remeshed: the mesh is periodic; make another one with Mesh.sheet()")
        length = None if edgeLength is None else realNumber(edgeLength, "edgeLength", unit.nanometer)
        result = remesh(Triangulation(self.vertices, self.triangles), numVertices, length)
        for sentence in result.shortcomings():
            warnings.warn(f"remeshed: {sentence}", stacklevel=2)
        mesh = Mesh(*result.triangulation, self.box)
        mesh.notes = [*self.notes, *(f"remeshed: {text}" for text in (result.summary(), *result.shortcomings()))]
        mesh.notes += self._speciesLeft(mesh)
        return mesh

    def subdivided(self, times: int = 1) -> "Mesh":
        """Return the mesh with each triangle divided in four equal ones at the middles of its edges.

        ::

            large = mh.Mesh.read("equilibrated.ply").subdivided(2)  # 16 times as many triangles

        It is the same surface, of the same area and volume, and edges over their mean are as before.  So a shape from
        equilibrium, subdivided, begins a run of a larger mesh with long waves that are in equilibrium already; see
        docs/how-to/large-vesicles.md.  The vertices of the mesh come first, in their order.  A vertex between two
        species takes that of the end with the lower number.

        Triangles with an angle above 170 degrees have their longest side flipped first, where the surface hardly bends
        there and the new side is no shorter than the others: their parts would be as flat, so that trajectories need
        short steps.  A note says how many there were.

        Parameters
        ----------
        times : int
            how often; each time brings a new vertex for each edge

        Raises
        ------
        ValueError
            if `times` is negative or no whole number, or there would be more than 2e7 vertices
        """
        times = wholeNumber(times, "subdivided: times", 0)
        if times > 0:
            count = len(self.vertices) + len(self.triangles) / 2 * (_fourTo(times) - 1)
            connectivity.requireVertices(count, f"subdivided: times is {times}")
        mesh = self._with(slice(None), self.triangles)
        mesh.beads, mesh.notes = self.beads.copy(), list(self.notes)
        if times > 0:
            mesh._flipFlat()
        for _ in range(times):
            mesh = mesh._dividedInFour()
        return mesh

    def topology(self) -> app.Topology:
        """Create an openmm.app.Topology: a residue for each connected membrane, an atom for each vertex, a bond for
        each edge; a residue and an atom for each bead, in a chain of their own.

        A Topology keeps the atoms of a residue together; where the vertices of membranes alternate, so do residues of
        their ids.  Names of atoms and the order of bonds are such that files of OpenMM (PDB, PDBx/mmCIF) keep all of
        them.  Its objects are made when they are first asked for, which takes memory for a large mesh.
        """
        topology = MeshTopology(self.triangles, len(self.vertices), len(self.beads))
        if self.isPeriodic:
            topology.setPeriodicBoxVectors(np.asarray(self.box) * unit.nanometer)
        return topology

    def createSystem(self, mass: float | unit.Quantity = 1.0) -> mm.System:
        """Create an openmm.System with a particle for each vertex and no forces; that of a periodic mesh has its box.

        Parameters
        ----------
        mass : float or Quantity
            the mass of each particle, in Da.  Monte Carlo averages do not depend on it

        Raises
        ------
        ValueError, TypeError
            if it is negative, or no mass
        """
        mass = realNumber(mass, "mass", unit.dalton)
        if not (math.isfinite(mass) and mass >= 0):
            raise ValueError(f"mass is {mass} Da; it must be finite, and not negative")
        system = mm.System()
        for _ in range(len(self.vertices)):
            system.addParticle(mass)
        if self.isPeriodic:
            system.setDefaultPeriodicBoxVectors(*np.asarray(self.box))
        return system

    @property
    def images(self) -> NDArray[np.float64] | None:
        """The box in which neighbors are the nearest images of each other, if the mesh is periodic."""
        return self.box if self.isPeriodic else None

    @property
    def edges(self) -> NDArray[np.int32]:
        """The vertices of each edge, smaller index first, in ascending order: an (E, 2) int32 array."""
        return connectivity.edgesOf(self.triangles, len(self.vertices))

    @property
    def edgeLengths(self) -> NDArray[np.float64]:
        """The length of each edge, in nm, in the order of :attr:`edges`."""
        return connectivity.edgeLengthsOf(self.vertices, self.edges, self.images)

    @property
    def triangleAreas(self) -> NDArray[np.float64]:
        """The area of each triangle, in nm^2."""
        return connectivity.triangleAreas(self.vertices, self.triangles, self.images)

    @property
    def area(self) -> float:
        """The total area A, in nm^2."""
        return float(self.triangleAreas.sum())

    @property
    def volume(self) -> float:
        """The enclosed volume V, in nm^3; negative if the surface is inside out.

        A periodic mesh has none, and a ValueError says so.
        """
        if self.isPeriodic:
            raise ValueError("the mesh is periodic, and so encloses no volume")
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
        surface must be closed.  The dihedral angle beside a triangle without area is 0, as in the force.
        """
        first, second = connectivity.pairHalfedges(self.triangles, len(self.vertices))
        origin, target = connectivity.endsOf(self.triangles, first)
        normals, curvature = np.empty(self.triangles.shape), np.empty(len(first))
        for block in connectivity.blocks(len(normals)):
            some = connectivity.triangleNormals(self.vertices, self.triangles[block], self.images)
            sizes = np.linalg.norm(some, axis=1)
            normals[block] = some / np.where(sizes > 0, sizes, 1)[:, np.newaxis]
        for block in connectivity.blocks(len(first)):
            edge = connectivity.edgeVectors(self.vertices, origin[block], target[block], self.images)
            length = np.linalg.norm(edge, axis=1)
            nf, ng = normals[first[block] // 3], normals[second[block] // 3]
            # 0 is added so that it is never -0: two triangles folded onto each other have the angle pi, as in the force
            sine = np.einsum("ei,ei->e", np.cross(nf, ng), edge) / np.where(length > 0, length, 1) + 0.0
            curvature[block] = length * np.arctan2(sine, np.einsum("ei,ei->e", nf, ng)) / 4
        return _sums(origin, curvature, len(self.vertices)) + _sums(target, curvature, len(self.vertices))

    def _scaled(self, factor: float) -> "Mesh":
        """Return the mesh with coordinates and box multiplied by a factor."""
        result = self._with(slice(None), self.triangles)
        with np.errstate(over="ignore"):  # what becomes too large is refused
            result.vertices *= factor
            result.box = None if self.box is None else self.box * factor
        _requireSizes(result.vertices)
        return result

    def _flipFlat(self) -> None:
        """Flip nearly flat triangles, whose parts would be as flat, and beyond what flips can mend."""
        self.triangles[:], count = mending.flipFlat(self.vertices, self.triangles, self.images)
        if count > 0:
            self.notes.append(f"{mending.counted(count, 'flat triangle')} flipped before the mesh was subdivided")

    def _dividedInFour(self) -> "Mesh":
        """Return the mesh with each triangle divided in four at the middles of its edges."""
        order, start = connectivity.groupHalfedges(self.triangles, len(self.vertices))
        middle = np.empty(len(order), dtype=np.int64)
        middle[order] = len(self.vertices) + np.repeat(np.arange(len(start)), np.diff(start, append=len(order)))
        first, second = (end[order[start]] for end in connectivity.halfedges(self.triangles))
        ends = self.vertices[first], self.vertices[second]
        if self.isPeriodic:
            ends = ends[0], ends[0] + connectivity.edgeVectors(self.vertices, first, second, self.images)
        a, b, c = self.triangles.T
        ab, bc, ca = middle.reshape(-1, 3).T
        parts = np.stack([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]).transpose(2, 0, 1).reshape(-1, 3)
        species = None if self.species is None else np.append(self.species, self.species[np.minimum(first, second)])
        vertices = np.concatenate((self.vertices, (ends[0] + ends[1]) / 2))
        result = Mesh(vertices, parts, self.box, self.beads, species, self.speciesNames)
        result.notes = list(self.notes)
        return result

    def _requireWhole(self) -> None:
        """Raise a ValueError if the nearest images of a triangle's vertices make no triangle."""
        a, b, c = self.triangles.T
        ends = ((a, b), (b, c), (c, a))
        gaps = sum(connectivity.edgeVectors(self.vertices, start, end, self.images) for start, end in ends)
        sides = np.diag(np.asarray(self.box))
        torn = np.flatnonzero((np.abs(gaps) > sides / 2).any(axis=1))
        if len(torn):
            raise ValueError(
                f"triangle {torn[0]} is torn: the nearest images of its vertices in the box of "
                f"{' x '.join(f'{side:g}' for side in sides)} make no triangle; the box must be that of the mesh, and "
                "edges shorter than half a side"
            )

    def _speciesLeft(self, other: "Mesh") -> list[str]:
        """Return a note if another mesh, made of this one, has lost the species."""
        return (
            ["the species were left out, since vertices have changed"]
            if self.species is not other.species is None
            else []
        )

    def _with(self, vertices: Any, triangles: ArrayLike) -> "Mesh":
        """Return a mesh of some of the vertices, with their species, and other triangles."""
        species = None if self.species is None else self.species[vertices]
        return Mesh(self.vertices[vertices], triangles, self.box, None, species, self.speciesNames)

    def _withoutLooseVertices(self, notes: Iterable[str] = ()) -> "Mesh":
        """Return the mesh without vertices that belong to no triangle, with notes."""
        used = connectivity.isUsed(self.triangles, len(self.vertices))
        result = self._with(used, (np.cumsum(used) - 1)[self.triangles])
        result.notes = list(notes)
        return result

    def __repr__(self) -> str:
        count = len(self.beads)
        beads = f", and {count} bead{'s' if count > 1 else ''}" if count else ""
        return f"<Mesh of {len(self.vertices)} vertices and {len(self.triangles)} triangles{beads}>"

    def plot(self, **look: Any) -> Any:
        """Return a Picture of the mesh colored by its mean curvature, which a notebook shows and ``save`` writes.

        ::

            mesh.plot(elevation=10, range=(-2, 2)).save("vesicle.png", dpi=300)

        Parameters
        ----------
        look
            how it is drawn: see :class:`openmmhelfrich.pictures.look.Look`
        """
        return drawing().meshPicture(self, **look)


def _sums(places: NDArray[np.integer], values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the sums of the values at each of a number of places."""
    return np.bincount(places, values, count).astype(np.float64, copy=False)


def _namesOf(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of species, each of which must be of one species only."""
    result = tuple(names)
    for i, name in enumerate(result):
        if name in result[:i]:
            raise ValueError(f"speciesNames has '{name}' twice; each species must have a name of its own")
    return result


def _speciesOf(species: Any, numVertices: int, names: tuple[str, ...]) -> NDArray[np.intc] | None:
    """Return the numbers of the species of vertices, given these or their names."""
    try:
        values = np.asarray([] if species is None else species)
    except ValueError:
        raise ValueError("the species must be an array of whole numbers of shape (N,), one for each vertex") from None
    if values.size == 0:
        return None
    if values.shape != (numVertices,):
        raise ValueError(
            f"the species have the shape {values.shape}; there must be one for each of {numVertices} vertices"
        )
    if values.dtype.kind == "U":
        values = _numbersOf(values, names)
    if values.dtype.kind not in "iub":
        raise ValueError(f"the species are of type {values.dtype}; they must be whole numbers")
    wrong = np.flatnonzero((values < 0) | (values > np.iinfo(np.intc).max))
    if len(wrong):
        raise ValueError(
            f"the species of vertex {wrong[0]} is {values[wrong[0]]}; it must be a whole number, 0 or more"
        )
    return values.astype(np.intc)


def _numbersOf(species: NDArray[Any], names: tuple[str, ...]) -> NDArray[np.int64]:
    """Return the numbers of species of some names."""
    for vertex in np.flatnonzero(~np.isin(species, names))[:1]:
        known = f"they are called {', '.join(names)}" if names else "there are no speciesNames"
        raise ValueError(f"the species of vertex {vertex} is '{species[vertex]}'; {known}")
    return np.array([names.index(name) for name in species.tolist()])


def _speciesIn(content: Content, field: str | None) -> NDArray[np.int64] | None:
    """Return the species of the vertices of a file, by the name of an array, or by ours if there is one."""
    name = field or SPECIES_FIELD
    if name not in content.fields:
        if field is None:
            return None
        has = f"it has {', '.join(content.fields)}" if content.fields else "it has none"
        raise ValueError(f"the file has no array of vertices called '{name}': {has}")
    values = np.asarray(content.fields[name], dtype=float)
    wrong = values[~((values >= 0) & (values == np.rint(values)) & (values <= np.iinfo(np.intc).max))]
    if len(wrong) == 0:
        return values.astype(np.int64)
    sentence = f"the array {name} has the value {wrong[0]:g}, which is no number of a species: whole, and 0 or more"
    if field is not None:
        raise ValueError(sentence)
    content.notes.append(f"{sentence}; it was left out")
    return None


def _floats(vertices: Any) -> np.ndarray:
    try:
        with np.errstate(invalid="ignore"):  # what is no number is found later
            vertices = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("the vertices must be an array of numbers of shape (N, 3)") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"the vertices have the shape {vertices.shape}; it must be (N, 3)")
    _requireSizes(vertices)
    return vertices


def _boxVectors(box: Any) -> np.ndarray:
    """Return box vectors, (3, 3), of such, three lengths, or one."""
    try:
        box = np.asarray(box, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("the box must be three vectors, three lengths, or one") from None
    vectors = np.diag(np.broadcast_to(box, 3)) if box.size in (1, 3) and box.ndim < 2 else box
    if vectors.shape != (3, 3) or not _isSized(vectors) or np.linalg.det(vectors) <= 0:
        raise ValueError(
            f"the box is {box.tolist()}; it must be three vectors, three lengths, or one, all positive and at most "
            f"{GREATEST:g}"
        )
    return vectors.copy()


def _isSized(numbers: np.ndarray) -> bool:
    """Return whether all of some numbers are numbers, and not too large."""
    return bool(numbers.min(initial=0) >= -GREATEST and numbers.max(initial=0) <= GREATEST)


def _requireSizes(vertices: np.ndarray) -> None:
    if not _isSized(vertices):
        v = np.flatnonzero(~(np.abs(vertices) <= GREATEST).all(axis=1))[0]
        raise ValueError(
            f"the position of vertex {v} is ({', '.join(f'{c:g}' for c in vertices[v])}); every coordinate must be a "
            f"number from {-GREATEST:g} to {GREATEST:g}"
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
    if triangles.size and not (triangles.min() >= 0 and triangles.max() < numVertices):
        t, corner = np.argwhere((triangles < 0) | (triangles >= numVertices))[0]
        raise ValueError(
            f"triangle {t} has the vertex {triangles[t, corner]}; it must be from 0 to {numVertices - 1}, for "
            f"{numVertices} vertices"
        )
    return triangles.astype(np.int32)


def _lengthOf(length: Any) -> float:
    """Return a length unit in nm."""
    try:
        value = float(
            (1 * length).value_in_unit(unit.nanometer)
            if unit.is_unit(length)
            else realNumber(length, "unit", unit.nanometer)
        )
    except (TypeError, ValueError):
        raise ValueError(f"unit is {length}; it must be a length") from None
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"unit is {value} nm; it must be positive")
    return value


def _fourTo(power: int) -> float:
    """Return a power of four, and no larger one than a float holds."""
    return 4.0 ** min(power, 500)


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
