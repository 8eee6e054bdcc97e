"""DCD trajectories whose bytes are those of their frames alone, and which go on after a frame that was cut short."""

import struct

import openmm as mm
from openmm import app

from ..files import PathLike

# Where the header has the number of frames, the first step, the interval and the last step, its second title, and its
# end.
_COUNTERS, _TITLE, _END = 8, 180, 276


class TrajectoryReporter(app.DCDReporter):
    """Writes a DCD file, as openmm.app.DCDReporter does, without the date in its header: equal runs write equal files.

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
        if size > 0:
            _cut(file, size)
        super().__init__(str(file), reportInterval, append=size > 0)

    def report(self, simulation: app.Simulation, state: mm.State) -> None:
        """Write a frame."""
        isNew = self._dcd is None and not self._append
        super().report(simulation, state)
        if isNew:
            self._out.seek(_TITLE)
            self._out.write(struct.pack("<80s", b"Written by openmm-helfrich"))
            self._out.flush()

    def sync(self) -> int:
        """Return the size of the file so far, in bytes; they have left Python's buffers."""
        self._out.flush()
        return self._out.seek(0, 2)

    def close(self) -> None:
        """Close the file."""
        self._out.close()


def _cut(file: PathLike, size: int) -> None:
    """Drop what follows the first bytes of a DCD file, and count the frames that are left."""
    with open(file, "r+b") as out:
        out.truncate(size)
        out.seek(_END - 8)
        (atoms,) = struct.unpack("<i", out.read(4))
        frames, rest = divmod(size - _END, 3 * (4 * atoms + 8))
        if rest:
            raise ValueError(
                f"{file} does not hold whole frames up to byte {size}; it is not the trajectory that the run wrote"
            )
        out.seek(_COUNTERS)
        _, first, interval, _ = struct.unpack("<4i", out.read(16))
        out.seek(_COUNTERS)
        out.write(struct.pack("<4i", frames, first, interval, first + (frames - 1) * interval))
