"""A mesh written in the dialects of each format that programs write, for tests of readers.

A dialect takes (N, 3) vertices and (T, 3) triangles and returns the bytes of a file.  Those of VTK are written by VTK
itself, as are those of GMSH by meshio.  Beside the triangles they have what files have: normals, colors, texture
coordinates, comments, other elements.
"""

import base64
import io
import json
import struct
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

Dialect = Callable[[np.ndarray, np.ndarray], bytes]
DIALECTS: dict[str, tuple[str, Dialect]] = {}


def dialect(suffix: str, name: str) -> Callable[[Dialect], Dialect]:
    """Register a dialect of a format."""

    def register(function: Dialect) -> Dialect:
        DIALECTS[f"{suffix}: {name}"] = suffix, function
        return function

    return register


def numbers(row):
    return " ".join(f"{x:.17g}" for x in row)


def text(*lines):
    return ("\n".join(lines) + "\n").encode()


# --- STL


def binarySTL(vertices, triangles, header=b"made for a test", after=b"", attribute=0):
    facets = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"], facets["attribute"] = vertices[triangles], attribute
    return header.ljust(80)[:80] + struct.pack("<I", len(triangles)) + facets.tobytes() + after


def textSTL(vertices, triangles, name="cell", endLoop="endloop", normal="facet normal 0 0 1", indent="  ", end="\n"):
    def facet(corners):
        rows = [f"vertex {numbers(x)}" for x in corners]
        return [normal, indent + "outer loop", *(2 * indent + row for row in rows), indent + endLoop, "endfacet"]

    lines = [f"solid {name}", *(line for corners in vertices[triangles] for line in facet(corners)), "endsolid"]
    return (end.join(lines) + end).encode()


dialect("stl", "binary")(binarySTL)


@dialect("stl", "binary that begins with solid")
def _(x, t):
    return binarySTL(x, t, b"solid made by a program")


@dialect("stl", "bytes after the last facet")
def _(x, t):
    return binarySTL(x, t, after=b"\n\n\0made by a program")


@dialect("stl", "facets not counted, 0")
def _(x, t):
    return binarySTL(x, t)[:80] + bytes(4) + binarySTL(x, t)[84:]


@dialect("stl", "facets not counted, the largest number")
def _(x, t):
    return binarySTL(x, t)[:80] + b"\xff" * 4 + binarySTL(x, t)[84:]


@dialect("stl", "colors in the attributes")
def _(x, t):
    return binarySTL(x, t, b"COLOR=\xff\xff\xff\xff", attribute=0x8C1F)


dialect("stl", "text")(textSTL)


@dialect("stl", "text with end loop")
def _(x, t):
    return textSTL(x, t, endLoop="end loop")


@dialect("stl", "text in capitals")
def _(x, t):
    return textSTL(x, t).upper()


@dialect("stl", "text with a name like a keyword, tabs, lines of Windows")
def _(x, t):
    return textSTL(x, t, name="vertex facet normal", indent="\t", end="\r\n")


@dialect("stl", "text of several solids")
def _(x, t):
    half = len(t) // 2
    return textSTL(x, t[:half], name="a") + textSTL(x, t[half:], name="b")


# --- PLY

FLOATS = {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
INTEGERS = {"uchar": "u1", "uint8": "u1", "char": "i1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
TYPES = FLOATS | INTEGERS | {"int32": "i4", "uint32": "u4", "uint16": "u2"}


def ply(kind, elements, head=("comment made for a test",), end="\n"):
    """Write a PLY file of elements: (name, properties, rows), where a property is "type name" or "list type type name",
    and a row has a number or a list for each.
    """
    lines, body = ["ply", f"format {kind} 1.0", *head], []
    order = ">" if kind == "binary_big_endian" else "<"
    for name, properties, rows in elements:
        lines += [f"element {name} {len(rows)}", *(f"property {p}" for p in properties)]
        body += [_plyRow(row, properties, kind == "ascii", order) for row in rows]
    return (end.join([*lines, "end_header"]) + end).encode() + b"".join(body)


def _plyRow(row, properties, asText, order):
    words, packed = [], b""
    for value, words_ in zip(row, (p.split() for p in properties)):
        values = [len(value), *value] if words_[0] == "list" else [value]
        kinds = [words_[1], *[words_[2]] * len(value)] if words_[0] == "list" else [words_[0]]
        words += [f"{v:.17g}" for v in values]
        packed += b"".join(np.array(v).astype(order + TYPES[k]).tobytes() for v, k in zip(values, kinds))
    return (" ".join(words) + "\n").encode() if asText else packed


XYZ = ["double x", "double y", "double z"]
INDICES = "list uchar int vertex_indices"


def simplePLY(kind, x, t, vertexProperties=XYZ, faceProperties=(INDICES,), more=lambda i: (), beyond=lambda i: ()):
    vertices = [(*row, *more(i)) for i, row in enumerate(x.tolist())]
    return ply(
        kind,
        [
            ("vertex", list(vertexProperties), vertices),
            ("face", list(faceProperties), [(f, *beyond(i)) for i, f in enumerate(t.tolist())]),
        ],
    )


def propertiesBeforeCoordinates(kind, x, t):
    vertices = [(i % 100, [1, 2], *row) for i, row in enumerate(x.tolist())]
    faces = [(i % 100, f) for i, f in enumerate(t.tolist())]
    return ply(
        kind,
        [
            ("vertex", ["uchar quality", "list uchar short near", *XYZ], vertices),
            ("face", ["uchar quality", INDICES], faces),
        ],
    )


def otherElements(kind, x, t):
    return ply(
        kind,
        [
            ("camera", ["float view_px", "list uchar float m"], [(1.5, [1.0, 2.0, 3.0])]),
            ("vertex", XYZ, x.tolist()),
            ("edge", ["int vertex1", "int vertex2"], [(0, 1), (1, 2)]),
            ("face", [INDICES], [(f,) for f in t.tolist()]),
            ("material", ["list uchar uchar name"], [([97, 98],), ([99],)]),
        ],
        head=("comment made for a test", "obj_info made for a test"),
    )


def facesFirst(kind, x, t):
    return ply(kind, [("face", [INDICES], [(f,) for f in t.tolist()]), ("vertex", XYZ, x.tolist())])


def faceColors(kind, x, t):
    properties = [INDICES, "uchar red", "uchar green", "uchar blue", "int flags"]
    return simplePLY(kind, x, t, faceProperties=properties, beyond=lambda i: (255, i % 256, 0, 7))


def textureCoordinates(kind, x, t):
    properties = [INDICES, "list uchar float texcoord"]
    return simplePLY(kind, x, t, faceProperties=properties, beyond=lambda i: ([0.25 * (i % 4)] * 6,))


def vertexColors(kind, x, t):
    colors = ["uchar red", "uchar green", "uchar blue", "uchar alpha"]
    properties = [*XYZ, "float nx", "float ny", "float nz", *colors]
    return simplePLY(kind, x, t, properties, more=lambda i: (0, 0.5, 1, 10, 20, 30, 255))


def vertexIndex(kind, x, t):
    return simplePLY(kind, x, t, faceProperties=["list int uint vertex_index"])


for kind in ("ascii", "binary_little_endian", "binary_big_endian"):
    dialect("ply", kind)(partial(simplePLY, kind))
    dialect("ply", f"{kind}, vertex_index")(partial(vertexIndex, kind))
    dialect("ply", f"{kind}, colors and flags of faces")(partial(faceColors, kind))
    dialect("ply", f"{kind}, texture coordinates of faces")(partial(textureCoordinates, kind))
    dialect("ply", f"{kind}, normals and colors of vertices")(partial(vertexColors, kind))
    dialect("ply", f"{kind}, properties before the coordinates")(partial(propertiesBeforeCoordinates, kind))
    dialect("ply", f"{kind}, other elements before, between and after")(partial(otherElements, kind))
    dialect("ply", f"{kind}, faces before vertices")(partial(facesFirst, kind))


@dialect("ply", "ascii, lines of Windows")
def _(x, t):
    return simplePLY("ascii", x, t).replace(b"\n", b"\r\n")


@dialect("ply", "binary, header with lines of Windows")
def _(x, t):
    return ply(
        "binary_little_endian",
        [("vertex", XYZ, x.tolist()), ("face", [INDICES], [(f,) for f in t.tolist()])],
        end="\r\n",
    )


# --- OBJ


def obj(x, t, corner=lambda i, f, c: f"{i + 1}", head=(), vertex=lambda row: f"v {numbers(row)}", tail=()):
    faces = ["f " + " ".join(corner(i, f, c) for c, i in enumerate(row)) for f, row in enumerate(t.tolist())]
    return text(*head, *map(vertex, x), *faces, *tail)


dialect("obj", "plain")(obj)


@dialect("obj", "UTF-16")
def _(x, t):
    return obj(x, t).decode().encode("utf-16")


@dialect("obj", "texture coordinates and normals")
def _(x, t):
    head = ["# exported", "mtllib a.mtl", "o cell"]
    more = [f"vt {i / 99} 0.5" for i in range(50)] + [f"vn 0 0 {i / 99}" for i in range(40)]
    return obj(x, t, lambda i, f, c: f"{i + 1}/{(7 * f + c) % 50 + 1}/{(5 * f + c) % 40 + 1}", head + more)


@dialect("obj", "normals")
def _(x, t):
    return obj(x, t, lambda i, f, c: f"{i + 1}//{f % 9 + 1}", [f"vn 0 0 {i}" for i in range(9)])


@dialect("obj", "texture coordinates")
def _(x, t):
    return obj(x, t, lambda i, f, c: f"{i + 1}/{f % 9 + 1}", [f"vt 0 {i}" for i in range(9)])


@dialect("obj", "negative indices")
def _(x, t):
    return obj(x, t, lambda i, f, c: f"{i - len(x)}")


@dialect("obj", "negative indices with normals")
def _(x, t):
    return obj(x, t, lambda i, f, c: f"{i - len(x)}//{-1 - c}", ["vn 0 0 1", "vn 0 1 0", "vn 1 0 0"])


@dialect("obj", "negative indices between the vertices")
def _(x, t):
    lines, seen = [], []
    for row in t.tolist():
        for i in row:
            if i not in seen:
                seen.append(i)
                lines.append(f"v {numbers(x[i])}")
        lines.append("f " + " ".join(str(seen.index(i) - len(seen)) for i in row))
    return text(*lines)


@dialect("obj", "colors of vertices")
def _(x, t):
    return obj(x, t, vertex=lambda row: f"v {numbers(row)} 0.5 0.25 1")


@dialect("obj", "weights of vertices")
def _(x, t):
    return obj(x, t, vertex=lambda row: f"v {numbers(row)} 1.0")


@dialect("obj", "colors of some vertices")
def _(x, t):
    return obj(x, t, vertex=lambda row: f"v {numbers(row)}" + (" 1 0 0" if row[0] > 0 else ""))


@dialect("obj", "objects, groups and materials")
def _(x, t):
    lines = text("mtllib a.mtl", *(f"v {numbers(row)}" for row in x)).decode()
    for f, row in enumerate(t.tolist()):
        if f % 3 == 0:
            lines += f"o part{f}\ng group{f}\nusemtl m{f % 2}\ns off\n"
        lines += "f " + " ".join(str(i + 1) for i in row) + "\n"
    return lines.encode()


@dialect("obj", "vertices of each object after its faces' predecessors")
def _(x, t):
    half = len(t) // 2
    used = np.unique(t[:half])
    rest = np.setdiff1d(np.arange(len(x)), used)
    place = np.empty(len(x), dtype=int)
    place[np.concatenate((used, rest))] = np.arange(len(x))
    return obj(x[used], place[t[:half]]) + obj(x[rest], place[t[half:]])


@dialect("obj", "tabs, comments, lines that continue, lines of Windows")
def _(x, t):
    content = obj(x, t, head=["# a comment", "", "g"]).decode()
    return content.replace("\nf ", "\nf\t").replace("\n", " # end\r\n", 3).replace(" 1\n", " \\\n1\n").encode()


@dialect("obj", "points and lines")
def _(x, t):
    return obj(x, t, tail=["p 1", "l 1 2 3"])


# --- OFF


def off(x, t, head=("OFF",), counts=None, vertex=lambda row: "", face=lambda f: ""):
    counts = f"{len(x)} {len(t)} 0" if counts is None else counts.format(len(x), len(t))
    first = [head[0] + counts] if head[0].endswith(" ") else [*head, counts]
    rows = [numbers(row) + vertex(row) for row in x]
    return text(*first, *rows, *(f"3 {a} {b} {c}{face(f)}" for f, (a, b, c) in enumerate(t.tolist())))


dialect("off", "plain")(off)


@dialect("off", "counts on the first line")
def _(x, t):
    return off(x, t, head=("OFF ",))


@dialect("off", "counts right behind the word")
def _(x, t):
    return off(x, t).replace(b"OFF\n", b"OFF", 1)


@dialect("off", "the word in small letters")
def _(x, t):
    return off(x, t, head=("off",))


@dialect("off", "without the number of edges")
def _(x, t):
    return off(x, t, counts="{} {}")


@dialect("off", "without the word OFF")
def _(x, t):
    return off(x, t).split(b"\n", 1)[1]


@dialect("off", "comments and empty lines")
def _(x, t):
    content = off(x, t, head=("OFF # a comment", "# made by OFFICE", "")).decode().split("\n")
    return text("# a comment", *(f"{line}  # {i}\n" if i % 3 == 1 else line for i, line in enumerate(content)))


@dialect("off", "colors of faces")
def _(x, t):
    return off(x, t, face=lambda f: [" 255 0 0", " 0.5 0.5 0.5 1.0", " 3", ""][f % 4])


def offWithColumns(head, columns, x, t):
    return off(x, t, head=(head,), vertex=lambda row: columns * " 0.5")


for head, columns in {"COFF": 4, "NOFF": 3, "STOFF": 2, "CNOFF": 7, "STCNOFF": 9}.items():
    dialect("off", head)(partial(offWithColumns, head, columns))


@dialect("off", "tabs and lines of Windows")
def _(x, t):
    return off(x, t).replace(b" ", b"\t").replace(b"\n", b"\r\n")


# --- glTF


def gltf(x, t, binary, translation=(0.0, 0.0, 0.0)):
    """Write a glTF file: single precision, a node with a translation."""
    points, corners = np.ascontiguousarray(x - np.array(translation), dtype="<f4"), np.ascontiguousarray(t, dtype="<u4")
    data = points.tobytes() + corners.tobytes()
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": list(translation)}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": points.nbytes},
            {"buffer": 0, "byteOffset": points.nbytes, "byteLength": corners.nbytes},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": len(x),
                "type": "VEC3",
                "min": points.min(axis=0).tolist(),
                "max": points.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5125, "count": corners.size, "type": "SCALAR"},
        ],
    }
    if not binary:
        tree["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        return json.dumps(tree).encode()
    head = json.dumps(tree).encode()
    head += b" " * (-len(head) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(head), 0x4E4F534A) + head + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


dialect("gltf", "data in the file")(lambda x, t: gltf(x, t, False))
dialect("glb", "binary")(lambda x, t: gltf(x, t, True))


# --- FreeDTS


@dialect("tsi", "1.1")
def _(x, t):
    rows = [f"{i:5d}{a:25.17g}{b:25.17g}{c:25.17g}" for i, (a, b, c) in enumerate(x)]
    faces = [f"{f:5d} {a:5d} {b:5d} {c:5d}" for f, (a, b, c) in enumerate(t)]
    return text("version 1.1", "box   5e4   5e4   5e4", f"vertex {len(x)}", *rows, f"triangle {len(t)}", *faces)


@dialect("tsi", "domains, inclusions and exclusions")
def _(x, t):
    rows = [f"{i} {numbers(row)} {i % 2}" for i, row in enumerate(x)]
    faces = [f"{f} {a} {b} {c} 0" for f, (a, b, c) in enumerate(t)]
    more = ["inclusion 1", "0 1 0 0 1", "exclusion 1", "0 1 0.5"]
    return text("version 1.1", "box 5e4 5e4 5e4", f"vertex {len(x)}", *rows, f"triangle {len(t)}", *faces, *more)


@dialect("tsi", "vector fields")
def _(x, t):
    rows = [f"{i} {numbers(row)}" for i, row in enumerate(x)]
    faces = [f"{f} {a} {b} {c}" for f, (a, b, c) in enumerate(t)]
    fields = ["vector_fields 2", *["1 1 0 2 0 1"] * len(x), "inclusion 0"]
    return text("version 1.1", "box 5e4 5e4 5e4", f"vertex {len(x)}", *rows, f"triangle {len(t)}", *faces, *fields)


@dialect("q", "plain")
def _(x, t):
    rows = [f"{i} {numbers(row)} 0" for i, row in enumerate(x)]
    return text(
        "5e4 5e4 5e4", str(len(x)), *rows, str(len(t)), *(f"{f} {a} {b} {c} 0" for f, (a, b, c) in enumerate(t))
    )


# --- TriMem


def checkpoint(**data):
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        for name, values in data.items():
            file.create_dataset(name, data=values, compression="gzip")
    return out.getvalue()


@dialect("h5", "checkpoint")
def _(x, t):
    return checkpoint(points=np.asarray(x, dtype=np.float64), cells=np.asarray(t, dtype=np.int32))


# --- VTK


def polyData(x, t, others=False):
    import pyvista

    faces = np.column_stack((np.full(len(t), 3), t)).ravel()
    more = {"lines": [2, 0, 1], "verts": [1, 0]} if others else {}
    data = pyvista.PolyData(x.astype(float), faces=faces, **more)
    data.point_data["curvature"] = x[:, 0]
    data.cell_data["color"] = np.arange(data.n_cells)
    return data


def grid(x, t, others=False):
    import pyvista

    cells, kinds = np.column_stack((np.full(len(t), 3), t)).ravel(), np.full(len(t), 5)
    if others:
        cells, kinds = np.concatenate(([1, 0, 2, 0, 1], cells)), np.concatenate(([1, 3], kinds))
    data = pyvista.UnstructuredGrid(cells, kinds.astype(np.uint8), x.astype(float))
    data.point_data["curvature"] = x[:, 0]
    return data


def byVTK(make, suffix, settings, x, t, others=False):
    """Return what VTK's writer makes of a mesh, with its settings."""
    from vtkmodules import vtkIOLegacy, vtkIOXML

    kind = "PolyData" if make is polyData else "UnstructuredGrid"
    writer = getattr(vtkIOLegacy if suffix == "vtk" else vtkIOXML, f"vtk{'XML' * (suffix != 'vtk')}{kind}Writer")()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"a.{suffix}"
        writer.SetFileName(str(file))
        writer.SetInputData(make(x, t, others))
        for name, value in settings.items():
            getattr(writer, f"Set{name}")(value)
        assert writer.Write() == 1
        return file.read_bytes()


for make, suffix in ((polyData, "vtp"), (grid, "vtu")):
    for fileType, word in enumerate(("text", "binary"), start=1):
        for version in (42, 51):
            found = {"FileType": fileType, "FileVersion": version}
            dialect("vtk", f"{make.__name__} {word} {version / 10}")(partial(byVTK, make, "vtk", found))
    dialect("vtk", f"{make.__name__} with points and lines")(partial(byVTK, make, "vtk", {}, others=True))
    dialect(suffix, "with points and lines")(partial(byVTK, make, suffix, {}, others=True))
    for mode, order, compressor in ((0, 1, 0), (0, 0, 0), (1, 1, 1), (1, 0, 2), (2, 1, 3), (2, 0, 0), (2, 1, 2)):
        words = ("text", "binary", "appended")[mode], ("big", "little")[order]
        found = {"DataMode": mode, "ByteOrder": order, "CompressorType": compressor}
        name = f"{words[0]}, {words[1]} endian, compressor {('none', 'zlib', 'lz4', 'lzma')[compressor]}"
        dialect(suffix, name)(partial(byVTK, make, suffix, found))
    raw = {"DataMode": 2, "EncodeAppendedData": 0, "HeaderType": 64, "CompressorType": 0}
    dialect(suffix, "appended raw, 64-bit heads")(partial(byVTK, make, suffix, raw))


def ownVTU(x, t, head=""):
    """A VTU file of several pieces, written by hand."""
    pieces = []
    for part in (t[: len(t) // 2], t[len(t) // 2 :]):
        offsets = numbers(3 * np.arange(1, len(part) + 1))
        pieces.append(
            f'<Piece NumberOfPoints="{len(x)}" NumberOfCells="{len(part)}"><Points>'
            f'<DataArray type="Float64" NumberOfComponents="3" format="ascii">{numbers(x.ravel())}</DataArray></Points>'
            f'<Cells><DataArray type="Int64" Name="connectivity" format="ascii">{numbers(part.ravel())}</DataArray>'
            f'<DataArray type="Int64" Name="offsets" format="ascii">{offsets}</DataArray>'
            f'<DataArray type="UInt8" Name="types" format="ascii">{numbers(np.full(len(part), 5))}</DataArray></Cells>'
            "</Piece>"
        )
    return text(
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">',
        head,
        "<UnstructuredGrid>",
        *pieces,
        "</UnstructuredGrid></VTKFile>",
    )


dialect("vtu", "several pieces")(ownVTU)
dialect("vtu", "sections of its own")(lambda x, t: ownVTU(x, t, "<programversion>1</programversion>"))


# --- GMSH


def gmsh(fileFormat, binary, others, x, t):
    import meshio

    cells = [("vertex", [[0]]), ("line", [[0, 1]])] if others else []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.msh"
        mesh = meshio.Mesh(x, [*cells, ("triangle", t)])
        if fileFormat == "gmsh22":
            mesh.cell_data = {f"gmsh:{key}": [np.ones(len(c.data), int) for c in mesh.cells] for key in TAGS}
        meshio.write(file, mesh, file_format=fileFormat, binary=binary)
        return file.read_bytes()


TAGS = ("physical", "geometrical")
for binary, word in enumerate(("text", "binary")):
    dialect("msh", f"2.2 {word}")(partial(gmsh, "gmsh22", bool(binary), False))
    dialect("msh", f"2.2 {word} with points and lines")(partial(gmsh, "gmsh22", bool(binary), True))
    dialect("msh", f"4.1 {word}")(partial(gmsh, "gmsh", bool(binary), False))
