"""Sections of minimum shapes beside the outlines of axisymmetric ones."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..analysis.convergence import DiscreteMinimum
from ..files import PathLike
from ..geometry.mesh import Mesh
from .plots import ownStyle, saveFigure


@ownStyle()
def plotSections(minima: Sequence[DiscreteMinimum], file: PathLike, columns: int = 7) -> None:
    """Draw the sections of minimum shapes in a plane through the axis, over the outlines of the axisymmetric ones.

    Parameters
    ----------
    minima : sequence of DiscreteMinimum
        what to draw
    file : path
        the picture to write; its suffix tells the format
    columns : int
        how many to draw side by side
    """
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    rows = math.ceil(len(minima) / columns)
    figure = Figure(figsize=(1.9 * min(columns, len(minima)), 2.5 * rows), layout="constrained")
    for axes in (grid := figure.subplots(rows, min(columns, len(minima)), squeeze=False).ravel()):
        axes.set_axis_off()
    for axes, minimum in zip(grid, minima):
        r, z = minimum.continuum.outline.T
        z = z - (z.max() + z.min()) / 2
        axes.plot(np.concatenate((r, -r[::-1])), np.concatenate((z, z[::-1])), color="C1", lw=2.5, alpha=0.6)
        section = _section(minimum.mesh)
        section[..., 1] -= (section[..., 1].max() + section[..., 1].min()) / 2
        axes.add_collection(LineCollection(list(section), color="black", lw=0.7))
        axes.set(aspect="equal", xlim=(-1.6, 1.6), ylim=(-3, 3) if minimum.branch == "prolate" else (-1.6, 1.6))
        axes.set_title(
            f"{minimum.branch}, v = {minimum.reducedVolume:g}\nE/8πκ = {minimum.energy:.3f} "
            f"({minimum.energyError:+.1%})",
            fontsize="small",
        )
    saveFigure(figure, file)


def _section(mesh: Mesh) -> NDArray[np.float64]:
    """Return the lines in which the plane y = 0 cuts triangles, as pairs of points (x, z)."""
    x = mesh.vertices - mesh.vertices.mean(axis=0)
    corners = x[mesh.triangles]
    corners = corners[np.ptp(np.sign(corners[..., 1]), axis=1) > 0]
    following = np.roll(corners, -1, axis=1)
    cut = corners[..., 1] * following[..., 1] < 0
    part = (corners[..., 1] / np.where(cut, corners[..., 1] - following[..., 1], 1))[..., np.newaxis]
    points, two = (corners + part * (following - corners))[..., [0, 2]], cut.sum(axis=1) == 2
    return points[two][cut[two]].reshape(-1, 2, 2)
