"""What momenta on coarser meshes add to the cost of a step, side by side and in turns.

    python benchmarks/long_waves_cost.py [--subdivisions 4 5 6 7] [--steps 50] [--threads 1]

For each size and precision: nanoseconds of processor time a vertex and step, without and with coarser meshes, of
trajectories that follow each other, and of such as follow a sweep of a tenth of the edges, after which the coarser
meshes are made anew.
"""

import argparse
import time

from long_waves import createScene, ofUnitEdges

import openmmhelfrich as mh

WEIGHTS = (0.0, 2.0)


def timeSteps(move, count, before=None):
    total = 0.0
    for _ in range(count):
        if before is not None:
            before.step(1)
        begin = time.process_time()
        move.step(1)
        total += time.process_time() - begin
    return total / count


def measure(sphere, precision, arguments):
    """Return the least time of a step, by the weight and by whether a sweep came before."""
    scenes, times = {}, {}
    for weight in WEIGHTS:
        scene = argparse.Namespace(
            weight=weight,
            step=7e-4,
            steps=arguments.steps,
            volume=0.99,
            penalty=1e6,
            flips=0.1,
            jitter=0.0,
            refreshment=1,
            tether=[100, 0.85, 1.35],
            precision=precision,
            seed=1,
            threads=arguments.threads,
        )
        scenes[weight] = createScene(scene, sphere)
        scenes[weight][1].getMove(0).step(1)
    scale = 1e9 / len(sphere.vertices) / arguments.steps
    for _ in range(arguments.turns):
        for weight, (_, integrator, _) in scenes.items():
            count = max(2, 40000 // len(sphere.vertices))
            trajectories, flips = integrator.getMove(0), integrator.getMove(1)
            times.setdefault((weight, False), []).append(scale * timeSteps(trajectories, count))
            times.setdefault((weight, True), []).append(scale * timeSteps(trajectories, 2, flips))
    return {key: min(values) for key, values in times.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[4, 5, 6, 7])
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--turns", type=int, default=5)
    arguments = parser.parse_args()
    for subdivisions in arguments.subdivisions:
        sphere = ofUnitEdges(mh.Mesh.icosphere(subdivisions))
        for precision in ("double", "mixed"):
            best = measure(sphere, precision, arguments)
            columns = [f"{best[w, f]:.1f}" for f in (False, True) for w in WEIGHTS]
            ratios = [f"{best[2.0, f] / best[0.0, f]:.2f}" for f in (False, True)]
            print(len(sphere.vertices), precision, *columns, *ratios, flush=True)
