"""A large fluid vesicle in equilibrium, from a small one: its mesh is subdivided, and each size runs for a while.

    python benchmarks/large_vesicle.py 5 --first 3 --computations 100000 4000 4000 [--runs 40] [--write vesicle.ply]

begins with an icosphere of FIRST subdivisions and ends with one of SUBDIVISIONS.  At each size it prints lines of JSON:
how many computations of forces there were since the subdivision, and at that time E_B, the share of vertices with other
than six neighbors, and the mean squares of the modes of degree 2, 3 and 4.  The scene is that of long_waves.py.
"""

import argparse
import json
import time

import numpy as np
from long_waves import DEGREES, KT, createScene, modesOf

import openmmhelfrich as mh

# Steps in ps and trajectories' lengths that are accepted at 0.9, by the number of subdivisions, with all momenta anew.
STEPS = {2: 1.8e-3, 3: 2.2e-3, 4: 2.0e-3, 5: 1.6e-3, 6: 1.3e-3, 7: 1.1e-3, 8: 0.9e-3}
LENGTH = 30


class Level:
    """One size of the vesicle."""

    def __init__(self, subdivisions, start, seed, threads):
        settings = dict(weight=2, steps=LENGTH, volume=0.99, flips=1, jitter=0.2, refreshment=1, precision="mixed")
        self.scene = argparse.Namespace(
            **settings,
            subdivisions=subdivisions,
            step=STEPS[subdivisions],
            tether=[100, 0.85, 1.35],
            seed=seed,
            threads=threads,
            start=None,
        )
        mesh, self.force, integrator, self.context = createScene(self.scene)
        self.trajectories, self.flips = integrator.getMove(0), integrator.getMove(1)
        if start is None:
            self.deflate(mesh.volume)
        else:
            self.context.setPositions(start.vertices * (mesh.area / start.area) ** 0.5)
            self.force.setTrianglesInContext(self.context, start.triangles)
            integrator.setStepSize(STEPS[subdivisions] / 3)  # the middles of edges are not yet where they like to be
            self.step(10)
            integrator.setStepSize(STEPS[subdivisions])

    def deflate(self, reached):
        target = self.force.getTargetVolume()._value
        while reached > target:
            reached = max(0.998 * reached, target)
            self.context.setParameter(self.force.getTargetVolumeParameter(), reached)
            self.step(3)

    def step(self, count=1):
        """Make trajectories, each with a sweep, and return the computations of forces."""
        computations = 0
        for _ in range(count):
            self.trajectories.step(1)
            self.flips.step(1)
            computations += self.trajectories.getLastNumSteps()
        return computations

    def counts(self):
        return self.trajectories.getNumAccepted(), self.trajectories.getNumAttempted()

    def mesh(self):
        x = self.context.getState(positions=True).getPositions(asNumpy=True)._value
        return mh.Mesh(x, self.force.getTrianglesInContext(self.context))

    def measure(self):
        mesh = self.mesh()
        modes = modesOf(mesh.vertices, mesh.triangles)
        parts = np.split(modes, np.cumsum([2 * l + 1 for l in DEGREES])[:-1])
        terms = self.force.getEnergyTermsInContext(self.context)
        return {
            "bending": terms["bending"]._value / KT,
            "tether": terms["tether"]._value / KT,
            "defects": float(np.mean(np.bincount(mesh.triangles.ravel()) != 6)),
            **{f"l{l}": float(np.mean(part**2)) for l, part in zip(DEGREES, parts)},
        }

    def run(self, computations, times):
        """Yield what there is at some times, in computations, while the vesicle runs for so many computations."""
        done, begin, counts = 0, time.process_time(), self.counts()
        for at in [*[t for t in times if t < computations], computations]:
            while done < at:
                done += self.step()
            accepted, attempted = (now - then for now, then in zip(self.counts(), counts))
            yield {
                "computations": done,
                "seconds": time.process_time() - begin,
                "accepted": accepted / max(1, attempted),
                **self.measure(),
            }


def main(arguments):
    times = [0, *(round(100 * 2 ** (k / 2)) for k in range(30))]
    for run in range(arguments.runs):
        mesh = None
        levels = range(arguments.first, arguments.subdivisions + 1)
        for subdivisions, computations in zip(levels, arguments.computations, strict=True):
            level = Level(subdivisions, mesh, arguments.seed + run, arguments.threads)
            for row in level.run(computations, times):
                print(json.dumps({"run": run, "subdivisions": subdivisions, **row}), flush=True)
            mesh = level.mesh().subdivided()
            if arguments.write:
                level.mesh().write(arguments.write)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subdivisions", type=int)
    parser.add_argument("--first", type=int, default=3, help="the icosphere to begin with")
    parser.add_argument("--computations", type=float, nargs="+", required=True, help="at each size")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--write", help="a mesh file for the last shape")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    main(parser.parse_args())
