"""One setting measured: a run as long as it takes, and what it says about cost, errors and correlation times."""

import math
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import openmm as mm
from openmm import unit

from ..analysis.description import classifyShape, gyrationTensor
from ..analysis.diffusion import vertexDiffusion
from ..geometry.measured import MeasuredMesh
from ..geometry.mesh import Mesh
from ..helfrich import EdgeFlipIntegrator, HelfrichForce
from ..runs.config import Config
from ..runs.scene import createScene
from ..runs.stepsizes import defaultStepSize
from ..sampling.adaptation import adaptStepSize
from ..sampling.conditions import currentMesh
from ..sampling.moves import findMove, trajectoriesOf
from ..units import valueIn
from .settings import apply
from .statistics import Motion, SeriesStatistics, shapeSeries, statisticsOf

OBSERVABLES = ("shape", "bending", "area", "volume")
RELATIVE_TIME_ERROR = 0.2  # of the shape's correlation time, at which a run is long enough
TOO_SHORT = 0.3  # its error in a run of some forty correlation times
BURN_IN = 0.1  # the part of a run that no average uses
ADAPTING_TRAJECTORIES, ADAPTING_LENGTH = 80, 100
EVALUATIONS_PER_ROW = 100  # between two looks at the membrane, which cost about as much as three evaluations
LEAST_ROWS = 10  # without which there are no statistics
FRAMES = 24


@dataclass
class Measurement:
    """What a run at one setting says.

    Energies are in kT, lengths in the scene's unit, times in seconds of one processor.

    Attributes
    ----------
    stepSize : float
        of the trajectories, in ps
    steps, evaluations : int
        Monte Carlo steps and evaluations, of forces in trajectories and energies of shear waves, that were made
    secondsPerStep, secondsPerEvaluation : float
        cost of a Monte Carlo step, with its share of sweeps, and of a force evaluation within a trajectory
    acceptance, flipAcceptance, diverged : float
        fractions of trajectories and of flips accepted, and of trajectories that diverged
    energyError : float
        what |dH| along a trajectory, in kT, is below in two of three: a root mean square would be that of a few that
        meet needle-shaped triangles
    balance : list of float
        mean of sgn(dH) min(1, exp(-dH/kT)) and its standard error: 0 where trajectories are reversible and keep the
        volume of phase space, for then those that win energy come as often as their reverse.  Unlike the mean of
        exp(-dH/kT), which is 1, it does not hang on rare events
    observables : dict
        an :class:`SeriesStatistics` of "bending", "area", "volume", "tether" (energy), and "shape" (the components of
        the gyration tensor; see :func:`shapeSeries`)
    motion : Motion
        of the shape
    reweighted : dict
        mean and standard error of "bending", "area" and "volume", corrected to the scene's own moduli; empty where
        these are the setting's
    effectiveFraction : float
        what reweighting leaves of the number of samples, (sum w)^2/(n sum w^2) (L. Kish, Survey Sampling, 1965)
    stepsPerEdge : float
        Monte Carlo steps in which a vertex diffuses along the surface by a mean edge length l, l^2 = 4Dt; infinite if
        it does not
    forceError : float
        root mean square of the forces' deviation from those of the Reference platform, in extended precision, relative
        to that of the forces
    numVertices : int
        of the membrane
    """

    stepSize: float
    steps: int
    evaluations: int
    secondsPerStep: float
    secondsPerEvaluation: float
    acceptance: float
    flipAcceptance: float
    diverged: float
    energyError: float
    balance: list
    observables: dict
    motion: Motion
    reweighted: dict = field(default_factory=dict)
    effectiveFraction: float = 1.0
    stepsPerEdge: float = math.inf
    forceError: float = math.nan
    numVertices: int = 0

    def __post_init__(self) -> None:
        self.observables = {
            name: values if isinstance(values, SeriesStatistics) else SeriesStatistics(**values)
            for name, values in self.observables.items()
        }
        self.motion = self.motion if isinstance(self.motion, Motion) else Motion(**self.motion)

    def shapeTime(self, variances: Sequence[float] | None = None, error: float = 0.0) -> tuple[float, float]:
        """Return the shape's integrated autocorrelation time in Monte Carlo steps and its relative standard error.

        Where the run is too short to know it by itself, it is a lower bound, for which :meth:`Motion.time` counts, too.

        Parameters
        ----------
        variances : list of float, optional
            those of the shape's columns, if another run knows them
        error : float
            their relative standard error
        """
        return timeOf(self.observables["shape"], self.motion, variances, error)

    @property
    def isShort(self) -> bool:
        """Whether the run is too short to know the shape's correlation time by itself."""
        return self.observables["shape"].timeError >= TOO_SHORT

    @property
    def evaluationsPerStep(self) -> float:
        """The mean number of force evaluations in a Monte Carlo step."""
        return self.evaluations / self.steps


def timeOf(
    shape: SeriesStatistics, motion: Motion, variances: Sequence[float] | None, error: float
) -> tuple[float, float]:
    """Return the integrated autocorrelation time of the SeriesStatistics and the Motion of a shape, and its relative
    standard error: see :meth:`Measurement.shapeTime`.
    """
    own = shape.time, shape.timeError
    if variances is None or shape.timeError < TOO_SHORT:
        return own
    # In a short run both are too small: the one knows a part of the variance only, the other the first decay of the
    # correlation only.
    moved = motion.time(variances, error)
    return max(own, moved) if math.isfinite(moved[0]) else own


def measure(
    config: Config,
    mesh: Mesh,
    effort: float,
    hopeless: float = math.inf,
    moduli: Mapping[str, float] | None = None,
    accuracy: float = math.inf,
    isEquilibrated: bool = True,
    variances: tuple[Sequence[float] | None, float] = (None, 0.0),
) -> Measurement:
    """Run a membrane at a setting, and return a :class:`Measurement`.

    The run ends when the correlation time of the shape is known to a relative error of 0.2, or is sure to be hopelessly
    long, or the effort is spent.  Where that is does not depend on how fast the machine is.

    Parameters
    ----------
    config : Config
        the setting, with every default filled in; its step size may be "auto"
    mesh : Mesh
        an equilibrated membrane to begin with
    effort : float
        the largest number of force evaluations, times the number of vertices
    hopeless : float
        the number of evaluations to an independent sample of the shape that is not worth a longer run
    moduli : dict, optional
        terms whose moduli are those of another ensemble, for which averages are corrected: the ratio of its modulus to
        that of the setting by term

    accuracy : float
        the relative error of the mean bending energy that is wanted, too
    isEquilibrated : bool
        whether the membrane is one of the setting's own distribution; if not, the step size is sought once more when it
        has come nearer
    variances : (list of float, float)
        the arguments of :meth:`Measurement.shapeTime`, to see what is hopeless

    Raises
    ------
    ValueError, openmm.OpenMMException
        if no step size can be found, or the membrane cannot be simulated
    """
    run = _Run(config, mesh)
    limit = effort / len(mesh.vertices)
    for _ in range(1 if isEquilibrated else 2):
        run.adapt(limit / 8)
    run.sample(limit / 16)
    while run.evaluations < limit:
        shape = run.shape()
        time, timeError = timeOf(shape, run.motion(), *variances)
        surely = (1 - 2 * timeError) * time * run.evaluations / run.steps if timeError < 0.5 else 0.0
        if surely > hopeless or (shape.timeError < RELATIVE_TIME_ERROR and run.relativeError() < accuracy):
            break
        run.sample(min(run.evaluations / 2, limit - run.evaluations))
    return run.result(moduli or {})


class _Run:
    """A membrane at a setting, and the series that come of it."""

    def __init__(self, config: Config, mesh: Mesh) -> None:
        scene = createScene(config, mesh)
        self._config, self._kT = config, scene.kT
        self._force = scene.createForce()
        self._simulation = scene.createSimulation(self._force)
        self._integrator, self._isSphere = self._simulation.integrator, classifyShape(mesh) == "sphere"
        self._trajectories = trajectoriesOf(self._integrator)
        self._flips = findMove(self._integrator, EdgeFlipIntegrator)
        sampling = config.sampling
        self._probabilities = {
            "flips": sampling.flip_probability,
            "waves": sampling.shear_wave_probability,
            "trajectory": 1 - sampling.flip_probability - sampling.shear_wave_probability,
        }
        self._evaluations = {
            "flips": 0,
            "waves": sampling.shear_waves_per_step,
            "trajectory": sampling.steps_per_trajectory,
        }
        perStep = sum(p * self._evaluations[kind] for kind, p in self._probabilities.items())
        if not self._probabilities["trajectory"] > 0:
            raise ValueError(
                "there are no trajectories; flip_probability and shear_wave_probability must add up to less than 1"
            )
        self._interval = max(1, round(EVALUATIONS_PER_ROW / perStep))
        self._diffusion = _DiffusionProbe(mesh)
        self._rows: list[list[float]] = []
        self._tensors: list[np.ndarray] = []
        self._changes: list[float] = []
        # For each step of a kind, its seconds and evaluations.
        self._kinds: dict[str, list[tuple[float, int]]] = {"trajectory": [], "flips": [], "waves": []}
        self._forceError = forceError(config, mesh)

    @property
    def steps(self) -> int:
        return sum(map(len, self._kinds.values()))

    @property
    def evaluations(self) -> int:
        return sum(evaluations for steps in self._kinds.values() for _, evaluations in steps)

    def adapt(self, limit: float) -> None:
        """Find a step size, if there is none, with trajectories that need not be as long as those to come: their energy
        error grows no further.
        """
        sampling = self._config.sampling
        if sampling.step_size != "auto":
            return
        length = min(sampling.steps_per_trajectory, ADAPTING_LENGTH)
        self._integrator.setStepsPerTrajectory(length)
        trajectories = min(ADAPTING_TRAJECTORIES, max(30, limit / length))
        adaptStepSize(
            self._simulation, int(trajectories / self._probabilities["trajectory"]), sampling.target_acceptance
        )
        self._integrator.setStepsPerTrajectory(sampling.steps_per_trajectory)

    def sample(self, evaluations: float) -> None:
        """Make so many evaluations, or more until there are statistics, and look at the membrane now and then."""
        goal = self.evaluations + evaluations
        while self.evaluations < goal or len(self._rows) < LEAST_ROWS:
            for _ in range(self._interval):
                self._step()
            self._observe()

    def _step(self) -> None:
        trajectories, flips = self._trajectories, self._flips
        numTrajectories, numSweeps = trajectories.getNumTrajectories(), flips.getNumSweeps()
        start = time.process_time()
        self._integrator.step(1)
        seconds = time.process_time() - start
        if trajectories.getNumTrajectories() > numTrajectories:
            self._kinds["trajectory"].append((seconds, trajectories.getLastNumSteps()))
            self._changes.append(valueIn(trajectories.getLastEnergyChange(), unit.kilojoules_per_mole) / self._kT)
        else:
            kind = "flips" if flips.getNumSweeps() > numSweeps else "waves"
            self._kinds[kind].append((seconds, self._evaluations[kind]))

    def _observe(self) -> None:
        terms, geometry = (
            self._force.getEnergyTermsInContext(self._simulation.context),
            self._force.getGeometryInContext(self._simulation.context),
        )
        energies = [valueIn(energy, unit.kilojoules_per_mole) / self._kT for energy in terms.values()]
        self._rows.append(
            [*energies, valueIn(geometry.area, unit.nanometer**2), valueIn(geometry.volume, unit.nanometer**3)]
        )
        mesh = currentMesh(self._simulation, self._force)
        self._tensors.append(gyrationTensor(mesh))
        self._diffusion.add(mesh)

    def _series(self) -> dict[str, np.ndarray]:
        """Return the scalar series by name, after the burn-in."""
        terms = HelfrichForce.getTermNames()
        names = [name if name not in ("area", "volume") else name + "Energy" for name in terms]
        return dict(zip([*names, "area", "volume"], np.array(self._rows[self._burnIn() :]).T))

    def _burnIn(self) -> int:
        return int(BURN_IN * len(self._rows))

    def shape(self) -> SeriesStatistics:
        """Return the SeriesStatistics of the shape."""
        return statisticsOf(self._shapeSeries(), self._interval)

    def motion(self) -> Motion:
        """Return the Motion of the shape."""
        return Motion.of(self._shapeSeries(), self._interval)

    def _shapeSeries(self) -> np.ndarray:
        return shapeSeries(np.array(self._tensors[self._burnIn() :]), self._isSphere)

    def relativeError(self) -> float:
        """Return that of the mean bending energy."""
        bending = statisticsOf(self._series()["bending"])
        return bending.error / abs(bending.mean) if bending.mean else 0.0

    def result(self, moduli: Mapping[str, float]) -> Measurement:
        """Return the Measurement."""
        series, integrator = self._series(), self._integrator
        observables = {
            "shape": self.shape(),
            **{name: statisticsOf(series[name], self._interval) for name in ("bending", "area", "volume", "tether")},
        }
        changes = np.array(self._changes)
        diverged = float(np.mean(~np.isfinite(changes)))
        probabilities = np.exp(-np.maximum(changes, 0))
        balance = np.sign(changes) * probabilities
        reweighted, fraction = _reweight(series, observables, moduli, self._kT)
        seconds, lengths = np.array(self._kinds["trajectory"]).T
        # Medians, for the processor has other work; each kind of step comes as often as it was asked for.
        perEvaluation = float(np.median(seconds / lengths))
        costs = {
            kind: float(np.median([cost for cost, _ in self._kinds[kind]])) if self._kinds[kind] else 0.0
            for kind in ("flips", "waves")
        }
        costs["trajectory"] = perEvaluation * self._evaluations["trajectory"]
        perStep = sum(p * costs[kind] for kind, p in self._probabilities.items())
        return Measurement(
            valueIn(integrator.getStepSize(), unit.picosecond),
            self.steps,
            self.evaluations,
            perStep,
            perEvaluation,
            float(probabilities.mean()),
            self._flips.getAcceptanceRate(),
            diverged,
            float(np.quantile(np.abs(changes), 2 / 3, method="higher")),
            [float(balance.mean()), float(balance.std() / math.sqrt(len(balance)))],
            observables,
            self.motion(),
            reweighted,
            fraction,
            self._diffusion.framesPerEdge() * self._interval,
            self._forceError,
            len(self._diffusion.mesh.vertices),
        )


def forceError(config: Config, mesh: Mesh) -> float:
    """Return the deviation of the forces on a mesh, as a configuration computes them in trajectories, from those of the
    Reference platform: see :class:`Measurement`.
    """

    scene = createScene(config, mesh)

    def forces(platform: mm.Platform, properties: dict[str, str]) -> np.ndarray:
        system = mesh.createSystem()
        system.addForce(scene.createForce())
        context = mm.Context(system, mm.VerletIntegrator(1e-3), platform, properties)
        context.setPositions(mesh.vertices)
        return context.getState(forces=True).getForces(asNumpy=True)._value

    reference = forces(mm.Platform.getPlatformByName("Reference"), {})
    error = forces(scene.platform, scene.platformProperties) - reference
    if config.platform.precision != "double":
        error += _errorOfPrecision(config, mesh)
    return float(np.linalg.norm(error) / np.linalg.norm(reference))


def _errorOfPrecision(config: Config, mesh: Mesh) -> np.ndarray:
    """Return what the precision of trajectories adds to the forces: where a leapfrog step leads tells, for it goes by
    (h^2/2m) F beside what the velocities do, which are the same.
    """
    step, ends = 0.2 * defaultStepSize(config, MeasuredMesh(mesh)), []
    for precision in (config.platform.precision, "double"):
        changed = apply(
            config,
            {
                "platform.precision": precision,
                "sampling.step_size": step,
                "sampling.steps_per_trajectory": 1,
                "sampling.integrator": "leapfrog",
                "sampling.flip_probability": 0.0,
                "sampling.shear_wave_probability": 0.0,
            },
        )
        scene = createScene(changed, mesh)
        simulation = scene.createSimulation(scene.createForce())
        simulation.integrator.step(1)
        if simulation.integrator.getNumAcceptedTrajectories() != 1:
            return np.full(mesh.vertices.shape, math.nan)
        ends.append(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value)
    return 2 * config.sampling.mass / step**2 * (ends[0] - ends[1])


def _reweight(
    series: dict[str, np.ndarray], observables: dict[str, SeriesStatistics], moduli: Mapping[str, float], kT: float
) -> tuple[dict[str, list[float]], float]:
    """Return the means and errors that averages have in an ensemble of other moduli, and the fraction of samples that
    is left.
    """
    if not moduli:
        return {}, 1.0
    change = sum(
        (
            (ratio - 1) * series[term if term in series and term not in ("area", "volume") else term + "Energy"]
            for term, ratio in moduli.items()
        ),
        start=np.zeros(()),
    )
    weights = np.exp(change.min() - change)
    weights /= weights.sum()
    fraction = float(1 / (len(weights) * np.sum(weights**2)))
    reweighted = {}
    for name in ("bending", "area", "volume"):
        mean = float(weights @ series[name])
        spread = math.sqrt(weights @ (series[name] - mean) ** 2)
        reweighted[name] = [
            mean,
            spread * observables[name].error / (observables[name].deviation * math.sqrt(fraction))
            if observables[name].deviation
            else 0.0,
        ]
    return reweighted, fraction


class _DiffusionProbe:
    """Some frames of a membrane, so far apart that vertices have begun to diffuse between them, and never more than a
    few.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self._square = mesh, float(mesh.edgeLengths.mean()) ** 2
        self._frames: deque[Mesh] = deque(maxlen=FRAMES)
        self._spacing, self._count = 1, 0

    def add(self, mesh: Mesh) -> None:
        if self._count % self._spacing == 0:
            self._frames.append(mesh)
            if len(self._frames) == FRAMES and self._displacements(1)[0] < 0.25 * self._square:
                self._frames, self._spacing = deque(list(self._frames)[::2], FRAMES), 2 * self._spacing
        self._count += 1

    def framesPerEdge(self) -> float:
        """Return the number of frames in which 4Dt is the square of a mean edge length."""
        if len(self._frames) < 8:
            return math.inf
        near, far = self._displacements(4)[[0, 3]]
        return 3 * self._spacing * self._square / (far - near) if far > near else math.inf

    def _displacements(self, maxLag: int) -> np.ndarray:
        return vertexDiffusion(
            [mesh.vertices for mesh in self._frames], [mesh.triangles for mesh in self._frames], maxLag
        ).meanSquaredDisplacements
