"""Words of messages."""

from typing import Any

MOST_CHARACTERS = 100


def quoted(value: Any) -> str:
    """Return a value as a message shows it: as Python writes it, and the middle of what is long left out."""
    return shortened(repr(value))


def shortened(text: str) -> str:
    """Return a text for a message, with the middle of what is long left out."""
    if len(text) <= MOST_CHARACTERS:
        return text
    half = MOST_CHARACTERS // 2
    return f"{text[:half]} ... {text[-half:]} ({len(text)} characters)"
