"""Pictures: the observables of a run against its steps, and a membrane's shape coloured by mean curvature."""

import threading

import numpy as np

_drawing = threading.Lock()  # matplotlib reads formulas in one thread at a time

# matplotlib is imported where it is used: scripts that draw nothing start faster.  Figures are made without pyplot, so that no display
# is needed and no setting of the caller's is touched.


def plotObservables(table, file, lengthUnit="nm", energyUnit="kT"):
    """Plot energies, area, volume and acceptance rates against steps, and the temperature if it changes.

    Parameters
    ----------
    table : dict
        the columns, as :func:`readObservables` returns them
    file : path
        the picture to write; its suffix tells the format
    lengthUnit, energyUnit : str
        names for the axes
    """
    from matplotlib.figure import Figure

    steps, hasTemperatures = table["step"], "temperature" in table and np.ptp(table["temperature"]) > 0
    figure = Figure(figsize=(8, 11 if hasTemperatures else 9), layout="constrained")
    energies, area, volume, rates, *more = figure.subplots(4 + hasTemperatures, 1, sharex=True)
    _plotEnergies(energies, steps, table, energyUnit)
    area.plot(steps, table["area"], color="C0")
    area.set_ylabel(f"area ({lengthUnit}$^2$)")
    _plotTarget(area, steps, table, "targetArea")
    _plotReducedVolume(volume, steps, table, lengthUnit)
    _plotTarget(volume, steps, table, "targetVolume")
    for name, label in (("acceptance", "trajectories"), ("flipAcceptance", "flips")):
        if name in table:
            rates.plot(steps, table[name], label=label)
    rates.set(ylabel="acceptance so far", ylim=(0, 1))
    if rates.lines:
        rates.legend(fontsize="small")
    for axes in more:
        axes.plot(steps, table["temperature"], color="C3")
        axes.set_ylabel("temperature (K)")
    (more or [rates])[-1].set_xlabel("Monte Carlo step")
    for axes in (area, volume):
        axes.ticklabel_format(useOffset=False)
    _save(figure, file)


def _plotEnergies(axes, steps, table, energyUnit):
    for name, values in table.items():
        if name == "energy":
            axes.plot(steps, values, color="black", label="total")
        elif name.startswith("E_") and np.any(values):
            axes.plot(steps, values, lw=1, label=name[2:])
    axes.set_ylabel(f"energy ({energyUnit})")
    axes.legend(fontsize="small", ncols=3)


def _plotTarget(axes, steps, table, name):
    if name in table:
        axes.plot(steps, table[name], color="0.5", ls="--", lw=1, zorder=0)


def _plotReducedVolume(axes, steps, table, lengthUnit):
    axes.plot(steps, table["volume"], color="C1")
    axes.set_ylabel(f"volume ({lengthUnit}$^3$)", color="C1")
    twin = axes.twinx()
    twin.plot(steps, table["reducedVolume"], color="C2", lw=1)
    twin.set_ylabel("reduced volume", color="C2")
    twin.ticklabel_format(useOffset=False)


def plotPath(windows, file, lengthUnit="nm", energyUnit="kT"):
    """Plot the average energy and shape in each window of a continuation against lambda, the ways there and back apart.

    Parameters
    ----------
    windows : Table
        the averages, as :func:`averageWindows` returns them
    file : path
        the picture to write; its suffix tells the format
    lengthUnit, energyUnit : str
        names for the axes
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 7), layout="constrained")
    quantities = (
        ("E_bending", f"bending energy ({energyUnit})"),
        ("reducedVolume", "reduced volume"),
        ("areaDifference", f"area difference ({lengthUnit}$^2$)"),
    )
    for axes, (name, label) in zip(figure.subplots(len(quantities), 1, sharex=True), quantities):
        for stage in np.unique(windows["stage"]) if "stage" in windows else [None]:
            _plotBranches(
                axes,
                windows if stage is None else windows.where(windows["stage"] == stage),
                name,
                "" if stage is None else f"stage {stage:.0f}, ",
            )
        axes.set_ylabel(label)
        axes.ticklabel_format(useOffset=False)
        if axes.lines:
            axes.legend(fontsize="small")
    axes.set_xlabel("$\\lambda$; bars are standard deviations")
    _save(figure, file)


def _plotBranches(axes, windows, name, prefix):
    last = int(np.argmax(windows["lambda"]))
    for part, style, text in ((slice(last + 1), "o-", "there"), (slice(last, None), "s--", "back")):
        if windows["lambda"][part].size > 1:
            axes.errorbar(
                windows["lambda"][part],
                windows[name][part],
                windows[name + "Deviation"][part],
                fmt=style,
                capsize=3,
                label=prefix + text,
            )


def drawMesh(mesh, file, lengthUnit="nm", elevation=30, azimuth=-60):
    """Draw a closed mesh, lit from above the viewer's shoulder and coloured by mean curvature, positive where it is convex.

    Parameters
    ----------
    mesh : Mesh
        what to draw
    file : path
        the picture to write; its suffix tells the format
    lengthUnit : str
        the name of the unit of length
    elevation, azimuth : float
        direction of view, in degrees
    """
    from matplotlib.colors import LightSource, TwoSlopeNorm
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    curvature = smoothMeanCurvature(mesh)
    bound = max(np.quantile(np.abs(curvature), 0.99), 1e-12)
    norm = TwoSlopeNorm(0, -bound, bound)
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    colours = _colourMap()(norm(curvature[mesh.triangles].mean(axis=1)))
    # Edges of the triangles' own colour hide the seams between them.
    axes.add_collection3d(
        Poly3DCollection(
            mesh.vertices[mesh.triangles],
            facecolors=colours,
            edgecolors=colours,
            linewidths=0.3,
            shade=True,
            lightsource=LightSource(azdeg=120 - azimuth, altdeg=50),
        )
    )
    _frame(axes, mesh.vertices, elevation, azimuth, lengthUnit)
    _colourBar(figure, axes, norm, lengthUnit)
    _save(figure, file)


def smoothMeanCurvature(mesh, rounds=2):
    """Return the mean curvature at each vertex, in 1/nm, averaged over its neighbourhood.

    The curvature of single vertices of a fluctuating membrane is mostly noise, in which its shape would not be seen.
    """
    a, b = mesh.edges.T
    curvature, area = mesh.vertexMeanCurvatures, mesh.vertexAreas
    for _ in range(rounds):
        curvature, area = (x + np.bincount(a, x[b], len(x)) + np.bincount(b, x[a], len(x)) for x in (curvature, area))
    return curvature / area


def _colourMap():
    from matplotlib import colormaps

    return colormaps["coolwarm"]


def _save(figure, file):
    with _drawing:
        figure.savefig(file, dpi=120)


def _frame(axes, vertices, elevation, azimuth, lengthUnit):
    """Show all of the vertices at equal scales."""
    middle, size = (vertices.max(axis=0) + vertices.min(axis=0)) / 2, np.ptp(vertices, axis=0).max()
    for set_limits, centre in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle):
        set_limits(centre - size / 2, centre + size / 2)
    axes.set_box_aspect((1, 1, 1), zoom=1.3)
    axes.view_init(elevation, azimuth)
    axes.set_axis_off()
    axes.set_title(f"{size:.3g} {lengthUnit} across", y=0, fontsize="medium")


def _colourBar(figure, axes, norm, lengthUnit):
    from matplotlib.cm import ScalarMappable

    figure.colorbar(ScalarMappable(norm, _colourMap()), ax=axes, shrink=0.6, label=f"mean curvature (1/{lengthUnit})")
