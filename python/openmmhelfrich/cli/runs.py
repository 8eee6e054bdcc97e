"""Commands that simulate."""
from pathlib import Path
from typing import Annotated, Optional

import typer

from .errors import friendly

app = typer.Typer()


@app.command()
@friendly
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
    from ..config import readConfig
    from ..studies import run as runConfig
    from .progress import Progress
    settings = readConfig(config)
    _override(settings.platform, name=platform, threads=threads)
    _override(settings.sampling, seed=seed, steps=steps)
    _override(settings.output, prefix=output, overwrite=overwrite or None)
    with Progress(settings.sampling.steps, quiet) as progress:
        summary = runConfig(settings, progress)
    if not quiet:
        for label, text in summary.lines():
            print(f"{label:>15}  {text}")


def _override(section, **values):
    for name, value in values.items():
        if value is not None:
            setattr(section, name, value)
