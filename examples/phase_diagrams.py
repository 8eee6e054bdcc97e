"""Plots and pictures of the two phase diagrams, from the results of their sweeps.

    python phase_diagrams.py volume results/volume                     # volume_energies.png, volume_shapes.png
    python phase_diagrams.py area-difference results/area_difference   # area_difference_shapes.png

Pictures are named after the folder.  Prints energies, those of the branches beside those of axisymmetric shapes, and
where they cross.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas
from matplotlib.figure import Figure
from matplotlib.image import imread
from scipy.interpolate import PchipInterpolator

import openmmhelfrich as mh
from openmmhelfrich.pictures.look import Look
from openmmhelfrich.pictures.rendering import render

BRANCHES = {"prolate": "C0", "oblate": "C1", "stomatocyte": "C2"}
ENERGY = "E_bending/8 pi kappa"
# Energy over 8 pi kappa of axisymmetric shapes by reduced volume, from tests/data/axisymmetric_minima.csv.
REFERENCE = {
    "prolate": {0.9: 1.18964, 0.8: 1.38744, 0.7: 1.64327, 0.65: 1.82793, 0.6: 2.06029, 0.55: 2.35678, 0.5: 2.74739},
    "oblate": {0.9: 1.21786, 0.8: 1.45254, 0.7: 1.69911, 0.65: 1.82623, 0.6: 1.95568, 0.55: 2.08730, 0.5: 2.22093},
    "stomatocyte": {0.6: 1.97753, 0.55: 1.98454, 0.5: 1.98983},
}
CROSSINGS = {("stomatocyte", "oblate"): 0.591, ("oblate", "prolate"): 0.651}


def curve(points):
    """Return an interpolation of energies, by reduced volume."""
    points = points.sort_values("reducedVolume").drop_duplicates("reducedVolume")
    return PchipInterpolator(points.reducedVolume, points[ENERGY], extrapolate=False)


def branchOf(table, name):
    """Return the points that were led along a branch and are on it at the end, at the volume that they were to have."""
    isOnIt = (table.variant == name) & (table.shapeClass == name) & (table.verdict != "failed")
    return table[isOnIt & (abs(table.reducedVolume - table.reduced_volume) < 0.01)]


def compareBranches(table):
    for name, reference in REFERENCE.items():
        points, exact = branchOf(table, name), PchipInterpolator(*zip(*sorted(reference.items())), extrapolate=False)
        low, high = min(reference) - 0.002, max(reference) + 0.002  # volumes are not quite those that were asked for
        print(
            f"{name}: found from v = {points.reducedVolume.min():.3f} to {points.reducedVolume.max():.3f}\n  v       "
            "E/8 pi kappa   reference   error   delta a"
        )
        for _, p in points.sort_values("reducedVolume").iterrows():
            e = exact(np.clip(p.reducedVolume, min(reference), max(reference)))
            compared = f"{e:9.4f} {p[ENERGY] / e - 1:+9.2%}" if low < p.reducedVolume < high else ""
            print(f"  {p.reducedVolume:.4f} {p[ENERGY]:12.4f}   {compared:19} {p.reducedAreaDifference:9.3f}")


def printCrossings(table):
    for (low, high), reference in CROSSINGS.items():
        branches = branchOf(table, low), branchOf(table, high)
        if min(map(len, branches)) < 2:
            print(f"{low}/{high}: too few points")
            continue
        one, other, v = curve(branches[0]), curve(branches[1]), np.linspace(0.4, 0.8, 4001)
        difference = one(v) - other(v)
        at = np.flatnonzero(np.diff(np.sign(difference)) > 0)
        print(
            f"{low}/{high}: {', '.join(f'{v[i]:.3f}' for i in at) or 'no crossing'} (axisymmetric shapes: {reference})"
        )


def plotEnergies(table, file):
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for name, color in BRANCHES.items():
        points = branchOf(table, name).sort_values("reducedVolume")
        axes.plot(points.reducedVolume, points[ENERGY], "o-", color=color, ms=4, lw=1, label=name)
        axes.plot(*zip(*REFERENCE[name].items()), "+", color=color, ms=11, mew=1.5)
    annealed = table[(table.variant == "annealed") & (table.verdict != "failed")].sort_values("reducedVolume")
    axes.plot(
        annealed.reducedVolume, annealed[ENERGY], "s", mfc="none", color="black", ms=8, label="annealed from a sphere"
    )
    failed = table[table.verdict == "failed"]
    if len(failed):
        axes.plot(failed.reducedVolume, failed[ENERGY], "x", color="0.6", ms=7, label="failed")
    axes.plot([], [], "+", color="0.3", ms=11, mew=1.5, label="axisymmetric shapes")
    for v in CROSSINGS.values():
        axes.axvline(v, color="0.7", lw=1, zorder=0)
    axes.set(xlabel="reduced volume", ylabel="bending energy / 8πκ", ylim=(0.95, 2.9))
    axes.legend()
    figure.savefig(file, dpi=120)


def onAxes(mesh):
    """Return a mesh whose longest axis is x and whose shortest is z."""
    _, axes = np.linalg.eigh(mh.analysis.gyrationTensor(mesh))
    x, y = axes[:, 2], axes[:, 1]
    return mh.Mesh(mesh.vertices @ np.column_stack((x, y, np.cross(x, y))), mesh.triangles)


def picture(folder, row):
    """Return the image of a point's shape, from above if it is flat or long, and cut open if it is a stomatocyte."""
    mesh = onAxes(mh.Mesh.read(folder / row.folder / "run.ply"))
    isStomatocyte = row.shapeClass == "stomatocyte"
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "shape.png"
        look = Look(elevation=0 if isStomatocyte else 60, azimuth=-90, cut=isStomatocyte)
        render([mh.meshFrame(0, mesh)], file, look=look)
        return imread(file)[:640, 110:-110]  # without the scale of colors


def gallery(folder, table, rows, columns, title, file):
    """Write pictures in rows and columns by the values of two parameters."""
    rowValues, columnValues = sorted(table[rows].unique()), sorted(table[columns].unique())
    figure = Figure(figsize=(1.7 * len(columnValues), 1.75 * len(rowValues)), layout="constrained")
    panels = figure.subplots(len(rowValues), len(columnValues), squeeze=False)
    for axes in panels.flat:
        axes.set_axis_off()
    for _, row in table.iterrows():
        axes = panels[rowValues.index(row[rows]), columnValues.index(row[columns])]
        axes.imshow(picture(folder, row))
        isFailed = row.verdict == "failed"
        axes.set_title(title(row) + isFailed * ", failed", fontsize="small", color="C3" if isFailed else "black")
    figure.savefig(file, dpi=90)


kind, folder = sys.argv[1], Path(sys.argv[2])
table = pandas.read_csv(folder / "summary.csv")
print(table.status.value_counts().to_string())
table = table[table.steps.notna()]  # those that have come to their end; what failed is drawn as such
if kind == "volume":
    compareBranches(table)
    printCrossings(table)
    plotEnergies(table, f"{folder.name}_energies.png")
    isShown = table.reduced_volume.isin([0.3, 0.45, 0.55, 0.62, 0.7, 0.8, 0.95])
    gallery(
        folder,
        table[isShown] if isShown.any() else table,
        "variant",
        "reduced_volume",
        lambda row: f"{row.variant}, v = {row.reduced_volume}\n{row.shapeClass}, {row[ENERGY]:.3f}",
        f"{folder.name}_shapes.png",
    )
else:
    print(table.pivot(index="target_area_difference", columns="reduced_volume", values=ENERGY).round(3).to_string())
    gallery(
        folder,
        table,
        "reduced_volume",
        "target_area_difference",
        lambda row: f"v = {row.reduced_volume}, Δa = {row.target_area_difference}\nE/8πκ = {row[ENERGY]:.3f}",
        f"{folder.name}_shapes.png",
    )
