"""The command that runs grids of runs."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.progress import TaskID

from .errors import friendly
from .progress import SECONDS_BETWEEN_LINES, Bars
from .runs import FAILED_VERDICT, AcceptAnything, Quiet

if TYPE_CHECKING:  # cli starts without what simulates
    from ..runs.sweeps import PointStatus

app = typer.Typer()


@app.command(epilog="Example: openmm-helfrich sweep examples/volume_diagram.toml --output results/volume --workers 2")
@friendly
def sweep(
    grid: Annotated[
        Path, typer.Argument(metavar="GRID.toml", help="A configuration, and lists of values for its keys.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where the results go; by default a folder of the grid's name."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="A Dask scheduler whose workers run the points; by default processes on this machine do.",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of these processes; one for each core by default.")
    ] = None,
    retry: Annotated[
        Literal["failed"] | None,
        typer.Option(
            help="Begin points anew whose verdict is failed, with the grid's settings of now and other random numbers.",
        ),
    ] = None,
    acceptAnything: AcceptAnything = False,
    quiet: Quiet = False,
) -> None:
    """Run a grid of targets, temperatures, moduli, seeds: every combination of values of a configuration's keys.

    Each point is a run in a folder of its own.  Whatever stopped the sweep, the same command goes on with it: what is
    finished stays, and what had begun goes on from its last checkpoint.  A table, summary.csv, has a row for each
    point.

    The exit code is 3 if the verdict on a point is failed, and 1 if a point ended with an error.
    """
    from ..runs.sweeps import sweep as runSweep

    start = time.monotonic()
    with _SweepProgress(quiet) as progress:
        result = runSweep(grid, output, scheduler, workers, progress, retry)
    if not quiet:
        counts = ", ".join(
            f"{result.count(status)} {status}"
            for status in ("done", "failed", "stopped", "waiting")
            if result.count(status)
        )
        print(f"{len(result.points)} points: {counts}, in {time.monotonic() - start:.0f} s\n{result.table}")
        for state in result.points:
            if state.verdict == "doubtful":
                print(f"point {state.point.name} is doubtful: {state.reason}")
    for state in result.points:
        if state.status == "failed":
            print(f"openmm-helfrich: point {state.point.name} failed: {state.reason}", file=sys.stderr)
    if result.signal:
        raise typer.Exit(128 + result.signal)
    failed = [state for state in result.points if state.status == "failed"]
    if any(not state.verdict for state in failed):
        raise typer.Exit(1)
    if failed and not acceptAnything:
        raise typer.Exit(FAILED_VERDICT)


class _SweepProgress(Bars):
    """A bar for the sweep and one for each point that runs, on a terminal; elsewhere plain lines; nothing when quiet.

    Called with the states of the points.
    """

    def __init__(self, quiet: bool):
        super().__init__(quiet)
        self._tasks: dict[str, TaskID] = {}
        self._known: dict[str, str] = {}
        self._shownAt = 0.0

    def __call__(self, states: "list[PointStatus]") -> None:
        if self._quiet:
            return
        if not self._known:
            self._known = {state.point.name: state.status for state in states}
        for state in states:
            if state.status != self._known[state.point.name]:
                self._known[state.point.name] = state.status
                reason = f", {state.verdict}" if state.verdict else f": {state.reason}" if state.reason else ""
                self._say(f"{state.point.name}: {state.status}{reason}")
        if self._bar:
            self._draw(self._bar, states)
        elif time.monotonic() >= self._shownAt + SECONDS_BETWEEN_LINES:
            self._shownAt = time.monotonic()
            running = [
                f"{state.point.name} {state.stage} {state.position}/{state.steps}"
                for state in states
                if state.status == "running"
            ]
            self._say(f"{self._count(states)} of {len(states)} points{''.join('; ' + text for text in running)}")

    def _draw(self, bar: Any, states: list["PointStatus"]) -> None:
        self._show(bar, "points", self._count(states), len(states), "")
        for state in states:
            name = state.point.name
            if state.status == "running":
                self._show(bar, name, state.position, state.steps, state.stage)
            elif name in self._tasks:
                bar.remove_task(self._tasks.pop(name))

    def _show(self, bar: Any, name: str, done: int, total: int, text: str) -> None:
        if name not in self._tasks:
            self._tasks[name] = bar.add_task(name, total=total, text=text)
        bar.update(self._tasks[name], completed=done, total=total, text=text)

    @staticmethod
    def _count(states: list["PointStatus"]) -> int:
        return sum(state.status in ("done", "failed") for state in states)
