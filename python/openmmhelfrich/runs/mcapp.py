"""Runs of TriMem's configurations, with TriMem's checkpoints, for programs that call ``mc_app run``.

A checkpoint is two files: PREFIX.cpt.pN.h5 has the mesh, and PREFIX.pN.cpt, which is XML, names it and has the
configuration to go on with as INI text in JSON.  N counts them from 0.
"""

import configparser
import contextlib
import json
import re
import shlex
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from ..files import PathLike, replacing
from ..geometry.mesh import Mesh
from ..io.locks import locked
from ..io.runfiles import beside
from ..sampling.progress import requireProgress
from .config import parseConfig
from .outputs import Outputs
from .progress import RunProgress, following
from .readiness import UnevenError
from .studies import run as runStudy, told
from .summary import Summary
from .trimem import Source, converted

if TYPE_CHECKING:
    from .studies import Study

LAST = -1


def runLikeTriMem(
    file: PathLike,
    restart: int | None = None,
    progress: Callable[["Study"], None] | bool | None = None,
    note: Callable[[str], None] | None = None,
) -> Summary:
    """Do what a configuration of TriMem asks for, write our files and TriMem's checkpoint, and return a Summary.

    Without a restart, files of earlier runs get the names #NAME.B# with the least B that is free.  A restart begins
    with the shape of a checkpoint and makes the configuration's number of steps; its files begin with PREFIX.pN.

    Parameters
    ----------
    file : path
        TriMem's configuration
    restart : int, optional
        the number of the checkpoint to begin with; -1 is the last one
    progress : callable or True, optional
        that of :func:`openmmhelfrich.run`
    note : callable, optional
        called with each sentence on what has no counterpart

    Raises
    ------
    ValueError, OSError, openmm.OpenMMException
        what :func:`openmmhelfrich.run` raises; or if there is no such checkpoint, or it is damaged
    """
    requireProgress(progress, hasBars=True)
    source = Source(Path(file))
    prefix = Path(source.text("GENERAL", "output_prefix", source.stem))
    checkpoints = Checkpoints(Path(source.text("GENERAL", "restart_prefix", source.stem)))
    begin = None if restart is None else checkpoints.read(restart)
    part = 0 if begin is None else checkpoints.last() + 1
    if begin is not None:
        source.goOnFrom(begin.settings)
    data, comments = converted(source)
    if begin is not None:
        data["mesh"]["file"] = str(begin.mesh)
    if part > 0:
        data["output"]["prefix"] = f"{prefix}.p{part}"
    if note is not None:
        for comment in comments:
            note(comment)
    with source.namingItsKeys():
        config = parseConfig(data, str(file))
    outputs = Outputs.of(config)
    outputs.makeFolder()
    with locked(outputs.prefix):
        if begin is None:
            backUp({*outputs.paths(), *_parts(prefix), *checkpoints.files()}, source.mesh)
        with (
            source.namingItsKeys(),
            _namingMesh(source.path, begin),
            following(progress, RunProgress) as shown,
        ):
            if isinstance(shown, RunProgress):
                shown.words = source.inItsWords
            summary = runStudy(config, shown or _unseen).inWords(source.inItsWords)
    summary = replace(summary, notes=[*summary.notes, *source.unknown()])
    checkpoints.write(part, Mesh.read(outputs.mesh), source.textAfter(0 if source.minimizes else _stepsOf(summary)))
    return told(summary, progress)


def _unseen(study: "Study") -> None:
    """Show nothing of how a run goes: what it comes to is told in TriMem's words."""


def _stepsOf(summary: Summary) -> int:
    """Return the number of steps that count for lambda and cooling: those of approaches come before they go on."""
    return max(0, summary.steps - sum(stage.totalSteps for stage in summary.config.stages if stage.isAdded))


@dataclass
class Checkpoint:
    """What a run begins with.

    Attributes
    ----------
    mesh : Path
        the file that has the mesh
    settings : dict
        the keys of [ENERGY] and [HMC] of the configuration to go on with
    """

    mesh: Path
    settings: dict[str, str]


@contextlib.contextmanager
def _namingMesh(file: Path, begin: Checkpoint | None) -> Iterator[None]:
    """Say, of a mesh that is to be made anew, how a run of TriMem's configuration takes the new one: by its own key, or
    from the checkpoint with which it begins.
    """
    try:
        yield
    except UnevenError as error:
        if begin is None:
            last = f"and with input = {error.file} in [GENERAL] of {file}"
        else:
            last = shlex.join(["openmm-helfrich", "convert", "--overwrite", str(error.file), str(begin.mesh)])
        raise ValueError("\n".join([error.problem, *error.commands, last])) from None


class Checkpoints:
    """The checkpoints of a prefix."""

    def __init__(self, prefix: Path):
        self._prefix = prefix

    def _names(self, number: int) -> tuple[Path, Path]:
        """Return the file of the mesh of a checkpoint, and the one that names it."""
        return beside(self._prefix, f".cpt.p{number}.h5"), beside(self._prefix, f".p{number}.cpt")

    def files(self) -> list[Path]:
        """Return the files of all of them."""
        return [*_parts(self._prefix, r"\.cpt"), *_parts(self._prefix, end=r"\.cpt")]

    def last(self) -> int:
        """Return the number of the last one, -1 if there is none."""
        return max((int(path.name.split(".")[-2][1:]) for path in self.files()), default=-1)

    def read(self, number: int) -> Checkpoint:
        """Read a checkpoint; -1 is the last one."""
        file = self._names(max(self.last(), 0) if number == LAST else number)[1]
        if not file.exists():
            raise FileNotFoundError(f"there is no checkpoint {file} to restart from; run without --restart writes one")
        try:
            root = ElementTree.parse(file).getroot()
            mesh, text = (root.findtext(tag, "") for tag in ("points", "config"))
            parser = configparser.ConfigParser(interpolation=None)
            parser.read_string(json.loads(text))
            settings = {key: value for name in ("ENERGY", "HMC") for key, value in parser[name].items()}
            return Checkpoint(file.with_name(mesh.split(":/")[0].strip()), settings)
        except (
            SyntaxError,
            AttributeError,
            TypeError,
            ValueError,
            KeyError,
            RecursionError,
            configparser.Error,
        ) as error:
            raise ValueError(f"{file} is not a checkpoint of TriMem: {' '.join(str(error).split())}") from None

    def write(self, number: int, mesh: Mesh, config: str) -> None:
        """Write a checkpoint, whose configuration is a text."""
        data, names = self._names(number)
        mesh.write(data)
        root = ElementTree.Element("cpt", Version="0.1")
        for tag, rows, kind in (("points", mesh.vertices, "float64"), ("cells", mesh.triangles, "int32")):
            ElementTree.SubElement(root, tag, shape=f"{len(rows)} 3", dtype=kind).text = f"{data.name}:/{tag}"
        ElementTree.SubElement(root, "config").text = json.dumps(config)
        with replacing(names) as part:
            ElementTree.ElementTree(root).write(part)


def backUp(files: Iterable[Path], source: PathLike) -> None:
    """Give files that are there, but for the one that the run reads, the names #NAME.B#, with the least B that is free
    for all of them.
    """
    present = [path for path in sorted(files) if path.is_file() and not path.samefile(source)]
    number = 0
    while any(_backup(path, number).exists() for path in present):
        number += 1
    for path in present:
        path.rename(_backup(path, number))


def _backup(path: Path, number: int) -> Path:
    return path.with_name(f"#{path.name}.{number}#")


def _parts(prefix: Path, middle: str = "", end: str = r".*") -> list[Path]:
    """Return the files of parts of runs with a prefix: PREFIX.pN."""
    pattern = re.compile(rf"{re.escape(prefix.name)}{middle}\.p\d+{end if not middle else r'.h5'}")
    return [path for path in prefix.parent.glob("*") if pattern.fullmatch(path.name)]
