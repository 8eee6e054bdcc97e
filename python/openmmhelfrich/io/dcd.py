"""DCD trajectories whose bytes are those of their frames alone, and which go on after a frame that was cut short."""

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import openmm as mm
from openmm import app, unit

from ..files import PathLike

# CHARMM's layout, as OpenMM and NAMD write it: records of 32-bit words, each between two words with its size in bytes.
# The counters are those of frames, the first step, the interval and the last step.
_COUNTERS, _STEP_SIZE, _NUM_ATOMS, _END = 8, 44, 268, 276
_TITLES = (b"Created by OpenMM", b"Written by openmm-helfrich")
_CHARMM_VERSION = 24
_AKMA_TIME = 0.04888821  # CHARMM's unit of time, in ps
_MOST_STEPS = 1 << 31  # that a header can tell


class TrajectoryReporter:
    """Writes the DCD file that openmm.app.DCDReporter does, but for the date in its header: equal runs write equal
    files.

    Parameters
    ----------
    file : path
        the file to write
    reportInterval : int
        the number of steps between frames
    size : int
        the number of bytes of an existing file to keep and go on from, as :meth:`sync` returned it; 0 replaces the file
    """

    def __init__(self, file: PathLike, reportInterval: int, size: int = 0):
        self._path, self._reportInterval = Path(file), reportInterval
        # Of frames; the first step and the interval, of which long runs have others in their headers.
        self._count, self._first, self._interval = 0, reportInterval, reportInterval
        self._out = open(file, "r+b" if size > 0 else "w+b")  # noqa: SIM115
        if size > 0:
            self._cut(size)

    def describeNextReport(self, simulation: app.Simulation) -> dict[str, Any]:
        """Get information about the next report this object will generate."""
        steps = self._reportInterval - simulation.currentStep % self._reportInterval
        return {"steps": steps, "periodic": None, "include": ["positions"]}

    def report(self, simulation: app.Simulation, state: mm.State) -> None:
        """Write a frame.  Raises a ValueError if a position is not finite."""
        positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        if not np.isfinite(positions).all():
            raise ValueError(f"{self._path}: a position in step {simulation.currentStep} is not finite")
        stepSize = simulation.integrator.getStepSize().value_in_unit(unit.picosecond)
        if self._count == 0:
            self._out.write(_header(len(positions), self._interval, stepSize))
        self._out.seek(0, os.SEEK_END)
        size = struct.pack("<i", 4 * len(positions))
        for axis in range(3):
            self._out.write(size + (10 * positions[:, axis]).astype("<f4").tobytes() + size)
        self._count += 1
        self._writeCounters()
        self._out.flush()

    def sync(self) -> int:
        """Return the size of the file so far, in bytes; they have left Python's buffers."""
        self._out.flush()
        return self._out.seek(0, os.SEEK_END)

    def close(self) -> None:
        """Close the file."""
        self._out.close()

    def _cut(self, size: int) -> None:
        """Drop what follows the first bytes of the file, and count the frames that are left."""
        self._out.truncate(size)
        self._out.seek(_NUM_ATOMS)
        (atoms,) = struct.unpack("<i", self._out.read(4))
        self._count, rest = divmod(size - _END, 3 * (4 * atoms + 8))
        if rest:
            raise ValueError(
                f"{self._path} does not hold whole frames up to byte {size}; it is not the trajectory that the run "
                "wrote"
            )
        self._out.seek(_COUNTERS)
        _, self._first, self._interval = struct.unpack("<3i", self._out.read(12))
        self._writeCounters()

    def _writeCounters(self) -> None:
        if self._interval > 1 and self._first + self._count * self._interval > _MOST_STEPS:
            self._mergeSteps()
        last = self._first + (self._count - 1) * self._interval
        self._out.seek(_COUNTERS)
        self._out.write(struct.pack("<4i", self._count, self._first, self._interval, last))

    def _mergeSteps(self) -> None:
        """Tell of fewer and longer steps: an interval is one."""
        self._out.seek(_STEP_SIZE)
        (stepSize,) = struct.unpack("<f", self._out.read(4))
        self._out.seek(_STEP_SIZE)
        self._out.write(struct.pack("<f", stepSize * self._interval))
        self._first, self._interval = self._first // self._interval, 1


def _header(numAtoms: int, interval: int, stepSize: float) -> bytes:
    """Return the beginning of a file without frames."""
    counters = struct.pack("<i4s9if", 84, b"CORD", 0, interval, interval, *[0] * 6, stepSize / _AKMA_TIME)
    titles = struct.pack("<9i4i80s80si", *[0] * 9, _CHARMM_VERSION, 84, 164, 2, *_TITLES, 164)
    return counters + titles + struct.pack("<3i", 4, numAtoms, 4)
