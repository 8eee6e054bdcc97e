"""Sweeps: the points of a grid as tasks of dask.distributed.

A point is a run in a folder of its own, and its checkpoint is all that a worker needs to go on with it, so that a task
may die and be made again anywhere.  The lock of the run keeps two workers from one point.  When the run has ended,
``result.json`` says what came of it, and of which files: a point that has one is finished, if its files are those.
A finished point is done or, if the verdict on its run is so, failed.
"""

import contextlib
import csv
import json
import math
import pickle
import signal
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing import spawn
from pathlib import Path
from typing import Any

import openmm as mm

from ..analysis.description import classifyShape
from ..analysis.verdict import FAILED, Verdict
from ..display import briefly, htmlTable
from ..files import PathLike, replacing
from ..geometry.measures import reducedAreaDifference
from ..geometry.mesh import Mesh
from ..io.locks import InUseError, locked
from ..optional import require
from ..sampling.averages import lateRows
from ..sampling.interruption import interruptible
from ..sampling.observables import observablesIn, readObservables
from ..sampling.progress import requireProgress
from ..tables import headOf, unwarned
from ..units import wholeNumber
from .additions import Setup
from .checkpoint import loadRunState
from .config import Config, after, readConfig
from .configfile import settingsText
from .grids import GridPoint, coarsePoints, readGrid, seedOf
from .outputs import Outputs
from .platforms import platformOf
from .progress import SweepProgress, following
from .room import requireDisk
from .studies import StopSignals, Study, resume, run
from .summary import Summary

SECONDS_BETWEEN_MESSAGES = 0.5
SECONDS_FOR_A_LOCK = 5.0
_stopping: set[str] = set()  # on a worker: the sweeps that were asked to stop


@dataclass
class PointStatus:
    """How far a point is.

    Attributes
    ----------
    point : GridPoint
        which
    status : str
        "waiting", "running", "done", "failed" or "stopped"
    stage : str
        what is being done
    position, steps : int
        the steps made, and to make, in this stage
    verdict : str
        the level of that on its run: "good", "doubtful" or "failed"; empty if it has none
    reason : str
        why it failed, or is doubtful
    observables : dict
        what came of it
    """

    point: GridPoint
    status: str = "waiting"
    stage: str = ""
    position: int = 0
    steps: int = 1
    verdict: str = ""
    reason: str = ""
    observables: dict = field(default_factory=dict)

    def finish(self, outcome: dict[str, Any]) -> None:
        """Take what came of the point."""
        findings = outcome.get("verdict")
        verdict = None if findings is None else Verdict.ofData(findings)
        self.status, self.observables = outcome["status"], outcome.get("observables", {})
        self.verdict = verdict.level if verdict else ""
        self.reason = outcome.get("reason", "") or "; ".join(verdict.reasons() if verdict else ())


@dataclass(repr=False)
class SweepResult:
    """What came of a sweep.

    Attributes
    ----------
    points : list of PointStatus
        in the order of the grid
    table : Path
        the summary that was written: a row for each point
    signal : int or None
        what stopped the sweep
    """

    points: list[PointStatus]
    table: Path
    signal: int | None = None

    @property
    def notes(self) -> list[str]:
        """What there is to warn of: which points have too few vertices for where their targets lead."""
        return coarsePoints([state.point for state in self.points])

    def count(self, status: str) -> int:
        """Return the number of points of a status."""
        return sum(point.status == status for point in self.points)

    def __repr__(self) -> str:
        counts = [
            f"{n} {status}" for status in dict.fromkeys(p.status for p in self.points) if (n := self.count(status))
        ]
        return f"<SweepResult: {len(self.points)} points, {', '.join(counts)}, {self.table}>"

    def _repr_html_(self) -> str:
        shown = ("shapeClass", "reducedVolume", "E_bending/8 pi kappa", "acceptance")
        rows = [
            [
                state.point.name,
                state.status,
                *(briefly(state.observables.get(name, "")) for name in shown),
                state.reason,
            ]
            for state in self.points
        ]
        return htmlTable(rows, ["point", "status", *shown, "reason"])


def sweep(
    grid: PathLike,
    output: PathLike | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Callable[[list[PointStatus]], None] | bool | None = None,
    retry: str | None = None,
    setup: Setup | None = None,
    threads: int | None = None,
) -> SweepResult:
    """Run what is left of a grid.

    SIGINT and SIGTERM end the sweep early, after a checkpoint of every point.

    ::

        result = mh.sweep("grid.toml", workers=1)
        print(result.table)

    Parameters
    ----------
    grid : path
        the file of the grid
    output : path, optional
        the folder for the results; by default the grid's name without suffix
    scheduler : str, optional
        the address of a Dask scheduler, whose workers see the same files; by default there is one for this sweep alone,
        on this machine
    workers : int, optional
        the number of processes of the latter, by default as many as give each thread of a point a core.  No result
        depends on it
    progress : callable or True, optional
        called with the points, several times a second; True shows bars, in a terminal and in Jupyter
    retry : str, optional
        "failed" begins points anew whose verdict is failed, with the grid's present settings and other random numbers.
        Points that are done stay, also if they were begun with other settings
    setup : callable, optional
        of every point: see :func:`openmmhelfrich.run`. It goes to other processes, so that what it refers to must be
        what pickle or cloudpickle take: no Context, no open file. A sweep that is to go on takes the same setup, for
        the points that have not begun
    threads : int, optional
        the number of threads of each point, instead of the grid's, which is 1 by default.  No result depends on it

    Raises
    ------
    ValueError, OSError
        if the grid will not do, a point has been begun with other settings, or the scheduler cannot be reached; no
        point has been touched then
    """
    requireProgress(progress, hasBars=True)
    _requireLibraries()
    _requirePickled(setup)
    if scheduler is not None and workers is not None:
        raise ValueError(f"workers is {workers} and scheduler {scheduler}; a scheduler has workers of its own")
    if retry not in (None, FAILED):
        raise ValueError(f"retry is '{retry}'; it must be '{FAILED}'")
    points = readGrid(grid)
    folder = Path(output or Path(grid).stem).resolve()
    for point in points:
        _place(point, folder)
        if threads is not None:
            point.config.platform.threads = wholeNumber(threads, "sweep: threads", 1)
    if scheduler is None:
        _requirePlatforms(points)
    states = [PointStatus(point) for point in points]
    _takeFinished(states)
    again = [state for state in states if retry and state.verdict == FAILED]
    for state in states:
        if state not in again and not (retry and state.status == "done"):
            _requireSameSettings(state.point, folder)
    result = SweepResult(states, folder / "summary.csv")
    # What a point that had begun has written already is not counted as room: it is little where the disk is full.
    waiting = [state.point for state in states if state.status == "waiting"]
    requireDisk(sum(point.diskSize for point in waiting if not _settingsFile(point.config).exists()), folder)
    folder.mkdir(parents=True, exist_ok=True)
    for state in again:
        _beginAnew(state)
    with StopSignals() as stop:
        if any(state.status == "waiting" for state in states):
            with _client(scheduler, workers, points) as client, following(progress, SweepProgress) as shown:
                show = shown or (lambda points: None)
                show(states)
                _Dispatcher(client, result, stop, show, setup).run()
        result.signal = stop.signal
    _writeTable(result)
    return result


def runPoint(config: Config, name: str, sweepName: str, setup: Setup | None = None) -> dict[str, Any]:
    """Do what is left of a point, on a worker, and return a dict of its status, "done", "failed", "stopped" or "busy",
    and of what there is to say.
    """
    folder = _folder(config)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        isToStop = interruptible(lambda: sweepName in _stopping)
        with locked(Outputs.of(config).prefix, SECONDS_FOR_A_LOCK), isToStop:
            result = _finished(config)
            if result is None:
                if _isStopped(_goOn(config, _Messenger(name, sweepName), setup)):
                    return {"status": "stopped"}
                result = _writeResult(config)
            return result
    except InUseError:
        return {"status": "busy"}
    except (ValueError, OSError, mm.OpenMMException) as error:
        return {"status": "failed", "reason": str(error)}
    except Exception as error:  # whatever goes wrong in a point is its own affair
        return {"status": "failed", "reason": f"{type(error).__name__}: {error}"}


def _requireLibraries() -> None:
    """Raise a ValueError unless the libraries of the extra are there; cryptography makes the certificate."""
    for module in ("distributed", "dask", "cryptography"):
        require(module, "a sweep", "sweep")


def _requirePickled(setup: Setup | None) -> None:
    """Raise a ValueError if a setup cannot go to other processes."""
    if setup is None:
        return
    try:
        require("cloudpickle", "a sweep", "sweep").dumps(setup)
    except (TypeError, pickle.PicklingError, AttributeError) as error:
        raise ValueError(
            f"the setup cannot go to the processes of the sweep: {error}; make in it what it refers to"
        ) from None


def _requirePlatforms(points: list[GridPoint]) -> None:
    """Raise a ValueError if there is no such platform on this machine as a point asks for, or not so many threads."""
    for config in {point.config.platform.model_dump_json(): point.config for point in points}.values():
        platformOf(config)


def _place(point: GridPoint, folder: Path) -> None:
    """Give a point its folder, and its random numbers if it was begun anew there."""
    config = point.config
    # The folder belongs to the point, and the lock to its run.
    config.output.prefix, config.output.overwrite = (
        str(folder / point.name / "run"),
        True,
    )
    for attempt in range(_attempt(config)):
        config.sampling.seed = _nextSeed(config, attempt)


def _attempt(config: Config) -> int:
    """Return how often a point was begun anew."""
    try:
        return int(_attemptFile(config).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return 0


def _nextSeed(config: Config, attempt: int) -> int:
    return seedOf(config.sampling.seed, f"attempt {attempt + 1}")


def _beginAnew(state: PointStatus) -> None:
    """Let a point that is finished wait to be run again."""
    config = state.point.config
    with locked(Outputs.of(config).prefix, SECONDS_FOR_A_LOCK):
        attempt = _attempt(config)
        # In this order a point that is left half way begins anew, too.
        for file in (_resultFile(config), Outputs.of(config).checkpoint, _settingsFile(config)):
            file.unlink(missing_ok=True)
        with replacing(_attemptFile(config)) as part:
            part.write_text(f"{attempt + 1}\n", encoding="utf-8")
    config.sampling.seed = _nextSeed(config, attempt)
    state.status, state.verdict, state.reason, state.observables = "waiting", "", "", {}


def _requireSameSettings(point: GridPoint, folder: Path) -> None:
    """Raise a ValueError if the folder of a point holds a run of other settings."""
    config = point.config
    file = _settingsFile(config)
    if file.exists():
        before, now = (_comparable(c) for c in (readConfig(file), config))
        changed = [
            f"{key} is {now.get(key)!r}, and was {before.get(key)!r}"
            for key in {**before, **now}
            if before.get(key) != now.get(key)
        ]
        if changed:
            raise ValueError(
                f"point {point.name} was begun with other settings: {changed[0]}; choose another output folder, or "
                f"delete {folder / point.name}"
            )


def _comparable(config: Config) -> dict[str, Any]:
    """Return what a point's results depend on, by key."""
    data = config.model_dump(
        mode="json",
        exclude={
            "output": {"prefix", "overwrite", "checkpoint_interval", "checkpoint_seconds"},
            "platform": {"threads"},
        },
    )
    lists = {"stage": data.pop("stages"), "[[species]]": data.pop("species")}
    return {
        **{f"[{section}] {key}": value for section, values in data.items() for key, value in values.items()},
        **{
            f"{name} {i + 1} {key}": value
            for name, tables in lists.items()
            for i, table in enumerate(tables)
            for key, value in table.items()
        },
    }


def _folder(config: Config) -> Path:
    return Path(config.output.prefix or "").parent


def _settingsFile(config: Config) -> Path:
    return _folder(config) / "point.toml"


def _attemptFile(config: Config) -> Path:
    return _folder(config) / "attempt"


def _resultFile(config: Config) -> Path:
    return _folder(config) / "result.json"


def _goOn(config: Config, progress: Callable[[Study], None], setup: Setup | None) -> Summary | None:
    """Begin a run, or go on with it, and return its Summary; None if it has come to its end already."""
    outputs = Outputs.of(config)
    if not outputs.checkpoint.exists():
        _writeSettings(config)
        return run(config, progress, setup)
    if outputs.match(loadRunState(outputs.checkpoint).record):
        return None
    return resume(config.output.prefix or "", progress=progress, threads=config.platform.threads)


def _writeSettings(config: Config) -> None:
    with replacing(_settingsFile(config)) as part:
        part.write_text(
            settingsText(config, ["The settings of this point, as openmm-helfrich run takes them."]), encoding="utf-8"
        )


def _isStopped(summary: Summary | None) -> bool:
    return summary is not None and summary.interrupted


class _Messenger:
    """Tells the sweep how far a point is, and the point to stop if the sweep is to.

    Called with the Study after each step.
    """

    def __init__(self, name: str, sweepName: str) -> None:
        from distributed import get_worker

        self._name, self._sweep, self._log, self._saidAt = name, sweepName, get_worker().log_event, -math.inf

    def __call__(self, study: Study) -> None:
        if self._sweep in _stopping:
            raise KeyboardInterrupt
        now = time.monotonic()
        if now >= self._saidAt + SECONDS_BETWEEN_MESSAGES:
            self._saidAt = now
            stage = study.stage
            self._log(
                self._sweep,
                {
                    "name": self._name,
                    "stage": f"{study.index + 1}/{len(study.config.stages)} {stage.title}",
                    "position": stage.position,
                    "steps": stage.steps,
                },
            )


def _writeResult(config: Config) -> dict[str, Any]:
    """Write what came of a point, with the record of the files that tell it, and return it."""
    state = loadRunState(Outputs.of(config).checkpoint)
    verdict = state.verdict()
    told = {"observables": observe(config), "verdict": None if verdict is None else verdict.toData()}
    with replacing(_resultFile(config)) as part:
        part.write_text(json.dumps({**state.record, **told}, indent=1) + "\n", encoding="utf-8")
    return _outcomeOf(told)


def _outcomeOf(told: dict[str, Any]) -> dict[str, Any]:
    """Return the outcome of a finished point, of what its result tells.  Earlier versions' results have no verdict."""
    isFailed = Verdict.ofData(told["verdict"] or ()).level == FAILED
    return {"status": "failed" if isFailed else "done", **told}


def _finished(config: Config) -> dict[str, Any] | None:
    """Return what came of a point, or None if it is not finished, or its files are not those of its last step."""
    try:
        record = dict(json.loads(_resultFile(config).read_text(encoding="utf-8")))
        told = {"observables": record.pop("observables"), "verdict": record.pop("verdict", None)}
        return _outcomeOf(told) if Outputs.of(config).match(record) else None
    except (OSError, ValueError, TypeError, KeyError):  # an earlier version's, or damaged
        return None


@unwarned
def observe(config: Config) -> dict[str, Any]:
    """Return what came of a run, by name: averages over the second half of its last stage, or its last window, where
    these are equilibrated, and the final shape.

    Energies are in kT; reducedAreaDifference is M/(4 pi R_A), and shapeClass that of :func:`classifyShape`, of several
    surfaces that of each.  Acceptance rates are those of the whole run.
    """
    outputs, kappa, lengthUnit = Outputs.of(config), _endModulus(config), config.mesh.length_unit
    table, surfaces = readObservables(outputs.table), Mesh.read(outputs.mesh).components()
    late = lateRows(table)
    mean = {name: float(values.mean()) for name, values in late.items()}
    observables = observablesIn(table)
    averaged = [o for o in observables if o.inSweep == "mean"]
    means = {headOf(o.name, o.unitIn(lengthUnit)): float(late[o.name].mean()) for o in averaged if o.unit}
    return {
        "steps": int(table["step"][-1]),
        "shapeClass": ", ".join(map(classifyShape, surfaces)),
        "E_bending/8 pi kappa": mean["E_bending"] / (8 * math.pi * kappa) if kappa > 0 else None,
        **{o.name: float(late[o.name].mean()) for o in averaged if not o.unit},
        **{
            f"reducedAreaDifference{k}": reducedAreaDifference(mean[f"area{k}"], mean[f"meanCurvature{k}"])
            for k in ([f"[{k}]" for k in range(len(surfaces))] if len(surfaces) > 1 else [""])
            if not surfaces[0].isPeriodic
        },
        **means,
        **{o.name: float(table[o.name][-1]) for o in observables if o.inSweep == "last"},
    }


def _endModulus(config: Config) -> float:
    """Return the bending modulus at the end of a run."""
    return after(config, len(config.stages) - 1).membrane.bending_modulus


def _takeFinished(states: list[PointStatus]) -> None:
    for state in states:
        outcome = _finished(state.point.config)
        if outcome is not None:
            state.finish(outcome)


@contextlib.contextmanager
def _client(scheduler: str | None, workers: int | None, points: list[GridPoint]) -> Iterator[Any]:
    """Lend a Client of a scheduler, or of a cluster of processes on this machine that lives as long: by default of as
    many as give each thread of a point a core.

    The ports of the latter take the certificate that it makes for itself, and are open to nobody else.
    """
    import dask
    import distributed

    if scheduler is not None:
        try:
            client = distributed.Client(scheduler, timeout=10)
        except (OSError, ValueError) as error:
            raise ConnectionError(f"no Dask scheduler answers at {scheduler}: {error}") from None
        with client:
            yield client
        return
    # Dask's HTTP servers cannot be done without; they have nothing to tell, and close as soon as they can.
    cores = dask.system.CPU_COUNT
    threads = max(point.config.platform.threads or 1 for point in points)
    silent: dict[str, list[str]] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
    with (
        dask.config.set(silent),
        _workersWithoutScript(),
        distributed.LocalCluster(
            n_workers=workers or max(1, cores // threads),
            threads_per_worker=1,
            memory_limit=0,
            security=True,
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs="CRITICAL",
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.run_on_scheduler(_closeHTTP)
        client.register_worker_callbacks(_prepareWorker)
        yield client


@contextlib.contextmanager
def _workersWithoutScript() -> Iterator[None]:
    """Start processes that do not run the script that calls this: it may begin a sweep in each."""
    whole = spawn.get_preparation_data

    def withoutScript(name: str) -> dict[str, Any]:
        return {key: value for key, value in whole(name).items() if not key.startswith("init_main")}

    spawn.get_preparation_data = withoutScript
    try:
        yield
    finally:
        spawn.get_preparation_data = whole


def _closeHTTP(dask_scheduler: Any) -> None:
    dask_scheduler.http_server.stop()


def _prepareWorker(dask_worker: Any) -> None:
    """Leave Ctrl-C, which a terminal sends to every process, to the sweep, and close the HTTP server."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    dask_worker.http_server.stop()


def _askToStop(sweepName: str) -> None:
    """Let the points of a sweep that run on a worker end, after a checkpoint."""
    _stopping.add(sweepName)


class _Dispatcher:
    """Hands points to workers, as many as there are threads for, until none is left."""

    def __init__(
        self,
        client: Any,
        result: SweepResult,
        stop: StopSignals,
        progress: Callable[[list[PointStatus]], None],
        setup: Setup | None,
    ) -> None:
        self._client, self._result, self._stop, self._progress, self._setup = client, result, stop, progress, setup
        self._name = f"openmm-helfrich-sweep-{uuid.uuid4().hex}"
        self._states = {state.point.name: state for state in result.points}
        self._waiting = [state.point for state in result.points if state.status == "waiting"]
        self._running: dict[Any, GridPoint] = {}  # by their futures

    def run(self) -> None:
        self._client.subscribe_topic(self._name, self._hear)
        while self._running or self._waiting:
            if self._stop.signal is not None:
                self._waiting = []
                self._client.run(_askToStop, self._name, on_error="ignore")
            self._handOut()
            self._wait()
            self._collect()
            self._progress(self._result.points)
        self._client.unsubscribe_topic(self._name)

    def _handOut(self) -> None:
        free = max(0, sum(self._client.nthreads().values()) - len(self._running))
        for point in self._waiting[:free]:
            future = self._client.submit(
                runPoint,
                point.config,
                point.name,
                self._name,
                self._setup,
                key=f"{point.name}-{uuid.uuid4().hex}",
                pure=False,
            )
            self._running[future] = point
        del self._waiting[:free]

    def _wait(self) -> None:
        from distributed import TimeoutError, wait

        if not self._running:
            time.sleep(SECONDS_BETWEEN_MESSAGES)  # no worker is there yet
            return
        with contextlib.suppress(TimeoutError):
            wait(list(self._running), timeout=SECONDS_BETWEEN_MESSAGES, return_when="FIRST_COMPLETED")

    def _collect(self) -> None:
        hasNews = False
        for future in [future for future in self._running if future.done()]:
            point = self._running.pop(future)
            state, outcome = self._states[point.name], self._outcome(future)
            if outcome["status"] == "busy":  # with another sweep, or a worker that is thought dead: later perhaps
                self._waiting.append(point)
                continue
            state.finish(outcome)
            hasNews = True
        if hasNews:
            _writeTable(self._result)

    @staticmethod
    def _outcome(future: Any) -> dict[str, Any]:
        if future.status == "finished":
            return future.result()
        error = future.exception()
        if type(error).__name__ == "KilledWorker":
            return {
                "status": "failed",
                "reason": (
                    f"{error.allowed_failures + 1} workers died while they ran it; the next sweep goes on from "
                    "its checkpoint"
                ),
            }
        return {"status": "failed", "reason": f"{type(error).__name__}: {error}"}

    def _hear(self, event: tuple[Any, dict[str, Any]]) -> None:
        """Take a message of a point, on the Client's thread."""
        _, message = event
        state = self._states[message["name"]]
        if state.status in ("waiting", "running"):
            state.status = "running"
            state.stage, state.position, state.steps = message["stage"], message["position"], message["steps"]


def _writeTable(result: SweepResult) -> None:
    """Write a row for each point, replacing the table in a single step."""
    heads = dict.fromkeys(name for state in result.points for name in state.point.parameters)
    columns = dict.fromkeys(name for state in result.points for name in state.observables)
    with replacing(result.table) as part, open(part, "w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([*heads, "status", "verdict", *columns, "reason", "folder"])
        for state in result.points:
            status = state.status if state.status in ("done", "failed") else "unfinished"
            writer.writerow(
                [
                    *(state.point.parameters.get(name) for name in heads),
                    status,
                    state.verdict,
                    *(state.observables.get(name) for name in columns),
                    state.reason,
                    state.point.name,
                ]
            )
