"""Plot how vesicles come to equilibrium after subdivision: python benchmarks/large_vesicle_plot.py RUNS.jsonl OUT.png

RUNS.jsonl has the lines of benchmarks/large_vesicle.py.  A size that a file has from several calls is taken from the
call with most runs.
"""

import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

PANELS = {"bending": "E_B over its value at last", "defects": "share of vertices without six neighbors"}

LINEAR = 50  # computations, up to which the axis is linear, so that it has 0; beyond it is logarithmic


def valueOf(entry):
    """Return a value and its standard error, if there is one."""
    return entry if isinstance(entry, list) else [entry, 0.0]


def plot(rows, out):
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 4))
    isNew = [row["computations"] == 0 and valueOf(row["defects"])[0] < 0.3 for row in rows]
    sizes = sorted({row["vertices"] for row, new in zip(rows, isNew) if new})  # that come from a subdivision
    for size, color in zip(sizes, plt.cm.viridis(np.linspace(0, 0.9, len(sizes)))):
        mine = [row for row in rows if row["vertices"] == size]
        mine = [row for row in mine if row["runs"] == max(row["runs"] for row in mine)]
        times = [row["computations"] for row in mine]
        for axes, key in zip(panels, PANELS):
            values, errors = np.array([valueOf(row[key]) for row in mine]).T
            scale = values[-1] if key == "bending" else 1
            axes.errorbar(times, values / scale, errors / scale, fmt=".-", lw=1, color=color, label=f"{size:,}")
    for axes, name in zip(panels, PANELS.values()):
        axes.set_xscale("symlog", linthresh=LINEAR, linscale=0.3)
        axes.set_xlim(left=-5)
        axes.set_xticks([0, 100, 1000], ["0", "100", "1,000"])
        axes.set_xticks([*range(10, 100, 10), *range(200, 1000, 100), 2000, 3000], minor=True)
        axes.axvline(LINEAR, color="0.85", lw=1, zorder=0)
        axes.set_xlabel(f"computations of forces since the subdivision, linear to {LINEAR}")
        axes.set_ylabel(name)
    panels[0].legend(title="vertices")
    figure.tight_layout()
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    plot([json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()], sys.argv[2])
