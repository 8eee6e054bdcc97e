"""Cells of scripts and notebooks.

Cells of a script stand between lines of "# %%"; those that begin with "# %% [markdown]" are prose, in comments.
"""

import json
import re

CELL = re.compile(r"^# %%(.*)$", re.MULTILINE)


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
