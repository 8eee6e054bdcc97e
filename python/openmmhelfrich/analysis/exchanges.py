"""The verdict on a replica exchange: on what was sampled in each state, and on the exchanges."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..sampling.conditions import currentMesh, flatEnergy, moduliOf
from ..sampling.replicaexchange import ReplicaExchange
from .verdict import DRIFT, LEVELS, OF_EXCHANGES, OF_MOVES, OF_SHAPES, ROWS, Evidence, Finding, Verdict, judge, ratesOf

# What to do that is another thing here than in a stage of a run.
_ADVICE = {ROWS.title: "make more rounds", DRIFT.title: "make more rounds"}


def judgeStates(exchange: ReplicaExchange) -> list[Verdict]:
    """Return the Verdict on what was sampled in each state, by the shape of the replica that was in it at last."""
    return [_judge(exchange, state) for state in range(len(exchange.states))]


def judgeExchange(exchange: ReplicaExchange, verdicts: Sequence[Verdict]) -> Verdict:
    """Return the Verdict on the whole, from those on the states: what is wrong in one is wrong in the whole."""
    own = judge(Evidence(exchanges=exchange.exchangeCounts, passages=exchange.numPassages), OF_EXCHANGES)
    where: dict[tuple[str, str, int], list[tuple[int, Finding]]] = {}
    for state, verdict in enumerate(verdicts):
        kinds = [(finding.check, finding.level) for finding in verdict.findings]
        for n, finding in enumerate(verdict.findings):  # of a check there may be several in a state
            where.setdefault((*kinds[n], kinds[:n].count(kinds[n])), []).append((state, finding))
    findings = [*own.findings, *map(_together, where.values())]
    return Verdict(tuple(sorted(findings, key=lambda finding: -LEVELS.index(finding.level))))


def _together(found: list[tuple[int, Finding]]) -> Finding:
    """Return the first of like findings, with the states that have others."""
    (state, finding), *others = found
    also = f" (and so in {', '.join(str(other) for other, _ in others)})" if others else ""
    return replace(finding, what=f"in state {state} {finding.what}{also}")


def _judge(exchange: ReplicaExchange, state: int) -> Verdict:
    verdict = judge(_evidence(exchange, state), (*OF_SHAPES, *OF_MOVES, ROWS, DRIFT))
    return Verdict(
        tuple(replace(finding, advice=_ADVICE.get(finding.check, finding.advice)) for finding in verdict.findings)
    )


def _evidence(exchange: ReplicaExchange, state: int) -> Evidence:
    replica = int(np.flatnonzero(exchange.history[-1] == state)[0])
    simulation, kT = exchange.simulations[replica], exchange.states[state].thermalEnergy
    late = exchange.counters(state, discard=exchange.numRounds // 2)
    rates = {
        **ratesOf(exchange.counters(state), simulation.integrator),
        "lately": (late.accepted, late.trajectories),
    }
    force = exchange.membrane(replica)
    if force is None:
        return Evidence(rows=exchange.observables(state), **rates)
    mesh = currentMesh(simulation, force)
    return Evidence(
        rows=exchange.observables(state),
        mesh=mesh,
        moduli={name: modulus / kT for name, modulus in moduliOf(simulation.context, force).items()},
        flatEnergy=flatEnergy(simulation.context, force, mesh) / kT,
        isUniform=force.getNumSpecies() == 0,
        moved=exchange.displacement(replica) / float(mesh.edgeLengths.mean()),
        **rates,
    )
