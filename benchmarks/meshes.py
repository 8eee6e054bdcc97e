#!/usr/bin/env python3
"""Time reading meshes of every format and repairing them; which libraries read which dialects.

    python benchmarks/meshes.py [--triangles N ...] [--repeat 3]
    python benchmarks/meshes.py --libraries [--formats stl ply ...]

With --libraries, each dialect of tests/meshdialects.py is read by trimesh, meshio, VTK and this package, each in a
process of its own, since some crash; the rest is time.  Takes openmm-helfrich[looking].
"""

import argparse
import contextlib
import io
import os
import statistics
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

import openmmhelfrich as mh

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
SUFFIXES = ["stl", "ply", "obj", "off", "vtu", "vtk", "msh", "tsi", "q"]


def byTrimesh(file):
    import trimesh

    mesh = trimesh.load_scene(file, process=False, maintain_order=True).to_mesh()
    return mesh.vertices, mesh.faces


def byMeshio(file):
    import meshio

    mesh = meshio.read(file)
    return mesh.points, np.concatenate([block.data for block in mesh.cells if block.type == "triangle"])


def byVTK(file):
    import pyvista

    data = pyvista.read(file)
    data = data.combine() if isinstance(data, pyvista.MultiBlock) else data
    data = data if isinstance(data, pyvista.PolyData) else data.extract_surface(algorithm=None)
    surface = data.triangulate()
    return surface.points, surface.faces.reshape(-1, 4)[:, 1:]


def byThisPackage(file):
    mesh = mh.Mesh.read(file)
    return mesh.vertices, mesh.triangles


READERS = {"trimesh": byTrimesh, "meshio": byMeshio, "VTK": byVTK, "this package": byThisPackage}


def facets(vertices, triangles):
    """Return the corners of all triangles, each from its least corner on, sorted."""
    corners = np.round(np.asarray(vertices, dtype=np.float64)[triangles], 6).tolist()
    return sorted(c[i:] + c[:i] for c in corners for i in [c.index(min(c))])


def verdict(reader, file, mesh):
    """Return "right", "apart" (the same triangles, but some vertices divided), "wrong", "error" or "crash"."""
    end, start = os.pipe()
    child = os.fork()
    if child == 0:
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        os.write(start, _verdict(reader, file, mesh).encode())
        os._exit(0)
    os.close(start)
    word = os.read(end, 100).decode() or "crash"
    os.waitpid(child, 0)
    os.close(end)
    return word


def _verdict(reader, file, mesh):
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            vertices, triangles = reader(str(file))
        if facets(vertices, triangles) != facets(mesh.vertices, mesh.triangles):
            return "wrong"
        return "right" if len(vertices) == len(mesh.vertices) or file.suffix == ".stl" else "apart"
    except BaseException:
        return "error"


def compareLibraries(formats):
    """Print how many dialects of each format each library reads, and what becomes of the others."""
    from meshdialects import DIALECTS

    sphere = mh.Mesh.icosphere(1)
    mesh = mh.Mesh(np.round(sphere.vertices * [1, 1.25, 0.75] * 64) / 64 + [0.5, 0, 0.25], sphere.triangles)
    counts: dict[str, dict[str, Counter]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for suffix, write in DIALECTS.values():
            if formats and suffix not in formats:
                continue
            file = Path(folder) / f"a.{suffix}"
            file.write_bytes(write(mesh.vertices, mesh.triangles))
            for name, reader in READERS.items():
                row = counts.setdefault(suffix, {}).setdefault(name, Counter())
                row[verdict(reader, file, mesh)] += 1
    print(f"| format | dialects | {' | '.join(READERS)} |\n|{'---|' * (2 + len(READERS))}")
    for suffix, row in counts.items():
        total = sum(next(iter(row.values())).values())
        print(f"| {suffix.upper()} | {total} | {' | '.join(_described(row[name], total) for name in READERS)} |")


def _described(words, total):
    others = [f"{count} {word}" for word, count in words.most_common() if word != "right"]
    return "all" if words["right"] == total else ", ".join([f"{words['right']}", *others])


def timed(function, repeat):
    """Return the median of the seconds that a function takes, and its last result."""
    seconds = []
    for _ in range(repeat):
        start = time.perf_counter()
        result = function()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), result


def timeReading(sizes, repeat):
    """Print the seconds to read files of each format, and to repair what has faults."""
    print(f"| triangles | {' | '.join(s.upper() for s in SUFFIXES)} | repair: sound | repair: corners apart |")
    print(f"|{'---|' * (3 + len(SUFFIXES))}")
    for wanted in sizes:
        subdivisions = round(np.log(wanted / 20) / np.log(4))
        mesh, row = mh.Mesh.icosphere(subdivisions), []
        with tempfile.TemporaryDirectory() as folder:
            for suffix in SUFFIXES:
                file = Path(folder) / f"a.{suffix}"
                mesh.write(file)
                row.append(timed(lambda file=file: mh.Mesh.read(file), repeat)[0])
        loose = mh.Mesh(mesh.vertices[mesh.triangles].reshape(-1, 3), np.arange(mesh.triangles.size).reshape(-1, 3))
        row += [timed(mesh.repaired, repeat)[0], timed(loose.repaired, repeat)[0]]
        print(f"| {len(mesh.triangles):,} | {' | '.join(f'{seconds:.2f}' for seconds in row)} |", flush=True)


def main() -> None:
    """Print what is asked for as tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--libraries", action="store_true", help="compare libraries instead")
    parser.add_argument("--formats", nargs="+", help="that libraries read, as suffixes; by default all")
    parser.add_argument("--triangles", type=int, nargs="+", default=[20480, 81920, 327680, 1310720])
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    if options.libraries:
        compareLibraries(options.formats)
    else:
        timeReading(options.triangles, options.repeat)


if __name__ == "__main__":
    main()
