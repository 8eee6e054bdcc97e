"""TriMem's command, for programs that call it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .errors import friendly
from .runs import report
from .terminal import say

if TYPE_CHECKING:
    from ..runs.progress import RunProgress
    from ..runs.summary import Summary

app = typer.Typer()
trimem = typer.Typer(no_args_is_help=True, help="What TriMem's command mc_app does, for programs that call it.")
app.add_typer(trimem, name="mc-app")


@trimem.callback()
def _group() -> None:
    """Keep run a command of its own."""


@trimem.command(epilog="Example: openmm-helfrich mc-app run --conf inp.conf")
@friendly
def run(
    conf: Annotated[Path, typer.Option(metavar="FILE", help="TriMem's configuration.")],
    restart: Annotated[bool, typer.Option("--restart", help="Begin with the shape of a checkpoint.")] = False,
    number: Annotated[
        int | None, typer.Argument(metavar="N", min=0, help="Of the checkpoint to restart from: the last by default.")
    ] = None,
) -> None:
    """Do what a configuration of TriMem asks for, and write the checkpoint that TriMem writes beside our own files.

    PREFIX.cpt.p0.h5 has the mesh (points, cells), PREFIX.p0.cpt names it; a restart writes p1, p2 and so on.  Files of
    an earlier run get the names #NAME.B#, unless it is a restart.

    The exit code is 0 at the end of the run, as TriMem's is, whatever the verdict; 1 after an error, 2 after a wrong
    option, 130 or 143 if it was stopped.
    """
    from ..runs.mcapp import LAST, runLikeTriMem

    if number is not None and not restart:
        raise typer.BadParameter(f"{number} is the number of a checkpoint, and goes with --restart", param_hint="N")
    begin = (LAST if number is None else number) if restart else None

    def work(progress: "RunProgress") -> "Summary":
        return runLikeTriMem(conf, begin, progress, say)

    report(work, quiet=False, acceptAnything=True)
