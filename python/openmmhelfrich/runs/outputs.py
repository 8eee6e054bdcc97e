"""The files that a run writes."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from openmm import app

from ..files import PathLike, sync
from ..helfrich import HelfrichForce
from ..io.dcd import TrajectoryReporter
from ..sampling.observables import Place, observablesOf
from ..sampling.reporters import MeshReporter, ObservablesReporter
from .checkpoint import loadRunState
from .config import Config, parseConfig
from .scene import Scene

APPENDED = ("table", "trajectory", "meshTrajectory")  # the files of which a checkpoint says how much belongs to the run


@dataclass
class Outputs:
    """The names of the files, all of which begin with the run's prefix."""

    trajectory: Path
    meshTrajectory: Path | None
    topology: Path | None
    table: Path
    mesh: Path
    plot: Path
    picture: Path
    path: Path | None
    pathPlot: Path | None
    settings: Path
    checkpoint: Path

    @classmethod
    def of(cls, config: Config) -> "Outputs":
        """Return the names that a Config asks for, or raise a ValueError if its prefix is only a folder."""
        prefix, output = config.output.prefix or "", config.output
        if Path(prefix + "x").stem == "x":
            raise ValueError(
                f"[output] prefix is '{prefix}'; the first part of the files' names must follow the folder"
            )
        hasPath = any(stage.hasPath for stage in config.stages)
        return cls(
            trajectory=Path(prefix + ".dcd"),
            meshTrajectory=Path(prefix + ".vtkhdf") if output.mesh_trajectory else None,
            topology=None if output.psf is False else Path(prefix + ".psf"),
            table=Path(prefix + ".csv"),
            mesh=Path(f"{prefix}.{output.mesh_format}"),
            plot=Path(prefix + "_observables.png"),
            picture=Path(prefix + "_shape.png"),
            path=Path(prefix + "_path.csv") if hasPath else None,
            pathPlot=Path(prefix + "_path.png") if hasPath else None,
            settings=Path(prefix + ".resolved.toml"),
            checkpoint=Path(prefix + ".checkpoint"),
        )

    @property
    def prefix(self) -> Path:
        """What all of them begin with."""
        return self.checkpoint.with_suffix("")

    def growing(self, sizes: Mapping[str, int]) -> list[Path]:
        """Return the paths of the files without which a run cannot go on: the checkpoint, and those of which it counts
        something.
        """
        return [self.checkpoint, *(getattr(self, name) for name in ("table", "trajectory") if sizes.get(name))]

    def paths(self) -> list[Path]:
        """Return the paths of all files that the run writes."""
        return [path for path in vars(self).values() if path is not None]

    def record(self, run: str, step: int, among: Container[str] | None = None) -> dict[str, Any]:
        """Return what tells the files as they are now, or some among them, from all others: the run and its step; the
        size of each file; and the checksum of each that is written as a whole.
        """
        files = {
            name: path
            for name, path in vars(self).items()
            if path is not None and name != "checkpoint" and (among is None or name in among)
        }
        return {
            "run": run,
            "step": step,
            "files": {name: _describe(path, name not in APPENDED) for name, path in files.items()},
        }

    def match(self, record: dict[str, Any]) -> bool:
        """Return whether the files that a record tells are there, as it tells them."""
        return record == self.record(record.get("run", ""), record.get("step", 0), record.get("files", {}))

    def makeFolder(self) -> None:
        """Create the folder of the files.  Raises an OSError if it does not take files."""
        folder = self.table.parent
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise NotADirectoryError(f"{folder} is not a folder; choose another output prefix") from None
        try:
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise PermissionError(
                f"the folder {folder.resolve()} is not writable ({error.strerror}); choose another output prefix"
            ) from None

    def prepare(self, source: PathLike | None, overwrite: bool = False) -> list[Path]:
        """Make sure that every file can be written, before the first is opened, and return the files of an earlier run
        that are to be removed when this one has its first checkpoint, so that none of them is taken for one of its own.

        Raises FileExistsError if one exists already and is not to be overwritten, or is the mesh file that the run
        reads (None if there is none), and PermissionError if one cannot be written.
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
        for path in existing:
            if not os.access(path, os.W_OK):
                raise PermissionError(f"{path} is not writable; choose another output prefix")
        kept = {self.checkpoint, *(getattr(self, name) for name in APPENDED)}  # which begin anew where they are
        old = {*existing, *self._earlier()} - kept
        return [path for path in old if path.is_file() and not (source and path.samefile(source))]

    def _earlier(self) -> list[Path]:
        """Return the paths of the files of the run whose checkpoint is there, which may have had other settings."""
        try:
            config = parseConfig(loadRunState(self.checkpoint).config)
        except (ValueError, OSError):
            return []
        config.output.prefix = str(self.prefix)
        return Outputs.of(config).paths()


class Recorder:
    """The files to which a run appends, and the reporters that do so.

    What a file held at the last checkpoint stays when a run goes on; what came later is dropped, since it will be made
    again.
    """

    def __init__(
        self,
        outputs: Outputs,
        scene: Scene,
        simulation: app.Simulation,
        force: HelfrichForce,
        place: Callable[[], Place],
        sizes: Mapping[str, int],
    ):
        """Open the files.

        Parameters
        ----------
        outputs : Outputs
            their names
        scene : Scene
            the intervals and units
        simulation, force
            what is reported
        place : callable
            returns the :class:`Place` in the run
        sizes : dict
            what sync() returned at the checkpoint to go on from; empty for a new run

        Raises
        ------
        ValueError
            if a file is no longer there, or has become another since the checkpoint
        """
        files = {"table": outputs.table, "trajectory": outputs.trajectory}
        for name, file in files.items():
            _checkLength(file, sizes.get(name, 0))
        if sizes.get("table", 0) > 0:
            _checkLine(outputs.table, sizes["table"])
            os.truncate(outputs.table, sizes["table"])
        output = scene.config.output
        self._simulation, self._files = simulation, files
        with contextlib.ExitStack() as opened:
            self.table = ObservablesReporter(
                outputs.table,
                output.observables_interval,
                force,
                scene.temperature,
                scene.lengthUnit,
                append=sizes.get("table", 0) > 0,
                observables=observablesOf(scene.changing),
                place=place,
            )
            opened.callback(self.table.close)
            self.table.requireColumns(simulation)
            self._trajectory = TrajectoryReporter(
                outputs.trajectory, output.trajectory_interval, sizes.get("trajectory", 0)
            )
            opened.callback(self._trajectory.close)
            self._meshes = None
            if outputs.meshTrajectory is not None:
                frames = sizes.get("meshFrames", 0)
                self._meshes = MeshReporter(
                    outputs.meshTrajectory,
                    output.trajectory_interval,
                    force,
                    frames > 0,
                    frames or None,
                    lengthUnit=scene.lengthUnit,
                    beads=range(len(scene.mesh.vertices), simulation.system.getNumParticles()),
                    speciesNames=scene.speciesNames,
                )
            opened.pop_all()
        simulation.reporters += self._reporters()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: Any) -> None:
        self._simulation.reporters.clear()
        for reporter in self._reporters():
            with (
                contextlib.suppress(OSError) if kind else contextlib.nullcontext()
            ):  # an error of a full disk has been raised already
                reporter.close()

    def report(self) -> None:
        """Write a row and a frame of the present."""
        state = self._simulation.context.getState(positions=True)
        for reporter in self._reporters():
            reporter.report(self._simulation, state)

    def sync(self) -> dict[str, int]:
        """Wait until everything is on the disk, and return how much each file holds: bytes, and frames of the mesh
        trajectory.
        """
        sizes = {"table": self.table.sync(), "trajectory": self._trajectory.sync()}
        for file in self._files.values():
            sync(file)
        if self._meshes:
            self._meshes.flush()
            sizes["meshFrames"] = self._meshes.getNumFrames()
        return sizes

    def _reporters(self) -> list[Any]:
        return [reporter for reporter in (self._trajectory, self._meshes, self.table) if reporter]


def _describe(file: Path, isWhole: bool) -> dict[str, Any]:
    """Return the size of a file, and its checksum if that is asked for; nothing if there is no such file."""
    if not file.is_file():
        return {}
    described: dict[str, Any] = {"size": file.stat().st_size}
    if isWhole:
        checksum = hashlib.sha256()
        with open(file, "rb") as content:
            while part := content.read(2**20):
                checksum.update(part)
        described["sha256"] = checksum.hexdigest()
    return described


def _checkLength(file: Path, size: int) -> None:
    if size > 0 and not file.exists():
        raise ValueError(
            f"there is no file {file}; it had {size} bytes at the last checkpoint, so that the run cannot go on"
        )
    length = file.stat().st_size if file.exists() else 0
    if length < size:
        raise ValueError(
            f"{file} has {length} bytes, and had {size} at the last checkpoint; it was replaced or cut since, so that "
            "the run cannot go on"
        )


def _checkLine(file: Path, size: int) -> None:
    """Raise a ValueError unless a line of a table ends where the table ended at the checkpoint."""
    with open(file, "rb") as content:
        content.seek(size - 1)
        if content.read(1) != b"\n":
            raise ValueError(
                f"{file} has no end of a line at byte {size}, where it ended at the last checkpoint; it was replaced "
                "or changed since, so that the run cannot go on"
            )
