"""What a run did, in a few lines."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..analysis.verdict import Verdict
from ..display import htmlTable, lineText
from ..pictures.plots import Picture, observablesPicture
from ..sampling.averages import lateRows
from ..sampling.observables import Made, Observable, madeBetween, observablesIn
from ..tables import Table, unwarned
from .config import Config, after
from .outputs import Outputs
from .stagesettings import StageSettings


@dataclass(repr=False)
class Summary:
    """What a run did.

    Attributes
    ----------
    config : Config
        the configuration, with every default filled in
    outputs : Outputs
        the files that were written
    steps, newSteps : int
        steps made in all, and since the run was begun or resumed: Monte Carlo steps, and one for each minimization
    seconds : float
        what the latter took
    table : Table
        the observables
    stage : int
        the stage, from 0, that it has come to: of a run that was stopped the table may have no row of it yet
    targets : dict
        those at the end of terms that are on, in powers of the length unit, by the names of
        :mod:`openmmhelfrich.sampling.targets`
    shapeClasses : list of str
        the shape of each surface at the end, if there are several: see :func:`classifyShape`
    acceptance, flipAcceptance : float
        fractions of trajectories and flips that were accepted in the last stage; if that is a minimization, in all
        stages that sampled
    descent : Table
        the "iteration" and the "energy" after each, in kT, if the last stage is a minimization: of many, some at equal
        distances
    notes : list of str
        what the run found out, or has to warn of
    stageVerdicts : list of (str, Verdict)
        the title of each stage that is done, and the verdict on it
    verdict : Verdict or None
        whether the results can be trusted, and if not, why; None of a run that was stopped before its end
    interrupted : bool
        whether it was stopped before its end
    signal : int or None
        the signal that stopped it
    words : callable
        what gives a line the words of the user's own configuration, if that is of another program
    """

    config: Config
    outputs: Outputs
    numVertices: int
    numTriangles: int
    steps: int
    newSteps: int
    seconds: float
    table: Table
    stage: int
    targets: dict[str, float]
    shapeClasses: list[str]
    acceptance: float
    flipAcceptance: float
    descent: Table
    notes: list[str]
    stageVerdicts: list[tuple[str, Verdict]]
    verdict: Verdict | None
    interrupted: bool
    signal: int | None
    words: Callable[[str], str] = str

    def __repr__(self) -> str:
        energy, volume = self.mean("energy"), self.table.get("reducedVolume")
        shape = "" if volume is None else f", reduced volume {self.mean('reducedVolume'):.4f}"
        stopped = ", interrupted" if self.interrupted else ""
        return f"<Summary: {self.numVertices} vertices, {self._made(0)}{stopped}, energy {energy:.5g} kT{shape}>"

    def __str__(self) -> str:
        return lineText(self.lines())

    def _repr_html_(self) -> str:
        return htmlTable(self.lines())

    def plot(self) -> Picture:
        """Return a Picture of the observables against steps, which a notebook shows."""
        return observablesPicture(self.table, self.config.mesh.length_unit, descent=self.loneDescent)

    @property
    def loneDescent(self) -> Table | None:
        """The energy by iteration, if the run is a single minimization."""
        return self.descent if len(self.config.stages) == 1 and len(self.descent) else None

    @unwarned
    def drift(self, name: str) -> float:
        """Return the largest relative deviation of "area", "volume" or "areaDifference", or of one of several surfaces'
        ("volume[0]"), from its target, while :meth:`mean` averages.
        """
        target = next(observable.target for observable in observablesIn(self.table) if observable.name == name)
        return float(np.max(np.abs(self._late[name] / self._late[target] - 1)))

    @unwarned
    def mean(self, name: str) -> float:
        """Return the average of a column of the table over the second half of the last stage that it has, or over its
        last window, where these are equilibrated.
        """
        return float(self._late[name].mean())

    def lines(self) -> list[tuple[str, str]]:
        """Return a label and a text for each thing worth knowing at the end."""
        last, kappas = self._lastStage, [self._bendingModulus(stage) for stage in (self._lastIndex, -1)]
        shown = [observable for observable in observablesIn(self.table) if observable.digits]
        lines = [
            ("membrane", f"{self.numVertices} vertices, {self.numTriangles} triangles"),
            ("time", self._timeLine()) if self.loneDescent else ("made", self._madeLine()),
            self._averagesLine(),
        ]
        lines += [
            (o.title, self._average(o)) for o in shown if o.unit != "energy" and (o.onPage or o.name in self.targets)
        ]
        if self.shapeClasses:
            shapes = (f"surface {k} {shape}" for k, shape in enumerate(self.shapeClasses))
            lines.append(("shapes", f"{', '.join(shapes)}, at the end"))
        if last.isMonteCarlo:
            rates = f"{self.acceptance:.1%} of trajectories, {self.flipAcceptance:.1%} of flips"
            lines.append(("accepted", rates + self._whoseRates()))
        if "exchangeAcceptance" in self.table:
            accepted, alike = (self.table[name][-1] for name in ("exchangeAcceptance", "exchangesAlike"))
            lines.append(("exchanges", f"{accepted:.1%} accepted, {alike:.1%} of alike species, since the start"))
        lines += [(o.title, self._average(o)) for o in shown if o.unit == "energy"]
        if all(kappas):
            energies = self.mean("E_bending"), self.table["E_bending"][0]
            ratios = [energy / (8 * math.pi * kappa) for energy, kappa in zip(energies, kappas)]
            undulations = "; thermal undulations add about kT/2 a vertex" if last.isMonteCarlo else ""
            lines.append(("E_B/8 pi kappa", f"{ratios[0]:.3f}, from {ratios[1]:.3f} at the start{undulations}"))
        lines += [("note", note) for note in self.notes]
        lines += self._verdictLines()
        lines.append(("files", ", ".join(map(str, self.outputs.paths()))))
        if self.outputs.topology is None:
            lines.append(("no PSF file", "[output] psf = true writes one for a membrane of any size"))
        return [(label, self.words(text)) for label, text in lines]

    def inWords(self, words: Callable[[str], str]) -> "Summary":
        """Return it in the words of another program's configuration."""
        stages = [(title, verdict.inWords(words)) for title, verdict in self.stageVerdicts]
        verdict, notes = self.verdict and self.verdict.inWords(words), [words(note) for note in self.notes]
        return replace(self, notes=notes, stageVerdicts=stages, verdict=verdict, words=words)

    @property
    def _lastIndex(self) -> int:
        """The stage, from 0, that the last row of the table is of, and averages are over."""
        return min(int(self.table["stage"][-1]), len(self.config.stages)) - 1

    @property
    def _lastStage(self) -> StageSettings:
        return self.config.stages[self._lastIndex]

    def _bendingModulus(self, stage: int) -> float:
        """Return the bending modulus at the end of a stage, or of -1, at the start."""
        return after(self.config, stage).membrane.bending_modulus

    def _verdictLines(self) -> list[tuple[str, str]]:
        lines = []
        if len(self.stageVerdicts) > 1:
            lines.append(("stages", ", ".join(f"{title} {verdict.level}" for title, verdict in self.stageVerdicts)))
        if self.verdict is not None:
            first, *reasons = str(self.verdict).splitlines()
            lines += [("verdict", first), *(("", reason) for reason in reasons)]
        return lines

    @cached_property
    def _late(self) -> Table:
        return lateRows(self.table)

    def _made(self, first: int) -> Made:
        """Return what was made after a step."""
        return madeBetween(first, self.steps, self.table, [stage.kind for stage in self.config.stages])

    def _madeLine(self) -> str:
        first = self.steps - self.newSteps
        return f"{self._made(0)}{f', of which {self._made(first)}' if first else ''} in {self._timeLine()}"

    def _timeLine(self) -> str:
        stopped = (
            f", interrupted: openmm-helfrich resume {self.config.output.prefix} goes on" if self.interrupted else ""
        )
        return f"{self.seconds:.1f} s, seed {self.config.sampling.seed}{stopped}"

    def _averagesLine(self) -> tuple[str, str]:
        """Return what the numbers that follow are: never those of another stage without saying so."""
        if not self._lastStage.isMonteCarlo:
            return "values", f"{self._valuesLine()}:"
        if len(self._late["step"]) == 1:
            step = int(self._late["step"][0])
            return "values", f"at step {step}, the only row of the table to average{self._rowless()}:"
        if self._isOnItsWay:
            whole = self._called(self._lastIndex)
        else:
            whole = "the run" if len(self.config.stages) == 1 else "the last stage"
        return "averages", f"over the {self._lastStage.lastPart(whole)}{self._rowless()}:"

    @property
    def _isOnItsWay(self) -> bool:
        """Whether the run was stopped in a stage before the table had a row of it."""
        return self.stage != self._lastIndex

    def _rowless(self) -> str:
        return f"; the table has no row of {self._called(self.stage)} yet" if self._isOnItsWay else ""

    def _called(self, stage: int) -> str:
        return f"stage {stage + 1} ({self.config.stages[stage].title})"

    def _whoseRates(self) -> str:
        if not self._isOnItsWay:
            return ""
        return f", in {self._called(self.stage)}" if self.config.stages[self.stage].isMonteCarlo else ", in all stages"

    def _valuesLine(self) -> str:
        """Return what the values of a minimization are."""
        if self._isOnItsWay:
            return f"at the end of {self._called(self._lastIndex)}{self._rowless()}"
        if len(self.table["step"]) == 1:
            return "at the start, from which a minimization that was stopped begins anew"
        if not len(self.descent):
            return "at the end"
        count = int(self.descent["iteration"][-1])
        made = f"{count} iteration{'' if count == 1 else 's'}"
        return f"after {made}{', and at the start' if self.loneDescent else ''}"

    def _average(self, observable: Observable) -> str:
        name, unit = observable.name, observable.unitIn(self.config.mesh.length_unit)
        text = f"{self.mean(name):{observable.digits}} {unit}".rstrip()
        if self.loneDescent and len(self.table["step"]) > 1:
            text += f", from {self.table[name][0]:{observable.digits}}"
        always = "always " if len(self._late["step"]) > 1 else ""
        return text + f", {always}within {self.drift(name):.2%} of its target" if name in self.targets else text
