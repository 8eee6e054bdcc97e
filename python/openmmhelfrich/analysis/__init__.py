"""What shapes and trajectories of membranes say: size and form, fluctuations, correlation in time, diffusion.

Trajectories are arrays of positions of shape (frames, N, 3), in nm, wherever they come from:
``mdtraj.load_dcd(...).xyz`` is one.  Functions that need triangles take one set for all frames or one for each; a DCD
file has none, so that those of a fluid membrane come from a MeshReporter's file.
"""

from .correlation import autocorrelationTime, meanAndError
from .description import (
    ShapeDescription,
    classifyShape,
    describeShape,
    describeTrajectory,
    gyrationTensor,
    reducedAreaDifference,
    toDataFrame,
)
from .diffusion import Diffusion, vertexDiffusion
from .domains import (
    Domains,
    boundaryLength,
    compositionProfile,
    compositionSpectrum,
    contactNumbers,
    findDomains,
    speciesCurvature,
)
from .fluctuations import (
    FluctuationSpectrum,
    SpectrumFit,
    fluctuationSpectrum,
    meshStiffness,
    sphericalHarmonicCoefficients,
)
from .heights import HeightFit, HeightSpectrum, heightSpectrum

__all__ = [
    "Diffusion",
    "Domains",
    "FluctuationSpectrum",
    "HeightFit",
    "HeightSpectrum",
    "ShapeDescription",
    "SpectrumFit",
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
    "gyrationTensor",
    "heightSpectrum",
    "meanAndError",
    "meshStiffness",
    "reducedAreaDifference",
    "speciesCurvature",
    "sphericalHarmonicCoefficients",
    "toDataFrame",
    "vertexDiffusion",
]
