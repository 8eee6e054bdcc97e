"""Errors as a user sees them."""

import functools
import resource
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

from ..messages import explain
from .terminal import INTERRUPTED, say, wasInterrupted

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

LEAST_ADDRESS_SPACE = 700_000_000


def friendly(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate a command: what the user can put right ends it with a sentence instead of a traceback."""

    @functools.wraps(command)
    def wrapped(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
        try:
            _requireAddressSpace()
            return command(*arguments, **options)
        except typer.Exit:
            raise
        except (Exception, KeyboardInterrupt) as error:
            if wasInterrupted() or isinstance(error, KeyboardInterrupt):
                say("interrupted")
                raise typer.Exit(INTERRUPTED) from None
            sentence = explain(error)
            if sentence is None:
                raise
            say(sentence)
            raise typer.Exit(1) from None

    return wrapped


def _requireAddressSpace() -> None:
    """Raise a MemoryError if a limit leaves no room for the libraries: some wait for memory for ever."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_ADDRESS_SPACE:
        raise MemoryError(
            f"this command takes {LEAST_ADDRESS_SPACE / 1e6:.0f} MB of addresses at least, and the limit (ulimit -v) "
            f"is {limit / 1e6:.0f} MB"
        )
