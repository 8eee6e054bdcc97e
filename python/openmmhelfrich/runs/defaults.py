"""What a configuration leaves open: the numbers that follow from its mesh."""

import random
from pathlib import Path

import numpy as np

from ..geometry.measured import MeasuredMesh
from ..sampling.targets import MODULUS_NAMES, listedTargets, requireOnePerSurface, totalOf
from .additions import fixedVertices
from .approach import withApproaches
from .config import Config, stagesOf
from .sections import MembraneSection
from .sizes import requireComparableTargets
from .stepsizes import defaultStepSize, multilevelWeight
from .surfaces import heldOf, measuresOf, ownAreaDifferences, surfacesOf, targetsOf
from .tethers import requireShortEdges, tetherOf

MAX_PSF_VERTICES = 200_000  # for which a run writes a PSF file unasked


def resolve(config: Config, measured: MeasuredMesh) -> Config:
    """Return a copy of a Config in which every default is a number, also those that follow from the mesh, and the
    stages are listed.

    Only an "auto" step size stays as it is: what it becomes is known after the burn-in.
    """
    config, mesh = config.model_copy(deep=True), measured.mesh
    if mesh.isPeriodic:
        _leaveOutVolume(config, measured)
    _holdLargeSurfaces(config.membrane, measured)
    membrane, tether, repulsion, sampling = config.membrane, config.tether, config.repulsion, config.sampling
    surfaces = surfacesOf(config, measured)
    for stage in stagesOf(config):
        for name in stage.targetNames():
            requireOnePerSurface(f"{stage.title}: {name}", getattr(stage, name), len(surfaces))
    targets = targetsOf(surfaces)
    requireComparableTargets(config, measured, targets)
    config.stages = stagesOf(config)
    if sampling.approach == "auto":
        config.stages, targets = withApproaches(
            config.stages, _measuresHeld(config, measured), targets, len(mesh.vertices), heldOf(config)
        )
        sampling.approach = "none"  # what it means is among the stages now
    membrane.target_area, membrane.target_volume, membrane.reduced_volume = (
        listedTargets(targets, "area"),
        None if mesh.isPeriodic else listedTargets(targets, "volume"),
        None,
    )
    areaDifferences = listedTargets(targets, "areaDifference")
    membrane.target_area_difference = areaDifferences if np.all(areaDifferences) else None
    tether.modulus, tether.min_length, tether.max_length, tether.length_scale = tetherOf(config, measured)
    if mesh.isPeriodic and tether.modulus > 0:
        requireShortEdges(tether.max_length, mesh)
    repulsion.onset = repulsion.onset or tether.min_length
    sampling.seed = sampling.seed or random.SystemRandom().randrange(1, 2**31)
    sampling.step_size = sampling.step_size or defaultStepSize(config, measured)
    if sampling.multilevel_weight == "auto":
        sampling.multilevel_weight = multilevelWeight(config, measured)
    sampling.model_fields_set.discard("steps")
    # However short the run is, its end is there, and every window of a continuation.
    steps, output = sum(stage.totalSteps for stage in config.stages), config.output
    output.trajectory_interval = min(output.trajectory_interval, steps)
    output.psf = len(mesh.vertices) <= MAX_PSF_VERTICES if output.psf is None else output.psf
    longest = min(stage.longestInterval for stage in config.stages)
    output.observables_interval = int(min(output.observables_interval, steps, longest))
    if config.mesh.file is not None:
        config.mesh.file = str(Path(config.mesh.file).resolve())
    system = config.system
    system.fixed, system.fixed_box = fixedVertices(system, mesh) or None, None
    system.forces = system.forces and [str(Path(file).resolve()) for file in system.forces]
    return config


# What a stage or [membrane] may give that a periodic membrane has not.
_OF_VOLUME = ("volume_modulus", "pressure", "target_volume", "reduced_volume")


def _leaveOutVolume(config: Config, measured: MeasuredMesh) -> None:
    """Turn the volume of the Config of a periodic membrane off, and its area where that is not asked for; raise a
    ValueError if the Config gives what such a membrane has not.
    """
    membrane, sampling = config.membrane, config.sampling
    if not all(surface.isPeriodic for surface in measured.surfaces):
        raise ValueError("the mesh has surfaces that are periodic and others that are not; give all of one kind")
    for where, section in (("[membrane]", membrane), *((stage.title, stage) for stage in stagesOf(config))):
        given = [name for name in _OF_VOLUME if name in section.model_fields_set and getattr(section, name)]
        if given:
            raise ValueError(
                f"{where}: {given[0]} is {getattr(section, given[0])}, but the mesh is periodic and encloses no "
                "volume; leave it out"
            )
    if sampling.shear_wave_probability > 0:
        raise ValueError(
            f"[sampling] shear_wave_probability is {sampling.shear_wave_probability:g}, but the mesh is periodic, and "
            "such waves would tear it at the borders of the box; multilevel_weight moves long waves, too"
        )
    membrane.volume_modulus = 0.0
    if "area_modulus" not in membrane.model_fields_set:
        membrane.area_modulus = 0.0


# The moduli that grow with the mesh where they are not given, and by how many kT for each vertex.
GROWING_MODULI, MODULUS_PER_VERTEX = ("area_modulus", "volume_modulus"), 390


def _holdLargeSurfaces(membrane: MembraneSection, measured: MeasuredMesh) -> None:
    """Let moduli of area and volume that are not given grow with the number of vertices of the largest surface.

    Vertices press on each other in the plane as the molecules of a gas do, so that the same modulus would be too soft
    for more of them.  Up to 2,562 vertices the defaults are those of any small mesh.
    """
    modulus = float(MODULUS_PER_VERTEX * max(len(surface.vertices) for surface in measured.surfaces))
    for key in GROWING_MODULI:
        if key not in membrane.model_fields_set:
            setattr(membrane, key, max(getattr(membrane, key), modulus))


def _measuresHeld(config: Config, measured: MeasuredMesh) -> dict[str, float]:
    """Return what the mesh has of the targets whose terms are on at some time, by their names."""
    given = [stage.conditions() for stage in config.stages]
    on = heldOf(config) | {total for total, name in MODULUS_NAMES.items() if any(each.get(name) for each in given)}
    measures = measuresOf(measured) | (ownAreaDifferences(config, measured) if "areaDifference" in on else {})
    return {name: value for name, value in measures.items() if totalOf(name) in on}
