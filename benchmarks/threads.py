"""Time runs on one thread, on two and on the default number, on an idle machine and beside a busy process.

    python benchmarks/threads.py                          # 2562 and 10242 vertices
    python benchmarks/threads.py --sizes 2562 --rounds 9

A step is a trajectory of 100 leapfrog steps, or a sweep over 30% of the edges, as by default in a configuration.  The
cases take turns, and the figure of each is the median of all rounds.  The busy process counts on one of the processors;
the runs have two, which must have nothing else to do.
"""

import argparse
import multiprocessing
import os
import statistics
import time

from benchmark import createContext, createForce, createMembrane, describeMachine, stepSize

PROCESSORS = 2


def keepBusy():
    """Count, for as long as the process exists."""
    while True:
        sum(range(10000))


class Run:
    """A run on a number of threads, or on the default with None."""

    def __init__(self, size, threads):
        import openmmhelfrich as mh

        mesh = createMembrane(size)
        self._integrator = mh.HybridMonteCarloIntegrator(300, stepSize(size), 100, 0.3, 0.5)
        self._integrator.setRandomNumberSeed(1)
        self._context = createContext(mesh, createForce(mesh), self._integrator, "CPU", threads)
        self.time()

    def time(self, pairs=10):
        """Return the time of a trajectory and a sweep, in ms."""
        trajectories, flips = self._integrator.getMove(0), self._integrator.getMove(1)
        start = time.perf_counter()
        for _ in range(pairs):
            trajectories.step(1)
            flips.step(1)
        return (time.perf_counter() - start) / pairs * 1e3


def measure(runs, rounds, isBusy):
    """Return the median times of the runs by the number of their threads."""
    process = multiprocessing.get_context("spawn").Process(target=keepBusy, daemon=True)
    if isBusy:
        process.start()
        time.sleep(1)
    times = [[run.time() for run in runs.values()] for _ in range(rounds)]
    if isBusy:
        process.kill()
        process.join()
    return dict(zip(runs, map(statistics.median, zip(*times))))


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[2562, 10242])
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:PROCESSORS])
    print(describeMachine())
    print("a trajectory and a sweep, ms; in brackets in units of one thread's")
    print(f"{'vertices':>9} {'beside':>13} {'1 thread':>9} {'2 threads':>16} {'default':>16}")
    for size in arguments.sizes:
        runs = {threads: Run(size, threads) for threads in (1, 2, None)}
        for beside in ("nothing", "a busy process"):
            times = measure(runs, arguments.rounds, beside != "nothing")
            ratios = " ".join(f"{times[threads]:>9.2f} ({times[threads] / times[1]:.2f})" for threads in (2, None))
            print(f"{size:>9} {beside:>13} {times[1]:>9.2f} {ratios}", flush=True)


if __name__ == "__main__":
    main()
