"""Reporters for openmm.app.Simulation."""

import csv
import math
import weakref
from pathlib import Path
from typing import Dict, Optional

import numpy as np
from openmm import unit

from ..files import PathLike, replacing
from ..helfrich import HelfrichForce
from ..geometry.mesh import Mesh, reducedVolume
from ..optional import dataFrame
from ..io.vtkhdf import MeshFrame, MeshTrajectoryWriter, readMeshTrajectory

ENERGY_TERMS = ("bending", "area", "volume", "areaDifference", "tether", "repulsion")


class ObservablesReporter:
    """Writes a table of a membrane's energy terms, geometry and acceptance rates as comma-separated values.

    The first row names the columns, with units.  The membrane's energy is the sum of the six terms that follow it.  Acceptance rates, the
    flip rate (flips accepted per edge and sweep), the fraction of attempted flips that the rules forbid, and the number of trajectories that diverged are
    those since the start of the simulation; they are there if the Integrator has them.
    """

    def __init__(self, file, reportInterval, force, temperature=None, lengthUnit="nm", append=False, describe=None):
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
            add to an existing file instead of replacing it
        describe : callable, optional
            returns more columns, as a dict from names to numbers
        """
        self._reportInterval = reportInterval
        self._force = force
        self._energyUnit, self._energyScale = "kJ/mol", 1.0
        if temperature is not None:
            self._energyUnit, self._energyScale = "kT", 1 / thermalEnergy(temperature)
        self._lengthUnit, self._describe = lengthUnit, describe
        self._ownsFile = not hasattr(file, "write")
        self._out = open(file, "a" if append else "w", newline="") if self._ownsFile else file
        self._writer = csv.writer(self._out, lineterminator="\n")
        self._hasHeader = append

    def describeNextReport(self, simulation):
        """Get information about the next report this object will generate."""
        steps = self._reportInterval - simulation.currentStep % self._reportInterval
        return {"steps": steps, "periodic": None, "include": []}

    def report(self, simulation, state):
        """Write a row."""
        row = self.observe(simulation)
        if not self._hasHeader:
            self._writer.writerow(row)
            self._hasHeader = True
        self._writer.writerow(row.values())
        self._out.flush()

    def observe(self, simulation):
        """Return the row that describes a Simulation now, as a dict from column names to numbers."""
        row = {"step": simulation.currentStep}
        row.update(self._energies(simulation.context))
        row.update(self._geometry(simulation.context))
        integrator = simulation.integrator
        if hasattr(integrator, "getAcceptanceRate"):
            row["acceptance"] = integrator.getAcceptanceRate()
        if hasattr(integrator, "getFlipAcceptanceRate"):
            row["flipAcceptance"] = integrator.getFlipAcceptanceRate()
        if hasattr(integrator, "getShearWaveProbability") and integrator.getNumIntegrators() > 2:
            row["waveAcceptance"] = integrator.getShearWaveAcceptanceRate()
            row[f"waveAmplitude ({self._lengthUnit})"] = valueIn(
                integrator.getShearWaveIntegrator().getAmplitude(), unit.nanometer
            )
        flips = integrator.getFlipIntegrator() if hasattr(integrator, "getFlipIntegrator") else integrator
        if hasattr(flips, "getFlipRate"):
            row["flipRate"] = flips.getFlipRate()
            row["flipsForbidden"] = flips.getNumForbidden() / max(1, flips.getNumAttempted())
        if hasattr(integrator, "getNumDivergedTrajectories"):
            row["diverged"] = integrator.getNumDivergedTrajectories()
        if self._describe:
            row.update(self._describe())
        return row

    def sync(self):
        """Return the size of the file so far, in bytes; they have left Python's buffers."""
        self._out.flush()
        return self._out.seek(0, 2)

    def close(self):
        """Close the file."""
        if self._ownsFile:
            self._out.close()

    def _energies(self, context):
        terms = self._force.getEnergyTermsInContext(context)
        values = [valueIn(terms[name], unit.kilojoules_per_mole) * self._energyScale for name in ENERGY_TERMS]
        names = [f"E_{name} ({self._energyUnit})" for name in ENERGY_TERMS]
        return {f"energy ({self._energyUnit})": sum(values), **dict(zip(names, values))}

    def _geometry(self, context):
        geometry, u = self._force.getGeometryInContext(context), self._lengthUnit
        area, volume = valueIn(geometry.area, unit.nanometer**2), valueIn(geometry.volume, unit.nanometer**3)
        return {
            f"area ({u}^2)": area,
            f"volume ({u}^3)": volume,
            "reducedVolume": reducedVolume(area, volume),
            f"areaDifference ({u}^2)": valueIn(geometry.areaDifference, unit.nanometer**2),
            f"meanCurvature ({u})": valueIn(geometry.integratedMeanCurvature, unit.nanometer),
        }


class MeshReporter:
    """Writes a membrane's positions and live triangles to a VTKHDF file, which ParaView and pyvista play as a time series.

    Each frame has the mean curvature ("MeanCurvature", in 1/nm) and the area ("Area", in nm^2) of each vertex, and the step as its time.
    :func:`readMeshTrajectory` reads the frames back.

    The file is complete at any moment, whatever happens to the program: new frames wait in memory until they are written all at once, after a
    minute or so, at :meth:`flush` and at :meth:`close`, or else at the end of the program.  To write the frames up to a checkpoint, call
    ``flush()`` before making it, and save ``getNumFrames()`` with it; to go on from there, create the reporter with ``append=True`` and that number
    as `numFrames`: later frames, which the run will make again, are dropped.
    """

    def __init__(
        self,
        file: PathLike,
        reportInterval: int,
        force: HelfrichForce,
        append: bool = False,
        numFrames: Optional[int] = None,
        precision: str = "double",
        lengthUnit: str = "nm",
    ):
        """Create a MeshReporter.

        Parameters
        ----------
        file : path
            where to write to, by custom with the suffix .vtkhdf
        reportInterval : int
            the number of steps between frames
        force : HelfrichForce
            the membrane; particles that belong to none of its triangles are left out
        append : bool
            add to an existing file instead of replacing it
        numFrames : int, optional
            when appending, the number of frames of the existing file to keep; all by default
        precision : str
            of the positions: "double", or "single" for files that are a third smaller
        lengthUnit : str
            the name of the unit of length, if 1 nm stands for another

        Raises
        ------
        ValueError
            if `append` is asked for and the file is not a mesh trajectory of this membrane, or has fewer frames than `numFrames`
        OSError
            if the file cannot be written
        """
        if reportInterval < 1:
            raise ValueError(f"reportInterval is {reportInterval}; it must be 1 or more")
        if numFrames is not None and not append:
            raise ValueError(f"numFrames is {numFrames} and append False; numFrames is for appending")
        self._reportInterval, self._force = reportInterval, force
        self._vertices = np.unique(force.getTriangles())
        if append and numFrames != 0 and Path(file).exists():
            self._requireSameMembrane(file)
        self._writer = MeshTrajectoryWriter(file, numFrames if append else 0, precision, lengthUnit)
        # A script that ends without close() has its last frames too.
        self._end = weakref.finalize(self, self._writer.close)

    def describeNextReport(self, simulation):
        """Get information about the next report this object will generate."""
        steps = self._reportInterval - simulation.currentStep % self._reportInterval
        return {"steps": steps, "periodic": False, "include": ["positions"]}

    def report(self, simulation, state):
        """Add a frame."""
        positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        geometry = self._force.getGeometryInContext(simulation.context)
        areas = valueIn(geometry.vertexAreas, unit.nanometer**2)
        curvatures = valueIn(geometry.vertexMeanCurvatures, unit.nanometer)
        # The vertices are numbered anew if other particles lie between them.
        triangles = np.searchsorted(self._vertices, self._force.getTrianglesInContext(simulation.context))
        mesh = Mesh(positions[self._vertices], triangles)
        self._writer.add(
            MeshFrame(
                simulation.currentStep,
                mesh,
                {"MeanCurvature": np.float32(curvatures / areas), "Area": np.float32(areas)},
            )
        )

    def getNumFrames(self) -> int:
        """Get the number of frames so far, in the file and waiting."""
        return self._writer.numFrames

    def flush(self) -> None:
        """Make the file complete with all frames so far.  This copies it, which takes time in proportion to its size."""
        self._writer.flush()

    def close(self) -> None:
        """Write the last frames."""
        try:
            self._writer.close()
        finally:
            self._end.detach()

    def _requireSameMembrane(self, file):
        with readMeshTrajectory(file) as trajectory:
            mesh = trajectory[0].mesh
        if (len(mesh.vertices), len(mesh.triangles)) != (len(self._vertices), self._force.getNumTriangles()):
            raise ValueError(
                f"{file} has frames of {len(mesh.vertices)} vertices and {len(mesh.triangles)} triangles; "
                f"this membrane has {len(self._vertices)} and {self._force.getNumTriangles()}"
            )


class Table(dict):
    """Columns of numbers: a dict from names to arrays of equal length."""

    @classmethod
    def ofRows(cls, rows):
        """Create a Table from dicts with the same keys, of whose names the units in brackets are left out."""
        return cls(
            (plainName(name), np.array([row[name] for row in rows], dtype=float)) for name in (rows[0] if rows else ())
        )

    @classmethod
    def concatenate(cls, tables):
        """Create a Table of the rows of several, which have the same columns."""
        return cls((name, np.concatenate([table[name] for table in tables])) for name in tables[0])

    def toDataFrame(self):
        """Return a pandas.DataFrame of the same columns."""
        return dataFrame(self)

    def where(self, chosen):
        """Return a Table of the rows that an array of booleans chooses."""
        return Table((name, values[chosen]) for name, values in self.items())

    def write(self, file):
        """Write the table as comma-separated values, replacing a file that exists in a single step."""
        with replacing(file) as part, open(part, "w", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(self)
            writer.writerows(zip(*(values.tolist() for values in self.values())))


def readObservables(file):
    """Read a table that an :class:`ObservablesReporter` wrote: a :class:`Table`, a dict from column names, without their units, to arrays."""
    with open(file, newline="") as table:
        rows = list(csv.reader(table))
    if not rows:
        raise ValueError(f"{file} is empty; it must hold a table of observables")
    columns = np.array(rows[1:], dtype=float).reshape(-1, len(rows[0])).T
    return Table(zip(map(plainName, rows[0]), columns))


def plainName(column):
    """Return the name of a column without its unit."""
    return column.split(" (")[0]


def observableUnits(file: PathLike) -> Dict[str, str]:
    """Return the units of the columns of a table that an :class:`ObservablesReporter` wrote: a dict from column names to what their heads have in brackets."""
    with open(file, newline="") as table:
        heads = next(csv.reader(table), [])
    units = dict(head.rstrip(")").split(" (") for head in heads if " (" in head)
    if not {"energy", "area"} <= set(units):
        raise ValueError(f"{file} is not a table of observables; it has no columns 'energy (...)' and 'area (...)'")
    return units


def thermalEnergy(temperature):
    """Return kT, in kJ/mol, of a temperature in K."""
    temperature = valueIn(temperature, unit.kelvin)
    if not (math.isfinite(temperature) and temperature > 0):
        raise ValueError(f"the temperature is {temperature} K; it must be positive")
    return (unit.MOLAR_GAS_CONSTANT_R * temperature * unit.kelvin).value_in_unit(unit.kilojoules_per_mole)


def valueIn(value, wanted):
    """Return a Quantity, or a number that has this unit already, as a number."""
    return value.value_in_unit(wanted) if unit.is_quantity(value) else value
