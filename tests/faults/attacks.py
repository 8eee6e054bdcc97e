"""Commands whose disk fails at their n-th operation, or which are killed there, for every n.

The program compiles FailingDisk and starts itself anew with that preloaded.  What is attacked is a *scene*: a folder
with some files, and a command in it.  The command is forked off a process that has imported everything, once for each n
and mode, in a copy of the folder.  What must come of it:

- Exit code 0, and files equal to those of an undisturbed command;
- or another exit code, after sentences without a traceback; or the attack's own signal;
- after either of the latter the same command, or the one that goes on, ends with files equal to those of an
  undisturbed one, and nothing else in the folder.
"""

import argparse
import contextlib
import functools
import gc
import hashlib
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

from children import MODES, execute, fork, importEverything, temporaryFolder, waitFor
from matplotlib.figure import Figure
from PIL import Image

import openmmhelfrich as mh
from openmmhelfrich.pictures.plots import drawMesh, saveFigure
from openmmhelfrich.runs import studies
from openmmhelfrich.runs.checkpoint import RunState, loadRunState
from openmmhelfrich.runs.config import readTOML

# What lets a program mount disks that no other sees.
OWN_DISKS = ["unshare", "--user", "--map-root-user", "--mount"]
# How often another process fills the disk at most, and how large that is.
TIMES_FILLED, DISK = 300, "12m"

RUN = """
[mesh]
icosphere = 1
[platform]
threads = 1
[sampling]
seed = 3
steps_per_trajectory = 2
step_size = 1e-4
[output]
trajectory_interval = 2
observables_interval = 1
checkpoint_interval = 2
[[stages]]
kind = "sample"
steps = 3
[[stages]]
kind = "continue"
windows = 1
reduced_volume = 0.98
steps = 2
equilibration = 1
"""
POINT = RUN[: RUN.rindex("[[")]
GRID = """
base = "run.toml"
[grid]
sampling.temperature = [300, 310]
"""


@dataclass
class Scene:
    """A command to attack.

    Attributes
    ----------
    files : dict
        the texts of files by their names
    command : list of str
        what is attacked
    goOn : callable
        returns the command that goes on after an attack, in a folder
    before : list of commands
        what has been done in the folder
    killedAt : int
        the operation at which the last of these was killed; 0 if it came to its end
    """

    files: dict[str, str]
    command: list[str]
    goOn: Callable[[Path], list[str]]
    before: Sequence[list[str]] = ()
    killedAt: int = 0


# --- what is in a folder

Contents: TypeAlias = dict[str, Any]


def contentsOf(folder: Path) -> Contents:
    """Return what equal files have in common, by the names of all files in a folder.

    A file that is no lock any more may be left of a lock.
    """
    files = (file for file in sorted(folder.rglob("*")) if not file.is_dir() and file.suffix != ".lock")
    return {str(file.relative_to(folder)): _contentOf(file) for file in files}


def _contentOf(file):
    if file.name.startswith("."):
        return file.read_bytes()
    if file.suffix == ".vtkhdf":
        with mh.readMeshTrajectory(file) as frames:
            return [
                (
                    frame.step,
                    frame.mesh.vertices.tobytes(),
                    frame.mesh.triangles.tobytes(),
                    *(values.tobytes() for values in frame.data.values()),
                )
                for frame in frames
            ]
    return _partsOf(file) if file.suffix == ".checkpoint" else re.sub(OWN, b"", file.read_bytes())


def _partsOf(archive):
    with zipfile.ZipFile(archive) as parts:
        return {name: re.sub(OWN, b"", parts.read(name)) for name in parts.namelist()}


def _stateOf(folder):
    """Return what folders have in common in which a command does the same: all bytes that are not of a time."""
    return {str(file.relative_to(folder)): _bytesOf(file) for file in sorted(folder.rglob("*")) if not file.is_dir()}


def _bytesOf(file):
    content = file.read_bytes()
    with contextlib.suppress(zipfile.BadZipFile):  # what is no archive, or a torn one
        return _partsOf(file)
    return re.sub(rb"\d+", b"", content) if file.suffix == ".lock" else re.sub(OWN, b"", content)


# What is of a time, a run or a place: dates, checksums of files that have dates, the identity of a run, the folder of a
# sweep and the size of a file that has it.
OWN = re.compile(
    rb"(?<=Created by meshio v)[^\n<]*|\d{4}-\d\d-\d\d \d\d:\d\d UTC|\b[0-9a-f]{64}\b|\b[0-9a-f]{32}\b"
    rb'|(?<=")/[^"\n]*(?=/grid/)|(?<="settings": {\n   "size": )\d+'
)


def differences(found: Contents, expected: Contents) -> str:
    """Return how the contents of a folder differ from those that are expected; "" if they do not."""
    names = [name for name in sorted({*found, *expected}) if found.get(name) != expected.get(name)]
    return "; ".join(
        f"{name} {'is missing' if name not in found else 'is left' if name not in expected else 'is another'}"
        for name in names
    )


# --- what is attacked


RUN_IT = ["run", "run.toml", "--quiet", "--overwrite"]
RESUME_IT = ["resume", "run", "--quiet"]
SWEEP_IT = ["sweep", "grid.toml", "--quiet"]


def _resume(otherwise: list[str], isBegun: Callable[[RunState], bool] = lambda state: True) -> Callable:
    """Return what returns the command that goes on with a run; another one if it has not begun."""

    def goOn(folder: Path) -> list[str]:
        file = folder / "run.checkpoint"
        return RESUME_IT if file.exists() and isBegun(loadRunState(file)) else otherwise

    return goOn


def _look(*command: str) -> Scene:
    """Return the scene of a command that reads what a run wrote, and writes other files."""
    return Scene({"run.toml": RUN}, list(command), lambda folder: [*command, "--overwrite"], [RUN_IT])


SCENES = {
    "run": Scene({"run.toml": RUN}, RUN_IT, _resume(RUN_IT)),
    "resume": Scene({"run.toml": RUN}, RESUME_IT, _resume(RUN_IT), [RUN_IT], 150),
    "more": Scene(
        {"run.toml": RUN},
        [*RESUME_IT, "--steps", "3"],
        _resume([*RESUME_IT, "--steps", "3"], lambda state: len(state.config["stages"]) == 3),
        [RUN_IT],
    ),
    "overwrite": Scene(
        {"run.toml": RUN},
        [*RUN_IT, "--seed", "4"],
        _resume([*RUN_IT, "--seed", "4"], lambda state: state.config["sampling"]["seed"] == 4),
        [RUN_IT],
    ),
    "sweep": Scene({"run.toml": POINT, "grid.toml": GRID}, SWEEP_IT, lambda folder: SWEEP_IT),
    "sweepAgain": Scene({"run.toml": POINT, "grid.toml": GRID}, SWEEP_IT, lambda folder: SWEEP_IT, [SWEEP_IT], 150),
    "xyz": _look("convert", "run.vtkhdf", "out.xyz"),
    "pvd": _look("convert", "run.vtkhdf", "out.pvd", "--every", "3"),
    "ply": _look("convert", "run.vtkhdf", "out.ply", "--frame", "-1"),
    "vtkhdf": _look("convert", "run.dcd", "out.vtkhdf", "--topology", "run.ply"),
    "plot": _look("plot", "run"),
    "report": _look("report", "run"),
    "render": _look("render", "run.ply", "-o", "out.png"),
    "film": _look("render", "run.vtkhdf", "-o", "out.gif", "--every", "3"),
    "mp4": _look("render", "run.vtkhdf", "-o", "out.mp4", "--every", "3"),
}


class Attacked:
    """A scene in a folder of its own, and what comes of it undisturbed."""

    def __init__(self, scene: Scene, place: Path):
        self._scene, self._start = scene, _start(scene, place)
        self._before = contentsOf(self._start)
        with temporaryFolder() as folder:
            shutil.copytree(self._start, folder, dirs_exist_ok=True)
            watched = execute(scene.command, folder)
            _require(watched)
            self._expected = contentsOf(folder)
        self._names = [operation.split()[0] for operation in watched.operations]
        self._known = Path(tempfile.mkdtemp(dir=place))  # what has come of folders

    def count(self, mode: str) -> int:
        """Return how many attacks of a mode there are, which may be a few more than there are operations."""
        names = self._names
        counts = {
            "torn": names.count("write"),
            "short": names.count("write"),
            "full": sum(map(names.count, ROOMY)),
            "filled": min(TIMES_FILLED, 10 * len(names)),
        }
        return counts.get(mode, len(names))

    def attack(self, mode: str, n: int) -> str:
        """Return what is wrong after an attack, "" if nothing is."""
        with temporaryFolder() as disk, _mounted(disk) if mode == "filled" else contextlib.nullcontext():
            folder = disk / "folder"
            shutil.copytree(self._start, folder)
            outcome = execute(self._scene.command, folder, mode, n)
            try:
                complaint = self._judge(folder, outcome, mode)
            except Exception as error:
                complaint = f"{type(error).__name__}: {error}, after: {outcome.errors}"
        return complaint and f"{mode} {n} ({', '.join(outcome.operations[:1])}): {complaint}"

    def _judge(self, folder, outcome, mode):
        if outcome.code == 0:
            return outcome.errors or self._differences(folder)
        if outcome.code < 0 and not (mode in ("kill", "torn") and outcome.code == -signal.SIGKILL):
            return f"it dies of {signal.Signals(-outcome.code).name}"
        if outcome.code > 0 and not re.fullmatch("(openmm-helfrich: .+\n)+", outcome.errors):
            return f"exit code {outcome.code}, and it says: {outcome.errors}"
        if outcome.code > 0 and not any(Path(name).stem in outcome.errors for name in (*self._expected, folder)):
            return f"it names no file: {outcome.errors}"
        for prefix, step in re.findall(r"the results of (\S+) cannot .* up to step (\d+) is safe", outcome.errors):
            if int(step) > loadRunState(folder / f"{prefix}.checkpoint").step:
                return f"the checkpoint is of an earlier step than it says: {outcome.errors}"
        found = contentsOf(folder)
        wrong = [name for name in found if not self._isWhole(folder, name, found[name], mode)]
        if wrong:
            return f"{', '.join(wrong)} should not be as it is, after: {outcome.errors}"
        complaint = self._goOn(folder)
        return f"after '{outcome.errors}', {complaint}" if complaint else ""

    def _goOn(self, folder):
        """Return what is wrong after the command that goes on, which is done once in folders that are alike."""
        command = self._scene.goOn(folder)
        known = self._known / hashlib.sha256(repr((command, _stateOf(folder))).encode()).hexdigest()
        if not known.exists():
            again = execute(command, folder)
            isEnd = again.code == 0 or "is complete" in again.errors
            complaint = self._differences(folder) if isEnd else f"it does not go on: {again.errors}"
            known.write_text(complaint and f"{complaint}, with {' '.join(command)}")
        return known.read_text()

    def _differences(self, folder):
        return differences(contentsOf(folder), self._expected)

    def _isWhole(self, folder, name, content, mode):
        """Return whether a file is old or new after an attack."""
        file = Path(name)
        if file.name.startswith("."):
            return mode not in ("full", "filled") or name in self._before  # what is begun in vain is removed
        if file.suffix == ".toml":
            return bool(readTOML(folder / name))
        if file.name in OTHERS or file.suffix == ".checkpoint":
            return True
        new = self._expected.get(name)
        return content in (self._before.get(name), new) or (isinstance(new, list) and content == new[: len(content)])


# They may have ends that are dropped later, or say what happened.
OTHERS = ("run.csv", "run.dcd", "summary.csv")
ROOMY = ("open", "write", "link", "mkdir")


def _start(scene, place):
    """Return a folder with what is there before, the same for all scenes where that is the same."""
    folder = place / f"{zlib.crc32(repr((scene.files, scene.before, scene.killedAt)).encode())}"
    if not folder.exists():
        folder.mkdir()
        for file, text in scene.files.items():
            (folder / file).write_text(text)
        for i, command in enumerate(scene.before, 1):
            killedAt = scene.killedAt if i == len(scene.before) else 0
            _require(execute(command, folder, "kill" if killedAt else "watch", killedAt))
    return folder


@contextlib.contextmanager
def _mounted(folder):
    """Let a folder be a small disk of its own."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}", "none", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def _require(outcome):
    if outcome.code > 0:
        raise RuntimeError(f"without an attack there is an error: {outcome.errors}")


def main() -> None:
    """Attack the scenes and modes of the command line, and say what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help=f"some of {', '.join(SCENES)}; by default all")
    parser.add_argument("--mode", action="append", choices=MODES[1:], help="what happens; by default everything")
    parser.add_argument("--first", type=int, default=1, help="the number of the first operation that is attacked")
    parser.add_argument("--every", type=int, default=1, help="attack one of so many operations")
    parser.add_argument("--count", type=int, default=sys.maxsize, help="the most attacks of a scene and mode")
    parser.add_argument("--jobs", type=int, default=2, help="the number of processes")
    options = parser.parse_args()
    if "FAILING_DISK" not in os.environ:
        _startPreloaded()
    del os.environ["LD_PRELOAD"]
    _warmUp()
    if options.mode is None:
        options.mode = [mode for mode in MODES[1:] if mode != "filled" or _canMount()]
    hasFault = False
    with temporaryFolder() as place:
        for name in options.scenes or SCENES:
            scene = Attacked(SCENES[name], place)
            for mode in options.mode:
                attacks = range(options.first, scene.count(mode) + 1, options.every)[: options.count]
                start = time.monotonic()
                hasFault |= _attackInJobs(functools.partial(_attackAll, name, scene, mode), attacks, options.jobs)
                print(f"{name} {mode}: {len(attacks)} attacks in {time.monotonic() - start:.0f} s", flush=True)
    sys.exit(hasFault)


def _attackInJobs(attackAll, attacks, numJobs):
    """Share attacks out among processes, and return whether something was wrong after one of them."""
    size = math.ceil(len(attacks) / numJobs)
    jobs = [fork(functools.partial(attackAll, attacks[i * size : (i + 1) * size])) for i in range(numJobs)]
    codes = [waitFor(job) for job in jobs]
    return any(codes)


def _attackAll(name, scene, mode, attacks):
    """Make attacks, say what is wrong after them, and return whether something is."""
    hasFault = False
    for n in attacks:
        complaint = scene.attack(mode, n)
        if complaint:
            print(f"{name} {complaint}", flush=True)
            hasFault = True
    return hasFault


def _startPreloaded():
    """Compile the library, and start the program anew with it."""
    ownDisks = OWN_DISKS if subprocess.run([*OWN_DISKS, "true"], capture_output=True).returncode == 0 else []
    with tempfile.TemporaryDirectory() as place:
        library = f"{place}/FailingDisk.so"
        compiler = os.environ.get("CXX", "c++")
        source = Path(__file__).with_name("FailingDisk.cpp")
        subprocess.run([compiler, "-std=c++17", "-O1", "-shared", "-fPIC", source, "-o", library, "-ldl"], check=True)
        sys.exit(
            subprocess.run(
                [*ownDisks, sys.executable, __file__, *sys.argv[1:]],
                env={**os.environ, "LD_PRELOAD": library, "FAILING_DISK": library},
            ).returncode
        )


def _canMount():
    with temporaryFolder() as place:
        try:
            with _mounted(place):
                return True
        except subprocess.CalledProcessError:
            print("This system does not let a program mount a disk of its own; the mode 'filled' is left out.")
            return False


def _warmUp():
    """Import everything before there are children, and let pictures be drawn faster: those of runs without matplotlib,
    others without the best layout.
    """
    importEverything()
    for name in ("plotObservables", "plotPath", "drawMesh"):
        setattr(studies, name, _drawFast)
    Figure.set_layout_engine = lambda *_, **__: None
    with temporaryFolder() as place:
        drawMesh(mh.Mesh.icosphere(0), place / "a.png")
    gc.collect()
    gc.freeze()  # what is here already need not be looked at by the children


def _drawFast(shown, file, *_):
    """Write a small picture, another one for each mesh or table that it shows."""
    parts = (shown.vertices, shown.triangles) if isinstance(shown, mh.Mesh) else (shown[name] for name in shown)
    noise = hashlib.shake_256(b"".join(part.tobytes() for part in parts)).digest(64 * 64)
    picture = Image.frombytes("L", (64, 64), noise)
    saveFigure(SimpleNamespace(savefig=lambda part, **_: picture.save(part, "PNG")), file)


if __name__ == "__main__":
    main()
