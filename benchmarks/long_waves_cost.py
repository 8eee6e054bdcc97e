"""What momenta on coarser meshes add to the cost of a step, side by side and in turns.

    python benchmarks/long_waves_cost.py [--subdivisions 4 5 6 7] [--steps 50] [--threads 1]

For each size and precision: nanoseconds of processor time a vertex and step, without and with coarser meshes, of
trajectories that follow each other, and of such as follow a sweep of a tenth of the edges, after which the coarser
meshes are made anew.
"""

import argparse
import time

import numpy as np
from long_waves import createScene

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


def measure(subdivisions, precision, arguments):
    scenes, times = {}, {}
    for weight in WEIGHTS:
        scenes[weight] = createScene(
            argparse.Namespace(
                subdivisions=subdivisions,
                volume=0.99,
                step=7e-4,
                steps=arguments.steps,
                flips=0.1,
                weight=weight,
                seed=1,
                jitter=0.0,
                precision=precision,
                threads=arguments.threads,
            )
        )
        scenes[weight][2].getMove(0).step(1)
    for _ in range(arguments.turns):
        for weight, (mesh, _, integrator, _) in scenes.items():
            scale = 1e9 / len(mesh.vertices) / arguments.steps
            count = max(2, 40000 // len(mesh.vertices))
            trajectories, flips = integrator.getMove(0), integrator.getMove(1)
            times.setdefault((weight, False), []).append(scale * timeSteps(trajectories, count))
            times.setdefault((weight, True), []).append(scale * timeSteps(trajectories, 2, flips))
    best = {key: np.min(values) for key, values in times.items()}
    return len(scenes[0.0][0].vertices), best


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[4, 5, 6, 7])
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--turns", type=int, default=5)
    arguments = parser.parse_args()
    for subdivisions in arguments.subdivisions:
        for precision in ("double", "mixed"):
            size, best = measure(subdivisions, precision, arguments)
            columns = [f"{best[w, f]:.1f}" for f in (False, True) for w in WEIGHTS]
            ratios = [f"{best[2.0, f] / best[0.0, f]:.2f}" for f in (False, True)]
            print(size, precision, *columns, *ratios, flush=True)
