"""Commands that simulate."""

import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .errors import friendly
from .terminal import say, show

if TYPE_CHECKING:  # cli starts without what simulates
    from ..runs.progress import RunProgress
    from ..runs.summary import Summary

app = typer.Typer()

FAILED_VERDICT = 3  # the exit code

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Platform = Annotated[str | None, typer.Option(help="OpenMM platform: CPU or Reference.")]
Threads = Annotated[int | None, typer.Option(min=1, help="Threads of the CPU platform.")]
AcceptAnything = Annotated[
    bool, typer.Option("--accept-anything", help="End with exit code 0 whatever the verdict, which is shown.")
]


@app.command(epilog="Example: openmm-helfrich run examples/red_blood_cell.toml --output results/cell")
@friendly
def run(
    config: Annotated[Path, typer.Argument(metavar="CONFIG.toml", help="The configuration of the run.")],
    platform: Platform = None,
    threads: Threads = None,
    seed: Annotated[int | None, typer.Option(min=1, max=2**31 - 1, help="Seed of all random numbers.")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Number of Monte Carlo steps.")] = None,
    output: Annotated[
        str | None, typer.Option(metavar="PREFIX", help="Folder and first part of the names of all results.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the results of an earlier run.")] = False,
    acceptAnything: AcceptAnything = False,
    quiet: Quiet = False,
) -> None:
    """Do the stages that a configuration describes: minimize, sample, anneal, continue to other targets.

    Writes trajectories (VTKHDF, with the live triangles, and DCD), a topology (PSF), a table of observables (CSV), the
    final mesh, two pictures (PNG), the settings with all defaults filled in, and a checkpoint, from which the command
    resume goes on after whatever stopped the run.  Options take the place of the configuration's values.

    At the end stands a verdict, good, doubtful or failed, with its reasons.  The exit code is 0 if it is good or
    doubtful, 3 if it is failed, 1 after an error and 2 after a wrong option.
    """
    from ..runs.config import readConfig
    from ..runs.studies import run as runConfig

    settings = readConfig(config)
    _override(settings.platform, name=platform, threads=threads)
    _override(settings.sampling, seed=seed, steps=steps)
    _override(settings.output, prefix=output, overwrite=overwrite or None)
    report(lambda progress: runConfig(settings, progress), quiet, acceptAnything)


@app.command(epilog="Example: openmm-helfrich resume results/cell --steps 5000")
@friendly
def resume(
    prefix: Annotated[
        Path,
        typer.Argument(metavar="PREFIX|FILE", help="Folder and first part of the names of the run's files, or one."),
    ],
    steps: Annotated[
        int | None, typer.Option(min=1, help="Make so many more Monte Carlo steps than were asked for.")
    ] = None,
    platform: Platform = None,
    threads: Threads = None,
    acceptAnything: AcceptAnything = False,
    quiet: Quiet = False,
) -> None:
    """Go on with a run that was stopped or killed, or make more steps.

    The files become what they would be if the run had never been stopped, to the last byte.  The exit codes are those
    of run; a complete run that failed says its verdict again.
    """
    from ..runs.studies import CompleteError, resume as resumeRun

    def work(progress: "RunProgress") -> "Summary":
        return resumeRun(prefix, steps, progress, platform, threads)

    try:
        report(work, quiet, acceptAnything)
    except CompleteError as error:
        if acceptAnything or error.verdict is None or error.verdict.level != "failed":
            raise
        say(str(error))
        raise typer.Exit(FAILED_VERDICT) from None


@app.command(epilog="Example: openmm-helfrich config > vesicle.toml")
@friendly
def config(
    fromTrimem: Annotated[
        Path | None,
        typer.Option("--from-trimem", metavar="FILE.inp", help="Convert a configuration of TriMem instead."),
    ] = None,
) -> None:
    """Print a configuration file with every key, its default, and the reason for it."""
    from ..runs.configfile import defaultText

    if fromTrimem is None:
        print(defaultText(), end="")
        return
    from ..runs.trimem import convertConfig

    print(convertConfig(fromTrimem), end="")


def _override(section: Any, **values: Any) -> None:
    for name, value in values.items():
        if value is not None:
            setattr(section, name, value)


def report(work: Callable[["RunProgress"], "Summary"], quiet: bool, acceptAnything: bool) -> None:
    """Do a run with its progress shown, and print its summary.

    A run that was stopped ends the command as the signal would have.  A failed verdict is an error, also when all is
    quiet.
    """
    from ..runs.progress import RunProgress

    with RunProgress(quiet) as progress:
        summary = work(progress)
    if not quiet:
        show(summary.lines())
    if summary.interrupted:
        raise typer.Exit(128 + (summary.signal or signal.SIGINT))
    if summary.verdict is not None and summary.verdict.level == "failed":
        if quiet:
            say(f"{summary.outputs.prefix}: the verdict is {summary.verdict}")
        if not acceptAnything:
            raise typer.Exit(FAILED_VERDICT)
