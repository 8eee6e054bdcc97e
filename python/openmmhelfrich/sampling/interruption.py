"""How long steps of an integrator end early: those that would take hours are asked a few times a second.

Signals alone need none of this: their handlers run meanwhile, and an exception that one of them raises, such as a
KeyboardInterrupt, ends the step, which leaves everything as it was before.
"""

import contextlib
import threading
from collections.abc import Callable, Iterator

from .. import helfrich


class StepInterrupted(Exception):
    """A step ended early because it was asked to; everything is as it was before it."""


@contextlib.contextmanager
def interruptible(isToStop: Callable[[], bool]) -> Iterator[None]:
    """Let the steps that this thread makes in the context end by a :class:`StepInterrupted` when a function returns
    True.

    It is called within steps, and must not ask anything of their Context.
    """
    questions = _questions()
    questions.append(isToStop)
    try:
        yield
    finally:
        questions.remove(isToStop)


_ofThread = threading.local()


def _questions() -> list[Callable[[], bool]]:
    if not hasattr(_ofThread, "questions"):
        _ofThread.questions = []
    return _ofThread.questions


def _listen() -> None:
    if any(isToStop() for isToStop in _questions()):
        raise StepInterrupted


helfrich._setStepListener(_listen)
