"""Averages over the rows of a table of observables."""

import numpy as np
from numpy.typing import NDArray

from ..tables import Table, unwarned
from .observables import OBSERVABLES


def lateRows(table: Table) -> Table:
    """Return the rows of a table over which to average, where the start is forgotten.

    They are those of the last window of a path, as in the table of its averages, or else of the second half of the last
    stage; without what is marked as not equilibrated, unless all of it is.
    """
    last = _lastStage(table)
    hasPath = _hasPath(last)
    if hasPath:
        last = last.where(last["window"] == last["window"][-1])
    late = last.where(np.arange(len(last["step"]) // 2, len(last["step"])))
    equilibrated = _equilibrated(last if hasPath else late)
    return equilibrated if len(equilibrated["step"]) else late


def sampledWindows(table: Table) -> list[Table]:
    """Return the rows of the last stage over which to average, of each window of a path by itself."""
    last = _lastStage(table)
    rows = _equilibrated(last) if _hasPath(last) else lateRows(last)
    windows = rows.get("window", np.zeros(len(rows["step"])))
    return [rows.where(windows == window) for window in np.unique(windows)] or [lateRows(last)]


def _hasPath(stage: Table) -> bool:
    return bool(np.any(stage.get("window", np.zeros(0)) > 0))


def _lastStage(table: Table) -> Table:
    return table.where(table["stage"] == table["stage"][-1]) if "stage" in table else table


def _equilibrated(table: Table) -> Table:
    return table.where(table["equilibrated"] == 1) if "equilibrated" in table else table


@unwarned
def averageWindows(table: Table, lambdas: NDArray[np.float64]) -> Table:
    """Return averages and standard deviations of a table's rows over each window, as a Table with a row for each."""
    labels = {observable.name for observable in OBSERVABLES if not observable.isAveraged}
    rows = []
    for window in np.unique(table["window"]).astype(int):
        chosen = table["window"] == window
        row = {"stage": table["stage"][chosen][0]} if "stage" in table else {}
        row |= {"window": window, "lambda": lambdas[window], "samples": int(chosen.sum())}
        for name in table:
            if name not in labels:
                row[name] = float(table[name][chosen].mean())
                row[name + "Deviation"] = float(table[name][chosen].std())
        rows.append(row)
    return Table.ofRows(rows)
