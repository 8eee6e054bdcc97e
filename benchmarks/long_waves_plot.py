"""Plot the runs of benchmarks/long_waves.py that a file has: python benchmarks/long_waves_plot.py RUNS.jsonl OUT.png"""

import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

DEGREES = {"l2": "tab:blue", "l3": "tab:orange", "l4": "tab:green"}


def plot(runs, out):
    figure, axes = plt.subplots(figsize=(6.4, 4.4))
    for degree, color in DEGREES.items():
        for isPlain, marker in ((True, "x"), (False, "o")):
            chosen = [run for run in runs if run["volume"] == 0.99 and (run["weight"] == 0) == isPlain]
            if not isPlain:  # earlier runs, with sweeps of 0.3, had coarsest meshes of a few vertices
                chosen = [run for run in chosen if run["flips"] >= 1]
            sizes = np.array([run["vertices"] for run in chosen], float)
            costs = np.array([run[degree]["evaluations"] for run in chosen])
            # Independent samples of a vector of 2l+1 components
            errors = costs * np.sqrt([4 * 2.5 / run[degree]["samples"] for run in chosen])
            label = f"degree {degree[1:]}" + (", plain" if isPlain else "")
            axes.errorbar(sizes, costs, errors, fmt=marker, color=color, alpha=0.8, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("vertices")
    axes.set_ylabel("computations of forces an independent sample")
    sizes = np.array([500, 14000])
    axes.plot(sizes, 1100 * (sizes / 642) ** 0.5, "k--", lw=0.8, label="$N^{1/2}$")
    axes.legend(fontsize=8, ncol=2)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    plot([json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()], sys.argv[2])
