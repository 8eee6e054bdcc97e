"""Files that are damaged by chance: each command that reads one must take it or say in a sentence what is wrong.

A child reads many files, one after the other, with limits of time and memory; a file that ends it is known by its
number.  What is wrong with a command: a traceback, a signal, a warning that nobody understands, an error that does not
name the file, more time or memory than allowed, results that are not numbers.
"""

import argparse
import contextlib
import faulthandler
import functools
import importlib
import io
import json
import math
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import openmm as mm
from attacks import GRID, RUN
from children import fork, importEverything, temporaryFolder, waitFor
from matplotlib.figure import Figure

import openmmhelfrich as mh
from openmmhelfrich.cli import app
from openmmhelfrich.geometry.formats import _vtkreader, vtkfiles
from openmmhelfrich.runs.checkpoint import loadSimulation
from openmmhelfrich.runs.config import readConfig
from openmmhelfrich.runs.grids import readGrid
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.studies import resume, run

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from meshdialects import DIALECTS

SECONDS, BYTES = 10, 2 << 30
BATCH = 500

TOKEN = re.compile(rb"[-+]?[0-9][0-9.eE+-]*|[A-Za-z_]+")
CLAIMS = [0, 1, -1, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1, 10**9, 2**62, 2**63 - 1, -(2**63)]
TEXTS = (
    b"0 1 -1 2.5 nan inf -inf 1e308 1e-308 1e999 800000000 99999999999999999999 true [] {} '' \xff \x00 \xe2\x82".split(
        b" "
    )
)


def damaged(content: bytes, random: np.random.Generator) -> bytes:
    """Return bytes like others, of which some are changed, missing, twice there, or claim what is not there."""
    for _ in range(random.choice([1, 1, 1, 2, 5])):
        content = _DAMAGES[random.integers(len(_DAMAGES))](content, random)
    return content


def _part(content, random, most=None):
    """Return the first and last place of a part, short as a rule."""
    start = random.integers(len(content) + 1)
    longest = len(content) - start if random.integers(4) == 0 else min(16, len(content) - start)
    return start, start + random.integers(longest + 1)


def _cut(content, random):
    return content[: random.integers(len(content) + 1)]


def _flip(content, random):
    changed = bytearray(content)
    for place in random.integers(max(1, len(content)), size=random.choice([1, 2, 8])):
        changed[place : place + 1] = bytes(byte ^ (1 << random.integers(8)) for byte in changed[place : place + 1])
    return bytes(changed)


def _leaveOut(content, random):
    start, end = _part(content, random)
    return content[:start] + content[end:]


def _repeat(content, random):
    start, end = _part(content, random)
    return content[:end] + content[start:end] * random.choice([1, 1, 3, 50]) + content[end:]


def _exchange(content, random):
    (a, b), (c, d) = sorted((_part(content, random), _part(content, random)))
    return content if b > c else content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:]


def _claim(content, random):
    """Let a binary number claim something."""
    size = int(random.choice([1, 2, 4, 8]))
    place = int(random.integers(len(content) + 1)) // size * size
    number = CLAIMS[random.integers(len(CLAIMS))] % 256**size
    return content[:place] + number.to_bytes(size, random.choice(["little", "big"])) + content[place + size :]


def _replaceToken(content, random):
    """Let a word or number of a text be another."""
    tokens = list(TOKEN.finditer(content))
    if not tokens:
        return _flip(content, random)
    # The first ones, of heads, are chosen as often as all the others.
    token = tokens[random.integers(len(tokens) if random.integers(2) else min(40, len(tokens)))]
    other = TEXTS[random.integers(len(TEXTS))] if random.integers(4) else tokens[random.integers(len(tokens))][0]
    return content[: token.start()] + other + content[token.end() :]


def _changeLines(content, random):
    lines = content.splitlines(keepends=True) or [b""]
    i, j = random.integers(len(lines), size=2)
    kind = random.integers(3)
    if kind == 0:
        lines[i], lines[j] = lines[j], lines[i]
    elif kind == 1:
        lines.insert(i, lines[j])
    else:
        del lines[i]
    return b"".join(lines)


def _other(content, random):
    size = random.choice([0, 1, 100, len(content)])
    return bytes(size) if random.integers(2) else random.bytes(size)


_DAMAGES = [
    *[_cut, _flip, _flip, _leaveOut, _repeat, _exchange, _claim, _claim, _claim],
    *[_replaceToken, _replaceToken, _replaceToken, _replaceToken, _changeLines, _changeLines],
]


def damagedArchive(content: bytes, random: np.random.Generator) -> bytes:
    """Return a ZIP archive of which a part is damaged and has the right checksum, or which is damaged itself."""
    if random.integers(4) == 0:
        return damaged(content, random)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    name = sorted(parts)[random.integers(len(parts))]
    parts[name] = damaged(parts[name], random)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, part in parts.items():
            archive.writestr(name, part)
    return out.getvalue()


# --- what reads them


class Nonsense(Exception):
    """What a command took without a word."""


@dataclass
class Kind:
    """Files of a kind.

    Attributes
    ----------
    name : str
        of the file that is damaged
    read : callable
        reads the file in the working folder; it raises Nonsense if what comes of it is that
    mentions : str
        a pattern of what a message mentions that does not have the file's name
    damage : callable
        returns damaged content
    """

    name: str
    read: Callable[[], object]
    mentions: str = "^$"
    damage: Callable[[bytes, np.random.Generator], bytes] = damaged


def _do(*command):
    """Do a command that may end the program if it fails."""
    try:
        app(list(command))
    except SystemExit as end:
        if end.code:
            raise


def _check(file):
    _do("check", file)
    if not mh.Mesh.read(file).volume > 0:
        raise Nonsense("the volume is not positive")


def _convert(*arguments):
    _do("convert", *arguments, "out.xyz", "--overwrite")
    positions = re.findall(r"^V (\S+) (\S+) (\S+)$", Path("out.xyz").read_text(), re.MULTILINE)
    if not np.all(np.isfinite(np.array(positions, dtype=float))):
        raise Nonsense("positions are not finite")


def _create():
    scene = Scene.of(readConfig("other.toml"))
    force = scene.createForce()
    context = scene.createSimulation(force).context
    if not math.isfinite(context.getState(energy=True).getPotentialEnergy()._value):
        raise Nonsense("the energy is not finite")


def _resume():
    def stop(study):
        raise KeyboardInterrupt

    try:
        resume("run", progress=stop)
    finally:
        for name in ("run.csv", "run.dcd", "run.vtkhdf"):
            shutil.copy(f"good/{name}", name)


def _simulate(damagedFile):
    """Make a Context of XML, of which one file is damaged."""
    texts = (Path(file).read_bytes().decode("latin-1") for file in XML)
    system, integrator, state = map(mm.XmlSerializer.deserialize, texts)
    context = mm.Context(system, integrator, mm.Platform.getPlatform("Reference"))
    context.setState(state)
    if not math.isfinite(context.getState(energy=True).getPotentialEnergy()._value):
        raise Nonsense("the energy is not finite")


XML = ("system.xml", "integrator.xml", "state.xml")
MESHES = ("stl", "ply", "obj", "off", "vtk", "vtu", "msh", "tsi", "q", "h5")
ONLY_READ = ("vtp", "gltf", "glb")
KINDS = {
    "toml": Kind("other.toml", _create, r"\[\w+\] \w+"),
    "grid": Kind("grid.toml", lambda: readGrid("grid.toml"), "there is no configuration file | is a folder"),
    "trimem": Kind("trimem.inp", lambda: _do("config", "--from-trimem", "trimem.inp"), "File name too long"),
    **{suffix: Kind(f"mesh.{suffix}", functools.partial(_check, f"mesh.{suffix}")) for suffix in MESHES + ONLY_READ},
    "vtkhdf": Kind("run.vtkhdf", lambda: _convert("run.vtkhdf")),
    "dcd": Kind("run.dcd", lambda: _convert("run.dcd", "--topology", "run.ply")),
    "psf": Kind("run.psf", lambda: _convert("run.dcd", "--topology", "run.psf")),
    "csv": Kind("run.csv", lambda: _do("plot", "run.csv", "-o", "out.png", "--overwrite")),
    "page": Kind("run.csv", lambda: _do("report", "run", "--overwrite")),
    "settings": Kind("run.resolved.toml", lambda: _do("report", "run", "--overwrite"), r"\[\w+\] \w+"),
    "checkpoint": Kind("run.checkpoint", _resume, damage=damagedArchive),
    **{name.split(".")[0]: Kind(name, functools.partial(_simulate, name)) for name in XML},
}
TRIMEM = """
[GENERAL]
input = mesh.stl
[BONDS]
bond_type = Edge
[ENERGY]
kappa_b = 30.0
kappa_a = 1.0e4
area_fraction = 1.0
volume_fraction = 0.9
[HMC]
num_steps = 100
step_size = 2.5e-4
traj_steps = 10
"""


def prepare() -> None:
    """Write good files into the working folder, and a copy of them into another."""
    Path("run.toml").write_text(RUN)
    Path("grid.toml").write_text(GRID)
    Path("trimem.inp").write_text(TRIMEM)
    with contextlib.suppress(KeyboardInterrupt):
        run("run.toml", progress=_stopAfter(6))
    Path("other.toml").write_bytes(Path("run.resolved.toml").read_bytes())
    mesh = mh.Mesh.icosphere(1)
    for suffix in MESHES:
        mesh.write(f"mesh.{suffix}")
    for suffix in ONLY_READ:
        write = next(write for kind, write in DIALECTS.values() if kind == suffix)
        Path(f"mesh.{suffix}").write_bytes(write(mesh.vertices, mesh.triangles))
    with zipfile.ZipFile("run.checkpoint") as archive:
        archive.extractall(members=XML[:2])
    _writeState("state.xml")
    shutil.copytree(".", "good")


def _writeState(file):
    simulation, _ = loadSimulation("run.checkpoint", mm.Platform.getPlatform("Reference"), {})
    simulation.saveState(file)


def _stopAfter(step):
    def progress(study):
        if study.simulation.currentStep == step:
            raise KeyboardInterrupt

    return progress


# --- what comes of it


def judge(kind: Kind) -> str:
    """Read a file in the working folder, and return what is wrong with how that ends; "" if nothing is."""
    said, printed = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(printed):
            kind.read()
        return said.getvalue()
    except SystemExit:
        if "ready after" in printed.getvalue():  # the verdict of check
            return said.getvalue()
        lines = said.getvalue().splitlines()
        if not lines or not all(line.startswith("openmm-helfrich: ") for line in lines):
            return f"it says: {said.getvalue()}"
        return _faultOf(said.getvalue(), kind)
    except (ValueError, OSError, mm.OpenMMException) as error:
        return said.getvalue() or _faultOf(str(error), kind)
    except Nonsense as nonsense:
        return f"without a word {nonsense}"
    except BaseException:
        return traceback.format_exc()


def _faultOf(message, kind):
    if kind.name in XML:  # which OpenMM reads, and says what it will
        return ""
    if kind.name not in message and not re.search(kind.mentions, message):
        return f"it names no file: {message}"
    longest = max(map(len, message.splitlines()))
    return f"it has {longest} characters a line: {message[:200]}" if longest > 500 else ""


def _requireGood(kind):
    """Raise an error unless the file is taken that is not damaged."""
    with contextlib.redirect_stdout(io.StringIO()):
        kind.read()


def readAll(name: str, seed: int, numbers: range) -> Iterator[tuple[int, str]]:
    """Yield, for each of some damaged files, its number and what is wrong with how it is read."""
    kind, content = KINDS[name], Path(f"good/{KINDS[name].name}").read_bytes()
    shutil.copy(f"good/{kind.name}", kind.name)
    _requireGood(kind)
    for number in numbers:
        random = np.random.default_rng([seed, list(KINDS).index(name), number])
        Path(kind.name).write_bytes(kind.damage(content, random))
        signal.setitimer(signal.ITIMER_PROF, SECONDS)  # of computing: others may have the processor
        signal.alarm(20 * SECONDS)
        yield number, judge(kind)
    shutil.copy(f"good/{kind.name}", kind.name)


def attack(name: str, seed: int, numbers: range) -> Iterator[str]:
    """Read damaged files in children, and yield what is wrong."""
    while numbers:
        found, end = _readInChild(name, seed, numbers[:BATCH])
        yield from (f"{name} {number}: {what}" for number, what in found if what)
        numbers = numbers[len(found) :]
        if end.startswith("exit code 99:"):
            raise RuntimeError(f"{name}: {end}")
        if end:
            if " in step\n" not in end:  # a file may ask for steps that take long
                yield f"{name} {numbers[0]}: {end}"
            numbers = numbers[1:]


def _readInChild(name, seed, numbers):
    """Return, for the damaged files that a child has read, what is wrong, and how it ended if a file ended it."""
    with tempfile.TemporaryFile("w+") as results, tempfile.TemporaryFile("w+") as errors:

        def read():
            os.dup2(errors.fileno(), 2)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            faulthandler.enable()
            for number in (signal.SIGPROF, signal.SIGALRM):
                faulthandler.register(number, chain=True)
            resource.setrlimit(resource.RLIMIT_AS, (_addressSpace() + BYTES,) * 2)
            for result in readAll(name, seed, numbers):
                print(json.dumps(result), file=results, flush=True)

        code = waitFor(fork(read))
        results.seek(0)
        errors.seek(0)
        found = [json.loads(line) for line in results]
        return found, "" if code == 0 and len(found) == len(numbers) else f"exit code {code}: {errors.read()[:1500]}"


def readInFork(command: list[str], env: dict[str, str], timeout: float, **_: bool) -> subprocess.CompletedProcess:
    """Do what the program that reads with VTK does, in a child that has VTK already: ten times as fast."""
    with tempfile.TemporaryFile() as errors:

        def read():
            os.dup2(errors.fileno(), 2)
            os.environ.update(env)
            faulthandler.disable()
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.alarm(round(timeout))
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            try:
                _vtkreader.main(*command[-2:])
            except SystemExit as end:
                print(end, file=sys.stderr, flush=True)
                return 1

        code = waitFor(fork(read))
        if code == -signal.SIGALRM:
            raise subprocess.TimeoutExpired(command, timeout)
        errors.seek(0)
        return subprocess.CompletedProcess(command, code, b"", errors.read())


def _addressSpace():
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def main() -> None:
    """Read damaged files of the kinds of the command line, and say what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", help=f"some of {', '.join(KINDS)}; by default all")
    parser.add_argument("--count", type=int, default=10000, help="how many files of each kind")
    parser.add_argument("--first", type=int, default=0, help="the number of the first")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    # Pictures are not what this is about.
    mock.patch.object(Figure, "savefig", lambda *_, **__: None).start()
    mock.patch.object(Figure, "set_layout_engine").start()
    quicker = SimpleNamespace(run=readInFork, TimeoutExpired=subprocess.TimeoutExpired)
    mock.patch.object(vtkfiles, "subprocess", quicker).start()
    warnings.simplefilter("always")
    hasFault = False
    with temporaryFolder() as place:
        os.chdir(place)
        importEverything()
        for name in ("vtkIOLegacy", "vtkIOXML", "util.numpy_support"):
            importlib.import_module(f"vtkmodules.{name}")
        if waitFor(fork(prepare)):
            sys.exit("the good files cannot be made")
        for name in options.kinds or KINDS:
            faults = 0
            for wrong in attack(name, options.seed, range(options.first, options.first + options.count)):
                faults += 1
                print(wrong, flush=True)
            print(f"{name}: {options.count} files, {faults} faults", flush=True)
            hasFault = hasFault or faults > 0
        os.chdir("/")
    sys.exit(hasFault)


if __name__ == "__main__":
    main()
