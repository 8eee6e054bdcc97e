"""What local breathing moves of a fluid vesicle would bring, beside trajectories with momenta on coarser meshes:

    python benchmarks/breathing.py SUBDIVISIONS [--frames 40] [--widths 1 2 4 8] [--sizes 0.01 0.02 0.05 0.1 0.2]

A breathing move shifts two caps of the vesicle along a random direction n, one outwards and one inwards, so that the
volume stays to first order: x += a n exp(-r^2/2w^2), with r the distance from an axis along n, and n the way from the
center to the cap.  Such a shift changes no r: it is its own reverse with -a, and its Jacobian is 1.  For each width w
and size a, in edges: the probability that the move is accepted, and the mean squared change of all modes of degree 2, 3
and 4 for what it costs, over that of ten trajectories and sweeps, in which inertia is forgotten.  As a cost only the
vertices that move by more than a hundredth of a count, each as in a computation of forces: less than any program could
do.
"""

import argparse
import math

import numpy as np
from long_waves import KT, begin, modesOf

FIRST = {2: 0, 3: 5, 4: 12}  # of each degree's modes
CUTOFF = math.sqrt(2 * math.log(100))  # in widths, where a shift is a hundredth of its size


def squares(change):
    """Return the squared changes of the modes of each degree."""
    return np.array([np.sum(change[first : first + 2 * l + 1] ** 2) for l, first in FIRST.items()])


class Vesicle:
    """A vesicle of edges of length 1, as in long_waves.py."""

    def __init__(self, arguments):
        scene = argparse.Namespace(
            subdivisions=arguments.subdivisions,
            weight=2.0,
            step=2.2e-3 * 4 ** (-0.15 * (arguments.subdivisions - 3)),
            steps=20,
            volume=0.99,
            flips=1,
            seed=arguments.seed,
            jitter=0.2,
            refreshment=0.3,
            penalty=1e6,
            tether=[100, 0.85, 1.35],
            precision="mixed",
            threads=1,
            start=None,
        )
        self.force, self.context, _, self._trajectories, self._flips = begin(scene)

    def step(self):
        """Make a trajectory and a sweep, and return the computations of forces."""
        self._trajectories.step(1)
        self._flips.step(1)
        return self._trajectories.getLastNumSteps()

    def positions(self):
        return self.context.getState(positions=True).getPositions(asNumpy=True)._value

    def modes(self, x):
        return modesOf(x, self.force.getTrianglesInContext(self.context))

    def probability(self, x, before):
        """Return the probability that positions are accepted."""
        self.context.setPositions(x)
        return math.exp(-max(0.0, self.energy() - before) / KT)

    def energy(self):
        return self.context.getState(energy=True).getPotentialEnergy()._value


def breathed(x, width, size, random):
    """Return the positions after a breathing move, and the part of the vertices that move."""
    y, moved, center = x.copy(), 0, x.mean(axis=0)
    radius = np.linalg.norm(x - center, axis=1).mean()
    for a in (size, -size):
        n = random.normal(size=3)
        n /= np.linalg.norm(n)
        height, away = (x - center) @ n, np.linalg.norm(np.cross(x - center, n), axis=1)
        cap = (height > 0.3 * radius) & (away < CUTOFF * width)
        y[cap] += a * np.exp(-(away[cap] ** 2) / (2 * width**2))[:, np.newaxis] * n
        moved += np.sum(cap)
    return y, moved / len(x)


def ofTrajectories(vesicle, count=200, each=10):
    """Return the mean squared changes of the modes in some trajectories and sweeps, for a computation of forces."""
    changes, evaluations, last = np.zeros(3), 0, vesicle.modes(vesicle.positions())
    for _ in range(count):
        evaluations += sum(vesicle.step() for _ in range(each))
        modes = vesicle.modes(vesicle.positions())
        changes += squares(modes - last)
        last = modes
    return changes / evaluations


def ofMoves(vesicle, width, size, frames, random, each=5):
    """Return how often moves are accepted, and the mean squared changes of the modes that they bring for their cost."""
    accepted, changes, cost = [], np.zeros(3), 0.0
    for _ in range(frames):
        vesicle.step()
        x, energy = vesicle.positions(), vesicle.energy()
        modes = vesicle.modes(x)
        for _ in range(each):
            y, part = breathed(x, width, size, random)
            accepted.append(vesicle.probability(y, energy))
            changes += accepted[-1] * squares(vesicle.modes(y) - modes)
            cost += part
        vesicle.context.setPositions(x)
    return np.mean(accepted), changes / cost


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subdivisions", type=int)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--widths", type=float, nargs="+", default=[1, 2, 4, 8], help="in edges")
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.01, 0.02, 0.05, 0.1, 0.2], help="in edges")
    parser.add_argument("--settle", type=int, default=300, help="trajectories before")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    vesicle, random = Vesicle(arguments), np.random.default_rng(arguments.seed)
    for _ in range(arguments.settle):
        vesicle.step()
    trajectories = ofTrajectories(vesicle)
    print("width | size | accepted | l = 2 | l = 3 | l = 4, over those of trajectories for the same cost")
    for width in arguments.widths:
        for size in arguments.sizes:
            accepted, changes = ofMoves(vesicle, width, size, arguments.frames, random)
            ratios = " | ".join(f"{ratio:.2g}" for ratio in changes / trajectories)
            print(f"{width:g} | {size:g} | {accepted:.1%} | {ratios}", flush=True)
