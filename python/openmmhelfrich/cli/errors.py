"""Errors as a user sees them."""

import functools
import sys

import openmm as mm
import typer


def friendly(command):
    """Decorate a command: what the user can put right ends it with a sentence instead of a traceback."""

    @functools.wraps(command)
    def wrapped(*arguments, **options):
        try:
            return command(*arguments, **options)
        except (ValueError, OSError, mm.OpenMMException) as error:
            for line in str(error).splitlines():
                print(f"openmm-helfrich: {line}", file=sys.stderr)
            raise typer.Exit(1)

    return wrapped
