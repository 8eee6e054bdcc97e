"""Pages made of scripts: a Python file with cells between lines of "# %%", or a notebook, becomes a page.

Cells that begin with "# %% [markdown]" are the prose, in comments.  A page shows what stands in the file: pictures are
files beside it that the prose shows.
"""

import json
import re
from typing import Any

from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx

CELL = re.compile(r"^# %%(.*)$", re.MULTILINE)


class PercentParser(MystParser):
    """Reads a script in cells."""

    supported = ("percent",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        super().parse(pageOfCells(cellsOfScript(inputstring)), document)


class NotebookParser(MystParser):
    """Reads a notebook, without its outputs."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        super().parse(pageOfCells(cellsOfNotebook(inputstring)), document)


def cellsOfScript(text: str) -> list[tuple[str, str]]:
    """Return the kind, "markdown" or "code", and the text of each cell; what precedes the first is no cell."""
    _, *parts = CELL.split(text)
    cells = []
    for title, body in zip(parts[::2], parts[1::2], strict=True):
        if "[markdown]" in title:
            lines = (line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines())
            cells.append(("markdown", "\n".join(lines)))
        else:
            cells.append(("code", body.strip()))
    return cells


def cellsOfNotebook(text: str) -> list[tuple[str, str]]:
    """Return the kind and the text of each cell of a notebook."""
    return [(cell["cell_type"], "".join(cell["source"]).strip()) for cell in json.loads(text)["cells"]]


def pageOfCells(cells: list[tuple[str, str]]) -> str:
    """Return the Markdown of a page."""
    parts = (text if kind == "markdown" else f"```python\n{text}\n```" for kind, text in cells if text)
    return "\n\n".join(parts) + "\n"


def setup(app: Sphinx) -> dict[str, Any]:
    for suffix, kind, parser in ((".py", "percent", PercentParser), (".ipynb", "notebook", NotebookParser)):
        app.add_source_suffix(suffix, kind)
        app.add_source_parser(parser)
    return {"parallel_read_safe": True}
