"""What surrounds a command: the screen, which may go away at any time, and Ctrl-C, which may come at any time.

Only Python's own modules are imported here, so that little happens before Ctrl-C is looked after.
"""

import contextlib
import errno
import io
import os
import signal
import sys
from collections.abc import Iterable, Iterator
from types import FrameType
from typing import Any, NoReturn

from ..messages import explain

INTERRUPTED = 128 + signal.SIGINT
_hasBeenInterrupted = False


@contextlib.contextmanager
def attended() -> Iterator[None]:
    """Look after the screen and Ctrl-C while the command runs, and end with its exit code."""
    _openStreams()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _takeUnraisable
    try:
        yield
    except BaseException as error:
        code = _exitCodeOf(error)
        if code is None:
            raise
    else:
        code = 0
    sys.exit(_flushed(code))


def wasInterrupted() -> bool:
    """Return whether Ctrl-C has come.  Libraries may make errors of another kind of it."""
    return _hasBeenInterrupted


def say(text: str) -> None:
    """Print a message for the user on standard error."""
    for line in text.splitlines():
        print(f"openmm-helfrich: {line}", file=sys.stderr, flush=True)


def show(lines: Iterable[tuple[str, str]]) -> None:
    """Print a label and a text on each line, the texts below each other."""
    lines = list(lines)
    width = max([15, *(len(label) for label, _ in lines)])
    for label, text in lines:
        print(f"{label:>{width}}  {text}")


class _Screen(io.FileIO):
    """A stream that takes what nobody reads any more, and lets the command go on."""

    def __init__(self, descriptor: int, takesAll: bool):
        super().__init__(descriptor, "wb", closefd=False)
        self._takesAll = takesAll

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if self._takesAll or error.errno in (errno.EPIPE, errno.EIO):
                return len(data)
            raise


def _openStreams() -> None:
    """Make the streams such that nothing printed is an error, but for a full disk where results are printed."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # or else the next file would be the screen
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _screen(sys.stdout, 1, takesAll=False)
    sys.stderr = _screen(sys.stderr, 2, takesAll=True)


def _screen(stream: Any, descriptor: int, takesAll: bool) -> Any:
    buffer = io.BufferedWriter(_Screen(descriptor, takesAll))
    if stream is None:
        return io.TextIOWrapper(buffer, "utf-8", "backslashreplace", line_buffering=True)
    stream.flush()
    return io.TextIOWrapper(
        buffer,
        stream.encoding,
        "backslashreplace",
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Take Ctrl-C: it ends the command in order, but at once while something is imported, or when it comes again."""
    global _hasBeenInterrupted
    if _hasBeenInterrupted or _isImport(frame):  # libraries that are imported may swallow what is raised
        _exitAtOnce()
    _hasBeenInterrupted = True
    raise KeyboardInterrupt


def _exitAtOnce() -> NoReturn:
    with contextlib.suppress(OSError):
        os.write(2, b"openmm-helfrich: interrupted\n")
    os._exit(INTERRUPTED)


def _isImport(frame: FrameType | None) -> bool:
    while frame is not None and "importlib._bootstrap" not in frame.f_code.co_filename:
        frame = frame.f_back
    return frame is not None


def _takeUnraisable(unraisable: Any) -> None:
    """Take an exception that Python cannot raise, as in the end of an object: an interrupt ends the command all the
    same.
    """
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        _exitAtOnce()
    sys.__unraisablehook__(unraisable)


def _exitCodeOf(error: BaseException) -> int | None:
    """Return the exit code for what ended the command, after saying what there is to say; None for a fault of ours."""
    if isinstance(error, SystemExit) and not wasInterrupted():
        return error.code if isinstance(error.code, int) else int(error.code is not None)
    if wasInterrupted() or isinstance(error, KeyboardInterrupt):
        if not isinstance(error, SystemExit):
            say("interrupted")
        return INTERRUPTED
    sentence = explain(error)
    if sentence is None:
        return None
    say(sentence)
    return 1


def _flushed(code: int) -> int:
    """Print what waits to be printed, and return the exit code, which that can change."""
    try:
        sys.stdout.flush()
        return code
    except OSError as error:
        say(f"what was to be printed cannot be written: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Python would try once more
        return code or 1
