"""Files that are replaced whole, in a single step."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

PathLike: TypeAlias = str | os.PathLike[str]


@contextlib.contextmanager
def replacing(file: PathLike) -> Iterator[Path]:
    """Give a path to write to, with the same suffix; when that is done without an error, its file takes the place of
    another in a single step.

    Whatever happens meanwhile, a full disk or the end of the machine, the file is the old one or the new one, never
    half of one.
    """
    path = Path(file)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield part
        sync(part)
        os.replace(part, path)
    except BaseException as error:
        with contextlib.suppress(OSError):  # the first error tells more
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno and not error.filename:
            error.filename = str(path)  # an error of a write does not know it
        raise
    syncFolder(path.parent)


def sync(file: PathLike) -> None:
    """Wait until a file is on the disk."""
    with open(file, "rb") as written:
        os.fsync(written.fileno())


def syncFolder(folder: PathLike) -> None:
    """Wait until the names in a folder are on the disk."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:  # not every file system knows how
        if error.errno in (errno.EIO, errno.ENOSPC, errno.EDQUOT):
            error.filename = error.filename or os.path.abspath(folder)
            raise


def hidden(file: PathLike, ending: str) -> Path:
    """Return the name of a file beside another for what is not to be seen."""
    path = Path(file)
    return path.with_name(f".{path.name}.{ending}")
