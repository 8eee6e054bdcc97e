"""Reporters for openmm.app.Simulation."""

import csv
import os
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import openmm as mm
from openmm import app, unit

from ..files import PathLike
from ..geometry.connectivity import isUsed
from ..geometry.measures import localMeanCurvatures, smoothCurvatures
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce
from ..io.vtkhdf import MeshFrame, MeshTrajectoryWriter, readMeshTrajectory
from ..messages import quoted
from ..tables import plainName, readHeads
from ..units import thermalEnergy, valueIn, wholeNumber
from .conditions import boxOf
from .observables import DEFAULT_OBSERVABLES, Moment, Observable, Place, keepingTerms, observe


class ObservablesReporter:
    """Writes a table of a membrane's energy terms, geometry and acceptance rates as comma-separated values.

    The first row names the columns, with units.  The membrane's energy is the sum of the terms that follow it.
    Acceptance rates, the flip rate (flips accepted per edge and sweep), the fraction of attempted flips that the rules
    forbid, and the number of trajectories that diverged are those since the start of the simulation; they are there if
    the Integrator has such moves, and of two of a kind it is the first that is asked.

    ::

        simulation.reporters.append(mh.ObservablesReporter("vesicle.csv", 10, force, 300 * unit.kelvin))
        simulation.step(20)
    """

    def __init__(
        self,
        file: PathLike | IO[str],
        reportInterval: int,
        force: HelfrichForce,
        temperature: float | unit.Quantity | None = None,
        lengthUnit: str = "nm",
        append: bool = False,
        describe: Callable[[], dict[str, float]] | None = None,
        observables: Iterable[Observable] = DEFAULT_OBSERVABLES,
        place: Callable[[], Place] = Place,
    ):
        """Create an ObservablesReporter.

        Parameters
        ----------
        file : path or file object
            where to write to
        reportInterval : int
            the number of steps between rows
        force : HelfrichForce
            the membrane
        temperature : float or Quantity
            if given, energies are in units of kT at this temperature, in K, and otherwise in kJ/mol
        lengthUnit : str
            the name of the unit of length, if 1 nm stands for another
        append : bool
            add to an existing file instead of replacing it; its columns are those that it has
        describe : callable, optional
            returns more columns, as a dict from names to numbers
        observables : iterable of Observable
            the other columns
        place : callable
            returns the :class:`Place` in a run

        Raises
        ------
        ValueError
            if reportInterval is no whole number, 1 or more
        """
        self._reportInterval = wholeNumber(reportInterval, "reportInterval", 1)
        self._force, self._lengthUnit = force, lengthUnit
        self._energyUnitName, self._energyUnit = "kJ/mol", 1.0
        if temperature is not None:
            self._energyUnitName, self._energyUnit = "kT", thermalEnergy(temperature)
        self._out: IO[str]
        self._describe, self._observables, self._place = describe or dict, tuple(observables), place
        self._heads: list[str] = []
        self._needsHeads = not append
        if isinstance(file, (str, os.PathLike)):
            if append and Path(file).exists():
                self._heads = readHeads(file)
                self._observables = keepingTerms(self._observables, self._heads)
            self._needsHeads = not self._heads
            self._ownsFile = True
            self._out = open(file, "a" if append else "w", newline="", encoding="utf-8")  # noqa: SIM115
        else:
            self._ownsFile, self._out = False, file
        self._writer = csv.writer(self._out, lineterminator="\n")

    def describeNextReport(self, simulation: app.Simulation) -> dict[str, Any]:
        """Get information about the next report this object will generate."""
        steps = self._reportInterval - simulation.currentStep % self._reportInterval
        return {"steps": steps, "periodic": None, "include": []}

    def report(self, simulation: app.Simulation, state: mm.State) -> None:
        """Write a row."""
        row = self.observe(simulation)
        if not self._heads:
            self._heads = list(row)
            self._observables = keepingTerms(self._observables, self._heads)
        if self._needsHeads:
            self._writer.writerow(self._heads)
            self._needsHeads = False
        self._requireHeads(row)
        self._writer.writerow([row[head] for head in self._heads])
        self._out.flush()

    def requireColumns(self, simulation: app.Simulation) -> None:
        """Raise a ValueError unless a Simulation has what the table that is there has columns of."""
        if self._heads:
            self._requireHeads(self.observe(simulation))

    def _requireHeads(self, row: Mapping[str, float]) -> None:
        for head in self._heads:
            if head not in row:
                name = getattr(self._out, "name", "the table")
                others = [quoted(other) for other in row if plainName(other) == plainName(head)] or ["no such thing"]
                raise ValueError(f"{name} has the column {quoted(head)}; the simulation has {others[0]}")

    def observe(self, simulation: app.Simulation) -> dict[str, float]:
        """Return the row that describes a Simulation now, as a dict from column names to numbers."""
        moment = Moment(simulation, self._force, self._energyUnit, self._place())
        return observe(moment, self._observables, self._lengthUnit, self._energyUnitName) | self._describe()

    def sync(self) -> int:
        """Return the size of the file so far, in bytes; they have left Python's buffers."""
        self._out.flush()
        return self._out.seek(0, 2)

    def close(self) -> None:
        """Close the file."""
        if self._ownsFile:
            self._out.close()


class MeshReporter:
    """Writes a membrane's positions and live triangles to a VTKHDF file, which ParaView and pyvista play as a time
    series.

    Each frame has the mean curvature of each vertex ("MeanCurvature", in 1/nm), that of its neighborhood
    ("SmoothMeanCurvature", which pictures show), and its area ("Area", in nm^2), and the step as its time.
    :func:`readMeshTrajectory` reads the frames back.

    The file is complete at any moment, whatever happens to the program: new frames wait in memory until they are
    written all at once, after a minute or so, at :meth:`flush` and at :meth:`close`, or else at the end of the program.
    Until then a second copy of the file, whose name begins with a dot, lies beside it.  To write the frames up to a
    checkpoint, call ``flush()`` before making it, and save ``getNumFrames()`` with it; to go on from there, create the
    reporter with ``append=True`` and that number as `numFrames`: later frames, which the run will make again, are
    dropped.

    ::

        reporter = mh.MeshReporter("vesicle.vtkhdf", 10, force)
        simulation.reporters.append(reporter)
        simulation.step(20)
        reporter.close()
    """

    def __init__(
        self,
        file: PathLike,
        reportInterval: int,
        force: HelfrichForce,
        append: bool = False,
        numFrames: int | None = None,
        precision: str = "double",
        lengthUnit: str = "nm",
        beads: Sequence[int] = (),
        speciesNames: Sequence[str] = (),
    ):
        """Create a MeshReporter.

        Parameters
        ----------
        file : path
            where to write to, by custom with the suffix .vtkhdf
        reportInterval : int
            the number of steps between frames
        force : HelfrichForce
            the membrane; other particles than its vertices are left out, unless they are `beads`
        append : bool
            add to an existing file instead of replacing it
        numFrames : int, optional
            when appending, the number of frames of the existing file to keep; all by default
        precision : str
            of the positions: "double", or "single" for files that are a third smaller
        lengthUnit : str
            the name of the unit of length, if 1 nm stands for another
        beads : sequence of int
            the indices of other particles to write beside the vertices, as cells of a point each
        speciesNames : sequence of str
            what the species of the vertices are called, if they have names

        Raises
        ------
        ValueError
            if `append` is asked for and the file is not a mesh trajectory of this membrane, or has fewer frames than
            `numFrames`
        OSError
            if the file cannot be written
        """
        reportInterval = wholeNumber(reportInterval, "reportInterval", 1)
        if numFrames is not None and not append:
            raise ValueError(f"numFrames is {numFrames} and append False; numFrames is for appending")
        self._reportInterval, self._force = reportInterval, force
        self._speciesNames = tuple(speciesNames)
        triangles = force.getTriangles()
        isVertex = isUsed(triangles, int(triangles.max(initial=-1)) + 1)
        self._vertices, self._beads = np.flatnonzero(isVertex), np.asarray(beads, dtype=np.int64)
        self._numbers = (
            np.cumsum(isVertex, dtype=np.int32) - 1
        )  # of the vertices, which other particles may lie between
        isLater = append and numFrames != 0 and Path(file).exists()
        self._names = self._requireSameMembrane(file) if isLater else None
        self._writer = MeshTrajectoryWriter(file, numFrames if append else 0, precision, lengthUnit)
        # A script that ends without close() has its last frames too.
        self._end = weakref.finalize(self, self._writer.close)

    def describeNextReport(self, simulation: app.Simulation) -> dict[str, Any]:
        """Get information about the next report this object will generate."""
        steps = self._reportInterval - simulation.currentStep % self._reportInterval
        return {"steps": steps, "periodic": False, "include": ["positions"]}

    def report(self, simulation: app.Simulation, state: mm.State) -> None:
        """Add a frame."""
        positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        geometry = self._force.getGeometryInContext(simulation.context)
        areas = valueIn(geometry.vertexAreas, unit.nanometer**2)
        curvatures = valueIn(geometry.vertexMeanCurvatures, unit.nanometer)
        triangles = self._numbers[self._force.getTrianglesInContext(simulation.context)]
        species = self._force.getVertexSpeciesInContext(simulation.context)
        beads = positions[self._beads]
        box = boxOf(state, self._force)
        mesh = Mesh(positions[self._vertices], triangles, box, beads, species, self._speciesNames)
        data = {
            "MeanCurvature": localMeanCurvatures(curvatures, areas),
            "SmoothMeanCurvature": smoothCurvatures(mesh.edges, curvatures, areas),
            "Area": areas,
            **({} if mesh.species is None else {"Species": mesh.species}),
        }
        names = self._names or data  # those of a file of an earlier version stay
        frame = {name: np.float32(data[name]) for name in names if name in data}
        self._writer.add(MeshFrame(simulation.currentStep, mesh, frame))

    def getNumFrames(self) -> int:
        """Get the number of frames so far, in the file and waiting."""
        return self._writer.numFrames

    def flush(self) -> None:
        """Make the file complete with all frames so far.

        If this fails, the file is as it was and the frames go on waiting.
        """
        self._writer.flush()

    def close(self) -> None:
        """Write the last frames."""
        try:
            self._writer.close()
        finally:
            self._end.detach()

    def _requireSameMembrane(self, file: PathLike) -> list[str]:
        """Raise a ValueError if a file is of another membrane; return the names of its data."""
        trajectory = readMeshTrajectory(file)
        with trajectory:
            found, names = trajectory.layout()
        own = len(self._vertices), self._force.getNumTriangles(), len(self._beads)
        if found != own:
            what = " and {} beads" if found[2] != own[2] else ""
            raise ValueError(
                f"{file} has frames of {found[0]} vertices and {found[1]} triangles{what.format(found[2])}; "
                f"this membrane has {own[0]} and {own[1]}{what.format(own[2])}"
            )
        return names
