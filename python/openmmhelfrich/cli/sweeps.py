"""The command that runs grids of runs."""

import sys
import time
from pathlib import Path
from typing import Annotated, Literal

import typer

from .errors import friendly
from .runs import FAILED_VERDICT, AcceptAnything, Quiet

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
        int | None,
        typer.Option(min=1, help="Number of these processes; by default each thread of a point has a core."),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads of the CPU platform of each point; 1 by default.")
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
    from ..runs.progress import SweepProgress
    from ..runs.sweeps import sweep as runSweep

    start = time.monotonic()
    with SweepProgress(quiet) as progress:
        result = runSweep(grid, output, scheduler, workers, progress, retry, threads=threads)
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
