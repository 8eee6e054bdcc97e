"""Pictures: the observables of a run against its steps, and a membrane's shape colored by mean curvature."""

import contextlib
import io
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..files import PathLike, replacingAtOnce
from ..geometry.mesh import Mesh
from ..sampling.observables import (
    MOST_DRAWN,
    PANELS,
    Observable,
    curves,
    isTarget,
    observablesIn,
    onlyMinimizes,
    shownValues,
)
from ..sampling.targets import totalOf
from ..tables import Table, headOf
from .curvature import shownSurface, simplification
from .look import BEAD_COLOR, Look, curvatureLabel, speciesColors, speciesCount, speciesLegend, unitText

# What a run's picture of its final shape is like.
SHAPE = Look(azimuth=-60, size=(960, 660), dpi=120)

_LONG_WAY = 30.0  # a factor by which an energy falls
_MARGIN = 0.05  # of the range of a panel, above and below it

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


class Picture:
    """A figure that a notebook shows, and that :meth:`save` writes.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        what is drawn
    """

    def __init__(self, figure: Any, dpi: float = 120, transparent: bool = False):
        """Create a Picture of a Figure of matplotlib."""
        self.figure, self._dpi, self._transparent = figure, dpi, transparent

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches()
        return f"<Picture of {width:.3g} by {height:.3g} inches; save('FILE.png') writes it>"

    def _repr_png_(self) -> bytes:
        out = io.BytesIO()
        with ownStyle():
            self.figure.savefig(out, dpi=self._dpi, format="png", transparent=self._transparent)
        return out.getvalue()

    def save(self, file: PathLike, dpi: float | None = None) -> None:
        """Write the picture, replacing one that exists in a single step.

        Parameters
        ----------
        file : path
            the picture to write; its suffix tells the format: .png, .pdf, .svg and what else matplotlib knows
        dpi : float, optional
            pixels an inch, of formats that have pixels; by default as many as it was made for
        """
        requirePlotFormat(file)
        with ownStyle():
            saveFigure(self.figure, file, dpi or self._dpi, self._transparent)


def requirePlotFormat(file: PathLike) -> None:
    """Raise a ValueError unless matplotlib writes files with the suffix of this name."""
    from matplotlib.backend_bases import FigureCanvasBase

    known = sorted(FigureCanvasBase.get_supported_filetypes())
    if Path(file).suffix[1:].lower() not in known:
        raise ValueError(f"{file}: no plot has the suffix '{Path(file).suffix}'; use one of .{', .'.join(known)}")


def plotObservables(
    table: Table,
    file: PathLike,
    lengthUnit: str = "nm",
    energyUnit: str = "kT",
    descent: Table | None = None,
    size: tuple[float, float] | None = None,
    dpi: float = 120,
) -> None:
    """Plot observables against steps: energies, area, volume and acceptance rates, the area difference if it has a
    modulus, and the temperature if it changes.

    Parameters
    ----------
    table : Table
        the columns, as :func:`readObservables` returns them
    file : path
        the picture to write; its suffix tells the format
    lengthUnit, energyUnit : str
        names for the axes
    descent : Table, optional
        the "iteration" and the "energy" after each, if all that the rows are of is the start and the end of a
        minimization: the energy is drawn against iterations, and the start and end of all else
    size : pair of float, optional
        width and height, in inches; by default as high as it takes
    dpi : float
        pixels an inch, of formats that have pixels
    """
    observablesPicture(table, lengthUnit, energyUnit, descent, size).save(file, dpi)


@ownStyle()
def observablesPicture(
    table: Table,
    lengthUnit: str = "nm",
    energyUnit: str = "kT",
    descent: Table | None = None,
    size: tuple[float, float] | None = None,
) -> Picture:
    """Return what :func:`plotObservables` writes."""
    from matplotlib.figure import Figure

    table.requireRows()
    shown = [(panel, observables) for panel in PANELS if (observables := curves(panel, table))]
    figure = Figure(figsize=size or (8, 1 + 2 * len(shown)), layout="constrained")
    rows = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    steps, label = table["step"], "Monte Carlo step"
    if descent is not None:
        steps, label = steps * descent["iteration"][-1], "iteration; dots are the start and the end"
    elif onlyMinimizes(table):
        label = "minimization"
        rows[-1].xaxis.get_major_locator().set_params(integer=True)
    rows[-1].set_xlabel(label)
    for axes, (panel, observables) in zip(rows, shown):
        for observable in observables:
            values = shownValues(panel, observable, table)
            _plotCurve(axes, steps, values, observable, onlyMinimizes(table), descent is None)
        axes.set_ylabel(headOf(panel.title, _unitOf(observables[0], lengthUnit, energyUnit)))
        if panel.range:
            low, high = panel.range
            margin = _MARGIN * (high - low)  # so that no curve lies on the frame
            axes.set_ylim(low - margin, high + margin)
        axes.ticklabel_format(useOffset=False)
        if len(observables) > 1 and not isTarget(observables[1]):
            axes.legend(fontsize="small", ncols=3 if len(observables) > 3 else 1)
    if descent is not None:
        _plotDescent(rows[0], descent)
    return Picture(figure)


def _plotDescent(axes: Any, descent: Table) -> None:
    """Draw the energy of a minimization against iterations; that of a long way down, too, so that its end is seen."""
    energies = np.where(np.abs(descent["energy"]) < MOST_DRAWN, descent["energy"], np.nan)
    axes.plot(descent["iteration"], energies, color="black", lw=1)
    least, greatest = np.nanmin(np.abs(energies)), np.nanmax(np.abs(energies))
    if greatest > _LONG_WAY * least > 0:
        axes.set_yscale("symlog", linthresh=least)


def _plotCurve(
    axes: Any,
    steps: np.ndarray,
    values: np.ndarray,
    observable: Observable,
    isMarked: bool = False,
    isJoined: bool = True,
) -> None:
    if isTarget(observable):
        axes.plot(steps, values, color="0.5", ls="--", lw=1, zorder=0)
        return
    style: dict[str, Any] = {"lw": 1} if observable.isTerm else {}
    isAlone = _isAlone(values)
    if isMarked:
        style |= {"marker": "o", "markersize": 4, "ls": "-" if isJoined else ""}
    elif np.any(isAlone):
        style |= {"marker": ".", "markevery": np.flatnonzero(isAlone)}
    axes.plot(steps, values, color=observable.color, label=observable.label or observable.title, **style)


def _isAlone(values: np.ndarray) -> np.ndarray:
    """Return which values are between others that are not finite, so that no line leads to them."""
    isDrawn = np.pad(np.isfinite(values), 1)
    return isDrawn[1:-1] & ~isDrawn[:-2] & ~isDrawn[2:]


def _unitOf(observable: Observable, lengthUnit: str, energyUnit: str) -> str:
    return _plain(unitText(observable.unitIn(lengthUnit, energyUnit)))


def _plain(text: str) -> str:
    """Return a text such that matplotlib finds no formula in it."""
    return text.replace("$", r"\$")


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
    pathPicture(windows, lengthUnit, energyUnit).save(file)


@ownStyle()
def pathPicture(windows: Table, lengthUnit: str = "nm", energyUnit: str = "kT") -> Picture:
    """Return what :func:`plotPath` writes."""
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
        axes.set_ylabel(headOf(title, _unitOf(parts[0], lengthUnit, energyUnit)))
        axes.ticklabel_format(useOffset=False)
        if axes.lines:
            axes.legend(fontsize="small")
    axes.set_xlabel("$\\lambda$; bars are standard deviations")
    return Picture(figure)


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


def drawMesh(mesh: Mesh, file: PathLike, lengthUnit: str = "nm", look: Look = SHAPE) -> None:
    """Draw a closed mesh and its beads, lit from above the viewer's shoulder and colored by mean curvature, positive
    where it is convex, or by species.

    Parameters
    ----------
    mesh : Mesh
        what to draw; of more than 100,000 vertices, a simplified surface is drawn, and the picture says so
    file : path
        the picture to write; its suffix tells the format
    lengthUnit : str
        the name of the unit of length
    look : Look
        how to draw it, but for `cut`
    """
    _meshPicture(mesh, lengthUnit, look).save(file)


def meshPicture(mesh: Mesh, lengthUnit: str = "nm", **look: Any) -> Picture:
    """Return what :func:`drawMesh` writes, with a :class:`Look` of these values."""
    unknown = [name for name in look if name not in SHAPE.__dataclass_fields__ or name == "cut"]
    if unknown:
        known = ", ".join(name for name in SHAPE.__dataclass_fields__ if name != "cut")
        raise ValueError(f"plot has no {unknown[0]}; it has {known} and lengthUnit")
    return _meshPicture(mesh, lengthUnit, replace(SHAPE, **look))


@ownStyle()
def _meshPicture(mesh: Mesh, lengthUnit: str, look: Look) -> Picture:
    from matplotlib.colors import LightSource, Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    surface, curvature = shownSurface(mesh)
    norm = Normalize(*look.limits(curvature))
    figure = Figure(figsize=(look.size[0] / look.dpi, look.size[1] / look.dpi), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    species = look.species(surface)
    if species is None:
        colors = _colorMap(look)(norm(curvature[surface.triangles].mean(axis=1)))
    else:
        middle = np.median(species[surface.triangles], axis=1).astype(int)
        colors = np.insert(speciesColors(middle, speciesCount(surface)), 3, 1.0, axis=1)
    beads, beadColors = _beadTriangles(mesh)
    faces, fills = np.concatenate((surface.vertices[surface.triangles], beads)), np.concatenate((colors, beadColors))
    axes.add_collection3d(
        Poly3DCollection(
            faces,
            facecolors=fills,
            # Edges of the triangles' own color hide the seams between them.
            edgecolors="0.2" if look.edges else fills,
            linewidths=0.3,
            shade=not look.edges,
            lightsource=None if look.edges else LightSource(azdeg=120 - look.azimuth, altdeg=50),
        )
    )
    _frame(
        axes,
        np.concatenate((surface.vertices if mesh.isPeriodic else mesh.vertices, mesh.beads)),
        look,
        lengthUnit,
        simplification(mesh, surface),
    )
    if species is None:
        _colorBar(figure, axes, norm, lengthUnit, look)
    else:
        _speciesLegend(figure, surface)
    if look.scaleBar:
        _scaleBar(figure, axes, mesh, look, lengthUnit)
    return Picture(figure, look.dpi, look.transparent)


def _beadTriangles(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of triangles that make a sphere of each bead, and their colors."""
    from matplotlib.colors import to_rgba

    ball = Mesh.icosphere(1 if len(mesh.beads) <= 500 else 0, beadRadius(mesh))
    corners = mesh.beads[:, np.newaxis, np.newaxis] + ball.vertices[ball.triangles]
    corners = corners.reshape(-1, 3, 3)
    return corners, np.tile(to_rgba(BEAD_COLOR), (len(corners), 1))


def beadRadius(mesh: Mesh) -> float:
    """Return the radius with which beads are drawn: half the mean length of edges, which an edge's neighbors leave."""
    return 0.5 * float(mesh.edgeLengths.mean()) if len(mesh.beads) else 1.0


def _colorMap(look: Look) -> Any:
    from matplotlib import colormaps

    return colormaps[look.colorMap]


def requireMatplotlib() -> None:
    """Raise what importing matplotlib raises: an error that nobody wants to see at the end of a long run."""
    import matplotlib.figure  # noqa: F401


def saveFigure(figure: Any, file: PathLike, dpi: float = 120, transparent: bool = False) -> None:
    """Write a matplotlib Figure to a picture, replacing one that exists in a single step."""
    with _drawing, replacingAtOnce(file) as content:
        figure.savefig(content, dpi=dpi, format=Path(file).suffix[1:] or "png", transparent=transparent)


def _frame(axes: Any, points: np.ndarray, look: Look, lengthUnit: str, remark: str | None) -> None:
    """Show all of the points at equal scales, and a remark beside the size."""
    middle, size = (points.max(axis=0) + points.min(axis=0)) / 2, np.ptp(points, axis=0).max()
    for set_limits, center in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle):
        set_limits(center - size / 2, center + size / 2)
    axes.set_box_aspect((1, 1, 1), zoom=1.3 * look.zoom)
    axes.view_init(look.elevation, look.azimuth)
    axes.set_axis_off()
    if look.scaleBar:
        axes.set_proj_type("ortho")
    title = ", ".join(filter(None, (f"{size:.3g} {_plain(unitText(lengthUnit))} across", remark)))
    axes.set_title(title, y=0, fontsize="medium")


def _colorBar(figure: Any, axes: Any, norm: Any, lengthUnit: str, look: Look) -> None:
    from matplotlib.cm import ScalarMappable

    figure.colorbar(
        ScalarMappable(norm, _colorMap(look)), ax=axes, shrink=0.6, label=_plain(curvatureLabel(lengthUnit))
    )


def _speciesLegend(figure: Any, mesh: Mesh) -> None:
    from matplotlib.patches import Patch

    patches = [Patch(color=color, label=_plain(name)) for name, color in speciesLegend(mesh, speciesCount(mesh))]
    figure.legend(handles=patches, loc="center right", title="species")


def _scaleBar(figure: Any, axes: Any, mesh: Mesh, look: Look, lengthUnit: str) -> None:
    """Draw a bar of a length in the plane of the picture, whose scale is the same everywhere."""
    from matplotlib.lines import Line2D
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    figure.draw_without_rendering()
    across = np.array([-np.sin(np.radians(look.azimuth)), np.cos(np.radians(look.azimuth)), 0.0])
    middle = mesh.vertices.mean(axis=0)
    ends = [proj_transform(*point, axes.get_proj())[:2] for point in (middle, middle + across)]
    inFigure = figure.transFigure.inverted().transform(axes.transData.transform(ends))
    scale = float(np.linalg.norm(inFigure[1] - inFigure[0]))  # of the picture's width for 1 nm
    length = look.barLength(1 / scale)
    x, y = 0.05, 0.08
    figure.add_artist(Line2D([x, x + length * scale], [y, y], color="black", lw=3, solid_capstyle="butt"))
    label = f"{length:g} {_plain(unitText(lengthUnit))}"
    figure.text(x + length * scale / 2, y + 0.015, label, ha="center", va="bottom")
