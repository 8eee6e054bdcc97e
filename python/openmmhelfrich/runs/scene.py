"""From a configuration to an openmm.app.Simulation.  Each step is a function that a script can call on its own."""

import math
import random
from pathlib import Path

import openmm as mm
from openmm import app

from .config import stagesOf
from ..helfrich import HelfrichForce, HybridMonteCarloIntegrator, ShearWaveIntegrator
from ..geometry.mesh import Mesh
from ..sampling.reporters import thermalEnergy


def loadMesh(config):
    """Read or make, and check, the mesh of a Config, in its length unit."""
    if config.mesh.file is None:
        source, mesh = "[mesh] icosphere", Mesh.icosphere(config.mesh.icosphere, config.mesh.scale)
    else:
        source, mesh = config.mesh.file, Mesh.read(config.mesh.file, unit=config.mesh.scale)
    try:
        mesh.check()
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
    length = mesh.edgeLengths.mean()
    if not 0.01 <= length <= 10:
        raise ValueError(
            f"{source}: the mean edge length is {length:.3g} {config.mesh.length_unit}; it must be between 0.01 and 10, "
            f"where the tether's power laws are meant to be used: try scale = {config.mesh.scale * 10 ** -round(math.log10(4 * length)):g} in [mesh]"
        )
    return mesh


def createForce(config, mesh):
    """Create the HelfrichForce that a Config describes, with the mesh's own geometry where it names no target."""
    kT, membrane = thermalEnergy(config.sampling.temperature), config.membrane
    force = HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(membrane.bending_modulus * kT)
    force.setAreaModulus(membrane.area_modulus * kT)
    force.setVolumeModulus(membrane.volume_modulus * kT)
    force.setAreaDifferenceModulus(membrane.area_difference_modulus * kT)
    force.setLeafletSeparation(membrane.leaflet_separation)
    area, volume, areaDifference = targets(config, mesh)
    force.setTargetArea(area)
    force.setTargetVolume(volume)
    force.setTargetAreaDifference(areaDifference)
    modulus, minLength, maxLength, lengthScale = tetherParameters(config, mesh)
    force.setTether(modulus * kT, minLength, maxLength, config.tether.exponent)
    force.setTetherLengthScale(lengthScale)
    if config.repulsion.modulus > 0:
        onset = config.repulsion.onset or minLength
        force.setRepulsion(
            config.repulsion.modulus * kT, onset, config.repulsion.exponent, config.repulsion.exclusion_level
        )
    return force


def targets(config, mesh):
    """Return A_0, V_0 and dA_0."""
    membrane = config.membrane
    area = membrane.target_area or mesh.area
    volume = membrane.target_volume or mesh.volume
    if membrane.reduced_volume is not None:
        volume = membrane.reduced_volume * area**1.5 / (6 * math.sqrt(math.pi))
    areaDifference = membrane.target_area_difference
    if areaDifference is None:
        areaDifference = 2 * membrane.leaflet_separation * mesh.vertexMeanCurvatures.sum()
    return area, volume, areaDifference


def tetherParameters(config, mesh):
    """Return the modulus, in kT, the least and the greatest length of an edge, and the unit of length.

    The defaults are soft where edges are short, so that steps are long, and their pull and push on the area of a fluid membrane cancel, entropy included.
    Edges beyond them at the start cost no more than a few hundred kT, and soon come back.
    """
    tether, mean = config.tether, mesh.edgeLengths.mean()
    minLength, maxLength = tether.min_length or 0.83 * mean, tether.max_length or 1.33 * mean
    if minLength >= maxLength:
        raise ValueError(
            f"[tether] min_length is {minLength:.4g} and max_length {maxLength:.4g}; min_length must be less"
        )
    r, modulus = tether.exponent, tether.modulus
    lengthScale = tether.length_scale or (mean if modulus is None else 1.0)
    if modulus is None:
        modulus = 4 / (r ** (r + 1) * (0.1 * mean / lengthScale) ** r)
    return modulus, minLength, maxLength, lengthScale


def defaultStepSize(config, mesh):
    """Return the size of a leapfrog step, in ps, for a Config that names none.

    Steps must be short against the fastest motion, of frequency sqrt(stiffness/mass), and since the acceptance of a trajectory falls with the number
    of vertices, they shrink as its fourth root.  The factor was found by trial on spheres of 162 to 2562 vertices and on the red blood cell, to accept about
    three trajectories in four and to let none of two thousand diverge.
    """
    sampling, kT = config.sampling, thermalEnergy(config.sampling.temperature)
    return 2.4 * math.sqrt(sampling.mass / (_stiffness(config, mesh) * kT)) / len(mesh.vertices) ** 0.25


def _stiffness(config, mesh):
    """Estimate the largest second derivative of the energy, in kT per squared length unit.

    The estimates are those for a vertex of a flat sheet of equilateral triangles (bending, with thermal roughness: area), for all vertices moving
    along the normal (volume), for an edge so short that the tether's exponential branch holds 1 kT, and for a vertex some of whose edges are as much too long.
    """
    membrane, number, length = config.membrane, len(mesh.vertices), mesh.edgeLengths.mean()
    area, volume, _ = targets(config, mesh)
    bending = 100 * membrane.bending_modulus / length**2
    constraints = 0.7 * membrane.area_modulus / (number * length**2) + 2 * membrane.volume_modulus * area**2 / (
        number * volume**2
    )
    modulus, minLength, _, lengthScale = tetherParameters(config, mesh)
    r = config.tether.exponent
    decades = math.log(max(modulus / (minLength / lengthScale) ** r, 1.0))
    spring = r * (r - 1) * (r ** (r + 1) * modulus) ** (2 / r) / lengthScale**2
    return bending + constraints + ((decades + 1) ** 2 / minLength) ** 2 + 4 * spring


def resolve(config, mesh):
    """Return a copy of a Config in which every default is a number, also those that follow from the mesh, and the stages are listed.

    Only an "auto" step size stays as it is: what it becomes is known after the burn-in.
    """
    config = config.model_copy(deep=True)
    membrane, tether, repulsion, sampling = config.membrane, config.tether, config.repulsion, config.sampling
    area, volume, areaDifference = targets(config, mesh)
    membrane.target_area, membrane.target_volume, membrane.reduced_volume = area, volume, None
    membrane.target_area_difference = areaDifference or None
    tether.modulus, tether.min_length, tether.max_length, tether.length_scale = tetherParameters(config, mesh)
    repulsion.onset = repulsion.onset or tether.min_length
    sampling.seed = sampling.seed or random.SystemRandom().randrange(1, 2**31)
    sampling.step_size = sampling.step_size or defaultStepSize(config, mesh)
    config.stages = stagesOf(config)
    sampling.model_fields_set.discard("steps")
    # However short the run is, its end is there, and every window of a continuation.
    steps, output = sum(stage.totalSteps for stage in config.stages), config.output
    windows = [stage.steps for stage in config.stages if stage.kind == "continue"]
    output.trajectory_interval, output.observables_interval = (
        min(output.trajectory_interval, steps),
        min(output.observables_interval, steps, *windows),
    )
    if config.mesh.file is not None:
        config.mesh.file = str(Path(config.mesh.file).resolve())
    return config


def createSimulation(config, mesh, force):
    """Create the app.Simulation of a membrane, at the mesh's positions."""
    sampling = config.sampling
    system = mesh.createSystem(sampling.mass)
    system.addForce(force)
    stepSize = sampling.step_size if isinstance(sampling.step_size, float) else defaultStepSize(config, mesh)
    integrator = HybridMonteCarloIntegrator(
        sampling.temperature, stepSize, sampling.steps_per_trajectory, sampling.flip_fraction, sampling.flip_probability
    )
    integrator.setSplitting(sampling.integrator)
    integrator.setTetherSubsteps(sampling.tether_substeps)
    integrator.setTrajectoryJitter(sampling.trajectory_jitter)
    integrator.setMomentumRefreshment(sampling.momentum_refreshment)
    if sampling.shear_wave_probability > 0:
        integrator.addShearWaves(createShearWaves(config, mesh), sampling.shear_wave_probability)
    integrator.setForcePrecision(config.platform.precision)
    integrator.setRandomNumberSeed(sampling.seed or 0)
    simulation = app.Simulation(mesh.topology(), system, integrator, *platformOf(config))
    simulation.context.setPositions(mesh.vertices)
    return simulation


def createShearWaves(config, mesh):
    """Create the ShearWaveIntegrator that a Config describes.

    The longest wave has the wave number 1/R of a sphere with the target area.  The amplitude to begin with is a rule of thumb: the energy of a strain s
    changes by about s sqrt(N) kT, whatever the moduli.
    """
    sampling, radius = config.sampling, math.sqrt(targets(config, mesh)[0] / (4 * math.pi))
    amplitude = sampling.shear_wave_amplitude
    if not isinstance(amplitude, float):
        amplitude = 0.7 * radius / math.sqrt(len(mesh.vertices))
    return ShearWaveIntegrator(
        sampling.temperature, amplitude, 1 / radius, sampling.shear_wave_cutoff / radius, sampling.shear_waves_per_step
    )


def currentMesh(simulation, force):
    """Return a Mesh of the present positions and live triangles."""
    positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
    return Mesh(positions, force.getTrianglesInContext(simulation.context))


def platformOf(config):
    """Return the Platform and its properties."""
    names = [mm.Platform.getPlatform(i).getName() for i in range(mm.Platform.getNumPlatforms())]
    name, threads = config.platform.name, config.platform.threads
    if name not in names:
        raise ValueError(f"[platform] name is '{name}'; it must be one of {', '.join(names)}")
    if threads is not None and name != "CPU":
        raise ValueError(f"[platform] threads is {threads}; only the CPU platform has threads, not {name}")
    if config.platform.precision != "double" and name != "CPU":
        raise ValueError(
            f"[platform] precision is '{config.platform.precision}'; only the CPU platform has another than 'double', not {name}"
        )
    return mm.Platform.getPlatformByName(name), {} if threads is None else {"Threads": str(threads)}
