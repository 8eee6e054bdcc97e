"""The command that measures trades of speed for accuracy."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .errors import friendly
from .terminal import show

if TYPE_CHECKING:  # cli starts without what simulates
    from ..tradeoff.search import SearchPoint

app = typer.Typer()


@app.command(
    epilog="Example: openmm-helfrich tradeoff examples/red_blood_cell.toml --error 1e-3 --minutes 15 --output "
    "results/cell"
)
@friendly
def tradeoff(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE.toml", help="The configuration of a run, whose last stage samples.")
    ],
    error: Annotated[
        float, typer.Option(help="Relative error of the averages of bending energy, area and volume that is allowed.")
    ] = 1e-3,
    minutes: Annotated[
        float | None,
        typer.Option(min=0, help="Processor time after which no measurement is begun; a later call goes on."),
    ] = None,
    effort: Annotated[
        float, typer.Option(min=0, help="Largest number of force evaluations at a setting times vertices, in millions.")
    ] = 300.0,
    axes: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES", help="What to vary, separated by commas, such as 'tether,length'; everything by default."
        ),
    ] = None,
    output: Annotated[
        str | None, typer.Option(metavar="PREFIX", help="Folder and first part of the names of all results.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Begin anew instead of going on with an earlier search.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
) -> None:
    """Measure what a scene's settings cost and how accurate they are, and recommend the cheapest for an error.

    Varies step size, length of trajectories, flips, tether, constraints, resolution and terms, one after the other
    around the best so far, and measures the processor time to an independent sample of the shape.  Writes a table
    (PREFIX.md), a picture (PREFIX.png), and a configuration for openmm-helfrich run (PREFIX.toml). Every measurement is
    kept in PREFIX.json: after whatever stopped the command, calling it again goes on.
    """
    from ..tradeoff import tradeoff as measureSettings
    from ..tradeoff.settings import describe

    prefix = output or f"{scene.with_suffix('').name}_tradeoff"
    with _Progress(quiet) as progress:
        search, best = measureSettings(
            scene,
            prefix,
            error,
            1e6 * effort,
            minutes,
            axes and [name.strip() for name in axes.split(",")],
            overwrite,
            progress,
        )
    if best is None:
        print(
            f"openmm-helfrich: {len(search.points)} settings are measured and kept in {prefix}.json; the time is "
            "spent, call the command again to go on",
            file=sys.stderr,
        )
        raise typer.Exit(3)
    if quiet:
        return
    lines = (
        ("recommended", describe(best.setting)),
        ("step size", f"{best.measured.stepSize:.3g} ps, {best.measured.acceptance:.0%} accepted"),
        (
            "cost",
            f"{search.seconds(best):.3g} s ± {search.time(best)[1]:.0%} of processor time to an independent sample of "
            "the shape",
        ),
        ("gain", f"{search.gain(best):.3g} times more of them than the scene as it stands"),
        ("files", f"{prefix}.toml, {prefix}.md, {prefix}.png, {prefix}.json"),
    )
    show(lines)


class _Progress:
    """What is being measured, on a terminal, and a line for each setting."""

    def __init__(self, quiet: bool) -> None:
        from rich.console import Console

        self._console, self._quiet = Console(stderr=True, highlight=False), quiet
        self._status = self._console.status("") if self._console.is_terminal and not quiet else None

    def __enter__(self) -> "_Progress":
        if self._status:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status:
            self._status.stop()

    def __call__(self, point: "SearchPoint") -> None:
        from ..tradeoff.settings import describe

        if self._quiet:
            return
        title, m = f"{point.axis}: {describe(point.choice)}" if point.choice else point.axis, point.measurement
        if m is not None or point.problem:
            result = point.problem
            if m is not None:
                each = f"{1e6 * m.secondsPerEvaluation:.1f} µs"
                result = f"{m.evaluations} evaluations of {each}, {m.acceptance:.0%} accepted"
            self._console.print(f"{title}: {result}", soft_wrap=True)
        elif self._status:
            self._status.update(f"{title} ...")
