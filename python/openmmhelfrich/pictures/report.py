"""A page to look at: a run's shape in 3D with its frames, its observables, settings and warnings, in one HTML file that
needs nothing else.
"""

import base64
import html
import json
import re
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import openmm as mm
from numpy.typing import NDArray

from ..analysis.description import classifyShape
from ..analysis.verdict import OF_MOVES, OF_SHAPES, Evidence, Verdict, judge
from ..files import PathLike, replacing
from ..geometry.mesh import Mesh
from ..io.conversion import requireNew
from ..io.runfiles import beside, finalMesh, prefixOf
from ..io.vtkhdf import MeshFrame, readMeshTrajectory
from ..optional import require
from ..sampling.averages import lateRows
from ..sampling.observables import (
    PANELS,
    Observable,
    curves,
    madeBetween,
    observablesIn,
    observableUnits,
    readObservables,
    shownValues,
)
from ..tables import Table, headOf, unwarned
from ..units import wholeNumber
from ..version import __version__
from .curvature import shownSurface, simplification
from .look import BEAD_COLOR, LOOK, colorScale, speciesCount, speciesLegend, speciesPalette, speciesPlaces, unitText
from .plots import beadRadius

MAX_BYTES = 20e6  # of a page: what mail and browsers take without complaint
MAX_FRAMES = 101  # the start and a hundred more
MAX_ROWS = 2000  # of the table: more than a plot has pixels
TEMPLATE = Path(__file__).with_name("report.html")


@unwarned
def writeReport(
    prefix: PathLike,
    file: PathLike | None = None,
    maxFrames: int = MAX_FRAMES,
    overwrite: bool = False,
    verdict: Verdict | None = None,
) -> Path:
    """Write a page about the results of a run.

    It has the shape in 3D, to turn and to play, colored by mean curvature, from PREFIX.vtkhdf or, if there is none,
    the final mesh; the observables against steps, from PREFIX.csv; the settings, from PREFIX.resolved.toml; averages,
    versions and warnings.  What is missing is left out and listed among the warnings.  The page is self-contained and
    stays below 20 MB: of more frames than fit, and of more than 2,000 rows, it has some at equal distances. Shapes of
    more than 100,000 vertices are simplified. Positions are rounded to 1/65,535 of the size, curvatures to 1/255 of
    their range.

    Parameters
    ----------
    prefix : path
        the prefix of the run's files, or one of them
    file : path, optional
        the page to write; PREFIX_report.html by default
    maxFrames : int
        the largest number of frames
    overwrite : bool
        replace a page that exists
    verdict : Verdict, optional
        the one on the run; by default the one on what the table and the final mesh tell

    Returns
    -------
    Path
        the page

    Raises
    ------
    FileNotFoundError
        if there is neither a trajectory nor a table nor a final mesh
    FileExistsError
        if the page exists and is not to be overwritten
    ValueError
        if a file is damaged, or plotly is not there
    """
    maxFrames = wholeNumber(maxFrames, "the number of frames", 1)
    prefix = prefixOf(prefix)
    file = beside(prefix, "_report.html") if file is None else Path(file)
    plotly = require("plotly.offline", "writing a report").get_plotlyjs()
    requireNew([file], beside(prefix, ".csv"), overwrite)
    warnings: list[str] = []
    frames, (table, units), settings = (
        _readFrames(prefix, warnings),
        _readTable(prefix, warnings),
        _readSettings(prefix, warnings),
    )
    if not len(frames) and table is None:
        raise FileNotFoundError(f"there are no results {prefix}.vtkhdf, {prefix}.csv or {prefix}.ply")
    lengthUnit = units.get("area", getattr(frames, "lengthUnit", "nm") + "^2").removesuffix("^2")
    data = {
        "shape": _shape(frames, maxFrames, MAX_BYTES - len(plotly.encode()) - 500e3, lengthUnit, warnings)
        if len(frames)
        else None,
        "panels": _panels(table, units) if table is not None else None,
    }
    if table is not None and np.any(table["step"][1:] <= table["step"][:-1]):
        warnings.append("The steps in the table do not ascend: rows of several runs may be mixed.")
    last = frames[len(frames) - 1].mesh if len(frames) else None
    verdict = verdict or _judge(table, last, warnings)
    text = _fill(
        TEMPLATE.read_text(encoding="utf-8"),
        {
            "title": html.escape(prefix.name),
            "level": verdict.level,
            "findings": "".join(f"<li>{html.escape(reason)}</li>" for reason in verdict.reasons()),
            "plotly": plotly,
            "data": json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
            "facts": "".join(
                f"<tr><th>{html.escape(label)}</th><td>{html.escape(text)}</td></tr>"
                for label, text in _facts(frames, table, units, _kindsIn(settings))
            ),
            "warnings": "".join(f"<li>{html.escape(line)}</li>" for line in warnings),
            "settings": html.escape(settings),
        },
    )
    with replacing(file) as part:
        part.write_text(text, encoding="utf-8")
    return file


def _readFrames(prefix: Path, warnings: list[str]) -> Sequence[MeshFrame]:
    """Return the frames of the trajectory, or the final mesh as the only one, or none."""
    trajectory = beside(prefix, ".vtkhdf")
    if trajectory.exists():
        return readMeshTrajectory(trajectory)
    final = finalMesh(prefix)
    if final is not None:
        warnings.append(f"There is no mesh trajectory {trajectory.name}; the shape is that of {final.name}.")
        return [MeshFrame(0, Mesh.read(final), {})]
    warnings.append(f"There is neither a mesh trajectory {trajectory.name} nor a final mesh; no shape can be shown.")
    return []


def _readTable(prefix: Path, warnings: list[str]) -> tuple[Table | None, dict[str, str]]:
    """Return the table and its units, or None and no units."""
    file = beside(prefix, ".csv")
    if not file.exists():
        warnings.append(f"There is no table of observables {file.name}.")
        return None, {}
    units, table = observableUnits(file), readObservables(file)
    table.requireRows()
    return table, units


def _readSettings(prefix: Path, warnings: list[str]) -> str:
    file = beside(prefix, ".resolved.toml")
    if file.exists():
        return file.read_text(encoding="utf-8", errors="replace")
    warnings.append(f"There are no settings {file.name}.")
    return ""


def _shape(
    frames: Sequence[MeshFrame], maxFrames: float, maxBytes: float, lengthUnit: str, warnings: list[str]
) -> dict[str, Any] | None:
    """Return what the page needs to draw the frames, or None if there is no room for one."""
    last = frames[len(frames) - 1]
    surface, _ = drawn = shownSurface(last.mesh)
    if remark := simplification(last.mesh, surface):
        warnings.append(f"The page shows shapes that are {remark}.")
    indexType = "u2" if len(surface.vertices) <= 2**16 else "u4"
    frameBytes = 4 / 3 * (7 * len(surface.vertices) + 3 * np.dtype(indexType).itemsize * len(surface.triangles)) + 200
    count = int(max(0, min(len(frames), maxFrames, maxBytes // frameBytes)))
    if count < len(frames):
        warnings.append(f"The page shows {count} of {len(frames)} frames.")
    if count == 0:
        return None
    chosen = (
        np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int)).tolist()
        if count > 1
        else [len(frames) - 1]
    )
    shown = [(frames[i].step, *shownSurface(frames[i].mesh)) for i in chosen[:-1]] + [(last.step, *drawn)]
    beads = [frames[i].mesh.beads for i in chosen]
    count = 0 if LOOK.species(last.mesh) is None else speciesCount(*(mesh for _, mesh, _ in shown))
    return {
        "lengthUnit": _forPlotly(unitText(lengthUnit)),
        "colors": colorScale(),
        "beadColor": [round(255 * float(BEAD_COLOR))] * 3,
        "index": chosen,
        "wide": indexType == "u4",
        **_encode(shown, beads, indexType, count),
        "beadSize": 2 * beadRadius(last.mesh),
        **_species(last.mesh, count),
    }


def _species(mesh: Mesh, count: int) -> dict[str, Any]:
    """Return the colors of so many species, and the names and colors of those that a mesh has."""
    from matplotlib.colors import to_hex

    legend = speciesLegend(mesh, count) if count else []
    return {
        "speciesColors": [to_hex(color) for color in speciesPalette(count)] if count else [],
        "legend": [[_forPlotly(name), to_hex(color)] for name, color in legend],
    }


def _encode(
    shown: list[tuple[int, Mesh, NDArray[np.float64]]], beads: list[NDArray[np.float64]], indexType: str, count: int
) -> dict[str, Any]:
    """Return the arrays of the frames as text, and what turns it into lengths and curvatures again; the colors of
    species if a number of them is to be shown.
    """
    low, high = (
        limit([limit(np.concatenate((mesh.vertices, own)), axis=0) for (_, mesh, _), own in zip(shown, beads)], axis=0)
        for limit in (np.min, np.max)
    )
    size, low = max(high - low), (low + high - max(high - low)) / 2  # a cube around all
    bound = max(*(np.quantile(np.abs(curvature), 0.99) for *_, curvature in shown), 1e-12)
    frames = [
        {
            "step": step,
            "positions": _base64((mesh.vertices - low).T / size * 65535, "u2"),
            "triangles": _base64(mesh.triangles.T, indexType),
            "curvatures": _base64((np.clip(curvature / bound, -1, 1) + 1) * 127.5, "u1"),
            "beads": _base64((own - low).T / size * 65535, "u2"),
            **(
                {"species": _base64(speciesPlaces(mesh.species, count), "u1")}
                if count and mesh.species is not None
                else {}
            ),
        }
        for (step, mesh, curvature), own in zip(shown, beads)
    ]
    return {"low": low.tolist(), "size": float(size), "bound": float(bound), "frames": frames}


def _base64(values: np.ndarray, kind: str) -> str:
    """Return numbers, rounded to little-endian integers of a kind, as text."""
    return base64.b64encode(np.ascontiguousarray(np.rint(values), dtype="<" + kind).tobytes()).decode()


def _forPlotly(text: str) -> str:
    """Return a text in which plotly finds no markup."""
    return html.escape(text, quote=False)


def _panels(table: Table, units: dict[str, str]) -> dict[str, Any]:
    """Return the curves of each panel of the plot."""
    rows = np.unique(np.linspace(0, len(table["step"]) - 1, MAX_ROWS).round().astype(int))

    shown = [(panel, curves(panel, table)) for panel in PANELS]
    panels = [
        {
            "title": _forPlotly(headOf(panel.title, unitText(units.get(observables[0].name, "")))),
            "curves": [
                {"name": o.label or o.title, "values": _rounded(shownValues(panel, o, table)[rows])}
                for o in observables
            ],
        }
        for panel, observables in shown
        if observables
    ]
    return {"steps": [int(step) for step in table["step"][rows]], "panels": panels}


def _rounded(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.7g}") if np.isfinite(value) else None for value in values]


def _kindsIn(settings: str) -> list[str]:
    """Return the kinds of the stages in the text of a run's settings."""
    return re.findall(r'^kind = "(\w+)"', settings, re.MULTILINE)


def _facts(
    frames: Sequence[MeshFrame], table: Table | None, units: dict[str, str], kinds: Sequence[str]
) -> list[tuple[str, str]]:
    """Return a label and a text for what the run, of stages of some kinds, was like on average."""
    facts = []
    if len(frames):
        mesh = frames[len(frames) - 1].mesh
        facts += [
            ("membrane", f"{len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles"),
            ("frames", str(len(frames))),
        ]
        surfaces = mesh.components()
        if len(surfaces) > 1:
            facts += [(f"shape of surface {k}", classifyShape(surface)) for k, surface in enumerate(surfaces)]
    if table is not None:
        late = lateRows(table)
        facts += [
            ("table", f"up to {madeBetween(0, int(table['step'][-1]), table, kinds)}"),
            ("averages", f"with standard deviations, from step {int(late['step'][0])} on")
            if len(late["step"]) > 1
            else ("values", f"at step {int(late['step'][0])}"),
        ]
        facts += [(o.title, _fact(o, table, late, units)) for o in observablesIn(table) if o.onPage]
    versions = f"openmm-helfrich {__version__}, OpenMM {mm.Platform.getOpenMMVersion()}"
    return [*facts, ("this page", f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC, {versions}")]


def _fact(observable: Observable, table: Table, late: Table, units: dict[str, str]) -> str:
    """Return the average of an observable, or its last value, as text."""
    name = observable.name
    if observable.onPage == "last":
        return f"{table[name][-1]:.1%}"
    deviation = f" ± {late[name].std():.2g}" if len(late[name]) > 1 else ""
    return f"{late[name].mean():.5g}{deviation} {unitText(units.get(name, ''))}"


def _judge(table: Table | None, mesh: Mesh | None, warnings: list[str]) -> Verdict:
    """Return the verdict on results that have none, and add what speaks against judging the mesh."""
    if mesh is not None:
        try:
            mesh.check()
        except ValueError as error:
            warnings.append(f"The mesh of the last frame is not sound: {error}.")
            mesh = None
    rates: dict[str, Any] = {}
    if table is not None:
        last = {name: float(values[-1]) for name, values in table.items()}
        rates = {name: last[name] for name in ("acceptance", "flipAcceptance") if name in last}
        if "diverged" in last:
            rates["divergence"] = last["diverged"] / max(last["step"], 1)
    evidence = Evidence(rows=Table() if table is None else table, mesh=mesh, **rates)
    return judge(evidence, (*OF_SHAPES, *OF_MOVES))


def _fill(template: str, parts: dict[str, str]) -> str:
    """Put the parts in the places that the template marks as @@name@@, each found before any is filled."""
    pieces = template.split("@@")
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces))
