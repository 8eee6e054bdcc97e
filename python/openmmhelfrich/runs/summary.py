"""What a run did, in a few lines."""

import math
from dataclasses import dataclass
from typing import Optional

import numpy as np
from openmm import unit

from .config import Config
from .outputs import Outputs
from ..sampling.reporters import Table, readObservables, valueIn


@dataclass
class Summary:
    """What a run did.

    Attributes
    ----------
    config : Config
        the configuration, with every default filled in
    outputs : Outputs
        the files that were written
    steps, newSteps : int
        Monte Carlo steps made in all, and since the run was begun or resumed
    seconds : float
        what the latter took
    table : Table
        the observables
    targets : dict
        "area", "volume", "areaDifference": those at the end, of terms that are on, in powers of the length unit
    acceptance, flipAcceptance : float
        fractions of trajectories and flips that were accepted in the last stage
    diverged : int
        number of trajectories that diverged in the whole run, also while a step size was sought
    notes : list of str
        what the run found out, or has to warn of
    interrupted : bool
        whether it was stopped before its end
    signal : int or None
        the signal that stopped it
    """

    config: Config
    outputs: Outputs
    numVertices: int
    numTriangles: int
    steps: int
    newSteps: int
    seconds: float
    table: Table
    targets: dict
    acceptance: float
    flipAcceptance: float
    diverged: int
    notes: list
    interrupted: bool
    signal: Optional[int]

    def drift(self, name):
        """Return the largest relative deviation of "area", "volume" or "areaDifference" from its target, while :meth:`mean` averages."""
        return float(
            np.max(
                np.abs(lateValues(self.table, name) / lateValues(self.table, f"target{name[0].upper()}{name[1:]}") - 1)
            )
        )

    def mean(self, name):
        """Return the average of a column of the table over the second half of the last stage, or of its last window, when its start is forgotten."""
        return float(lateValues(self.table, name).mean())

    def lines(self):
        """Return a label and a text for each thing worth knowing at the end."""
        u, kappa = self.config.mesh.length_unit, self.config.membrane.bending_modulus
        lines = [
            ("membrane", f"{self.numVertices} vertices, {self.numTriangles} triangles"),
            ("steps", self._stepsLine()),
            ("averages", f"over the second half of the {self._lastPart()}:"),
            ("area", self._mean("area", f"{u}^2")),
            ("volume", self._mean("volume", f"{u}^3")),
            ("reduced volume", f"{self.mean('reducedVolume'):.4f}"),
        ]
        if "areaDifference" in self.targets:
            lines.append(("area difference", self._mean("areaDifference", f"{u}^2")))
        if self.config.stages[-1].kind != "minimize":
            lines.append(("accepted", f"{self.acceptance:.1%} of trajectories, {self.flipAcceptance:.1%} of flips"))
        if self.diverged:
            lines.append(("warning", divergence(self.diverged)))
        lines.append(("energy", f"{self.mean('energy'):.1f} kT"))
        if kappa:
            lines.append(
                (
                    "E_B/8 pi kappa",
                    f"{self.mean('E_bending') / (8 * math.pi * kappa):.3f}, from {self.table['E_bending'][0] / (8 * math.pi * kappa):.3f} at the start; "
                    "thermal undulations add about kT/2 a vertex",
                )
            )
        lines += [("note", note) for note in self.notes]
        return lines + [("files", ", ".join(map(str, self.outputs.paths())))]

    def _lastPart(self):
        if self.config.stages[-1].kind == "continue":
            return "last window"
        return "run" if len(self.config.stages) == 1 else "last stage"

    def _stepsLine(self):
        made = (
            f"{self.steps} in" if self.newSteps == self.steps else f"{self.steps}, of which the last {self.newSteps} in"
        )
        stopped = (
            f", interrupted: openmm-helfrich resume {self.config.output.prefix} goes on" if self.interrupted else ""
        )
        return f"{made} {self.seconds:.1f} s, seed {self.config.sampling.seed}{stopped}"

    def _mean(self, name, unitName):
        text = f"{self.mean(name):.2f} {unitName}"
        return text + f", always within {self.drift(name):.2%} of its target" if name in self.targets else text


def lateValues(table, name):
    """Return the values of a column of a run's table in the second half of the last stage, or of its last window, when its start is forgotten."""
    stage, window = table["stage"], table["window"]
    values = table[name][(stage == stage[-1]) & (window == window[-1])]
    return values[len(values) // 2 :]


def divergence(count):
    """Return a sentence about trajectories that diverged."""
    return f"{'One trajectory' if count == 1 else f'{count} trajectories'} diverged and had to be rejected; a smaller step_size avoids this."


def summarise(study, newSteps, seconds, signal):
    """Return the Summary of a Study."""
    simulation, force = study.simulation, study.force
    context = simulation.context
    named = {
        "area": (force.getAreaModulus(), force.getTargetAreaParameter()),
        "volume": (force.getVolumeModulus(), force.getTargetVolumeParameter()),
        "areaDifference": (force.getAreaDifferenceModulus(), force.getTargetAreaDifferenceParameter()),
    }
    targets = {
        name: context.getParameter(parameter)
        for name, (modulus, parameter) in named.items()
        if valueIn(modulus, unit.kilojoules_per_mole) > 0
    }
    return Summary(
        study.config,
        study.outputs,
        context.getSystem().getNumParticles(),
        force.getNumTriangles(),
        simulation.currentStep,
        newSteps,
        seconds,
        readObservables(study.outputs.table),
        targets,
        *study.stage.acceptance(),
        simulation.integrator.getNumDivergedTrajectories(),
        study.notes,
        not study.isComplete,
        signal,
    )
