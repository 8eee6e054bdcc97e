"""Checkpoints: everything that a run needs to go on, in one file that is always complete.

The file is a ZIP archive.  It has the System, the Integrator and the State as OpenMM's XML, which holds every number
to the last bit and is the same on each platform; positions and velocities, which would be most of that, as
little-endian numbers of 64 bits; and a JSON file with the configuration, the stage, and the sizes of the files that the
run appends to.  At the end another JSON file is added, the record of the files that were written of this state: a
checkpoint without one, or with one that the files do not match, is of a run whose results are still to be drawn.  Live
triangles, random numbers' counters and the order of the vertices are part of the State, as parameters of the
Integrator.
"""

import contextlib
import io
import json
import shutil
import uuid
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import openmm as mm
from numpy.typing import NDArray
from openmm import app, unit
from pydantic import NonNegativeInt, TypeAdapter

from ..analysis.verdict import Verdict, verdictOfStages
from ..files import PathLike, replacing, requireStored
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce, HybridMonteCarloIntegrator
from ..messages import inLine
from ..sampling.conditions import boxOf
from ..sampling.moves import NO_FLIPS, FlipCounters

FORMAT = 2
READ_FORMATS = (1, FORMAT)  # in the first, positions and velocities are in the State
# Texts like ours become no more than so many times smaller.
MAX_RATIO = 200
RECORD = "record.json"
MOTION = ("positions", "velocities")

Parsed = TypeVar("Parsed")


@dataclass
class RunState:
    """How far a run is.

    Attributes
    ----------
    config : dict
        the configuration, with every default filled in
    stage : int
        the index of the present stage
    stageState : dict
        what the stage remembers
    sizes : dict
        how much of each growing file belongs to the run so far
    notes : list of str
        what the run has found out or had to warn of
    versions : dict
        of the software that the run has used so far
    step : int
        the number of Monte Carlo steps made
    isComplete : bool
        whether all stages are done
    run : str
        what tells the run from all others
    verdicts : dict
        the findings on each stage that is done, by its index
    minimizing : FlipCounters
        the flips that minimizations have tried
    record : dict
        what :func:`addRecord` added to the checkpoint
    """

    config: dict[str, Any]
    stage: NonNegativeInt
    stageState: dict[str, Any] | None
    sizes: dict[str, NonNegativeInt]
    notes: list[str]
    versions: dict[str, str]
    step: NonNegativeInt
    isComplete: bool
    run: str = field(default_factory=lambda: uuid.uuid4().hex)  # earlier versions' runs get one when they go on
    verdicts: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    minimizing: FlipCounters = NO_FLIPS  # earlier versions did not tell them from others
    record: dict[str, Any] = field(default_factory=dict)

    def verdictsOfStages(self) -> dict[int, Verdict]:
        """Return the verdicts on the stages that are done, by their indices.  Earlier versions' runs have none."""
        return {int(index): Verdict.ofData(findings) for index, findings in self.verdicts.items()}

    def verdict(self) -> Verdict | None:
        """Return the verdict on the run, None if its last stage is not done."""
        titles = [stage.get("name") or stage["kind"] for stage in self.config["stages"]]
        return verdictOfStages(titles, self.verdictsOfStages())


_RUN_STATE = TypeAdapter(RunState)


def saveCheckpoint(file: PathLike, simulation: app.Simulation, runState: RunState) -> None:
    """Write a checkpoint, replacing an earlier one in a single step.

    Raises OSError if that fails; the earlier one is whole then.
    """
    state = simulation.context.getState(parameters=True, integratorParameters=True)
    run = {"format": FORMAT, **asdict(runState)}
    del run["record"]  # of files that are older than this checkpoint
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("run.json", json.dumps(run, indent=1))
        for name, what in (("system", simulation.system), ("integrator", simulation.integrator), ("state", state)):
            archive.writestr(f"{name}.xml", mm.XmlSerializer.serialize(what))  # one text at a time, for they are long
        for name, values in zip(MOTION, _motionOf(simulation.context.getState(positions=True, velocities=True))):
            archive.writestr(name, values.astype("<f8").tobytes(), zipfile.ZIP_STORED)  # nothing makes them shorter
    with replacing(file) as part:
        part.write_bytes(content.getbuffer())


def addRecord(file: PathLike, record: dict[str, Any]) -> None:
    """Add the record of the files of a run to its checkpoint, in a single step."""
    with replacing(file) as part:
        shutil.copyfile(file, part)
        # Of a name that it cannot open ZipFile would make an empty file.
        with open(part, "r+b") as content, zipfile.ZipFile(content, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(RECORD, json.dumps(record, indent=1))


def loadRunState(file: PathLike) -> RunState:
    """Return the RunState that a checkpoint holds.

    Raises FileNotFoundError if there is no such file, and ValueError if it is not a checkpoint.
    """
    state = _read(file, _runStateIn)
    if state is None:
        raise ValueError(f"{file} is a checkpoint of another version's format")
    return state


def verdictOf(file: PathLike) -> Verdict | None:
    """Return the verdict on the run of a checkpoint; None if it has none, or there is no such file."""
    try:
        return loadRunState(file).verdict()
    except (ValueError, OSError):
        return None


@contextlib.contextmanager
def understanding(file: PathLike) -> Iterator[None]:
    """Name a checkpoint where what it says of a run makes no sense."""
    try:
        yield
    except ValueError as error:
        if str(file) in str(error):
            raise
        raise ValueError(f"{file}: {error}") from None
    except (LookupError, TypeError, AttributeError):
        raise ValueError(f"{file} is damaged: what it says of the run makes no sense") from None


def loadSimulation(
    file: PathLike, platform: mm.Platform, properties: dict[str, str]
) -> tuple[app.Simulation, HelfrichForce]:
    """Return the app.Simulation that a checkpoint holds, and its HelfrichForce."""
    with naming(file):
        (system, integrator, state), (positions, velocities) = _read(file, _simulationIn)
        force = next(HelfrichForce.cast(f) for f in system.getForces() if HelfrichForce.isinstance(f))
        triangles = force.getTriangles()
        numVertices = int(triangles.max()) + 1
        box = boxOf(state, force)
        mesh = Mesh(positions[:numVertices], triangles, box, positions[numVertices:])
        simulation = app.Simulation(
            mesh.topology(), system, HybridMonteCarloIntegrator.cast(integrator), platform, properties
        )
        simulation.context.setState(state)
        simulation.context.setPositions(positions)
        simulation.context.setVelocities(velocities)
        if not np.isfinite(simulation.context.getState(energy=True).getKineticEnergy()._value):
            raise ValueError("the velocities are not finite")
        return simulation, force


@contextlib.contextmanager
def naming(file: PathLike) -> Iterator[None]:
    """Say of which checkpoint it is that something cannot be made of what it holds."""
    try:
        yield
    except (FileNotFoundError, MemoryError):
        raise
    except mm.OpenMMException as error:
        raise ValueError(f"the simulation in {file} cannot go on: {inLine(error)}") from None
    except Exception:  # of what is damaged the libraries make anything from a KeyError to an encrypted file
        raise ValueError(f"{file} is not a checkpoint of openmm-helfrich, or is damaged") from None


def _read(file: PathLike, parse: Callable[[zipfile.ZipFile], Parsed]) -> Parsed:
    if not Path(file).exists():
        raise FileNotFoundError(f"there is no checkpoint {file}")
    with naming(file), zipfile.ZipFile(file) as archive:
        parts = archive.infolist()
        size, stored = (sum(getattr(part, name) for part in parts) for name in ("file_size", "compress_size"))
        requireStored("it", size, stored, MAX_RATIO)
        return parse(archive)


def _runStateIn(archive: zipfile.ZipFile) -> RunState | None:
    """Return a RunState, or None if its format is another version's."""
    text = archive.read("run.json")
    if json.loads(text).get("format") not in READ_FORMATS:
        return None
    state = _RUN_STATE.validate_json(text, strict=True)
    if RECORD in archive.namelist():
        state.record = dict(json.loads(archive.read(RECORD)))
    sampling = state.config.setdefault("sampling", {})
    if isinstance(sampling, dict):
        sampling.setdefault("multilevel_weight", 0.0)  # a run that does not name it is older than its "auto"
    if state.stage >= len(state.config["stages"]):
        raise ValueError("it is at a stage that there is not")
    return state


def _simulationIn(archive: zipfile.ZipFile) -> tuple[list[Any], list[NDArray[np.float64]]]:
    """Return a System, an Integrator and a State; and positions and velocities."""
    names = ("system.xml", "integrator.xml", "state.xml")
    parts = [mm.XmlSerializer.deserialize(archive.read(name).decode()) for name in names]
    if MOTION[0] not in archive.namelist():
        return parts, _motionOf(parts[-1])
    return parts, [np.frombuffer(archive.read(name), "<f8").reshape(-1, 3) for name in MOTION]


def _motionOf(state: mm.State) -> list[NDArray[np.float64]]:
    """Return the positions and velocities of a State."""
    return [
        state.getPositions(asNumpy=True).value_in_unit(unit.nanometer),
        state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond),
    ]
