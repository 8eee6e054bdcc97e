#!/usr/bin/env python3
"""From Blender to a simulation: a mesh as Blender exports it, made even, run, and a picture of each step.

    python examples/blender.py [--file sphere.obj] [--vertices 642] [--steps 2000]

Without a file it writes Blender's default sphere (Add, Mesh, UV Sphere) as Blender does: faces of four corners, with
normals and texture coordinates.  Takes openmm-helfrich[looking,remesh].
"""

import argparse
from pathlib import Path

import numpy as np
from segmentation import picture, simulate

import openmmhelfrich as mh

SEGMENTS, RINGS = 32, 16


def writeSphere(file: Path) -> None:
    """Write a sphere by degrees of longitude and latitude, of quads, and of triangles at its poles."""
    polar = np.pi * np.arange(1, RINGS) / RINGS
    around = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    theta, phi = (grid.ravel() for grid in np.meshgrid(polar, around, indexing="ij"))
    rings = np.column_stack((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)))
    north, south = len(rings) + 1, len(rings) + 2
    faces: list[tuple[int, ...]] = []
    for a in range(SEGMENTS):
        b = (a + 1) % SEGMENTS
        faces.append((north, a + 1, b + 1))
        for first in range(1, len(rings) - SEGMENTS + 1, SEGMENTS):
            faces.append((first + a, first + SEGMENTS + a, first + SEGMENTS + b, first + b))
        last = len(rings) - SEGMENTS + 1
        faces.append((last + b, last + a, south))
    lines = ["# Blender", "o Sphere"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in [*rings, (0, 0, 1), (0, 0, -1)]]
    lines += ["vn 0.0000 0.0000 1.0000", "vt 0.500000 0.500000", "s 1"]
    lines += ["f " + " ".join(f"{i}/1/1" for i in face) for face in faces]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Do all steps and say what each did."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--file", type=Path, help="what Blender exported")
    parser.add_argument("--vertices", type=int, default=642)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--output", type=Path, default=Path("blender"), help="a folder")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    file = options.file or options.output / "sphere.obj"
    if options.file is None:
        writeSphere(file)
    found = mh.Mesh.read(file)
    even = found.remeshed(numVertices=options.vertices)
    print(*even.notes, sep="\n")
    even.write(options.output / "sphere_even.ply")
    final = simulate(options.output / "sphere_even.ply", options.output / "sphere", options.steps, reduced_volume=0.9)
    shown = {"as Blender has it": found, "remeshed": even, f"after {options.steps} steps": final}
    picture(shown, options.output / "blender.png")


if __name__ == "__main__":
    main()
