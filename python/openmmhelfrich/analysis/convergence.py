"""Minimum shapes of triangles beside those of axisymmetric vesicles: how far a mesh is from the continuum."""

import math
import time
from dataclasses import dataclass
from typing import Any

import openmm as mm
from openmm import app

from ..display import Brief
from ..geometry.axisymmetric import AxisymmetricShape, axisymmetricMinimum
from ..geometry.measures import reducedAreaDifference, volumeOfReduced
from ..geometry.mesh import Mesh
from ..geometry.shapes import surfaceOfRevolution
from ..helfrich import HelfrichForce, HybridMonteCarloIntegrator
from ..sampling.minimization import MinimizationResult, defaultTolerance, minimizeFluid
from ..units import valueIn

# The points of each branch whose minima are well known.
REDUCED_VOLUMES = {
    "prolate": (0.9, 0.8, 0.7, 0.65, 0.6, 0.55, 0.5),
    "oblate": (0.9, 0.8, 0.7, 0.65, 0.6, 0.55, 0.5),
    "stomatocyte": (0.6, 0.55, 0.5),
}
_MODULUS = 50.0  # bending modulus, in kJ/mol: 20 kT at 300 K
_STIFFNESS = 1e6  # moduli of area and volume over the bending modulus
_TETHER = (100, 0.88, 1.17)  # its modulus over the bending modulus, and its bounds over the mean length of the edges
# Of the edges along the axis over those around it: what is curved in a tube is the way around.
_ELONGATION = {"prolate": 1.3}


@dataclass(frozen=True, eq=False, repr=False)
class DiscreteMinimum(Brief):
    """A minimum shape of triangles, and the axisymmetric one that it stands for.

    Attributes
    ----------
    branch, reducedVolume, numVertices
        what was asked for
    energy, areaDifference : float
        the bending energy over 8 pi kappa_B and the reduced area difference of the triangles
    continuum : AxisymmetricShape
        the axisymmetric minimum
    inscribedVolume : float
        the reduced volume of the mesh at the start, whose vertices are on the axisymmetric shape: it has to swell to
        its target by the rest
    mesh : Mesh
        the triangles at the end
    result : MinimizationResult
        what the minimization came to
    seconds : float
        how long it took, mesh included
    """

    branch: str
    reducedVolume: float
    numVertices: int
    energy: float
    areaDifference: float
    continuum: AxisymmetricShape
    inscribedVolume: float
    mesh: Mesh
    result: MinimizationResult
    seconds: float

    @property
    def energyError(self) -> float:
        """The relative error of the energy; negative if the triangles have less."""
        return self.energy / self.continuum.energy - 1

    @property
    def areaDifferenceError(self) -> float:
        """The error of the reduced area difference."""
        return self.areaDifference - self.continuum.areaDifference

    def row(self) -> dict[str, Any]:
        """Return numbers and words for a table, as a dict."""
        tether = valueIn(self.result.energies["tether"], mm.unit.kilojoules_per_mole) / (8 * math.pi * _MODULUS)
        return {
            "branch": self.branch,
            "reducedVolume": self.reducedVolume,
            "numVertices": self.numVertices,
            "energy": self.energy,
            "axisymmetricEnergy": self.continuum.energy,
            "energyError": self.energyError,
            "areaDifference": self.areaDifference,
            "axisymmetricAreaDifference": self.continuum.areaDifference,
            "inscribedVolume": self.inscribedVolume,
            "tether": tether,
            "iterations": self.result.iterations,
            "flips": self.result.flips,
            "seconds": self.seconds,
            "end": self.result.reason,
        }


def discreteMinimum(branch: str, reducedVolume: float, numVertices: int, tolerance: float = 1.0) -> DiscreteMinimum:
    """Minimize the bending energy of a fluid mesh at a reduced volume, from the axisymmetric minimum.

    The mesh is an even one with its vertices on the axisymmetric shape; on prolates it is 1.3 times as long along the
    axis.  Moduli of 1e6 kappa_B keep its area and its reduced volume, a tether of 100 kappa_B (where a length of 1 is
    the radius of a sphere of this area) its edges within 0.88 to 1.17 times their mean.

    Parameters
    ----------
    branch : str
        "prolate", "oblate" or "stomatocyte"
    reducedVolume : float
        as for :func:`axisymmetricMinimum`
    numVertices : int
        the number of vertices, at least 12
    tolerance : float
        factor on the tolerance of the forces that :func:`minimizeFluid` has by default

    Raises
    ------
    ValueError
        if an argument is out of range
    """
    start, continuum = time.perf_counter(), axisymmetricMinimum(branch, reducedVolume)
    stretch = _ELONGATION.get(branch, 1)
    mesh = surfaceOfRevolution(continuum.outline / [1, stretch], numVertices)
    mesh.vertices = mesh.vertices * [1, 1, stretch]
    inscribedVolume = mesh.reducedVolume
    mesh.vertices *= math.sqrt(4 * math.pi / mesh.area)
    simulation, force = _simulation(mesh, reducedVolume)
    result = minimizeFluid(simulation, force, tolerance * defaultTolerance(simulation, force))
    context = simulation.context
    final = Mesh(context.getState(positions=True).getPositions(asNumpy=True), force.getTrianglesInContext(context))
    energy = valueIn(result.energies["bending"], mm.unit.kilojoules_per_mole) / (8 * math.pi * _MODULUS)
    areaDifference = reducedAreaDifference(final.area, final.vertexMeanCurvatures.sum())
    return DiscreteMinimum(
        branch,
        reducedVolume,
        numVertices,
        energy,
        areaDifference,
        continuum,
        inscribedVolume,
        final,
        result,
        time.perf_counter() - start,
    )


def orderOfConvergence(coarse: DiscreteMinimum, fine: DiscreteMinimum) -> float:
    """Return the p with which the error of the energy falls as (1/N)^p between two numbers of vertices; NaN if it
    changes its sign.
    """
    ratio = coarse.energyError / fine.energyError
    return math.log(ratio) / math.log(fine.numVertices / coarse.numVertices) if ratio > 0 else math.nan


def extrapolatedEnergy(coarse: DiscreteMinimum, fine: DiscreteMinimum) -> float:
    """Return the bending energy over 8 pi kappa_B that two numbers of vertices tell of infinitely many, if the error is
    of first order in 1/N (Richardson).
    """
    return (fine.numVertices * fine.energy - coarse.numVertices * coarse.energy) / (
        fine.numVertices - coarse.numVertices
    )


def _simulation(mesh: Mesh, reducedVolume: float) -> tuple[app.Simulation, HelfrichForce]:
    edge = mesh.edgeLengths.mean()
    force = HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(_MODULUS)
    force.setAreaModulus(_STIFFNESS * _MODULUS)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(_STIFFNESS * _MODULUS)
    force.setTargetVolume(volumeOfReduced(reducedVolume, mesh.area))
    force.setTether(_TETHER[0] * _MODULUS, _TETHER[1] * edge, _TETHER[2] * edge, 2)
    system = mesh.createSystem()
    system.addForce(force)
    integrator = HybridMonteCarloIntegrator(300, 1e-4)
    integrator.setRandomNumberSeed(1)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    return simulation, force
