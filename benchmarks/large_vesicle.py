"""A large fluid vesicle in equilibrium, from a small one: its mesh is subdivided, and each size runs for a while.

    python benchmarks/large_vesicle.py 642 --computations 100000 4000 4000 [--runs 40] [--write vesicle.ply]

begins with 642 vertices and ends with 10,242, with so many computations of forces at each size.  A line of JSON for
each size and time: how many computations there were since the subdivision, and E_B, the energy of the tether, the share
of vertices with other than six neighbors, the mean squares of the modes of degree 2, 3 and 4, and the elongation, each
with its standard error over the runs.  Where there is no icosphere of so many vertices, it takes
openmm-helfrich[remesh].
The step is found in the first 1,000 computations at each size that begins with a mesh, and then kept.

The scene is that of long_waves.py up to 10,242 vertices.  Beyond, the moduli of area and volume grow with the number of
vertices, whose pressure in the plane would else stretch the area: by 1% at 40,962.  The reduced volume falls by what
more short waves take of the area, a part kT ln(N/10242)/(8 pi kappa), so that long waves stay as they are.
"""

import argparse
import json
import math
import time

import numpy as np
from long_waves import DEGREES, KT, createScene, deflate, elongations, modesOf, ofUnitEdges, setShape

import openmmhelfrich as mh

MEASURED = "bending", "tether", "defects", "l2", "l3", "l4", "elongation"
TIMES = [0, *(round(50 * 2 ** (k / 2)) for k in range(30))]  # in computations
SETTLING = 1000  # computations in which the step is found
ICOSPHERES = {10 * 4**n + 2: n for n in range(2, 9)}


def sphereOf(numVertices):
    if numVertices in ICOSPHERES:
        return ofUnitEdges(mh.Mesh.icosphere(ICOSPHERES[numVertices]))
    return onSphere(mh.Mesh.icosphere(5).remeshed(numVertices))


def onSphere(mesh):
    x = mesh.vertices - mesh.vertices.mean(axis=0)
    return ofUnitEdges(mh.Mesh(x / np.linalg.norm(x, axis=1)[:, np.newaxis], mesh.triangles))


class Level:
    """One size of the vesicle."""

    def __init__(self, sphere, start, arguments, seed):
        larger = len(sphere.vertices) / 10242
        stepSize = 2.2e-3 * (642 / len(sphere.vertices)) ** 0.12  # the longest; accepted at about 0.9
        self.scene = argparse.Namespace(
            weight=2,
            step=stepSize,
            steps=30,
            volume=arguments.volume * (1 - 1.5 * max(0, math.log(larger)) / (8 * math.pi * 30)),
            penalty=1e6 * max(1, larger),
            flips=1,
            jitter=0.2,
            refreshment=arguments.refreshment,
            tether=[100, 0.85, 1.35],
            precision="mixed",
            seed=seed,
            threads=arguments.threads,
        )
        self.force, integrator, self.context = createScene(self.scene, sphere)
        self.trajectories, self.flips = integrator.getMove(0), integrator.getMove(1)
        if start is None:
            deflate(self.force, self.context, sphere.volume, (self.trajectories, self.flips))
        else:
            setShape(self.force, self.context, start)
        self.settling = 0 if start is None else SETTLING
        self.trajectories.setStepSize(stepSize / (1 if start is None else 3))

    def step(self, done):
        """Make a trajectory and a sweep, and return the computations of forces.

        From a mesh steps are short at first, since vertices at the middles of edges are not yet where they like to be.
        They are made longer as long as 0.8 of the trajectories are accepted, and then kept.
        """
        accepted = self.trajectories.getNumAccepted()
        self.trajectories.step(1)
        self.flips.step(1)
        if done < self.settling:
            factor = 1.05 if self.trajectories.getNumAccepted() > accepted else 0.8
            self.trajectories.setStepSize(min(factor * self.trajectories.getStepSize()._value, self.scene.step))
        return self.trajectories.getLastNumSteps()

    def counts(self):
        return self.trajectories.getNumAccepted(), self.trajectories.getNumAttempted()

    def mesh(self):
        x = self.context.getState(positions=True).getPositions(asNumpy=True)._value
        return mh.Mesh(x, self.force.getTrianglesInContext(self.context))

    def measure(self):
        mesh = self.mesh()
        modes = modesOf(mesh.vertices, mesh.triangles)
        parts = np.split(modes, np.cumsum([2 * degree + 1 for degree in DEGREES])[:-1])
        terms = self.force.getEnergyTermsInContext(self.context)
        return {
            "bending": terms["bending"]._value / KT,
            "tether": terms["tether"]._value / KT,
            "defects": float(np.mean(np.bincount(mesh.triangles.ravel()) != 6)),
            **{f"l{degree}": float(np.mean(part**2)) for degree, part in zip(DEGREES, parts)},
            "elongation": float(elongations(modes)),
        }

    def run(self, computations):
        """Yield what there is at some times while the vesicle runs for so many computations."""
        done, begin, counts = 0, time.process_time(), self.counts()
        for at in [*[t for t in TIMES if t < computations], computations]:
            while done < at:
                done += self.step(done)
            accepted, attempted = (now - then for now, then in zip(self.counts(), counts))
            yield {
                "computations": done,
                "seconds": time.process_time() - begin,
                "accepted": accepted / max(1, attempted),
                **self.measure(),
            }


def summary(rows):
    """Return one row for the same size and time of several runs: means, and standard errors of what is measured."""
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    for key in MEASURED if len(rows) > 1 else ():
        error = np.std([row[key] for row in rows], ddof=1) / len(rows) ** 0.5
        means[key] = [means[key], float(error)]
    return {"runs": len(rows), **means}


def main(arguments):
    found = {}
    for run in range(arguments.runs):
        sphere, mesh = sphereOf(arguments.vertices), arguments.start and mh.Mesh.read(arguments.start)
        while mesh and len(sphere.vertices) < len(mesh.vertices):
            sphere = onSphere(sphere.subdivided())
        level = None
        for computations in arguments.computations:
            if level is not None:
                sphere, mesh = onSphere(sphere.subdivided()), level.mesh().subdivided()
            level = Level(sphere, mesh, arguments, arguments.seed + run)
            for at, row in enumerate(level.run(computations)):
                found.setdefault((len(sphere.vertices), at), []).append(row)
            if arguments.write:
                level.mesh().write(arguments.write)
    for (vertices, _), rows in found.items():
        print(json.dumps({"vertices": vertices, **summary(rows)}, default=float), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vertices", type=int, help="to begin with")
    parser.add_argument("--computations", type=float, nargs="+", required=True, help="at each size")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--refreshment", type=float, default=1, help="the part of momenta that is drawn anew")
    parser.add_argument("--start", help="a mesh file to go on with, of a call with the same VERTICES")
    parser.add_argument("--write", help="a mesh file for the last shape")
    parser.add_argument("--volume", type=float, default=0.99, help="the reduced volume at 10,242 vertices and less")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    main(parser.parse_args())
