"""The search: the settings of a scene tried one after the other around the best so far, and every measurement kept in a
file.
"""

import json
import math
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import openmm as mm

from ..files import PathLike, replacing
from ..geometry.measured import MeasuredMesh
from ..geometry.mesh import Mesh
from ..runs.config import Config, stagesOf
from ..runs.defaults import resolve
from ..runs.meshsource import loadMesh
from ..runs.scene import createScene
from ..runs.sections import MODULI
from ..runs.stages import createStage
from ..runs.stagesettings import SampleStage
from ..runs.studies import versions
from ..sampling.conditions import currentMesh
from ..sampling.targets import currentTargets, listedTargets
from .measure import Measurement, measure
from .minimization import FACTORS, Minimum, minimumOf
from .settings import (
    COARSER,
    Axis,
    apply,
    axes,
    changes,
    forEdges,
    isExact,
    keyOf,
    moduliRatios,
    tetherOf,
    tetherPath,
)

AUTOMATIC = {"sampling.step_size": "auto"}
EQUILIBRATION = 600  # Monte Carlo steps at least
HOPELESS = 3.0  # a setting that costs so many times more than the best one is not measured any better
AVERAGES = ("bending", "area", "volume")
_FORMERLY = {"minimiser": "minimization"}  # names of axes
WORTHWHILE = 0.9  # a change must bring the cost down to so much of what it was, which is known to some 20% only


@dataclass
class SearchPoint:
    """A setting that was measured, or why it could not be: the choice on an axis, and all else that is not as the scene
    has it.
    """

    axis: str
    choice: dict
    setting: dict
    effort: float
    measurement: Measurement | None
    problem: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.measurement, dict):
            self.measurement = Measurement(**self.measurement)

    @property
    def measured(self) -> Measurement:
        """The measurement of a setting that could be measured; a ValueError is raised for others."""
        if self.measurement is None:
            raise ValueError(f"{self.axis} was not measured: {self.problem}")
        return self.measurement


class OutOfTime(Exception):
    """The time for a search is spent.  What was measured is in its file."""


class Search:
    """A search under way, or its result.

    Attributes
    ----------
    config, scene : Config
        the scene as it was written, and with every default filled in, and the mesh and the targets that its stages lead
        to
    points : list of SearchPoint
        what was measured, in order; the first is the scene as it stands, the second the reference: short steps, and a
        long run
    minima : list of Minimum
        what minimizations with coarser and finer tolerances come to
    error : float
        the relative error of averages that is allowed
    """

    def __init__(
        self,
        config: Config,
        prefix: PathLike,
        error: float = 1e-3,
        effort: float = 3e8,
        minutes: float | None = None,
        names: Sequence[str] | None = None,
        progress: Callable[[SearchPoint], None] | None = None,
    ):
        self.config, self._prefix, self.error, self._effort = config, str(prefix), error, effort
        self._names = None if names is None else [_FORMERLY.get(name, name) for name in names]
        self._progress = progress or (lambda *_: None)
        self._end = math.inf if minutes is None else time.process_time() + 60 * minutes
        self._file = Path(f"{prefix}.json")
        self.points: list[SearchPoint] = []
        self.minima: list[Minimum] = []
        # Those that the search has come to: what it knows, so that one that goes on decides as before.
        self._seen: list[SearchPoint] = []
        self._seed = config.sampling.seed or 1
        self.scene, self._mesh = self._begin(config, "start")
        self._load()
        self._coarse: tuple[Config, Mesh] | None = None

    @property
    def baseline(self) -> SearchPoint:
        """The scene as it stands."""
        return self.points[0]

    @property
    def reference(self) -> SearchPoint:
        """The scene with short steps, in a long run."""
        return self.points[1]

    def run(self) -> SearchPoint:
        """Measure what has not been measured, and return the SearchPoint to recommend.

        Raises OutOfTime when the time is spent.
        """
        available = self._axes()
        self._measure("scene", {}, {}, 2 * self._effort)
        self._measure("reference", self._reference(), {}, 2 * self._effort, accuracy=self.error / 4)
        best = self._descend(available)
        if self.bias(best) > self.error:  # it promised more than a longer run confirms
            best = self._descend([axis for axis in available if axis.isExact])
        self._findMinima()
        return min(best, self.baseline, key=self.seconds)

    def time(self, point: SearchPoint) -> tuple[float, float]:
        """Return the integrated autocorrelation time of a point's shape in Monte Carlo steps, and its relative standard
        error.

        Points that sample about the same distribution share the variance of the shape, which the best of them knows
        best.
        """
        return point.measured.shapeTime(*(self._variances() if _isAlike(point) else (None, 0.0)))

    def seconds(self, point: SearchPoint) -> float:
        """Return the cost of an independent sample of the shape in seconds of one processor."""
        return point.measured.secondsPerStep * self.time(point)[0]

    def evaluations(self, point: SearchPoint) -> float:
        """Return the number of force evaluations to an independent sample of the shape."""
        return point.measured.evaluationsPerStep * self.time(point)[0]

    def _variances(self) -> tuple[Any, float]:
        known = [point.measurement for point in self._seen if point.measurement and _isAlike(point)]
        if not known:
            return None, 0.0
        long = [measurement for measurement in known if not measurement.isShort]
        # Where all runs are short, the one that came farthest has seen most of the variance; the others know but a part
        # of it.
        best = (
            min(long, key=lambda measurement: measurement.observables["shape"].timeError)
            if long
            else max(known, key=lambda measurement: sum(measurement.motion.displacements[-1]))
        )
        motion = best.motion
        return motion.variances, math.sqrt(
            best.observables["shape"].time / (motion.interval * motion.length * len(motion.variances))
        )

    def deviations(self, point: SearchPoint) -> dict[str, tuple[float, float]]:
        """Return the relative deviation of each average from the reference's and its standard error, by name."""
        result = {}
        for name in AVERAGES:
            own, true = point.measured.observables[name], self.reference.measured.observables[name]
            result[name] = (
                (own.mean / true.mean - 1, math.hypot(own.error, true.error) / abs(true.mean))
                if point is not self.reference
                else (0.0, true.error / abs(true.mean))
            )
        return result

    def bias(self, point: SearchPoint) -> float:
        """Return the largest relative deviation of an average from the reference's that is certain: more than twice its
        standard error; 0 where the distribution is the same.
        """
        if isExact(point.setting):
            return 0.0
        return max(max(0.0, abs(deviation) - 2 * error) for deviation, error in self.deviations(point).values())

    def gain(self, point: SearchPoint) -> float:
        """Return how many times more independent samples of the shape a point gives in a time than the scene as it
        stands.
        """
        return self.seconds(self.baseline) / self.seconds(point)

    def _axes(self) -> list[Axis]:
        available = axes(self.config, self.scene, float(self._mesh.edgeLengths.mean()))
        known = [*(axis.name for axis in available), "minimization"]
        unknown = set(self._names or ()) - set(known)
        if unknown:
            raise ValueError(f"there is no axis '{sorted(unknown)[0]}'; this scene has {', '.join(known)}")
        return [axis for axis in available if self._names is None or axis.name in self._names]

    def _reference(self) -> dict[str, Any]:
        """Return the scene's own distribution with short steps, and with moves that reach all of it."""
        return {"sampling.step_size": "auto", "sampling.target_acceptance": 0.9, **_moves(self.scene)}

    def _descend(self, available: list[Axis]) -> SearchPoint:
        """Go through the axes once, from each with the best choice to the next, and return the point at the end after a
        longer run there.
        """
        automatic = self._measure("step size", AUTOMATIC, {}, self._effort)
        best = automatic if automatic.measurement else self.baseline
        for axis in available:
            tried = [
                self._measure(axis.name, choice, best.setting, self._effort, best)
                for choice in axis.choices
                if changes(self.scene, best.setting, choice)
            ]
            offered = [point for point in tried if axis.isOffered and self._isAdmissible(point)]
            cheapest = min(offered, key=self.seconds, default=best)
            if self.seconds(cheapest) < WORTHWHILE * self.seconds(best):
                best = cheapest
        longer = self._measure("recommended", {}, best.setting, 2 * self._effort, accuracy=self.error / 4)
        return longer if longer.measurement else best

    def _findMinima(self) -> None:
        if (self._names is not None and "minimization" not in self._names) or self.scene.membrane.bending_modulus == 0:
            return
        iterations = int(self._effort / len(self._mesh.vertices) / 10)
        for factor in FACTORS[len(self.minima) :]:
            self._checkTime()
            self.minima.append(minimumOf(self.scene, self._mesh, factor, max(1, iterations)))
            self._save()

    def _checkTime(self) -> None:
        if time.process_time() > self._end:
            raise OutOfTime

    def _isAdmissible(self, point: SearchPoint) -> bool:
        return point.measurement is not None and point.measurement.acceptance > 0.3 and self.bias(point) <= self.error

    def _measure(
        self,
        axis: str,
        choice: dict[str, Any],
        others: dict[str, Any],
        effort: float,
        best: SearchPoint | None = None,
        accuracy: float = math.inf,
    ) -> SearchPoint:
        """Return the SearchPoint of a choice beside others, from the file if it is there."""
        setting = {**others, **choice}
        for point in self.points:
            if keyOf(point.setting) == keyOf(setting) and point.effort >= effort:
                self._seen.append(point)
                return point
        self._checkTime()
        point = SearchPoint(axis, choice, setting, effort, None)
        self._progress(point)
        try:
            point.measurement = self._run(setting, effort, best, accuracy)
        except (ValueError, mm.OpenMMException) as error:
            point.problem = str(error)
            if len(self.points) < 2:
                raise
        self.points.append(point)
        self._seen.append(point)
        self._save()
        self._progress(point)
        return point

    def _run(self, setting: dict[str, Any], effort: float, best: SearchPoint | None, accuracy: float) -> Measurement:
        scene, mesh = self._place(setting)
        if COARSER in setting:
            setting = forEdges(setting, mesh.edgeLengths.mean() / self._mesh.edgeLengths.mean())
        config = apply(scene, setting)
        config.sampling.seed = (self._seed * 2654435761 + zlib.crc32(keyOf(setting).encode())) % (2**31 - 1) + 1
        hopeless = HOPELESS * self.evaluations(best) if best and best.measurement else math.inf
        return measure(
            config,
            mesh,
            effort,
            hopeless,
            moduliRatios(scene, setting),
            accuracy,
            isExact(setting) or COARSER in setting,
            self._variances(),
        )

    def _place(self, setting: dict[str, Any]) -> tuple[Config, Mesh]:
        """Return the scene that a setting changes, and the membrane to begin with."""
        if COARSER not in setting:
            return self.scene, self._mesh
        if self._coarse is None:
            config = apply(self.config, {COARSER: setting[COARSER]}, asWritten=True)
            tether = forEdges(tetherOf(self.scene), loadMesh(config).edgeLengths.mean() / self._mesh.edgeLengths.mean())
            self._coarse = self._begin(apply(config, tether, asWritten=True), "coarse")
        return self._coarse

    def _begin(self, config: Config, name: str) -> tuple[Config, Mesh]:
        """Do all stages of a scene but the last, equilibrate, and return the scene with the mesh and targets of that
        moment.  The mesh is kept in a file.
        """
        mesh = loadMesh(config)
        if mesh.isPeriodic:
            raise ValueError("tradeoff: the mesh is periodic; the errors that this measures are those of closed ones")
        scene = resolve(config, MeasuredMesh(mesh))
        scene.sampling.seed = self._seed
        last, file = stagesOf(config)[-1], Path(f"{self._prefix}_{name}.ply")
        if not last.isSteady:
            raise ValueError(
                f"the last stage has the kind '{last.kind}'; trade-offs are measured where a scene samples, so it must "
                "be 'sample'"
            )
        if last.temperature not in (None, scene.sampling.temperature):
            raise ValueError(
                f"the last stage has the temperature {last.temperature:g} K and [sampling] "
                f"{scene.sampling.temperature:g} K; they must be equal"
            )
        scene.sampling.step_size = last.step_size or scene.sampling.step_size
        if scene.platform.name == "CPU":
            scene.platform.threads = 1
        target = Path(f"{self._prefix}_{name}.json")
        if not target.exists() or not file.exists():
            self._progress(SearchPoint("equilibration", {}, {}, 0, None))
            targets = self._prepare(scene, mesh, last, file)
            with replacing(target) as part:
                part.write_text(json.dumps(targets))
        _setTargets(scene, json.loads(target.read_text()))
        scene.stages = []
        return scene, Mesh.read(file)

    def _prepare(self, scene: Config, mesh: Mesh, last: Any, file: Path) -> dict[str, float]:
        """Bring a membrane to where the last stage samples, keep it in a file, and return its targets."""
        # With whatever gets there fast, for it is the place that counts: a scene's own settings may take very long, and
        # with a tether that lets few edges flip, for ever.
        fast = apply(
            scene,
            {
                **_moves(scene),
                "sampling.trajectory_jitter": 0.5,
                "sampling.steps_per_trajectory": max(300, scene.sampling.steps_per_trajectory),
            },
        )
        # At some 150 evaluations a step twice what a setting takes.
        equilibration = max(EQUILIBRATION, int(2 * self._effort / len(mesh.vertices) / 150))
        mesh, targets = _advance(fast, mesh, fast.stages[:-1])
        tethers = tetherPath(scene, float(mesh.edgeLengths.mean()))
        for i, tether in enumerate(tethers):
            config, steps = apply(fast, tether), equilibration // 10 if 0 < i < len(tethers) - 1 else equilibration
            _setTargets(config, targets)
            mesh, targets = _advance(
                config, mesh, [SampleStage(**{**last.model_dump(), "steps": steps, "step_size": "auto"})]
            )
        file.parent.mkdir(parents=True, exist_ok=True)
        mesh.write(file)
        return targets

    def _load(self) -> None:
        """Take the points of an earlier search of the same scene."""
        if self._file.exists():
            try:
                data = json.loads(self._file.read_text(encoding="utf-8"))
                scene, points = data["scene"], [SearchPoint(**point) for point in data["points"]]
                minima = [Minimum(**minimum) for minimum in data.get("minima", ())]
            except (ValueError, LookupError, TypeError, AttributeError):
                raise ValueError(
                    f"{self._file} is not the file of a search, or is damaged; choose another output prefix, or ask to "
                    "overwrite files"
                ) from None
            if scene != self._identity():
                raise ValueError(
                    f"{self._file} has the measurements of another scene, or of other versions; choose another output "
                    "prefix, or ask to overwrite files"
                )
            self.points, self.minima = points, minima

    def _save(self) -> None:
        data = {
            "scene": self._identity(),
            "points": [asdict(point) for point in self.points],
            "minima": [asdict(minimum) for minimum in self.minima],
        }
        with replacing(self._file) as part:
            part.write_text(json.dumps(data, indent=1), encoding="utf-8")

    def _identity(self) -> dict[str, Any]:
        scene = self.scene.model_dump(mode="json", exclude_none=True, exclude={"output"})
        return {**scene, "versions": versions()}


def _moves(scene: Config) -> dict[str, Any]:
    """Return a setting with many flips and some shear waves, which change no distribution."""
    sampling = scene.sampling
    return {
        "sampling.flip_fraction": max(1.0, sampling.flip_fraction),
        "sampling.shear_wave_probability": max(0.2 * (1 - sampling.flip_probability), sampling.shear_wave_probability),
    }


def _isAlike(point: SearchPoint) -> bool:
    """Return whether a point's shape has about the variance that it has in the scene: the tether hardly changes it,
    unless it is left out.
    """
    return not any(
        name.startswith(("membrane.", "mesh.")) or (name in MODULI.values() and value == 0)
        for name, value in point.setting.items()
    )


def _advance(config: Config, mesh: Mesh, stages: Sequence[Any]) -> tuple[Mesh, dict[str, float]]:
    """Do stages, and return the mesh and the targets that they lead to."""
    scene = createScene(config, mesh)
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    for settings in stages:
        stage = createStage(settings, scene, simulation, force)
        while not stage.isDone:
            stage.advance()
    return currentMesh(simulation, force), currentTargets(simulation.context, force)


def _setTargets(config: Config, targets: dict[str, float]) -> None:
    membrane = config.membrane
    membrane.target_area, membrane.target_volume, membrane.target_area_difference, membrane.reduced_volume = (
        listedTargets(targets, "area"),
        listedTargets(targets, "volume"),
        listedTargets(targets, "areaDifference") or None,
        None,
    )
