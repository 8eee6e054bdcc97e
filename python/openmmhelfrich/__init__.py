"""Fluid membranes in OpenMM: Helfrich elasticity, edge flips and Hybrid Monte Carlo."""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from .adaptation import AmplitudeAdapter, AmplitudeTracker, StepSizeAdapter, StepSizeTracker, adaptStepSize
from .annealing import anneal
from .continuation import ContinuationResult, continueTo
from .helfrich import (
    CustomTrajectoryIntegrator,
    EdgeFlipIntegrator,
    HamiltonianTrajectoryIntegrator,
    HelfrichForce,
    HybridMonteCarloIntegrator,
    MonteCarloIntegrator,
    ShearWaveIntegrator,
)
from .mesh import Mesh, reducedVolume
from .minimization import MinimizationResult, minimize, minimizeFluid
from .psf import writePSF
from .reporters import MeshReporter, ObservablesReporter, readObservables
from .schedules import ExponentialSchedule, TableSchedule, createSchedule
from .vtkhdf import MeshFrame, meshFrame, readMeshTrajectory, writeMeshTrajectory

try:
    __version__ = version("openmm-helfrich")
except PackageNotFoundError:  # a source tree on the path, not installed
    __version__ = "unknown"


# What is imported when it is asked for, by the module it is in: scripts that do without start faster.
_LATER = {
    "axisymmetric": ["axisymmetricMinimum"],
    "studies": ["resume", "run"],
    "replicaexchange": ["ReplicaExchange", "ThermodynamicState"],
    "grids": ["readGrid"],
    "sweeps": ["sweep"],
    "reweighting": ["reweight"],
    "shapes": ["spheroid", "spheroidAspectRatio", "surfaceOfRevolution"],
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
    "CustomTrajectoryIntegrator",
    "MonteCarloIntegrator",
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
