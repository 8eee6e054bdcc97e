"""Plot the runs of benchmarks/long_waves.py that a file has: python benchmarks/long_waves_plot.py RUNS.jsonl OUT.png

On the left what an independent sample costs, on the right the share of a mode's mean square that a mesh without flips
has, with what a mesh whose elastic energy grows with the number of vertices would have.
"""

import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

DEGREES = {"l2": "tab:blue", "l3": "tab:orange", "l4": "tab:green"}
TETHER = [100, 0.85, 1.35]
LARGE = {"l2": 800, "l3": 2800, "l4": 7000}  # vertices at which bending and the mesh are equally stiff
LAG = 800  # computations in which an elastic mesh forgets
ERROR = 0.13  # the greatest, of a time by the decay of correlation


def plot(runs, out):
    runs = [run for run in runs if run["volume"] >= 0.99 and run.get("tether", TETHER) == TETHER]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.4))
    for degree in DEGREES:
        plotCosts(left, [run for run in runs if not run.get("frozen")], degree)
        plotShares(right, runs, degree)
    left.set_ylabel("computations of forces an independent sample")
    right.set_ylabel("share of the mean square, without flips")
    left.set_yscale("log")
    left.set_ylim(60, 3e6)
    right.set_ylim(0, 1.05)
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("vertices")
        axes.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


def plotCosts(axes, runs, degree):
    isKept, isPlain = (lambda run: run.get("refreshment", 1) < 1), (lambda run: run["weight"] == 0)
    runs = [run for run in runs if isPlain(run) or run["flips"] >= 1]
    kept = [run for run in runs if isKept(run) and not isPlain(run)]
    kinds = (
        ([run for run in runs if isPlain(run) and not isKept(run)], "x", "plain"),
        ([run for run in runs if isPlain(run) and isKept(run)], "+", "plain, momenta kept"),
        ([run for run in runs if not isPlain(run) and not isKept(run)], "s", "coarser meshes"),
        (kept, "o", "coarser meshes, momenta kept"),
    )
    color = DEGREES[degree]
    for chosen, marker, what in kinds:
        sizes = [run["vertices"] for run in chosen]
        costs, errors = np.array([costOf(run[degree]) for run in chosen]).reshape(-1, 2).T
        label = f"degree {degree[1:]}, {what}" if degree == "l2" else f"degree {degree[1:]}" if marker == "o" else None
        fill = color if marker == "o" else "none"
        axes.errorbar(sizes, costs, errors, fmt=marker, color=color, markerfacecolor=fill, alpha=0.8, label=label)
    sizes = np.geomspace(500, 50000)
    first = np.mean([costOf(run[degree])[0] for run in kept if run["vertices"] == 642])
    axes.plot(
        sizes, first * sizes / 642, "--", color=color, lw=0.8, label="in proportion to N" if degree == "l4" else None
    )


def costOf(mode):
    """Return the computations for an independent sample and their standard error: of a long run by the decay of the
    correlation, at the longest lag where it is known well.
    """
    known = [(int(lag), *found) for lag, found in mode.get("decayTimes", {}).items() if found[1] <= ERROR]
    if known:
        _, cost, error = max(known)
        return cost, cost * error
    cost = mode["evaluations"]
    return cost, cost * (10 / mode["samples"]) ** 0.5  # independent samples of a vector of 2l+1 components


def plotShares(axes, runs, degree):
    sizes, shares = [], []
    for run in runs:
        if run.get("frozen"):
            powers = [
                other[degree]["power"]
                for other in runs
                if other["vertices"] == run["vertices"] and not other.get("frozen") and other["weight"] > 0
            ]
            sizes.append(run["vertices"])
            changes = run[degree]["squaredChanges"]
            changed = np.mean(changes[min(changes, key=lambda lag: abs(int(lag) - LAG))])
            shares.append(changed / (2 * np.mean(powers)))
    axes.plot(sizes, shares, "o", color=DEGREES[degree], label=f"degree {degree[1:]}")
    law = np.geomspace(500, 14000)
    label = f"1/(1+N/{LARGE[degree]})"
    axes.plot(law, 1 / (1 + law / LARGE[degree]), "--", color=DEGREES[degree], lw=0.8, label=label)


if __name__ == "__main__":
    plot([json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()], sys.argv[2])
