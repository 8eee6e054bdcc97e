"""From a configuration to a scene: everything that a run needs to know before its first step, and its Simulation."""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import openmm as mm
from numpy.typing import NDArray
from openmm import app

from ..files import PathLike
from ..geometry.measured import MeasuredMesh
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce, HybridMonteCarloIntegrator, ShearWaveIntegrator, SpeciesExchangeIntegrator
from ..sampling.targets import setDefaultTargets, totalOf
from ..units import thermalEnergy
from .additions import Setup, addSection, beadPositions, requireCreated
from .approach import FAR
from .config import Config, after, asConfig, during, namingSource, valueOf
from .defaults import resolve
from .effects import requireEffect
from .material import bendingModulusOf, numbered, requireOnePlace, setMaterial, speciesOf
from .meshsource import loadMesh
from .platforms import platformOf
from .sections import MODULI
from .sizes import checkSizes, overflowsExplained, requireMeshSize
from .stagesettings import StageSettings, givenConditions
from .stepsizes import defaultStepSize
from .surfaces import defaultAmplitude, radiusOf, surfacesOf, targetScales, targetsOf
from .tethers import Tether, tetherOf


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
            requireEffect(config, scene.config, scene.mesh)
            scene._warnOfFarTargets()
        return scene

    @property
    def changing(self) -> list[str]:
        """The names of the conditions that stages change, with the numbers of species."""
        return [numbered(self.config, name) for name in givenConditions(self.stages)]

    def during(self, index: int) -> "Scene":
        """Return the Scene with the moduli that it has during one of its stages, at the end of it; -1 is before all."""
        return self._withConfig(during(self.config, index))

    def after(self, index: int) -> "Scene":
        """Return the Scene with the moduli that it has after one of its stages."""
        return self._withConfig(after(self.config, index))

    def _withConfig(self, config: Config) -> "Scene":
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
        try:
            simulation = app.Simulation(topology, system, integrator, self.platform, self.platformProperties)
        except mm.OpenMMException:
            requireCreated(system, self.config.system, len(mesh.vertices), self._createContext)
            raise
        simulation.context.setPositions(np.concatenate((mesh.vertices, mesh.beads)))
        return simulation

    def _createContext(self, system: mm.System) -> mm.Context:
        return mm.Context(system, self.createIntegrator(), self.platform, self.platformProperties)

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
        sampling, radius = self.config.sampling, radiusOf(max(areas))
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
    with namingSource(config), overflowsExplained(config):
        requireMeshSize(config, measured)
        config = resolve(config, measured)
        checkSizes(config, measured)
        vertexSpecies = speciesOf(config, mesh)
        platform, properties = platformOf(config)
    sampling, kT = config.sampling, thermalEnergy(config.sampling.temperature)
    surfaces = surfacesOf(config, measured)
    tether = tetherOf(config, measured)
    adaptsStepSize, adaptsWaves = sampling.step_size == "auto", sampling.shear_wave_amplitude == "auto"
    return Scene(
        config=config,
        mesh=mesh,
        lengthUnit=config.mesh.length_unit,
        temperature=sampling.temperature,
        kT=kT,
        moduli=_moduliOf(config, kT),
        targets=targetsOf(surfaces),
        targetScales=targetScales(config, measured),
        tether=tether,
        vertexSpecies=vertexSpecies,
        repulsionOnset=config.repulsion.onset or tether.minLength,
        stepSize=defaultStepSize(config, measured) if adaptsStepSize else sampling.step_size,
        adaptsStepSize=adaptsStepSize,
        waveAmplitude=defaultAmplitude(max(surface.area for surface in surfaces), mesh)
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
