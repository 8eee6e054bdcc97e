"""Fluid membranes in OpenMM: Helfrich elasticity, edge flips and Hybrid Monte Carlo."""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from .sampling.adaptation import AmplitudeAdapter, AmplitudeTracker, StepSizeAdapter, StepSizeTracker, adaptStepSize
from .sampling.annealing import anneal
from .sampling.continuation import ContinuationResult, continueTo
from .helfrich import (
    EdgeFlipIntegrator,
    HamiltonianTrajectoryIntegrator,
    HelfrichForce,
    HybridMonteCarloIntegrator,
    ShearWaveIntegrator,
)
from .geometry.mesh import Mesh, reducedVolume
from .sampling.minimization import MinimizationResult, minimize, minimizeFluid
from .io.psf import writePSF
from .sampling.reporters import MeshReporter, ObservablesReporter, readObservables
from .sampling.schedules import ExponentialSchedule, TableSchedule, createSchedule
from .io.vtkhdf import MeshFrame, meshFrame, readMeshTrajectory, writeMeshTrajectory

try:
    __version__ = version("openmm-helfrich")
except PackageNotFoundError:  # a source tree on the path, not installed
    __version__ = "unknown"


# What is imported when it is asked for, by the module it is in: scripts that do without start faster.
_LATER = {
    "geometry.axisymmetric": ["axisymmetricMinimum"],
    "runs.studies": ["resume", "run"],
    "sampling.replicaexchange": ["ReplicaExchange", "ThermodynamicState"],
    "runs.grids": ["readGrid"],
    "runs.sweeps": ["sweep"],
    "analysis.reweighting": ["reweight"],
    "geometry.shapes": ["spheroid", "spheroidAspectRatio", "surfaceOfRevolution"],
    "analysis": [
        "autocorrelationTime",
        "classifyShape",
        "describeShape",
        "describeTrajectory",
        "fluctuationSpectrum",
        "meanAndError",
        "vertexDiffusion",
    ],
}


def __getattr__(name):
    for module, names in _LATER.items():
        if name == module or name in names:
            found = import_module(f".{module}", __name__)
            return found if name == module else getattr(found, name)
    raise AttributeError(f"module 'openmmhelfrich' has no attribute '{name}'")


__all__ = [
    "EdgeFlipIntegrator",
    "HamiltonianTrajectoryIntegrator",
    "HelfrichForce",
    "HybridMonteCarloIntegrator",
    "Mesh",
    "ObservablesReporter",
    "readObservables",
    "writePSF",
    "AmplitudeAdapter",
    "AmplitudeTracker",
    "ShearWaveIntegrator",
    "StepSizeAdapter",
    "StepSizeTracker",
    "adaptStepSize",
    "anneal",
    "MinimizationResult",
    "axisymmetricMinimum",
    "minimize",
    "minimizeFluid",
    "reducedVolume",
    "spheroid",
    "spheroidAspectRatio",
    "surfaceOfRevolution",
    "ContinuationResult",
    "continueTo",
    "resume",
    "run",
    "readGrid",
    "sweep",
    "autocorrelationTime",
    "classifyShape",
    "describeShape",
    "describeTrajectory",
    "fluctuationSpectrum",
    "meanAndError",
    "vertexDiffusion",
    "ReplicaExchange",
    "ThermodynamicState",
    "reweight",
    "ExponentialSchedule",
    "TableSchedule",
    "createSchedule",
    "MeshFrame",
    "MeshReporter",
    "meshFrame",
    "readMeshTrajectory",
    "writeMeshTrajectory",
]
