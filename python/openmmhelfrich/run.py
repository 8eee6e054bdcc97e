"""A run from a configuration to its results.  Each step is a function that a script can call on its own."""
import math
import os
import random
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import openmm as mm
from openmm import app, unit

from .config import Config
from .helfrich import HelfrichForce, HybridMonteCarloIntegrator
from .mesh import Mesh
from .pictures import drawMesh, plotObservables
from .psf import writePSF
from .reporters import ObservablesReporter, readObservables, thermalEnergy, valueIn


@dataclass
class Outputs:
    """The files that a run writes, all of which begin with its prefix."""
    trajectory: Path
    topology: Path
    table: Path
    mesh: Path
    plot: Path
    picture: Path

    @classmethod
    def of(cls, config):
        """Return the names that a Config asks for, or raise a ValueError if its prefix is only a folder."""
        if Path(config.output.prefix+"x").stem == "x":
            raise ValueError(f"[output] prefix is '{config.output.prefix}'; the first part of the files' names must follow the folder")
        endings = (".dcd", ".psf", ".csv", "."+config.output.mesh_format, "_observables.png", "_shape.png")
        return cls(*(Path(config.output.prefix+ending) for ending in endings))

    def paths(self):
        """Return all paths."""
        return list(vars(self).values())

    def prepare(self, source, overwrite=False):
        """Make sure that every file can be written, and create their folder, before the first is opened.

        Raises FileExistsError if one exists already and is not to be overwritten, or is the mesh file that the run reads, and
        another OSError if their folder does not take files.
        """
        if any(path.exists() and path.samefile(source) for path in self.paths()):
            raise FileExistsError(f"the results would replace the mesh file {source}; choose another output prefix or mesh_format")
        existing = [path for path in self.paths() if path.exists()]
        if existing and not (overwrite and all(path.is_file() for path in existing)):
            raise FileExistsError(f"{', '.join(map(str, existing))} exist{'s' if len(existing) == 1 else ''} already; "
                                  "choose another output prefix, or ask to overwrite files")
        folder = self.table.parent
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise NotADirectoryError(f"{folder} is not a folder; choose another output prefix") from None
        for path in [folder]+existing:
            if not os.access(path, os.W_OK):
                raise PermissionError(f"{path} is not writable; choose another output prefix")


@dataclass
class Summary:
    """What a run did."""
    config: Config
    outputs: Outputs
    numVertices: int
    numTriangles: int
    steps: int
    seconds: float
    table: dict
    targets: dict
    acceptance: float
    flipAcceptance: float
    diverged: int
    interrupted: bool = field(default=False)

    def drift(self, name):
        """Return the largest relative deviation of "area", "volume" or "areaDifference" from its target during the run."""
        return float(np.max(np.abs(self.table[name]/self.targets[name]-1)))

    def mean(self, name):
        """Return the average of a column of the table over the second half of the run, when the start is forgotten."""
        return float(self.table[name][len(self.table[name])//2:].mean())

    def lines(self):
        """Return a label and a text for each thing worth knowing at the end."""
        u, kappa = self.config.mesh.length_unit, self.config.membrane.bending_modulus
        lines = [("membrane", f"{self.numVertices} vertices, {self.numTriangles} triangles"),
                 ("steps", f"{self.steps} in {self.seconds:.1f} s, seed {self.config.sampling.seed}{', interrupted' if self.interrupted else ''}"),
                 ("averages", "over the second half of the run:"),
                 ("area", self._mean("area", f"{u}^2")),
                 ("volume", self._mean("volume", f"{u}^3")),
                 ("reduced volume", f"{self.mean('reducedVolume'):.4f}")]
        if "areaDifference" in self.targets:
            lines.append(("area difference", self._mean("areaDifference", f"{u}^2")))
        lines += [("accepted", f"{self.acceptance:.1%} of trajectories, {self.flipAcceptance:.1%} of flips"),
                  ("energy", f"{self.mean('energy'):.1f} kT"),
                  ("files", ", ".join(map(str, self.outputs.paths())))]
        if kappa:
            lines.insert(-1, ("E_B/8 pi kappa", f"{self.mean('E_bending')/(8*math.pi*kappa):.3f}, from {self.table['E_bending'][0]/(8*math.pi*kappa):.3f} at the start; "
                              "thermal undulations add about kT/2 a vertex"))
        if self.diverged:
            lines.append(("warning", f"{self.diverged} trajectories diverged and were rejected; a smaller step_size avoids this"))
        return lines

    def _mean(self, name, unitName):
        text = f"{self.mean(name):.2f} {unitName}"
        return text+f", always within {self.drift(name):.2%} of its target" if name in self.targets else text


def loadMesh(config):
    """Read and check the mesh of a Config, in its length unit."""
    mesh = Mesh.read(config.mesh.file, unit=config.mesh.scale)
    try:
        mesh.check()
    except ValueError as error:
        raise ValueError(f"{config.mesh.file}: {error}") from None
    length = mesh.edgeLengths.mean()
    if not 0.01 <= length <= 10:
        raise ValueError(f"{config.mesh.file}: the mean edge length is {length:.3g} {config.mesh.length_unit}; it must be between 0.01 and 10, "
                         f"where the tether's power laws are meant to be used: try scale = {config.mesh.scale*10**-round(math.log10(4*length)):g} in [mesh]")
    return mesh


def createForce(config, mesh):
    """Create the HelfrichForce that a Config describes, with the mesh's own geometry where it names no target."""
    kT, membrane = thermalEnergy(config.sampling.temperature), config.membrane
    force = HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(membrane.bending_modulus*kT)
    force.setAreaModulus(membrane.area_modulus*kT)
    force.setVolumeModulus(membrane.volume_modulus*kT)
    force.setAreaDifferenceModulus(membrane.area_difference_modulus*kT)
    force.setLeafletSeparation(membrane.leaflet_separation)
    area, volume, areaDifference = targets(config, mesh)
    force.setTargetArea(area)
    force.setTargetVolume(volume)
    force.setTargetAreaDifference(areaDifference)
    modulus, minLength, maxLength = tetherParameters(config, mesh)
    force.setTether(modulus*kT, minLength, maxLength, config.tether.exponent)
    if config.repulsion.modulus > 0:
        onset = config.repulsion.onset or minLength
        force.setRepulsion(config.repulsion.modulus*kT, onset, config.repulsion.exponent, config.repulsion.exclusion_level)
    return force


def targets(config, mesh):
    """Return A_0, V_0 and dA_0."""
    membrane = config.membrane
    area = membrane.target_area or mesh.area
    volume = membrane.target_volume or mesh.volume
    if membrane.reduced_volume is not None:
        volume = membrane.reduced_volume*area**1.5/(6*math.sqrt(math.pi))
    areaDifference = membrane.target_area_difference
    if areaDifference is None:
        areaDifference = 2*membrane.leaflet_separation*mesh.vertexMeanCurvatures.sum()
    return area, volume, areaDifference


def tetherParameters(config, mesh):
    """Return the modulus, in kT, the least length and the greatest length of an edge."""
    tether, lengths = config.tether, mesh.edgeLengths
    mean = lengths.mean()
    minLength = tether.min_length or min(0.75*mean, 0.95*lengths.min())
    maxLength = tether.max_length or max(1.4*mean, 1.05*lengths.max())
    if minLength >= maxLength:
        raise ValueError(f"[tether] min_length is {minLength:.4g} and max_length {maxLength:.4g}; min_length must be less")
    r = tether.exponent
    modulus = 20/(r**(r+1)*(0.1*mean)**r) if tether.modulus is None else tether.modulus
    return modulus, minLength, maxLength


def defaultStepSize(config, mesh):
    """Return the size of a leapfrog step, in ps, for a Config that names none.

    Steps must be short against the fastest motion, of frequency sqrt(stiffness/mass), and since the acceptance of a trajectory falls with the number
    of vertices, they shrink as its fourth root.  The factor was found by trial on red blood cells of 642 to 10,242 vertices, to accept about
    three trajectories in four.
    """
    sampling, kT = config.sampling, thermalEnergy(config.sampling.temperature)
    return 2.6*math.sqrt(sampling.mass/(_stiffness(config, mesh)*kT))/len(mesh.vertices)**0.25


def _stiffness(config, mesh):
    """Estimate the largest second derivative of the energy, in kT per squared length unit.

    The estimates are those for a vertex of a flat sheet of equilateral triangles (bending, with thermal roughness: area), for all vertices moving
    along the normal (volume), and for an edge so short that the tether's exponential branch holds 1 kT.
    """
    membrane, number, length = config.membrane, len(mesh.vertices), mesh.edgeLengths.mean()
    area, volume, _ = targets(config, mesh)
    bending = 100*membrane.bending_modulus/length**2
    constraints = 0.7*membrane.area_modulus/(number*length**2)+2*membrane.volume_modulus*area**2/(number*volume**2)
    modulus, minLength, _ = tetherParameters(config, mesh)
    decades = math.log(max(modulus/minLength**config.tether.exponent, 1.0))
    return bending+constraints+((decades+1)**2/minLength)**2


def createSimulation(config, mesh, force):
    """Create the app.Simulation of a membrane, at the mesh's positions."""
    sampling = config.sampling
    system = mesh.createSystem(sampling.mass)
    system.addForce(force)
    sampling.seed = sampling.seed or random.SystemRandom().randrange(1, 2**31)
    sampling.step_size = sampling.step_size or defaultStepSize(config, mesh)
    integrator = HybridMonteCarloIntegrator(sampling.temperature, sampling.step_size, sampling.steps_per_trajectory,
                                            sampling.flip_fraction, sampling.flip_probability)
    integrator.setRandomNumberSeed(sampling.seed)
    simulation = app.Simulation(mesh.topology(), system, integrator, *_platform(config))
    simulation.context.setPositions(mesh.vertices)
    return simulation


def currentMesh(simulation, force):
    """Return a Mesh of the present positions and live triangles."""
    positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
    return Mesh(positions, force.getTrianglesInContext(simulation.context))


def run(config, progress=None):
    """Do everything that a Config asks for and return a Summary.

    Parameters
    ----------
    config : Config
        what to do; the seed and the step size that were chosen are filled in
    progress : callable, optional
        called now and then with the Simulation and a dict of its observables.  KeyboardInterrupt ends the run early, and
        its results are complete up to there

    Raises
    ------
    ValueError, OSError, openmm.OpenMMException
        if the mesh, the configuration, the platform or the place for the results will not do; no file has been touched then
    """
    mesh, outputs = loadMesh(config), Outputs.of(config)
    force = createForce(config, mesh)
    simulation = createSimulation(config, mesh, force)
    outputs.prepare(config.mesh.file, config.output.overwrite)
    writePSF(outputs.topology, simulation.topology, config.sampling.mass)
    observables = _addReporters(simulation, force, config, outputs, progress)
    observables.report(simulation, None)  # the table begins with the start
    start, interrupted = time.perf_counter(), False
    try:
        simulation.step(config.sampling.steps)
    except KeyboardInterrupt:
        interrupted = True
    seconds = time.perf_counter()-start
    observables.close()
    simulation.reporters.clear()
    summary = _summarise(config, outputs, simulation, force, seconds, interrupted)
    _draw(currentMesh(simulation, force), summary)
    return summary


class _ProgressReporter:
    """Calls a function at an interval with the Simulation and its observables."""

    def __init__(self, reportInterval, observe, progress):
        self._reportInterval, self._observe, self._progress = reportInterval, observe, progress

    def describeNextReport(self, simulation):
        steps = self._reportInterval-simulation.currentStep % self._reportInterval
        return {"steps": steps, "periodic": None, "include": []}

    def report(self, simulation, state):
        self._progress(simulation, self._observe(simulation))


def _platform(config):
    """Return the Platform and its properties."""
    names = [mm.Platform.getPlatform(i).getName() for i in range(mm.Platform.getNumPlatforms())]
    name, threads = config.platform.name, config.platform.threads
    if name not in names:
        raise ValueError(f"[platform] name is '{name}'; it must be one of {', '.join(names)}")
    if threads is not None and name != "CPU":
        raise ValueError(f"[platform] threads is {threads}; only the CPU platform has threads, not {name}")
    return mm.Platform.getPlatformByName(name), {} if threads is None else {"Threads": str(threads)}


def _addReporters(simulation, force, config, outputs, progress):
    steps, output = config.sampling.steps, config.output
    observables = ObservablesReporter(outputs.table, min(output.observables_interval, steps), force,
                                      config.sampling.temperature, config.mesh.length_unit)
    simulation.reporters.append(app.DCDReporter(str(outputs.trajectory), min(output.trajectory_interval, steps)))
    simulation.reporters.append(observables)
    if progress is not None:
        simulation.reporters.append(_ProgressReporter(max(1, steps//200), observables.observe, progress))
    return observables


def _summarise(config, outputs, simulation, force, seconds, interrupted):
    table, context, integrator = readObservables(outputs.table), simulation.context, simulation.integrator
    named = {"area": (force.getAreaModulus(), force.getTargetAreaParameter()),
             "volume": (force.getVolumeModulus(), force.getTargetVolumeParameter()),
             "areaDifference": (force.getAreaDifferenceModulus(), force.getTargetAreaDifferenceParameter())}
    targetValues = {name: context.getParameter(parameter) for name, (modulus, parameter) in named.items()
                    if valueIn(modulus, unit.kilojoules_per_mole) > 0}
    return Summary(config, outputs, context.getSystem().getNumParticles(), force.getNumTriangles(), simulation.currentStep, seconds, table, targetValues,
                   integrator.getAcceptanceRate(), integrator.getFlipAcceptanceRate(), integrator.getNumDivergedTrajectories(), interrupted)


def _draw(mesh, summary):
    lengthUnit, outputs = summary.config.mesh.length_unit, summary.outputs
    mesh.write(outputs.mesh)
    plotObservables(summary.table, outputs.plot, lengthUnit)
    drawMesh(mesh, outputs.picture, lengthUnit)
