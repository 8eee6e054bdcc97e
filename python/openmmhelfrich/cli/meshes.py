"""Commands that change meshes."""

from pathlib import Path
from typing import Annotated

import typer

from .errors import friendly

app = typer.Typer()


@app.command()
@friendly
def repair(
    source: Annotated[Path, typer.Argument(metavar="IN", help="The mesh file to mend.")],
    output: Annotated[Path, typer.Argument(metavar="OUT", help="The mesh file to write.")],
    reverse: Annotated[
        bool, typer.Option("--reverse", help="Turn all facets round, instead of turning surfaces outwards.")
    ] = False,
    keep: Annotated[
        list[int] | None,
        typer.Option(metavar="K", help="Keep this surface only, from 0 in the order of the file; may be repeated."),
    ] = None,
    smallest: Annotated[
        float, typer.Option(metavar="X", help="Leave out surfaces with less than this part of the largest one's area.")
    ] = 0.01,
    tolerance: Annotated[
        float, typer.Option(metavar="X", help="Weld corners of open edges this close, in parts of the usual edge.")
    ] = 1e-3,
    box: Annotated[
        str | None, typer.Option(metavar="L|X,Y,Z", help="Lengths of the periodic box, to unfold the surface.")
    ] = None,
    closeHoles: Annotated[bool, typer.Option("--close-holes", help="Close holes with flat fans of triangles.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file that exists.")] = False,
) -> None:
    """Mend the faults that files of meshes have, and say each thing that was done.

    Welds corners, divides faces of more than three corners, takes away facets that have no area or lie on another,
    turns surfaces outwards, parts sheets that touch, leaves out specks, unfolds what is folded into a periodic box, and
    names holes.  Ends with exit code 1 if what is left cannot be simulated, and says why; the file is written all the
    same.

    Examples:

    openmm-helfrich repair cell.stl cell_repaired.stl

    openmm-helfrich repair segmentation.ply cell.ply --keep 0 --close-holes
    """
    from ..geometry.mesh import Mesh
    from ..geometry.meshfiles import requireWritten
    from ..geometry.quality import MeshQuality
    from ..io.conversion import requireNew
    from ..runs.readiness import overlap

    requireWritten(output)
    requireNew([output], source, overwrite)
    mesh = Mesh.read(source)
    try:
        mended = mesh.repaired(tolerance, smallest, keep or None, _lengths(box), closeHoles, reverse)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
    mended.write(output)
    for note in mended.notes or ["nothing was to be mended"]:
        print(note)
    print(f"{output}: {len(mended.vertices)} vertices, {len(mended.triangles)} triangles")
    try:
        mended.check()
    except ValueError as error:
        raise ValueError(f"{output} is written, but cannot be simulated: {error}") from None
    quality = MeshQuality(mended)
    problem, copied = overlap(quality), quality.copied("")
    if problem is not None:
        also = f"; {copied}" if copied else ""
        raise ValueError(f"{output} is written, but cannot be simulated: {problem}{also}")
    if copied is not None:
        print(copied)


def _lengths(text: str | None) -> list[float] | None:
    """Return the lengths of a box from a command's option."""
    if text is None:
        return None
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise ValueError(f"--box is '{text}'; it must be one number, or three like 4,4,6") from None
