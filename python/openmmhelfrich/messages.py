"""Words of messages."""

import sys
from typing import Any

from .installation import InstallationError, explainLoading, isOfLibraries

MOST_CHARACTERS = 100


def quoted(value: Any) -> str:
    """Return a value as a message shows it: as Python writes it, and the middle of what is long left out."""
    return shortened(repr(value))


def shortened(text: str, most: int = MOST_CHARACTERS) -> str:
    """Return a text for a message, with the middle of what is long left out."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]} ... {text[-half:]} ({len(text)} characters)"


def inLine(error: object) -> str:
    """Return what a library says, which may hold bytes of a file, on one line that is not too long."""
    words = " ".join(str(error).split())
    return shortened("".join(c if c.isprintable() else "?" for c in words), 3 * MOST_CHARACTERS)


def explain(error: BaseException) -> str | None:
    """Return what to tell a user of an error that is no fault of the program; None of one that is.

    C++ gives its errors as OpenMMExceptions, also those of memory.
    """
    text = str(error)
    openmm = sys.modules.get("openmm")  # what has not been imported has raised nothing
    isOpenMM = openmm is not None and isinstance(error, openmm.OpenMMException)
    if isinstance(error, MemoryError) or (isOpenMM and "bad_alloc" in text):
        return f"there is not enough memory{f': {text}' if text and 'bad_alloc' not in text else ''}"
    if isinstance(error, InstallationError):
        return text
    if isinstance(error, ImportError) and isOfLibraries(error):
        return explainLoading(text)
    if isinstance(error, ImportError):
        return f"{error.name or 'a library'} cannot be loaded: {text}"
    if isinstance(error, RuntimeError) and "start new thread" in text:
        return "the system can start no more threads"
    if isinstance(error, OSError) and error.strerror:
        return f"{shortened(str(error.filename))}: {error.strerror}" if error.filename else error.strerror
    return text if isOpenMM or isinstance(error, (ValueError, OSError)) else None
