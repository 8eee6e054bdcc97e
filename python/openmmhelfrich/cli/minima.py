"""The command that compares minimum shapes with those of the continuum."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .errors import friendly

if TYPE_CHECKING:  # cli starts without what simulates
    from ..analysis.convergence import DiscreteMinimum

app = typer.Typer()

_HEADER = "branch          v  vertices    E/8πκ   axisym.    error       Δa  axisym.  inscribed v   tether   s  end"


@app.command(epilog="Example: openmm-helfrich minima --branch prolate --vertices 642 --vertices 2562")
@friendly
def minima(
    branch: Annotated[
        list[str] | None,
        typer.Option(help="prolate, oblate or stomatocyte; may be given several times. By default all."),
    ] = None,
    volume: Annotated[
        list[float] | None,
        typer.Option(
            help="A reduced volume; may be given several times. By default 0.5 to 0.9, as far as the branch goes."
        ),
    ] = None,
    vertices: Annotated[
        list[int] | None,
        typer.Option(min=12, metavar="N", help="A number of vertices; may be given several times. By default 642."),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(min=1e-6, metavar="X", help="Factor on the default tolerance of the forces.")
    ] = 1.0,
    out: Annotated[Path | None, typer.Option(metavar="FILE.csv", help="Write the table to a file as well.")] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the shapes of fewest vertices: .png, .pdf or .svg.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")] = False,
) -> None:
    """Minimize vesicles, and compare bending energy and area difference with axisymmetric minima.

    Prints a line for each minimum.  After several numbers of vertices it prints the orders in 1/N with which the error
    of the energy falls from one to the next, and the energy that the last two tell of infinitely many vertices.
    """
    from ..analysis.convergence import discreteMinimum
    from ..io.conversion import requireNew

    requireNew([file for file in (out, picture) if file], Path(), overwrite)
    points, sizes, found = _points(branch, volume), sorted(set(vertices or [642])), []
    print(_HEADER)
    for branchName, v in points:
        series = []
        for number in sizes:
            series.append(discreteMinimum(branchName, v, number, tolerance))
            print(_line(series[-1]), flush=True)
        if len(series) > 1:
            print(_convergence(series))
        found.append(series)
        if out:  # after every series, so that what is known is not lost
            _write(out, found)
    if picture:
        from ..pictures.sections import plotSections

        plotSections([series[0] for series in found], picture)


def _points(branches: list[str] | None, volumes: list[float] | None) -> list[tuple[str, float]]:
    """Return the branches and reduced volumes that were asked for; of all branches those that reach a volume."""
    from ..analysis.convergence import REDUCED_VOLUMES
    from ..geometry.axisymmetric import requireBranch

    points = [
        (name, v)
        for name in branches or REDUCED_VOLUMES
        for v in volumes or REDUCED_VOLUMES.get(name, (0.6,))
        if branches or name != "stomatocyte" or v <= max(REDUCED_VOLUMES[name])
    ]
    for point in points:
        requireBranch(*point)
    return points


def _line(m: "DiscreteMinimum") -> str:
    row = m.row()
    return (
        f"{m.branch:12} {m.reducedVolume:4g} {m.numVertices:9}  {m.energy:7.5f}   {m.continuum.energy:7.5f}  "
        f"{m.energyError:+7.2%}  {m.areaDifference:7.4f}  {m.continuum.areaDifference:7.4f}"
        f"  {m.inscribedVolume:11.5f}  {row['tether']:7.1e}  {m.seconds:2.0f}  {m.result.reason}"
    )


def _convergence(series: list["DiscreteMinimum"]) -> str:
    from ..analysis.convergence import extrapolatedEnergy, orderOfConvergence

    orders = [f"{orderOfConvergence(*pair):.2f}" for pair in itertools.pairwise(series)]
    energy, exact = extrapolatedEnergy(*series[-2:]), series[0].continuum.energy
    return (
        f"{'':18}order in 1/N: {', '.join(orders)};  extrapolated E/8πκ {energy:.5f}, error {energy / exact - 1:+.2%}"
    )


def _write(out: Path, found: list[list["DiscreteMinimum"]]) -> None:
    import csv

    from ..files import replacing

    rows = [m.row() for series in found for m in series]
    with replacing(out) as part, open(part, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
