"""From a configuration to a scene: everything that a run needs to know before its first step, and its Simulation."""

import contextlib
import math
import os
import random
import threading
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import openmm as mm
from numpy.typing import NDArray
from openmm import app

from ..files import PathLike
from ..geometry.measured import MeasuredMesh
from ..geometry.measures import volumeOfReduced
from ..geometry.mesh import Mesh
from ..helfrich import (
    HelfrichForce,
    HybridMonteCarloIntegrator,
    ShearWaveIntegrator,
    SpeciesExchangeIntegrator,
)
from ..messages import quoted, shortened
from ..sampling.targets import (
    listedTargets,
    numberedTargets,
    requireComparableTarget,
    requireOnePerSurface,
    setDefaultTargets,
    sphereDifference,
    totalOf,
)
from ..units import thermalEnergy
from .additions import Setup, addSection, beadPositions, fixedVertices
from .approach import FAR, MODULUS_NAMES, targetInWords, withApproaches
from .config import Config, asConfig, asDict, during, hasBurnIn, namingSource, stagesOf, valueOf
from .material import (
    bendingModulusOf,
    gaussianStepOf,
    numbered,
    requireOnePlace,
    requireResolved,
    setMaterial,
    speciesOf,
    spontaneousCurvatureOf,
)
from .memory import requireMemory
from .sections import GREATEST, LEAST, MODULI, MembraneSection, SamplingSection
from .stagesettings import StageSettings, givenConditions

# By so much a length may differ from the mesh's own, and a step size from the rule of thumb.
GREATEST_FACTOR = 1e6
# Of flips in a sweep: what SweepEdgeFlipsKernel makes.
MOST_ATTEMPTS = 2**33
# More threads than this for each processor would wait for each other.
THREADS_PER_PROCESSOR = 32
MAX_PSF_VERTICES = 200_000  # for which a run writes a PSF file unasked


class Tether(NamedTuple):
    """A tether: its modulus, in kT, the least and greatest length of an edge, and the length scale of its energy."""

    modulus: float
    minLength: float
    maxLength: float
    lengthScale: float


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """A membrane and the conditions of a run, with a value for everything.

    ::

        scene = mh.Scene.of({"membrane": {"reduced_volume": 0.98}}, mesh)
        print(scene.tether, scene.stepSize, scene.targets)

    Attributes
    ----------
    config : Config
        the configuration, with every default filled in: what settings files and checkpoints hold. What may be left
        out of a file, and simulates, is an attribute here, and not to be read from it
    mesh : Mesh
        the membrane at the beginning
    lengthUnit : str
        what 1 nm is called
    temperature, kT : float
        in K, and in kJ/mol: the unit of the energies in results
    moduli : dict of float
        the modulus of each term, in kJ/mol and powers of nm
    targets : dict of float
        by the names of :mod:`openmmhelfrich.sampling.targets`, in powers of nm: each surface has its own
    targetScales : dict of float
        what targets are compared with, by the same names: the areas and volumes of the mesh, and the area differences
        of spheres of these areas
    tether : Tether
        the bounds of edges
    vertexSpecies : array of int
        the number of the species of each vertex at the beginning; of none if there are no species
    repulsionOnset : float
        the distance below which vertices repel each other, in nm
    stepSize, waveAmplitude : float
        those to begin with, in ps and nm
    adaptsStepSize, adaptsWaveAmplitude : bool
        whether they adapt
    seed : int
        of all random numbers
    stages : tuple of StageSettings
        what to do
    platform : openmm.Platform
        where to compute
    platformProperties : dict of str
        the properties of that
    setup : callable or None
        what adds a user's own forces and beads: see :func:`openmmhelfrich.run`
    """

    config: Config
    mesh: Mesh
    lengthUnit: str
    temperature: float
    kT: float
    moduli: dict[str, float]
    targets: dict[str, float]
    targetScales: dict[str, float]
    tether: Tether
    vertexSpecies: NDArray[np.intc]
    repulsionOnset: float
    stepSize: float
    adaptsStepSize: bool
    waveAmplitude: float
    adaptsWaveAmplitude: bool
    seed: int
    stages: tuple[StageSettings, ...]
    platform: mm.Platform
    platformProperties: dict[str, str]
    setup: Setup | None = None

    def __repr__(self) -> str:
        stages = ", ".join(stage.title for stage in self.stages)
        return (
            f"<Scene: {len(self.mesh.vertices)} vertices, {stages}, steps of {self.stepSize:.3g} ps, seed {self.seed}, "
            f"{self.platform.getName()}>"
        )

    @property
    def speciesNames(self) -> tuple[str, ...]:
        """What the species are called."""
        return tuple(species.name for species in self.config.species)

    @classmethod
    def of(
        cls, config: Config | dict[str, Any] | PathLike, mesh: Mesh | None = None, setup: Setup | None = None
    ) -> "Scene":
        """Create the Scene of a configuration, with the mesh that it names or another.

        ::

            scene = mh.Scene.of({"membrane": {"reduced_volume": 0.98}}, mesh)
            force = scene.createForce()
            simulation = scene.createSimulation(force)
            simulation.step(1000)

        Parameters
        ----------
        config : Config, dict or path
            a Config, the nested dict of one, whose values may be Quantities, or the name of a TOML file
        mesh : Mesh, optional
            the membrane; where it is given the configuration needs no [mesh]
        setup : callable, optional
            what adds forces and beads: see :func:`openmmhelfrich.run`

        Raises
        ------
        ValueError, OSError
            if the mesh cannot be simulated, or a value of the configuration does not go with it

        A UserWarning says that targets are far from what the mesh has: see :func:`openmmhelfrich.continueTo`.
        """
        if setup is not None and not callable(setup):
            raise TypeError(f"setup is {setup!r}; it must be a function of the System and the Scene")
        isChecked = isinstance(config, Config)
        config = asConfig(config, hasMesh=mesh is not None)
        if mesh is not None:
            with namingSource(config):
                requireOnePlace(config, mesh)
        scene = createScene(config, loadMesh(config) if mesh is None else mesh, setup)
        if not isChecked:
            requireEffect(config, scene)
            scene._warnOfFarTargets()
        return scene

    @property
    def changing(self) -> list[str]:
        """The names of the conditions that stages change, with the numbers of species."""
        return [numbered(self.config, name) for name in givenConditions(self.stages)]

    def during(self, index: int) -> "Scene":
        """Return the Scene with the moduli that it has during one of its stages, at the end of it; -1 is before all."""
        config = during(self.config, index)
        return replace(self, config=config, moduli=_moduliOf(config, self.kT))

    def _warnOfFarTargets(self) -> None:
        """Say that the first of the stages leads to targets to which a Simulation by itself does not go."""
        if self.stages[0].isAdded:
            warnings.warn(
                f"targets are more than {FAR:.0%} from what the mesh has, and a Simulation of this Scene keeps to the "
                "mesh's own: lead it there by continueTo(), or give approach = 'none' in [sampling]",
                stacklevel=3,
            )

    def createForce(self) -> HelfrichForce:
        """Create the membrane's force."""
        membrane, tether, repulsion, moduli = self.config.membrane, self.tether, self.config.repulsion, self.moduli
        force = HelfrichForce()
        force.setTriangles(self.mesh.triangles)
        force.setUsesPeriodicBoundaryConditions(self.mesh.isPeriodic)
        setMaterial(force, self.config, self.vertexSpecies, self.kT)
        force.setAreaModulus(moduli["area"])
        force.setVolumeModulus(moduli["volume"])
        force.setAreaDifferenceModulus(moduli["areaDifference"])
        force.setLeafletSeparation(membrane.leaflet_separation)
        setDefaultTargets(force, self.targets)
        force.setTether(moduli["tether"], tether.minLength, tether.maxLength, self.config.tether.exponent)
        force.setTetherLengthScale(tether.lengthScale)
        force.setTension(moduli["tension"])
        force.setPressure(moduli["pressure"])
        if moduli["repulsion"] > 0:
            force.setRepulsion(moduli["repulsion"], self.repulsionOnset, repulsion.exponent, repulsion.exclusion_level)
            force.setRepulsionLengthScale(repulsion.length_scale or 1.0)
        return force

    def createIntegrator(self) -> HybridMonteCarloIntegrator:
        """Create the integrator."""
        sampling = self.config.sampling
        integrator = HybridMonteCarloIntegrator(
            self.temperature,
            self.stepSize,
            sampling.steps_per_trajectory,
            sampling.flip_fraction,
            sampling.flip_probability,
        )
        integrator.setSplitting(sampling.integrator)
        integrator.setTetherSubsteps(sampling.tether_substeps)
        integrator.setTrajectoryJitter(sampling.trajectory_jitter)
        integrator.setMomentumRefreshment(sampling.momentum_refreshment)
        integrator.setMultilevelWeight(sampling.multilevel_weight)
        if sampling.exchange_probability > 0:
            integrator.addMove(self._createExchanges(), sampling.exchange_probability)
        if sampling.shear_wave_probability > 0:
            integrator.addShearWaves(self._createShearWaves(), sampling.shear_wave_probability)
        integrator.setForcePrecision(self.config.platform.precision)
        integrator.setRandomNumberSeed(self.seed)
        return integrator

    def createSimulation(self, force: HelfrichForce) -> app.Simulation:
        """Create the Simulation of a force that :meth:`createForce` made, at the mesh's positions, with what is beside
        the membrane.
        """
        system, mesh = self.createSystem(force)
        integrator, topology = self.createIntegrator(), mesh.topology()
        simulation = app.Simulation(topology, system, integrator, self.platform, self.platformProperties)
        simulation.context.setPositions(np.concatenate((mesh.vertices, mesh.beads)))
        return simulation

    def createSystem(self, force: HelfrichForce) -> tuple[mm.System, Mesh]:
        """Create the System of a force that :meth:`createForce` made, with what is beside the membrane; return it and
        the mesh with its beads.
        """
        system = self.mesh.createSystem(self.config.sampling.mass)
        system.addForce(force)
        addSection(system, self.config.system)
        positions = None if self.setup is None else self.setup(system, self)
        beads = beadPositions(positions, system.getNumParticles() - len(self.mesh.vertices))
        return system, Mesh(self.mesh.vertices, self.mesh.triangles, self.mesh.images, beads)

    def _createExchanges(self) -> SpeciesExchangeIntegrator:
        """Create the integrator of exchanges of species."""
        exchanges = SpeciesExchangeIntegrator(self.temperature, self.config.sampling.exchange_fraction)
        exchanges.setProposal(self.config.sampling.exchange_proposal)
        for i, species in enumerate(self.config.species):
            exchanges.setChemicalPotential(i, species.chemical_potential * self.kT)
        return exchanges

    def _createShearWaves(self) -> ShearWaveIntegrator:
        """Create the integrator of shear waves; the longest has the wave number 1/R of a sphere of the target area, of
        several surfaces that of the largest.
        """
        areas = [value for name, value in self.targets.items() if totalOf(name) == "area"]
        sampling, radius = self.config.sampling, _radius(max(areas))
        return ShearWaveIntegrator(
            self.temperature,
            self.waveAmplitude,
            1 / radius,
            sampling.shear_wave_cutoff / radius,
            sampling.shear_waves_per_step,
        )


def createScene(config: Config, mesh: Mesh, setup: Setup | None = None) -> Scene:
    """Return the Scene of a Config with a mesh, which keeps the species that it has.

    Species of the Config may have places: those of a run that goes on say where they were at its start.
    """
    measured = MeasuredMesh(mesh)
    with namingSource(config), _overflowsExplained(config):
        config = resolve(config, measured)
        checkSizes(config, measured)
        vertexSpecies = speciesOf(config, mesh)
        platform, properties = platformOf(config)
    sampling, kT = config.sampling, thermalEnergy(config.sampling.temperature)
    surfaces = _surfaces(config, measured)
    tether = tetherOf(config, measured)
    adaptsStepSize, adaptsWaves = sampling.step_size == "auto", sampling.shear_wave_amplitude == "auto"
    return Scene(
        config=config,
        mesh=mesh,
        lengthUnit=config.mesh.length_unit,
        temperature=sampling.temperature,
        kT=kT,
        moduli=_moduliOf(config, kT),
        targets=_targets(surfaces),
        targetScales=_targetScales(config, measured),
        tether=tether,
        vertexSpecies=vertexSpecies,
        repulsionOnset=config.repulsion.onset or tether.minLength,
        stepSize=defaultStepSize(config, measured) if adaptsStepSize else sampling.step_size,
        adaptsStepSize=adaptsStepSize,
        waveAmplitude=_defaultAmplitude(max(surface.area for surface in surfaces), mesh)
        if adaptsWaves
        else sampling.shear_wave_amplitude,
        adaptsWaveAmplitude=adaptsWaves,
        seed=sampling.seed or 0,
        stages=tuple(config.stages),
        platform=platform,
        platformProperties=properties,
        setup=setup,
    )


def _moduliOf(config: Config, kT: float) -> dict[str, float]:
    """Return the modulus of each term, in kJ/mol and powers of nm."""
    moduli = {term: valueOf(config, key) * kT for term, key in MODULI.items()}
    return moduli | {"bending": bendingModulusOf(config) * kT}


def loadMesh(config: Config) -> Mesh:
    """Read or make, and check, the mesh of a Config, in its length unit.

    Its notes say what has been done to it.
    """
    if config.mesh.icosphere is not None:
        source, mesh = "[mesh] icosphere", Mesh.icosphere(config.mesh.icosphere, config.mesh.scale)
    elif config.mesh.sheet is not None:
        source, scale = "[mesh] sheet", config.mesh.scale
        width, height, edge = config.mesh.sheet
        mesh = Mesh.sheet(scale * width, scale * height, scale * edge)
    else:
        source = str(config.mesh.file)
        field = config.mesh.species_field
        mesh = Mesh.read(source, unit=config.mesh.scale, repair=config.mesh.repair, speciesField=field)
        if field is None:
            mesh.species = None  # [[species]] say where they are
    try:
        mesh.check()
        if config.mesh.remesh is not None:
            with warnings.catch_warnings(record=True):  # they are among the notes
                mesh = mesh.remeshed(config.mesh.remesh)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
    mesh = _subdivided(mesh, config.mesh.subdivide or 0)
    if config.mesh.species_field is not None and mesh.species is None:
        raise ValueError(f"{source}: the mesh has been repaired or remeshed, and so cannot have a species_field")
    return mesh


def _subdivided(mesh: Mesh, times: int) -> Mesh:
    """Return the mesh, subdivided, if the memory is there that a run of it takes."""
    try:
        if times > 0:
            requireMemory(len(mesh.vertices) + 3 * len(mesh.triangles) // 2 * (4**times - 1) // 3)
        return mesh.subdivided(times)
    except ValueError as error:
        raise ValueError(f"[mesh] subdivide is {times}: {error}") from None


def platformOf(config: Config) -> tuple[mm.Platform, dict[str, str]]:
    """Return the Platform that a Config asks for, and its properties."""
    names = [mm.Platform.getPlatform(i).getName() for i in range(mm.Platform.getNumPlatforms())]
    name, threads = config.platform.name, config.platform.threads
    if name == "CPU":
        _checkThreads(threads)
    if name not in names:
        raise ValueError(f"[platform] name is {quoted(name)}; it must be one of {', '.join(names)}")
    if threads is not None and name != "CPU":
        raise ValueError(f"[platform] threads is {threads}; only the CPU platform has threads, not {name}")
    if config.platform.precision != "double" and name != "CPU":
        raise ValueError(
            f"[platform] precision is '{config.platform.precision}'; only the CPU platform has another than 'double', "
            f"not {name}"
        )
    return mm.Platform.getPlatformByName(name), {} if threads is None else {"Threads": str(threads)}


def _checkThreads(threads: int | None) -> None:
    """Raise a ValueError if the system cannot start so many threads: the program would end without a word."""
    processors = os.cpu_count() or 1
    count, most = threads or processors, THREADS_PER_PROCESSOR * processors
    if count > most:
        raise ValueError(
            f"the number of threads is {count}; it must be at most {most}, {THREADS_PER_PROCESSOR} for each of the "
            f"{processors} processors that there are"
        )
    done, started = threading.Event(), 0
    try:
        for _ in range(2 * count):  # OpenMM's own, and as many of the force's
            threading.Thread(target=done.wait, daemon=True).start()
            started += 1
    except RuntimeError:
        raise ValueError(
            f"the number of threads is {count}, and the system lets this program start {started // 2}; ask for fewer, "
            "or look at its limits of processes and memory"
        ) from None
    finally:
        done.set()


@contextlib.contextmanager
def _overflowsExplained(config: Config) -> Iterator[None]:
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
        radius = _radius(measured.mesh.area)
        requireComparable("[sampling] shear_wave_amplitude", sampling.shear_wave_amplitude, radius, "the radius")


def requireTrajectories(sampling: SamplingSection) -> None:
    """Raise a ValueError if there are no trajectories by which a step size could be found."""
    others = sampling.flip_probability + sampling.shear_wave_probability + sampling.exchange_probability
    if others >= 1:
        raise ValueError(
            "step_size is 'auto', and the probabilities of [sampling] of moves other than trajectories add up to "
            f"{others:g}; they must leave trajectories by which it is found"
        )


def _requireComparableTargets(config: Config, measured: MeasuredMesh, targets: dict[str, float]) -> None:
    """Raise a ValueError if a target before the stages has nothing to do with the mesh.  That of an area difference,
    which may be near 0 where nothing is held to it, counts where it is.
    """
    for name, scale in _targetScales(config, measured).items():
        total = totalOf(name)
        if total != "areaDifference" or total in _held(config):
            isReduced = total == "volume" and config.membrane.reduced_volume is not None
            key = _TARGET_KEYS[total][1][0] + name.removeprefix(total)
            what = targetInWords(config.membrane, name) if isReduced else key
            requireComparableTarget(f"[membrane] {what}", name, targets[name], scale)


def _targetScales(config: Config, measured: MeasuredMesh) -> dict[str, float]:
    """Return what targets are compared with, of each surface."""
    separation = config.membrane.leaflet_separation
    spheres = [sphereDifference(area, separation) for area in measured.areas]
    return _measures(measured) | numberedTargets("areaDifference", spheres)


def _measures(measured: MeasuredMesh) -> dict[str, float]:
    """Return the area and volume of each surface."""
    volumes = [volume for volume in measured.volumes if volume is not None]
    return {
        **numberedTargets("area", measured.areas),
        **(numberedTargets("volume", volumes) if volumes else {}),
    }


def _held(config: Config) -> set[str]:
    """Return the totals that a Config's membrane is held to targets of, before its stages."""
    return {total for total in _TARGET_KEYS if valueOf(config, MODULI[total]) > 0}


def _measuresHeld(config: Config, measured: MeasuredMesh) -> dict[str, float]:
    """Return what the mesh has of the targets whose terms are on at some time, by their names."""
    given = [stage.conditions() for stage in config.stages]
    on = _held(config) | {total for total, name in MODULUS_NAMES.items() if any(each.get(name) for each in given)}
    measures = _measures(measured) | (_ownAreaDifferences(config, measured) if "areaDifference" in on else {})
    return {name: value for name, value in measures.items() if totalOf(name) in on}


def requireComparable(name: str, value: float | str | None, own: float, what: str) -> None:
    """Raise a ValueError if a number, unless it is none, is not within a large factor of another one."""
    if not isinstance(value, float):
        return
    if not abs(own) / GREATEST_FACTOR <= abs(value) <= abs(own) * GREATEST_FACTOR:
        raise ValueError(f"{name} is {value:g}; it must be within a factor of {GREATEST_FACTOR:g} of {what} {own:.4g}")


def requireEffect(config: Config, scene: Scene) -> None:
    """Raise a ValueError if something that a Config, which is not resolved, gives has no effect in its Scene."""
    _requireEffectiveKeys(config)
    _requireEffectiveTargets(config, scene)


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
    if config.sampling.burn_in is not None and not hasBurnIn(config):
        raise ValueError(
            f"{config.source}: [sampling] burn_in is {config.sampling.burn_in}, and has no effect, since no step_size "
            "is 'auto'; make it that, or leave burn_in out"
        )


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


def _requireEffectiveTargets(config: Config, scene: Scene) -> None:
    """The mesh's own area, volume or area difference does no harm."""
    membrane = config.membrane
    parts = [scene.during(index) for index in range(-1, len(scene.stages))]
    for total, (modulus, keys) in _TARGET_KEYS.items():
        given = [key for key in keys if getattr(membrane, key) is not None]
        if not given or any(part.moduli[total] > 0 for part in parts):
            continue
        own = _ownAreaDifferences(config, MeasuredMesh(scene.mesh)) if total == "areaDifference" else scene.targetScales
        targets = {name: value for name, value in scene.targets.items() if totalOf(name) == total}
        isIdle = not all(math.isclose(targets[name], own[name]) for name in targets)
        if isIdle and not (total == "area" and membrane.reduced_volume is not None):
            raise ValueError(
                f"{config.source}: [membrane] {given[0]} is {shortened(str(getattr(membrane, given[0])))}, and has no "
                f"effect, since {modulus} is 0; make it positive, or leave {given[0]} out"
            )


# The keys of each target, and that of its modulus.
_TARGET_KEYS = {
    "area": ("area_modulus", ("target_area",)),
    "volume": ("volume_modulus", ("target_volume", "reduced_volume")),
    "areaDifference": ("area_difference_modulus", ("target_area_difference",)),
}


def _ownAreaDifferences(config: Config, measured: MeasuredMesh) -> dict[str, float]:
    height = config.membrane.leaflet_separation
    values = [2 * height * float(curvature) for curvature in measured.meanCurvatures]
    return numberedTargets("areaDifference", values)


def chosenWeight(config: Config, scene: Scene) -> list[str]:
    """Return a sentence about the momenta on coarser meshes that the Scene of a Config, which is not resolved, has
    where this leaves them open.
    """
    weight = scene.config.sampling.multilevel_weight
    if config.sampling.multilevel_weight != "auto" or weight == 0:
        return []
    return [f"[sampling] multilevel_weight is {weight:g}, as a surface has {_MULTILEVEL_SIZE} vertices or more"]


def changedIntervals(config: Config, scene: Scene) -> list[str]:
    """Return a sentence for each interval of a Config, which is not resolved, that is shorter in its Scene."""
    sentences = []
    for key, why in (
        ("observables_interval", "so that each window, and the run, has a row"),
        ("trajectory_interval", "so that the run has a frame"),
    ):
        given, taken = getattr(config.output, key), getattr(scene.config.output, key)
        if key in config.output.model_fields_set and given != taken:
            sentences.append(f"[output] {key} is {taken}, and not {given}, {why}")
    return sentences


def resolve(config: Config, measured: MeasuredMesh) -> Config:
    """Return a copy of a Config in which every default is a number, also those that follow from the mesh, and the
    stages are listed.

    Only an "auto" step size stays as it is: what it becomes is known after the burn-in.
    """
    config, mesh = config.model_copy(deep=True), measured.mesh
    if mesh.isPeriodic:
        _leaveOutVolume(config, measured)
    membrane, tether, repulsion, sampling = config.membrane, config.tether, config.repulsion, config.sampling
    surfaces = _surfaces(config, measured)
    for stage in stagesOf(config):
        for name in stage.targetNames():
            requireOnePerSurface(f"{stage.title}: {name}", getattr(stage, name), len(surfaces))
    targets = _targets(surfaces)
    _requireComparableTargets(config, measured, targets)
    config.stages = stagesOf(config)
    if sampling.approach == "auto":
        config.stages, targets = withApproaches(
            config.stages, _measuresHeld(config, measured), targets, len(mesh.vertices), _held(config)
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
        _requireShortEdges(tether.max_length, mesh)
    repulsion.onset = repulsion.onset or tether.min_length
    sampling.seed = sampling.seed or random.SystemRandom().randrange(1, 2**31)
    sampling.step_size = sampling.step_size or defaultStepSize(config, measured)
    if sampling.multilevel_weight == "auto":
        sampling.multilevel_weight = _multilevelWeight(config, measured)
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


def _requireShortEdges(maxLength: float, mesh: Mesh) -> None:
    """Raise a ValueError if a tether lets edges of a periodic mesh be longer than half a side of the box: they would
    change over to another image of their vertex, and tear triangles.
    """
    half = float(np.diag(np.asarray(mesh.box)).min()) / 2
    if maxLength > half:
        raise ValueError(
            f"[tether] max_length is {maxLength:.4g}; it must be at most half of the shortest side of the periodic "
            f"box, {half:.4g}"
        )


def tetherOf(config: Config, measured: MeasuredMesh) -> Tether:
    """Return the Tether that a Config asks for.

    The defaults are soft where edges are short, so that steps are long, and their pull and push on the area of a fluid
    membrane cancel, entropy included. Edges beyond them at the start cost no more than a few hundred kT, and soon come
    back.
    """
    tether = config.tether
    given = (tether.modulus, tether.min_length, tether.max_length, tether.length_scale)
    mean = measured.meanEdgeLength if None in given else math.nan
    minLength, maxLength = tether.min_length or 0.83 * mean, tether.max_length or 1.33 * mean
    if minLength >= maxLength:
        raise ValueError(
            f"[tether] min_length is {minLength:.4g} and max_length {maxLength:.4g}; min_length must be less"
        )
    r, modulus = tether.exponent, tether.modulus
    lengthScale = tether.length_scale or (mean if modulus is None else 1.0)
    if modulus is None:
        modulus = 4 / (r ** (r + 1) * (0.1 * mean / lengthScale) ** r)
    return Tether(modulus, minLength, maxLength, lengthScale)


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
    none of two thousand diverge.
    """
    sampling, kT = config.sampling, thermalEnergy(config.sampling.temperature)
    numVertices = len(measured.mesh.vertices)
    return 2.4 * math.sqrt(sampling.mass / (_stiffness(config, measured) * kT)) / numVertices**0.25


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
        for surface in _surfaces(config, measured)
    )
    modulus, minLength, _, lengthScale = tetherOf(config, measured)
    r = config.tether.exponent
    decades = math.log(max(modulus / (minLength / lengthScale) ** r, 1.0))
    spring = r * (r - 1) * (r ** (r + 1) * modulus) ** (2 / r) / lengthScale**2
    return local + constraints + ((decades + 1) ** 2 / minLength) ** 2 + 4 * spring


# The weight of coarser meshes that "auto" takes, and the number of vertices from which on it was measured to pay.
_MULTILEVEL_WEIGHT, _MULTILEVEL_SIZE = 2.0, 1000


def _multilevelWeight(config: Config, measured: MeasuredMesh) -> float:
    """Return the weight that "auto" stands for: 0 where it is not known to pay.

    Coarser meshes let a surface swell and shrink faster, against the penalties of its area and volume, the softest of
    motions without them.  A step may take 1.5 radians of that; with 1.4 three trajectories in four were accepted.
    """
    sampling = config.sampling
    stepSize = sampling.step_size if isinstance(sampling.step_size, float) else defaultStepSize(config, measured)
    surfaces = _surfaces(config, measured)
    if max(surface.numVertices for surface in surfaces) < _MULTILEVEL_SIZE or sampling.tether_substeps > 1:
        return 0.0
    stiffness = max(_swelling(config.membrane, surface) for surface in surfaces)
    frequency = math.sqrt(stiffness * thermalEnergy(sampling.temperature) / sampling.mass)
    return _MULTILEVEL_WEIGHT if stepSize * frequency <= 1.5 else 0.0


def _swelling(membrane: MembraneSection, surface: "_Surface") -> float:
    """Estimate the second derivative of the penalties, in kT per squared length unit, for a sphere that swells, times
    the factor by which coarser meshes raise its inverse mass.
    """
    factor, amplification, count = 1.0, 1.0, surface.numVertices / 4
    while count > 12:  # a level of n vertices has the inverse mass 4w times that of the next finer one
        factor *= 4 * _MULTILEVEL_WEIGHT
        amplification += factor
        count /= 4
    area = 8 * math.pi * (4 * membrane.area_modulus + membrane.area_difference_modulus) / surface.area
    volume = 2 * membrane.volume_modulus * (surface.area / surface.volume) ** 2 if surface.volume else 0.0
    return amplification * (area + volume) / surface.numVertices


class _Surface(NamedTuple):
    """One of the mesh's surfaces: its number of vertices, A_0, V_0 unless it is periodic, and dA_0."""

    numVertices: int
    area: float
    volume: float | None
    areaDifference: float


def _surfaces(config: Config, measured: MeasuredMesh) -> list[_Surface]:
    """Return the surfaces, in the order of their numbers, with the targets that each is held to by itself."""
    membrane, count = config.membrane, len(measured.surfaces)
    for name in membrane.targetNames():
        requireOnePerSurface(f"[membrane] {name}", getattr(membrane, name), count)
    return [_surface(membrane, measured, k) for k in range(count)]


def _surface(membrane: MembraneSection, measured: MeasuredMesh, number: int) -> _Surface:
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
    return _Surface(len(measured.surfaces[number].vertices), area, volume, areaDifference)


def _targets(surfaces: list[_Surface]) -> dict[str, float]:
    """Return the targets of surfaces by their names."""
    volumes = [surface.volume for surface in surfaces if surface.volume is not None]
    return {
        **numberedTargets("area", [surface.area for surface in surfaces]),
        **(numberedTargets("volume", volumes) if volumes else {}),
        **numberedTargets("areaDifference", [surface.areaDifference for surface in surfaces]),
    }


def _radius(area: float) -> float:
    """Return the radius of a sphere of an area."""
    return math.sqrt(area / (4 * math.pi))


def _defaultAmplitude(area: float, mesh: Mesh) -> float:
    """Return the amplitude of shear waves to begin with.

    By rule of thumb, the energy of a strain s changes by about s sqrt(N) kT, whatever the moduli.
    """
    return 0.7 * _radius(area) / math.sqrt(len(mesh.vertices))
