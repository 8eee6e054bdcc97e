"""The targets of stages, and the stages that lead to those that are far."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..sampling.targets import TARGET_FACTORS, absoluteTargets, listedTargets, totalOf
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
# Steps for each change by a factor of e, of up to so many vertices; of more, whose long waves take longer, more in
# proportion to the root of their number.  docs/how-to/studies.md has what comes of it.
STEPS_PER_E_FOLD, VERTICES = 3000, 642


def endTargets(settings: StageSettings, start: Mapping[str, float]) -> dict[str, float]:
    """Return the targets that a stage gives, in powers of nm, by "area", "volume" and "areaDifference"."""
    given = {TARGET_NAMES[name]: getattr(settings, name) for name in settings.targetNames()}
    return absoluteTargets(given, start) if given else {}


def withApproaches(
    stages: Sequence[StageSettings], measures: Mapping[str, float], targets: Mapping[str, float], numVertices: int
) -> tuple[list[Any], dict[str, float]]:
    """Return stages with those between them that lead to far targets, and the targets to begin with.

    Parameters
    ----------
    stages : sequence of StageSettings
        what is to be done
    measures : dict
        what the mesh has of the targets whose terms are on, by their names
    targets : dict
        those before the first stage, by the same names
    numVertices : int
        how many the membrane has
    """
    led: list[Any] = []
    here, before, first = (
        {name: float(value) for name, value in each.items()} for each in (measures, targets, targets)
    )
    for stage in stages:
        end = before | endTargets(stage, before)
        goal = {name: value for name, value in stage.suddenTargets(before, end).items() if name in here}
        distances = {name: abs(math.log(value / here[name])) for name, value in goal.items() if value * here[name] > 0}
        distance = max(distances.values(), default=0.0)
        canBe = all(each <= math.log(TARGET_FACTORS[totalOf(name)]) for name, each in distances.items())
        if distance > math.log1p(FAR) and canBe:
            if not led:
                first = before | here
            steps = math.ceil(STEPS_PER_E_FOLD * distance * max(1.0, math.sqrt(numVertices / VERTICES)))
            led.append(_approachTo(goal, steps, getattr(stage, "temperature", None)))
        led.append(stage)
        here, before = {name: end[name] for name in here}, end
    return led, first


def _approachTo(goal: Mapping[str, float], steps: int, temperature: float | None) -> ApproachStage:
    given: dict[str, Any] = {
        key: listedTargets(goal, name) for key, name in TARGET_NAMES.items() if name in map(totalOf, goal)
    }
    return ApproachStage(kind="approach", steps=steps, temperature=temperature, **given).added()
