"""How results show themselves: a line in a console, a table in a notebook."""

import html
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import Any

MOST = 60  # characters of a value
ROWS = 5  # at each end of a long table


class Brief:
    """A dataclass that shows itself in a line, with numbers in a few digits and arrays by their shape, and as a table
    in a notebook.
    """

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(f'{name} {text}' for name, text in self._parts())}>"

    def _repr_html_(self) -> str:
        return htmlTable(self._parts())

    def _parts(self) -> list[tuple[str, str]]:
        return [(name, briefly(value)) for name, value in vars(self).items() if not name.startswith("_")]


def briefly(value: Any) -> str:
    """Return a value in a few words."""
    if isinstance(value, float):
        return f"{value:.5g}"
    if hasattr(value, "value_in_unit"):
        return f"{briefly(value._value)} {value.unit.get_symbol()}"
    if hasattr(value, "shape"):
        return f"array of shape {value.shape}" if value.shape else f"{value:.5g}"
    if hasattr(value, "inWords"):
        return str(value.inWords())
    if isinstance(value, dict) and len(value) > 0 and type(value) is dict:
        text = ", ".join(f"{key}: {briefly(part)}" for key, part in value.items())
        return text if len(text) <= 4 * MOST else f"{len(value)} items"
    text = str(value) if isinstance(value, str) else repr(value)
    if len(text) <= MOST or isinstance(value, str):
        return text
    return f"{len(value)} items" if hasattr(value, "__len__") else f"a {type(value).__name__}"


def lineText(lines: Iterable[tuple[str, str]]) -> str:
    """Return labels and texts below each other."""
    lines = list(lines)
    width = max([15, *(len(label) for label, _ in lines)])
    return "\n".join(f"{label:>{width}}  {text}" for label, text in lines)


def htmlTable(rows: Iterable[Sequence[str]], heads: Sequence[str] = ()) -> str:
    """Return an HTML table, whose first column is that of labels where it has no heads."""
    top = "<tr>" + "".join(f"<th>{html.escape(head)}</th>" for head in heads) + "</tr>" if heads else ""
    body = "".join("<tr>" + "".join(map(_cell, range(len(row)), row)) + "</tr>" for row in rows)
    return f'<table style="text-align: left">{top}{body}</table>'


def _cell(column: int, text: str) -> str:
    kind = "th" if column == 0 else "td"
    return f'<{kind} style="text-align: left">{html.escape(text)}</{kind}>'


def columnTable(columns: dict[str, Any]) -> str:
    """Return an HTML table of columns of numbers, of whose rows it has the first and the last."""
    count = max(map(len, columns.values()), default=0)
    shown = range(count) if count <= 2 * ROWS + 1 else [*range(ROWS), None, *range(count - ROWS, count)]
    rows = [["…" if i is None else f"{values[i]:.5g}" for values in columns.values()] for i in shown]
    note = f"<p>{count} rows</p>" if count > 2 * ROWS + 1 else ""
    return htmlTable(rows, list(columns)) + note


def drawing() -> Any:
    """Return the module that draws.  It stands above what shows itself, and is imported when something is drawn."""
    return import_module(".pictures.plots", __package__)


def judging() -> Any:
    """Return the module that judges replica exchange, which stands above that, too."""
    return import_module(".analysis.exchanges", __package__)
