"""Tables: columns of numbers by name, and the files of comma-separated values that hold them.

The first row of a file names its columns, each with its unit, if it has one, in brackets: "area (nm^2)".
"""

import csv
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .display import columnTable
from .files import PathLike, replacing
from .messages import quoted, shortened
from .optional import dataFrame

# Columns without which a run is not to be understood.  Others may hold what is no finite number, of which averages are
# none either, without a warning.
PLACES = ("step", "stage", "window", "equilibrated")
LARGEST_PLACE = 1e15
unwarned = np.errstate(over="ignore", invalid="ignore")


class MissingColumn(ValueError, KeyError):
    """A table has no column of a name."""

    __str__ = ValueError.__str__


class Table(dict[str, NDArray[np.float64]]):
    """Columns of numbers: a dict from names to arrays of equal length.

    Attributes
    ----------
    source : str
        the file that it was read from, for messages
    """

    source = "the table"

    def __missing__(self, name: str) -> NDArray[np.float64]:
        raise MissingColumn(f"{self.source} has no column {quoted(name)}; it has {shortened(', '.join(self))}")

    @classmethod
    def ofRows(cls, rows: Sequence[Mapping[str, float]]) -> "Table":
        """Create a Table from dicts with the same keys, of whose names the units in brackets are left out."""
        return cls(
            (plainName(name), np.array([row[name] for row in rows], dtype=float)) for name in (rows[0] if rows else ())
        )

    @classmethod
    def concatenate(cls, tables: Sequence["Table"]) -> "Table":
        """Create a Table of the rows of several, which have the same columns."""
        return cls((name, np.concatenate([table[name] for table in tables])) for name in tables[0])

    @classmethod
    def read(cls, file: PathLike) -> "Table":
        """Read a file of comma-separated values whose first row names the columns.

        Raises a ValueError if it is not one.
        """
        heads, *rows = _readRows(file) or [[]]
        if not heads:
            raise ValueError(f"{file} is empty; it must hold a table of observables")
        for i, row in enumerate(rows, 2):
            if len(row) != len(heads):
                raise ValueError(f"{file} has {len(row)} values in line {i}; its first line names {len(heads)}")
        try:
            columns = np.array(rows, dtype=float).reshape(-1, len(heads)).T
        except ValueError:
            raise _noNumber(file, heads, rows) from None
        table = cls(zip(map(plainName, heads), columns))
        table.source = str(file)
        for name in filter(table.__contains__, PLACES):
            for i in np.flatnonzero(~(np.abs(table[name]) <= LARGEST_PLACE))[:1]:
                raise ValueError(
                    f"{file}: {name} is {table[name][i]} in line {i + 2}; it must be a number from -1e15 to 1e15"
                )
        return table

    def __repr__(self) -> str:
        return f"<{self.inWords()}: {', '.join(self)}>"

    def inWords(self) -> str:
        """Return what it is, without its columns."""
        return f"Table of {max(map(len, self.values()), default=0)} rows"

    def _repr_html_(self) -> str:
        return columnTable(self)

    def requireRows(self) -> None:
        """Raise a ValueError if the table has no rows."""
        if not all(map(len, self.values())):
            raise ValueError(f"{self.source} has no rows")

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame of the same columns."""
        return dataFrame(self)

    def where(self, chosen: NDArray[Any]) -> "Table":
        """Return a Table of the rows that an array, of booleans or of indices, chooses."""
        table = Table((name, values[chosen]) for name, values in self.items())
        table.source = self.source
        return table

    def write(self, file: PathLike) -> None:
        """Write the table as comma-separated values, replacing a file that exists in a single step."""
        with replacing(file) as part, open(part, "w", newline="", encoding="utf-8") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(self)
            writer.writerows(zip(*(values.tolist() for values in self.values())))


def readHeads(file: PathLike) -> list[str]:
    """Return the heads of the columns of a file, with their units; none if it is empty."""
    return next(iter(_readRows(file, 1)), [])


def _readRows(file: PathLike, most: int | None = None) -> list[list[str]]:
    """Return the rows of a file, or its first ones."""
    with open(file, newline="", encoding="utf-8") as table:
        try:
            return list(itertools.islice(csv.reader(table), most))
        except (UnicodeDecodeError, csv.Error) as error:
            raise ValueError(f"{file} is not a table of comma-separated values: {error}") from None


def _noNumber(file: PathLike, heads: list[str], rows: list[list[str]]) -> ValueError:
    """Return the error that says what in a table is no number."""
    for i, row in enumerate(rows, 2):
        for head, text in zip(heads, row):
            if not _isNumber(text):
                return ValueError(f"{file}: {shortened(head)} is {quoted(text)} in line {i}; it must be a number")
    return ValueError(f"{file} is not a table of numbers")


def _isNumber(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def headOf(name: str, unit: str) -> str:
    """Return the head of a column."""
    return f"{name} ({unit})" if unit else name


def plainName(head: str) -> str:
    """Return the name of a column without its unit."""
    return head.split(" (", 1)[0]


def unitsOf(heads: Iterable[str]) -> dict[str, str]:
    """Return the units of columns by their names, of those that have one."""
    return dict(head.removesuffix(")").split(" (", 1) for head in heads if " (" in head)
