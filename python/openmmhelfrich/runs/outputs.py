"""The files that a run writes."""

import contextlib
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Optional

from ..io.dcd import TrajectoryReporter
from ..files import sync
from ..sampling.reporters import MeshReporter, ObservablesReporter


@dataclass
class Outputs:
    """The names of the files, all of which begin with the run's prefix."""

    trajectory: Path
    meshTrajectory: Optional[Path]
    topology: Path
    table: Path
    mesh: Path
    plot: Path
    picture: Path
    path: Optional[Path]
    pathPlot: Optional[Path]
    settings: Path
    checkpoint: Path

    @classmethod
    def of(cls, config):
        """Return the names that a Config asks for, or raise a ValueError if its prefix is only a folder."""
        if Path(config.output.prefix + "x").stem == "x":
            raise ValueError(
                f"[output] prefix is '{config.output.prefix}'; the first part of the files' names must follow the folder"
            )
        meshes = ".vtkhdf" if config.output.mesh_trajectory else None
        paths = ("_path.csv", "_path.png") if any(stage.kind == "continue" for stage in config.stages) else (None, None)
        endings = (
            ".dcd",
            meshes,
            ".psf",
            ".csv",
            "." + config.output.mesh_format,
            "_observables.png",
            "_shape.png",
            *paths,
            ".resolved.toml",
            ".checkpoint",
        )
        return cls(*(ending and Path(config.output.prefix + ending) for ending in endings))

    def paths(self):
        """Return the paths of all files that the run writes."""
        return [path for path in vars(self).values() if path is not None]

    def prepare(self, source, overwrite=False):
        """Make sure that every file can be written, and create their folder, before the first is opened.

        Raises FileExistsError if one exists already and is not to be overwritten, or is the mesh file that the run reads (None if there is none),
        and another OSError if their folder does not take files.
        """
        if source is not None and any(path.exists() and path.samefile(source) for path in self.paths()):
            raise FileExistsError(
                f"the results would replace the mesh file {source}; choose another output prefix or mesh_format"
            )
        existing = [path for path in self.paths() if path.exists()]
        if existing and not (overwrite and all(path.is_file() for path in existing)):
            hint = "; resume goes on with the run that wrote them" if self.checkpoint in existing else ""
            raise FileExistsError(
                f"{', '.join(map(str, existing))} exist{'s' if len(existing) == 1 else ''} already; "
                f"choose another output prefix, or ask to overwrite files{hint}"
            )
        folder = self.table.parent
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise NotADirectoryError(f"{folder} is not a folder; choose another output prefix") from None
        try:
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise PermissionError(
                f"{folder} is not writable ({error.strerror}); choose another output prefix"
            ) from None
        for path in existing:
            if not os.access(path, os.W_OK):
                raise PermissionError(f"{path} is not writable; choose another output prefix")


class Recorder:
    """The files to which a run appends, and the reporters that do so.

    What a file held at the last checkpoint stays when a run goes on; what came later is dropped, since it will be made again.
    """

    def __init__(self, outputs, config, simulation, force, describe, sizes):
        """Open the files.

        Parameters
        ----------
        outputs : Outputs
            their names
        config : Config
            the intervals and units
        simulation, force
            what is reported
        describe : callable
            returns more columns of the table
        sizes : dict
            what sync() returned at the checkpoint to go on from; empty for a new run

        Raises
        ------
        ValueError
            if a file has become shorter since the checkpoint
        """
        files = {"table": outputs.table, "trajectory": outputs.trajectory}
        for name, file in files.items():
            _checkLength(file, sizes.get(name, 0))
        output, lengthUnit = config.output, config.mesh.length_unit
        self._simulation, self._files = simulation, files
        self.table = _openTable(
            outputs.table,
            sizes.get("table", 0),
            output.observables_interval,
            force,
            config.sampling.temperature,
            lengthUnit,
            describe,
        )
        self._trajectory = TrajectoryReporter(
            outputs.trajectory, output.trajectory_interval, sizes.get("trajectory", 0)
        )
        self._meshes = None
        if output.mesh_trajectory:
            frames = sizes.get("meshFrames", 0)
            self._meshes = MeshReporter(
                outputs.meshTrajectory,
                output.trajectory_interval,
                force,
                frames > 0,
                frames or None,
                lengthUnit=lengthUnit,
            )
        simulation.reporters += self._reporters()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self._simulation.reporters.clear()
        for reporter in self._reporters():
            with (
                contextlib.suppress(OSError) if kind else contextlib.nullcontext()
            ):  # an error of a full disk has been raised already
                reporter.close()

    def report(self):
        """Write a row and a frame of the present."""
        state = self._simulation.context.getState(positions=True)
        for reporter in self._reporters():
            reporter.report(self._simulation, state)

    def sync(self):
        """Wait until everything is on the disk, and return how much each file holds: bytes, and frames of the mesh trajectory."""
        sizes = {"table": self.table.sync(), "trajectory": self._trajectory.sync()}
        for file in self._files.values():
            sync(file)
        if self._meshes:
            self._meshes.flush()
            sizes["meshFrames"] = self._meshes.getNumFrames()
        return sizes

    def _reporters(self):
        return [reporter for reporter in (self._trajectory, self._meshes, self.table) if reporter]


def _openTable(file, size, interval, force, temperature, lengthUnit, describe):
    if size > 0:
        os.truncate(file, size)
    return ObservablesReporter(file, interval, force, temperature, lengthUnit, append=size > 0, describe=describe)


def _checkLength(file, size):
    length = file.stat().st_size if file.exists() else 0
    if length < size:
        raise ValueError(
            f"{file} has {length} bytes, and had {size} at the last checkpoint; it was replaced or cut since, so that the run cannot go on"
        )
