"""Pictures: what can be asked of them, and what they show."""

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import openmmhelfrich as mh
from openmmhelfrich.cli.commands import app
from openmmhelfrich.pictures.look import Look, colorScale, unitText
from openmmhelfrich.pictures.plots import drawMesh, observablesPicture
from openmmhelfrich.pictures.rendering import canRender, render
from openmmhelfrich.sampling.observables import PANELS, curves, shownValues
from openmmhelfrich.tables import Table

needs3D = pytest.mark.skipif(not canRender(), reason="there is no pyvista or no OpenGL")
SMALL = (320, 240)


def frame(beads=()):
    mesh = mh.Mesh.icosphere(2)
    return mh.MeshFrame(0, mh.Mesh(mesh.vertices, mesh.triangles, beads=np.reshape(beads, (-1, 3))), {})


def picture(tmp_path, look=None, beads=(), with3D=True, dpi=100):
    """Return what is drawn, as an array."""
    if with3D:
        render([frame(beads)], tmp_path / "a.png", "um", look=look or Look(size=SMALL))
    else:
        drawMesh(frame(beads).mesh, tmp_path / "a.png", "um", replace(look or Look(size=SMALL), dpi=dpi))
    return np.asarray(Image.open(tmp_path / "a.png"))


@pytest.fixture(params=[pytest.param(True, marks=needs3D, id="pyvista"), pytest.param(False, id="matplotlib")])
def with3D(request):
    return request.param


def grays(image):
    """Return the number of pixels that are dark and gray: beads, and letters."""
    colors = image[..., :3].astype(int)
    return int(((np.ptp(colors, axis=2) < 12) & (colors.max(axis=2) < 120)).sum())


def test_size_and_resolution_are_those_asked_for(tmp_path, with3D):
    image = picture(tmp_path, Look(size=(400, 304), dpi=200), with3D=with3D, dpi=200)
    assert image.shape[:2] == (304, 400)
    assert Image.open(tmp_path / "a.png").info["dpi"] == pytest.approx((200, 200), abs=0.01)


def test_the_background_can_be_left_out(tmp_path, with3D):
    assert picture(tmp_path, with3D=with3D)[0, 0, :3].tolist() == [255, 255, 255]
    image = picture(tmp_path, Look(size=SMALL, transparent=True), with3D=with3D)
    assert image[0, 0, 3] == 0 and image[110, 150, 3] == 255


def test_a_transparent_picture_on_white_is_the_opaque_one(tmp_path, with3D):
    """So letters and edges are black on any background, and not half white."""
    look = Look(size=SMALL, edges=True, scaleBar=True)
    opaque = picture(tmp_path, look, with3D=with3D)[..., :3].astype(float)
    image = picture(tmp_path, replace(look, transparent=True), with3D=with3D).astype(float)
    share = image[..., 3:] / 255
    assert np.abs(share * image[..., :3] + (1 - share) * 255 - opaque).max() < 10
    assert ((share > 0) & (share < 1)).any()


def test_beads_are_drawn_where_they_are(tmp_path, with3D):
    look = Look(size=SMALL, elevation=0, azimuth=0)
    without = grays(picture(tmp_path, look, with3D=with3D))
    before = grays(picture(tmp_path, look, [1.5, 0, 0], with3D))
    behind = grays(picture(tmp_path, look, [-1.5, 0, 0], with3D))
    assert before > without + 100 and abs(behind - without) < 60


def test_the_range_sets_the_colors(tmp_path, with3D):
    """A sphere of curvature 1 is red in the range -1 to 1, gray in the middle of a range, and blue below one."""

    def middle(limits):
        look = Look(size=SMALL, range=limits, elevation=0, azimuth=0)
        return picture(tmp_path, look, with3D=with3D)[90:110, 130:150, :3].mean(axis=(0, 1))

    red, gray, blue = (middle(limits) for limits in ((-1, 1), (0, 2), (2, 4)))
    assert red[0] > 2 * red[2] and blue[2] > 2 * blue[0] and np.ptp(gray) < 0.15 * gray.max()


def lengthOfBar(image):
    """Return the length of the longest dark line at the left end of the lower part of a picture."""
    isDark = image[3 * len(image) // 4 :, : image.shape[1] // 2, :3].max(axis=2) < 40
    starts = isDark.argmax(axis=1)
    return max(int((~row[start:]).argmax()) for row, start in zip(isDark, starts) if row.any())


def test_edges_and_a_scale_bar(tmp_path, with3D):
    """Edges are dark lines; a bar of half the length is half as wide."""
    plain = picture(tmp_path, with3D=with3D)
    assert np.any(picture(tmp_path, Look(size=SMALL, edges=True), with3D=with3D) != plain)
    widths = []
    for length in (0.5, 1.0):
        widths.append(lengthOfBar(picture(tmp_path, Look(size=SMALL, scaleBar=length), with3D=with3D)))
    assert widths[1] == pytest.approx(2 * widths[0], abs=2) and widths[0] > 10


@needs3D
def test_the_scale_bar_is_as_long_as_it_says(tmp_path):
    """The sphere of radius 1 is twice as wide as the bar of 1."""
    image = picture(tmp_path, Look(size=(640, 480), scaleBar=1.0, elevation=0, azimuth=90))
    colors = image[..., :3].astype(int)
    sphere = (colors[:380, :, 0] - colors[:380, :, 2]) > 40
    assert sphere.sum(axis=1).max() == pytest.approx(2 * lengthOfBar(image), rel=0.03)


def test_the_length_of_the_bar_is_round():
    look = Look(scaleBar=True)
    assert [look.barLength(width) for width in (1.0, 2.6, 7.0, 30, 4e4)] == [0.2, 0.5, 1, 5, 5000]


@needs3D
@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_films(tmp_path, suffix):
    frames = [frame([1.5, 0, 0.1 * i])._replace(step=10 * i) for i in range(3)]
    render(frames, tmp_path / f"a{suffix}", look=Look(size=(200, 150)))
    import imageio.v3 as imageio

    assert imageio.imread(tmp_path / f"a{suffix}").shape[:3] == (3, 150, 200)


LIMITED = """
import resource
import numpy as np
from openmmhelfrich.pictures.rendering import _writeMP4
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
noise = np.random.default_rng(1)
_writeMP4((noise.integers(0, 256, (96, 128, 3), dtype=np.uint8) for _ in range(30)), "a.mp4", 10)
"""


def test_films_that_ffmpeg_cannot_write(tmp_path):
    """ffmpeg fails, the library says nothing, and the old film stays."""
    pytest.importorskip("imageio_ffmpeg")
    (tmp_path / "a.mp4").write_bytes(b"old")
    done = subprocess.run([sys.executable, "-c", LIMITED], cwd=tmp_path, capture_output=True, text=True)
    assert re.search(r"OSError: a\.mp4: of 30 frames ffmpeg wrote \d+; the disk may be full$", done.stderr.strip())
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("a.mp4", b"old")]


@pytest.mark.parametrize(
    "options, words",
    [
        ({"size": (10, 200)}, "the size is (10, 200); it must be two numbers of pixels, each from 16 to 16384"),
        ({"range": (1.0, -1.0)}, "the range is (1.0, -1.0); it must be two curvatures, the smaller one first"),
        ({"colorMap": "rainbows"}, "the color map is 'rainbows'; it must be one of matplotlib's, such as coolwarm"),
        ({"zoom": 0.0}, "zoom is 0.0; it must be positive"),
        ({"dpi": float("nan")}, "dpi is nan; it must be positive"),
        ({"scaleBar": -1.0}, "the scale bar is -1.0; it must be a length above 0, or True"),
    ],
)
def test_mistakes_are_named(options, words):
    with pytest.raises(ValueError) as error:
        Look(**options)
    assert str(error.value) == words


def test_what_a_format_cannot_have(tmp_path):
    with pytest.raises(ValueError, match=r"only a .png has a transparent background"):
        render([frame()], tmp_path / "a.jpg", look=Look(transparent=True))
    with pytest.raises(ValueError, match=r"the size of an .mp4 is 201 by 150 pixels; both must be even"):
        render([frame()], tmp_path / "a.mp4", look=Look(size=(201, 150)))


def test_mp4_without_its_library(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match=r"writing MP4 films needs imageio_ffmpeg, .* pip install"):
        render([frame()], tmp_path / "a.mp4")


def test_the_command_takes_all_of_it(tmp_path):
    frame().mesh.write(tmp_path / "a.ply")
    options = "--size 320 240 --dpi 300 --range -2 2 --color-map viridis --edges --transparent --scale-bar --zoom 1.5"
    arguments = ["render", str(tmp_path / "a.ply"), "-o", str(tmp_path / "b.png"), *options.split()]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert Image.open(tmp_path / "b.png").size == (320, 240)


def test_units_are_written_as_they_are_printed():
    texts = [unitText(unit) for unit in ("um", "um^2", "um^3", "nm^2", "angstrom^3", "kT", "bum", "number")]
    assert texts == ["µm", "µm²", "µm³", "nm²", "Å³", "kT", "bum", "number"]


def test_the_page_has_the_color_map_of_pictures():
    scale = colorScale()
    assert scale[0] == [0.0, "#3b4cc0"] and scale[-1] == [1.0, "#b40426"] and len(scale) == 33


def table(**columns):
    rows = len(next(iter(columns.values())))
    given = {"step": np.arange(rows), "energy": np.ones(rows), "area": np.ones(rows), "volume": np.ones(rows)}
    return Table({name: np.asarray(values, dtype=float) for name, values in (given | columns).items()})


def test_rates_are_drawn_where_there_are_some():
    """Nothing is drawn before anything was accepted, nor where nothing was tried; what is never accepted is drawn."""
    panel = next(panel for panel in PANELS if panel.isRate)
    stages = {"stage": [1, 1, 1, 1]}
    flips = {"flipAcceptance": [0, 0, 0, 0], "flipsForbidden": [0, 0, 0, 0]}
    late = table(acceptance=[0, 0, 0.5, 0], **flips, **stages)
    (trajectories,) = curves(panel, late)
    assert trajectories.name == "acceptance"
    assert np.array_equal(shownValues(panel, trajectories, late), [np.nan, np.nan, 0.5, 0], equal_nan=True)
    never = table(acceptance=[0, 0, 0, 0], flipAcceptance=[0, 0, 0, 0], flipsForbidden=[0, 0.1, 0.1, 0.1], **stages)
    assert [o.name for o in curves(panel, never)] == ["acceptance", "flipAcceptance"]
    minimized = table(step=[0, 1], acceptance=[0, 0], flipAcceptance=[0, 0], flipsForbidden=[0, 0], stage=[1, 1])
    assert curves(panel, minimized) == []


def test_a_value_without_neighbors_is_drawn():
    """A line that leads nowhere is not seen: a lone value has a mark, and others have none."""
    rates = {"acceptance": [0, 0.7, 0.6], "flipAcceptance": [0, 0, 0.1]}
    lines = observablesPicture(table(**rates, stage=[1, 1, 1])).figure.axes[-1].lines
    assert [(line.get_marker(), line.get_markevery()) for line in lines] == [("None", None), (".", [2])]


def test_no_curve_lies_on_the_frame():
    rates = {"acceptance": [1, 1, 1], "flipAcceptance": [0.0, 0.1, 0.1]}
    low, high = observablesPicture(table(**rates, stage=[1, 1, 1])).figure.axes[-1].get_ylim()
    assert low < 0 and high > 1


def test_the_area_difference_is_drawn_where_it_is_held():
    """With its target; a membrane that is not held to one has no panel of it."""
    difference = {"areaDifference": [25, 24, 23], "targetAreaDifference": [25, 23, 23]}
    for energies, names in (([0, 0, 0], []), ([0, 3.0, 0.1], ["areaDifference", "targetAreaDifference"])):
        held = table(**difference, E_areaDifference=energies)
        drawn = [o.name for panel in PANELS for o in curves(panel, held) if "ifference" in o.name]
        assert [name for name in drawn if not name.startswith("E_")] == names
        axes = observablesPicture(held).figure.axes
        assert [each.get_ylabel() for each in axes].count("area difference (nm²)") == len(names) / 2


def test_every_panel_has_axes_of_its_own():
    drawn = observablesPicture(table(reducedVolume=[0.9, 0.8, 0.7]), "um").figure
    labels = [axes.get_ylabel() for axes in drawn.axes]
    assert labels == ["energy (kT)", "area (µm²)", "volume (µm³)", "reduced volume"]
