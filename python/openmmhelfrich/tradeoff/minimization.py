"""What the tolerance of a minimization costs and what it is worth."""

import time
from dataclasses import dataclass

from openmm import unit

from ..geometry.mesh import Mesh
from ..runs.config import Config
from ..runs.scene import createScene
from ..sampling.minimization import minimizeFluid
from ..units import valueIn

FACTORS = (100.0, 10.0, 1.0, 0.1)


@dataclass
class Minimum:
    """A minimum found with a tolerance, in kT per unit of length: its energy and the bending energy in kT, and the cost
    in seconds of one processor.
    """

    tolerance: float
    energy: float
    bending: float
    seconds: float
    iterations: int
    reason: str


def minimumOf(config: Config, mesh: Mesh, factor: float, maxIterations: int) -> Minimum:
    """Return the :class:`Minimum` that a membrane comes to with a multiple of the default tolerance.

    That is kappa_B l/(4A), with the mean edge length l.
    """
    config = config.model_copy(update={"sampling": config.sampling.model_copy(update={"step_size": None})})
    scene = createScene(config, mesh)
    tolerance = factor * config.membrane.bending_modulus * float(mesh.edgeLengths.mean()) / (4 * mesh.area)
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    start = time.process_time()
    result = minimizeFluid(simulation, force, tolerance * scene.kT, maxIterations)
    seconds = time.process_time() - start
    energy, bending = (
        valueIn(value, unit.kilojoules_per_mole) / scene.kT for value in (result.energy, result.energies["bending"])
    )
    return Minimum(tolerance, energy, bending, seconds, result.iterations, result.reason)
