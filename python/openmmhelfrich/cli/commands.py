"""All commands."""

from typing import Annotated

import typer

from ..version import __version__
from . import info, mcapp, meshes, minima, runs, shapes, sweeps, tradeoff

app = typer.Typer(
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    help="Simulate fluid membranes with OpenMM.",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(runs.app)
app.add_typer(mcapp.app)
app.add_typer(sweeps.app)
app.add_typer(meshes.app)
app.add_typer(shapes.app)
app.add_typer(minima.app)
app.add_typer(tradeoff.app)
app.add_typer(info.app)


@app.callback(invoke_without_command=True)
def _main(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        import openmm as mm

        print(f"openmm-helfrich {__version__}, OpenMM {mm.Platform.getOpenMMVersion()}")
        raise typer.Exit()
