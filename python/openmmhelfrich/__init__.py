"""Fluid membranes in OpenMM: Helfrich elasticity, edge flips and Hybrid Monte Carlo."""
from importlib.metadata import PackageNotFoundError, version

from .adaptation import StepSizeAdapter, StepSizeTracker, adaptStepSize
from .annealing import anneal
from .continuation import ContinuationResult, continueTo
from .helfrich import EdgeFlipIntegrator, HamiltonianTrajectoryIntegrator, HelfrichForce, HybridMonteCarloIntegrator
from .mesh import Mesh, reducedVolume
from .minimization import MinimizationResult, minimize, minimizeFluid
from .psf import writePSF
from .reporters import MeshReporter, ObservablesReporter, readObservables
from .schedules import ExponentialSchedule, TableSchedule, createSchedule
from .shapes import spheroid, spheroidAspectRatio, surfaceOfRevolution
from .vtkhdf import MeshFrame, meshFrame, readMeshTrajectory, writeMeshTrajectory

try:
    __version__ = version("openmm-helfrich")
except PackageNotFoundError:  # a source tree on the path, not installed
    __version__ = "unknown"


def __getattr__(name):
    """Import what runs from configurations when it is asked for: scripts that do without start faster."""
    if name in ("run", "resume"):
        from . import studies
        return getattr(studies, name)
    raise AttributeError(f"module 'openmmhelfrich' has no attribute '{name}'")


__all__ = [
    "EdgeFlipIntegrator", "HamiltonianTrajectoryIntegrator", "HelfrichForce", "HybridMonteCarloIntegrator", "Mesh", "ObservablesReporter", "readObservables", "writePSF",
    "StepSizeAdapter", "StepSizeTracker", "adaptStepSize", "anneal",
    "MinimizationResult", "minimize", "minimizeFluid", "reducedVolume", "spheroid", "spheroidAspectRatio", "surfaceOfRevolution",
    "ContinuationResult", "continueTo", "resume", "run",
    "ExponentialSchedule", "TableSchedule", "createSchedule",
    "MeshFrame", "MeshReporter", "meshFrame", "readMeshTrajectory", "writeMeshTrajectory",
]
