"""The command openmm-helfrich."""
import sys
from pathlib import Path
from typing import Annotated, Optional

import openmm as mm
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

app = typer.Typer(no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False,
                  help="Simulate fluid membranes with OpenMM.", context_settings={"help_option_names": ["-h", "--help"]})


@app.callback(invoke_without_command=True)
def _main(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False):
    if version:
        from . import __version__
        print(f"openmm-helfrich {__version__}, OpenMM {mm.Platform.getOpenMMVersion()}")
        raise typer.Exit()


@app.command()
def run(config: Annotated[Path, typer.Argument(metavar="CONFIG.toml", help="The configuration of the run.")],
        platform: Annotated[Optional[str], typer.Option(help="OpenMM platform: CPU or Reference.")] = None,
        threads: Annotated[Optional[int], typer.Option(min=1, help="Threads of the CPU platform.")] = None,
        seed: Annotated[Optional[int], typer.Option(min=1, max=2**31-1, help="Seed of all random numbers.")] = None,
        steps: Annotated[Optional[int], typer.Option(min=1, help="Number of Monte Carlo steps.")] = None,
        output: Annotated[Optional[str], typer.Option(metavar="PREFIX", help="Folder and first part of the names of all results.")] = None,
        overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the results of an earlier run.")] = False,
        quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False):
    """Sample the membrane that a configuration describes.

    Writes a trajectory (DCD), its topology (PSF), a table of observables (CSV), the final mesh, and two pictures (PNG).  Options take the place
    of the configuration's values.

    Example: openmm-helfrich run examples/red_blood_cell.toml --output results/cell
    """
    from .config import readConfig
    from .run import run as runConfig

    def work():
        settings = readConfig(config)
        _override(settings.platform, name=platform, threads=threads)
        _override(settings.sampling, seed=seed, steps=steps)
        _override(settings.output, prefix=output, overwrite=overwrite or None)
        with _Progress(settings.sampling.steps, quiet) as progress:
            return runConfig(settings, progress)
    summary = _friendly(work)
    if not quiet:
        for label, text in summary.lines():
            print(f"{label:>15}  {text}")


def main():
    """Run the command."""
    app()


def _override(section, **values):
    for name, value in values.items():
        if value is not None:
            setattr(section, name, value)


def _friendly(work):
    """Do some work; what the user can put right ends the command with a sentence instead of a traceback."""
    try:
        return work()
    except (ValueError, OSError, mm.OpenMMException) as error:
        for line in str(error).splitlines():
            print(f"openmm-helfrich: {line}", file=sys.stderr)
        raise typer.Exit(1)


class _Progress:
    """A bar on a terminal, ten plain lines elsewhere, nothing when quiet.  Called with the Simulation and its observables."""

    def __init__(self, steps, quiet):
        self._steps, self._quiet, self._printed = steps, quiet, 0
        columns = (TextColumn("sampling"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.fields[text]}"))
        console = Console(stderr=True)
        self._bar = Progress(*columns, console=console) if console.is_terminal and not quiet else None

    def __enter__(self):
        if self._bar:
            self._bar.start()
            self._task = self._bar.add_task("", total=self._steps, text="")
        return self

    def __exit__(self, *_):
        if self._bar:
            self._bar.stop()

    def __call__(self, simulation, row):
        step, text = row["step"], f"energy {row['energy (kT)']:.0f} kT, accepted {row['acceptance']:.0%}, flips {row['flipAcceptance']:.0%}"
        if self._bar:
            self._bar.update(self._task, completed=step, text=text)
        elif not self._quiet and 10*step//self._steps > self._printed:
            self._printed = 10*step//self._steps
            print(f"step {step} of {self._steps}: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
