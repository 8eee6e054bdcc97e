"""Files that are replaced whole, in a single step."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

PathLike: TypeAlias = str | os.PathLike[str]


@contextlib.contextmanager
def replacing(file: PathLike) -> Iterator[Path]:
    """Give a path to write to; when that is done without an error, its file takes the place of another in a single
    step.

    Whatever happens meanwhile, a full disk or the end of the machine, the file is the old one or the new one, never
    half of one.
    """
    path = Path(file)
    part = path.with_name(f".{path.name}.part")
    try:
        yield part
        sync(part)
        os.replace(part, path)
        _syncFolder(path.parent)
    finally:
        part.unlink(missing_ok=True)


def sync(file: PathLike) -> None:
    """Wait until a file is on the disk."""
    with open(file, "rb") as written:
        os.fsync(written.fileno())


def _syncFolder(folder: Path) -> None:
    with contextlib.suppress(OSError):  # not every file system knows how
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
