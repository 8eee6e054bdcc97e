"""Targets of a membrane's area, volume and area difference: parameters of its Context.

They go by the names "area", "volume" and "areaDifference".  Of several connected surfaces those that have a target of
their own have it by a name with their number: "volume[0]", "volume[1]".
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import openmm as mm
from openmm import unit

from ..geometry.measures import volumeOfReduced
from ..helfrich import HelfrichForce
from ..units import realNumber, valueIn

_UNITS = {"area": unit.nanometer**2, "volume": unit.nanometer**3, "areaDifference": unit.nanometer**2}
_PARAMETERS: dict[str, Callable[..., str]] = {
    "area": HelfrichForce.getTargetAreaParameter,
    "volume": HelfrichForce.getTargetVolumeParameter,
    "areaDifference": HelfrichForce.getTargetAreaDifferenceParameter,
}
_SETTERS: dict[str, Callable[..., None]] = {
    "area": HelfrichForce.setTargetArea,
    "volume": HelfrichForce.setTargetVolume,
    "areaDifference": HelfrichForce.setTargetAreaDifference,
}

# By so much targets may differ from the mesh's own; farther ones are errors.  Edges keep their length to a factor of
# less than 2.
TARGET_FACTORS = {"area": 5.0**2, "volume": 5.0**3}
# The size of area differences, which may be near 0, or negative, in units of a sphere's.  A chain of n buds has sqrt(n)
# and a tube of a length of n radii sqrt(n/8).
_LEAST_DIFFERENCE, _GREATEST_DIFFERENCE = 1e-5, 100.0

# What holds them, in configurations.
MODULUS_NAMES = {"area": "area_modulus", "volume": "volume_modulus", "areaDifference": "area_difference_modulus"}


def nameOf(total: str, surface: int) -> str:
    """Return the name of what one of several surfaces has of its own."""
    return f"{total}[{surface}]"


def inWords(name: str) -> str:
    """Return what messages call a target: "area difference of surface 1" is "areaDifference[1]"."""
    total, _, number = name.partition("[")
    words = {"areaDifference": "area difference", "reducedVolume": "reduced volume"}.get(total, total)
    return f"{words} of surface {number.rstrip(']')}" if number else words


def totalOf(name: str) -> str:
    """Return a name without the number of a surface."""
    return name.partition("[")[0]


def numberedTargets(total: str, values: list[float]) -> dict[str, float]:
    """Return the targets of surfaces by name: values of "area", "volume" or "areaDifference", one for each surface."""
    return {total: values[0]} if len(values) == 1 else {nameOf(total, k): value for k, value in enumerate(values)}


def listedTargets(targets: Mapping[str, float], total: str) -> Any:
    """Return what :func:`numberedTargets` names: a number for one surface, a list for several."""
    values = [value for name, value in targets.items() if totalOf(name) == total]
    return values[0] if total in targets else values


def targetParameters(context: mm.Context, force: HelfrichForce) -> dict[str, str]:
    """Return the names of the parameters of a Context that hold a HelfrichForce's targets, by the targets' names."""
    numSurfaces, parameters = force.getNumSurfacesInContext(context), {}
    for total, ask in _PARAMETERS.items():
        common = ask(force)
        own = {k: ask(force, k) for k in range(numSurfaces) if ask(force, k) != common}
        if numSurfaces == 1:
            parameters[total] = own.get(0, common)
            continue
        if len(own) < numSurfaces:
            parameters[total] = common
        parameters |= {nameOf(total, k): parameter for k, parameter in own.items()}
    return parameters


def currentTargets(context: mm.Context, force: HelfrichForce) -> dict[str, float]:
    """Return the targets in a Context by their names, in powers of nm."""
    return {name: context.getParameter(parameter) for name, parameter in targetParameters(context, force).items()}


def sphereDifference(area: float, separation: float) -> float:
    """Return the area difference of a sphere of an area, with the separation of the leaflets: what those of other
    shapes are compared with.
    """
    return 4 * separation * math.sqrt(math.pi * area)


def requireComparableTarget(what: str, name: str, value: float | None, own: float) -> None:
    """Raise a ValueError if a target, unless it is none, is of another scale than the mesh.

    Parameters
    ----------
    what : str
        the target, as the message names it
    name : str
        that of the module
    value, own : float
        the target, and what the mesh has; of an area difference, what a sphere of the mesh's area has
    """
    if totalOf(name) == "areaDifference":
        _requireComparableDifference(what, value, own)
        return
    factor = TARGET_FACTORS[totalOf(name)]
    if value is not None and not abs(own) / factor <= abs(value) <= abs(own) * factor:
        raise ValueError(
            f"{what} is {value:g}; it must be within a factor of {factor:g} of the {inWords(name)} of the mesh, "
            f"{own:.4g}: one of them may be in another unit of length"
        )


def differenceBounds(sphere: float) -> tuple[float, float]:
    """Return the least and the greatest size of an area difference that can be a target, from that of a sphere."""
    return _LEAST_DIFFERENCE * sphere, _GREATEST_DIFFERENCE * sphere


def _requireComparableDifference(what: str, value: float | None, sphere: float) -> None:
    least, greatest = differenceBounds(sphere)
    if value is not None and not least <= abs(value) <= greatest:
        raise ValueError(
            f"{what} is {value:g}; its size must be from {least:.4g} to {greatest:.4g}, where a sphere of the mesh's "
            f"area has {sphere:.4g}: one of them may be in another unit of length, and an area_difference_modulus of 0 "
            "lets the area difference go"
        )


def measuredTargets(context: mm.Context, force: HelfrichForce) -> dict[str, float]:
    """Return what is held to the targets in a Context by their names, in powers of nm."""
    surfaces = force.getGeometryInContext(context).surfaces
    measures: dict[str, float] = {}
    for total, wanted in _UNITS.items():
        measures |= numberedTargets(total, [valueIn(getattr(surface, total), wanted) for surface in surfaces])
    return measures


def targetScales(context: mm.Context, force: HelfrichForce) -> dict[str, float]:
    """Return what targets in a Context are compared with by their names, in powers of nm."""
    measures = measuredTargets(context, force)
    separation = valueIn(force.getLeafletSeparation(), unit.nanometer)
    return {
        name: sphereDifference(measures[name.replace("areaDifference", "area")], separation)
        if totalOf(name) == "areaDifference"
        else value
        for name, value in measures.items()
    }


def setTargets(context: mm.Context, force: HelfrichForce, targets: Mapping[str, float]) -> None:
    """Set some targets in a Context."""
    if targets:
        parameters = targetParameters(context, force)
        for name, value in targets.items():
            context.setParameter(parameters[name], value)


def setDefaultTargets(force: HelfrichForce, targets: Mapping[str, float]) -> None:
    """Set targets in a HelfrichForce."""
    for name, value in targets.items():
        total, _, number = name.partition("[")
        _SETTERS[total](force, value, int(number.rstrip("]")) if number else -1)


def absoluteTargets(targets: Mapping[str, Any], start: Mapping[str, float]) -> dict[str, float]:
    """Return targets by their names, in powers of nm.

    Parameters
    ----------
    targets : dict
        what they may be given as: numbers or Quantities by "area", "volume" and "areaDifference", and a "reducedVolume"
        instead of a volume.  A number is that of every surface by itself, a list has one for each surface
    start : dict
        those before, of whose area a reduced volume may be
    """
    unknown = {totalOf(name) for name in targets} - {*_UNITS, "reducedVolume"}
    if unknown or not targets:
        raise ValueError(
            f"the targets are {', '.join(map(str, targets)) or 'none'}; they must be among area, volume, reducedVolume "
            "and areaDifference"
        )
    if "volume" in targets and "reducedVolume" in targets:
        raise ValueError("volume and reducedVolume are both given; give one of them")
    absolute: dict[str, float] = {}
    for name, value in targets.items():
        if name != "reducedVolume":
            absolute |= {
                known: realNumber(number, f"the target {name}", _UNITS[totalOf(name)])
                for known, number in _spread(name, value, start).items()
            }
    for name, value in absolute.items():
        if not math.isfinite(value):
            raise ValueError(f"the target {name} is {value}; it must be finite")
    if "reducedVolume" in targets:
        for name, number in _spread("volume", targets["reducedVolume"], start).items():
            v = realNumber(number, "the target reducedVolume")
            if not 0 < v <= 1:
                raise ValueError(f"the target reducedVolume is {v}; it must be above 0 and at most 1")
            absolute[name] = volumeOfReduced(v, _areaBeside(name, {**start, **absolute}))
    return absolute


def _spread(name: str, value: Any, start: Mapping[str, float]) -> dict[str, Any]:
    """Return a target by the names that it has at the start."""
    names = [known for known in start if known == name or totalOf(known) == name] or [name]
    if not isinstance(value, (list, tuple)):
        return dict.fromkeys(names, value)
    requireOnePerSurface(f"the target {name}", value, len(names))
    return dict(zip(names, value))


def requireOnePerSurface(what: str, values: Any, numSurfaces: int) -> None:
    """Raise a ValueError unless something that may have a value for each surface has a single one, or that many."""
    if isinstance(values, (list, tuple)) and len(values) != numSurfaces:
        raise ValueError(
            f"{what} has {len(values)} values, for {numSurfaces} surface{'s' if numSurfaces > 1 else ''}; give one "
            "number, which is that of every surface by itself, or a list with one for each"
        )


def _areaBeside(volume: str, targets: Mapping[str, float]) -> float:
    area = volume.replace("volume", "area")
    if area not in targets and totalOf(area) not in targets:
        raise ValueError(
            "the surfaces have area targets of their own, and one volume target in common, so that no reduced volume "
            "says what it is; give them volume targets of their own"
        )
    return targets[area] if area in targets else targets[totalOf(area)]
