"""The command openmm-helfrich.

Each module of this package holds related commands, in a typer application of its own, and :mod:`.commands` has all of
them.  They are imported only when Ctrl-C is looked after.
"""

from importlib import import_module
from typing import Any

from . import terminal


def __getattr__(name: str) -> Any:
    if name == "app":
        return import_module(".commands", __name__).app
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def main() -> None:
    """Run the command."""
    with terminal.attended():
        from .commands import app

        app()
