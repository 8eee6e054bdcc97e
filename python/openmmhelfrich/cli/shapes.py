"""Commands that look at meshes and at the results of runs."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .errors import friendly
from .terminal import show

if TYPE_CHECKING:  # cli starts without what simulates
    from ..geometry.mesh import Mesh
    from ..runs.scene import Scene
    from ..runs.sections import MeshSection

app = typer.Typer()

Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
Frame = Annotated[int | None, typer.Option(metavar="N", help="One frame only, counted from 0; -1 is the last.")]
Every = Annotated[int, typer.Option(min=1, metavar="N", help="The first of every N frames.")]
Topology = Annotated[
    Path | None, typer.Option(metavar="FILE", help="What has the triangles of a DCD file: a mesh or a PSF file.")
]


@app.command()
@friendly
def check(
    mesh: Annotated[
        Path, typer.Argument(metavar="MESH", help="A mesh file: STL, PLY, OBJ, OFF, VTU, VTK, GMSH, glTF, TSI ...")
    ],
    scale: Annotated[
        float, typer.Option(min=0, metavar="X", help="Factor on the file's coordinates, as in the configuration.")
    ] = 1.0,
    length_unit: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="The unit of lengths, as in the configuration: nm, angstrom, um, '100 nm' ..."
        ),
    ] = None,
) -> None:
    """Describe a mesh, and say whether a run would sample it.

    Prints its topology, the statistics of edges, angles and aspect ratios, where it comes close to itself or passes
    through itself, area and volume, of each surface if there are several, and the tether's bounds and the step size
    that a run takes by default.  The verdict is "ready", or the commands after which it is; then the exit code is 1.

    Example: openmm-helfrich check cell.stl --length-unit angstrom
    """
    from ..geometry.mesh import Mesh
    from ..runs.readiness import coarse, readinessOf

    section = _meshSection(mesh, scale, length_unit)
    surface = Mesh.read(mesh, unit=section.scale)
    try:
        readiness = readinessOf(surface, mesh, section.length_unit)
    except ValueError as error:
        raise ValueError(f"{mesh}: {error}") from None
    quality, scene = readiness.quality, readiness.scene
    if quality is not None and scene is not None:
        show(quality.lines(section.length_unit) + _shapes(quality.surfaces) + _suggestions(scene))
        volumes = zip(quality.surfaces, quality.reducedVolumes)
        notes = (coarse(part, volume) for part, volume in volumes if volume is not None)
        show([("warning", note.advice()) for note in notes if note])
    show([("note", note) for note in surface.notes])
    if readiness.reason is None:
        show([("verdict", "ready")])
        return
    if not readiness.commands:
        raise ValueError(f"{mesh}: {readiness.reason}")
    repairs, verdict = (("repair", note) for note in readiness.notes), f"ready after{readiness.needs}"
    show([("reason", readiness.reason), *repairs, ("verdict", verdict)])
    print("\n".join(readiness.commands))
    raise typer.Exit(1)


@app.command()
@friendly
def remesh(
    source: Annotated[Path, typer.Argument(metavar="INPUT", help="A mesh file.")],
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="The mesh file to write, in any format.")],
    vertices: Annotated[int | None, typer.Option(metavar="N", help="The number of vertices.")] = None,
    edge_length: Annotated[
        float | None, typer.Option(metavar="L", help="Instead: the mean edge length, in the file's unit.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Make a mesh anew, with even triangles on the same surface.

    Prints by how much area, volume and surface have changed, and how even the edges are.  A warning says where the
    surface has features that are finer than the edges, which are then not kept.  Takes mmgpy and libigl, which come
    with pip install 'openmm-helfrich\\[remesh]'.

    Example: openmm-helfrich remesh cell.stl even.ply --vertices 2500
    """
    from ..geometry.mesh import Mesh
    from ..geometry.meshfiles import requireWritten
    from ..io.conversion import requireNew

    requireWritten(output)
    requireNew([output], source, overwrite)
    if (vertices is None) == (edge_length is None):
        raise ValueError("remesh: give one of --vertices and --edge-length")
    mesh = Mesh.read(source)
    with warnings.catch_warnings(record=True):  # they are among the notes
        try:
            mesh = mesh.remeshed(vertices, edge_length)
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from None
    mesh.write(output)
    for note in mesh.notes:
        print(note)
    print(output)


@app.command()
@friendly
def convert(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="INPUT", help="A mesh trajectory (.vtkhdf), a DCD file, a mesh, or the prefix of a run."
        ),
    ],
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUTPUT", help="What to write: .vtkhdf, .pvd, .vtu, .ply, .stl, .obj, .off, .vtk, .msh or .xyz."
        ),
    ],
    frame: Frame = None,
    every: Every = 1,
    topology: Topology = None,
    overwrite: Overwrite = False,
) -> None:
    """Convert trajectories and meshes.

    VTKHDF, PVD and XYZ files hold all frames; the other formats one, so that several frames become several files with
    numbers in their names.

    Examples:

    openmm-helfrich convert results/cell.vtkhdf last.ply --frame -1

    openmm-helfrich convert results/cell.vtkhdf cell.pvd --every 10

    openmm-helfrich convert results/cell.dcd last.stl --topology results/cell.ply --frame -1
    """
    from ..io.conversion import convert as convertFile
    from ..io.runfiles import shapesOf

    files = convertFile(shapesOf(source, topology), output, frame, every, topology, overwrite, print)
    print(f"{files[0]}" if len(files) == 1 else f"{len(files)} files: {files[0]} to {files[-1]}")


@app.command()
@friendly
def plot(
    source: Annotated[
        Path, typer.Argument(metavar="PREFIX|FILE", help="The prefix of a run or one of its files, or a table (.csv).")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="The picture: .png, .pdf or .svg; by default PREFIX_plot.png."
        ),
    ] = None,
    size: Annotated[
        tuple[float, float] | None, typer.Option(metavar="W H", help="Width and height, in inches.")
    ] = None,
    dpi: Annotated[float, typer.Option(min=1, max=10000, help="Pixels an inch, of a picture that has pixels.")] = 120.0,
    overwrite: Overwrite = False,
) -> None:
    """Plot energies by term, area, volume and acceptance against steps.

    Example: openmm-helfrich plot results/cell -o cell.pdf
    """
    from ..io.conversion import requireNew
    from ..io.runfiles import beside, prefixOf
    from ..pictures.plots import plotObservables, requirePlotFormat
    from ..sampling.observables import observableUnits, readObservables

    table = beside(prefixOf(source), ".csv")
    if not table.exists() and source.suffix.lower() == ".csv":
        table = source
    if not table.exists():
        raise FileNotFoundError(f"there is no table of observables {table}")
    output = output or table.with_name(table.stem + "_plot.png")
    requirePlotFormat(output)
    requireNew([output], table, overwrite)
    units = observableUnits(table)
    plotObservables(
        readObservables(table), output, units["area"].removesuffix("^2"), units["energy"], size=size, dpi=dpi
    )
    print(output)


@app.command()
@friendly
def render(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="PREFIX|FILE", help="The prefix of a run or one of its files, a .vtkhdf or DCD file, or a mesh."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="The picture: .png or .jpg, or .gif or .mp4 for an animation; by default FILE.png.",
        ),
    ] = None,
    frame: Frame = None,
    every: Every = 1,
    topology: Topology = None,
    elevation: Annotated[float, typer.Option(help="Direction of view: degrees above the xy plane.")] = 30.0,
    azimuth: Annotated[float, typer.Option(help="Direction of view: degrees around z, from x.")] = 30.0,
    zoom: Annotated[float, typer.Option(help="How much larger than to fill the picture.")] = 1.0,
    size: Annotated[tuple[int, int], typer.Option(metavar="W H", help="Width and height, in pixels.")] = (1024, 768),
    dpi: Annotated[float, typer.Option(help="Pixels an inch, which a picture tells its reader.")] = 150.0,
    color_range: Annotated[
        tuple[float, float] | None,
        typer.Option("--range", metavar="LOW HIGH", help="Curvatures at the ends of the color map."),
    ] = None,
    color_map: Annotated[str, typer.Option(metavar="NAME", help="A color map of matplotlib.")] = "coolwarm",
    color_by: Annotated[
        str, typer.Option(metavar="WHAT", help="curvature, species, or auto: species where there are some.")
    ] = "auto",
    edges: Annotated[bool, typer.Option("--edges", help="Draw the edges of triangles.")] = False,
    transparent: Annotated[bool, typer.Option("--transparent", help="Leave the background of a PNG out.")] = False,
    scale_bar: Annotated[
        bool, typer.Option("--scale-bar", help="Draw a bar of a round length; the view has no perspective then.")
    ] = False,
    bar_length: Annotated[
        float | None, typer.Option(min=0, metavar="L", help="Draw a scale bar of this length.")
    ] = None,
    cut: Annotated[
        bool, typer.Option("--cut", help="Leave out the half that is nearer to the viewer, to show what is inside.")
    ] = False,
    fps: Annotated[float, typer.Option(min=0.1, help="Frames per second of an animation.")] = 10.0,
    length_unit: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the unit of length; by default what the file says.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Render a membrane, colored by its mean curvature or its species: a picture of the last frame, or an animation of
    all.

    Works without a display.  Takes pyvista, which comes with pip install 'openmm-helfrich\\[looking]'; without it a PNG
    is drawn with matplotlib.

    Examples:

    openmm-helfrich render results/cell.vtkhdf -o cell.png

    openmm-helfrich render results/cell.vtkhdf -o cell.mp4 --every 2

    openmm-helfrich render results/stomatocyte.vtkhdf --cut --elevation 0

    openmm-helfrich render results/cell.vtkhdf --size 2400 1800 --dpi 300 --range -2 2 --scale-bar --transparent
    """
    from ..io.conversion import ChosenFrames, openFrames, requireNew, selectFrames
    from ..io.runfiles import shapesOf
    from ..pictures.look import Look
    from ..pictures.rendering import render as renderFrames, requireFormat

    source = shapesOf(source, topology)
    output = output or source.with_suffix(".png")
    requireFormat(output)
    bar = bar_length or scale_bar
    look = Look(elevation, azimuth, zoom, size, dpi, color_range, color_map, color_by, edges, transparent, bar, cut)
    requireNew([output], source, overwrite)
    frames = openFrames(source, topology)
    chosen = ChosenFrames(frames, selectFrames(source, frames, frame, every))
    lengthUnit = length_unit or str(getattr(frames, "lengthUnit", "nm"))
    renderFrames(chosen, output, lengthUnit, fps, look)
    print(output)


@app.command()
@friendly
def report(
    prefix: Annotated[Path, typer.Argument(metavar="PREFIX|FILE", help="The prefix of a run, or one of its files.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="The page; by default PREFIX_report.html.")
    ] = None,
    max_frames: Annotated[
        int, typer.Option(min=1, metavar="N", help="The largest number of frames, which are taken at equal distances.")
    ] = 101,
    overwrite: Overwrite = False,
) -> None:
    """Write a page about a run: its shape in 3D to turn and to play, observables, settings, versions and warnings.

    The page is one HTML file that opens offline in any browser.  Takes plotly, which comes with pip install
    'openmm-helfrich\\[looking]'.

    Example: openmm-helfrich report results/cell
    """
    from ..io.runfiles import beside, prefixOf
    from ..pictures.report import writeReport
    from ..runs.checkpoint import verdictOf

    prefix = prefixOf(prefix)
    page = writeReport(prefix, output, max_frames, overwrite, verdictOf(beside(prefix, ".checkpoint")))
    print(f"{page}, {page.stat().st_size / 1e6:.1f} MB")


def _shapes(surfaces: list["Mesh"]) -> list[tuple[str, str]]:
    """Return the shapes of several surfaces."""
    from ..analysis.description import classifyShape

    if len(surfaces) == 1:
        return []
    return [("shapes", ", ".join(f"surface {k} {classifyShape(surface)}" for k, surface in enumerate(surfaces)))]


def _meshSection(mesh: Path, scale: float, lengthUnit: str | None) -> "MeshSection":
    """Return the section of a configuration that has these values, and the same rules for them."""
    from ..runs.config import parseConfig

    given = {"file": str(mesh), "scale": scale} | ({} if lengthUnit is None else {"length_unit": lengthUnit})
    return parseConfig({"mesh": given}, "check").mesh


def _suggestions(scene: "Scene") -> list[tuple[str, str]]:
    """Return what a run does with a mesh by default."""
    bounds = f"min_length {scene.tether.minLength:.4g}, max_length {scene.tether.maxLength:.4g}"
    energy = f"modulus {scene.tether.modulus:.4g} kT, length_scale {scene.tether.lengthScale:.4g}"
    return [("tether", f"{bounds}, {energy} by default"), ("step size", f"{scene.stepSize:.3g} ps by default")]
