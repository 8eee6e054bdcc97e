"""The targets of stages, and the stages that lead to those that are far."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from ..sampling.targets import MODULUS_NAMES, TARGET_FACTORS, absoluteTargets, inWords, listedTargets, totalOf
from .sections import Targets
from .stagesettings import ApproachStage, StageSettings

# What targets are called in configurations and elsewhere.
TARGET_NAMES = {
    "target_area": "area",
    "target_volume": "volume",
    "reduced_volume": "reducedVolume",
    "target_area_difference": "areaDifference",
}
# A target farther than this from what a membrane has, as a part of itself, is not to be reached suddenly.
FAR = 0.05
# What a membrane has after stages that did not hold it is not known, and counts as so far away, in factors of e.
UNKNOWN = 0.2
# Steps for each change by a factor of e, of up to so many vertices; of more, whose long waves take longer, more in
# proportion to the root of their number.  docs/how-to/studies.md has what comes of it.
STEPS_PER_E_FOLD, VERTICES = 3000, 642


def targetInWords(given: Targets, name: str) -> str:
    """Return what messages call a target of a section or a stage, of which a reduced volume may be given instead."""
    isReduced = given.reduced_volume is not None and totalOf(name) == "volume"
    return f"the target {inWords(name)}{' that reduced_volume gives' if isReduced else ''}"


def endTargets(settings: StageSettings, start: Mapping[str, float]) -> dict[str, float]:
    """Return the targets that a stage gives, in powers of nm, by "area", "volume" and "areaDifference"."""
    given = {TARGET_NAMES[name]: getattr(settings, name) for name in settings.targetNames()}
    return absoluteTargets(given, start) if given else {}


def withApproaches(
    stages: Sequence[StageSettings],
    measures: Mapping[str, float],
    targets: Mapping[str, float],
    numVertices: int,
    held: Collection[str] = tuple(MODULUS_NAMES),
) -> tuple[list[Any], dict[str, float]]:
    """Return stages with those between them that lead to far targets, and the targets to begin with.

    Parameters
    ----------
    stages : sequence of StageSettings
        what is to be done
    measures : dict
        what the mesh has of the targets whose terms are on at some time, by their names
    targets : dict
        those before the first stage, by the same names
    numVertices : int
        how many the membrane has
    held : collection of str
        "area", "volume" and "areaDifference", as far as their terms are on before the first stage
    """
    led: list[Any] = []
    here, before, first = (
        {name: float(value) for name, value in each.items()} for each in (measures, targets, targets)
    )
    held, free = set(held), set[str]()
    for stage in stages:
        end, heldAtEnd = before | endTargets(stage, before), _heldAfter(stage, held)
        heldAtStart = held if stage.isGradual else heldAtEnd
        sudden = stage.suddenTargets(before, end)
        goal = {name: value for name, value in sudden.items() if name in here and totalOf(name) in heldAtStart}
        steps = _stepsTo(goal, here, free, numVertices)
        if steps > 0:
            if not led:
                first = before | {name: here[name] for name in goal}
            names = (MODULUS_NAMES[total] for total in heldAtStart - held)
            led.append(_approachTo(goal, {name: getattr(stage, name) for name in names}, steps, stage))
        led.append(stage)
        if not stage.returns:
            before, held = end, heldAtEnd
        here = {name: before[name] if totalOf(name) in held else value for name, value in here.items()}
        free = set(MODULUS_NAMES) - held
    return led, first


def _heldAfter(stage: StageSettings, held: set[str]) -> set[str]:
    """Return what is held to targets with what a stage gives, of what was before it."""
    given = stage.conditions()
    return {total for total, name in MODULUS_NAMES.items() if given.get(name, total in held)}


def _stepsTo(goal: Mapping[str, float], here: Mapping[str, float], free: Collection[str], numVertices: int) -> int:
    """Return the number of steps that lead to targets; 0 where they are near, or too far to be led to.

    Of some totals, which are free, it is not known what a membrane has.
    """
    distances = {name: abs(math.log(value / here[name])) for name, value in goal.items() if value * here[name] > 0}
    if any(each > math.log(TARGET_FACTORS.get(totalOf(name), math.inf)) for name, each in distances.items()):
        return 0
    distance = max((max(each, UNKNOWN * (totalOf(name) in free)) for name, each in distances.items()), default=0.0)
    if distance <= math.log1p(FAR):
        return 0
    return math.ceil(STEPS_PER_E_FOLD * distance * max(1.0, math.sqrt(numVertices / VERTICES)))


def _approachTo(
    goal: Mapping[str, float], moduli: Mapping[str, float], steps: int, stage: StageSettings
) -> ApproachStage:
    """Return the stage that leads to targets, and to moduli, before another one."""
    given: dict[str, Any] = {
        key: listedTargets(goal, name) for key, name in TARGET_NAMES.items() if name in map(totalOf, goal)
    }
    given |= {**moduli, "temperature": getattr(stage, "temperature", None)}
    return ApproachStage(kind="approach", steps=steps, **given).added()
