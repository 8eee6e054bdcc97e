"""Pages made of scripts in cells and of notebooks.

A page shows what stands in the file: pictures are files beside it that the prose shows.
"""

from typing import Any

from cells import cellsOfNotebook, cellsOfScript, pageOfCells
from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx


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


def setup(app: Sphinx) -> dict[str, Any]:
    for suffix, kind, parser in ((".py", "percent", PercentParser), (".ipynb", "notebook", NotebookParser)):
        app.add_source_suffix(suffix, kind)
        app.add_source_parser(parser)
    return {"parallel_read_safe": True}
