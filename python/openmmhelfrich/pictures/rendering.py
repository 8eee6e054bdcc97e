"""Pictures and films of membranes in 3D, off screen, with pyvista where there is one."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..files import PathLike, replacing, replacingAtOnce
from ..geometry.mesh import Mesh
from ..io.vtkhdf import MeshFrame
from ..optional import require
from .curvature import unwrappedSurface
from .look import BEAD_COLOR, LOOK, Look, curvatureLabel, speciesColors, speciesCount, speciesLegend, unitText
from .plots import beadRadius, drawMesh

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
VIEW_ANGLE, DISTANCE = 30, 4.7  # degrees; of the camera, in radii of what it sees


def render(
    frames: Sequence[MeshFrame],
    file: PathLike,
    lengthUnit: str = "nm",
    framesPerSecond: float = 10.0,
    look: Look = LOOK,
) -> None:
    """Render membranes and their beads, colored by mean curvature, positive where they are convex, on the same scale in
    all frames, or by species.

    Parameters
    ----------
    frames : sequence of MeshFrame
        what to show.  A still picture shows the last; an animation all.  They are read more than once
    file : path
        the picture to write: .png or .jpg, or .gif or .mp4 for an animation.  Without pyvista or OpenGL a .png is drawn
        with matplotlib instead
    lengthUnit : str
        the name of the unit of length
    framesPerSecond : float
        of an animation
    look : Look
        how to draw them

    Raises
    ------
    ValueError
        if the suffix is another, or a library that this takes is not there; it names the library
    """
    suffix = Path(file).suffix.lower()
    requireFormat(file)
    if look.transparent and suffix != ".png":
        raise ValueError(f"{file}: only a .png has a transparent background")
    if suffix == ".mp4" and any(n % 2 for n in look.size):
        raise ValueError(f"{file}: the size of an .mp4 is {look.size[0]} by {look.size[1]} pixels; both must be even")
    if not len(frames):
        raise ValueError(f"{file}: there are no frames to show")
    if suffix == ".png" and not look.cut and not canRender():
        drawMesh(frames[len(frames) - 1].mesh, file, lengthUnit, look)
        return
    isFilm = suffix in FILMS
    images = _images(frames if isFilm else [frames[len(frames) - 1]], lengthUnit, look)
    if isFilm:
        write = _writeGIF if suffix == ".gif" else _writeMP4
        write(images, file, framesPerSecond)
    else:
        _save(next(images), file, look.dpi)


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


def _images(frames: Sequence[MeshFrame], lengthUnit: str, look: Look) -> Iterator[np.ndarray]:
    """Yield the picture of each frame as an array of bytes (height, width, 3), or 4 with a transparent background."""
    pyvista = _requirePyvista()
    middle, radius, curvatures, count = _bounds(frames)
    limits = look.limits(curvatures)
    # VTK warns of every way to draw that it tries before the one that works.
    pyvista.vtk_verbosity("error")
    plotter = pyvista.Plotter(off_screen=True, window_size=look.size, lighting="three lights")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    direction = _direction(np.radians(look.elevation), np.radians(look.azimuth))
    _aim(plotter, middle, radius, direction, look)
    title, scale = curvatureLabel(lengthUnit), min(look.size[0] / 1024, look.size[1] / 768)
    try:
        for i in range(len(frames)):
            mesh, curvature = unwrappedSurface(frames[i].mesh)
            shape = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
            species = look.species(mesh)
            shape[title] = curvature if species is None else speciesColors(species, count)
            shape = shape.clip(normal=direction, origin=middle) if look.cut else shape
            plotter.add_mesh(
                shape,
                name="membrane",
                scalars=title,
                **({"clim": limits, "cmap": look.colorMap} if species is None else {"rgb": True}),
                show_edges=look.edges,
                line_width=max(1.0, scale),
                smooth_shading=True,
                ambient=0.3,
                diffuse=0.65,
                reset_camera=False,
                show_scalar_bar=False,
            )
            if i == 0:
                sizes = {"title_font_size": round(18 * scale), "label_font_size": round(16 * scale)}
                if species is None:
                    plotter.add_scalar_bar(title + "\n", **sizes, **SCALE)
                else:
                    plotter.add_legend(speciesLegend(mesh, count), bcolor=None, face="circle", size=(0.2, 0.2))
            _addBeads(plotter, pyvista, mesh, middle, direction, look)
            if len(frames) > 1:
                place, letters = (20 * scale, look.size[1] - 40 * scale), round(12 * scale)
                step = f"step {frames[i].step}"
                plotter.add_text(step, position=place, name="step", color="black", font_size=letters)
            image = plotter.screenshot(return_img=True, transparent_background=look.transparent)
            image = _withoutWhite(image) if look.transparent else image
            yield _withScaleBar(image, 2 * plotter.camera.parallel_scale, lengthUnit, look) if look.scaleBar else image
    finally:
        plotter.close()


def _withoutWhite(image: np.ndarray) -> np.ndarray:
    """Return a transparent picture whose colors are not mixed with the white of the background, as VTK has them where a
    pixel is partly covered: on white it would be added again, and elsewhere it would show.
    """
    color, alpha = image[..., :3].astype(float), image[..., 3:].astype(float)
    own = 255 * (color - (255 - alpha)) / np.maximum(alpha, 1)
    return np.concatenate((np.clip(np.rint(own), 0, 255).astype(np.uint8), image[..., 3:]), axis=-1)


def _addBeads(plotter: Any, pyvista: Any, mesh: Mesh, middle: np.ndarray, direction: np.ndarray, look: Look) -> None:
    """Draw the beads as spheres, but for those that are cut away."""
    shown = mesh.beads[(mesh.beads - middle) @ direction <= 0] if look.cut else mesh.beads
    if len(shown):
        ball = pyvista.Sphere(radius=beadRadius(mesh), theta_resolution=16, phi_resolution=16)
        spheres = pyvista.PolyData(shown).glyph(geom=ball, scale=False, orient=False)
        gray = [float(BEAD_COLOR)] * 3
        plotter.add_mesh(spheres, name="beads", color=gray, smooth_shading=True, reset_camera=False)


def _withScaleBar(image: np.ndarray, height: float, lengthUnit: str, look: Look) -> np.ndarray:
    """Return a picture of something so high, in nm, with a bar of a length."""
    from matplotlib import font_manager
    from PIL import Image, ImageDraw, ImageFont

    perPixel, scale = height / image.shape[0], look.size[1] / 768
    length = look.barLength(image.shape[1] * perPixel)
    picture = Image.fromarray(image)
    drawing, font = ImageDraw.Draw(picture), ImageFont.truetype(font_manager.findfont("DejaVu Sans"), 18 * scale)
    x, y, black = 40 * scale, image.shape[0] - 40 * scale, (0, 0, 0, 255)[: image.shape[2]]
    drawing.rectangle((x, y, x + length / perPixel, y + 6 * scale), fill=black)
    label = f"{length:g} {unitText(lengthUnit)}"
    drawing.text((x + length / perPixel / 2, y - 4 * scale), label, fill=black, font=font, anchor="mb")
    return np.asarray(picture)


def _bounds(frames: Sequence[MeshFrame]) -> tuple[np.ndarray, float, np.ndarray, int]:
    """Return the middle and the radius of a sphere around all frames, the curvatures that set the colors: those of the
    frame that has the largest, but for the outermost hundredth; and the number of species.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    curvatures, bound, count = np.zeros(1), -1.0, 0
    for i in range(len(frames)):
        mesh, found = unwrappedSurface(frames[i].mesh)
        points = _pointsOf(mesh)
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        count = max(count, speciesCount(mesh))
        if (own := float(np.quantile(np.abs(found), 0.99))) > bound:
            curvatures, bound = found, own
    middle = (low + high) / 2
    distances = (
        np.linalg.norm(_pointsOf(frames[i].mesh.unwrapped()) - middle, axis=1).max() for i in range(len(frames))
    )
    return middle, max(distances), curvatures, count


def _pointsOf(mesh: Mesh) -> np.ndarray:
    return np.concatenate((mesh.vertices, mesh.beads))


def _direction(elevation: float, azimuth: float) -> np.ndarray:
    """Return the unit vector towards the viewer."""
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def _aim(plotter: Any, middle: np.ndarray, radius: float, direction: np.ndarray, look: Look) -> None:
    """Let the camera see a sphere, above the scale of colors."""
    camera = plotter.camera
    camera.focal_point, camera.position = middle, middle + DISTANCE * radius * direction
    camera.SetWindowCenter(0, -0.14)
    camera.up = (0, 0, 1) if abs(direction[2]) < 0.99 else (0, 1, 0)
    camera.view_angle = min(VIEW_ANGLE / look.zoom, 170)
    if look.scaleBar:
        plotter.enable_parallel_projection()
        camera.parallel_scale = DISTANCE * radius * np.tan(np.radians(VIEW_ANGLE / 2)) / look.zoom
    camera.clipping_range = (3.5 * radius, 6 * radius)


def _save(image: np.ndarray, file: PathLike, dpi: float) -> None:
    from PIL import Image

    with replacingAtOnce(file) as content:
        Image.fromarray(image).save(content, Image.registered_extensions()[Path(file).suffix.lower()], dpi=(dpi, dpi))


def _writeGIF(images: Iterable[np.ndarray], file: PathLike, framesPerSecond: float) -> None:
    from PIL import Image

    first, *others = [Image.fromarray(image) for image in images]
    first = first.quantize(256)
    others = [image.quantize(palette=first) for image in others]
    with replacingAtOnce(file) as content:
        first.save(content, "GIF", save_all=True, append_images=others, duration=round(1000 / framesPerSecond), loop=0)


def _writeMP4(images: Iterable[np.ndarray], file: PathLike, framesPerSecond: float) -> None:
    """Write a film by ffmpeg, whose errors the library does not tell: the frames of the film are counted."""
    imageio = require("imageio.v2", "writing MP4 films")
    ffmpeg = require("imageio_ffmpeg", "writing MP4 films")
    options = {"macro_block_size": 2, "quality": 8, "ffmpeg_log_level": "quiet"}
    count, written = 0, 0
    with replacing(file) as part:
        with imageio.get_writer(str(part), fps=framesPerSecond, **options) as film:
            for image in images:
                count += 1
                with contextlib.suppress(OSError):  # ffmpeg has ended
                    film.append_data(image)
        with contextlib.suppress(OSError, RuntimeError):
            written, _ = ffmpeg.count_frames_and_secs(str(part))
        if written != count:
            raise OSError(f"{file}: of {count} frames ffmpeg wrote {written}; the disk may be full")
