"""How membranes are drawn: what pictures of both libraries, and the page of a run, have in common."""

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.mesh import Mesh

COLOR_MAP = "coolwarm"
BEAD_COLOR = "0.35"
COLORED = ("auto", "curvature", "species")
SPECIES_COLORS, NUM_COLORS = "tab10", 10  # one for each species
# Of more species, in the order of their numbers: a scale, its part that can be read on white, and what its legend has.
SPECIES_SCALE, BRIGHTEST, NUM_SHADES, NUM_LABELS = "plasma", 0.85, 256, 5
_SIGNS = {"um": "µm", "angstrom": "Å", "^2": "²", "^3": "³"}


@dataclass(frozen=True)
class Look:
    """How a membrane is drawn.

    Attributes
    ----------
    elevation, azimuth : float
        direction of view, in degrees: above the xy plane, and around z from x
    zoom : float
        how much larger than to fill the picture
    size : pair of int
        width and height, in pixels
    dpi : float
        pixels an inch, which the file tells, so that a page can have it at its size
    range : pair of float, optional
        the mean curvatures at the ends of the color map, in 1/nm; by default those that all but a hundredth of the
        vertices have, the same in both directions
    colorMap : str
        the name of a color map of matplotlib
    colorBy : str
        "curvature", "species", or "auto": species where there are some, and else curvature. So it is too where nearly
        every vertex has a species of its own and numbers of neighbors have nothing to do with each other
    edges : bool
        whether to draw the edges of triangles
    transparent : bool
        whether the background is transparent, in a PNG
    scaleBar : bool or float
        whether to draw a bar of a round length, or of this length, in nm. The view has no perspective then, so that the
        bar holds everywhere
    cut : bool
        whether to leave out the half that is nearer to the viewer, to show what is inside
    """

    elevation: float = 30.0
    azimuth: float = 30.0
    zoom: float = 1.0
    size: tuple[int, int] = (1024, 768)
    dpi: float = 150.0
    range: tuple[float, float] | None = None
    colorMap: str = COLOR_MAP
    colorBy: str = "auto"
    edges: bool = False
    transparent: bool = False
    scaleBar: bool | float = False
    cut: bool = False

    def __post_init__(self) -> None:
        from matplotlib import colormaps

        if self.colorMap not in colormaps:
            raise ValueError(f"the color map is '{self.colorMap}'; it must be one of matplotlib's, such as {COLOR_MAP}")
        if self.colorBy not in COLORED:
            raise ValueError(f"colorBy is '{self.colorBy}'; it must be one of {', '.join(COLORED)}")
        if len(self.size) != 2 or not all(16 <= n <= 16384 for n in self.size):
            raise ValueError(f"the size is {self.size}; it must be two numbers of pixels, each from 16 to 16384")
        if self.range is not None and not (len(self.range) == 2 and self.range[0] < self.range[1]):
            raise ValueError(f"the range is {self.range}; it must be two curvatures, the smaller one first")
        for name in ("dpi", "zoom"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} is {value}; it must be positive")
        if not (math.isfinite(self.scaleBar) and self.scaleBar >= 0):
            raise ValueError(f"the scale bar is {self.scaleBar}; it must be a length above 0, or True")

    def species(self, mesh: Mesh) -> NDArray[np.intc] | None:
        """Return the species that color a mesh, or None if its curvature does."""
        if self.colorBy == "species" and mesh.species is None:
            raise ValueError("there are no species to color it by; leave it to the curvature")
        isHidden = self.colorBy == "curvature" or (self.colorBy == "auto" and _isUnordered(mesh))
        return None if isHidden else mesh.species

    def limits(self, curvature: np.ndarray) -> tuple[float, float]:
        """Return the curvatures at the ends of the color map, for those of a membrane or of all frames."""
        if self.range is not None:
            return self.range
        bound = max(float(np.quantile(np.abs(curvature), 0.99)), 1e-12)
        return -bound, bound

    def barLength(self, width: float) -> float:
        """Return the length of the scale bar of a picture so wide: one, two or five times a power of ten, about a fifth
        of the width.
        """
        if self.scaleBar is not True:
            return float(self.scaleBar)
        power = 10 ** math.floor(math.log10(width / 5))
        return power * max(n for n in (1, 2, 5) if n * power <= width / 5)


LOOK = Look()


def _isUnordered(mesh: Mesh) -> bool:
    """Return whether species are of single vertices, with numbers that tell nothing of where these are."""
    if mesh.species is None or speciesCount(mesh) <= len(mesh.vertices) / 2:
        return False
    first, second = mesh.species[mesh.edges].T.astype(float)
    return bool(np.abs(first - second).mean() > speciesCount(mesh) / 4)  # 1/3 of it by chance


def speciesCount(*meshes: Mesh) -> int:
    """Return how many species some meshes tell of, by numbers and names."""
    return max(max(len(m.speciesNames), 0 if m.species is None else int(m.species.max()) + 1) for m in meshes)


def speciesColors(species: NDArray[Any], count: int) -> NDArray[np.float64]:
    """Return the color of each of some numbers of species, of so many: an (n, 3) array from 0 to 1."""
    return speciesPalette(count)[speciesPlaces(species, count)]


def speciesPlaces(species: NDArray[Any], count: int) -> NDArray[np.int64]:
    """Return which of the :func:`speciesPalette` is the color of each of some species, of so many."""
    last = count - 1 if count > NUM_COLORS else NUM_SHADES - 1
    return np.rint(np.asarray(species) * ((NUM_SHADES - 1) / last)).astype(np.int64)


def speciesPalette(count: int) -> NDArray[np.float64]:
    """Return the colors of so many species: an (n, 3) array from 0 to 1."""
    from matplotlib import colormaps

    if count <= NUM_COLORS:
        return np.array(colormaps[SPECIES_COLORS](np.arange(NUM_COLORS)))[:, :3]
    return np.array(colormaps[SPECIES_SCALE](np.linspace(0, BRIGHTEST, NUM_SHADES)))[:, :3]


def speciesLegend(mesh: Mesh, count: int) -> list[tuple[str, tuple[float, float, float]]]:
    """Return the names and colors of the species that a mesh has, of so many; of more than have colors of their own,
    those of some at equal distances.
    """
    if mesh.species is None:
        return []
    found = np.unique(mesh.species).astype(int)
    if count > NUM_COLORS:
        found = np.linspace(0, count - 1, NUM_LABELS).round().astype(int)
    labels = [mesh.speciesNames[i] if i < len(mesh.speciesNames) else f"species {i}" for i in found]
    return [(label, tuple(color)) for label, color in zip(labels, speciesColors(found, count).tolist())]


def unitText(unit: str) -> str:
    """Return a unit as labels show it: µm² for um^2."""
    return re.sub(r"\bum\b|\bangstrom\b|\^2|\^3", lambda found: _SIGNS[found[0]], unit)


def curvatureLabel(lengthUnit: str) -> str:
    """Return what the scale of colors is called."""
    return f"mean curvature (1/{unitText(lengthUnit)})"


def colorScale(name: str = COLOR_MAP, steps: int = 33) -> list[list[Any]]:
    """Return a color map as pairs of a place from 0 to 1 and a color, as plotly takes it."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [[place, to_hex(colormaps[name](place))] for place in np.linspace(0, 1, steps).tolist()]
