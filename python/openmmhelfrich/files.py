"""Files that are replaced whole, in a single step."""

import contextlib
import errno
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

from .messages import quoted

PathLike: TypeAlias = str | os.PathLike[str]

# No deflated data become larger than this many times their size, and nothing is refused that is smaller than this many
# bytes.
_GREATEST_RATIO, _SMALL = 1032, 1 << 20


def pathOf(file: Any, argument: str) -> Path:
    """Return the path that an argument gives; raise a TypeError that names it if it is none."""
    if isinstance(file, str | os.PathLike) and isinstance(os.fspath(file), str):
        return Path(file)
    raise TypeError(f"{argument} is {quoted(file)}; it must be a path: a str or a pathlib.Path")


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
        if isinstance(error, OSError) and error.errno and error.filename in (None, str(part)):
            # An error of a write does not know the file, and one of its beginning has the hidden one.
            error.filename = str(path) if path.parent.is_dir() else str(path.parent)
        raise
    syncFolder(path.parent)


@contextlib.contextmanager
def replacingAtOnce(file: PathLike) -> Iterator[io.BytesIO]:
    """Give memory to write to, whose content takes the place of a file in a single step.

    For libraries that do not notice when a disk takes a part of what they write.
    """
    content = io.BytesIO()
    yield content
    with replacing(file) as part:
        part.write_bytes(content.getbuffer())


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


def requireStored(what: str, size: int, stored: int, ratio: float = _GREATEST_RATIO) -> None:
    """Raise a ValueError if something claims far more bytes than a file has of it: that much memory would be taken.

    Parameters
    ----------
    what : str
        what it is
    size, stored : int
        the bytes that it claims, and those that are there
    ratio : float
        how many times smaller it may have become
    """
    if size > max(_SMALL, ratio * stored):
        raise ValueError(f"{what} claims {size} bytes, of which {stored} are there")
