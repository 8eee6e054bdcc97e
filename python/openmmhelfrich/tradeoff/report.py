"""What a search found, as a table, a picture, and a configuration to run."""

import math
from pathlib import Path
from typing import Any

from ..files import PathLike, replacing
from ..pictures.plots import ownStyle, saveFigure
from ..runs.config import asDict, hasBurnIn, parseConfig
from ..runs.configfile import configText
from .search import AVERAGES, Search, SearchPoint
from .settings import apply, describe, isExact

SHAPE_SAMPLES = 20  # independent ones that a recommended run has at least


def writeReport(search: Search, prefix: PathLike, recommended: SearchPoint | None = None) -> list[str]:
    """Write PREFIX.md, PREFIX.png and, if there is a SearchPoint to recommend, PREFIX.toml, and return their names."""
    files = [f"{prefix}.md", f"{prefix}.png"]
    with replacing(files[0]) as part:
        part.write_text(tableText(search, recommended), encoding="utf-8")
    plot(search, files[1], recommended)
    if recommended is not None:
        files.append(f"{prefix}.toml")
        with replacing(files[2]) as part:
            part.write_text(recommendationText(search, recommended), encoding="utf-8")
    return files


def tableText(search: Search, recommended: SearchPoint | None = None) -> str:
    """Return what a search measured as tables in Markdown: the cost of settings, their accuracy, and minimizations."""
    tables = []
    for columns in (_costs, _accuracies):
        rows = [
            {**_head(search, point, recommended), **(columns(search, point) if point.measurement else {})}
            for point in search.points
        ]
        names = list(next(row for row, point in zip(rows, search.points) if point.measurement))
        lines = [
            names,
            ["---"] * 2 + ["--:"] * (len(names) - 2),
            *([row.get(name, "") for name in names] for row in rows),
        ]
        tables.append("".join(f"| {' | '.join(cells)} |\n" for cells in lines))
    return "\n".join(tables + ([_minimaText(search)] if search.minima else []))


def _minimaText(search: Search) -> str:
    lowest = min(minimum.energy for minimum in search.minima)
    lines = [
        "| tolerance, kT per length | s | iterations | energy above the lowest, kT | E_B, kT | end |",
        "| --: | --: | --: | --: | --: | --- |",
    ]
    lines += [
        f"| {m.tolerance:.3g} | {m.seconds:.2f} | {m.iterations} | {m.energy - lowest:.3g} | {m.bending:.2f} | "
        f"{m.reason} |"
        for m in search.minima
    ]
    return "\n".join(lines) + "\n"


def _head(search: Search, point: SearchPoint, recommended: SearchPoint | None) -> dict[str, str]:
    text = f"**{describe(point.setting)}**" if point is recommended else describe(point.choice or point.setting)
    return {"axis": point.axis, "setting": text if point.measurement else f"{text}: {point.problem.replace('|', '/')}"}


def _costs(search: Search, point: SearchPoint) -> dict[str, str]:
    m = point.measured
    bending = m.observables["bending"]
    diffusion = f"{m.secondsPerStep * m.stepsPerEdge:.3g}" if math.isfinite(m.stepsPerEdge) else "–"
    return {
        "step, ps": f"{m.stepSize:.3g}",
        "accepted": f"{m.acceptance:.0%}",
        "flips accepted": f"{m.flipAcceptance:.1%}",
        "µs per evaluation": f"{1e6 * m.secondsPerEvaluation:.1f}",
        "ms per step": f"{1e3 * m.secondsPerStep:.2f}",
        "evaluations per sample, shape": (
            f"{'≥ ' if m.isShort else ''}{search.evaluations(point):.0f} ± {search.time(point)[1]:.0%}"
        ),
        "E_B": f"{m.evaluationsPerStep * bending.time:.0f} ± {bending.timeError:.0%}",
        "s per sample, shape": f"{search.seconds(point):.3g}",
        "s per edge of diffusion": diffusion,
        "gain": f"{search.gain(point):.2g}",
    }


def _accuracies(search: Search, point: SearchPoint) -> dict[str, str]:
    m, reference = point.measured, search.reference.measured.observables["bending"]
    corrected = ""
    if m.reweighted:
        mean, error = m.reweighted["bending"]
        corrected = (
            f"{1e3 * (mean / reference.mean - 1):.1f} ± "
            f"{1e3 * math.hypot(error, reference.error) / abs(reference.mean):.1f}, {m.effectiveFraction:.1%} left"
        )
    return {
        "diverged": f"{m.diverged:.1%}",
        "ΔH, kT": f"{m.energyError:.2g}",
        "balance": f"{m.balance[0]:.3f} ± {m.balance[1]:.3f}",
        "force error": f"{m.forceError:.0e}",
        "E_B, kT": f"{m.observables['bending'].mean:.1f}",
        **{
            f"{name}, ‰": f"{1e3 * deviation:.1f} ± {1e3 * error:.1f}"
            for name, (deviation, error) in zip(("E_B", "A", "V"), search.deviations(point).values())
        },
        "E_B reweighted, ‰": corrected,
    }


def stepsFor(search: Search, point: SearchPoint) -> int:
    """Return the number of Monte Carlo steps after which the standard errors of bending energy, area and volume are
    half of the search's error, and the shape has been sampled.
    """
    observables = point.measured.observables
    needed = [
        (observables[name].deviation / (observables[name].mean * search.error / 2)) ** 2 * observables[name].time
        for name in AVERAGES
    ]
    return math.ceil(max(*needed, SHAPE_SAMPLES * search.time(point)[0]))


def recommendationText(search: Search, point: SearchPoint) -> str:
    """Return a configuration of the scene at a setting, for openmm-helfrich run.

    It has twice the steps that the error takes, for a run's summary averages over the second half.
    """
    measurement, steps = point.measured, 2 * stepsFor(search, point)
    setting = {name: value for name, value in point.setting.items() if name != "sampling.target_acceptance"}
    if setting.get("sampling.step_size") == "auto":
        setting["sampling.step_size"] = float(f"{measurement.stepSize:.4g}")
    config = apply(search.config, setting, asWritten=True)
    data = asDict(config, onlyGiven=True)
    if config.mesh.file is not None:
        data["mesh"]["file"] = str(Path(config.mesh.file).resolve())  # wherever this is put
    data.get("output", {}).pop("prefix", None)
    if config.stages:
        data["stages"][-1].update(steps=steps)
        data["stages"][-1].pop("step_size", None)
    else:
        data["sampling"]["steps"] = steps
    if not hasBurnIn(parseConfig(data)):
        data.get("sampling", {}).pop("burn_in", None)
    comments = [
        f"Recommended by openmm-helfrich tradeoff for a relative error of {search.error:g} of bending energy, area and "
        "volume.",
        f"{describe(point.setting)}: {search.seconds(point):.3g} s of processor time to an independent sample of the "
        f"shape, 1/{search.gain(point):.3g} of the scene's as it stood; about {steps * measurement.secondsPerStep:.3g} "
        "s in all.",
    ]
    return configText(data, comments)


@ownStyle()
def plot(search: Search, file: PathLike, recommended: SearchPoint | None = None) -> None:
    """Draw the cost of an independent sample at each setting, and against it how far averages may be off, with the
    Pareto front.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    points = [point for point in search.points if point.measurement is not None]
    axes = list(dict.fromkeys(point.axis for point in points))
    colors = {axis: colormaps["tab20"](i) for i, axis in enumerate(axes)}
    figure = Figure(figsize=(13, 2 + 0.2 * len(points)), layout="constrained")
    costs, pareto = figure.subplots(1, 2)
    _plotCosts(costs, search, points, colors)
    places = {i: (search.seconds(point), _bound(search, point)) for i, point in enumerate(points)}
    for i, (x, y) in places.items():
        isBest = points[i] is recommended
        pareto.plot(
            x,
            y,
            "*" if isBest else "o" if isExact(points[i].setting) else "s",
            ms=16 if isBest else 6,
            color=colors[points[i].axis],
        )
    offered = [place for i, place in places.items() if points[i].axis != "terms"]
    front = sorted(
        place for place in offered if not any(x <= place[0] and y <= place[1] and (x, y) != place for x, y in offered)
    )
    pareto.plot(*zip(*front), color="0.5", lw=1, zorder=0, drawstyle="steps-post")
    pareto.axhline(search.error, color="0.7", ls="--", lw=1)
    pareto.set(
        xscale="log",
        yscale="log",
        xlabel="s per independent sample of the shape",
        ylabel="relative deviation of ⟨E$_B$⟩, ⟨A⟩ or ⟨V⟩ plus its error",
    )
    pareto.xaxis.set_minor_formatter("")
    handles = [pareto.plot([], [], "o", color=color, label=axis)[0] for axis, color in colors.items()]
    pareto.legend(
        handles=handles, fontsize="x-small", ncols=2, title="squares: another distribution", title_fontsize="x-small"
    )
    saveFigure(figure, file, dpi=110)


def _plotCosts(axes: Any, search: Search, points: list[SearchPoint], colors: dict[str, Any]) -> None:
    cost = [search.seconds(point) for point in points]
    errors = [c * min(search.time(point)[1], 0.9) for c, point in zip(cost, points)]
    places = [-i for i in range(len(points))]
    axes.barh(places, cost, xerr=errors, color=[colors[point.axis] for point in points], ecolor="0.4")
    axes.set_yticks(
        places,
        [f"{point.axis}: {describe(point.choice)}" if point.choice else point.axis for point in points],
        fontsize=6,
    )
    axes.set(xscale="log", xlabel="s per independent sample of the shape", ylim=(-len(points), 1))


def _bound(search: Search, point: SearchPoint) -> float:
    """Return the largest deviation of an average, with its error."""
    return max(abs(deviation) + error for deviation, error in search.deviations(point).values())
