"""Compare how what large vesicles remember falls with how it falls in smaller ones, from runs of long_waves.py:

    python benchmarks/long_waves_comparison.py RUNS.jsonl [--lags 3200 6400 12800]

A run of a large vesicle is soon too short to know the time of an independent sample by itself.  If its correlations
fall as those of a smaller vesicle do, only later, then that time is the smaller one's, times how much later.  For each
quantity and lag: how many times later as much is left in the larger vesicle, with the means and variances of the
smaller one; then the computations for an independent sample, at the longest lag where that factor is known to 15%.
Runs of one size count together.  The sizes are the two largest of the file.
"""

import argparse
import json
from pathlib import Path

import numpy as np

QUANTITIES = {
    "squares of l = 2": lambda run: run["l2"]["ofShape"],
    "squares of l = 3": lambda run: run["l3"]["ofShape"],
    "squares of l = 4": lambda run: run["l4"]["ofShape"],
    "elongation": lambda run: run["elongation"],
    "modes of l = 3": lambda run: run["l3"],
    "modes of l = 4": lambda run: run["l4"],
}  # where a run has them
ERROR = 0.15  # the greatest, of a factor that a cost is by


class Changes:
    """The mean squared changes of a quantity in the parts of runs of one size, which count by their computations."""

    def __init__(self, runs, find):
        self._parts = []
        for run in runs:
            changes = find(run)["squaredChanges"]
            lags = np.array([int(lag) for lag in changes])
            values = np.array([np.atleast_1d(parts) for parts in changes.values()])
            self._parts += [(lags, part, run["trajectories"] * run["steps"] / len(values.T)) for part in values.T]
        self.lags = self._parts[0][0]

    def at(self, lag):
        """Return the mean squared change after a lag, and the standard error of its logarithm, from the parts."""
        logs = [np.interp(np.log(lag), np.log(lags), np.log(changes)) for lags, changes, _ in self._parts]
        changes, weights = np.exp(logs), np.array([length for *_, length in self._parts])
        mean = np.average(changes, weights=weights, axis=0)
        squares = np.tensordot(weights**2, (changes - mean) ** 2, 1) / weights.sum() ** 2
        n = len(weights)
        return mean, (squares * n / (n - 1) if n > 1 else squares * np.nan) ** 0.5 / mean


def compare(small, large, lag):
    """Return how many times later large has changed as far as after a lag, and the standard error of the logarithm."""
    changes, error = large.at(lag)
    logs = np.log(small.at(small.lags)[0])
    where = np.searchsorted(np.maximum.accumulate(logs), np.log(changes))
    if not 0 < where < len(logs):
        return None
    pair = slice(where - 1, where + 1)
    early = np.exp(np.interp(np.log(changes), logs[pair], np.log(small.lags[pair])))
    slope = np.log(small.at(early * 1.2)[0] / small.at(early / 1.2)[0]) / np.log(1.44)
    return lag / early, np.hypot(error, small.at(early)[1]) / slope


def has(run, find):
    try:
        return "squaredChanges" in find(run)
    except KeyError:
        return False


def report(runs, lags):
    sizes = sorted({run["vertices"] for run in runs})[-2:]
    smaller, larger = ([run for run in runs if run["vertices"] == size] for size in sizes)
    print(f"how many times later as much is left at {sizes[1]} vertices as at {sizes[0]}, after {lags} computations")
    for name, find in QUANTITIES.items():
        if not all(has(run, find) for run in smaller + larger):
            continue
        small, large = Changes(smaller, find), Changes(larger, find)
        factors = [compare(small, large, lag) for lag in lags]
        shown = ["-" if found is None else f"{found[0]:.1f} ± {found[1]:.0%}" for found in factors]
        known = [found for found in factors if found is not None and found[1] <= ERROR]
        print(name, *shown, costs(find(max(smaller, key=lambda run: run["trajectories"])), known), sep=" | ")


def costs(found, known):
    """Return what an independent sample takes at both sizes, in words: at the smaller by the integrated time, or by the
    decay of the correlation where that time is known worse than to 20%.
    """
    small, error = found["evaluations"], (10 / found["samples"]) ** 0.5
    if error > 0.2:
        decays = [(int(lag), *decay) for lag, decay in found["decayTimes"].items() if decay[1] <= ERROR]
        if not decays:
            return "-"
        _, small, error = max(decays)
    words = f"{small:.0f} ± {error:.0%}"
    if known:
        factor, off = known[-1]
        words += f" | {small * factor:.0f} ± {np.hypot(error, off):.0%}"
    return words


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--lags", type=int, nargs="+", default=[3200, 6400, 12800])
    arguments = parser.parse_args()
    runs = [json.loads(line) for line in arguments.runs.read_text().splitlines()]
    sizes = sorted({run.get("vertices", 0) for run in runs})
    if len(sizes) < 2:
        parser.error(f"{arguments.runs} has runs of {sizes} vertices; it must have two sizes")
    report(runs, arguments.lags)
