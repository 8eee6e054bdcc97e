"""STL, text and binary."""

import struct

import numpy as np
from numpy.typing import NDArray

from .content import Content
from .text import Lines

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_ROUNDING = 1e-6  # of the largest coordinate: some units in the last place of single precision
_HEAD = 84  # a title of 80 bytes and the number of facets
_UNCOUNTED = (0, 2**32 - 1)  # what programs leave there that write facets as they come


def read(content: bytes) -> Content:
    """Read the facets of a file's bytes; corners with the same coordinates are one vertex."""
    count = struct.unpack("<I", content[80:_HEAD])[0] if len(content) >= _HEAD else -1
    isBinary = len(content) == _HEAD + _FACET.itemsize * count or b"\0" in content
    if not isBinary and content.lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid":
        return _readText(content)
    if not isBinary or count < 0:
        raise ValueError("this is no STL file: it is neither text that begins with 'solid' nor binary")
    return _readBinary(content, count)


def _readBinary(content: bytes, count: int) -> Content:
    there, beyond = divmod(len(content) - _HEAD, _FACET.itemsize)
    if there > 0 and beyond == 0 and count in _UNCOUNTED:
        notes = [f"the file says that it has {count} facets, and has {there}"]
        return _welded(np.frombuffer(content, dtype=_FACET, offset=_HEAD)["corners"], notes)
    if there < count:
        if content[80:_HEAD] == struct.pack(">I", there):
            raise ValueError("its numbers are in the byte order of big-endian machines, which STL does not allow")
        raise ValueError(f"it is not complete: it ends after {there} of {count} facets")
    corners = np.frombuffer(content, dtype=_FACET, count=count, offset=_HEAD)["corners"]
    beyond = len(content) - _HEAD - _FACET.itemsize * count
    return _welded(corners, [f"bytes after the last facet were left out: {beyond}"] * (beyond > 0))


def _readText(content: bytes) -> Content:
    lines = Lines(content, comment=None)
    rows: list[int] = []
    isOpen, isInside = False, False  # a solid, a facet
    for i, text in enumerate(lines.texts):
        word = text.split(None, 1)[0].lower()
        if word == "vertex" and isInside:
            rows.append(i)
        elif word == "facet" and isOpen and not isInside:
            isInside, first = True, len(rows)
        elif word == "endfacet" and isInside:
            if len(rows) - first != 3:
                raise lines.fault(i, f"after three corners of its facet, not {len(rows) - first}")
            isInside = False
        elif word in ("solid", "endsolid") and not isInside:
            isOpen = word == "solid"
        elif not (isInside and word in ("outer", "endloop", "end")):
            raise lines.fault(i, "a line of a facet" if isInside else "facet, solid or endsolid")
    if isInside:
        raise ValueError("it is not complete: it ends within a facet")
    corners = lines.rows(rows, 3, float, "vertex x y z", skip=1).reshape(-1, 3, 3)
    return _welded(corners, ["the file ends without 'endsolid'"] * isOpen)


def _welded(corners: NDArray[np.floating], notes: list[str]) -> Content:
    """Return facets whose corners are one vertex where they are equal, and along open edges also where they differ by
    rounding.
    """
    result = Content.ofLooseTriangles(corners, *notes)
    return result.welded(_ROUNDING * float(np.abs(result.points).max())) if len(corners) else result
