"""Commands in children of a process that has imported everything, under attack.

The process must have FailingDisk preloaded.
"""

import atexit
import contextlib
import ctypes
import gc
import importlib
import os
import pkgutil
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, NamedTuple

import openmmhelfrich as mh
from openmmhelfrich.cli import app

# What FailingDisk does, in its order; and an attack of other processes.
ON_OPERATIONS = ("watch", "fail", "full", "kill", "torn", "short")
MODES = (*ON_OPERATIONS, "filled")
SECONDS = 600  # that a command may take


class Outcome(NamedTuple):
    """What came of a command.

    Attributes
    ----------
    code : int
        its exit code, or less than 0: the signal that ended it
    errors : str
        what it wrote to standard error
    operations : list of str
        those that were attacked, or all that were watched
    """

    code: int
    errors: str
    operations: list[str]


def execute(command: list[str], folder: Path, mode: str = "watch", n: int = 0) -> Outcome:
    """Do a command in a folder, in a process of its own, under an attack."""
    with (
        tempfile.TemporaryFile() as errors,
        tempfile.TemporaryFile() as journal,
        _filling(folder, n) if mode == "filled" else contextlib.nullcontext(),
    ):
        how = mode if mode in ON_OPERATIONS else "watch"
        code = waitFor(fork(lambda: _doCommand(command, folder, how, n, errors.fileno(), journal.fileno())))
        return Outcome(code, _textOf(errors), _textOf(journal).splitlines())


def fork(work: Callable[[], int | None]) -> int:
    """Do what makes Contexts in a process of its own, whose number is returned.

    The threads of Contexts are not in the children of the process that made them.
    """
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = work() or 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    return child


def waitFor(child: int) -> int:
    """Return the exit code of a child, or less than 0: the signal that ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def importEverything() -> None:
    """Import all modules of the package, and what they import later, which children have then from the start."""
    names = [module.name for module in pkgutil.walk_packages(mh.__path__, "openmmhelfrich.")]
    for name in (*names, "distributed", "meshio"):
        if not name.endswith("__main__"):
            importlib.import_module(name)


@contextlib.contextmanager
def temporaryFolder() -> Iterator[Path]:
    """Lend a folder, which no child that ends removes."""
    place = Path(tempfile.mkdtemp())
    try:
        yield place
    finally:
        shutil.rmtree(place)


def _textOf(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode()


def _doCommand(command, folder, mode, n, errors, journal):
    signal.alarm(SECONDS)
    os.chdir(folder)
    os.dup2(errors, 2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    _arm(folder, mode, n, journal)
    code = _do(command)
    gc.collect()
    atexit._run_exitfuncs()
    _arm(folder, mode, 0, -1)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    return code


def _arm(folder, mode, n, journal):
    ctypes.CDLL(None).attack(os.fsencode(folder), ON_OPERATIONS.index(mode), ctypes.c_long(n), journal)


def _do(command):
    try:
        with contextlib.ExitStack() as stack:
            if command[0] == "sweep":
                command = [*command, "--scheduler", stack.enter_context(_cluster()).scheduler_address]
            app(command)
    except SystemExit as end:
        return end.code or 0
    except BaseException:
        traceback.print_exc()
        return 99
    return 0


def _cluster():
    """Return a Dask cluster whose worker is this process, so that what it does is attacked too."""
    from distributed import LocalCluster

    return LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0", silence_logs="CRITICAL"
    )


@contextlib.contextmanager
def _filling(folder, seed):
    """Let another process fill the disk and make room, again and again."""
    filler = fork(lambda: _fill(folder.parent / "other", random.Random(seed)))
    try:
        yield
    finally:
        os.kill(filler, signal.SIGKILL)
        waitFor(filler)
        (folder.parent / "other").unlink(missing_ok=True)


def _fill(file, moments):
    with open(file, "ab", buffering=0) as out:
        while True:
            with contextlib.suppress(OSError):
                while True:
                    out.write(bytes(4096))
            time.sleep(moments.choice([0, 0.01, 0.1]))
            out.truncate(max(0, out.seek(0, os.SEEK_END) - moments.choice([4096, 20000, 100000, 10**7])))
            time.sleep(moments.choice([0, 0.01, 0.1, 0.5]))
