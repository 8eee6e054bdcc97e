"""Files that grow in time that does not depend on their length, and of which no reader ever sees half a change.

HDF5 changes its indices in the midst of a file, so that adding to one in place tears it if the program is killed
meanwhile; and when the disk refuses a write, HDF5 may lose data without a word, or take the program with it.  Therefore
it writes to a :class:`Draft`, which keeps its changes in memory.  They are put on the disk here, where every error of a
write, a flush or a close is an exception, and into a hidden copy of the file, its twin.  When the twin has been read
back, the two change their names in a single step: the name of the file stands for the old content or for the new one,
whole, at any moment.  The old file is the next twin, and lacks just the pages that were changed.

A journal beside a file that is changed in place would take half of the room on the disk.  But it would leave a moment,
however short, in which a kill makes the file unreadable for all other programs, and every reader would have to know of
it.  Segments under a virtual file would leave many files, of which none must be lost.  Room for a second copy was
always needed, since files were copied whole to be changed.
"""

import contextlib
import io
import os
import shutil
import signal
import stat
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from ..files import PathLike, hidden, syncFolder

PAGE, BUFFER = 4096, 1 << 20


class Draft:
    """What a file is to become, or is: a file object for HDF5, whose changes stay in memory until they are written.

    None of its methods raises an error: HDF5 can crash after one.  It reads zeros then, and :meth:`check` raises the
    error.  HDF5 is to read from a Draft, too, where a file may change: what it opens by name it takes for a file of the
    same inode that it has open already, as that was.
    """

    def __init__(self, file: PathLike | None = None):
        """Begin with the content of a file, or with nothing."""
        self._base: io.FileIO | None = None
        self._baseSize, self._identity = 0, None
        if file is not None:
            self._base = io.FileIO(file)
            status = os.fstat(self._base.fileno())
            self._baseSize, self._identity = status.st_size, _identityOf(status)
        self._size, self._position = self._baseSize, 0
        self._changes: dict[int, bytes] = {}
        self._error: Exception | None = None

    def __enter__(self) -> "Draft":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        if self._base:
            self._base.close()

    @property
    def isNew(self) -> bool:
        """Whether it began with nothing."""
        return self._base is None

    @property
    def changedPages(self) -> Iterable[int]:
        """The numbers of the pages that differ from the file's."""
        return self._changes.keys()

    def isCurrent(self, file: PathLike) -> bool:
        """Return whether the name of a file still stands for the one that was opened, and that has not been changed."""
        try:
            return _identityOf(os.stat(file)) == self._identity
        except FileNotFoundError:
            return True  # it has been moved, where nobody changes it

    def check(self) -> None:
        """Raise the first error that there has been since the last time."""
        error, self._error = self._error, None
        if error:
            raise error

    def writeTo(self, file: PathLike, pages: Iterable[int] = ()) -> None:
        """Put the changes on the disk, into a file that has all the rest but for some other pages.

        A draft that began with nothing makes the file.
        """
        with open(file, "wb" if self.isNew else "r+b", buffering=BUFFER) as out:
            out.truncate(self._baseSize)
            next = 0
            for page in sorted({*self._changes, *pages}):
                if page != next:  # a seek writes what is in the buffer
                    out.seek(page * PAGE)
                out.write(self._page(page))
                next = page + 1
            out.truncate(self._size)
            out.flush()
            os.fsync(out.fileno())
        self.check()

    # --- what HDF5 calls

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> None:
        self._position = offset + (self._size if whence == os.SEEK_END else 0)

    def tell(self) -> int:
        return self._position

    def read(self, size: int) -> bytes:
        first, last = self._position // PAGE, (self._position + size - 1) // PAGE
        if self._changes:
            content = b"".join(self._page(page) for page in range(first, last + 1))
        else:
            content = self._stored(first, last + 1 - first)
        return content[self._position - first * PAGE :][:size]

    def readinto(self, buffer: Any) -> None:
        with self._noting():
            memoryview(buffer)[:] = self.read(len(buffer))

    def write(self, data: Any) -> None:
        with self._noting():
            first, last = self._position // PAGE, (self._position + len(data) - 1) // PAGE
            content = bytearray(b"".join(self._page(page) for page in range(first, last + 1)))
            start = self._position - first * PAGE
            content[start : start + len(data)] = data
            for i in range(last - first + 1):
                self._changes[first + i] = bytes(content[i * PAGE : (i + 1) * PAGE])
            self._size = max(self._size, self._position + len(data))

    def truncate(self, size: int) -> None:
        self._size = size

    def flush(self) -> None:
        pass

    def _page(self, number: int) -> bytes:
        return self._changes.get(number) or self._stored(number)

    def _stored(self, number: int, count: int = 1) -> bytes:
        """Return some pages of the file, with zeros beyond its end and where it cannot be read."""
        content = b""
        if self._base:
            with self._noting():
                content = os.pread(self._base.fileno(), count * PAGE, number * PAGE)
        return content.ljust(count * PAGE, b"\0")

    @contextlib.contextmanager
    def _noting(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            # Its frames would keep HDF5's objects, which keep the Draft, where no garbage collector sees it.
            self._error = self._error or error.with_traceback(None)


class GrowingFile:
    """A file, and its twin while it grows."""

    def __init__(self, file: PathLike):
        """Clear away what a killed program left beside a file."""
        self._path, self._twin, self._spare = Path(file), hidden(file, "part"), hidden(file, "old")
        self.close()

    def replace(self, draft: Draft, verify: Callable[[Path], None]) -> None:
        """Let the content of a draft, which began with the file's or with nothing, take the file's place.

        `verify` gets the name of a file that has it and is to raise an exception if it is not as it should be.  If that
        or anything else fails, the file is the old one or the new one.
        """
        try:
            if self._lag is None and not draft.isNew:
                shutil.copyfile(self._path, self._twin)
            draft.writeTo(self._twin, self._lag or ())
            verify(self._twin)
            self._exchange(draft)
        except BaseException:
            with contextlib.suppress(OSError):  # the first error tells more
                self.close()
            raise

    def close(self) -> None:
        """Remove the twin."""
        # The pages in which the twin is behind the file; None without a twin.
        self._lag: list[int] | None = None
        self._twin.unlink(missing_ok=True)
        self._spare.unlink(missing_ok=True)

    def _exchange(self, draft: Draft) -> None:
        lag = None if draft.isNew or not self._linkSpare() else list(draft.changedPages)
        os.replace(self._twin, self._path)
        if lag is not None:
            os.replace(self._spare, self._twin)
        self._lag = lag
        syncFolder(self._path.parent)

    def _linkSpare(self) -> bool:
        """Give the file a second name under which it lives on, and return whether that is possible."""
        status = os.lstat(self._path)
        if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
            return False  # it has names elsewhere, for which it must not change
        try:
            os.link(self._path, self._spare)
        except OSError:  # not every file system knows how; a new twin will be copied then
            return False
        return True


@contextlib.contextmanager
def signalsLater() -> Iterator[None]:
    """Let signals wait that would call Python: an exception must not come up within HDF5 while it writes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[tuple[Any, ...]] = []
    found = {number: signal.getsignal(number) for number in signal.valid_signals()}
    handlers = {number: handler for number, handler in found.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda *arguments: came.append(arguments))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in came:
            handlers[number](number, frame)


def _identityOf(status: os.stat_result) -> tuple[int, int, int]:
    return status.st_dev, status.st_ino, status.st_mtime_ns
