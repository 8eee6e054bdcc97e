"""The verdict on what a simulation came to: whether it can be trusted, and if not, why, and what to do.

:data:`CHECKS` is the one list of what is looked at, with the limits.  A check whose evidence is missing says nothing.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from ..display import htmlTable
from ..geometry.connectivity import genus
from ..geometry.mesh import Mesh
from ..geometry.quality import crossings, dihedralAngles
from ..sampling.averages import lateRows, sampledWindows
from ..sampling.moves import Counters, makesFlips, makesTrajectories
from ..sampling.observables import Observable, observablesIn
from ..sampling.targets import MODULUS_NAMES, totalOf
from ..tables import Table, unwarned
from .description import gyrationTensor

GOOD, DOUBTFUL, FAILED = LEVELS = ("good", "doubtful", "failed")

# The part of the run's temperature below which flips may freeze.
COLD = 0.5
# Of rows: fewer cannot tell a drift from a fluctuation.
LEAST_ROWS = 8
# Fewer trajectories, flips or exchanges than these have no rate of acceptance, but a least one.
LEAST_TRIED = {"trajectories": 10, "flips": 1000, "exchanges": 100}
# The probability that the true rate is below the least one.
_RISK = 0.05
# The part of the rule of thumb below which a step is not too long for trajectories to be accepted.
SHORT_STEP = 0.1
# By so much a constraint may miss its target unnoticed, and by so much at most where its modulus is soft.
CLOSE, FAR = 0.005, 0.05
# The part of the mean area below which a triangle has none.
FLAT = 1e-3
# By so much the reduced volume of a shape as long as wide and high is less than an icosphere's if it is dented.
DENTED = 0.02
# The angle between the normals of neighbors, in degrees, beyond which the surface is folded.
FOLDED = 90.0
# The least bending energy over 8 pi kappa of closed surfaces without a hole, by reduced volume: the sphere, prolates,
# oblates and stomatocytes (Seifert, Berndl and Lipowsky, Phys. Rev. A 44, 1182, 1991).
_LEAST_ENERGY = {0: 2, 0.5: 1.988, 0.59: 1.978, 0.6: 1.956, 0.65: 1.826, 0.7: 1.643, 0.8: 1.387, 0.9: 1.19, 1: 1}
# Of a surface with holes: 4 pi^2 kappa (Marques and Neves, Ann. Math. 179, 683, 2014).
_LEAST_OF_TORI = math.pi / 2
# kT for each vertex: undulations hold about 1/2.
_GREATEST_UNDULATION = 0.6


@dataclass(frozen=True)
class Finding:
    """Something that is wrong.

    Attributes
    ----------
    level : str
        "doubtful" or "failed"
    check : str
        the title of the check that found it
    what : str
        what was found, as a sentence without its period
    value, limit : float
        what was measured, and the limit that it is beyond
    advice : str
        what to do
    """

    level: str
    check: str
    what: str
    value: float
    limit: float
    advice: str

    def __str__(self) -> str:
        return f"{self.what}; {self.advice}" if self.advice else self.what


@dataclass(frozen=True, repr=False)
class Verdict:
    """Whether results can be trusted.

    Attributes
    ----------
    findings : tuple of Finding
        what is wrong, the worst first
    """

    findings: tuple[Finding, ...] = ()

    @property
    def level(self) -> str:
        """Return "good", "doubtful" or "failed": that of the worst finding."""
        return max((finding.level for finding in self.findings), key=LEVELS.index, default=GOOD)

    def __repr__(self) -> str:
        return f"<Verdict: {'; '.join([self.level, *(finding.check for finding in self.findings)])}>"

    def __str__(self) -> str:
        return "\n".join([self.level, *self.reasons()])

    def _repr_html_(self) -> str:
        return htmlTable([("verdict", self.level), *(("", reason) for reason in self.reasons())])

    def reasons(self) -> list[str]:
        """Return the findings as sentences, of which the first has what to do if several have the same."""
        advice = [finding.advice for finding in self.findings]
        return [
            finding.what if finding.advice in advice[:i] else str(finding) for i, finding in enumerate(self.findings)
        ]

    def inWords(self, words: Callable[[str], str]) -> "Verdict":
        """Return it with what was found and the advice in other words."""
        return Verdict(tuple(replace(each, what=words(each.what), advice=words(each.advice)) for each in self.findings))

    def toData(self) -> list[dict[str, Any]]:
        """Return the findings, fit for JSON."""
        return [asdict(finding) for finding in self.findings]

    @classmethod
    def ofData(cls, data: Iterable[dict[str, Any]]) -> "Verdict":
        """Return the Verdict of what :meth:`toData` returned."""
        return cls(tuple(Finding(**finding) for finding in data))


def verdictOfStages(titles: Sequence[str], verdicts: Mapping[int, Verdict]) -> Verdict | None:
    """Return the Verdict on a run from the titles of its stages and the verdicts by their indices; None if its last
    stage has none.

    It is that of the last stage, whose averages and shape are the results.  What failed in a stage before it makes the
    run doubtful.
    """
    last = len(titles) - 1
    if last not in verdicts:
        return None
    findings = list(verdicts[last].findings)
    for index in range(last):
        found = verdicts.get(index, Verdict()).findings
        findings += [
            replace(finding, level=DOUBTFUL, what=f"stage {index + 1}, {titles[index]}, failed: {finding.what}")
            for finding in found
            if finding.level == FAILED
        ]
    return Verdict(tuple(findings))


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of a simulation, or a stage of one, at its end.  What is not known is None, or left out.

    Attributes
    ----------
    rows : Table
        the observables, with energies in kT
    mesh : Mesh or None
        the surface at the end
    moduli : dict of float
        the modulus of each term, in kT; the greatest where it is not the same everywhere
    flatEnergy : float
        the bending energy, in kT, that the surface would have if it were flat: 0 without spontaneous curvature
    isUniform : bool
        whether its material is the same everywhere
    heat : float
        the temperature of the averages over the one whose kT is the unit of energies; 0 of a minimum
    acceptance, divergence, flipAcceptance : float or None
        the parts of trajectories that were accepted and that diverged, since a step size was found, and that of flips
    stepSize, timeScale : float or None
        the step size, and that of the rule of thumb, in ps
    weight : float
        that of momenta on coarser meshes, where steps must be shorter with it; 0 elsewhere
    adaptation : str
        what lets a step size that is found by its acceptance come out better; empty where it is given
    lately : (int, int)
        how many trajectories were accepted and tried in about the second half
    few : dict of (int, int)
        how many "trajectories" or "flips" were accepted and tried, where these are too few for a rate
    exchanges : sequence of (int, int)
        how many exchanges between each of several states and the next were accepted and tried
    passages : int or None
        how often a replica has come from one end of the states to the other
    moved : float or None
        the root mean square of the vertices' displacements, over the mean edge length
    fall : float or None
        the part of the energy by which a minimization that was cut short came down in the last tenth of its iterations
    excess : float or None
        the forces over the tolerance where a minimization found no lower energy along them
    slack : float or None
        the forces over the default tolerance where a minimization met a looser one
    beside : Beside or None
        the forces beside the membrane of a minimization
    """

    rows: Table = field(default_factory=Table)
    mesh: Mesh | None = None
    moduli: dict[str, float] = field(default_factory=dict)
    flatEnergy: float = 0.0
    isUniform: bool = True
    heat: float = 1.0
    acceptance: float | None = None
    divergence: float | None = None
    flipAcceptance: float | None = None
    stepSize: float | None = None
    timeScale: float | None = None
    weight: float = 0.0
    adaptation: str = ""
    lately: tuple[int, int] = (0, 0)
    few: dict[str, tuple[int, int]] = field(default_factory=dict)
    exchanges: Sequence[tuple[int, int]] = ()
    passages: int | None = None
    moved: float | None = None
    fall: float | None = None
    excess: float | None = None
    slack: float | None = None
    beside: "Beside | None" = None

    @cached_property
    def late(self) -> Table:
        """The rows that averages are taken over."""
        return lateRows(self.rows)

    @cached_property
    def bending(self) -> float | None:
        """The mean bending energy, in kT, if there is a bending modulus."""
        has = self.moduli.get("bending", 0) > 0 and "E_bending" in self.rows and self.mesh is not None
        return float(self.late["E_bending"].mean()) if has else None

    @cached_property
    def undulation(self) -> float:
        """The number of vertices times kT at the temperature of the averages, in kT."""
        return 0.0 if self.mesh is None else self.heat * len(self.mesh.vertices)

    @cached_property
    def surfaces(self) -> list[Mesh]:
        """The connected surfaces at the end."""
        return [] if self.mesh is None else self.mesh.components()

    def pull(self, rows: Table) -> float:
        """Return the largest derivative, in kT, by the logarithm of an area or volume, of the energy of smooth shapes,
        undulations, tension and pressure, on the average over some rows: what a modulus has to hold.

        Bending energies change with the reduced volume at most as a thin tube's, as 1/v^2, and so as A^3 with the area.
        Undulations take room: the excess of area, 1-v near the sphere, is shared by N modes where nothing resists, and
        by fewer the larger the bending modulus; what they pull was measured without one, and with one of 20 kT.
        """
        pull = abs(self.moduli.get("tension", 0)) * rows["area"].mean()
        if self.moduli.get("pressure", 0) != 0:
            pull += abs(self.moduli["pressure"]) * rows["volume"].mean()
        if self.bending is not None:
            pull += 3 * min(rows["E_bending"].mean(), self.energyOf(greatestEnergy) + self.flatEnergy + self.undulation)
        volumes = [rows[o.name].mean() for o in observablesIn(rows) if totalOf(o.name) == "reducedVolume"]
        if volumes and self.mesh is not None:
            roundest = _roundest(len(self.mesh.vertices) / len(volumes))
            softness = 1.5 / (1 + self.moduli.get("bending", 0) / 5)
            pull += self.undulation * (2 + softness / max(roundest - max(volumes), 1e-3))
        return float(pull)

    @cached_property
    def buckling(self) -> float:
        """What keeps periodic surfaces flat against a larger target of the area, in kT, by the logarithm of the area:
        kappa A (2 pi/L)^2 of a wave as long as a square box, 4 pi^2 kappa.  Below it a sheet has no bending energy.
        """
        return 0.0 if self.bending is None else self.energyOf(lambda s: math.pi / 2 if s.reducedVolume is None else 0.0)

    @cached_property
    def dihedrals(self) -> NDArray[np.float64]:
        """The angles between the normals of neighbors at the end, in degrees, without sign."""
        assert self.mesh is not None
        return np.abs(dihedralAngles(self.mesh))

    @cached_property
    def numCrossings(self) -> int:
        """How many times an edge passes through a triangle at the end."""
        assert self.mesh is not None
        return len(crossings(self.mesh))

    @cached_property
    def shapes(self) -> "list[Shape]":
        """The shapes of the surfaces at the end."""
        return [
            Shape(genus(s.triangles, len(s.vertices)), None if s.isPeriodic else s.reducedVolume) for s in self.surfaces
        ]

    def energyOf(self, energy: "Callable[[Shape], float]") -> float:
        """Return a bending energy, in kT, from that of the shape of each surface, over 8 pi kappa."""
        return 8 * math.pi * self.moduli["bending"] * sum(map(energy, self.shapes))


class Beside(NamedTuple):
    """The forces beside the membrane, by their names, and what they lost and the membrane's own terms gained, in kT,
    where they drove a minimization that came to no minimum.
    """

    forces: str
    lost: float = 0.0
    gained: float = 0.0

    def __str__(self) -> str:
        return f"what is beside the membrane ({self.forces})"


class Shape(NamedTuple):
    """What the bending energy of a smooth closed surface is estimated from; a periodic one has no reduced volume."""

    genus: int
    reducedVolume: float | None


class Measured(NamedTuple):
    """What a check measures: the value, what to say of it, and what to do if it is beyond the limit; and the limits for
    being doubtful and failed, if these are not those of the check.
    """

    value: float
    what: str
    advice: str = ""
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Check:
    """Something that is looked at.

    Attributes
    ----------
    title : str
        what it is called
    measure : callable
        yields what :class:`Measured` of the :class:`Evidence`; nothing if that is missing
    doubtful, failed : float
        the limits of the value
    isLeast : bool
        whether values below the limits are wrong, and not those above
    """

    title: str
    measure: Callable[[Evidence], Iterator[Measured]]
    doubtful: float
    failed: float
    isLeast: bool = False

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield what is beyond the limits."""
        for value, what, advice, limits in self.measure(evidence):
            doubtful, failed = limits or (self.doubtful, self.failed)
            for level, limit in ((FAILED, failed), (DOUBTFUL, doubtful)):
                if not (value >= limit if self.isLeast else value <= limit):
                    yield Finding(level, self.title, what, value, limit, advice)
                    break


@unwarned
def judge(evidence: Evidence, checks: "Iterable[Check] | None" = None) -> Verdict:
    """Return the Verdict of some checks, or all, on what is known."""
    found = [finding for check in (CHECKS if checks is None else checks) for finding in check.findings(evidence)]
    cause = _drive(evidence)
    if cause:  # of whatever else is wrong
        found = [replace(finding, advice=cause) for finding in found]
    return Verdict(tuple(sorted(found, key=lambda finding: -LEVELS.index(finding.level))))


def ratesOf(counters: Counters, integrator: Any) -> dict[str, Any]:
    """Return what the counters of an integrator tell of its acceptance, as attributes of an :class:`Evidence`."""
    c, few = counters, dict[str, tuple[int, int]]()
    if c.trajectories < LEAST_TRIED["trajectories"] and makesTrajectories(integrator):
        few["trajectories"] = c.accepted, c.trajectories
    if c.flips < LEAST_TRIED["flips"] and makesFlips(integrator):
        few["flips"] = c.acceptedFlips, c.flips
    return {
        "acceptance": _rate(c.accepted, c.trajectories, "trajectories"),
        "divergence": _rate(c.diverged, c.trajectories, "trajectories"),
        "flipAcceptance": _rate(c.acceptedFlips, c.flips, "flips"),
        "few": few,
    }


def _rate(accepted: int, tried: int, name: str) -> float | None:
    return accepted / tried if tried >= LEAST_TRIED[name] else None


def _roundest(numVertices: float) -> float:
    """Return the reduced volume of an icosphere."""
    return 1 - 0.95 / numVertices


def leastEnergy(shape: Shape) -> float:
    """Return the least bending energy, over 8 pi kappa, of a smooth closed surface of a shape."""
    if shape.genus > 0 or shape.reducedVolume is None:
        return _LEAST_OF_TORI
    return float(np.interp(shape.reducedVolume, list(_LEAST_ENERGY), list(_LEAST_ENERGY.values())))


def greatestEnergy(shape: Shape) -> float:
    """Return the largest bending energy, over 8 pi kappa, that a smooth closed surface of a shape is likely to have:
    that of a string of 1/v^2 equal beads, which is more than a tube's, and one for caps and handles.  Of a periodic one
    it is that of a sphere.
    """
    return 1.0 if shape.reducedVolume is None else 1 + 1 / max(shape.reducedVolume, 1e-3) ** 2


def _finite(e: Evidence) -> Iterator[Measured]:
    bad = [name for name, values in e.rows.items() if not np.all(np.isfinite(values))]
    if bad:
        what = f"there are values in the table that are not finite numbers: {', '.join(bad)}"
        yield Measured(len(bad), what, "a smaller step_size or smaller moduli keep them finite")


def _equilibrated(e: Evidence) -> Iterator[Measured]:
    marks = e.late.get("equilibrated", np.ones(0)) if len(e.rows) else ()
    if len(marks):
        yield Measured(
            float(np.mean(marks == 1)),
            "the averages are of steps in which the run still adapted its step size or approached its targets",
            "more steps, or a shorter burn_in or equilibration",
        )


def _targets(e: Evidence) -> Iterator[Measured]:
    """Averages over each window, against what pulls on the modulus."""
    for observable in observablesIn(e.rows):
        total = totalOf(observable.name)
        modulus = e.moduli.get(total, 0) if observable.target in e.rows else 0
        if modulus > 0:
            missed = [_missed(e, rows, observable, modulus) for rows in sampledWindows(e.rows)]
            yield max(missed, key=lambda measured: measured.value / (measured.limits or (1,))[0])


def _missed(e: Evidence, rows: Table, observable: Observable, modulus: float) -> Measured:
    deviations = rows[observable.name] / rows[observable.target] - 1
    mean, count = float(deviations.mean()), len(deviations)
    total = totalOf(observable.name)
    error = math.sqrt(e.heat / (2 * modulus) / count)
    if count >= LEAST_ROWS:
        error = max(error, _blockError(deviations))
    pull = e.pull(rows) + (e.buckling if total == "area" and mean < 0 else 0)
    given = max(CLOSE, pull / (2 * modulus)) + 4 * error
    hasOtherSign = total == "areaDifference" and mean + 4 * error < -1
    limit = min(given, 1.0 if hasOtherSign else math.inf if total == "areaDifference" else FAR)
    isSoft = abs(mean) <= given
    name, off = observable.title, f"{mean:+.2%} off its target{' on average' if count > 1 else ''}"
    return Measured(
        abs(mean),
        f"the {name} is {off}, where its modulus, {modulus:.3g} kT, "
        + ("is too soft to hold it" if isSoft else f"allows {given:.2%}"),
        _OTHER_SIGN
        if hasOtherSign
        else f"a larger {MODULUS_NAMES[total]} holds it"
        if isSoft
        else _approaching(e, total, mean),
        (limit, math.inf if isSoft else max(3 * given + CLOSE, FAR)),
    )


def _approaching(e: Evidence, total: str, mean: float) -> str:
    """Return what brings a constraint nearer to its target, which its modulus could hold."""
    if not e.heat:
        return _descending(e, total)
    if _hasShortStep(e):
        return f"{_LARGER_STEP}: it is {e.stepSize:.2g} ps, where {e.timeScale:.2g} ps go with the moduli; or {_LONGER}"
    if not (total == "area" and mean > 0 and e.mesh is not None and e.mesh.isPeriodic):
        return _LONGER
    return _ROOM if mean <= FAR else f"{_LONGER}, or {_ROOM}"  # it is near already


def _descending(e: Evidence, total: str) -> str:
    """Return what brings a constraint nearer to its target in a minimization."""
    for finding in (*FORCES.findings(e), *MINIMUM.findings(e)):
        return finding.advice if e.excess is not None else _NEARER
    if _isRough(e):
        return _LED
    larger = f"a larger {MODULUS_NAMES[total]} holds it"
    return f"the energy has its minimum there, with {e.beside}: {larger}, or a weaker force" if e.beside else larger


_LONGER = "let it be approached (sampling.approach, or a stage of kind approach or continue that takes longer)"
_ROOM = "give a larger target_area or area_modulus, as a sheet covers its box, and its undulations take more"
_OTHER_SIGN = (
    "its sign is not that of its target, to which no way leads through 0: give a target of its own sign, or begin with "
    "a mesh whose area difference has the other"
)
_LED = "let a stage of kind approach before it lead to the targets"
_NEARER = f"let the minimization go on (max_iterations, tolerance), or {_LED}"


def _acceptance(e: Evidence) -> Iterator[Measured]:
    if e.acceptance is not None:
        yield Measured(e.acceptance, f"only {e.acceptance:.1%} of the trajectories were accepted", _stepAdvice(e))
    if "trajectories" in e.few:
        yield _leastRate(*e.few["trajectories"], "trajectories", ACCEPTANCE, "make more steps")


def _lateAcceptance(e: Evidence) -> Iterator[Measured]:
    """The rate that is surpassed with a small probability: where all in all enough are accepted, a run may freeze."""
    accepted, tried = e.lately
    if tried > 0 and e.acceptance is not None and e.acceptance >= ACCEPTANCE.doubtful:
        greatest = 1 - _leastLikely(tried - accepted, tried)
        what = f"of the last {tried} trajectories {accepted} were accepted, and {e.acceptance:.0%} of all"
        yield Measured(greatest, what, _stepAdvice(e))


def _leastRate(accepted: int, tried: int, name: str, check: Check, advice: str) -> Measured:
    """Return the rate that is not reached with a small probability, where too few were tried to know it better."""
    least = _leastLikely(accepted, tried)
    what = f"{accepted} of {tried} {name} were accepted" if tried else f"no {name} were tried"
    return Measured(least, f"{what}, too few to tell whether enough are", advice, (check.doubtful, 0.0))


def _leastLikely(count: int, tried: int) -> float:
    """Return the rate at which so many or more come out with a small probability: the lower bound of Clopper and
    Pearson.
    """
    return float(betaincinv(count, tried - count + 1, _RISK)) if count else 0.0


def _divergence(e: Evidence) -> Iterator[Measured]:
    if e.divergence is not None:
        what = f"{e.divergence:.1%} of the trajectories diverged and were rejected"
        yield Measured(e.divergence, what, _stepAdvice(e))


_ANEW = "begin anew, and let the targets be approached more slowly, in a stage of kind approach or continue"
_SMALLER_STEP = 'a smaller step_size helps, or step_size = "auto"'
_LARGER_STEP = 'give a larger step_size, or "auto", or none'
_UNEVEN = "the mesh is uneven or crumpled, so remesh it, or minimize before sampling"


def _hasShortStep(e: Evidence) -> bool:
    """Return whether the step size is given, and much smaller than trajectories need in order to be accepted."""
    if e.stepSize is None or e.timeScale is None or e.acceptance is None or e.adaptation:
        return False
    return e.acceptance > 0.5 and e.stepSize < SHORT_STEP * e.timeScale


def _stepAdvice(e: Evidence) -> str:
    """Return what lets trajectories be accepted."""
    if e.moduli.get("tether") == 0:
        return "a tether keeps triangles well shaped, and trajectories are accepted then"
    if e.mesh is not None and np.mean(e.dihedrals > FOLDED) > FOLDS.doubtful:
        return f"a smaller step_size does not help, since the membrane has crumpled: {_ANEW}"
    if e.stepSize is None or e.timeScale is None or e.stepSize >= SHORT_STEP * e.timeScale:
        advice = e.adaptation or _SMALLER_STEP
        return f"{_cause(e)}; or {advice}" if e.weight > 0 else advice
    return (
        f"a smaller step_size does not help, since it is {e.stepSize:.2g} ps already, where {e.timeScale:.2g} ps go "
        f"with the moduli: {_cause(e)}"
    )


def _cause(e: Evidence) -> str:
    """Return what lets steps be as long as the rule of thumb says."""
    lighter = f"a multilevel_weight below {e.weight:g}, or 0, helps, since the moduli are too stiff for this one"
    return lighter if e.weight > 0 else _UNEVEN


def _flips(e: Evidence) -> Iterator[Measured]:
    if e.flipAcceptance is not None and e.heat > COLD:
        what = f"only {e.flipAcceptance:.2%} of the flips were accepted, so that the membrane does not flow"
        isStill = e.acceptance is None or e.acceptance < ACCEPTANCE.failed
        advice = "wider bounds of the tether let edges flip; flip_probability = 0 asks for none"
        still = "trajectories that move the vertices let edges flip, too"
        yield Measured(e.flipAcceptance, what, still if isStill else advice)
    if "flips" in e.few and e.heat > COLD:
        yield _leastRate(*e.few["flips"], "flips", FLIPS, "make more steps")


def _stepSize(e: Evidence) -> Iterator[Measured]:
    if e.stepSize is not None and e.timeScale is not None and e.acceptance is not None:
        what = f"the step size of {e.stepSize:.2g} ps creeps: {e.timeScale:.2g} ps go with the moduli and the mesh"
        advice = _LARGER_STEP if _hasShortStep(e) else _cause(e)
        yield Measured(e.stepSize / e.timeScale, what, advice)


def _moved(e: Evidence) -> Iterator[Measured]:
    if e.moved is not None and e.acceptance is not None:
        what = f"vertices moved by {e.moved:.2g} mean edge lengths, so that nothing was sampled"
        yield Measured(e.moved, what, _stepAdvice(e) if e.acceptance < 0.2 else "more or longer steps")


def _bendingEnergy(e: Evidence) -> Iterator[Measured]:
    if e.bending is not None:
        smooth = (math.sqrt(e.energyOf(greatestEnergy)) + math.sqrt(e.flatEnergy)) ** 2  # by Cauchy and Schwarz
        expected, unit = smooth + _GREATEST_UNDULATION * e.undulation, e.energyOf(lambda _: 1)
        what = (
            f"the bending energy is {e.bending / unit:.3g} times that of a sphere, where smooth shapes and thermal "
            f"undulations have at most {expected / unit:.3g}: the membrane is crumpled"
        )
        yield Measured(e.bending / expected, what, _ANEW)


def _continuum(e: Evidence) -> Iterator[Measured]:
    isClosed = e.mesh is not None and not e.mesh.isPeriodic
    if e.bending is not None and e.isUniform and e.flatEnergy == 0 and isClosed:
        least, unit = e.energyOf(leastEnergy), e.energyOf(lambda _: 1)
        what = (
            f"the bending energy is {e.bending / unit:.3g} times that of a sphere, less than any smooth surface of "
            f"this reduced volume has ({least / unit:.3g}): the mesh is too coarse for its shape"
        )
        yield Measured(e.bending / least, what, "more vertices, or a firmer tether")


def _folds(e: Evidence) -> Iterator[Measured]:
    if e.mesh is not None:
        share, greatest = float(np.mean(e.dihedrals > FOLDED)), e.dihedrals.max()
        what = (
            f"the surface is folded by more than {FOLDED:g} degrees at {share:.1%} of its edges, up to {greatest:.0f}"
        )
        yield Measured(share, what, "a slower way to the targets, more vertices, or a firmer tether")


def _triangles(e: Evidence) -> Iterator[Measured]:
    if e.mesh is not None:
        areas = e.mesh.triangleAreas
        count = int(np.sum(areas < FLAT * areas.mean()))
        what = f"{count} triangle{'s are' if count > 1 else ' is'} as good as without area"
        yield Measured(count / len(areas), what, "narrower bounds of the tether keep triangles well shaped")


def _intersections(e: Evidence) -> Iterator[Measured]:
    if e.mesh is not None:
        what = f"the surface passes through itself {e.numCrossings} times at the end"
        # Of edges that cross in the middle.
        longer = "a larger onset of the repulsion, 0.7 times the longest edges,"
        advice = longer if e.moduli.get("repulsion", 0) > 0 else "a repulsion"
        share = e.numCrossings / (3 * len(e.mesh.triangles) // 2)  # of the edges
        yield Measured(share, what, f"{advice} prevents this")


def _rowsLeft(e: Evidence) -> Iterator[Measured]:
    if len(e.rows):
        count = len(e.late["step"])
        what = f"averages are over {count} row{'s' if count > 1 else ''} of the table, which cannot tell their errors"
        yield Measured(count, what, "make more steps, or a smaller observables_interval")


def _drift(e: Evidence) -> Iterator[Measured]:
    """The means of the two halves, in their standard errors, where they differ by what matters."""
    if not len(e.rows) or len(e.late["step"]) < LEAST_ROWS:
        return
    for observable in observablesIn(e.late):
        if totalOf(observable.name) in _DRIFTING:
            values = e.late[observable.name]
            first, second = np.array_split(values, 2)
            change, mean = float(second.mean() - first.mean()), abs(float(values.mean()))
            error = math.hypot(_blockError(first), _blockError(second))
            # What is 0 but for its fluctuations, as the area difference of a sheet, has no part of its mean.
            matters = mean > values.std() and abs(change) > _MATTERS * mean
            if matters and np.all(np.isfinite(values)):
                what = (
                    f"the {observable.title} drifts by {change / mean:+.1%} while it is averaged, and has not come to "
                    "equilibrium"
                )
                yield Measured(abs(change) / max(error, 1e-300), what, "more steps")


# What may drift, and by which part of its mean it matters.
_DRIFTING, _MATTERS = ("E_bending", "area", "volume", "areaDifference"), 0.01


def _blockError(values: NDArray[np.float64]) -> float:
    """Return the standard error of the mean of correlated values, from the means of at most four blocks."""
    blocks = [block.mean() for block in np.array_split(values, min(4, len(values)))]
    return float(np.std(blocks, ddof=1) / math.sqrt(len(blocks)))


def _minimum(e: Evidence) -> Iterator[Measured]:
    if e.fall is not None:
        what = (
            "the minimization was cut short while the energy fell, by "
            f"{100 * e.fall:.2g}% in the last tenth of its iterations"
        )
        yield Measured(e.fall, what, "a larger max_iterations")


def _forces(e: Evidence) -> Iterator[Measured]:
    if e.excess is not None:
        what = f"the minimization found no lower energy along forces that are {e.excess:.3g} times its tolerance"
        yield Measured(e.excess, what, f"more iterations do not help: {_ROUGH if _isRough(e) else _STIFF}")
    if e.slack is not None:
        what = (
            f"the minimization ended at forces that are {e.slack:.3g} times the default tolerance, as its own is looser"
        )
        yield Measured(e.slack, what, "a smaller tolerance, or none, brings it nearer to the minimum")


def _isRough(e: Evidence) -> bool:
    return any(found for check in (FOLDS, TRIANGLES, INTERSECTIONS) for found in check.findings(e))


def _drive(e: Evidence) -> str:
    """Return that forces beside the membrane may be without a minimum, if they drove it; it is not known for sure."""
    if e.beside is None or e.beside.gained == 0:
        return ""
    return (
        f"{e.beside} lost {e.beside.lost:.3g} kT, and the membrane took up {e.beside.gained:.3g} kT: a force of "
        "[system] or of the setup is too strong for it, or its energy has no lower bound"
        + ("" if e.fall is None else "; a larger max_iterations helps only if it has one")
    )


_ROUGH = (
    "triangles that are flat, folded or pass through others make the energy rough, and a firmer tether or a repulsion "
    "keeps them from that"
)
_STIFF = (
    "far from its targets a surface is stiff; let the targets be approached before, in a stage of kind approach that "
    "has them, or begin with another mesh, as of mh.spheroid()"
)


def _symmetry(e: Evidence) -> Iterator[Measured]:
    """A dented sphere that has the symmetry of an icosphere is no minimum; with an area difference some shapes are."""
    for surface, shape in zip(e.surfaces, e.shapes):
        v, isHeld = shape.reducedVolume, e.moduli.get("areaDifference", 0) > 0
        if v is not None and v < _roundest(len(surface.vertices)) - DENTED and shape.genus == 0 and not isHeld:
            moments = np.linalg.eigvalsh(gyrationTensor(surface))
            what = (
                f"the shape of reduced volume {v:.3f} is as long as wide and high: it has kept the symmetry of the "
                "mesh that it began with, and others have less energy"
            )
            yield Measured(float(moments[-1] / moments[0] - 1), what, _WITHOUT_SYMMETRY)


_WITHOUT_SYMMETRY = (
    "begin with another mesh, as of mh.spheroid(), or sample before, in a stage of kind sample or approach"
)


def _exchanges(e: Evidence) -> Iterator[Measured]:
    for k, (accepted, tried) in enumerate(e.exchanges):
        name = f"exchanges between the states {k} and {k + 1}"
        if tried < LEAST_TRIED["exchanges"]:
            yield _leastRate(accepted, tried, name, EXCHANGES, "make more rounds")
        else:
            what = f"only {accepted / tried:.1%} of the {name} were accepted"
            yield Measured(accepted / tried, what, "put another state between them, so that their energies overlap")


def _passages(e: Evidence) -> Iterator[Measured]:
    if e.passages is not None:
        what = "no replica has come from one end of the states to the other, so that none has seen them all"
        yield Measured(e.passages, what, "make more rounds, or put the states closer together")


FINITE = Check("finite numbers", _finite, 0, 0)
EQUILIBRATED = Check("equilibrated rows", _equilibrated, 1, 0, isLeast=True)
TARGETS = Check("targets", _targets, FAR, math.inf)
ACCEPTANCE = Check("acceptance of trajectories", _acceptance, 0.2, 0.02, isLeast=True)
LATE_ACCEPTANCE = Check("acceptance of late trajectories", _lateAcceptance, 0.2, 0.02, isLeast=True)
DIVERGENCE = Check("diverged trajectories", _divergence, 0.01, 0.5)
FLIPS = Check("acceptance of flips", _flips, 1e-3, 1e-5, isLeast=True)
STEP_SIZE = Check("step size", _stepSize, 0.02, 1e-3, isLeast=True)
MOVED = Check("displacement", _moved, 0.1, 0.01, isLeast=True)
BENDING = Check("bending energy", _bendingEnergy, 1, 2)
CONTINUUM = Check("bound of the continuum", _continuum, 0.95, 0.85, isLeast=True)
FOLDS = Check("folds", _folds, 0.005, 0.02)
TRIANGLES = Check("triangles without area", _triangles, 0, 0.01)
INTERSECTIONS = Check("self-intersections", _intersections, 0, 0.1)
ROWS = Check("rows to average", _rowsLeft, LEAST_ROWS, 0, isLeast=True)
DRIFT = Check("drift", _drift, 4, math.inf)
MINIMUM = Check("minimum", _minimum, 1e-5, 0.05)
FORCES = Check("forces", _forces, 10, math.inf)
SYMMETRY = Check("symmetry", _symmetry, 1e-3, -math.inf, isLeast=True)
EXCHANGES = Check("acceptance of exchanges", _exchanges, 0.01, 0, isLeast=True)
PASSAGES = Check("passages through the states", _passages, 1, 0, isLeast=True)

OF_SHAPES: tuple[Check, ...] = (FINITE, TARGETS, BENDING, CONTINUUM, FOLDS, TRIANGLES, INTERSECTIONS)
OF_MOVES: tuple[Check, ...] = (ACCEPTANCE, LATE_ACCEPTANCE, DIVERGENCE, FLIPS, STEP_SIZE, MOVED)
OF_AVERAGES: tuple[Check, ...] = (EQUILIBRATED, ROWS, DRIFT)
OF_MINIMA: tuple[Check, ...] = (MINIMUM, FORCES, SYMMETRY)
OF_EXCHANGES: tuple[Check, ...] = (EXCHANGES, PASSAGES)
CHECKS = (*OF_SHAPES, *OF_MOVES, *OF_AVERAGES, *OF_MINIMA, *OF_EXCHANGES)
