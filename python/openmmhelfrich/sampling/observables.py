"""Observables: what a table of a membrane has columns for, and how plots, pages, summaries and sweeps show it.

:data:`OBSERVABLES` is the one list.  An observable that is added to it is a column of every table, and is drawn,
averaged and summed up as its entry says.
"""

import itertools
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from openmm import app, unit

from ..files import PathLike
from ..geometry.measures import reducedAreaDifference, reducedVolume
from ..helfrich import EdgeFlipIntegrator, HelfrichForce, ShearWaveIntegrator, SpeciesExchangeIntegrator
from ..tables import Table, headOf, plainName, readHeads, unitsOf
from ..units import valueIn
from .conditions import CURVATURE, TERMS, currentConditions, positionsOf
from .moves import NO_FLIPS, FlipCounters, findMove, isMixture, numDiverged, trajectoriesOf
from .targets import currentTargets, inWords, nameOf, totalOf

# Every table has columns for these, and one for another term where the force has it: a table that is as old as version
# 0.1.0 and a run of today that goes on with it have the same columns.
TERMS_OF_EVERY_TABLE = ("bending", "area", "volume", "areaDifference", "tether", "repulsion")

MOST_DRAWN = 1e100  # what draws computes with squares


class Place(NamedTuple):
    """Where in a run a moment is: the number of its stage, from 1, the window of a path, whether that is equilibrated,
    and the flips that minimizations before it have tried, which rates leave out.
    """

    stage: int = 1
    window: int = 0
    isEquilibrated: bool = True
    minimizing: FlipCounters = NO_FLIPS


BEGINNING = Place()


class Moment:
    """A membrane now: what observables are computed from, each part when it is first asked for.

    Attributes
    ----------
    step : int
        the number of steps made
    context, integrator
        those of the Simulation
    force : HelfrichForce
        the membrane
    place : Place
        where in a run this is
    """

    def __init__(
        self, simulation: app.Simulation, force: HelfrichForce, energyUnit: float = 1.0, place: Place = BEGINNING
    ):
        """Create a Moment, with the unit of energy in kJ/mol."""
        self.step, self.context, self.integrator = simulation.currentStep, simulation.context, simulation.integrator
        self.force, self.place, self._energyScale = force, place, 1 / energyUnit

    @cached_property
    def energies(self) -> dict[str, float]:
        """The membrane's energy by term, in the unit of energy."""
        terms = self.force.getEnergyTermsInContext(self.context)
        return {name: valueIn(energy, unit.kilojoules_per_mole) * self._energyScale for name, energy in terms.items()}

    @cached_property
    def otherEnergy(self) -> float | None:
        """The energy of the System's forces beside the membrane's, in the unit of energy; None if there are none."""
        if self.context.getSystem().getNumForces() == 1:
            return None
        total = self.context.getState(energy=True).getPotentialEnergy()
        return valueIn(total, unit.kilojoules_per_mole) * self._energyScale - sum(self.energies.values())

    @cached_property
    def geometry(self) -> Any:
        """The HelfrichGeometry."""
        return self.force.getGeometryInContext(self.context)

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """The positions of all particles, in nm: an (N, 3) array."""
        return positionsOf(self.context)

    @cached_property
    def triangles(self) -> NDArray[np.int32]:
        """The live triangles: a (T, 3) array."""
        return self.force.getTrianglesInContext(self.context)

    @cached_property
    def targets(self) -> dict[str, float]:
        """The targets, in powers of nm, by the names of :mod:`.targets`."""
        return currentTargets(self.context, self.force)

    @cached_property
    def numSurfaces(self) -> int:
        """The number of connected surfaces."""
        return self.force.getNumSurfacesInContext(self.context)

    def condition(self, name: str) -> float:
        """Return a condition by its name in :mod:`.conditions`, with the unit of energy."""
        value = currentConditions(self.context, self.force, [name])[name]
        return value if name.startswith(CURVATURE) else value * self._energyScale

    def target(self, total: str, surface: int) -> float:
        """Return a target of a surface, in powers of nm: its own, or the one of all."""
        return self.targets[name if (name := nameOf(total, surface)) in self.targets else total]


@dataclass(frozen=True)
class Panel:
    """A part of plots and pages that shows some observables against steps.

    Attributes
    ----------
    title : str
        what it shows
    range : tuple
        the least and the greatest value, if these are fixed
    isRate : bool
        whether what it shows is a rate since the beginning, which there is not where nothing was tried
    onlyChanges : bool
        whether it is left out where nothing changes
    term : str
        the energy of the term without which it is left out, if there is one
    """

    title: str
    range: tuple[float, float] | None = None
    isRate: bool = False
    onlyChanges: bool = False
    term: str = ""


@dataclass(frozen=True)
class Observable:
    """Something that can be known of a membrane at a moment.

    Attributes
    ----------
    name : str
        what its column is called
    compute : callable
        returns it for a :class:`Moment`, or None if the simulation has no such thing
    ofSurface : callable or None
        returns it for a :class:`Moment` and the number of a surface, if each surface has it
    unit : str
        "energy", "length", "length^2" and what is made of these, which tables call by names of their own, or the name
        of another unit; without one it is a plain number
    title : str
        what texts call it
    label : str
        what its curve is called, if not by the title
    isDefault : bool
        whether every table has it; others are those of whole runs
    isAveraged : bool
        whether averages over the windows of a path mean anything
    target : str
        the observable that it is driven to
    panel : str
        the title of the panel that shows it, if any does
    color : str
        of its curve there; by default one in turn
    isTerm : bool
        whether it is one part of several, which panels leave out where it is always 0
    digits : str
        the format of its average in the summary of a run, which leaves it out without one, and, if it is not on the
        page, unless it is driven to a target
    onPage : str
        "mean" or "last", where the page of a run gives its average, or its last value, a fraction
    onPath : bool
        whether the plot of a path shows it
    inSweep : str
        "mean" or "last", for a column of a sweep's summary with its average or its last value
    condition : str
        the name of a condition, if it is one: a table of a run has those that its stages change
    """

    name: str
    compute: Callable[[Moment], float | None]
    unit: str = ""
    title: str = ""
    label: str = ""
    isDefault: bool = True
    isAveraged: bool = True
    target: str = ""
    panel: str = ""
    color: str | None = None
    isTerm: bool = False
    digits: str = ""
    onPage: str = ""
    onPath: bool = False
    inSweep: str = ""
    condition: str = ""
    ofSurface: Callable[[Moment, int], float | None] | None = None

    def parts(self, numSurfaces: int) -> "list[Observable]":
        """Return itself and, where there are several surfaces and each has it, that of each."""
        if numSurfaces == 1 or self.ofSurface is None:
            return [self]
        return [self, *map(self.part, range(numSurfaces))]

    def part(self, surface: int) -> "Observable":
        """Return that of one of several surfaces."""
        ask = self.ofSurface
        assert ask is not None
        return replace(
            self,
            name=nameOf(self.name, surface),
            compute=lambda moment: ask(moment, surface),
            title=self.title and f"{self.title} of surface {surface}",
            label=f"surface {surface}",
            target=self.target and nameOf(self.target, surface),
            color=None,
            ofSurface=None,
        )

    def unitIn(self, lengthUnit: str, energyUnit: str = "kT") -> str:
        """Return the unit, with these names of the units of length and energy."""
        return self.unit.replace("length", lengthUnit).replace("energy", energyUnit)


def _move(kind: type, ask: Callable[[Any], float], isPart: bool = False) -> Callable[[Moment], float | None]:
    """Return a function that asks the first move of a kind, or only one that is part of a mixture, if there is one."""

    def compute(moment: Moment) -> float | None:
        move = findMove(moment.integrator, kind)
        return None if move is None or (isPart and move is moment.integrator) else ask(move)

    return compute


def _flips(ask: Callable[[Any, FlipCounters], float], isPart: bool = False) -> Callable[[Moment], float | None]:
    """Return a function that asks the first move that flips, and what it made while it sampled."""

    def compute(moment: Moment) -> float | None:
        def ofMove(move: Any) -> float:
            return ask(move, FlipCounters.of(move).without(moment.place.minimizing))

        return _move(EdgeFlipIntegrator, ofMove, isPart)(moment)

    return compute


def _flipRate(flips: Any, made: FlipCounters) -> float:
    """Return the flips of an edge in a sweep, of those that were made."""
    every = FlipCounters.of(flips)
    if made == every:
        return flips.getFlipRate()
    return flips.getFlipRate() * (made.accepted / max(1, every.accepted)) * (every.sweeps / max(1, made.sweeps))


def _mixture(ask: Callable[[Any], float]) -> Callable[[Moment], float | None]:
    """Return a function that asks the integrator, if it is a mixture of moves."""
    return lambda moment: ask(moment.integrator) if isMixture(moment.integrator) else None


def _acceptance(move: Any) -> float:
    return move.getAcceptanceRate()


def _total(moment: Moment) -> float:
    return sum(moment.energies.values())


def _area(geometry: Any) -> float:
    return valueIn(geometry.area, unit.nanometer**2)


def _volume(geometry: Any) -> float:
    return valueIn(geometry.volume, unit.nanometer**3)


def _areaDifference(geometry: Any) -> float:
    return valueIn(geometry.areaDifference, unit.nanometer**2)


def _meanCurvature(geometry: Any) -> float:
    return valueIn(geometry.integratedMeanCurvature, unit.nanometer)


def _reducedVolume(geometry: Any) -> float:
    return reducedVolume(_area(geometry), _volume(geometry))


def _reducedAreaDifference(geometry: Any) -> float:
    return reducedAreaDifference(_area(geometry), _meanCurvature(geometry))


def _sum(name: str, measure: Callable[[Any], float], unit: str = "", title: str = "", **keywords: Any) -> Observable:
    """Return an observable of the geometry that adds up over surfaces."""
    return Observable(
        name,
        lambda moment: measure(moment.geometry),
        unit,
        title,
        ofSurface=lambda moment, surface: measure(moment.geometry.surfaces[surface]),
        **keywords,
    )


def _ofClosed(observable: Observable) -> Observable:
    """Return an observable that a periodic membrane, which encloses no volume, has not."""
    compute, ofSurface = observable.compute, observable.ofSurface
    assert ofSurface is not None
    return replace(
        observable,
        compute=lambda moment: None if moment.force.usesPeriodicBoundaryConditions() else compute(moment),
        ofSurface=lambda moment, k: None if moment.force.usesPeriodicBoundaryConditions() else ofSurface(moment, k),
    )


def _single(
    name: str, ask: Callable[[Moment, int], float], unit: str = "", title: str = "", **keywords: Any
) -> Observable:
    """Return an observable that only a single surface has."""
    return Observable(
        name,
        lambda moment: ask(moment, 0) if moment.numSurfaces == 1 else None,
        unit,
        title,
        ofSurface=ask,
        **keywords,
    )


def _measure(measure: Callable[[Any], float]) -> Callable[[Moment, int], float]:
    return lambda moment, surface: measure(moment.geometry.surfaces[surface])


def _target(total: str) -> Callable[[Moment, int], float]:
    return lambda moment, surface: moment.target(total, surface)


def _term(name: str) -> Observable:
    return Observable(
        f"E_{name}",
        lambda m: m.energies[name] if name in TERMS_OF_EVERY_TABLE or m.force.hasTerm(name) else None,
        "energy",
        f"{inWords(name)} energy",
        inWords(name),
        panel="energy",
        isTerm=True,
        onPath=name == "bending",
        inSweep="mean",
    )


def _condition(name: str, unit: str) -> Observable:
    first, *others = name.split("_")
    title = " ".join((first, *others))
    return Observable(
        first + "".join(map(str.capitalize, others)),
        lambda moment: moment.condition(name),
        unit,
        title,
        isDefault=False,
        panel=title,
        condition=name,
    )


# What stages may change, with its unit.
_CONDITIONS = {
    "bending_modulus": "energy",
    "gaussian_modulus": "energy",
    CURVATURE: "1/length",
    "line_tension": "energy/length",
    "pair_energy": "energy",
    "area_modulus": "energy",
    "volume_modulus": "energy",
    "area_difference_modulus": "energy",
    "tension": "energy/length^2",
    "pressure": "energy/length^3",
}
OBSERVABLES = (
    Observable("step", lambda m: m.step, isAveraged=False),
    Observable(
        "energy",
        _total,
        "energy",
        "energy",
        "total",
        panel="energy",
        color="black",
        digits=".1f",
        onPage="mean",
        inSweep="mean",
    ),
    *map(_term, HelfrichForce.getTermNames()),
    Observable(
        "E_other",
        lambda m: m.otherEnergy,
        "energy",
        "energy of other forces",
        "other forces",
        isDefault=False,
        panel="energy",
        digits=".1f",
        onPage="mean",
        inSweep="mean",
    ),
    _sum(
        "area",
        _area,
        "length^2",
        "area",
        target="targetArea",
        panel="area",
        color="C0",
        digits=".6g",
        onPage="mean",
        inSweep="mean",
    ),
    _ofClosed(
        _sum(
            "volume",
            _volume,
            "length^3",
            "volume",
            target="targetVolume",
            panel="volume",
            color="C1",
            digits=".6g",
            onPage="mean",
            inSweep="mean",
        )
    ),
    _ofClosed(
        _single(
            "reducedVolume",
            _measure(_reducedVolume),
            title="reduced volume",
            panel="reduced volume",
            color="C2",
            digits=".4f",
            onPage="mean",
            onPath=True,
            inSweep="mean",
        )
    ),
    _sum(
        "areaDifference",
        _areaDifference,
        "length^2",
        "area difference",
        target="targetAreaDifference",
        panel="area difference",
        color="C4",
        digits=".6g",
        onPath=True,
    ),
    _sum("meanCurvature", _meanCurvature, "length"),
    _ofClosed(
        _single(
            "reducedAreaDifference",
            _measure(_reducedAreaDifference),
            title="reduced area difference",
            isDefault=False,
            digits=".4f",
            onPage="mean",
        )
    ),
    Observable(
        "acceptance",
        _mixture(lambda mixture: trajectoriesOf(mixture).getAcceptanceRate()),
        title="trajectories accepted",
        label="trajectories",
        isAveraged=False,
        panel="accepted so far",
        onPage="last",
        inSweep="last",
    ),
    Observable(
        "flipAcceptance",
        _flips(lambda _, made: made.accepted / max(1, made.attempted), isPart=True),
        title="flips accepted",
        label="flips",
        isAveraged=False,
        panel="accepted so far",
        onPage="last",
        inSweep="last",
    ),
    Observable(
        "exchangeAcceptance",
        _move(SpeciesExchangeIntegrator, _acceptance, isPart=True),
        title="exchanges accepted",
        label="exchanges",
        isAveraged=False,
        panel="accepted so far",
        onPage="last",
        inSweep="last",
    ),
    Observable("waveAcceptance", _move(ShearWaveIntegrator, _acceptance, isPart=True)),
    Observable(
        "waveAmplitude",
        _move(ShearWaveIntegrator, lambda waves: valueIn(waves.getAmplitude(), unit.nanometer), isPart=True),
        "length",
    ),
    Observable("flipRate", _flips(_flipRate), isAveraged=False),
    Observable("flipsForbidden", _flips(lambda _, made: made.forbidden / max(1, made.attempted)), isAveraged=False),
    Observable(
        "exchangesAlike",
        _move(SpeciesExchangeIntegrator, lambda move: move.getNumAlike() / max(1, move.getNumAttempted())),
        isAveraged=False,
    ),
    Observable("diverged", _mixture(numDiverged), inSweep="last"),
    Observable(
        "temperature",
        lambda m: valueIn(m.integrator.getTemperature(), unit.kelvin),
        "K",
        "temperature",
        isDefault=False,
        panel="temperature",
        color="C3",
    ),
    Observable(
        "stepSize",
        lambda m: valueIn(trajectoriesOf(m.integrator).getStepSize(), unit.picosecond),
        "ps",
        isDefault=False,
    ),
    Observable("stage", lambda m: m.place.stage, isDefault=False, isAveraged=False),
    Observable("window", lambda m: m.place.window, isDefault=False, isAveraged=False),
    Observable("equilibrated", lambda m: int(m.place.isEquilibrated), isDefault=False, isAveraged=False),
    _single("targetArea", _target("area"), "length^2", "area target", isDefault=False, panel="area"),
    _ofClosed(_single("targetVolume", _target("volume"), "length^3", "volume target", isDefault=False, panel="volume")),
    _single(
        "targetAreaDifference",
        _target("areaDifference"),
        "length^2",
        "area difference target",
        isDefault=False,
        panel="area difference",
    ),
    *(_condition(name, unit) for name, unit in _CONDITIONS.items()),
)
PANELS = (
    Panel("energy"),
    Panel("area"),
    Panel("volume"),
    Panel("reduced volume"),
    Panel("area difference", term="E_areaDifference"),
    Panel("accepted so far", range=(0, 1), isRate=True),
    Panel("temperature", onlyChanges=True),
    *(Panel(o.panel, onlyChanges=True) for o in OBSERVABLES if o.condition),
)
DEFAULT_OBSERVABLES = tuple(observable for observable in OBSERVABLES if observable.isDefault)


def observablesOf(conditions: Collection[str]) -> tuple[Observable, ...]:
    """Return the observables of a run whose stages change some conditions: no other conditions, and the energies of
    their terms also where these are off.
    """
    parts = [name.partition("[") for name in conditions]
    terms = [TERMS[key] for key, *_ in parts if key in TERMS]
    own = {f"E_{term}": _energyOf(term) for term in terms}
    plain = [replace(o, compute=own[o.name]) if o.name in own else o for o in OBSERVABLES if not o.condition]
    changing = (_conditionOf(o, rest) for o in OBSERVABLES for key, _, rest in parts if key == o.condition)
    return (*plain, *changing)


def keepingTerms(observables: Iterable[Observable], heads: Iterable[str]) -> tuple[Observable, ...]:
    """Return observables, of which the energies of terms that a table has columns of are there also where the terms are
    off.
    """
    names = set(map(plainName, heads))
    return tuple(
        replace(o, compute=_energyOf(o.name.removeprefix("E_"))) if o.isTerm and o.name in names else o
        for o in observables
    )


def _conditionOf(condition: Observable, numbers: str) -> Observable:
    """Return a condition of species with some numbers, which end with a bracket, or itself if there are none."""
    if not numbers:
        return condition
    name, own = f"{condition.condition}[{numbers}", f"{condition.name}[{numbers}"
    label = f"species {numbers.removesuffix(']')}"
    title = f"{condition.title} of {label}"
    return replace(condition, name=own, compute=lambda m: m.condition(name), title=title, label=label, condition=name)


def _energyOf(term: str) -> Callable[[Moment], float]:
    return lambda moment: moment.energies[term]


def observe(moment: Moment, observables: Iterable[Observable], lengthUnit: str, energyUnit: str) -> dict[str, float]:
    """Return observables of a :class:`Moment`, as far as there are such, by the heads of their columns."""
    parts = itertools.chain.from_iterable(o.parts(moment.numSurfaces) for o in observables)
    row = {headOf(o.name, o.unitIn(lengthUnit, energyUnit)): o.compute(moment) for o in parts}
    return {head: value for head, value in row.items() if value is not None}


def observablesIn(table: Table) -> list[Observable]:
    """Return the observables that a table has, those of each surface in the place of their sum."""
    found: list[Observable] = []
    for observable in OBSERVABLES:
        if observable.condition:
            names = [name.removeprefix(observable.name) for name in table if name.startswith(observable.name)]
            found += [_conditionOf(observable, own.removeprefix("[")) for own in names if own[:1] in ("", "[")]
            continue
        numSurfaces = next(k for k in itertools.count() if nameOf(observable.name, k) not in table)
        if numSurfaces > 0:
            found += map(observable.part, range(numSurfaces))
        elif observable.name in table:
            found.append(observable)
    return found


def curves(panel: Panel, table: Table) -> list[Observable]:
    """Return the observables of a panel that a table has; none if the panel is to be left out."""
    isEmpty = panel.term and not np.any(table.get(panel.term, np.zeros(1)))
    if isEmpty or (panel.isRate and onlyMinimizes(table)):
        return []
    found = [
        o for o in observablesIn(table) if o.panel == panel.title and not (o.isTerm and np.all(table[o.name] == 0))
    ]
    if panel.isRate:
        found = [o for o in found if not _isIdle(o, table)]
    isStill = panel.onlyChanges and all(np.all(table[o.name] == table[o.name][0]) for o in found)
    return [] if isStill or all(map(isTarget, found)) else found


def shownValues(panel: Panel, observable: Observable, table: Table) -> NDArray[np.float64]:
    """Return the values of a curve of a panel: NaN for a rate until something has been accepted, unless nothing is, and
    for what is too large to be drawn.
    """
    values = table[observable.name]
    values = np.where(np.abs(values) < MOST_DRAWN, values, np.nan)
    if not panel.isRate or not np.any(values > 0):
        return values
    return np.where(np.cumsum(values > 0) > 0, values, np.nan)


def _isIdle(rate: Observable, table: Table) -> bool:
    """Return whether nothing has been tried of which this is the rate: no flip was accepted or forbidden, or stages
    only minimized, each of which counts as a step.
    """
    if np.any(table[rate.name] != 0):
        return False
    if rate.name == "flipAcceptance" and "flipsForbidden" in table:
        return not np.any(table["flipsForbidden"])
    return onlyMinimizes(table)


def onlyMinimizes(table: Table) -> bool:
    """Return whether all stages of a table are minimizations, each of which counts as a step."""
    return "stage" in table and bool(table["step"][-1] <= table["stage"][-1])


class Made(NamedTuple):
    """What a run has made: Monte Carlo steps, and minimizations, each of which counts as a step of the table."""

    steps: int
    minimizations: int

    def __str__(self) -> str:
        counts = ((self.steps, "step"), (self.minimizations, "minimization"))
        told = [f"{count} {word}{'' if count == 1 else 's'}" for count, word in counts if count]
        return " and ".join(told) or "0 steps"


def madeBetween(first: int, last: int, table: Table, kinds: Sequence[str]) -> Made:
    """Return what was made after a step and up to another one, given the table, which has a row at the end of each
    minimization, and the kinds of its stages.
    """
    stages = {int(stage) for stage in table["stage"][table["step"] > first]} if "stage" in table else set()
    minimizations = sum(kind == "minimize" for number, kind in enumerate(kinds, 1) if number in stages)
    return Made(last - first - minimizations, minimizations)


def isTarget(observable: Observable) -> bool:
    """Return whether another observable is driven to this one."""
    return any(other.target == totalOf(observable.name) for other in OBSERVABLES)


def readObservables(file: PathLike) -> Table:
    """Read a table that an ObservablesReporter wrote: a dict from column names, without their units, to arrays.

    ::

        mh.run("vesicle.toml")
        table = mh.readObservables("vesicle.csv")
        print(table["area"].mean(), table["energy"].mean())

    Parameters
    ----------
    file : path
        the table: comma-separated values

    Returns
    -------
    Table
        a dict from names of columns to arrays of shape (rows,); energies are in the unit that the file names

    Raises
    ------
    FileNotFoundError, ValueError
        if there is no such file, or it is not such a table
    """
    return Table.read(file)


def observableUnits(file: PathLike) -> dict[str, str]:
    """Return the units of the columns of a table that an ObservablesReporter wrote, by the columns' names."""
    heads = readHeads(file)
    units = unitsOf(heads)
    if not {"energy", "area"} <= set(units) or "step" not in heads:
        raise ValueError(
            f"{file} is not a table of observables; it has no columns 'step', 'energy (...)' and 'area (...)'"
        )
    return units
