"""Pictures and films of membranes in 3D, off screen, with pyvista where there is one."""

import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..files import PathLike, replacing
from ..io.vtkhdf import MeshFrame
from ..optional import require
from .curvature import smoothMeanCurvature
from .plots import drawMesh

STILL = (".png", ".jpg", ".jpeg")
FILMS = (".gif", ".mp4")
SCALE = {
    "color": "black",
    "n_labels": 5,
    "fmt": "{:.2g}",
    "vertical": False,
    "position_x": 0.3,
    "position_y": 0.02,
    "width": 0.4,
    "height": 0.09,
}
SIZE = (1024, 768)  # pixels; multiples of 16, which film formats want


def render(
    frames: Sequence[MeshFrame],
    file: PathLike,
    lengthUnit: str = "nm",
    elevation: float = 30.0,
    azimuth: float = 30.0,
    framesPerSecond: float = 10.0,
    cut: bool = False,
) -> None:
    """Render membranes, colored by mean curvature, positive where they are convex, on the same scale in all frames.

    Parameters
    ----------
    frames : sequence of MeshFrame
        what to show.  A still picture shows the last; an animation all.  They are read more than once
    file : path
        the picture to write: .png or .jpg, or .gif or .mp4 for an animation.  Without pyvista or OpenGL a .png is drawn
        with matplotlib instead
    lengthUnit : str
        the name of the unit of length
    elevation, azimuth : float
        direction of view, in degrees: above the xy plane, and around z from x
    framesPerSecond : float
        of an animation
    cut : bool
        leave out the half that is nearer to the viewer, to show what is inside

    Raises
    ------
    ValueError
        if the suffix is another, or a library that this takes is not there; it names the library
    """
    suffix = Path(file).suffix.lower()
    requireFormat(file)
    if not len(frames):
        raise ValueError(f"{file}: there are no frames to show")
    if suffix == ".png" and not cut and not canRender():
        drawMesh(frames[len(frames) - 1].mesh, file, lengthUnit, elevation, azimuth)
        return
    isFilm = suffix in FILMS
    images = _images(frames if isFilm else [frames[len(frames) - 1]], lengthUnit, elevation, azimuth, cut)
    if isFilm:
        write = _writeGIF if suffix == ".gif" else _writeMP4
        write(images, file, framesPerSecond)
    else:
        _save(next(images), file)


def requireFormat(file: PathLike) -> None:
    """Raise a ValueError unless the suffix of a file's name is that of a picture or film."""
    if Path(file).suffix.lower() not in STILL + FILMS:
        raise ValueError(
            f"{file}: no picture has the suffix '{Path(file).suffix}'; use one of {', '.join(STILL + FILMS)}"
        )


def canRender() -> bool:
    """Return whether there is all that drawing in 3D takes: pyvista, and an OpenGL library that works off screen."""
    try:
        _requirePyvista()
    except ValueError:
        return False
    return True


def _requirePyvista() -> Any:
    pyvista = require("pyvista", "rendering")
    if not _hasOpenGL():
        raise ValueError(
            "rendering needs an OpenGL library, libEGL or libOSMesa; Debian's packages are libegl1 and libosmesa6"
        )
    return pyvista


def _hasOpenGL() -> bool:
    """Return whether VTK will find something to draw with.  Where it does not, it ends the program."""
    if sys.platform != "linux" or os.environ.get("DISPLAY"):
        return True
    for name in ("libEGL.so.1", "libOSMesa.so", "libOSMesa.so.8"):
        try:
            ctypes.CDLL(name)
            return True
        except OSError:
            pass
    return False


def _images(
    frames: Sequence[MeshFrame], lengthUnit: str, elevation: float, azimuth: float, cut: bool
) -> Iterator[np.ndarray]:
    """Yield the picture of each frame as an array of bytes (height, width, 3)."""
    pyvista = _requirePyvista()
    middle, radius, bound = _bounds(frames)
    # VTK warns of every way to draw that it tries before the one that works.
    pyvista.vtk_verbosity("error")
    plotter = pyvista.Plotter(off_screen=True, window_size=SIZE, lighting="three lights")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    direction = _direction(np.radians(elevation), np.radians(azimuth))
    _aim(plotter, middle, radius, direction)
    title = f"mean curvature (1/{lengthUnit})"
    try:
        for i in range(len(frames)):
            mesh = frames[i].mesh
            shape = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
            shape[title] = smoothMeanCurvature(mesh)
            shape = shape.clip(normal=direction, origin=middle) if cut else shape
            plotter.add_mesh(
                shape,
                name="membrane",
                scalars=title,
                clim=(-bound, bound),
                cmap="coolwarm",
                smooth_shading=True,
                ambient=0.3,
                diffuse=0.65,
                reset_camera=False,
                show_scalar_bar=False,
            )
            if i == 0:
                plotter.add_scalar_bar(title + "\n", title_font_size=18, label_font_size=16, **SCALE)
            if len(frames) > 1:
                plotter.add_text(f"step {frames[i].step}", position=(20, 20), name="step", color="black", font_size=12)
            yield plotter.screenshot(return_img=True)
    finally:
        plotter.close()


def _bounds(frames: Sequence[MeshFrame]) -> tuple[np.ndarray, float, float]:
    """Return the middle and the radius of a sphere around all frames, and the largest curvature but for the outermost
    hundredth.
    """
    low, high, bound = np.full(3, np.inf), np.full(3, -np.inf), 1e-12
    for i in range(len(frames)):
        mesh = frames[i].mesh
        low, high = np.minimum(low, mesh.vertices.min(axis=0)), np.maximum(high, mesh.vertices.max(axis=0))
        bound = max(bound, np.quantile(np.abs(smoothMeanCurvature(mesh)), 0.99))
    middle = (low + high) / 2
    return (
        middle,
        max(np.linalg.norm(frames[i].mesh.vertices - middle, axis=1).max() for i in range(len(frames))),
        bound,
    )


def _direction(elevation: float, azimuth: float) -> np.ndarray:
    """Return the unit vector towards the viewer."""
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def _aim(plotter: Any, middle: np.ndarray, radius: float, direction: np.ndarray) -> None:
    """Let the camera see a sphere, above the scale of colors."""
    plotter.camera.focal_point, plotter.camera.position = middle, middle + 4.7 * radius * direction
    plotter.camera.SetWindowCenter(0, -0.14)
    plotter.camera.up = (0, 0, 1) if abs(direction[2]) < 0.99 else (0, 1, 0)
    plotter.camera.view_angle = 30
    plotter.camera.clipping_range = (3.5 * radius, 6 * radius)


def _save(image: np.ndarray, file: PathLike) -> None:
    from PIL import Image

    with replacing(file) as part:
        Image.fromarray(image).save(part)


def _writeGIF(images: Iterable[np.ndarray], file: PathLike, framesPerSecond: float) -> None:
    from PIL import Image

    first, *others = [Image.fromarray(image) for image in images]
    first = first.quantize(256)
    others = [image.quantize(palette=first) for image in others]
    with replacing(file) as part:
        first.save(part, "GIF", save_all=True, append_images=others, duration=round(1000 / framesPerSecond), loop=0)


def _writeMP4(images: Iterable[np.ndarray], file: PathLike, framesPerSecond: float) -> None:
    imageio = require("imageio.v2", "writing MP4 films")
    require("imageio_ffmpeg", "writing MP4 films")
    with (
        replacing(file) as part,
        imageio.get_writer(str(part), fps=framesPerSecond, macro_block_size=16, quality=8) as film,
    ):
        for image in images:
            film.append_data(image)
