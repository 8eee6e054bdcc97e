"""Numbers of a configuration that have nothing to do with its mesh, or overflow together, are errors."""

import contextlib
import math
from collections.abc import Iterator, Mapping

import numpy as np

from ..geometry.measured import MeasuredMesh
from ..sampling.targets import differenceBounds, inWords, requireComparableTarget, totalOf
from .approach import targetInWords
from .config import Config, asDict
from .material import requireResolved
from .sections import GREATEST, LEAST, SamplingSection, Targets
from .stepsizes import defaultStepSize
from .surfaces import TARGET_KEYS, heldOf, leastAreas, radiusOf, targetScales

# What lengths a mesh's edges may have, so that powers of them do not overflow with any modulus.
LEAST_EDGE, GREATEST_EDGE = 1e-20, 1e20
# By so much a length may differ from the mesh's own, and a step size from the rule of thumb.
GREATEST_FACTOR = 1e6
# Of flips in a sweep: what SweepEdgeFlipsKernel makes.
MOST_ATTEMPTS = 2**33
# The part by which the target area of a sheet may be less than the least one: numbers are rounded.
_ROUNDING = 0.005


def requireMeshSize(config: Config, measured: MeasuredMesh) -> None:
    """Raise a ValueError if a mesh is so large or small that its energies would overflow."""
    length, unit = measured.meanEdgeLength, config.mesh.length_unit
    if not LEAST_EDGE <= length <= GREATEST_EDGE:
        file = f" of {config.mesh.file}" if config.mesh.file is not None else ""
        raise ValueError(
            f"the edges of the mesh{file} are {length:.3g} {unit} long on average; they must be from {LEAST_EDGE:g} to "
            f"{GREATEST_EDGE:g} {unit}: give it another scale in [mesh]"
        )


def checkSizes(config: Config, measured: MeasuredMesh) -> None:
    """Raise a ValueError if a length or the step size of a resolved Config has nothing to do with the mesh."""
    length, tether, sampling = measured.meanEdgeLength, config.tether, config.sampling
    for name, value in (
        ("[tether] min_length", tether.min_length),
        ("[tether] max_length", tether.max_length),
        ("[repulsion] onset", config.repulsion.onset),
    ):
        requireComparable(name, value, length, "the mean edge length")
    requireResolved("the spontaneous_curvature", config, length)
    stepSize = defaultStepSize(config, measured)
    if not LEAST <= stepSize <= GREATEST:
        raise ValueError(
            f"[sampling] mass is {sampling.mass:g} Da and temperature {sampling.temperature:g} K; with the moduli they "
            f"ask for a step size of {stepSize:g} ps, which must be from {LEAST:g} to {GREATEST:g}"
        )
    requireComparable("[sampling] step_size", sampling.step_size, stepSize, "the rule of thumb for it in ps,")
    if sampling.step_size == "auto":
        requireTrajectories(sampling)
    numEdges = 3 * len(measured.mesh.triangles) // 2
    if sampling.flip_fraction * numEdges > MOST_ATTEMPTS:
        raise ValueError(
            f"[sampling] flip_fraction is {sampling.flip_fraction:g}; with the mesh's {numEdges} edges it must be at "
            f"most {MOST_ATTEMPTS / numEdges:.4g}"
        )
    if sampling.exchange_fraction * numEdges > MOST_ATTEMPTS:
        raise ValueError(
            f"[sampling] exchange_fraction is {sampling.exchange_fraction:g}; with the mesh's {numEdges} edges it must "
            f"be at most {MOST_ATTEMPTS / numEdges:.4g}"
        )
    if sampling.shear_wave_probability > 0:
        radius = radiusOf(measured.mesh.area)
        requireComparable("[sampling] shear_wave_amplitude", sampling.shear_wave_amplitude, radius, "the radius")


def requireComparableTargets(config: Config, measured: MeasuredMesh, targets: dict[str, float]) -> None:
    """Raise a ValueError if a target before the stages has nothing to do with the mesh.  That of an area difference,
    which may be near 0 where nothing is held to it, counts where it is.
    """
    membrane, isHeld = config.membrane, "areaDifference" in heldOf(config)
    for name, scale in targetScales(config, measured).items():
        total = totalOf(name)
        if total != "areaDifference":
            isReduced = total == "volume" and membrane.reduced_volume is not None
            what = targetInWords(membrane, name) if isReduced else _keyOf(name)
            requireComparableTarget(f"[membrane] {what}", name, targets[name], scale)
        elif isHeld and membrane.target_area_difference is None:
            requireHeldDifference("[membrane] ", membrane.area_difference_modulus, name, targets[name], scale)
        elif isHeld:
            requireComparableTarget(f"[membrane] {_keyOf(name)}", name, targets[name], scale)
    requireLeastAreas("[membrane] ", targets, measured)


def _keyOf(name: str) -> str:
    """Return the key of a target by its name: that of "area[1]" is "target_area[1]"."""
    total = totalOf(name)
    return TARGET_KEYS[total][0] + name.removeprefix(total)


def requireHeldDifference(where: str, modulus: float, name: str, target: float, sphere: float) -> None:
    """Raise a ValueError if a modulus, given without a target, holds to an area difference that can be none: the mesh's
    own as a rule, which is near 0 of a flat sheet.
    """
    _requireDifference(
        f"{where}area_difference_modulus is {modulus:g}, and the target {inWords(name)}, which is the mesh's own "
        f"unless target_area_difference is given, is {target:.4g}",
        *(target, sphere, "give such a target_area_difference, or an area_difference_modulus of 0"),
    )


def requireBeginning(goal: Targets, name: str, start: float, sphere: float) -> None:
    """Raise a ValueError if a path to an area difference begins with one that can be no target, as a flat sheet's."""
    _requireDifference(
        f"the path to {_keyOf(name)} = {goal.target_area_difference} begins with an area difference of {start:.4g}, "
        "that of the mesh unless one is given before",
        *(start, sphere, "let a stage of kind sample before it give a target_area_difference"),
    )


def _requireDifference(what: str, difference: float, sphere: float, remedy: str) -> None:
    """Raise a ValueError, of what it is and what to do, if an area difference can be no target."""
    least, greatest = differenceBounds(sphere)
    if not least <= abs(difference) <= greatest:
        raise ValueError(
            f"{what}; its size must be from {least:.4g} to {greatest:.4g}, as the energy is that of a ratio to it: "
            f"{remedy}"
        )


def requireLeastAreas(where: str, targets: Mapping[str, float], measured: MeasuredMesh) -> None:
    """Raise a ValueError if the target area of a periodic surface is less than any that it can have."""
    areas = {name: target for name, target in targets.items() if totalOf(name) == "area"}
    for name, least in (leastAreas(measured) if areas else {}).items():
        if areas[name] < (1 - _ROUNDING) * least:
            raise ValueError(
                f"{where}{_keyOf(name)} is {areas[name]:g}; it must be at least {least:.6g}, the area of the sheet "
                "when it is flat across its box; a positive tension makes it taut without a target"
            )


def requireTrajectories(sampling: SamplingSection) -> None:
    """Raise a ValueError if there are no trajectories by which a step size could be found."""
    others = sampling.flip_probability + sampling.shear_wave_probability + sampling.exchange_probability
    if others >= 1:
        raise ValueError(
            "step_size is 'auto', and the probabilities of [sampling] of moves other than trajectories add up to "
            f"{others:g}; they must leave trajectories by which it is found"
        )


def requireComparable(name: str, value: float | str | None, own: float, what: str) -> None:
    """Raise a ValueError if a number, unless it is none, is not within a large factor of another one."""
    if not isinstance(value, float):
        return
    if not abs(own) / GREATEST_FACTOR <= abs(value) <= abs(own) * GREATEST_FACTOR:
        raise ValueError(f"{name} is {value:g}; it must be within a factor of {GREATEST_FACTOR:g} of {what} {own:.4g}")


@contextlib.contextmanager
def overflowsExplained(config: Config) -> Iterator[None]:
    """Name the keys that are likely to be wrong when arithmetic with them fails."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            yield
    except ArithmeticError:
        sizes = {
            f"[{section}] {key} = {value:g}": abs(math.log(abs(value)))
            for section, values in asDict(config).items()
            if isinstance(values, dict)
            for key, value in values.items()
            if isinstance(value, float) and value != 0
        }
        extreme = sorted(sizes, key=lambda name: -sizes[name])[:3]
        raise ValueError(
            f"the configuration's numbers differ so much in size that energies or steps overflow: {', '.join(extreme)}"
        ) from None
