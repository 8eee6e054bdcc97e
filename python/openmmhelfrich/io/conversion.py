"""From one file of membranes to another: mesh trajectories, DCD files, and the mesh formats."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import overload
from xml.etree import ElementTree

from ..files import PathLike, replacing
from ..geometry.mesh import Mesh
from ..geometry.meshfiles import requireWritten
from ..units import wholeNumber
from .dcdframes import DCDTrajectory
from .locks import locked
from .vtkhdf import MeshFrame, readMeshTrajectory, writeMeshTrajectory

TRAJECTORIES = (".vtkhdf", ".hdf")


def openFrames(file: PathLike, topology: PathLike | None = None) -> Sequence[MeshFrame]:
    """Open a mesh trajectory, a DCD file, or a single mesh as a sequence of frames.

    Parameters
    ----------
    file : path
        a VTKHDF or DCD trajectory, or a mesh in any format that Mesh.read() knows
    topology : path, optional
        what has the triangles of a DCD file: a mesh file or a PSF file

    Raises
    ------
    FileNotFoundError
        if there is no such file
    ValueError
        if the file is damaged or of no known format, or a DCD file comes without topology or with one of another size
    """
    suffix = Path(file).suffix.lower()
    if suffix == ".dcd":
        return DCDTrajectory(file, topology)
    if topology is not None:
        raise ValueError(f"{topology} is given as a topology, but {file} is not a DCD file; only those need one")
    return readMeshTrajectory(file) if suffix in TRAJECTORIES else [MeshFrame(0, Mesh.read(file), {})]


def selectFrames(file: PathLike, frames: Sequence[MeshFrame], frame: int | None = None, every: int = 1) -> list[int]:
    """Return the indices that a choice of one frame, or of every so many, means.

    Raises a ValueError if there is no such frame.
    """
    if frame is not None:
        if every != 1:
            raise ValueError(f"frame {frame} and every {every} are both given; give one of them")
        if not -len(frames) <= frame < len(frames):
            raise ValueError(
                f"{file} has no frame {frame}; it has {len(frames)}: 0 to {len(frames) - 1}, or -1 for the last"
            )
        return [frame % len(frames)]
    return list(range(0, len(frames), wholeNumber(every, "every", 1)))


class ChosenFrames(Sequence[MeshFrame]):
    """Some of a sequence of frames, each read when it is asked for."""

    def __init__(self, frames: Sequence[MeshFrame], indices: Sequence[int]):
        """Create it from the indices of the frames."""
        self._frames, self._indices = frames, indices

    def __len__(self) -> int:
        return len(self._indices)

    @overload
    def __getitem__(self, index: int) -> MeshFrame: ...

    @overload
    def __getitem__(self, index: slice) -> "ChosenFrames": ...

    def __getitem__(self, index: int | slice) -> "MeshFrame | ChosenFrames":
        if isinstance(index, slice):
            return ChosenFrames(self._frames, self._indices[index])
        return self._frames[self._indices[index]]


def convert(
    file: PathLike,
    output: PathLike,
    frame: int | None = None,
    every: int = 1,
    topology: PathLike | None = None,
    overwrite: bool = False,
    note: Callable[[str], None] | None = None,
) -> list[Path]:
    """Convert a file of one or more membranes to another format, which the output's suffix names.

    .vtkhdf, .xyz and .pvd hold all frames; a PVD file names a VTU file for each.  XYZ has no triangles; its coordinates
    are in angstroms, its vertices V and its beads B.  The mesh formats hold one mesh, without beads: with several
    frames, as many files are written, with the number of the frame in each name.  VTU, VTK and PLY files have the
    values at the vertices too.

    Parameters
    ----------
    file, output : path
        what to read and what to write
    frame : int, optional
        one frame only, counted from 0, or from -1 backwards
    every : int
        the first of every so many frames
    topology : path, optional
        for DCD files, see :func:`openFrames`
    overwrite : bool
        replace files that exist
    note : callable, optional
        called with each sentence on what reading a mesh left out or changed

    Returns
    -------
    list of Path
        the files written

    Raises
    ------
    FileExistsError
        if a file exists and is not to be overwritten; nothing has been written then
    ValueError, OSError
        if a file cannot be read or written, or its format is not known
    """
    output = Path(output)
    requireWritten(output, *TRAJECTORIES, ".pvd", ".xyz")
    frames = openFrames(file, topology)
    indices = selectFrames(file, frames, frame, every)
    names = _names(output, indices)
    requireNew(names, file, overwrite)
    suffix, unit = output.suffix.lower(), getattr(frames, "lengthUnit", "nm")
    selected = (frames[i] for i in indices)
    if note is not None and isinstance(frames, list):  # of one mesh
        for sentence in frames[0].mesh.notes:
            note(sentence)
    if suffix in TRAJECTORIES:
        with locked(output.with_suffix("")):  # a run that has this prefix would lose its own
            writeMeshTrajectory(output, selected, lengthUnit=unit)
    elif suffix == ".xyz":
        _writeXYZ(output, selected)
    else:
        meshes = names[1:] if suffix == ".pvd" else names
        steps = [_writeMesh(name, frame) for name, frame in zip(meshes, selected)]
        if suffix == ".pvd":
            _writePVD(output, meshes, steps)
    return names


def requireNew(files: Iterable[PathLike], source: PathLike, overwrite: bool) -> None:
    """Raise a FileExistsError if a file to write exists and may not be replaced, or is the one to read from."""
    existing = [Path(file) for file in files if Path(file).exists()]
    if any(file.samefile(source) for file in existing):
        raise FileExistsError(f"the result would replace {source}; choose another name")
    if existing and not overwrite:
        more = f" and {len(existing) - 3} more" if len(existing) > 3 else ""
        raise FileExistsError(
            f"{', '.join(map(str, existing[:3]))}{more} exist{'s' if len(existing) == 1 else ''} already; "
            "choose another name, or ask to overwrite files with --overwrite"
        )


def _names(output: Path, indices: Sequence[int]) -> list[Path]:
    """Return the files to write, that of the series first."""
    suffix = output.suffix.lower()
    if suffix in (*TRAJECTORIES, ".xyz") or (len(indices) == 1 and suffix != ".pvd"):
        return [output]
    digits = max(4, len(str(max(indices, default=0))))
    numbered = [
        output.with_name(f"{output.stem}_{i:0{digits}}{'.vtu' if suffix == '.pvd' else output.suffix}") for i in indices
    ]
    return [output, *numbered] if suffix == ".pvd" else numbered


def _writeMesh(file: Path, frame: MeshFrame) -> int:
    """Write the mesh of a frame and return its step."""
    frame.mesh.write(file, data=frame.data)
    return frame.step


def _writePVD(file: Path, meshes: Iterable[Path], steps: Iterable[int]) -> None:
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for mesh, step in zip(meshes, steps):
        ElementTree.SubElement(collection, "DataSet", timestep=str(step), part="0", file=mesh.name)
    ElementTree.indent(root)
    with replacing(file) as part:
        ElementTree.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _writeXYZ(file: Path, frames: Iterable[MeshFrame]) -> None:
    with replacing(file) as part, open(part, "w", encoding="utf-8") as out:
        for frame in frames:
            out.write(f"{len(frame.mesh.vertices) + len(frame.mesh.beads)}\nstep {frame.step}\n")
            for name, points in (("V", frame.mesh.vertices), ("B", frame.mesh.beads)):
                out.writelines("{} {:.9g} {:.9g} {:.9g}\n".format(name, *point) for point in (10 * points).tolist())
