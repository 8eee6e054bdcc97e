"""The surfaces of a scene, and the targets that each is held to."""

import math
from typing import NamedTuple

import numpy as np

from ..geometry.connectivity import triangleNormals
from ..geometry.measured import MeasuredMesh
from ..geometry.measures import volumeOfReduced
from ..geometry.mesh import Mesh
from ..sampling.targets import MODULUS_NAMES, numberedTargets, requireOnePerSurface, sphereDifference
from .config import Config, valueOf
from .sections import MODULI, MembraneSection

# The keys of each target.
TARGET_KEYS = {
    "area": ("target_area",),
    "volume": ("target_volume", "reduced_volume"),
    "areaDifference": ("target_area_difference",),
}


class Surface(NamedTuple):
    """One of the mesh's surfaces: its number of vertices, A_0, V_0 unless it is periodic, and dA_0."""

    numVertices: int
    area: float
    volume: float | None
    areaDifference: float


def surfacesOf(config: Config, measured: MeasuredMesh) -> list[Surface]:
    """Return the surfaces, in the order of their numbers, with the targets that each is held to by itself."""
    membrane, count = config.membrane, len(measured.surfaces)
    for name in membrane.targetNames():
        requireOnePerSurface(f"[membrane] {name}", getattr(membrane, name), count)
    return [_surface(membrane, measured, k) for k in range(count)]


def _surface(membrane: MembraneSection, measured: MeasuredMesh, number: int) -> Surface:
    def given(name: str) -> float | None:
        value = getattr(membrane, name)
        return value[number] if isinstance(value, list) else value

    area = given("target_area") or measured.areas[number]
    volume = None if measured.volumes[number] is None else given("target_volume") or measured.volumes[number]
    reduced, areaDifference = given("reduced_volume"), given("target_area_difference")
    if reduced is not None:
        volume = volumeOfReduced(reduced, area)
    if areaDifference is None:
        areaDifference = 2 * membrane.leaflet_separation * measured.meanCurvatures[number]
    return Surface(len(measured.surfaces[number].vertices), area, volume, areaDifference)


def targetsOf(surfaces: list[Surface]) -> dict[str, float]:
    """Return the targets of surfaces by their names."""
    volumes = [surface.volume for surface in surfaces if surface.volume is not None]
    return {
        **numberedTargets("area", [surface.area for surface in surfaces]),
        **(numberedTargets("volume", volumes) if volumes else {}),
        **numberedTargets("areaDifference", [surface.areaDifference for surface in surfaces]),
    }


def heldOf(config: Config) -> set[str]:
    """Return the totals that a Config's membrane is held to targets of, before its stages."""
    return {total for total in MODULUS_NAMES if valueOf(config, MODULI[total]) > 0}


def targetScales(config: Config, measured: MeasuredMesh) -> dict[str, float]:
    """Return what targets are compared with, of each surface."""
    separation = config.membrane.leaflet_separation
    spheres = [sphereDifference(area, separation) for area in measured.areas]
    return measuresOf(measured) | numberedTargets("areaDifference", spheres)


def measuresOf(measured: MeasuredMesh) -> dict[str, float]:
    """Return the area and volume of each surface."""
    volumes = [volume for volume in measured.volumes if volume is not None]
    return {
        **numberedTargets("area", measured.areas),
        **(numberedTargets("volume", volumes) if volumes else {}),
    }


def leastAreas(measured: MeasuredMesh) -> dict[str, float]:
    """Return the least area that each periodic surface can have, by the names of targets; of closed ones there is none.

    It is that of the projection of a sheet onto a side of its box: the size of the sum of the area vectors of all
    triangles, which no motion changes, as it is the flux of a uniform field through the surface.
    """
    sheets = measured.surfaces if measured.mesh.isPeriodic else []
    sums = [triangleNormals(sheet.vertices, sheet.triangles, sheet.images).sum(axis=0) for sheet in sheets]
    return numberedTargets("area", [float(np.linalg.norm(each)) / 2 for each in sums]) if sums else {}


def ownAreaDifferences(config: Config, measured: MeasuredMesh) -> dict[str, float]:
    """Return the area difference of each surface."""
    height = config.membrane.leaflet_separation
    values = [2 * height * float(curvature) for curvature in measured.meanCurvatures]
    return numberedTargets("areaDifference", values)


def radiusOf(area: float) -> float:
    """Return the radius of a sphere of an area."""
    return math.sqrt(area / (4 * math.pi))


def defaultAmplitude(area: float, mesh: Mesh) -> float:
    """Return the amplitude of shear waves to begin with.

    By rule of thumb, the energy of a strain s changes by about s sqrt(N) kT, whatever the moduli.
    """
    return 0.7 * radiusOf(area) / math.sqrt(len(mesh.vertices))
