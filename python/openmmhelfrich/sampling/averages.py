"""Averages over the rows of a table of observables."""

import numpy as np
from numpy.typing import NDArray

from ..tables import Table
from .observables import OBSERVABLES


def lateRows(table: Table) -> Table:
    """Return the rows of a table over which to average, where the start is forgotten.

    They are the second half of the last stage, or of its last window, without what is marked as not equilibrated,
    unless all of it is.
    """
    last = np.ones(len(table["step"]), dtype=bool)
    for name in ("stage", "window"):
        if name in table:
            last &= table[name] == table[name][-1]
    late = table.where(np.flatnonzero(last)[np.count_nonzero(last) // 2 :])
    equilibrated = late.get("equilibrated", np.ones(0)) == 1
    return late.where(equilibrated) if np.any(equilibrated) else late


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
