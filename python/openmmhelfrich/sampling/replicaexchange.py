"""Replica exchange: simulations at several temperatures, targets, moduli or the like that exchange these, so that each
configuration visits them all.

Every replica is a Simulation of its own, and what moves between them are the states: positions, velocities and live
triangles stay in their Context. The method is that of Hukushima and Nemoto, J. Phys. Soc. Jpn. 65, 1604 (1996), for
temperatures, and of Sugita, Kitao and Okamoto, J. Chem. Phys. 113, 6042 (2000), for parameters of the energy.
"""

import io
import json
import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import openmm as mm
from numpy.typing import NDArray
from openmm import app, unit

from ..display import htmlTable, judging, lineText
from ..files import PathLike, replacing
from ..helfrich import HamiltonianTrajectoryIntegrator, HelfrichForce
from ..io.drafts import signalsLater
from ..tables import Table, plainName
from ..units import thermalEnergy, valueIn, wholeNumber
from .conditions import conditionNames, putConditions
from .marks import displacement, markedPositions
from .moves import Counters, countersOf, movesOf, trajectoriesOf
from .observables import Moment, Observable, isTarget, observablesOf, observe
from .states import Membrane, ThermodynamicState, mutationsOf

FORMATS = (1, 2, 3)  # the first one has no observables and counters, the second no counters of each round
# What of a serialized force a Context has of its own.
_LIVE = {"targetArea", "targetVolume", "targetAreaDifference", "tension", "pressure", "default"}
_LIVE |= {"Triangles", "SurfaceTargets"}


class ReplicaExchange:
    """Several simulations that exchange their states.

    A round is a number of Monte Carlo steps of each replica, the energies of each replica in every state, and attempts
    to exchange neighboring states: 0 and 1, 2 and 3 ... in even rounds, 1 and 2, 3 and 4 ... in odd ones.  Replicas a
    and b in the states i and j exchange them with the probability

        min(1, exp(u_i(x_a)+u_j(x_b)-u_i(x_b)-u_j(x_a))),   u_i(x) = E(x; parameters of i)/kT_i.

    The random numbers follow from the seed and the number of rounds made, and the replicas have generators of their
    own: a run that was saved and loaded goes on as an uninterrupted one to the last bit, and the number of workers
    changes nothing.  Both need a native HybridMonteCarloIntegrator (or any other whose State has its generator's
    state).

    ::

        states = [mh.ThermodynamicState(temperature) for temperature in (300, 310)]
        simulations = [mh.Scene.of({}, mesh).createSimulation(mh.Scene.of({}, mesh).createForce()) for _ in states]
        exchange = mh.ReplicaExchange(simulations, states, seed=1)
        exchange.run(rounds=4, steps=2)
        print(exchange.acceptanceRates)

    Attributes
    ----------
    simulations : list of openmm.app.Simulation
        the replicas
    states : list of ThermodynamicState
        what they exchange
    replicaStates : array of int
        the index of the state that each replica is in
    """

    def __init__(
        self,
        simulations: Sequence[app.Simulation],
        states: Sequence[ThermodynamicState],
        seed: int = 1,
        workers: int = 1,
    ):
        """Create a ReplicaExchange, with replica k in state k.

        Parameters
        ----------
        simulations : sequence of openmm.app.Simulation
            one for each state, with an integrator that has a temperature; give them different seeds
        states : sequence of ThermodynamicState
            in an order in which neighbors overlap; all with the same parameters
        seed : int
            of the exchanges' random numbers, 0 or more
        workers : int
            how many replicas run at the same time, each in a thread of this process

        Raises
        ------
        ValueError
            if an argument is out of range or does not fit to the others
        """
        self.simulations = list(simulations)
        self.seed = wholeNumber(seed, "ReplicaExchange: seed", 0)
        self._workers = wholeNumber(workers, "ReplicaExchange: workers", 1)
        self._check(self.simulations, list(states))
        self._membranes = [_membraneOf(simulation) for simulation in self.simulations]
        self._checkParameters(states)
        self.states = [
            _resolved(state, simulation, membrane)
            for state, simulation, membrane in zip(states, self.simulations, self._membranes)
        ]
        _requireSameEnergies(self.simulations, self._membranes, self.states[0].parameters)
        self.replicaStates = np.arange(len(self.states))
        self._history: list[NDArray[np.int64]] = []
        self._energies: list[NDArray[np.float64]] = []
        self._attempted, self._accepted = np.zeros((2, len(self.states) - 1), dtype=int)
        self._requireSameComposition()
        self._observed: list[NDArray[np.float64]] = []
        self._columns: list[str] = []
        self._made: list[NDArray[np.int64]] = []  # in each round, the counters of each state
        self._marks = [self._markedPositions(replica) for replica in range(len(self.simulations))]
        self._judged: tuple[int, list[Any], Any] = (0, [], None)
        for replica in range(len(self.simulations)):
            self._enter(replica, replica)

    def __repr__(self) -> str:
        return (
            f"<ReplicaExchange: {len(self.states)} states, {self.numRounds} rounds, {sum(self._accepted)} of "
            f"{sum(self._attempted)} exchanges accepted>"
        )

    def __str__(self) -> str:
        return lineText(self.lines())

    def _repr_html_(self) -> str:
        return htmlTable(self.lines())

    def lines(self) -> list[tuple[str, str]]:
        """Return a label and a text for each thing worth knowing: what each state accepted, and the verdict."""
        lines = [("replicas", f"{len(self.states)}, {self.numRounds} rounds")]
        exchanges = [*(f", exchanges with the next {rate:.0%}" for rate in self.acceptanceRates), ""]
        for k, state in enumerate(self.states):
            c = self.counters(k)
            accepted = [
                f"{name} {some / all:.0%}"
                for name, some, all in (
                    ("trajectories", c.accepted, c.trajectories),
                    ("flips", c.acceptedFlips, c.flips),
                )
                if all
            ]
            rates = f": accepted {', '.join(accepted)}" if accepted else ""
            lines.append((f"state {k}", f"{state.temperature:.5g} K{rates}{exchanges[k].replace('nan%', 'none')}"))
        verdict = self.verdict
        if verdict is not None:
            first, *reasons = str(verdict).splitlines()
            lines += [("verdict", first), *(("", reason) for reason in reasons)]
        return lines

    @property
    def verdict(self) -> Any:
        """The :class:`Verdict <openmmhelfrich.analysis.verdict.Verdict>` on what was sampled, in all states, and on the
        exchanges; None before the first round.
        """
        self._judge()
        return self._judged[2]

    @property
    def verdicts(self) -> list[Any]:
        """The Verdict on each state; none before the first round."""
        self._judge()
        return self._judged[1]

    @property
    def exchangeCounts(self) -> list[tuple[int, int]]:
        """How many exchanges between each state and the next were accepted, and attempted."""
        return list(zip(self._accepted.tolist(), self._attempted.tolist()))

    @property
    def numPassages(self) -> int:
        """How often a replica has come from one end of the states to the other."""
        last, passages = len(self.states) - 1, 0
        for path in self.history.T:
            ends = path[(path == 0) | (path == last)]
            passages += int(np.sum(np.diff(ends) != 0))
        return passages

    def observables(self, state: int, discard: int = 0) -> Table:
        """Return what was observed of the membranes in a state, at the end of each round, without some at the start:
        energies in kT of that state, areas and volumes in powers of nm.
        """
        first = self.numRounds - len(self._observed)  # of an earlier version's rounds nothing was observed
        rounds = np.arange(max(first, discard), self.numRounds)
        rows = [self._observed[n - first][np.argsort(self._history[n])[state]] for n in rounds]
        values = np.array(rows, dtype=float).reshape(len(rows), len(self._columns))
        return Table({"step": rounds.astype(float) + 1, **dict(zip(self._columns, values.T))})

    def counters(self, state: int, discard: int = 0) -> Counters:
        """Return how many trajectories and flips were tried in a state, and what came of them, without some rounds at
        the start.
        """
        first = self.numRounds - len(self._made)  # of an earlier version's rounds only the sum is known
        made = [counters[state].tolist() for counters in self._made[max(0, discard - first) :]]
        return Counters(*map(sum, zip(*made)))

    def membrane(self, replica: int) -> HelfrichForce | None:
        """Return the HelfrichForce of a replica, or None if it has none."""
        return self._membranes[replica].force

    def displacement(self, replica: int) -> float:
        """Return how far the particles of a replica have come since the first round, without the drift of all: the root
        mean square, of a hundred of them, in nm.
        """
        return displacement(self._marks[replica], self._markedPositions(replica))

    @property
    def numRounds(self) -> int:
        """The number of rounds made."""
        return len(self._history)

    @property
    def history(self) -> np.ndarray:
        """The state of each replica during each round: a (rounds, replicas) array of int."""
        return np.array(self._history, dtype=int).reshape(-1, len(self.states))

    @property
    def reducedEnergies(self) -> np.ndarray:
        """E/kT of each replica at the end of each round, as it is in each of the states: a (rounds, replicas, states)
        array.  With mutations, E is less by the chemical potentials of all vertices.
        """
        return np.array(self._energies, dtype=float).reshape(-1, len(self.states), len(self.states))

    @property
    def acceptanceRates(self) -> np.ndarray:
        """The fraction of the attempts that succeeded between each state and the next, NaN before the first."""
        return np.divide(
            self._accepted, self._attempted, out=np.full(len(self._attempted), np.nan), where=self._attempted > 0
        )

    def run(self, rounds: int, steps: int, checkpoint: PathLike | None = None, interval: int = 100) -> None:
        """Make rounds.

        Parameters
        ----------
        rounds : int
            how many
        steps : int
            Monte Carlo steps of each replica in each of them
        checkpoint : path, optional
            where to :meth:`save` every so many rounds, and at the end
        interval : int
            that number of rounds

        Raises
        ------
        ValueError
            if an argument is out of range, or the energy of a replica is not a number

        A KeyboardInterrupt ends it between exchanges, at whole steps of each replica, and the next call goes on.
        """
        for name, value, least in (("rounds", rounds, 0), ("steps", steps, 1), ("interval", interval, 1)):
            wholeNumber(value, f"ReplicaExchange.run: {name}", least)
        for n in range(1, int(rounds) + 1):
            made = self._propagate(int(steps))
            with signalsLater():  # an exchange, of which one half alone would be wrong, is short
                self._endRound(made)
            if checkpoint is not None and (n % interval == 0 or n == rounds):
                self.save(checkpoint)

    def samples(self, discard: int = 0, stride: int = 1) -> tuple:
        """Return what was sampled in the form that pymbar takes: u_kn and N_k.

        Parameters
        ----------
        discard : int
            rounds to leave out at the start
        stride : int
            of the others, take one in so many

        Returns
        -------
        (states, states*n) array, (states,) array of int
            the reduced energy in each state of n samples from state 0, n from state 1 ..., and n for each state
        """
        discard, stride = (
            wholeNumber(value, f"ReplicaExchange: {name}", least)
            for name, value, least in (("discard", discard, 0), ("stride", stride, 1))
        )
        history, energies = self.history[discard::stride], self.reducedEnergies[discard::stride]
        # (rounds, state sampled, state evaluated)
        ofState = np.take_along_axis(energies, np.argsort(history, axis=1)[:, :, np.newaxis], axis=1)
        return ofState.transpose(2, 1, 0).reshape(len(self.states), -1), np.full(len(self.states), len(history))

    def potentialEnergies(self, discard: int = 0) -> np.ndarray:
        """Return the potential energy of what was sampled in each state, in kJ/mol, less the chemical potentials that
        mutations have, without some rounds at the start: a (states, rounds) array.
        """
        u, counts = self.samples(discard)
        return np.array(
            [
                state.thermalEnergy * row.reshape(len(counts), -1)[k]
                for k, (state, row) in enumerate(zip(self.states, u))
            ]
        )

    def save(self, file: PathLike) -> None:
        """Write everything that :meth:`load` needs to a file, which replaces an earlier one in a single step."""
        data = {
            "format": FORMATS[-1],
            "seed": self.seed,
            "states": [_asDict(state) for state in self.states],
            "replicaStates": self.replicaStates.tolist(),
            "attempted": self._attempted.tolist(),
            "accepted": self._accepted.tolist(),
            "columns": self._columns,
        }
        arrays = io.BytesIO()
        contents: dict[str, Any] = {f"marks{replica}": marks for replica, marks in enumerate(self._marks)}
        contents |= {"history": self.history, "reducedEnergies": self.reducedEnergies, "observed": self._observed}
        contents["counters"] = np.array(self._made, dtype=int)
        np.savez(arrays, **contents)
        with replacing(file) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("exchange.json", json.dumps(data, indent=1))
            archive.writestr("rounds.npz", arrays.getvalue())
            for replica, simulation in enumerate(self.simulations):
                state = simulation.context.getState(
                    positions=True, velocities=True, parameters=True, integratorParameters=True
                )
                archive.writestr(f"replica{replica}.xml", mm.XmlSerializer.serialize(state))

    def load(self, file: PathLike) -> None:
        """Go on where another ReplicaExchange, of the same simulations, states and seed, was when it was saved, with
        its step sizes.

        Raises
        ------
        FileNotFoundError
            if there is no such file
        ValueError
            if it is not one that :meth:`save` wrote, or is of other states or another seed; nothing has changed then
        """
        data, arrays, contents = _read(file, len(self.states))
        states = [ThermodynamicState(**state) for state in data["states"]]
        for name, there, here in (
            ("seed", data["seed"], self.seed),
            (
                "temperatures and parameters",
                *([(s.temperature, s.parameters) for s in k] for k in (states, self.states)),
            ),
        ):
            if there != here:
                raise ValueError(f"ReplicaExchange.load: {file} has the {name} {there}; here it is {here}")
        for replica, (simulation, state) in enumerate(zip(self.simulations, contents)):
            if len(state.getPositions()) != simulation.system.getNumParticles():
                raise ValueError(
                    f"ReplicaExchange.load: replica {replica} of {file} has {len(state.getPositions())} particles; "
                    f"here it has {simulation.system.getNumParticles()}"
                )
        for simulation, state in zip(self.simulations, contents):
            simulation.context.setState(state)
        self.states, self.replicaStates = states, np.array(data["replicaStates"])
        self._history, self._energies = list(arrays["history"]), list(arrays["reducedEnergies"])
        self._attempted, self._accepted = np.array(data["attempted"]), np.array(data["accepted"])
        self._columns, self._observed = data.get("columns", []), list(arrays.get("observed", ()))
        made = arrays.get("counters", [data["counters"]] if "counters" in data else [])
        self._made = [np.array(counters) for counters in made]
        self._marks = [
            arrays[name] if (name := f"marks{replica}") in arrays else self._markedPositions(replica)
            for replica in range(len(self.states))
        ]
        self._judged = (0, [], None)
        for replica, state in enumerate(self.replicaStates.tolist()):
            self._enter(replica, state)

    def _checkParameters(self, states: Sequence[ThermodynamicState]) -> None:
        """Raise a ValueError if there is no parameter of a name that states have, or it has no effect."""
        for k, (state, membrane, simulation) in enumerate(zip(states, self._membranes, self.simulations)):
            try:
                membrane.require(state.parameters)
            except ValueError as error:
                raise ValueError(f"ReplicaExchange: state {k}: {error}") from None
            potential = next((name for name in state.parameters if name.startswith("chemical_potential")), None)
            if potential is not None and not mutationsOf(simulation.integrator):
                raise ValueError(
                    f"ReplicaExchange: state {k} has the parameter '{potential}', and simulation {k} no mutations of "
                    "species, which it is for"
                )

    def _requireSameComposition(self) -> None:
        """Raise a ValueError if replicas have other numbers of vertices of each species, and no move changes these, or
        moves that do have chemical potentials that differ.
        """
        mutates = [bool(mutationsOf(simulation.integrator)) for simulation in self.simulations]
        if all(mutates):
            self._requireSamePotentials()
            return
        if any(mutates):
            raise ValueError(
                f"ReplicaExchange: simulation {mutates.index(True)} has mutations of species, and simulation "
                f"{mutates.index(False)} none; all must have them, or none"
            )
        first, *others = (
            [] if force is None else np.bincount(force.getVertexSpeciesInContext(simulation.context)).tolist()
            for simulation, force in zip(self.simulations, map(self.membrane, range(len(self.simulations))))
        )
        for k, counts in enumerate(others, 1):
            if counts != first:
                raise ValueError(
                    f"ReplicaExchange: the species of simulation {k} have {counts} vertices, and those of simulation 0 "
                    f"{first}; they must be the same, unless moves of all simulations are mutations"
                )

    def _requireSamePotentials(self) -> None:
        """Raise a ValueError if chemical potentials differ that are not among the parameters of states."""
        force = self.membrane(0)
        for i in range(0 if force is None else force.getNumSpecies()):
            if f"chemical_potential[{i}]" in self.states[0].parameters:
                continue
            moves = [(k, move) for k, s in enumerate(self.simulations) for move in mutationsOf(s.integrator)]
            values = [(k, move.getChemicalPotential(i)._value) for k, move in moves]
            for k, value in values:
                if value != values[0][1]:
                    raise ValueError(
                        f"ReplicaExchange: the chemical potential of species {i} is {value:g} kJ/mol in simulation {k} "
                        f"and {values[0][1]:g} in simulation 0; it must be the same, or one of the states' parameters"
                    )

    def _endRound(self, made: NDArray[np.int64]) -> None:
        """Keep what is to be seen of the replicas, and what they have made, and let them exchange their states."""
        energies = np.array([self._energiesOf(replica) for replica in range(len(self.states))])
        observed = np.array([self._observe(replica) for replica in range(len(self.states))])
        self._made.append(made)
        self._observed.append(observed)
        self._history.append(self.replicaStates.copy())
        self._energies.append(energies)
        self._exchange(energies)

    def _propagate(self, steps: int) -> NDArray[np.int64]:
        """Make steps of every replica, and return what they have tried, in the order of states."""
        integrators = [simulation.integrator for simulation in self.simulations]
        before = [countersOf(integrator) for integrator in integrators]
        self._step(steps)
        made = np.subtract([countersOf(integrator) for integrator in integrators], before)
        return np.array(made[np.argsort(self.replicaStates)])

    def _step(self, steps: int) -> None:
        if self._workers == 1:
            for simulation in self.simulations:
                simulation.step(steps)
        else:
            with ThreadPoolExecutor(self._workers) as pool:
                list(pool.map(lambda simulation: simulation.step(steps), self.simulations))

    def _energiesOf(self, replica: int) -> np.ndarray:
        """Return the reduced energies of a replica in all states."""
        membrane, own = self._membranes[replica], self.states[self.replicaStates[replica]]
        energies = {}
        try:
            for state in self.states:
                key = tuple(state.parameters.values())
                if key not in energies:
                    membrane.takeOn(state.parameters)
                    energies[key] = membrane.energy(state.parameters)
        finally:
            membrane.takeOn(own.parameters)
        reduced = np.array([energies[tuple(state.parameters.values())] / state.thermalEnergy for state in self.states])
        if np.any(np.isnan(reduced)) or not math.isfinite(reduced[self.replicaStates[replica]]):
            raise ValueError(
                f"ReplicaExchange: the reduced energies of replica {replica} are {reduced} after {self.numRounds} "
                f"rounds; they must be numbers, and finite in its own state, {self.replicaStates[replica]}"
            )
        return reduced

    def _observe(self, replica: int) -> list[float]:
        """Return what is to be seen of a replica's membrane, in the order of the columns, which the first one names."""
        force, state = self.membrane(replica), self.states[self.replicaStates[replica]]
        row: dict[str, float] = {}
        if force is not None:
            moment = Moment(self.simulations[replica], force, state.thermalEnergy)
            row = observe(moment, _observed(force, state.parameters), "nm", "kT")
        values = {plainName(head): value for head, value in row.items()}
        self._columns = self._columns or list(values)
        return [values.get(name, math.nan) for name in self._columns]

    def _markedPositions(self, replica: int) -> NDArray[np.float64]:
        """Return where some of the particles are that can move, vertices where there is a membrane."""
        simulation, force = self.simulations[replica], self.membrane(replica)
        count = simulation.system.getNumParticles() if force is None else int(force.getTriangles().max()) + 1
        return markedPositions(simulation.context, np.arange(count))

    def _judge(self) -> None:
        """Judge what has been sampled, unless this has been done."""
        if self._observed and self._judged[0] != self.numRounds:
            verdicts = judging().judgeStates(self)
            self._judged = (self.numRounds, verdicts, judging().judgeExchange(self, verdicts))

    def _exchange(self, u: np.ndarray) -> None:
        uniform = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 0, self.numRounds])).random(
            len(self.states)
        )
        replicaOf = np.argsort(self.replicaStates)
        for i in range((self.numRounds - 1) % 2, len(self.states) - 1, 2):
            a, b = replicaOf[i], replicaOf[i + 1]
            self._attempted[i] += 1
            if uniform[i] < math.exp(min(0, u[a, i] + u[b, i + 1] - u[b, i] - u[a, i + 1])):
                self._accepted[i] += 1
                self._enter(a, i + 1)
                self._enter(b, i)

    def _enter(self, replica: int, index: int) -> None:
        """Put a replica into a state."""
        simulation, state = self.simulations[replica], self.states[index]
        context, integrator = simulation.context, simulation.integrator
        hasChanged = index != self.replicaStates[replica]
        factor = math.sqrt(state.thermalEnergy / self.states[self.replicaStates[replica]].thermalEnergy)
        self.replicaStates[replica] = index
        for move in _movesWithTemperature(integrator):
            move.setTemperature(state.temperature)
        trajectoriesOf(integrator).setStepSize(state.stepSize)
        self._membranes[replica].takeOn(state.parameters)
        if hasChanged:  # dynamics goes on with its velocities, and so do trajectories whose momenta are kept
            context.setVelocities(factor * context.getState(velocities=True).getVelocities(asNumpy=True))
            for move in movesOf(integrator):
                if isinstance(move, HamiltonianTrajectoryIntegrator):
                    move.scaleCoarseVelocities(factor)

    def _check(self, simulations: Sequence[app.Simulation], states: Sequence[ThermodynamicState]) -> None:
        if len(simulations) != len(states) or len(states) < 2:
            raise ValueError(
                f"ReplicaExchange: there are {len(simulations)} simulations and {len(states)} states; there must be "
                "two or more, and as many of the one as of the other"
            )
        if len({id(simulation.context) for simulation in simulations}) < len(simulations):
            raise ValueError("ReplicaExchange: a simulation is given twice; each replica must have one of its own")
        for k, (simulation, state) in enumerate(zip(simulations, states)):
            if not _movesWithTemperature(simulation.integrator):
                raise ValueError(
                    f"ReplicaExchange: the integrator of simulation {k}, a {type(simulation.integrator).__name__}, has "
                    "no temperature"
                )
            if set(state.parameters) != set(states[0].parameters):
                raise ValueError(
                    f"ReplicaExchange: state {k} has the parameters {sorted(state.parameters)}; they must be those of "
                    f"state 0, {sorted(states[0].parameters)}"
                )
            for name, parameter in state.parameters.items():
                if not math.isfinite(parameter):
                    raise ValueError(
                        f"ReplicaExchange: in state {k} the parameter '{name}' is {parameter}; it must be finite"
                    )


def _requireSameEnergies(
    simulations: Sequence[app.Simulation], membranes: Sequence[Membrane], exchanged: Mapping[str, float]
) -> None:
    """Raise a ValueError unless the energies of simulations are the same functions of positions, triangles and the
    parameters that are exchanged, of which those of a state are given.
    """
    first, *others = (_kept(simulation.context, exchanged) for simulation in simulations)
    for k, parameters in enumerate(others, 1):
        for name, value in first.items():
            if parameters.get(name) != value:
                raise ValueError(
                    f"ReplicaExchange: the parameter '{name}' is {parameters.get(name)} in simulation {k} and {value} "
                    "in simulation 0; it must be the same, or one of the states' parameters"
                )
    own, *rest = (
        _forcesOf(simulation.system, membrane.ofForce(exchanged))
        for simulation, membrane in zip(simulations, membranes)
    )
    for k, forces in enumerate(rest, 1):
        if forces != own:
            raise ValueError(
                f"ReplicaExchange: the forces of simulation {k} are not those of simulation 0; they must be the same, "
                "with moduli in kJ/mol that do not depend on the temperature of a state: create all simulations at one "
                "temperature, and the states set theirs"
            )


def _kept(context: mm.Context, exchanged: Iterable[str]) -> dict[str, float]:
    return {name: value for name, value in dict(context.getParameters()).items() if name not in exchanged}


def _forcesOf(system: mm.System, conditions: Mapping[str, float]) -> list[bytes]:
    """Return the forces of a System as texts, without what a Context has of its own: parameters, triangles and the
    species of vertices; its first membrane with some conditions.
    """
    texts, left = [], conditions
    for force in map(mm.XmlSerializer.clone, system.getForces()):
        if HelfrichForce.isinstance(force):
            membrane = HelfrichForce.cast(force)
            putConditions(membrane, left)
            left = {}
            membrane.setVertexSpecies([])
            membrane.setSpontaneousCurvature(1.0)  # a parameter, with which all are written as the same version
        root = ElementTree.fromstring(mm.XmlSerializer.serialize(force))
        for element in root.iter():
            element.attrib = {name: value for name, value in element.attrib.items() if name not in _LIVE}
        for child in [child for child in root if child.tag in _LIVE]:
            root.remove(child)
        texts.append(ElementTree.tostring(root))
    return texts


def _resolved(state: ThermodynamicState, simulation: app.Simulation, membrane: Membrane) -> ThermodynamicState:
    """Return a state in plain numbers, with its step size, its parameters in the order of their names, those of a
    Context by its names.
    """
    stepSize = trajectoriesOf(simulation.integrator).getStepSize() if state.stepSize is None else state.stepSize
    thermalEnergy(state.temperature)  # raises if it is not positive
    return ThermodynamicState(
        float(valueIn(state.temperature, unit.kelvin, "temperature")),
        membrane.named(state.parameters),
        float(valueIn(stepSize, unit.picosecond, "stepSize")),
    )


def _membraneOf(simulation: app.Simulation) -> Membrane:
    forces = simulation.system.getForces()
    force = next((HelfrichForce.cast(force) for force in forces if HelfrichForce.isinstance(force)), None)
    return Membrane(simulation.context, force, simulation.integrator)


def _observed(force: HelfrichForce, parameters: Iterable[str]) -> list[Observable]:
    """Return what a round tells of a membrane: what can be averaged over those that were in a state, with the energies
    of the terms that states change, also where these are off.
    """
    known = observablesOf(conditionNames(force, parameters))
    return [o for o in known if o.inSweep == "mean" or o.target or isTarget(o)]


def _asDict(state: ThermodynamicState) -> dict[str, Any]:
    return {"temperature": state.temperature, "parameters": state.parameters, "stepSize": state.stepSize}


def _movesWithTemperature(integrator: Any) -> list[Any]:
    """Return the moves of an integrator that have a temperature, OpenMM's own integrators too."""
    return [move for move in movesOf(integrator) if hasattr(move, "setTemperature")]


def _read(file: PathLike, replicas: int) -> tuple[dict[str, Any], dict[str, np.ndarray], list[Any]]:
    """Return the data, the arrays and the replicas' States in a file."""
    if not Path(file).exists():
        raise FileNotFoundError(f"there is no file {file}")
    try:
        with zipfile.ZipFile(file) as archive:
            data = json.loads(archive.read("exchange.json"))
            with np.load(io.BytesIO(archive.read("rounds.npz"))) as arrays:
                arrays = dict(arrays)
            states = [
                mm.XmlSerializer.deserialize(archive.read(f"replica{replica}.xml").decode())
                for replica in range(min(replicas, len(data["states"])))
            ]
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError):
        raise ValueError(f"{file} is not a file that ReplicaExchange.save wrote, or is damaged") from None
    if data.get("format") not in FORMATS:
        raise ValueError(f"{file} is of another version's format")
    return data, arrays, states
