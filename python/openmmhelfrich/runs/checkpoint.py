"""Checkpoints: everything that a run needs to go on, in one file that is always complete.

The file is a ZIP archive of texts: the System, the Integrator and the State as OpenMM's XML, which holds every number
to the last bit and is the same on each platform, and a JSON file with the configuration, the stage, and the sizes of
the files that the run appends to.  Live triangles, random numbers' counters and the order of the vertices are part of
the State, as parameters of the Integrator.
"""

import json
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import openmm as mm
from openmm import app

from ..files import PathLike, replacing
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce, HybridMonteCarloIntegrator

FORMAT = 1


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
    """

    config: dict
    stage: int
    stageState: dict[str, Any] | None
    sizes: dict
    notes: list
    versions: dict
    step: int
    isComplete: bool


def saveCheckpoint(file: PathLike, simulation: app.Simulation, runState: RunState) -> None:
    """Write a checkpoint, replacing an earlier one in a single step.

    Raises OSError if that fails; the earlier one is whole then.
    """
    state = simulation.context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    with replacing(file) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("run.json", json.dumps({"format": FORMAT, **asdict(runState)}, indent=1))
        for name, what in (("system", simulation.system), ("integrator", simulation.integrator), ("state", state)):
            archive.writestr(f"{name}.xml", mm.XmlSerializer.serialize(what))  # one text at a time, for they are long


def loadRunState(file: PathLike) -> RunState:
    """Return the RunState that a checkpoint holds.

    Raises FileNotFoundError if there is no such file, and ValueError if it is not a checkpoint.
    """
    (state,) = _read(file, ("run.json",), _parse)
    if state is None:
        raise ValueError(f"{file} is a checkpoint of another version's format")
    return state


def loadSimulation(
    file: PathLike, platform: mm.Platform, properties: dict[str, str]
) -> tuple[app.Simulation, HelfrichForce]:
    """Return the app.Simulation that a checkpoint holds, and its HelfrichForce."""
    system, integrator, state = _read(file, ("system.xml", "integrator.xml", "state.xml"), mm.XmlSerializer.deserialize)
    force = next(HelfrichForce.cast(f) for f in system.getForces() if HelfrichForce.isinstance(f))
    mesh = Mesh(state.getPositions(asNumpy=True), force.getTriangles())
    simulation = app.Simulation(
        mesh.topology(), system, HybridMonteCarloIntegrator.cast(integrator), platform, properties
    )
    simulation.context.setState(state)
    return simulation, force


def _read(file, names, parse):
    if not Path(file).exists():
        raise FileNotFoundError(f"there is no checkpoint {file}")
    try:
        with zipfile.ZipFile(file) as archive:
            return [parse(archive.read(name).decode()) for name in names]
    except mm.OpenMMException:
        raise
    except Exception:  # of a damaged archive the library makes anything from a KeyError to an encrypted file
        raise ValueError(f"{file} is not a checkpoint of openmm-helfrich, or is damaged") from None


def _parse(text):
    """Return a RunState, or None if its format is another version's."""
    data = json.loads(text)
    return RunState(**data) if data.pop("format", None) == FORMAT else None
