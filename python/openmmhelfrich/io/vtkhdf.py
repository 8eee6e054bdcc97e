"""Mesh trajectories: positions, live triangles and values at the vertices, frame by frame, in one VTKHDF file.

VTKHDF is VTK's own HDF5 layout, which ParaView and pyvista play as a time series.  A file of ours is a PolyData with
Steps, version 2.0 of the specification
(https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/vtkhdf_specifications.html).  The numbers of
vertices and of triangles are those of the first frame, so that the sizes of the one part and the Offsets of its
triangles are stored once, and each frame is a chunk of every other array: what a frame costs does not depend on how
many there are, and the last ones can be dropped.
"""

import contextlib
import os
import shutil
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, overload

import h5py
import numpy as np
from numpy.typing import NDArray

from ..files import PathLike, replacing
from ..geometry.measures import localMeanCurvatures
from ..geometry.mesh import Mesh

VERSION = (2, 0)
# Chosen by measurement (docs/looking.md): higher levels take longer for a percent or less.  Shuffled bytes of 64-bit
# indices, which is what VTK reads into, compress as well as those of shorter ones.
COMPRESSION = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
# VTK wants all four kinds of cells, in this order.
KINDS = ("Vertices", "Lines", "Polygons", "Strips")


class MeshFrame(NamedTuple):
    """A frame of a mesh trajectory.

    Attributes
    ----------
    step : int
        the number of the step, which is the time in the file
    mesh : Mesh
        positions, in nm, and the triangles at that step
    data : dict
        arrays of shape (N,) by name, a value for each vertex: "MeanCurvature", in 1/nm, and "Area", in nm^2, from a
        MeshReporter
    """

    step: int
    mesh: Mesh
    data: dict[str, np.ndarray]


def meshFrame(step: int, mesh: Mesh) -> MeshFrame:
    """Return a MeshFrame of a closed mesh with the mean curvature and the area of its vertices."""
    area = mesh.vertexAreas
    return MeshFrame(step, mesh, {"MeanCurvature": localMeanCurvatures(mesh.vertexMeanCurvatures, area), "Area": area})


def writeMeshTrajectory(
    file: PathLike, frames: Iterable[MeshFrame], keep: int = 0, precision: str = "double", lengthUnit: str = "nm"
) -> None:
    """Write frames to a file, in a single step: whatever happens meanwhile, the file is the old one or the new one,
    never half of one.

    Parameters
    ----------
    file : path
        the file to write.  A file that exists is replaced, but for the frames to keep
    frames : iterable of MeshFrame
        what to write, all with the same numbers of vertices and triangles and the same data
    keep : int
        the number of frames at the beginning of the file that stay; `frames` follow them
    precision : str
        "double" or "single", of a new file's positions.  The data are single
    lengthUnit : str
        the name of a new file's unit of length

    Raises
    ------
    ValueError
        if the file has fewer than `keep` frames, or a frame differs in size from the first
    OSError
        if the file cannot be written
    """
    path = Path(file)
    # The new file grows from a copy in the same folder, which then takes its place.
    with _plainErrors(path), replacing(path) as part:
        if keep:
            shutil.copyfile(path, part)
        if isinstance(frames, list):
            _requireRoom(part, frames)
        with h5py.File(part, "a" if keep else "w", locking=False) as out:
            root = _existing(out, path, keep) if keep else None
            for frame in frames:
                root = root or _create(out, frame, precision, lengthUnit)
                _append(root, frame)
            if root is None:
                raise ValueError(f"{path}: there are no frames to write")


def readMeshTrajectory(file: PathLike) -> "MeshTrajectory":
    """Open a mesh trajectory: a sequence of :class:`MeshFrame`, each read when it is asked for.

    ::

        for frame in mh.readMeshTrajectory("vesicle.vtkhdf"):
            print(frame.step, frame.mesh.reducedVolume, frame.data["MeanCurvature"].max())

    Raises
    ------
    FileNotFoundError
        if there is no such file
    ValueError
        if it is not a VTKHDF file of PolyData with time steps, or is damaged
    """
    return MeshTrajectory(file)


class MeshTrajectoryWriter:
    """Adds frames to a mesh trajectory as they come.

    New frames wait in memory until :meth:`flush` makes the file complete with them, as :func:`writeMeshTrajectory`
    does.  That copies the file, and so :meth:`add` flushes at most a fiftieth of the time: when a minute has passed
    since the last time, or 50 times as long as that took, or earlier when 64 MB wait.  The first frame is written at
    once.
    """

    def __init__(self, file: PathLike, numFrames: int | None = 0, precision: str = "double", lengthUnit: str = "nm"):
        """Open a file.

        Parameters
        ----------
        file : path
            the file to write.  With `numFrames` 0 one that exists is deleted
        numFrames : int or None
            go on after this number of frames of a file that exists, dropping those beyond it; None keeps all
        precision, lengthUnit : str
            see :func:`writeMeshTrajectory`
        """
        self._path, self._options = Path(file), {"precision": precision, "lengthUnit": lengthUnit}
        existing = _count(self._path) if numFrames is None or numFrames > 0 else 0
        self._kept = existing if numFrames is None else numFrames
        if self._kept > existing:
            raise ValueError(f"{self._path} has {existing} frames; it should have {self._kept} or more to go on from")
        _requireFolder(self._path)
        if self._kept == 0:
            self._path.unlink(missing_ok=True)
        self._surplus = existing > self._kept
        self._nextFlush, self._closed = 0.0, False
        self._waiting: list[MeshFrame] = []

    @property
    def numFrames(self) -> int:
        """The number of frames, with those that wait."""
        return self._kept + len(self._waiting)

    def add(self, frame: MeshFrame) -> None:
        """Add a MeshFrame."""
        if self._closed:
            raise ValueError(f"{self._path} is closed; no frame can be added")
        self._waiting.append(frame)
        size = _sizeOf(frame)
        if time.monotonic() >= self._nextFlush or size * len(self._waiting) > 64e6:
            self.flush()

    def flush(self) -> None:
        """Make the file complete with all frames so far.

        If this fails, the file is as it was and the frames go on waiting.
        """
        start = time.monotonic()
        if self._waiting or self._surplus:
            writeMeshTrajectory(self._path, self._waiting, self._kept, **self._options)
            self._kept, self._waiting, self._surplus = self.numFrames, [], False
        end = time.monotonic()
        self._nextFlush = end + max(60, 50 * (end - start))

    def close(self) -> None:
        """Flush, and take no more frames."""
        if not self._closed:
            self.flush()
            self._closed = True


class Frames(ABC, Sequence[MeshFrame]):
    """A sequence of :class:`MeshFrame` in a file: its length, its items, its slices (lists) and its iterator; each
    frame is read when it is asked for.

    Indices may be negative; those out of range raise an IndexError.

    Attributes
    ----------
    steps : (F,) int64 array
        the step of each frame
    lengthUnit : str
        the name of the unit of length
    """

    steps: NDArray[np.int64]
    lengthUnit: str
    _path: Path
    _file: Any

    def __len__(self) -> int:
        return len(self.steps)

    @overload
    def __getitem__(self, index: int) -> MeshFrame: ...

    @overload
    def __getitem__(self, index: slice) -> list[MeshFrame]: ...

    def __getitem__(self, index: int | slice) -> MeshFrame | list[MeshFrame]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(
                f"{self._path} has no frame {index}; it has {len(self)}: 0 to {len(self) - 1}, or -1 for the last"
            )
        index %= len(self)
        with self._complaint(f"is damaged at frame {index}"):
            return self._read(index)

    @abstractmethod
    def _read(self, i: int) -> MeshFrame:
        """Return a frame."""

    def __iter__(self) -> Iterator[MeshFrame]:
        return (self[i] for i in range(len(self)))

    def __enter__(self) -> "Frames":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @contextlib.contextmanager
    def _complaint(self, what):
        """Name the file in whatever its reader finds wrong with it."""
        try:
            yield
        except (OSError, KeyError, ValueError, IndexError, RuntimeError) as error:
            raise ValueError(f"{self._path} {what}: {str(error).strip(chr(39))}") from None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {len(self)} frames in {self._path}>"


class MeshTrajectory(Frames):
    """The frames of a VTKHDF file."""

    def __init__(self, file: PathLike):
        self._path = Path(file)
        if not self._path.exists():
            raise FileNotFoundError(f"there is no mesh trajectory {file}")
        try:
            # Files are replaced, never changed, and not every file system has locks.
            self._file = h5py.File(self._path, locking=False)
        except OSError:
            raise ValueError(f"{file} is not a VTKHDF file, or not a complete one") from None
        self._root = _polyData(self._file, self._path)
        with self._complaint("is damaged"):
            self.steps = np.asarray(self._root["Steps/Values"][: int(self._root["Steps"].attrs["NSteps"])]).astype(
                np.int64
            )
            self.lengthUnit = str(self._file.attrs.get("lengthUnit", "nm"))

    def _read(self, i):
        steps, polygons = self._root["Steps"], self._root["Polygons"]
        if steps.get("NumberOfParts") is not None and steps["NumberOfParts"][i] != 1:
            raise ValueError("it has several parts; one is expected")
        part = steps["PartOffsets"][i]
        numVertices = int(self._root["NumberOfPoints"][part])
        numCells, numCorners = int(polygons["NumberOfCells"][part]), int(polygons["NumberOfConnectivityIds"][part])
        cell, first = int(steps["CellOffsets"][i, 2]), int(steps["ConnectivityIdOffsets"][i, 2])
        if np.any(np.diff(polygons["Offsets"][cell + part : cell + part + numCells + 1]) != 3):
            raise ValueError("it has cells that are not triangles")
        point = int(steps["PointOffsets"][i])
        mesh = Mesh(
            self._root["Points"][point : point + numVertices],
            polygons["Connectivity"][first : first + numCorners].reshape(-1, 3),
        )
        offsets = {name: int(d[i]) for name, d in steps.get("PointDataOffsets", {}).items()}
        return MeshFrame(
            int(self.steps[i]),
            mesh,
            {name: self._root["PointData"][name][start : start + numVertices] for name, start in offsets.items()},
        )


def _count(path):
    """Return the number of frames in a file, 0 if there is none."""
    if not path.exists():
        return 0
    with readMeshTrajectory(path) as trajectory:
        return len(trajectory)


def _requireFolder(path):
    """Raise an OSError at once if a file cannot be made here."""
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; the name of a file is expected")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {path.parent} for {path.name}")
    if not os.access(path.parent, os.W_OK):
        raise PermissionError(f"{path.parent} is not writable; {path.name} cannot be made there")


def _polyData(file, path):
    """Return the group of an open file that holds the PolyData."""
    root = file.get("VTKHDF")
    kind = root.attrs.get("Type") if isinstance(root, h5py.Group) else None
    if kind is None:
        raise ValueError(f"{path} is not a VTKHDF file; it has no group VTKHDF with a Type")
    kind = kind.decode(errors="replace") if isinstance(kind, bytes) else str(kind)
    if kind != "PolyData" or "Steps" not in root:
        raise ValueError(
            f"{path} holds {kind}{'' if 'Steps' in root else ' without time steps'}; PolyData with steps is expected"
        )
    return root


def _existing(out, path, keep):
    """Return the group to which to append, with `keep` frames in it."""
    root = _polyData(out, path)
    count = int(root["Steps"].attrs["NSteps"])
    if count < keep:
        raise ValueError(f"{path} has {count} frames; it should have {keep} or more to go on from")
    _resize(root, keep)
    return root


def _create(out, frame, precision, lengthUnit):
    """Lay out a file for frames like this one."""
    if precision not in ("double", "single"):
        raise ValueError(f"precision is {precision!r}; it must be 'double' or 'single'")
    numVertices, numTriangles = len(frame.mesh.vertices), len(frame.mesh.triangles)
    out.attrs["lengthUnit"] = lengthUnit
    root = out.create_group("VTKHDF")
    root.attrs["Version"] = VERSION
    root.attrs.create("Type", b"PolyData", dtype="S8")  # of fixed length: VTK takes no other
    root["NumberOfPoints"] = np.array([numVertices])
    root.create_dataset(
        "Points",
        (0, 3),
        "f8" if precision == "double" else "f4",
        maxshape=(None, 3),
        chunks=(numVertices, 3),
        **COMPRESSION,
    )
    for kind in KINDS:
        cells = root.create_group(kind)
        count = numTriangles if kind == "Polygons" else 0
        cells["NumberOfCells"], cells["NumberOfConnectivityIds"] = np.array([count]), np.array([3 * count])
        cells.create_dataset("Offsets", data=3 * np.arange(count + 1), **COMPRESSION)
        cells.create_dataset("Connectivity", (0,), "i8", maxshape=(None,), chunks=(max(1, 3 * count),), **COMPRESSION)
    data, steps = root.create_group("PointData"), root.create_group("Steps")
    offsets = steps.create_group("PointDataOffsets")
    for name in frame.data:
        data.create_dataset(name, (0,), "f4", maxshape=(None,), chunks=(numVertices,), **COMPRESSION)
        _growing(offsets, name)
    steps.attrs["NSteps"] = 0
    _growing(steps, "Values", kind="f8")
    for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
        _growing(steps, name)
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        _growing(steps, name, 4)
    return root


def _growing(group, name, columns=None, kind="i8"):
    """Create an empty array with an entry for each step."""
    tail = () if columns is None else (columns,)
    group.create_dataset(name, (0, *tail), kind, maxshape=(None, *tail), chunks=(256, *tail))


def _resize(root, count):
    """Make room for a number of frames, or drop those beyond it."""
    numVertices, numCorners = int(root["NumberOfPoints"][0]), int(root["Polygons/NumberOfConnectivityIds"][0])
    root["Points"].resize(count * numVertices, axis=0)
    root["Polygons/Connectivity"].resize(count * numCorners, axis=0)
    for values in root["PointData"].values():
        values.resize(count * numVertices, axis=0)
    steps = root["Steps"]
    for entries in [
        *steps["PointDataOffsets"].values(),
        *(steps[name] for name in steps if name != "PointDataOffsets"),
    ]:
        entries.resize(count, axis=0)
    steps.attrs["NSteps"] = count


def _append(root, frame):
    """Add a frame."""
    mesh, data, steps = frame.mesh, root["PointData"], root["Steps"]
    count = int(steps.attrs["NSteps"])
    expected = int(root["NumberOfPoints"][0]), int(root["Polygons/NumberOfCells"][0]), set(data)
    if (len(mesh.vertices), len(mesh.triangles), set(frame.data)) != expected:
        raise ValueError(
            f"the frame of step {frame.step} has {len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles and "
            f"the data {sorted(frame.data)}; those before it have {expected[0]}, {expected[1]} and "
            f"{sorted(expected[2])}"
        )
    _resize(root, count + 1)
    point, corner = count * len(mesh.vertices), count * mesh.triangles.size
    root["Points"][point:] = mesh.vertices
    root["Polygons/Connectivity"][corner:] = mesh.triangles.ravel()
    for name, values in frame.data.items():
        data[name][point:] = values
        steps["PointDataOffsets"][name][count] = point
    entries = {
        "Values": frame.step,
        "PartOffsets": 0,
        "NumberOfParts": 1,
        "PointOffsets": point,
        "CellOffsets": 0,
        "ConnectivityIdOffsets": [0, 0, corner, 0],
    }
    for name, entry in entries.items():
        steps[name][count] = entry


def _requireRoom(part, frames):
    """Raise OSError if the disk has no room for more frames: after a write that failed HDF5 may take the whole program
    with it.
    """
    if not hasattr(os, "posix_fallocate"):
        return
    raw = sum(_sizeOf(frame) + 1024 for frame in frames)
    with open(part, "ab") as out:
        size = out.tell()
        os.posix_fallocate(out.fileno(), 0, size + raw + 65536)
        out.truncate(size)


def _sizeOf(frame):
    """Return the number of bytes of a frame in a file, before compression; indices have 64 bits there."""
    return (
        frame.mesh.vertices.nbytes
        + 2 * frame.mesh.triangles.nbytes
        + sum(values.nbytes for values in frame.data.values())
    )


@contextlib.contextmanager
def _plainErrors(path):
    """Say in a sentence what HDF5 says in its own words."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        number = getattr(error, "errno", None)
        raise (
            OSError(number, f"{path} cannot be written: {os.strerror(number)}")
            if number
            else OSError(f"{path} cannot be written: {error}")
        ) from None
