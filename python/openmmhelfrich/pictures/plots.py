"""Pictures: the observables of a run against its steps, and a membrane's shape colored by mean curvature."""

import contextlib
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..files import PathLike, replacing
from ..geometry.mesh import Mesh
from ..sampling.observables import PANELS, Observable, curves, isTarget, observablesIn
from ..sampling.targets import totalOf
from ..tables import Table, headOf
from .curvature import shownSurface, simplification

_drawing = threading.RLock()  # matplotlib reads formulas in one thread at a time

# matplotlib is imported where it is used: scripts that draw nothing start faster.  Figures are made without pyplot, so
# that no display is needed.


@contextlib.contextmanager
def ownStyle() -> Iterator[None]:
    """Draw with matplotlib's own settings: those of a user's may ask for programs that are not there, such as LaTeX."""
    import matplotlib

    with _drawing, matplotlib.rc_context():
        matplotlib.rcdefaults()
        yield


@ownStyle()
def plotObservables(table: Table, file: PathLike, lengthUnit: str = "nm", energyUnit: str = "kT") -> None:
    """Plot observables against steps: energies, area, volume and acceptance rates, and the temperature if it changes.

    Parameters
    ----------
    table : Table
        the columns, as :func:`readObservables` returns them
    file : path
        the picture to write; its suffix tells the format
    lengthUnit, energyUnit : str
        names for the axes
    """
    from matplotlib.figure import Figure

    table.requireRows()
    panels = [panel for panel in PANELS if curves(panel, table)]
    titles = {panel.title for panel in panels}
    own = [panel.title for panel in panels if panel.beside not in titles]
    figure = Figure(figsize=(8, 1 + 2 * len(own)), layout="constrained")
    axes = dict(zip(own, figure.subplots(len(own), 1, sharex=True, squeeze=False)[:, 0]))
    axes[own[-1]].set_xlabel("Monte Carlo step")
    for panel in panels:
        shown = curves(panel, table)
        place = axes[panel.title] if panel.title in axes else axes[panel.beside].twinx()
        for observable in shown:
            _plotCurve(place, table, observable, isThin=observable.isTerm or bool(panel.beside))
        isShared = panel.beside or panel.title in {other.beside for other in panels}
        label = headOf(panel.title, _mathUnit(shown[0], lengthUnit, energyUnit))
        place.set_ylabel(label, color=(isShared and shown[0].color) or "black")
        if panel.range:
            place.set_ylim(panel.range)
        place.ticklabel_format(useOffset=False)
        if len(shown) > 1 and not isTarget(shown[1]):
            place.legend(fontsize="small", ncols=3 if len(shown) > 3 else 1)
    saveFigure(figure, file)


def _plotCurve(axes: Any, table: Table, observable: Observable, isThin: bool) -> None:
    steps, values = table["step"], table[observable.name]
    if isTarget(observable):
        axes.plot(steps, values, color="0.5", ls="--", lw=1, zorder=0)
    else:
        axes.plot(
            steps, values, color=observable.color, lw=1 if isThin else None, label=observable.label or observable.title
        )


def _mathUnit(observable: Observable, lengthUnit: str, energyUnit: str) -> str:
    return re.sub(r"\^(\d)", r"$^\1$", _plain(observable.unitIn(lengthUnit, energyUnit)))


def _plain(text: str) -> str:
    """Return a text such that matplotlib finds no formula in it."""
    return text.replace("$", r"\$")


@ownStyle()
def plotPath(windows: Table, file: PathLike, lengthUnit: str = "nm", energyUnit: str = "kT") -> None:
    """Plot the average energy and shape in each window of a continuation against lambda, the ways there and back apart.

    Parameters
    ----------
    windows : Table
        the averages, as :func:`averageWindows` returns them
    file : path
        the picture to write; its suffix tells the format
    lengthUnit, energyUnit : str
        names for the axes
    """
    from matplotlib.figure import Figure

    shown = [observable for observable in observablesIn(windows) if observable.onPath]
    names = list(dict.fromkeys(totalOf(observable.name) for observable in shown))
    figure = Figure(figsize=(8, 1 + 2 * len(names)), layout="constrained")
    for axes, name in zip(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0], names):
        parts = [observable for observable in shown if totalOf(observable.name) == name]
        for stage in np.unique(windows["stage"]) if "stage" in windows else [None]:
            for part in parts:
                _plotBranches(
                    axes,
                    windows if stage is None else windows.where(windows["stage"] == stage),
                    part.name,
                    ("" if stage is None else f"stage {stage:.0f}, ") + (f"{part.label}, " if len(parts) > 1 else ""),
                )
        title = parts[0].title.removesuffix(" of surface 0")
        axes.set_ylabel(headOf(title, _mathUnit(parts[0], lengthUnit, energyUnit)))
        axes.ticklabel_format(useOffset=False)
        if axes.lines:
            axes.legend(fontsize="small")
    axes.set_xlabel("$\\lambda$; bars are standard deviations")
    saveFigure(figure, file)


def _plotBranches(axes: Any, windows: Table, name: str, prefix: str) -> None:
    last = int(np.argmax(windows["lambda"]))
    for part, style, text in ((slice(last + 1), "o-", "there"), (slice(last, None), "s--", "back")):
        if windows["lambda"][part].size > 1:
            axes.errorbar(
                windows["lambda"][part],
                windows[name][part],
                windows[name + "Deviation"][part],
                fmt=style,
                capsize=3,
                label=prefix + text,
            )


@ownStyle()
def drawMesh(mesh: Mesh, file: PathLike, lengthUnit: str = "nm", elevation: float = 30, azimuth: float = -60) -> None:
    """Draw a closed mesh, lit from above the viewer's shoulder and colored by mean curvature, positive where it is
    convex.

    Parameters
    ----------
    mesh : Mesh
        what to draw; of more than 100,000 vertices, a simplified surface is drawn, and the picture says so
    file : path
        the picture to write; its suffix tells the format
    lengthUnit : str
        the name of the unit of length
    elevation, azimuth : float
        direction of view, in degrees
    """
    from matplotlib.colors import LightSource, TwoSlopeNorm
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    surface, curvature = shownSurface(mesh)
    bound = max(np.quantile(np.abs(curvature), 0.99), 1e-12)
    norm = TwoSlopeNorm(0, -bound, bound)
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    colors = _colorMap()(norm(curvature[surface.triangles].mean(axis=1)))
    # Edges of the triangles' own color hide the seams between them.
    axes.add_collection3d(
        Poly3DCollection(
            surface.vertices[surface.triangles],
            facecolors=colors,
            edgecolors=colors,
            linewidths=0.3,
            shade=True,
            lightsource=LightSource(azdeg=120 - azimuth, altdeg=50),
        )
    )
    _frame(axes, mesh.vertices, elevation, azimuth, lengthUnit, simplification(mesh, surface))
    _colorBar(figure, axes, norm, lengthUnit)
    saveFigure(figure, file)


def _colorMap() -> Any:
    from matplotlib import colormaps

    return colormaps["coolwarm"]


def requireMatplotlib() -> None:
    """Raise what importing matplotlib raises: an error that nobody wants to see at the end of a long run."""
    import matplotlib.figure  # noqa: F401


def saveFigure(figure: Any, file: PathLike, dpi: float = 120) -> None:
    """Write a matplotlib Figure to a picture, replacing one that exists in a single step."""
    with _drawing, replacing(file) as part:
        figure.savefig(part, dpi=dpi, format=Path(file).suffix[1:] or "png")


def _frame(
    axes: Any, vertices: np.ndarray, elevation: float, azimuth: float, lengthUnit: str, remark: str | None
) -> None:
    """Show all of the vertices at equal scales, and a remark beside the size."""
    middle, size = (vertices.max(axis=0) + vertices.min(axis=0)) / 2, np.ptp(vertices, axis=0).max()
    for set_limits, center in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle):
        set_limits(center - size / 2, center + size / 2)
    axes.set_box_aspect((1, 1, 1), zoom=1.3)
    axes.view_init(elevation, azimuth)
    axes.set_axis_off()
    title = ", ".join(filter(None, (f"{size:.3g} {_plain(lengthUnit)} across", remark)))
    axes.set_title(title, y=0, fontsize="medium")


def _colorBar(figure: Any, axes: Any, norm: Any, lengthUnit: str) -> None:
    from matplotlib.cm import ScalarMappable

    figure.colorbar(
        ScalarMappable(norm, _colorMap()), ax=axes, shrink=0.6, label=f"mean curvature (1/{_plain(lengthUnit)})"
    )
