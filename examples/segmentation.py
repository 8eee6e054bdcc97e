#!/usr/bin/env python3
"""From a segmentation to a simulation: marching cubes, repair, remesh, run, and a picture of each step.

    python examples/segmentation.py [--voxels labels.npy] [--voxel-size 1.5] [--vertices 1500] [--steps 2000]

Without a file it makes a segmentation as a tomogram gives one: a vesicle of 120 nm that is not quite round, in voxels
of 1.5 nm, with specks around it.  A file holds a three-dimensional array, which is not 0 inside of the vesicle.
Takes openmm-helfrich[looking,remesh].
"""

import argparse
from pathlib import Path

import numpy as np
import pyvista
from PIL import Image
from scipy.ndimage import gaussian_filter

import openmmhelfrich as mh

SMOOTHING = 1.5  # in voxels


def exampleLabels(voxelSize: float) -> np.ndarray:
    """Return voxels that are 1 inside of a vesicle, and some specks."""
    random = np.random.default_rng(1)
    axis = np.arange(-75, 75, voxelSize)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    radius = np.sqrt(x**2 + y**2 + z**2) + 1e-9
    bumps = 1 + 0.12 * (z / radius) ** 2 - 0.10 * (x / radius) * (y / radius) + 0.06 * (y / radius) ** 3
    labels = (radius < 50 * bumps).astype(np.uint8)
    for i, j, k in random.integers(0, len(axis) - 5, (40, 3)):
        if radius[i, j, k] > 72:
            labels[i : i + 5, j : j + 5, k : k + 5] = 1
    return labels


def surfaceOf(labels: np.ndarray, voxelSize: float, file: Path) -> None:
    """Write the surface of the voxels that are not 0, by marching cubes.

    It would have the voxels' steps, and a tenth more area than the vesicle, if the labels were not smoothed first.
    """
    smooth = gaussian_filter((labels != 0).astype(np.float32), SMOOTHING)
    image = pyvista.ImageData(dimensions=labels.shape, spacing=3 * (voxelSize,))
    image.point_data["label"] = smooth.ravel(order="F")
    image.contour([0.5], scalars="label", method="marching_cubes", compute_normals=False).save(file)


def simulate(file: Path, prefix: Path, steps: int, **membrane: float) -> mh.Mesh:
    """Run a mesh, print what came of it, with the verdict, and return the mesh at the end."""
    summary = mh.run(
        {
            "mesh": {"file": str(file)},
            "membrane": membrane,
            "sampling": {"steps": steps, "step_size": "auto", "seed": 1},
            "output": {"prefix": str(prefix), "trajectory_interval": 100, "overwrite": True},
        }
    )
    print(*(f"{label}: {text}" for label, text in summary.lines()), sep="\n")
    return mh.Mesh.read(summary.outputs.mesh)


def picture(meshes: dict[str, mh.Mesh], file: Path) -> None:
    """Draw meshes beside each other, with their edges, in few colors, which makes a small file."""
    plotter = pyvista.Plotter(shape=(1, len(meshes)), off_screen=True, window_size=[380 * len(meshes), 400])
    for place, (title, mesh) in enumerate(meshes.items()):
        plotter.subplot(0, place)
        faces = np.column_stack((np.full(len(mesh.triangles), 3), mesh.triangles))
        surface = pyvista.PolyData(mesh.vertices, faces.ravel())
        isFine = len(mesh.vertices) > 5000
        plotter.add_mesh(surface, color="#d8b070", show_edges=True, edge_opacity=0.2 if isFine else 1.0, line_width=0.5)
        plotter.add_text(f"{title}\n{len(mesh.vertices)} vertices", font_size=9, color="black")
        plotter.camera_position = "yz"
        plotter.camera.zoom(1.2)
    image = Image.fromarray(np.asarray(plotter.screenshot(return_img=True)))
    image.quantize(32, dither=Image.Dither.NONE).save(file, optimize=True)


def main() -> None:
    """Do all steps and say what each did."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--voxels", type=Path)
    parser.add_argument("--voxel-size", type=float, default=1.5, help="in nm")
    parser.add_argument("--vertices", type=int, default=1500)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--output", type=Path, default=Path("segmentation"), help="a folder")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    labels = np.load(options.voxels) if options.voxels else exampleLabels(options.voxel_size)
    raw, even = options.output / "raw.ply", options.output / "even.ply"
    surfaceOf(labels, options.voxel_size, raw)
    found = mh.Mesh.read(raw)
    mended = found.repaired()
    print(*mended.notes, sep="\n")
    remeshed = mended.remeshed(numVertices=options.vertices)
    print(*remeshed.notes[len(mended.notes) :], sep="\n")
    remeshed.write(even)
    final = simulate(even, options.output / "cell", options.steps)
    shown = {"marching cubes": found, "remeshed": remeshed, f"after {options.steps} steps": final}
    picture(shown, options.output / "segmentation.png")


if __name__ == "__main__":
    main()
