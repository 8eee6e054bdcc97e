"""What keys of a configuration do to its scene: those without effect are errors, what was chosen or changed is told."""

import math

from ..geometry.measured import MeasuredMesh
from ..geometry.mesh import Mesh
from ..messages import shortened
from ..sampling.targets import MODULUS_NAMES, totalOf
from .config import Config, during, hasAim, hasBurnIn, valueOf
from .defaults import GROWING_MODULI, MODULUS_PER_VERTEX
from .sections import MODULI, MembraneSection, SamplingSection
from .stepsizes import MULTILEVEL_SIZE
from .surfaces import TARGET_KEYS, measuresOf, ownAreaDifferences, surfacesOf, targetsOf


def requireEffect(config: Config, resolved: Config, mesh: Mesh) -> None:
    """Raise a ValueError if something that a Config gives has no effect, from what it is when it is resolved."""
    _requireEffectiveKeys(config)
    _requireEffectiveTargets(config, resolved, MeasuredMesh(mesh))


# The keys of a section that have no effect where another one is 0, as it is by default.
_SWITCHES = (
    ("repulsion", "modulus", ("onset", "length_scale", "exponent", "exclusion_level")),
    ("sampling", "exchange_probability", ("exchange_fraction", "exchange_proposal")),
    (
        "sampling",
        "shear_wave_probability",
        ("shear_waves_per_step", "shear_wave_cutoff", "shear_wave_amplitude"),
    ),
)


def _requireEffectiveKeys(config: Config) -> None:
    """A key that switches on what others describe must be given with them, be it to switch it off."""
    for section, switch, keys in _SWITCHES:
        given = getattr(config, section).model_fields_set
        for key in keys:
            if key in given and switch not in given:
                raise ValueError(
                    f"{config.source}: [{section}] {key} is {getattr(getattr(config, section), key)}, and has no "
                    f"effect, since {switch} is 0 by default; give a {switch}, or leave {key} out"
                )
    for key, follows in (("burn_in", hasBurnIn), ("target_acceptance", hasAim)):
        value = getattr(config.sampling, key)
        if value != SamplingSection.model_fields[key].default and not follows(config):
            raise ValueError(
                f"{config.source}: [sampling] {key} is {value}, and has no effect, since no step_size is 'auto'; make "
                f"it that, or leave {key} out"
            )


def _requireEffectiveTargets(config: Config, resolved: Config, measured: MeasuredMesh) -> None:
    """The mesh's own area, volume or area difference does no harm."""
    membrane = config.membrane
    parts = [during(resolved, index) for index in range(-1, len(resolved.stages))]
    for total, keys in TARGET_KEYS.items():
        given = [key for key in keys if getattr(membrane, key) is not None]
        if not given or any(valueOf(part, MODULI[total]) > 0 for part in parts):
            continue
        own = ownAreaDifferences(config, measured) if total == "areaDifference" else measuresOf(measured)
        targets = targetsOf(surfacesOf(resolved, measured))
        isIdle = not all(math.isclose(targets[name], own[name]) for name in own if totalOf(name) == total)
        if isIdle and not (total == "area" and membrane.reduced_volume is not None):
            raise ValueError(
                f"{config.source}: [membrane] {given[0]} is {shortened(str(getattr(membrane, given[0])))}, and has no "
                f"effect, since {MODULUS_NAMES[total]} is 0; make it positive, or leave {given[0]} out"
            )


def chosenForSize(config: Config, resolved: Config) -> list[str]:
    """Return sentences about what a Config leaves open, and a resolved one has for the size of the mesh: momenta on
    coarser meshes, and larger moduli of area and volume.
    """
    weight, sentences = resolved.sampling.multilevel_weight, []
    if config.sampling.multilevel_weight == "auto" and weight != 0:
        sentences = [f"[sampling] multilevel_weight is {weight:g}, as a surface has {MULTILEVEL_SIZE} vertices or more"]
    for key in GROWING_MODULI:
        modulus, default = getattr(resolved.membrane, key), MembraneSection.model_fields[key].default
        if key not in config.membrane.model_fields_set and modulus > default:
            sentences.append(f"[membrane] {key} is {modulus:.3g} kT, {MODULUS_PER_VERTEX} for each vertex")
    return sentences


def changedIntervals(config: Config, resolved: Config) -> list[str]:
    """Return a sentence for each interval of a Config that is shorter when it is resolved."""
    sentences = []
    for key, why in (
        ("observables_interval", "so that each window, and the run, has a row"),
        ("trajectory_interval", "so that the run has a frame"),
    ):
        given, taken = getattr(config.output, key), getattr(resolved.output, key)
        if key in config.output.model_fields_set and given != taken:
            sentences.append(f"[output] {key} is {taken}, and not {given}, {why}")
    return sentences
