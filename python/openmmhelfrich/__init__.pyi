"""Written by wrappers/stubs.py."""

from . import (
    analysis as analysis,
    cli as cli,
    geometry as geometry,
    helfrich as helfrich,
    io as io,
    pictures as pictures,
    runs as runs,
    sampling as sampling,
    tradeoff as tradeoff,
)
from .analysis import (
    autocorrelationTime as autocorrelationTime,
    boundaryLength as boundaryLength,
    classifyShape as classifyShape,
    compositionProfile as compositionProfile,
    compositionSpectrum as compositionSpectrum,
    contactNumbers as contactNumbers,
    describeShape as describeShape,
    describeTrajectory as describeTrajectory,
    findDomains as findDomains,
    fluctuationSpectrum as fluctuationSpectrum,
    heightSpectrum as heightSpectrum,
    meanAndError as meanAndError,
    speciesCurvature as speciesCurvature,
    vertexDiffusion as vertexDiffusion,
)
from .analysis.freeenergies import freeEnergies as freeEnergies, reducedEnergies as reducedEnergies
from .analysis.reweighting import reweight as reweight
from .geometry.axisymmetric import axisymmetricMinimum as axisymmetricMinimum
from .geometry.measures import reducedVolume as reducedVolume
from .geometry.mesh import Mesh as Mesh
from .geometry.shapes import (
    spheroid as spheroid,
    spheroidAspectRatio as spheroidAspectRatio,
    surfaceOfRevolution as surfaceOfRevolution,
)
from .helfrich import (
    CustomTrajectoryIntegrator as CustomTrajectoryIntegrator,
    EdgeFlipIntegrator as EdgeFlipIntegrator,
    HamiltonianTrajectoryIntegrator as HamiltonianTrajectoryIntegrator,
    HelfrichForce as HelfrichForce,
    HybridMonteCarloIntegrator as HybridMonteCarloIntegrator,
    MonteCarloIntegrator as MonteCarloIntegrator,
    ShearWaveIntegrator as ShearWaveIntegrator,
    SpeciesExchangeIntegrator as SpeciesExchangeIntegrator,
)
from .io.locks import InUseError as InUseError
from .io.psf import writePSF as writePSF
from .io.vtkhdf import (
    MeshFrame as MeshFrame,
    meshFrame as meshFrame,
    readMeshTrajectory as readMeshTrajectory,
    writeMeshTrajectory as writeMeshTrajectory,
)
from .runs.grids import readGrid as readGrid
from .runs.scene import Scene as Scene
from .runs.studies import resume as resume, run as run
from .runs.sweeps import sweep as sweep
from .sampling.adaptation import (
    AmplitudeAdapter as AmplitudeAdapter,
    AmplitudeTracker as AmplitudeTracker,
    StepSizeAdapter as StepSizeAdapter,
    StepSizeTracker as StepSizeTracker,
    adaptStepSize as adaptStepSize,
)
from .sampling.annealing import anneal as anneal
from .sampling.continuation import ContinuationResult as ContinuationResult, continueTo as continueTo
from .sampling.minimization import (
    MinimizationResult as MinimizationResult,
    minimize as minimize,
    minimizeFluid as minimizeFluid,
)
from .sampling.observables import readObservables as readObservables
from .sampling.replicaexchange import ReplicaExchange as ReplicaExchange
from .sampling.reporters import MeshReporter as MeshReporter, ObservablesReporter as ObservablesReporter
from .sampling.schedules import (
    ExponentialSchedule as ExponentialSchedule,
    TableSchedule as TableSchedule,
    createSchedule as createSchedule,
)
from .sampling.states import ThermodynamicState as ThermodynamicState
from .version import __version__ as __version__

__all__ = [
    "AmplitudeAdapter",
    "AmplitudeTracker",
    "ContinuationResult",
    "CustomTrajectoryIntegrator",
    "EdgeFlipIntegrator",
    "ExponentialSchedule",
    "HamiltonianTrajectoryIntegrator",
    "HelfrichForce",
    "HybridMonteCarloIntegrator",
    "InUseError",
    "Mesh",
    "MeshFrame",
    "MeshReporter",
    "MinimizationResult",
    "MonteCarloIntegrator",
    "ObservablesReporter",
    "ReplicaExchange",
    "Scene",
    "ShearWaveIntegrator",
    "SpeciesExchangeIntegrator",
    "StepSizeAdapter",
    "StepSizeTracker",
    "TableSchedule",
    "ThermodynamicState",
    "adaptStepSize",
    "anneal",
    "autocorrelationTime",
    "axisymmetricMinimum",
    "boundaryLength",
    "classifyShape",
    "compositionProfile",
    "compositionSpectrum",
    "contactNumbers",
    "continueTo",
    "createSchedule",
    "describeShape",
    "describeTrajectory",
    "findDomains",
    "fluctuationSpectrum",
    "freeEnergies",
    "heightSpectrum",
    "meanAndError",
    "meshFrame",
    "minimize",
    "minimizeFluid",
    "readGrid",
    "readMeshTrajectory",
    "readObservables",
    "reducedEnergies",
    "reducedVolume",
    "resume",
    "reweight",
    "run",
    "speciesCurvature",
    "spheroid",
    "spheroidAspectRatio",
    "surfaceOfRevolution",
    "sweep",
    "vertexDiffusion",
    "writeMeshTrajectory",
    "writePSF",
]
