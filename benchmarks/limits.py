"""What is slow in a fluid vesicle whose long waves are fast, in computations of forces, and its laws.

    python benchmarks/limits.py run 3 --evaluations 1e6 [--weight 2] [--tether 50 0.83 1.33] >> limits.jsonl
    python benchmarks/limits.py run 3 --tether 25 0.83 1.4 --firm 50 0.83 1.33    # reweighted to a firmer tether
    python benchmarks/limits.py escapes 2 --volume 0.66 --kappa 10 --stretch 0.6  # from oblate to prolate
    python benchmarks/limits.py proposals 3                                       # flips that also move vertices
    python benchmarks/limits.py laws limits.jsonl

A vesicle of 30 kT with edges of length 1, area and volume held by 1e6 kT.  Each trajectory is followed by a sweep.  One
line of JSON has what was run, and after "results", with standard errors:

orientation    integrated autocorrelation time of the direction of the gyration tensor's deviator
shape          the same of the tensor's greatest eigenvalue, which does not see rotations
bending        the same of the bending energy
edge           in which a vertex diffuses along the surface by an edge: 4Dt = 1
bond           in which a part 1/e of the edges are still there, or there again
flips          accepted, of those attempted
samples        that reweighting to a firmer tether leaves, of those taken
variance       of what the firmer tether adds to the energy, in (kT)^2 a vertex
escape         of an oblate, which becomes a prolate

Times are in computations of forces.
"""

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np
import openmm as mm

import openmmhelfrich as mh
from openmmhelfrich.analysis import autocorrelationTime, vertexDiffusion

KT = 300 * 8.31446261815324e-3
BLOCKS = 4
COSTS = ("orientation", "shape", "bending", "edge", "bond")
APART = 750  # computations of forces from one snapshot of positions and triangles to the next
STRIDE, LAGS = 4, 6  # for diffusion, lags are multiples of STRIDE snapshots


class Chain:
    """A vesicle that has its reduced volume, and its step size."""

    def __init__(self, arguments):
        mesh = mh.Mesh.icosphere(arguments.subdivisions)
        self.mesh = mh.Mesh(mesh.vertices / mesh.edgeLengths.mean(), mesh.triangles)
        self.force = self._createForce(arguments)
        integrator = mh.HybridMonteCarloIntegrator(300, arguments.step, arguments.steps, arguments.flips, 0)
        integrator.setMultilevelWeight(arguments.weight)
        integrator.setMomentumRefreshment(arguments.refreshment)
        integrator.setTrajectoryJitter(0.2)
        integrator.setForcePrecision("mixed")
        integrator.setRandomNumberSeed(arguments.seed)
        system = self.mesh.createSystem(mass=1.0)
        system.addForce(self.force)
        self.context = mm.Context(system, integrator, mm.Platform.getPlatform("CPU"), {"Threads": "1"})
        self.context.setPositions(self._stretched(arguments.stretch))
        self.integrator, self.trajectories, self.flips = integrator, integrator.getMove(0), integrator.getMove(1)
        self.evaluations, self.seconds = 0, 0.0
        self._deflate()
        self._findStep(arguments.aim)

    def _createForce(self, arguments):
        force = mh.HelfrichForce()
        force.setTriangles(self.mesh.triangles)
        force.setBendingModulus(arguments.kappa * KT)
        force.setAreaModulus(1e6 * KT)
        force.setTargetArea(self.mesh.area)
        force.setVolumeModulus(1e6 * KT)
        force.setTargetVolume(arguments.volume * self.mesh.volume)
        modulus, shortest, longest = arguments.tether
        force.setTether(modulus * KT, shortest, longest, 2)
        return force

    def step(self):
        """Make a trajectory and a sweep."""
        begin = time.process_time()
        self.trajectories.step(1)
        self.flips.step(1)
        self.seconds += time.process_time() - begin
        self.evaluations += self.trajectories.getLastNumSteps()

    def positions(self):
        return self.context.getState(positions=True).getPositions(asNumpy=True)._value

    def _stretched(self, factor):
        """Return the vertices of a spheroid of the same area."""
        x = self.mesh.vertices * np.array([factor**-0.5, factor**-0.5, factor])
        return x * math.sqrt(self.mesh.area / mh.Mesh(x, self.mesh.triangles).area)

    def _deflate(self):
        """Reach the volume by little, for a sudden change would crumple the vesicle."""
        target = self.force.getTargetVolume()._value
        reached = mh.Mesh(self.positions(), self.mesh.triangles).volume
        while reached > target * 1.0001:
            reached = max(0.998 * reached, target)
            self.context.setParameter(self.force.getTargetVolumeParameter(), reached)
            for _ in range(3):
                self.step()

    def _findStep(self, aim, rounds=40, tries=15):
        """Move the step size towards the acceptance that is aimed at, ever less; none if that is 0."""
        for n in range(rounds if aim > 0 else 0):
            before = self.trajectories.getNumAccepted()
            for _ in range(tries):
                self.step()
            rate = (self.trajectories.getNumAccepted() - before) / tries
            self.integrator.setStepSize(self.trajectories.getStepSize() * math.exp((rate - aim) / (1 + n / 4)))


def sampled(chain, evaluations, steps):
    """Return gyration tensors' greatest eigenvalues and directions, bending energies, and snapshots, of a run, after a
    fifth of it.
    """
    while chain.evaluations < evaluations / 5:
        chain.step()
    chain.evaluations, chain.seconds = 0, 0.0
    values, directions, energies, snapshots = [], [], [], []
    while chain.evaluations < evaluations:
        for _ in range(max(1, 200 // steps)):
            chain.step()
        x = chain.positions()
        x = x - x.mean(axis=0)
        tensor = x.T @ x / len(x)
        values.append(np.linalg.eigvalsh(tensor)[-1])
        deviator = tensor - np.trace(tensor) / 3 * np.eye(3)
        directions.append((deviator / np.linalg.norm(deviator))[np.triu_indices(3)])
        energies.append(chain.force.getEnergyTermsInContext(chain.context)["bending"]._value / KT)
        if chain.evaluations >= len(snapshots) * APART:
            snapshots.append((x, chain.force.getTrianglesInContext(chain.context)))
    return np.array(values), np.array(directions), np.array(energies), snapshots


def correlationTime(series, each, columns):
    """Return the time and its error by Sokal, in computations of forces, of a series of one vector each."""
    tau = autocorrelationTime(series)
    return [each * tau, each * tau * math.sqrt(20 * tau / (columns * len(series)))]


def meanAndScatter(values):
    return [float(np.mean(values)), float(np.std(values, ddof=1) / math.sqrt(len(values)))]


def leastEvaluations(steps):
    """Return the computations of a run whose blocks have all lags; trajectories may be by a fifth longer."""
    return BLOCKS * (STRIDE * LAGS + 1) * max(APART, 1.2 * steps)


def edgeTime(snapshots, each):
    """Return the time in which 4Dt is 1, from the slope of the mean squared displacement in each of the blocks."""
    times = []
    for block in np.array_split(np.arange(len(snapshots)), BLOCKS):
        chosen = [snapshots[n] for n in block[::STRIDE]]
        result = vertexDiffusion(np.array([x for x, _ in chosen]), [t for _, t in chosen], LAGS)
        half = LAGS // 2
        times.append(STRIDE * each / np.polyfit(result.lags[half:], result.meanSquaredDisplacements[half:], 1)[0])
    return meanAndScatter(times)


def bondTime(snapshots, each):
    """Return the time after which a part 1/e of the edges are there, in the blocks, or None where more always are."""
    edges = [_edgeNumbers(triangles, len(x)) for x, triangles in snapshots]
    times = []
    for block in np.array_split(np.arange(len(edges)), BLOCKS):
        survival = [1.0]
        while survival[-1] > math.exp(-1):
            lag = len(survival)
            if lag > len(block) // 2:
                return None
            pairs = [(edges[n], edges[n + lag]) for n in block[:-lag:STRIDE]]
            survival.append(float(np.mean([np.isin(new, old).mean() for old, new in pairs])))
        before, after = -np.log(survival[-2:])
        times.append(each * (len(survival) - 2 + (1 - before) / (after - before)))
    return meanAndScatter(times)


def _edgeNumbers(triangles, count):
    a, b = triangles.astype(np.int64), np.roll(triangles, 1, axis=1).astype(np.int64)
    return (a * count + b)[a < b]


def tetherEnergy(lengths, modulus, shortest, longest):
    """Return the energy of edges, in kT, with an exponent of 2."""
    short, long = lengths[lengths < shortest], lengths[lengths > longest]
    return modulus * (np.sum(np.exp(short / (short - shortest)) / short**2) + 8 * np.sum((long - longest) ** 2))


def reweighted(snapshots, soft, firm):
    """Return what is left of samples of a soft tether in the ensemble of a firm one, and the variance a vertex."""
    differences = []
    for x, triangles in snapshots:
        edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
        a, b = edges[edges[:, 0] < edges[:, 1]].T
        lengths = np.linalg.norm(x[b] - x[a], axis=1)
        differences.append(tetherEnergy(lengths, *firm) - tetherEnergy(lengths, *soft))
    logs = np.min(differences) - np.array(differences)
    weights = np.exp(logs)
    return {
        "samples": float(weights.sum() ** 2 / np.sum(weights**2) / len(weights)),
        "variance": float(np.var(differences, ddof=1) / len(snapshots[0][0])),
    }


def measure(arguments):
    chain = Chain(arguments)
    moves = chain.trajectories, chain.flips
    before = [(move.getNumAccepted(), move.getNumAttempted()) for move in moves]
    values, directions, energies, snapshots = sampled(chain, arguments.evaluations, arguments.steps)
    rates = [
        (move.getNumAccepted() - accepted) / (move.getNumAttempted() - tried)
        for move, (accepted, tried) in zip(moves, before)
    ]
    each = chain.evaluations / len(values)
    apart = chain.evaluations / len(snapshots)
    return {
        **vars(arguments),
        "vertices": len(chain.mesh.vertices),
        "step": chain.trajectories.getStepSize()._value,
        "accepted": rates[0],
        "seconds": chain.seconds / chain.evaluations,
        "results": {
            "orientation": correlationTime(directions, each, 5),
            "shape": correlationTime(values, each, 1),
            "bending": correlationTime(energies, each, 1),
            "edge": edgeTime(snapshots, apart),
            "bond": bondTime(snapshots, apart),
            "flips": rates[1],
            **(reweighted(snapshots, arguments.tether, arguments.firm) if arguments.firm else {}),
        },
    }


def isProlate(x):
    small, middle, great = np.linalg.eigvalsh(np.cov(x.T))
    return bool(great - middle > 2 * (middle - small))


def measureEscapes(arguments):
    """Return how long oblates take to become prolates: the time of all runs, over those that did."""
    total, escaped, late = 0, 0, 0
    for seed in range(arguments.seed, arguments.seed + arguments.runs):
        chain = Chain(argparse.Namespace(**{**vars(arguments), "seed": seed}))
        chain.evaluations = 0
        late += isProlate(chain.positions())
        while chain.evaluations < arguments.evaluations and not isProlate(chain.positions()):
            chain.step()
        total += chain.evaluations
        escaped += isProlate(chain.positions())
    escape = [total / escaped, total / escaped**1.5] if escaped else None
    return {
        **vars(arguments),
        "vertices": len(chain.mesh.vertices),
        "step": chain.trajectories.getStepSize()._value,
        "results": {"escaped": escaped, "before": late, "escape": escape},
    }


def proposals():
    """Return ways to move vertices with a flip, each its own reverse, with a Jacobian of 1: functions of positions, the
    edge's ends and those of the new one, neighbors, and random numbers.

    Stretched: what joins the ends becomes longer by a factor and what joins the others shorter; of neighbors of the
    four all may follow by a part.
    """

    def drawn(width):
        def move(x, ends, others, neighbors, random):
            four = [*ends, *others]
            return {vertex: width * shift for vertex, shift in zip(four, random.normal(size=(4, 3)))}

        return move

    def stretched(factor, part=0.0):
        def move(x, ends, others, neighbors, random):
            shifts = {}
            for (a, b), change in ((ends, factor - 1), (others, 1 / factor - 1)):
                shifts[b] = change / 2 * (x[b] - x[a])
                shifts[a] = -shifts[b]
            for vertex in [*ends, *others] if part else []:
                for other in neighbors[vertex] - {*ends, *others}:
                    shifts[other] = shifts.get(other, 0) + part * shifts[vertex]
            return shifts

        return move

    return {
        "plain": lambda *_: {},
        **{f"drawn {width}": drawn(width) for width in (0.01, 0.02, 0.05)},
        **{f"stretched {factor}": stretched(factor) for factor in (1.05, 1.1, 1.2, 1.3)},
        **{f"stretched {factor}, neighbors 0.25": stretched(factor, 0.25) for factor in (1.05, 1.1, 1.2)},
    }


class Connectivity:
    """Neighbors, and the triangle and third vertex beside each halfedge."""

    def __init__(self, triangles):
        self.triangles, self.beside, self.neighbors = triangles, {}, {}
        for number, corners in enumerate(triangles.tolist()):
            for a, b, c in (corners, corners[1:] + corners[:1], corners[2:] + corners[:2]):
                self.beside[a, b] = number, c
                self.neighbors.setdefault(a, set()).add(b)

    def flipped(self, a, b):
        """Return the new edge's ends and the triangles, or None if the rules forbid the flip."""
        (f, c), (g, d) = self.beside[a, b], self.beside[b, a]
        if d in self.neighbors[c] or min(len(self.neighbors[a]), len(self.neighbors[b])) <= 3:
            return None
        triangles = self.triangles.copy()
        triangles[f], triangles[g] = (c, a, d), (d, b, c)
        return (c, d), triangles


def acceptanceOf(chain, change, positions, before):
    """Return the probability that positions and triangles are accepted."""
    x = positions.copy()
    for vertex, shift in change.items():
        x[vertex] += shift
    chain.context.setPositions(x)
    after = chain.context.getState(energy=True).getPotentialEnergy()._value
    return math.exp(-max(0.0, after - before) / KT) if math.isfinite(after) else 0.0


def measureProposals(arguments, each=60):
    """Return how often flips are accepted that also move vertices: means over edges drawn from frames of a run."""
    chain = Chain(arguments)
    for _ in range(400):
        chain.step()
    random, moves = np.random.default_rng(arguments.seed), proposals()
    rates = {name: [] for name in moves}
    for _ in range(math.ceil(arguments.attempts / each)):
        for _ in range(5):
            chain.step()
        x, mesh = chain.positions(), Connectivity(chain.force.getTrianglesInContext(chain.context))
        before = chain.context.getState(energy=True).getPotentialEnergy()._value
        halfedges = list(mesh.beside)
        for ends in (halfedges[n] for n in random.integers(len(halfedges), size=each)):
            flip = mesh.flipped(*ends)
            if flip:
                chain.force.setTrianglesInContext(chain.context, flip[1])
            for name, move in moves.items():
                change = move(x, ends, flip[0], mesh.neighbors, random) if flip else None
                rates[name].append(acceptanceOf(chain, change, x, before) if flip else 0.0)
        chain.force.setTrianglesInContext(chain.context, mesh.triangles)
        chain.context.setPositions(x)
    results = {name: [float(np.mean(rate)), float(np.std(rate) / len(rate) ** 0.5)] for name, rate in rates.items()}
    return {**vars(arguments), "vertices": len(chain.mesh.vertices), "results": results}


def printLaws(path):
    """Print the runs of a file as a table, and for each setting and cost the exponent p of N^p."""
    runs = [json.loads(line) for line in Path(path).read_text().splitlines()]
    runs = [run for run in runs if run["command"] == "run"]
    print("vertices | tether, kT | weight | steps | flips | refreshment | accepted | " + " | ".join(COSTS))
    settings = {}
    for run in runs:
        results = run["results"]
        values = " | ".join("{:,.0f} +- {:,.0f}".format(*results[cost]) if results.get(cost) else "-" for cost in COSTS)
        name = "{:g}, {:g}-{:g} | {:g} | {} | {:g} | {:g}".format(
            *run["tether"], run["weight"], run["steps"], run["flips"], run["refreshment"]
        )
        print(f"{run['vertices']} | {name} | {run['accepted']:.0%} | {values} | {results['flips']:.2%} of flips")
        settings.setdefault(name, []).append(run)
    for name, chosen in settings.items():
        for cost in COSTS:
            known = [run for run in chosen if run["results"].get(cost)]
            if len({run["vertices"] for run in known}) > 2:
                print(name, cost, "N^({:.2f} +- {:.2f})".format(*exponent(known, cost)))


def exponent(runs, cost):
    """Return the slope of the logarithm of a cost against that of the number of vertices, and its error."""
    values, errors = np.array([run["results"][cost] for run in runs]).T
    x = np.log([run["vertices"] for run in runs])
    slope, covariance = np.polyfit(x, np.log(values), 1, w=values / errors, cov="unscaled")
    return slope[0], math.sqrt(covariance[0, 0])


def addScene(parser):
    parser.add_argument("subdivisions", type=int)
    parser.add_argument("--evaluations", type=float, default=1e6)
    parser.add_argument("--volume", type=float, default=0.95)
    parser.add_argument("--stretch", type=float, default=1, help="of the sphere to begin with: above 1 for a prolate")
    parser.add_argument("--kappa", type=float, default=30, help="the bending modulus, in kT")
    parser.add_argument("--tether", type=float, nargs=3, default=[50, 0.83, 1.33], help="modulus, in kT, and bounds")
    parser.add_argument("--weight", type=float, default=2)
    parser.add_argument("--step", type=float, default=1.2e-3, help="in ps, to begin with")
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--aim", type=float, default=0.9, help="the acceptance of trajectories; 0 leaves the step")
    parser.add_argument("--flips", type=float, default=0.3, help="attempts in a sweep, of the number of edges")
    parser.add_argument("--refreshment", type=float, default=1)
    parser.add_argument("--seed", type=int, default=1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="measure one scene")
    addScene(run)
    run.add_argument("--firm", type=float, nargs=3, help="a firmer tether, to which samples are reweighted")
    escapes = commands.add_parser("escapes", help="measure how long oblates take to become prolates")
    addScene(escapes)
    escapes.add_argument("--runs", type=int, default=8)
    combined = commands.add_parser("proposals", help="measure how often flips that move vertices are accepted")
    addScene(combined)
    combined.add_argument("--attempts", type=int, default=6000)
    commands.add_parser("laws", help="print what runs found").add_argument("runs", help="a file of lines of JSON")
    arguments = parser.parse_args()
    if arguments.command == "run" and arguments.evaluations < leastEvaluations(arguments.steps):
        least = leastEvaluations(arguments.steps)
        parser.error(
            f"--evaluations is {arguments.evaluations:g}; for --steps {arguments.steps} it must be at least {least:g}"
        )
    measures = {"run": measure, "escapes": measureEscapes, "proposals": measureProposals}
    if arguments.command == "laws":
        printLaws(arguments.runs)
    else:
        print(json.dumps(measures[arguments.command](arguments)), flush=True)


if __name__ == "__main__":
    main()
