"""Whole runs: from a configuration, or from a checkpoint, through the stages to the results."""

import contextlib
import errno
import os
import platform as python
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from importlib.metadata import version as versionOf
from pathlib import Path
from types import FrameType
from typing import Any

import openmm as mm
from openmm import app, unit

from ..analysis.description import classifyShape
from ..analysis.verdict import FAILED, Verdict, verdictOfStages
from ..files import PathLike
from ..helfrich import EdgeFlipIntegrator, HelfrichForce
from ..io.locks import locked
from ..io.psf import writePSF
from ..io.runfiles import beside, prefixOf
from ..pictures.plots import drawMesh, plotObservables, plotPath, requireMatplotlib
from ..sampling.conditions import currentMesh
from ..sampling.interruption import StepInterrupted, interruptible
from ..sampling.moves import FlipCounters, findMove
from ..sampling.observables import Moment, Place, observablesOf, observe, readObservables
from ..sampling.progress import requireProgress
from ..sampling.targets import currentTargets, setTargets, totalOf
from ..tables import Table
from ..version import __version__
from .additions import Setup, describe, requireFinite, requireSame
from .checkpoint import RunState, addRecord, loadRunState, loadSimulation, naming, saveCheckpoint, understanding
from .config import Config, asConfig, asDict, parseConfig
from .configfile import writeSettings
from .effects import changedIntervals, chosenForSize, requireEffect
from .outputs import Outputs, Recorder
from .platforms import platformOf
from .progress import RunProgress, following
from .readiness import coarseness, requireReady
from .room import requireRoom
from .scene import Scene, createScene
from .sections import SystemSection
from .stages import Minimize, Stage, averagesOf, checkStages, createStage
from .summary import Summary


def run(
    config: Config | dict[str, Any] | PathLike,
    progress: Callable[["Study"], None] | bool | None = None,
    setup: Setup | None = None,
) -> Summary:
    """Do everything that a configuration asks for and return a Summary.

    SIGINT and SIGTERM end the run early, after a checkpoint; its results are complete up to there.

    ::

        def setup(system, scene):
            bead = system.addParticle(10.0)
            bond = mm.HarmonicBondForce()
            bond.addBond(0, bead, 0.5, 100.0)
            system.addForce(bond)
            return scene.mesh.vertices[:1] * 1.5

        mh.run("vesicle.toml", setup=setup)

    Parameters
    ----------
    config : Config, dict or path
        what to do: a Config, the nested dict of one, whose values may be Quantities, or the name of a TOML file
    progress : callable or True, optional
        called after each step with the :class:`Study`; True shows bars, in a terminal and in Jupyter
    setup : callable, optional
        called with the System and the :class:`Scene` before the Context is made. It may add forces and give vertices
        other masses, of which 0 holds a vertex where it is. It may add particles, beads, and then returns their
        positions: an array of shape (B, 3), in nm, or a Quantity. The vertices are particles 0 to N-1, the beads those
        that follow. All of it takes part in every stage, and is in the checkpoint

    Raises
    ------
    ValueError, OSError, openmm.OpenMMException
        if the mesh, the configuration, the platform or the place for the results will not do, or another process runs
        with this prefix; no file has been touched then.  Later an OSError, if the disk is full; the last checkpoint is
        whole then

    A UserWarning says that the verdict is failed, where there is no progress to show it.
    """
    requireProgress(progress, hasBars=True)
    config = _asConfig(config)
    scene = Scene.of(config, setup=setup)
    outputs = Outputs.of(scene.config)
    requireEffect(config, scene.config, scene.mesh)
    targets = checkStages(scene)
    requireRoom(scene, outputs)
    requireMatplotlib()
    force = scene.createForce()
    study = Study(scene, outputs, scene.createSimulation(force), force)
    study.requireFinite(targets, scene.config.system)
    additions = describe(study.simulation.system, len(scene.mesh.vertices))
    warnings = [
        *chosenForSize(config, scene.config),
        *changedIntervals(config, scene.config),
        *map(str, coarseness(scene, targets)),
    ]
    study.notes += [*scene.mesh.notes, *additions, *warnings]
    study.requireReady()
    outputs.makeFolder()
    with locked(outputs.prefix):
        old = outputs.prepare(config.mesh.file, config.output.overwrite)
        study.save()  # with all files empty: whatever happens from now on, the run can go on
        for path in old:
            path.unlink(missing_ok=True)
        with following(progress, RunProgress) as shown:
            return told(study.finish(shown), progress)


def resume(
    prefix: PathLike,
    steps: int | None = None,
    progress: Callable[["Study"], None] | bool | None = None,
    platform: str | None = None,
    threads: int | None = None,
    setup: Setup | None = None,
) -> Summary:
    """Go on with a run that was stopped or killed, or make more steps, and return a Summary.

    What the run would have written had it never been stopped is what it writes: the files are the same to the last
    byte.

    ::

        mh.run("vesicle.toml")
        summary = mh.resume("vesicle", steps=10)
        print(summary.verdict)

    Parameters
    ----------
    prefix : path
        the first part of the names of the run's files, one of them, or the folder that has them alone
    steps : int, optional
        more Monte Carlo steps than were asked for, by the last stage if it samples and otherwise by a new one that does
    progress : callable or True, optional
        called after each step with the :class:`Study`; True shows bars, in a terminal and in Jupyter
    platform : str, optional
        another platform than before.  The results are the same but for rounding errors
    threads : int, optional
        another number of threads than before.  Results do not depend on it
    setup : callable, optional
        that of :func:`run`. A checkpoint holds what it made, so that none is needed; one that is given must make as
        many particles and the same forces

    Raises
    ------
    FileNotFoundError, ValueError
        if there is no checkpoint, it is damaged, a file of the run is missing, or the run has no steps left
    InUseError
        if another process runs with this prefix
    """
    requireProgress(progress, hasBars=True)
    prefix = prefixOf(prefix)
    file = beside(prefix, ".checkpoint")
    if not file.exists():
        raise FileNotFoundError(_absence(prefix))
    with locked(prefix):
        state = loadRunState(file)
        config = parseConfig(state.config, str(file))
        config.output.prefix = str(prefix)
        config.sampling.approach = "none"  # stages are what they were at the beginning
        if config.output.psf is None:  # version 0.1.0 always wrote one
            config.output.psf = True
        outputs = Outputs.of(config)
        if steps is not None:
            _addSteps(config, steps)
        elif outputs.match(state.record):
            raise CompleteError(prefix, state)
        _changePlatform(config, state, platform, threads)
        with understanding(file):
            simulation, force = loadSimulation(file, *platformOf(config))
        scene = createScene(config, currentMesh(simulation, force), setup)
        if setup is not None:
            requireSame(simulation.system, scene.createSystem(scene.createForce())[0], prefix)
        with understanding(file):
            study = Study(scene, outputs, simulation, force, state)
            study.requireFinite(checkStages(scene, study.index, study.stage.startTargets))
            requireRoom(scene, outputs, state.step)
        requireMatplotlib()
        with following(progress, RunProgress) as shown:
            return told(study.finish(shown), progress)


def _absence(prefix: Path) -> str:
    """Return why there is no run of a prefix to go on with, or none beside a configuration."""
    if prefix.suffix == ".toml" and prefix.is_file():
        return (
            f"there is no checkpoint {prefix.with_suffix('.checkpoint')} beside {prefix}: start the run, or name the "
            "prefix that --output or the [output] of the configuration gives it"
        )
    return (
        f"there is no checkpoint {beside(prefix, '.checkpoint')}; a run writes it before anything else, so that no run "
        "of this prefix has begun: start one with run"
    )


class CompleteError(ValueError):
    """A run that is to go on has no steps left.

    Attributes
    ----------
    verdict : Verdict or None
        the one on the run
    """

    def __init__(self, prefix: PathLike, state: RunState):
        self.verdict = state.verdict()
        failed = f" and its verdict is {self.verdict}\n" if self.verdict and self.verdict.level == FAILED else "; "
        super().__init__(f"the run {prefix} is complete, at step {state.step}{failed}ask for more steps to go on")


class Study:
    """A run under way.

    Attributes
    ----------
    scene : Scene
        what to do
    config : Config
        its configuration, with every default filled in
    simulation : openmm.app.Simulation
        the membrane
    force : HelfrichForce
        its energy
    stage : Stage
        what is being done
    index : int
        its number, from 0
    notes : list of str
        what has been found out, or is to be warned of
    verdicts : dict of Verdict
        those on the stages that are done, by their numbers, from 0
    """

    def __init__(
        self,
        scene: Scene,
        outputs: Outputs,
        simulation: app.Simulation,
        force: HelfrichForce,
        state: RunState | None = None,
    ):
        """Create a Study at its beginning, or in the state that a checkpoint has."""
        self.scene, self.config, self.outputs, self.simulation, self.force = (
            scene,
            scene.config,
            outputs,
            simulation,
            force,
        )
        state = state or RunState({}, 0, None, {}, [], versions(), 0, False)
        self.index, self.notes, self._versions, self._run = state.stage, list(state.notes), state.versions, state.run
        self.verdicts = state.verdictsOfStages()
        self._minimizing = state.minimizing
        self._recorder: Recorder | None = None
        self._sizes, self._savedAt = state.sizes, (time.monotonic(), simulation.currentStep)
        self.stage = self._createStage()
        if state.stageState is not None:
            with naming(outputs.checkpoint):
                self.stage.setState(state.stageState)

    def finish(self, progress: Callable[["Study"], None] | None = None) -> Summary:
        """Do what is left to do, draw the pictures, and return a Summary."""
        start, firstStep = time.perf_counter(), self.simulation.currentStep
        with self._readable():
            with StopSignals() as stop, self._record() as recorder:
                self._recorder = recorder
                if self.outputs.topology is not None:
                    writePSF(self.outputs.topology, self.simulation.topology, self._masses(), self._types())
                self._writeSettings()
                if not self._sizes:
                    recorder.table.report(self.simulation, None)  # the table begins with the start
                self._advance(recorder, stop, progress)
                if self.stage.isDone or not self.stage.isWhole:
                    self.save()
            summary = self._summary(self.simulation.currentStep - firstStep, time.perf_counter() - start, stop.signal)
            self._draw(summary)
            if self.isComplete:
                record = self.outputs.record(self._run, self.simulation.currentStep)
                addRecord(self.outputs.checkpoint, record)
        return summary

    def _record(self) -> Recorder:
        """Open the files."""
        isLater = bool(self._sizes)
        with understanding(self.outputs.checkpoint) if isLater else contextlib.nullcontext():
            return Recorder(self.outputs, self.scene, self.simulation, self.force, self._place, self._sizes)

    def requireFinite(self, targets: list[dict[str, float]], section: SystemSection | None = None) -> None:
        """Raise a ValueError or an OpenMMException unless the energy and the forces are finite with each of some
        targets; forces of a [system], if it is given, are called by their files.
        """
        context, before = self.simulation.context, currentTargets(self.simulation.context, self.force)
        try:
            for each in targets:
                setTargets(context, self.force, each)
                requireFinite(context, section, len(self.scene.mesh.vertices))
        finally:
            setTargets(context, self.force, before)

    @property
    def isComplete(self) -> bool:
        """Whether nothing is left to do."""
        return self.index == len(self.config.stages) - 1 and self.stage.isDone

    @property
    def verdict(self) -> Verdict | None:
        """The verdict on the run; None before its end."""
        titles = [stage.title for stage in self.scene.stages]
        return verdictOfStages(titles, self.verdicts) if self.isComplete else None

    def requireReady(self) -> None:
        """Raise a ValueError if the present stage would sample nothing from the present shape."""
        settings = self.scene.stages[self.index]
        if settings.isMonteCarlo:
            stepSize, scene = getattr(settings, "step_size", None), self.scene.during(self.index - settings.isGradual)
            requireReady(scene, self.simulation, self.force, None if stepSize == "auto" else stepSize)

    def save(self) -> None:
        """Write a checkpoint."""
        if self._recorder:
            self._sizes = self._recorder.sync()
        state = RunState(
            asDict(self.config),
            self.index,
            self.stage.getState(),
            self._sizes,
            self.notes,
            self._versions,
            self.simulation.currentStep,
            self.isComplete,
            self._run,
            verdicts={str(i): verdict.toData() for i, verdict in self.verdicts.items()},
            minimizing=self._minimizing,
        )
        saveCheckpoint(self.outputs.checkpoint, self.simulation, state)
        self._savedAt = time.monotonic(), self.simulation.currentStep

    def observe(self) -> dict[str, float]:
        """Return a row of the table, for the present, as a dict."""
        moment = Moment(self.simulation, self.force, self.scene.kT, self._place())
        observables = observablesOf(self.scene.changing)
        return observe(moment, observables, self.scene.lengthUnit, "kT")

    def status(self) -> str:
        """Return the energy and the rates of acceptance of the present stage, in a few words."""
        return self.stage.status(lambda: self.observe()["energy (kT)"])

    def _advance(self, recorder: Recorder, stop: "StopSignals", progress: Callable[["Study"], None] | None) -> None:
        """Go through the stages, to the end or until asked to stop."""
        isInterrupted = False

        def isToStop() -> bool:
            nonlocal isInterrupted
            try:
                if progress is not None:
                    progress(self)
            except KeyboardInterrupt:
                isInterrupted = True
            return isInterrupted or stop.signal is not None

        while True:
            self.stage.listen = isToStop
            if self.stage.isWhole and not self.stage.isDone:
                self.save()  # where it goes on if it is stopped
            before = self._flips()
            while not self.stage.isDone:
                try:
                    with interruptible(lambda: stop.signal is not None):
                        self.stage.advance()
                except StepInterrupted:
                    isInterrupted = True
                    break
                if self.stage.isWhole and self.stage.isDone:
                    self._minimizing = self._minimizing.beside(self._flips().without(before))
                    recorder.report()
                if self.stage.isDone:
                    self._judge(recorder)
                if isToStop():
                    break
                self._saveIfDue()
            if not self.stage.isDone:
                return
            self._note()
            if self.isComplete or isInterrupted or stop.signal is not None:
                return
            hasSampled = self.scene.stages[self.index].isMonteCarlo
            self.index += 1
            if not hasSampled:
                self.requireReady()
            self.stage = self._createStage()

    def _createStage(self) -> Stage:
        scene = self.scene.during(self.index)
        return createStage(scene.stages[self.index], scene, self.simulation, self.force)

    def _judge(self, recorder: Recorder) -> None:
        """Keep the verdict on the stage, which has just ended, and has a row of the table from now on."""
        rows = self._rows()
        if not any(rows["step"] > 0):  # the start is the mesh's, before any stage
            recorder.table.report(self.simulation, None)
            rows = self._rows()
        self.verdicts[self.index] = self.stage.judge(rows, self.scene.after(self.index).moduli)
        self._writeSettings()

    def _rows(self) -> Table:
        """Return the rows that the table has of the present stage."""
        table = readObservables(self.outputs.table)
        return table.where(table["stage"] == self.index + 1)

    def _note(self) -> None:
        """Keep what the stage has to tell at its end."""
        new = [
            note
            for note in (f"stage {self.index + 1}, {note}" for note in self.stage.notes())
            if note not in self.notes
        ]
        if new:
            self.notes += new
            self._writeSettings()

    def _saveIfDue(self) -> None:
        output, (seconds, step) = self.config.output, self._savedAt
        isDue = (
            output.checkpoint_interval is not None and self.simulation.currentStep >= step + output.checkpoint_interval
        )
        if isDue or time.monotonic() >= seconds + output.checkpoint_seconds:
            self.save()

    def _masses(self) -> list[float]:
        """Return the masses of vertices, which are as they would be if they moved, and of beads, in Da."""
        system, numVertices = self.simulation.system, len(self.scene.mesh.vertices)
        beads = range(numVertices, system.getNumParticles())
        own = [system.getParticleMass(i).value_in_unit(unit.dalton) for i in beads]
        return [self.config.sampling.mass] * numVertices + own

    def _types(self) -> list[str]:
        """Return the names of the vertices' species at the start of the run, none if there are none."""
        names = [each.name for each in self.config.species]
        return [names[i] for i in self.force.getVertexSpecies().tolist()] if names else []

    def _place(self) -> Place:
        """Return where the run is, for the table."""
        return Place(self.index + 1, *self.stage.window(), self._minimizing)

    def _flips(self) -> FlipCounters:
        return FlipCounters.of(findMove(self.simulation.integrator, EdgeFlipIntegrator))

    def _writeSettings(self) -> None:
        lines = [f"versions: {', '.join(f'{name} {number}' for name, number in self._versions.items())}", *self.notes]
        for index, verdict in self.verdicts.items():
            lines += f"stage {index + 1}, {self.scene.stages[index].title}: {verdict}".splitlines()
        writeSettings(self.outputs.settings, self.config, lines)

    @contextlib.contextmanager
    def _readable(self) -> Iterator[None]:
        """Say what a failure to write means for the run."""
        try:
            yield
        except OSError as error:
            what = "the disk is full" if os.strerror(errno.ENOSPC) in str(error) else error.strerror or str(error)
            raise OSError(
                f"the results of {self.config.output.prefix} cannot be written: {what}; {self._whatIsLeft()}"
            ) from None

    def _whatIsLeft(self) -> str:
        """Return what there is to go on from, if that has not been deleted."""
        missing = [path for path in self.outputs.growing(self._sizes) if not path.exists()]
        if missing:
            return f"{', '.join(map(str, missing))} and perhaps more were deleted meanwhile, so that it cannot go on"
        prefix = self.config.output.prefix
        return f"everything up to step {self._savedAt[1]} is safe: openmm-helfrich resume {prefix} goes on from there"

    def _summary(self, newSteps: int, seconds: float, signal: int | None) -> Summary:
        """Return the Summary of what was done."""
        moduli = self.scene.after(self.index).moduli
        targets = currentTargets(self.simulation.context, self.force)
        table = readObservables(self.outputs.table)
        acceptance, flipAcceptance = (
            (float(table[name][-1]) if name in table else 0.0 for name in ("acceptance", "flipAcceptance"))
            if isinstance(self.stage, Minimize)
            else self.stage.acceptance()
        )
        surfaces = currentMesh(self.simulation, self.force).components()
        return Summary(
            config=self.config,
            outputs=self.outputs,
            numVertices=len(self.scene.mesh.vertices),
            numTriangles=len(self.scene.mesh.triangles),
            steps=self.simulation.currentStep,
            newSteps=newSteps,
            seconds=seconds,
            table=table,
            stage=self.index,
            targets={name: value for name, value in targets.items() if moduli[totalOf(name)] > 0},
            shapeClasses=[classifyShape(surface) for surface in surfaces] if len(surfaces) > 1 else [],
            acceptance=acceptance,
            flipAcceptance=flipAcceptance,
            descent=self.stage.descent if isinstance(self.stage, Minimize) else Table(),
            notes=self.notes,
            stageVerdicts=[(self.scene.stages[i].title, self.verdicts[i]) for i in sorted(self.verdicts)],
            verdict=self.verdict,
            interrupted=not self.isComplete,
            signal=signal,
        )

    def _draw(self, summary: Summary) -> None:
        lengthUnit = self.scene.lengthUnit
        mesh = currentMesh(self.simulation, self.force, self.scene.speciesNames)
        mesh.write(self.outputs.mesh)
        plotObservables(summary.table, self.outputs.plot, lengthUnit, "kT", summary.loneDescent)
        drawMesh(mesh, self.outputs.picture, lengthUnit)
        paths = [
            averages
            for settings, rows in zip(self.scene.stages, self._recordedRows(summary.table))
            if len(rows["step"]) and (averages := averagesOf(settings, rows)) is not None
        ]
        if paths and self.outputs.path is not None and self.outputs.pathPlot is not None:
            windows = Table.concatenate(paths)
            windows.write(self.outputs.path)
            plotPath(windows, self.outputs.pathPlot, lengthUnit)

    def _recordedRows(self, table: Table) -> list[Table]:
        """Return the equilibrated rows of each stage."""
        return [
            table.where((table["stage"] == i + 1) & (table["equilibrated"] == 1)) for i in range(len(self.scene.stages))
        ]


def versions() -> dict[str, str]:
    """Return the versions of the software that results depend on."""
    return {
        "openmm-helfrich": __version__,
        "OpenMM": mm.Platform.getOpenMMVersion(),
        "numpy": versionOf("numpy"),
        "Python": python.python_version(),
    }


class StopSignals:
    """Notes the signals that ask a run to stop, instead of being stopped by them; the second one of a kind does stop
    it.

    Attributes
    ----------
    signal : int or None
        the one that came
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self.signal: int | None = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "StopSignals":
        if threading.current_thread() is threading.main_thread():  # others cannot have handlers
            self._before = {number: signal.signal(number, self._ask) for number in self.SIGNALS}
        return self

    def __exit__(self, *_: Any) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        signal.signal(number, self._before[number])


def told(summary: Summary, progress: Any) -> Summary:
    """Return a Summary, with a warning if its verdict is failed and nothing shows how the run goes."""
    if not progress and summary.verdict is not None and summary.verdict.level == FAILED:
        warnings.warn(f"{summary.outputs.prefix}: the verdict is {summary.verdict}", stacklevel=3)
    return summary


def _asConfig(config: Config | dict[str, Any] | PathLike) -> Config:
    result = asConfig(config)
    if isinstance(config, dict) and result.output.prefix is None:
        raise ValueError("[output] prefix is missing; a configuration that is not a file has no name to take it from")
    return result


def _addSteps(config: Config, steps: int) -> None:
    """Let a run make more steps."""
    if steps < 1:
        raise ValueError(f"steps is {steps}; it must be positive")
    config.stages[-1:] = config.stages[-1].extended(steps)


def _changePlatform(config: Config, state: RunState, platform: str | None, threads: int | None) -> None:
    """Use another platform, or other versions, than before: not without saying so."""
    if platform is not None and platform != config.platform.name:
        state.notes.append(
            f"from step {state.step} on platform {platform} instead of {config.platform.name}: equal to a run on one "
            "platform but for rounding errors"
        )
        config.platform.name, config.platform.threads = platform, None
    if threads is not None:
        config.platform.threads = threads
    changed = [
        f"{name} {number} instead of {state.versions.get(name)}"
        for name, number in versions().items()
        if state.versions.get(name) != number
    ]
    if changed:
        state.notes.append(
            f"from step {state.step} with {', '.join(changed)}: perhaps no longer equal, to the last bit, to a run "
            "that was never stopped"
        )
        state.versions = versions()
