#!/usr/bin/env python3
"""Time remeshing, and say what comes of it.

    python benchmarks/remeshing.py [--vertices N ...] [--repeat 1]

Each surface, an icosphere of as many vertices or fewer, is made anew with N vertices in a process of its own.  Takes
openmm-helfrich[remesh].
"""

import argparse
import json
import math
import resource
import statistics
import subprocess
import sys
import time

import openmmhelfrich as mh


def measure(number: int) -> dict[str, float]:
    """Remesh an icosphere and return the seconds of the clock and of processors, GiB, and the range of edges."""
    mesh = mh.Mesh.icosphere(min(7, max(2, int(math.log(number / 10, 4)))))
    start, used = time.perf_counter(), time.process_time()
    made = mesh.remeshed(number)
    seconds, processors = time.perf_counter() - start, time.process_time() - used
    lengths = made.edgeLengths / made.edgeLengths.mean()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {
        "input": len(mesh.vertices),
        "seconds": seconds,
        "processors": processors,
        "memory": memory,
        "shortest": float(lengths.min()),
        "longest": float(lengths.max()),
    }


def main() -> None:
    """Print a table, or, as the process of one measurement, its result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vertices", type=int, nargs="+", default=[5000, 50000, 500000])
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(options.one)))
        return
    print("| vertices | of the input | time, s | processor time, s | memory, GiB | edges over their mean |")
    print("|--:|--:|--:|--:|--:|--:|")
    for number in options.vertices:
        command = [sys.executable, __file__, "--one", str(number)]
        runs = [
            json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            for _ in range(options.repeat)
        ]
        median = {name: statistics.median(run[name] for run in runs) for name in runs[0]}
        print(
            f"| {number:,} | {median['input']:,.0f} | {median['seconds']:.1f} | {median['processors']:.1f} | "
            f"{median['memory']:.2f} | {median['shortest']:.2f} to {median['longest']:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
