"""Mesh trajectories: positions, live triangles and values at the vertices, frame by frame, in one VTKHDF file.

VTKHDF is VTK's own HDF5 layout, which ParaView and pyvista play as a time series.  A file of ours is a PolyData with
Steps, version 2.0 of the specification
(https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/vtkhdf_specifications.html).  The numbers of
vertices and of triangles, and the box of a periodic membrane, are those of the first frame, so that the sizes of the
one part and the Offsets of its triangles are stored once, and each frame is a chunk of every other array: what a frame
costs does not depend on how many there are, and the last ones can be dropped.
How a file is changed without a moment in which it is not whole, :mod:`.drafts` says.
"""

import contextlib
import itertools
import math
import os
import shutil
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, overload

import h5py
import numpy as np
from numpy.typing import NDArray

from ..files import PathLike, replacing, requireStored
from ..geometry.measures import localMeanCurvatures, smoothCurvatures
from ..geometry.mesh import Mesh
from .drafts import Draft, GrowingFile, signalsLater

VERSION = (2, 0)
# Chosen by measurement (docs/results/mesh-trajectory.md): higher levels take longer for a percent or less.  Shuffled
# bytes of 64-bit indices, which is what VTK reads into, compress as well as those of shorter ones.
COMPRESSION = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
# VTK wants all four kinds of cells, in this order.
KINDS = ("Vertices", "Lines", "Polygons", "Strips")
# The rows of a chunk of the small arrays, which have a row for each step.
BLOCK = 256
# As many bytes of new frames may wait in memory.
MAX_WAITING = 64e6

Found = TypeVar("Found")


class MeshFrame(NamedTuple):
    """A frame of a mesh trajectory.

    ::

        frame = mh.meshFrame(0, mesh)
        print(frame.step, frame.mesh.area, frame.data["MeanCurvature"].mean())

    Attributes
    ----------
    step : int
        the number of the step, which is the time in the file
    mesh : Mesh
        positions, in nm, and the triangles at that step, and the beads if there are any
    data : dict
        arrays of shape (N,) by name, a value for each vertex: "MeanCurvature" and "SmoothMeanCurvature", in 1/nm, and
        "Area", in nm^2, from a MeshReporter; and "Species", the numbers of their species, if there are any
    """

    step: int
    mesh: Mesh
    data: dict[str, np.ndarray]


def meshFrame(step: int, mesh: Mesh) -> MeshFrame:
    """Return a MeshFrame of a closed mesh with the data that a MeshReporter gives.

    ::

        mh.writeMeshTrajectory("one.vtkhdf", [mh.meshFrame(0, mesh)])

    Parameters
    ----------
    step : int
        the number of the step
    mesh : Mesh
        a closed mesh
    """
    area, curvature = mesh.vertexAreas, mesh.vertexMeanCurvatures
    data: dict[str, np.ndarray] = {
        "MeanCurvature": localMeanCurvatures(curvature, area),
        "SmoothMeanCurvature": smoothCurvatures(mesh.edges, curvature, area),
        "Area": area,
    }
    if mesh.species is not None:
        data["Species"] = mesh.species
    return MeshFrame(step, mesh, data)


def writeMeshTrajectory(
    file: PathLike, frames: Iterable[MeshFrame], keep: int = 0, precision: str = "double", lengthUnit: str = "nm"
) -> None:
    """Write frames to a file, in a single step: whatever happens meanwhile, the file is the old one or the new one,
    never half of one.

    ::

        frames = [mh.meshFrame(i, mh.Mesh(mesh.vertices * (1 + 0.1 * i), mesh.triangles)) for i in range(3)]
        mh.writeMeshTrajectory("growing.vtkhdf", frames)

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
    with _plainErrors(path), replacing(path) as part:
        if keep:
            shutil.copyfile(path, part)
        for batch in _batches(frames):
            with Draft(part if keep else None) as draft:
                _edit(draft, path, batch, keep, precision, lengthUnit)
                draft.writeTo(part)
            _verify(part, batch, keep)
            keep += len(batch)


def readMeshTrajectory(file: PathLike) -> "MeshTrajectory":
    """Open a mesh trajectory: a sequence of :class:`MeshFrame`, each read when it is asked for.

    ::

        for frame in mh.readMeshTrajectory("vesicle.vtkhdf"):
            print(frame.step, frame.mesh.reducedVolume, frame.data["MeanCurvature"].max())

    Parameters
    ----------
    file : path
        a VTKHDF file

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

    New frames wait in memory until :meth:`flush` makes the file complete with them.  That takes time in proportion to
    their number, and whatever happens meanwhile, the file is the old one or the new one.  :meth:`add` flushes at most a
    fiftieth of the time: when a minute has passed since the last time, or 50 times as long as that took, or earlier
    when 64 MB wait.  The first frame is written at once.
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
        existing = _count(self._path, numFrames) if numFrames is None or numFrames > 0 else 0
        self._kept = existing if numFrames is None else numFrames
        _requireFolder(self._path)
        self._file = GrowingFile(self._path)
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
        if time.monotonic() >= self._nextFlush or _sizeOf(frame) * len(self._waiting) > MAX_WAITING:
            self.flush()

    def flush(self) -> None:
        """Make the file complete with all frames so far.

        If this fails, the file is as it was and the frames go on waiting.
        """
        start = time.monotonic()
        if self._waiting or self._surplus:
            with _plainErrors(self._path), Draft(self._path if self._kept else None) as draft:
                _edit(draft, self._path, self._waiting, self._kept, **self._options)
                self._file.replace(draft, lambda file: _verify(file, self._waiting, self._kept))
            self._kept, self._waiting, self._surplus = self.numFrames, [], False
        end = time.monotonic()
        self._nextFlush = end + max(60, 50 * (end - start))

    def close(self) -> None:
        """Flush, and take no more frames."""
        if not self._closed:
            self.flush()
            self._file.close()
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
    def _complaint(self, what: str) -> Iterator[None]:
        """Name the file in whatever its reader finds wrong with it."""
        try:
            yield
        except Exception as error:  # of a damaged file the libraries make anything
            raise ValueError(f"{self._path} {what}: {str(error).strip(chr(39))}") from None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {len(self)} frames in {self._path}>"


class MeshTrajectory(Frames):
    """The frames of a VTKHDF file, as many as there were when it was opened."""

    _draft: Any = None

    def __init__(self, file: PathLike):
        self._path = Path(file)
        if not self._path.exists():
            raise FileNotFoundError(f"there is no mesh trajectory {file}")
        self.steps, self.lengthUnit = self._settled(self._describe)

    def close(self) -> None:
        """Close the file."""
        super().close()
        self._draft.close()

    def holds(self, frame: MeshFrame, index: int) -> bool:
        """Return whether a frame is that of an index, in the file's precision."""
        found, precision = self[index], self._root["Points"].dtype
        pairs = [(_points(frame.mesh).astype(precision), _points(found.mesh))]
        pairs += [(np.asarray(frame.data[name], values.dtype), values) for name, values in found.data.items()]
        return (
            (frame.step, set(frame.data)) == (found.step, set(found.data))
            and np.array_equal(frame.mesh.triangles, found.mesh.triangles)
            and all(np.array_equal(*pair, equal_nan=True) for pair in pairs)
        )

    @contextlib.contextmanager
    def _complaint(self, what: str) -> Iterator[None]:
        with super()._complaint(what):
            try:
                yield
            finally:
                if self._draft:
                    self._draft.check()  # what HDF5 made of an error of the disk is beside the point

    def _settled(self, read: Callable[[], Found]) -> Found:
        """Return what a function reads.

        The program that writes the file may do so meanwhile.  What was read then may be of any time, and is read again.
        """
        while True:
            try:
                if self._draft is None:
                    self._open()
                found = read()
                if self._draft.isCurrent(self._path):
                    return found
            except Exception:
                if self._draft is None or self._draft.isCurrent(self._path):
                    raise
            self._draft = None

    def _open(self) -> None:
        with self._complaint("is not a VTKHDF file, or not a complete one"):
            self._draft = Draft(self._path)
            self._file = h5py.File(self._draft, "r")
            self._root = _polyData(self._file)
        with self._complaint("is damaged"):
            steps = self._root["Steps"]
            self._arrays: dict[str, Any] = {}
            self._blocks: dict[str, tuple[int, np.ndarray]] = {}
            self._hasParts, self._dataNames = "NumberOfParts" in steps, list(steps.get("PointDataOffsets", ()))

    def _describe(self) -> tuple[NDArray[np.int64], str]:
        with self._complaint("is damaged"):
            steps = self._rows("Steps/Values", 0, int(self._root["Steps"].attrs["NSteps"]))
            if not np.all(np.abs(steps) < 2**53):
                raise ValueError("the number of a step is not a number")
            return steps.astype(np.int64), str(_textOf(self._file.attrs, "lengthUnit") or "nm")

    def layout(self) -> tuple[tuple[int, int, int], list[str]]:
        """Return the numbers of vertices, triangles and beads of the first frame, and the names of its data."""
        with self._complaint("is damaged at frame 0"):
            part = self._number("Steps/PartOffsets", 0)
            numPoints, numCells = (self._number(name, part) for name in ("NumberOfPoints", "Polygons/NumberOfCells"))
            numBeads = self._countBeads(part, numPoints)
            return (numPoints - numBeads, numCells, numBeads), self._dataNames

    def _read(self, i: int) -> MeshFrame:
        return self._settled(lambda: self._frame(i))

    def _frame(self, i: int) -> MeshFrame:
        if self._hasParts and self._number("Steps/NumberOfParts", i) != 1:
            raise ValueError("it has several parts; one is expected")
        part = self._number("Steps/PartOffsets", i)
        numPoints, numCells = (self._number(name, part) for name in ("NumberOfPoints", "Polygons/NumberOfCells"))
        cell, corner = self._number("Steps/CellOffsets", i, 2) + part, self._number("Steps/ConnectivityIdOffsets", i, 2)
        if np.any(np.diff(self._rows("Polygons/Offsets", cell, numCells + 1)) != 3):
            raise ValueError("it has cells that are not triangles")
        numCorners = self._number("Polygons/NumberOfConnectivityIds", part)
        points = self._rows("Points", self._number("Steps/PointOffsets", i), numPoints)
        triangles = self._rows("Polygons/Connectivity", corner, numCorners).reshape(-1, 3)
        numVertices = numPoints - self._countBeads(part, numPoints)
        starts = {name: self._number(f"Steps/PointDataOffsets/{name}", i) for name in self._dataNames}
        data = {name: self._rows(f"PointData/{name}", start, numVertices) for name, start in starts.items()}
        species = np.nan_to_num(data["Species"]).astype(np.intc) if "Species" in data else None
        names = tuple(filter(None, (_textOf(self._file.attrs, "speciesNames") or "").split(", ")))
        if len(set(names)) < len(names):  # which a Mesh does not have, and files of earlier versions may
            names = ()
        box = self._file.attrs.get("periodicBox")
        mesh = Mesh(points[:numVertices], triangles, box, points[numVertices:], species, names)
        return MeshFrame(self._number("Steps/Values", i), mesh, data)

    def _countBeads(self, part: int, numPoints: int) -> int:
        """Return how many of the last points are beads: vertices as cells, if it is they."""
        count = self._number("Vertices/NumberOfCells", part)
        if not 0 < count < numPoints or self._number("Vertices/NumberOfConnectivityIds", part) != count:
            return 0
        points = self._rows("Vertices/Connectivity", 0, count)
        return count if np.array_equal(points, np.arange(numPoints - count, numPoints)) else 0

    def _rows(self, name: str, start: int, count: int) -> np.ndarray:
        """Return rows of an array."""
        return _rows(self._array(name), start, start + count)

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            self._arrays[name] = _numbers(self._root[name])
        return self._arrays[name]

    def _number(self, name: str, row: int, column: int | tuple[()] = ()) -> int:
        """Return a number of an array of small rows, of which a block is read at a time."""
        first = row // BLOCK * BLOCK
        if self._blocks.get(name, (None,))[0] != first:
            self._blocks[name] = first, self._rows(name, first, min(BLOCK, len(self._array(name)) - first))
        return int(self._blocks[name][1][row - first][column])


def _count(path: Path, keep: int | None) -> int:
    """Return the number of frames in a file, 0 if there is none.

    Those where others are to be added or dropped must not be damaged: HDF5 can crash then.
    """
    count = 0
    if path.exists():
        with readMeshTrajectory(path) as trajectory:
            count = len(trajectory)
            for i in {0, count - 1, min(keep or count, count) - 1} if count else ():
                trajectory[i]
    if keep is not None and keep > count:
        raise ValueError(f"{path} has {count} frames; it should have {keep} or more to go on from")
    return count


def _requireFolder(path: Path) -> None:
    """Raise an OSError at once if a file cannot be made here."""
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; the name of a file is expected")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {path.parent} for {path.name}")
    if not os.access(path.parent, os.W_OK):
        raise PermissionError(f"{path.parent} is not writable; {path.name} cannot be made there")


def _polyData(file: Any) -> Any:
    """Return the group of an open file that holds the PolyData."""
    root = file.get("VTKHDF")
    kind = _textOf(root.attrs, "Type") if isinstance(root, h5py.Group) else None
    if kind is None:
        raise ValueError("it has no group VTKHDF with a Type")
    if kind != "PolyData" or "Steps" not in root:
        steps = "" if "Steps" in root else " without time steps"
        raise ValueError(f"it holds {kind}{steps}; PolyData with steps is expected")
    return root


def _numbers(array: Any) -> Any:
    """Return an array of numbers, of a kind that numpy has too: HDF5 can crash where it converts what is of no kind."""
    isArray = isinstance(array, h5py.Dataset) and array.dtype.kind in "iuf" and array.ndim > 0
    if not isArray or array.id.get_type() != h5py.h5t.py_create(array.dtype):
        raise ValueError(f"{array.name} is not an array of numbers")
    return array


def _rows(array: Any, start: int, stop: int) -> np.ndarray:
    """Return rows of an array.

    HDF5 takes zeros for what a file does not hold, and sets aside as much memory as a damaged one claims: both are
    refused here.
    """
    if not 0 <= start <= stop <= len(array):
        raise ValueError(f"{array.name} has {len(array)} rows; {start} to {stop} are expected")
    size = (stop - start) * math.prod(array.shape[1:]) * array.dtype.itemsize
    requireStored(array.name, size, _storedSize(array, start, stop))
    return array[start:stop]


def _storedSize(array: Any, start: int, stop: int) -> int:
    """Return how many bytes of a file have some rows of an array."""
    if not array.chunks or start == stop:
        return min(array.id.get_storage_size(), array.file.id.get_filesize())
    rows, *columns = array.chunks
    places = itertools.product(
        range(start // rows * rows, stop, rows), *(range(0, n, step) for n, step in zip(array.shape[1:], columns))
    )
    total, size = 0, math.prod(array.chunks) * array.dtype.itemsize
    for place in places:
        stored = _chunkSize(array, place)
        requireStored(array.name, size, stored)
        total += stored
    return total


def _chunkSize(array: Any, place: tuple[int, ...]) -> int:
    """Return how many bytes of a file have a chunk of an array."""
    if array.compression or array.shuffle:
        return len(array.id.read_direct_chunk(place)[1])  # asking for the size alone visits all chunks
    chunk = array.id.get_chunk_info_by_coord(place)
    if chunk.byte_offset is None:
        raise ValueError(f"{array.name} lacks the rows from {place[0]} on")
    return chunk.size


def _textOf(attributes: Any, name: str) -> str | None:
    """Return a text among the attributes of a file or group, or None."""
    text = attributes.get(name)
    return text.decode(errors="replace") if isinstance(text, bytes) else text


def _setText(attributes: Any, name: str, text: str) -> None:
    """Give a file or group a text of fixed length: those of any length are in a heap, in which a damaged size can make
    HDF5 loop for ever.
    """
    content = text.encode()
    attributes.create(name, content, dtype=h5py.string_dtype("utf-8", max(1, len(content))))


def _edit(draft: Draft, path: Path, frames: Sequence[MeshFrame], keep: int, precision: str, lengthUnit: str) -> None:
    """Let a draft have the first frames that it has, and others after them."""
    if not keep and not frames:
        raise ValueError(f"{path}: there are no frames to write")
    with signalsLater():
        try:
            with h5py.File(draft, "r+" if keep else "w") as out:
                root = _existing(out, path, keep) if keep else _create(out, frames[0], precision, lengthUnit)
                for frame in frames:
                    _append(root, frame)
        finally:
            draft.check()


def _verify(file: Path, frames: Sequence[MeshFrame], keep: int) -> None:
    """Raise an OSError unless a file that has just been written has these frames after the first ones."""
    try:
        trajectory = MeshTrajectory(file)
        with trajectory:
            areThere = len(trajectory) == keep + len(frames) and all(
                trajectory.holds(frame, keep + i) for i, frame in enumerate(frames)
            )
    except ValueError as error:
        raise OSError(f"reading it back fails: {error}") from None
    if not areThere:
        raise OSError("reading it back gives other frames")


def _batches(frames: Iterable[MeshFrame]) -> Iterator[list[MeshFrame]]:
    """Yield frames in lists of as many as may wait, the last of which may be empty."""
    batch, size = [], 0
    for frame in frames:
        batch.append(frame)
        size += _sizeOf(frame)
        if size > MAX_WAITING:
            yield batch
            batch, size = [], 0
    yield batch


def _existing(out: Any, path: Path, keep: int) -> Any:
    """Return the group to which to append, with `keep` frames in it."""
    root = _polyData(out)
    count = int(root["Steps"].attrs["NSteps"])
    if count < keep:
        raise ValueError(f"{path} has {count} frames; it should have {keep} or more to go on from")
    for array, rows in _growingArrays(root, count):
        if len(array) != rows:
            raise ValueError(f"{path} is damaged: {array.name} has {len(array)} rows; {rows} are expected")
    _resize(root, keep)
    return root


def _create(out: Any, frame: MeshFrame, precision: str, lengthUnit: str) -> Any:
    """Lay out a file for frames like this one."""
    if precision not in ("double", "single"):
        raise ValueError(f"precision is {precision!r}; it must be 'double' or 'single'")
    numBeads, numTriangles = len(frame.mesh.beads), len(frame.mesh.triangles)
    numPoints = len(frame.mesh.vertices) + numBeads
    _setText(out.attrs, "lengthUnit", lengthUnit)
    if frame.mesh.speciesNames:
        _setText(out.attrs, "speciesNames", ", ".join(frame.mesh.speciesNames))
    if frame.mesh.isPeriodic:
        out.attrs["periodicBox"] = np.asarray(frame.mesh.box)
    root = out.create_group("VTKHDF")
    root.attrs["Version"] = VERSION
    root.attrs.create("Type", b"PolyData", dtype="S8")  # of fixed length: VTK takes no other
    root["NumberOfPoints"] = np.array([numPoints])
    root.create_dataset(
        "Points",
        (0, 3),
        "f8" if precision == "double" else "f4",
        maxshape=(None, 3),
        chunks=(numPoints, 3),
        **COMPRESSION,
    )
    for kind in KINDS:
        cells = root.create_group(kind)
        count, size = {"Polygons": (numTriangles, 3), "Vertices": (numBeads, 1)}.get(kind, (0, 3))
        cells["NumberOfCells"], cells["NumberOfConnectivityIds"] = np.array([count]), np.array([size * count])
        cells.create_dataset("Offsets", data=size * np.arange(count + 1), **COMPRESSION)
        chunks = (max(1, size * count),)
        cells.create_dataset("Connectivity", (0,), "i8", maxshape=(None,), chunks=chunks, **COMPRESSION)
    if numBeads:  # the same in all frames
        root["Vertices/Connectivity"].resize(numBeads, axis=0)
        root["Vertices/Connectivity"][:] = np.arange(numPoints - numBeads, numPoints)
    data, steps = root.create_group("PointData"), root.create_group("Steps")
    offsets = steps.create_group("PointDataOffsets")
    for name in frame.data:
        data.create_dataset(name, (0,), "f4", maxshape=(None,), chunks=(numPoints,), **COMPRESSION)
        _growing(offsets, name)
    steps.attrs["NSteps"] = 0
    _growing(steps, "Values", kind="f8")
    for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
        _growing(steps, name)
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        _growing(steps, name, 4)
    return root


def _growing(group: Any, name: str, columns: int | None = None, kind: str = "i8") -> None:
    """Create an empty array with an entry for each step."""
    tail = () if columns is None else (columns,)
    group.create_dataset(name, (0, *tail), kind, maxshape=(None, *tail), chunks=(BLOCK, *tail))


def _growingArrays(root: Any, count: int) -> list[tuple[Any, int]]:
    """Return the arrays that grow, each with the rows that it has for a number of frames."""
    numVertices, numCorners = int(root["NumberOfPoints"][0]), int(root["Polygons/NumberOfConnectivityIds"][0])
    steps = root["Steps"]
    entries = [*steps["PointDataOffsets"].values(), *(steps[name] for name in steps if name != "PointDataOffsets")]
    return [
        (root["Points"], count * numVertices),
        (root["Polygons/Connectivity"], count * numCorners),
        *((values, count * numVertices) for values in root["PointData"].values()),
        *((array, count) for array in entries),
    ]


def _resize(root: Any, count: int) -> None:
    """Make room for a number of frames, or drop those beyond it."""
    for array, rows in _growingArrays(root, count):
        array.resize(rows, axis=0)
    root["Steps"].attrs["NSteps"] = count


def _append(root: Any, frame: MeshFrame) -> None:
    """Add a frame."""
    mesh, data, steps = frame.mesh, root["PointData"], root["Steps"]
    count = int(steps.attrs["NSteps"])
    expected = int(root["NumberOfPoints"][0]), int(root["Polygons/NumberOfCells"][0]), set(data)
    points = _points(mesh)
    if (len(points), len(mesh.triangles), set(frame.data)) != expected:
        raise ValueError(
            f"the frame of step {frame.step} has {len(points)} vertices, {len(mesh.triangles)} triangles and "
            f"the data {sorted(frame.data)}; those before it have {expected[0]}, {expected[1]} and "
            f"{sorted(expected[2])}"
        )
    box = root.file.attrs.get("periodicBox")
    if (box is not None) != mesh.isPeriodic or (mesh.isPeriodic and not np.array_equal(box, np.asarray(mesh.box))):
        raise ValueError(
            f"the frame of step {frame.step} has another periodic box than those before it; a file has one box"
        )
    _resize(root, count + 1)
    point, corner = count * len(points), count * mesh.triangles.size
    root["Points"][point:] = points
    root["Polygons/Connectivity"][corner:] = mesh.triangles.ravel()
    for name, values in frame.data.items():
        data[name][point : point + len(values)] = values
        data[name][point + len(values) :] = np.nan  # a bead has none
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


def _points(mesh: Mesh) -> np.ndarray:
    """Return the positions of vertices, and of the beads after them."""
    return np.concatenate((mesh.vertices, mesh.beads)) if len(mesh.beads) else mesh.vertices


def _sizeOf(frame: MeshFrame) -> int:
    """Return the number of bytes of a frame in a file, before compression; indices have 64 bits there."""
    return (
        frame.mesh.vertices.nbytes
        + 2 * frame.mesh.triangles.nbytes
        + sum(values.nbytes for values in frame.data.values())
    )


@contextlib.contextmanager
def _plainErrors(path: Path) -> Iterator[None]:
    """Say in a sentence what HDF5 says in its own words."""
    try:
        yield
    except ValueError:
        raise
    except Exception as error:
        number = getattr(error, "errno", None)
        raise (
            OSError(number, f"{path} cannot be written: {os.strerror(number)}")
            if number
            else OSError(f"{path} cannot be written: {str(error).strip(chr(39))}")
        ) from None
