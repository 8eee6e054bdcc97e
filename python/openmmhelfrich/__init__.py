"""Fluid membranes in OpenMM: Helfrich elasticity, edge flips and Hybrid Monte Carlo.

Everything is imported when it is first asked for: what reads a configuration loads no OpenMM, and scripts start faster.
"""

import os
import sys
from importlib import import_module
from typing import Any

from .installation import explained as _explained, requireInstallation as _requireInstallation

# What scripts use, by the module that has it.
_HOMES = {
    "helfrich": [
        "CustomTrajectoryIntegrator",
        "EdgeFlipIntegrator",
        "HamiltonianTrajectoryIntegrator",
        "HelfrichForce",
        "HybridMonteCarloIntegrator",
        "MonteCarloIntegrator",
        "ShearWaveIntegrator",
        "SpeciesExchangeIntegrator",
    ],
    "geometry.axisymmetric": ["axisymmetricMinimum"],
    "geometry.measures": ["reducedVolume"],
    "geometry.mesh": ["Mesh"],
    "geometry.shapes": ["spheroid", "spheroidAspectRatio", "surfaceOfRevolution"],
    "io.locks": ["InUseError"],
    "io.psf": ["writePSF"],
    "io.vtkhdf": ["MeshFrame", "meshFrame", "readMeshTrajectory", "writeMeshTrajectory"],
    "sampling.adaptation": [
        "AmplitudeAdapter",
        "AmplitudeTracker",
        "StepSizeAdapter",
        "StepSizeTracker",
        "adaptStepSize",
    ],
    "sampling.annealing": ["anneal"],
    "sampling.continuation": ["ContinuationResult", "continueTo"],
    "sampling.minimization": ["MinimizationResult", "minimize", "minimizeFluid"],
    "sampling.observables": ["readObservables"],
    "sampling.replicaexchange": ["ReplicaExchange"],
    "sampling.reporters": ["MeshReporter", "ObservablesReporter"],
    "sampling.schedules": ["ExponentialSchedule", "TableSchedule", "createSchedule"],
    "sampling.states": ["ThermodynamicState"],
    "analysis": [
        "autocorrelationTime",
        "boundaryLength",
        "classifyShape",
        "compositionProfile",
        "compositionSpectrum",
        "contactNumbers",
        "describeShape",
        "describeTrajectory",
        "findDomains",
        "fluctuationSpectrum",
        "heightSpectrum",
        "meanAndError",
        "speciesCurvature",
        "vertexDiffusion",
    ],
    "analysis.freeenergies": ["freeEnergies", "reducedEnergies"],
    "analysis.reweighting": ["reweight"],
    "runs.grids": ["readGrid"],
    "runs.scene": ["Scene"],
    "runs.studies": ["resume", "run"],
    "runs.sweeps": ["sweep"],
    "version": ["__version__"],
}
_MODULES = {name: module for module, names in _HOMES.items() for name in names}
_PACKAGES = ("analysis", "cli", "geometry", "helfrich", "io", "pictures", "runs", "sampling", "tradeoff")
__all__ = [name for name in _MODULES if not name.startswith("__")]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        with _explained():
            globals()[name] = found = getattr(import_module(f".{_MODULES[name]}", __name__), name)
        return found
    if name in _PACKAGES:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module 'openmmhelfrich' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*_MODULES, *_PACKAGES, *(name for name in globals() if name.startswith("__"))})


# The command, which "info --check" is a part of, begins also where much is wrong.
if os.path.basename("".join(sys.argv[:1])) not in ("openmm-helfrich", "-m"):
    _requireInstallation()

# OpenMM loads the plugin when it is imported itself, unless this names another folder: then the extension does.
if "OPENMM_PLUGIN_DIR" in os.environ:
    import_module(".helfrich", __name__)
