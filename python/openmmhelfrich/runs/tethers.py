"""The tether of a scene, which keeps edges between a least and a greatest length."""

import math
from typing import NamedTuple

import numpy as np

from ..geometry.measured import MeasuredMesh
from ..geometry.mesh import Mesh
from .config import Config

# The bounds by default, in mean edge lengths.
FITTING = (0.83, 1.33)


class Tether(NamedTuple):
    """A tether: its modulus, in kT, the least and greatest length of an edge, and the length scale of its energy."""

    modulus: float
    minLength: float
    maxLength: float
    lengthScale: float


def tetherOf(config: Config, measured: MeasuredMesh) -> Tether:
    """Return the Tether that a Config asks for.

    The defaults are soft where edges are short, so that steps are long, and their pull and push on the area of a fluid
    membrane cancel, entropy included. Edges beyond them at the start cost no more than a few hundred kT, and soon come
    back.
    """
    tether = config.tether
    given = (tether.modulus, tether.min_length, tether.max_length, tether.length_scale)
    mean = measured.meanEdgeLength if None in given else math.nan
    minLength, maxLength = tether.min_length or FITTING[0] * mean, tether.max_length or FITTING[1] * mean
    if minLength >= maxLength:
        raise ValueError(
            f"[tether] min_length is {minLength:.4g} and max_length {maxLength:.4g}; min_length must be less"
        )
    r, modulus = tether.exponent, tether.modulus
    lengthScale = tether.length_scale or (mean if modulus is None else 1.0)
    if modulus is None:
        modulus = 4 / (r ** (r + 1) * (0.1 * mean / lengthScale) ** r)
    return Tether(modulus, minLength, maxLength, lengthScale)


def requireShortEdges(maxLength: float, mesh: Mesh) -> None:
    """Raise a ValueError if a tether lets edges of a periodic mesh be longer than half a side of the box: they would
    change over to another image of their vertex, and tear triangles.
    """
    half = float(np.diag(np.asarray(mesh.box)).min()) / 2
    if maxLength > half:
        raise ValueError(
            f"[tether] max_length is {maxLength:.4g}; it must be at most half of the shortest side of the periodic "
            f"box, {half:.4g}"
        )
