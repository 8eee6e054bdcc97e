"""Locks: no two programs write the files of one prefix.

Who writes files of a prefix holds its lock meanwhile, a hidden file beside them, ``.NAME.lock``, which the operating
system locks and which says who holds it: process, host and time.  It is removed at the end.

What is promised:

- On one machine, a program that would write while another does is told so at once, whatever the spelling of the
  prefix.  The lock is the operating system's (flock): it ends with its holder, also after SIGKILL or a failure of
  power, and what is left of the file then is no lock.
- On a network file system whose locks reach all hosts (NFS, CephFS, GPFS, Lustre mounted with flock), the same holds
  for all of them, as soon as the server has noticed that a host is gone.
- Where locks do not reach other hosts (NFS mounted with nolock or local_lock, Lustre with localflock, most file
  systems in user space), or there are none at all, what the file says decides.  A holder on this host is known to be
  gone if its process is, if the number of the process is another's now, or if the machine has been started anew.  Of a
  holder on another host only a person can know: until the file is deleted, nobody else writes.
- Without any locks of the file system, two programs that find the lock of a third that is gone, within the same
  millisecond, may both take it.
"""

import contextlib
import errno
import fcntl
import json
import os
import platform
import re
import threading
import time
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from ..files import PathLike, hidden

# Of file systems whose locks hold on one host only.
_LOCAL_TYPES = ("fuse.", "9p", "beegfs", "vboxsf", "virtiofs")
_LOCAL_OPTIONS = {"nolock", "local_lock=all", "local_lock=flock", "localflock"}
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
_held = threading.local()  # by the present thread: the set of the files


class InUseError(OSError):
    """Somebody else holds a lock.

    ::

        try:
            mh.run("vesicle.toml")
        except mh.InUseError as error:
            print(error)  # which process has the prefix, and since when
    """


@contextlib.contextmanager
def locked(prefix: PathLike, seconds: float = 0.0) -> Iterator[None]:
    """Hold the lock of a prefix, whose folder is there; a thread that does already goes on holding it.

    Parameters
    ----------
    prefix : path
        the first part of the names of files
    seconds : float
        how long to wait if somebody else holds it

    Raises
    ------
    InUseError
        if somebody else holds it; it says who
    FileExistsError
        if that cannot be known; it says whose lock it is, and what to do
    OSError
        if the folder does not take files
    """
    file = lockOf(prefix)
    mine: set[Path] = vars(_held).setdefault("files", set())
    if file in mine:
        yield
        return
    descriptor = _take(file, prefix, time.monotonic() + seconds)
    mine.add(file)
    try:
        yield
    finally:
        mine.discard(file)
        with contextlib.suppress(OSError):  # the folder may be gone
            if _isSame(descriptor, file):
                file.unlink()
        _close(descriptor)


def lockOf(prefix: PathLike) -> Path:
    """Return the file that is the lock of a prefix, the same for all of its spellings."""
    path = Path(prefix)
    return hidden(path.parent.resolve() / path.name, "lock")


def _take(file: Path, prefix: PathLike, end: float) -> int:
    """Return the descriptor of the file, once it is ours."""
    while True:
        try:
            descriptor = _tryToTake(file, prefix)
        except InUseError:
            if time.monotonic() >= end:
                raise
            time.sleep(0.1)
        else:
            if descriptor is not None:
                return descriptor


def _tryToTake(file: Path, prefix: PathLike) -> int | None:
    """Return the descriptor of the file if it is ours now, or None if somebody removed it just now."""
    descriptor, isNew = _open(file)
    try:
        hasLock = _lock(descriptor, prefix)
        isOurs = _isSame(descriptor, file)
        if isOurs and not isNew:
            _requireGone(_read(descriptor), hasLock, file, prefix)
            if not hasLock:
                file.unlink()  # whoever makes it anew has it
                isOurs = False
        if isOurs:
            _write(descriptor, file)
            return descriptor
    except BaseException:
        _close(descriptor)
        raise
    _close(descriptor)
    return None


def _open(file: Path) -> tuple[int, bool]:
    """Return a descriptor of the file and whether it was made just now."""
    while True:
        for flags in (os.O_EXCL | os.O_CREAT, 0):
            try:
                return os.open(file, os.O_RDWR | flags, 0o666), flags != 0
            except FileExistsError:
                pass
            except FileNotFoundError:
                if not file.parent.is_dir():
                    raise FileNotFoundError(f"there is no folder {file.parent}") from None
            except OSError as error:
                raise _unwritable(error, file) from None


def _close(descriptor: int) -> None:
    with contextlib.suppress(OSError):  # it is closed in any case, and nobody needs what was in the file
        os.close(descriptor)


def _write(descriptor: int, file: Path) -> None:
    """Write who holds the lock; without room for that nobody does."""
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps(_myself()).encode(), 0)
        os.fsync(descriptor)
    except OSError as error:
        file.unlink()
        raise _unwritable(error, file) from None


def _unwritable(error: OSError, file: Path) -> OSError:
    return type(error)(f"{file} cannot be written ({error.strerror}); choose another folder")


def _lock(descriptor: int, prefix: PathLike) -> bool:
    """Return whether the file system could lock the file; raise an InUseError if somebody else has."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise _inUse(_read(descriptor), prefix) from None
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        return False
    return True


def _requireGone(holder: dict[str, Any], hasLock: bool, file: Path, prefix: PathLike) -> None:
    """Raise an error unless it is known that the holder that the file names is gone."""
    me = _myself()
    isHere = holder.get("boot") == me["boot"]
    if hasLock and (isHere or not holder or _reachesAllHosts(file)):
        return
    if isHere and holder["processes"] == me["processes"]:
        if _startOf(holder["process"]) != holder["started"]:
            return
        raise _inUse(holder, prefix)
    if holder.get("host") == me["host"] and not isHere:
        return
    kind = FileExistsError if holder else InUseError  # it may be about to write its name
    raise kind(
        f"{prefix} is in use by {_describe(holder)}, as {file} says, and locks do not tell here whether it still is; "
        f"if it has ended, delete {file}"
    )


def _inUse(holder: dict[str, Any], prefix: PathLike) -> InUseError:
    return InUseError(f"{prefix} is in use by {_describe(holder)}; wait for its end, or choose another name")


def _describe(holder: dict[str, Any]) -> str:
    if not holder:
        return "another process"
    return f"process {holder['process']} on {holder['host']}, since {holder['since']}"


def _myself() -> dict[str, Any]:
    """Return what tells the present process from all others."""
    return {
        "process": os.getpid(),
        "host": platform.node(),
        "since": f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M:%S} UTC",
        "started": _startOf(os.getpid()),
        "boot": _text("/proc/sys/kernel/random/boot_id") or platform.node(),
        "processes": _processes(),
    }


def _startOf(process: int) -> list[str]:
    """Return when a process started, in ticks since the start of the machine, or nothing if it has ended."""
    fields = _text(f"/proc/{process}/stat").rpartition(")")[2].split()
    return [] if fields[:1] in (["Z"], ["X"]) else fields[19:20]


def _processes() -> str:
    """Return what numbers of processes refer to: those of a container mean others outside of it."""
    try:
        return os.readlink("/proc/self/ns/pid")
    except OSError:
        return ""


def _text(file: PathLike) -> str:
    try:
        return Path(file).read_text(encoding="utf-8", errors="surrogateescape").strip()
    except OSError:
        return ""


def _read(descriptor: int) -> dict[str, Any]:
    """Return the holder that a file names, or nothing if none has been written, or not yet."""
    try:
        holder = json.loads(os.pread(descriptor, 10000, 0))
    except ValueError:
        return {}
    return holder if isinstance(holder, dict) and holder.keys() == _myself().keys() else {}


def _isSame(descriptor: int, file: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(file))
    except FileNotFoundError:
        return False


def _reachesAllHosts(file: Path) -> bool:
    """Return whether locks on a file hold on every host that sees it, as far as its mount tells."""
    options: set[str] = set()
    found, kind = Path(), ""
    for line in _text("/proc/self/mountinfo").splitlines():
        left, _, right = line.partition(" - ")
        point = Path(re.sub(r"\\(\d{3})", lambda code: chr(int(code[1], 8)), left.split()[4]))
        if file.is_relative_to(point) and len(point.parts) >= len(found.parts):
            found, kind, options = point, right.split()[0], {*right.split()[-1].split(","), *left.split()[5].split(",")}
    return not kind.startswith(_LOCAL_TYPES) and not options & _LOCAL_OPTIONS
