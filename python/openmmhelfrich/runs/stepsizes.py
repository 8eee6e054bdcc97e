"""How long steps may be, from the stiffness of a scene, and whether coarser meshes pay."""

import math

from ..geometry.measured import MeasuredMesh
from ..units import thermalEnergy
from .config import Config, during
from .material import bendingModulusOf, gaussianStepOf, spontaneousCurvatureOf
from .sections import MembraneSection
from .stagesettings import givenConditions
from .surfaces import Surface, surfacesOf
from .tethers import tetherOf

# Vertices, beyond which the flattest triangles decide how long steps may be.
MANY = 2562


def defaultStepSize(config: Config, measured: MeasuredMesh) -> float:
    """Return the size of a leapfrog step, in ps, for a resolved Config that names none: that of the stiffest membrane
    that its stages make.
    """
    return min(stepSizeOf(each, measured) for each in _inForce(config))


def _inForce(config: Config) -> list[Config]:
    """Return a Config with each of the moduli and the like that its membrane has in its stages."""
    if not givenConditions(config.stages):
        return [config]
    gradual = [i - 1 for i, stage in enumerate(config.stages) if stage.isGradual]
    return [during(config, i) for i in (*gradual, *range(len(config.stages)))]


def stepSizeOf(config: Config, measured: MeasuredMesh) -> float:
    """Return the size of a leapfrog step, in ps, for the moduli of a Config.

    Steps must be short against the fastest motion, of frequency sqrt(stiffness/mass), and since the acceptance of a
    trajectory falls with the number of vertices, they shrink as its fourth root.  The factor was found by trial on
    spheres of 162 to 2562 vertices and on the red blood cell, to accept about three trajectories in four and to let
    none of two thousand diverge.  Of larger meshes trajectories are rejected for the flattest triangle of all, which is
    stiffer the more there are: with steps that shrink as the square root half of them or more are accepted.
    """
    sampling, kT = config.sampling, thermalEnergy(config.sampling.temperature)
    numVertices = len(measured.mesh.vertices)
    crowd = numVertices * max(1, numVertices / MANY)
    return 2.4 * math.sqrt(sampling.mass / (_stiffness(config, measured) * kT)) / crowd**0.25


def _stiffness(config: Config, measured: MeasuredMesh) -> float:
    """Estimate the largest second derivative of the energy, in kT per squared length unit.

    The estimates are those for a vertex of a flat sheet of equilateral triangles (bending; tension; with thermal
    roughness: area), for all vertices moving along the normal (volume), for an edge so short that the tether's
    exponential branch holds 1 kT, and for a vertex some of whose edges are as much too long.
    """
    membrane, length = config.membrane, measured.meanEdgeLength
    bending, curvature = bendingModulusOf(config), spontaneousCurvatureOf(config)
    tension = abs(membrane.tension) + bending * curvature**2 / 2
    local = (100 * bending + 10 * gaussianStepOf(config)) / length**2 + 3.5 * tension
    constraints = max(
        0.7 * membrane.area_modulus / (surface.numVertices * length**2)
        + (
            2 * membrane.volume_modulus * surface.area**2 / (surface.numVertices * surface.volume**2)
            if surface.volume is not None
            else 0
        )
        for surface in surfacesOf(config, measured)
    )
    modulus, minLength, _, lengthScale = tetherOf(config, measured)
    r = config.tether.exponent
    decades = math.log(max(modulus / (minLength / lengthScale) ** r, 1.0))
    spring = r * (r - 1) * (r ** (r + 1) * modulus) ** (2 / r) / lengthScale**2
    return local + constraints + ((decades + 1) ** 2 / minLength) ** 2 + 4 * spring


# The weight of coarser meshes that "auto" takes, and the number of vertices from which on it was measured to pay.
MULTILEVEL_WEIGHT, MULTILEVEL_SIZE = 2.0, 1000


def multilevelWeight(config: Config, measured: MeasuredMesh) -> float:
    """Return the weight that "auto" stands for: 0 where it is not known to pay, or is too great in a stage."""
    sampling = config.sampling
    stepSize = sampling.step_size if isinstance(sampling.step_size, float) else defaultStepSize(config, measured)
    own = [getattr(stage, "step_size", None) for stage in config.stages]
    longest = max([stepSize, *(each for each in own if isinstance(each, float))])
    count = max(surface.numVertices for surface in surfacesOf(config, measured))
    if count < MULTILEVEL_SIZE or sampling.tether_substeps > 1:
        return 0.0
    isTooGreat = any(isTooHeavy(each, measured, MULTILEVEL_WEIGHT, longest) for each in _inForce(config))
    return 0.0 if isTooGreat else MULTILEVEL_WEIGHT


def isTooHeavy(config: Config, measured: MeasuredMesh, weight: float, stepSize: float) -> bool:
    """Return whether steps, in ps, must be shorter than that with a weight of coarser meshes, for the moduli of a
    Config.

    Coarser meshes let a surface swell and shrink faster, against the penalties of its area and volume, the softest of
    motions without them.  A step may take 1.5 radians of that; with 1.4 three trajectories in four were accepted.
    """
    stiffness = max(_swelling(config.membrane, surface, weight) for surface in surfacesOf(config, measured))
    frequency = math.sqrt(stiffness * thermalEnergy(config.sampling.temperature) / config.sampling.mass)
    return stepSize * frequency > 1.5


def _swelling(membrane: MembraneSection, surface: Surface, weight: float) -> float:
    """Estimate the second derivative of the penalties, in kT per squared length unit, for a sphere that swells, times
    the factor by which coarser meshes of a weight raise its inverse mass.
    """
    factor, amplification, count = 1.0, 1.0, surface.numVertices / 4
    while count > 12:  # a level of n vertices has the inverse mass 4w times that of the next finer one
        factor *= 4 * weight
        amplification += factor
        count /= 4
    area = 8 * math.pi * (4 * membrane.area_modulus + membrane.area_difference_modulus) / surface.area
    volume = 2 * membrane.volume_modulus * (surface.area / surface.volume) ** 2 if surface.volume else 0.0
    return amplification * (area + volume) / surface.numVertices
