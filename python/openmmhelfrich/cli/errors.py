"""Errors as a user sees them."""

import functools
import sys
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def friendly(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate a command: what the user can put right ends it with a sentence instead of a traceback."""

    @functools.wraps(command)
    def wrapped(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
        try:
            return command(*arguments, **options)
        except Exception as error:
            if not _isForTheUser(error):
                raise
            for line in str(error).splitlines():
                print(f"openmm-helfrich: {line}", file=sys.stderr)
            raise typer.Exit(1) from None

    return wrapped


def _isForTheUser(error: Exception) -> bool:
    from openmm import OpenMMException  # here, so that commands that need no OpenMM start fast

    return isinstance(error, (ValueError, OSError, OpenMMException))
