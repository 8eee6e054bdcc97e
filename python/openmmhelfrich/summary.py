"""What a run did, in a few lines."""
import math
from dataclasses import dataclass, field

import numpy as np
from openmm import unit

from .config import Config
from .outputs import Outputs
from .reporters import readObservables, valueIn


@dataclass
class Summary:
    """What a run did."""
    config: Config
    outputs: Outputs
    numVertices: int
    numTriangles: int
    steps: int
    seconds: float
    table: dict
    targets: dict
    acceptance: float
    flipAcceptance: float
    diverged: int
    interrupted: bool = field(default=False)

    def drift(self, name):
        """Return the largest relative deviation of "area", "volume" or "areaDifference" from its target during the run."""
        return float(np.max(np.abs(self.table[name]/self.targets[name]-1)))

    def mean(self, name):
        """Return the average of a column of the table over the second half of the run, when the start is forgotten."""
        return float(self.table[name][len(self.table[name])//2:].mean())

    def lines(self):
        """Return a label and a text for each thing worth knowing at the end."""
        u, kappa = self.config.mesh.length_unit, self.config.membrane.bending_modulus
        lines = [("membrane", f"{self.numVertices} vertices, {self.numTriangles} triangles"),
                 ("steps", f"{self.steps} in {self.seconds:.1f} s, seed {self.config.sampling.seed}{', interrupted' if self.interrupted else ''}"),
                 ("averages", "over the second half of the run:"),
                 ("area", self._mean("area", f"{u}^2")),
                 ("volume", self._mean("volume", f"{u}^3")),
                 ("reduced volume", f"{self.mean('reducedVolume'):.4f}")]
        if "areaDifference" in self.targets:
            lines.append(("area difference", self._mean("areaDifference", f"{u}^2")))
        lines += [("accepted", f"{self.acceptance:.1%} of trajectories, {self.flipAcceptance:.1%} of flips"),
                  ("energy", f"{self.mean('energy'):.1f} kT"),
                  ("files", ", ".join(map(str, self.outputs.paths())))]
        if kappa:
            lines.insert(-1, ("E_B/8 pi kappa", f"{self.mean('E_bending')/(8*math.pi*kappa):.3f}, from {self.table['E_bending'][0]/(8*math.pi*kappa):.3f} at the start; "
                              "thermal undulations add about kT/2 a vertex"))
        if self.diverged:
            lines.append(("warning", f"{self.diverged} trajectories diverged and were rejected; a smaller step_size avoids this"))
        return lines

    def _mean(self, name, unitName):
        text = f"{self.mean(name):.2f} {unitName}"
        return text+f", always within {self.drift(name):.2%} of its target" if name in self.targets else text


def summarise(config, outputs, simulation, force, seconds, interrupted):
    table, context, integrator = readObservables(outputs.table), simulation.context, simulation.integrator
    named = {"area": (force.getAreaModulus(), force.getTargetAreaParameter()),
             "volume": (force.getVolumeModulus(), force.getTargetVolumeParameter()),
             "areaDifference": (force.getAreaDifferenceModulus(), force.getTargetAreaDifferenceParameter())}
    targetValues = {name: context.getParameter(parameter) for name, (modulus, parameter) in named.items()
                    if valueIn(modulus, unit.kilojoules_per_mole) > 0}
    return Summary(config, outputs, context.getSystem().getNumParticles(), force.getNumTriangles(), simulation.currentStep, seconds, table, targetValues,
                   integrator.getAcceptanceRate(), integrator.getFlipAcceptanceRate(), integrator.getNumDivergedTrajectories(), interrupted)
