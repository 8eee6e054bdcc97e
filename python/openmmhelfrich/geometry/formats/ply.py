"""PLY, as text and binary in either byte order, with whatever elements and properties."""

import re
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from .content import Content, trianglesOfStrip
from .text import Lines

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Property:
    """A property: its name, the type of its values, and of their number if it is a list."""

    name: str
    kind: str
    countKind: str | None = None


@dataclass
class _Element:
    """An element: its name, how many there are, and the properties of each."""

    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


def read(content: bytes) -> Content:
    """Read the vertices, faces and triangle strips of a file's bytes."""
    order, elements, body, headLines = _readHead(content)
    source = _Text(content[body:], headLines) if order == "" else _Binary(content[body:], order)
    values = {element.name: source.read(element) for element in elements}
    if not all(name in values.get("vertex", {}) for name in "xyz"):
        raise ValueError("it has no element 'vertex' with the properties x, y and z")
    points = np.column_stack([values["vertex"][name] for name in "xyz"])
    result = _faces(points, values)
    result.box = _boxOf(content[:body])
    result.fields = {p: v for p, v in values["vertex"].items() if p not in "xyz" and np.ndim(v) == 1}
    for name, count in ((e.name, e.count) for e in elements if e.name not in ("vertex", "face", "tristrips")):
        result.noteLeftOut(count, f"elements '{name}'")
    result.noteLeftOut(source.beyond(), f"{'bytes' if order else 'lines'} after the last element")
    return result


def withBox(content: bytes, box: NDArray[np.float64]) -> bytes:
    """Return a file's bytes with the sides of a rectangular periodic box in a comment, which :func:`read` knows."""
    if np.any(box != np.diag(np.diag(box))):
        raise ValueError(f"the box has the vectors {box.tolist()}; it must be rectangular")
    head, rest = content.split(b"\nformat ", 1)
    line, rest = rest.split(b"\n", 1)
    sides = " ".join(repr(float(side)) for side in np.diag(box))
    return head + b"\nformat " + line + f"\ncomment periodic box {sides}\n".encode() + rest


def _boxOf(head: bytes) -> NDArray[np.float64] | None:
    """Return the box that a comment in a head tells, if there is one."""
    number = rb"[ \t]+(\d[^ \t\r\n]*)"
    found = re.search(rb"(?m)^comment periodic box" + 3 * number + rb"[ \t]*\r?$", head)
    return None if found is None else np.diag([float(side) for side in found.groups()])


def _faces(points: NDArray[np.floating], values: dict[str, dict[str, Any]]) -> Content:
    for name in ("face", "tristrips"):
        face = values.get(name, {})
        key = next((k for k in ("vertex_indices", "vertex_index") if k in face), None)
        if key is None and len(next(iter(face.values()), ())):
            raise ValueError(f"its element '{name}' has no list vertex_indices or vertex_index")
        if key is not None and name == "face" and not isinstance(face[key], list):
            corners = face[key].astype(np.int64)
            return Content(points, corners.ravel(), np.full(len(corners), corners.shape[1]))
        if key is not None and len(face[key]):
            rows = [np.asarray(row).astype(np.int64).tolist() for row in face[key]]
            return Content.ofFaces(points, rows if name == "face" else _ofStrips(rows))
    raise ValueError("the mesh has no triangles")


def _ofStrips(strips: list[list[int]]) -> list[list[int]]:
    """Return the triangles of strips, of which one list may hold several, with -1 between them."""
    faces = []
    for strip in strips:
        while strip:
            end = strip.index(-1) if -1 in strip else len(strip)
            faces += [face for face in trianglesOfStrip(strip[:end]) if len(set(face)) == 3]
            strip = strip[end + 1 :]
    return faces


def _readHead(content: bytes) -> tuple[str, list[_Element], int, int]:
    """Return the byte order, the elements, where the body begins, and how many lines there are before it."""
    if not re.match(rb"ply\s*[\r\n]", content):
        start = content[:20].splitlines()[0] if content.strip() else b""
        raise ValueError(f"line 1 is '{start.decode('ascii', 'replace')}'; it must be 'ply': this is no PLY file")
    end = re.search(rb"(?m)^end_header[ \t]*(\r\n|\n|\r)", content)
    if end is None:
        raise ValueError("it is not complete: it ends before 'end_header'")
    lines = Lines(content[: end.end()].replace(b"\r\n", b"\n").replace(b"\r", b"\n"), comment=None)
    order, elements = None, []
    for i, words in enumerate(map(str.split, lines.texts[1:-1]), start=1):
        if words[0] == "format" and len(words) == 3 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdecimal():
            elements.append(_Element(words[1], int(words[2])))
        elif words[0] == "property" and elements and (found := _property(words[1:])):
            elements[-1].properties.append(found)
        elif words[0] not in ("comment", "obj_info"):
            raise lines.fault(i, "format, element with its number, property with its type, comment or obj_info")
    if order is None:
        raise ValueError(f"its head has no format, which must be one of {', '.join(_ORDERS)}")
    return order, elements, end.end(), lines.numbers[-1]


def _property(words: list[str]) -> _Property | None:
    """Return the property that words declare, or None."""
    if len(words) == 2 and words[0] in _TYPES:
        return _Property(words[1], _TYPES[words[0]])
    if len(words) == 4 and words[0] == "list" and words[1] in _TYPES and words[2] in _TYPES:
        return _Property(words[3], _TYPES[words[2]], _TYPES[words[1]]) if _TYPES[words[1]][0] in "iu" else None
    return None


class _Binary:
    """A binary body, which is read element by element."""

    def __init__(self, content: bytes, order: str):
        self._content, self._order, self._place = content, order, 0

    def read(self, element: _Element) -> dict[str, Any]:
        """Return the values of each property: an array, with a row for each list if all are as long, or else a list of
        arrays.
        """
        if element.count == 0 or not element.properties:
            return {p.name: np.zeros((0, 3) if p.countKind else 0) for p in element.properties}
        return self._readEqual(element) or self._readDifferent(element)

    def _readEqual(self, element: _Element) -> dict[str, Any] | None:
        """Read an element whose lists are as long as those of the first one, or return None if they are not."""
        first = self._row(element, self._place)[0]
        fields: list[tuple] = []
        for p, value in zip(element.properties, first):
            if p.countKind is not None:
                fields.append((f"count {p.name}", self._order + p.countKind))
            fields.append((p.name, self._order + p.kind, *([len(value)] if p.countKind is not None else [])))
        row = np.dtype([(f"{i} {name}", *rest) for i, (name, *rest) in enumerate(fields)])
        if row.itemsize == 0 or (len(self._content) - self._place) // row.itemsize < element.count:
            if all(p.countKind is None for p in element.properties):
                self._fail(element, (len(self._content) - self._place) // max(row.itemsize, 1))
            return None
        table = np.frombuffer(self._content, row, element.count, self._place)
        columns = {name: table[f"{i} {name}"] for i, (name, *_) in enumerate(fields)}
        lists = {p.name: len(value) for p, value in zip(element.properties, first) if p.countKind is not None}
        if any(np.any(columns[f"count {name}"] != length) for name, length in lists.items()):
            return None
        self._place += row.itemsize * element.count
        return {p.name: columns[p.name] for p in element.properties}

    def _readDifferent(self, element: _Element) -> dict[str, Any]:
        rows = []
        for i in range(element.count):
            if self._place >= len(self._content):
                self._fail(element, i)
            values, self._place = self._row(element, self._place, i)
            rows.append(values)
        return {p.name: [row[i] for row in rows] for i, p in enumerate(element.properties)}

    def _row(self, element: _Element, place: int, number: int = 0) -> tuple[list[Any], int]:
        """Return the values of one element and where the next begins."""
        values = []
        for p in element.properties:
            count = 1
            if p.countKind is not None:
                count = int(self._array(p.countKind, 1, place, element, number)[0])
                place += np.dtype(p.countKind).itemsize
            array = self._array(p.kind, count, place, element, number)
            place += array.nbytes
            values.append(array if p.countKind is not None else array[0])
        return values, place

    def _array(self, kind: str, count: int, place: int, element: _Element, number: int) -> NDArray:
        if count < 0:
            raise ValueError(f"{element.name} {number} has a list of {count} values; there must be 0 or more")
        if place + count * np.dtype(kind).itemsize > len(self._content):
            self._fail(element, number)
        return np.frombuffer(self._content, self._order + kind, count, place)

    def _fail(self, element: _Element, number: int) -> NoReturn:
        raise ValueError(f"it is not complete: it ends after {number} of {element.count} elements '{element.name}'")

    def beyond(self) -> int:
        """Return how many bytes there are after the last element."""
        return len(self._content) - self._place


class _Text:
    """A body of text, with a line for each element."""

    def __init__(self, content: bytes, before: int):
        self._lines, self._place = Lines(content, comment=None), 0
        self._lines.numbers = [number + before for number in self._lines.numbers]

    def read(self, element: _Element) -> dict[str, Any]:
        """Return the values of each property; see :meth:`_Binary.read`."""
        what = f"the properties of {element.name}: {', '.join(p.name for p in element.properties)}"
        first, properties = self._place, element.properties
        self._lines.require(first, element.count, f"elements '{element.name}'")
        self._place += element.count
        result: dict[str, Any] = {}
        skip, lines = 0, range(first, first + element.count)
        for i, p in enumerate(properties):
            kind: type = float if p.kind[0] == "f" else int
            if p.countKind is None:
                result[p.name] = self._lines.rows(lines, 1, kind, what, skip)[:, 0]
                skip += 1
                continue
            sizes = self._lines.rows(lines, 1, int, what, skip)[:, 0]
            if len(sizes) and (sizes[0] < 0 or np.any(sizes != sizes[0])):
                return result | self._readDifferent(lines, properties[i:], skip, what)
            length = int(sizes[0]) if len(sizes) else 3
            if length > 0:
                result[p.name] = self._lines.rows(lines, length, kind, what, skip + 1)
            else:
                result[p.name] = np.zeros((element.count, 0))
            skip += 1 + length
        return result

    def _readDifferent(self, lines: range, properties: list[_Property], skip: int, what: str) -> dict[str, Any]:
        result: dict[str, list[NDArray]] = {p.name: [] for p in properties}
        for i in lines:
            words, place = self._lines.texts[i].split(), skip
            try:
                for p in properties:
                    count = 1 if p.countKind is None else int(words[place])
                    place += 0 if p.countKind is None else 1
                    values = [float(word) for word in words[place : place + count]]
                    if count < 0 or len(values) < count:
                        raise IndexError
                    place += count
                    result[p.name].append(np.array(values))
            except (ValueError, IndexError):
                raise self._lines.fault(i, what) from None
        return result

    def beyond(self) -> int:
        """Return how many lines there are after the last element."""
        return len(self._lines) - self._place
