"""Targets of a membrane's area, volume and area difference: parameters of its Context."""

import math
from collections.abc import Mapping
from typing import Any

import openmm as mm
from openmm import unit

from ..geometry.measures import volumeOfReduced
from ..helfrich import HelfrichForce
from ..units import valueIn

_UNITS = {"area": unit.nanometer**2, "volume": unit.nanometer**3, "areaDifference": unit.nanometer**2}


def targetParameters(force: HelfrichForce) -> dict[str, str]:
    """Return the names of the Context parameters of a HelfrichForce's targets, by "area", "volume" and
    "areaDifference".
    """
    return {
        "area": force.getTargetAreaParameter(),
        "volume": force.getTargetVolumeParameter(),
        "areaDifference": force.getTargetAreaDifferenceParameter(),
    }


def currentTargets(context: mm.Context, force: HelfrichForce) -> dict[str, float]:
    """Return the targets in a Context, in powers of nm, by "area", "volume" and "areaDifference"."""
    return {name: context.getParameter(parameter) for name, parameter in targetParameters(force).items()}


def setTargets(context: mm.Context, force: HelfrichForce, targets: Mapping[str, float]) -> None:
    """Set some targets in a Context."""
    for name, value in targets.items():
        context.setParameter(targetParameters(force)[name], value)


def absoluteTargets(targets: Mapping[str, Any], start: Mapping[str, float]) -> dict[str, float]:
    """Return targets by "area", "volume" and "areaDifference" in powers of nm.

    Parameters
    ----------
    targets : dict
        what they may be given as: numbers or Quantities, and a "reducedVolume" instead of a volume
    start : dict
        those before, of whose area a reduced volume may be
    """
    unknown = set(targets) - {*_UNITS, "reducedVolume"}
    if unknown or not targets:
        raise ValueError(
            f"the targets are {', '.join(map(str, targets)) or 'none'}; they must be among area, volume, reducedVolume "
            "and areaDifference"
        )
    if "volume" in targets and "reducedVolume" in targets:
        raise ValueError("volume and reducedVolume are both given; give one of them")
    absolute = {name: float(valueIn(targets[name], _UNITS[name])) for name in targets if name != "reducedVolume"}
    for name, value in absolute.items():
        if not math.isfinite(value):
            raise ValueError(f"the target {name} is {value}; it must be finite")
    if "reducedVolume" in targets:
        v = float(targets["reducedVolume"])
        if not 0 < v <= 1:
            raise ValueError(f"the target reducedVolume is {v}; it must be above 0 and at most 1")
        absolute["volume"] = volumeOfReduced(v, absolute.get("area", start["area"]))
    return absolute
