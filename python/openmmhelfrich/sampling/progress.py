"""What functions that take long tell how far they are."""

from typing import Any

from ..messages import quoted


def requireProgress(progress: Any, hasBars: bool = False) -> None:
    """Raise a TypeError unless a progress is a function or None; True and False will do, too, where there are bars."""
    if progress is not None and not callable(progress) and not (hasBars and isinstance(progress, bool)):
        allowed = "a function, True for bars, or None" if hasBars else "a function or None"
        raise TypeError(f"progress is {quoted(progress)}; it must be {allowed}")
