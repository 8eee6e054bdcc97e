"""How far runs and sweeps are: bars in a terminal and in Jupyter, lines elsewhere, on standard error."""

import contextlib
import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress as Bar,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from ..analysis.verdict import GOOD
from .grids import coarsePoints

SECONDS_BETWEEN_LINES = 10
SECONDS_BETWEEN_UPDATES = 0.5
WIDE = 120  # columns, of a terminal in which a bar has room for what is seen of the membrane

Own = TypeVar("Own", bound="Bars")


class Bars:
    """Bars on a terminal, and in Jupyter where there are ipywidgets; None elsewhere, and when quiet.

    Each shows what is done, the number of steps, their rate, the time left, and in a wide terminal more: the fields
    "rate" and "text".
    """

    def __init__(self, quiet: bool, console: Console | None = None):
        console = console or Console(stderr=True)
        self._isWide = isWide = console.width >= WIDE
        shown = [
            TextColumn("{task.description}"),
            BarColumn(bar_width=24 if isWide else 12),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(compact=True, elapsed_when_finished=True),
            *([TextColumn("{task.fields[text]}")] if isWide else []),
        ]
        hasWidgets = console.is_jupyter and importlib.util.find_spec("ipywidgets") is not None
        self._bar = Bar(*shown, console=console) if (console.is_terminal or hasWidgets) and not quiet else None
        self._quiet = quiet

    def __enter__(self: Own) -> Own:
        if self._bar:
            self._bar.start()
        return self

    def __exit__(self, *_: Any) -> None:
        if self._bar:
            self._bar.stop()

    def _say(self, text: str) -> None:
        """Print a line, above the bars if there are any."""
        if self._bar:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=sys.stderr, flush=True)


class RunProgress(Bars):
    """A bar for each stage; elsewhere a plain line from time to time; nothing when quiet.  Called with the Study."""

    def __init__(self, quiet: bool = False, console: Console | None = None):
        super().__init__(quiet, console)
        self.words: Callable[[str], str] = str  # what gives notes the words of the user's configuration
        self._stage: Any = None
        self._shownAt = 0.0

    def __call__(self, study: Any) -> None:
        stage, now = study.stage, time.monotonic()
        if self._quiet:
            return
        if self._stage is None:
            for note in study.notes:
                self._say(f"note: {self.words(note)}")
        if stage is not self._stage:
            self._begin(study, now)
        seconds = SECONDS_BETWEEN_UPDATES if self._bar else SECONDS_BETWEEN_LINES
        if not stage.isDone and now < self._shownAt + seconds:
            return
        self._shownAt = now
        rate = f"{self._rate(stage, now)} {stage.unit}s/s"
        level = study.verdicts[study.index].level if stage.isDone and study.index in study.verdicts else ""
        text = f"{study.status()}, {level}" if level else study.status()
        if self._bar:
            isTold = self._isWide or level in ("", GOOD)  # where there is no room for the text, say what is wrong
            title = self._title(study) if isTold else f"{self._title(study)}, {level}"
            self._bar.update(self._task, description=title, completed=stage.position, rate=rate, text=text)
        else:
            count = f"{stage.position}" if stage.isWhole else f"{stage.position} of {stage.steps}"
            self._say(f"{self._title(study)}: {stage.unit} {count}, {self._remaining(stage, now)}{rate}, {text}")

    def _begin(self, study: Any, now: float) -> None:
        self._stage, self._beganAt, self._firstStep = study.stage, now, study.stage.position - 1
        self._shownAt = now - SECONDS_BETWEEN_LINES + 2  # soon, to show that something happens
        if self._bar:
            self._task = self._bar.add_task(
                self._title(study),
                total=None if study.stage.isWhole else study.stage.steps,
                completed=study.stage.position,
                rate="",
                text="",
            )

    @staticmethod
    def _title(study: Any) -> str:
        count = len(study.config.stages)
        return study.stage.title if count == 1 else f"{study.index + 1}/{count} {study.stage.title}"

    def _rate(self, stage: Any, now: float) -> str:
        return f"{(stage.position - self._firstStep) / max(now - self._beganAt, 1e-3):.3g}"

    def _remaining(self, stage: Any, now: float) -> str:
        if stage.isWhole or stage.isDone:
            return ""
        seconds = int((now - self._beganAt) / (stage.position - self._firstStep) * (stage.steps - stage.position))
        return f"{seconds // 60}:{seconds % 60:02d} left, "


class SweepProgress(Bars):
    """A bar for the sweep and one for each point that runs; elsewhere plain lines; nothing when quiet.

    Called with the states of the points.
    """

    def __init__(self, quiet: bool = False, console: Console | None = None):
        super().__init__(quiet, console)
        self._tasks: dict[str, TaskID] = {}
        self._known: dict[str, str] = {}
        self._shownAt = 0.0

    def __call__(self, states: list[Any]) -> None:
        if self._quiet:
            return
        if not self._known:
            self._known = {state.point.name: state.status for state in states}
            for note in coarsePoints([state.point for state in states]):
                self._say(f"note: {note}")
        for state in states:
            if state.status != self._known[state.point.name]:
                self._known[state.point.name] = state.status
                reason = f", {state.verdict}" if state.verdict else f": {state.reason}" if state.reason else ""
                self._say(f"{state.point.name}: {state.status}{reason}")
        if self._bar:
            self._draw(self._bar, states)
        elif time.monotonic() >= self._shownAt + SECONDS_BETWEEN_LINES:
            self._shownAt = time.monotonic()
            running = [
                f"{state.point.name} {state.stage} {state.position}/{state.steps}"
                for state in states
                if state.status == "running"
            ]
            self._say(f"{self._count(states)} of {len(states)} points{''.join('; ' + text for text in running)}")

    def _draw(self, bar: Any, states: list[Any]) -> None:
        self._show(bar, "points", self._count(states), len(states), "")
        for state in states:
            name = state.point.name
            if state.status == "running":
                self._show(bar, name, state.position, state.steps, state.stage)
            elif name in self._tasks:
                bar.remove_task(self._tasks.pop(name))

    def _show(self, bar: Any, name: str, done: int, total: int, text: str) -> None:
        if name not in self._tasks:
            self._tasks[name] = bar.add_task(name, total=total, rate="", text=text)
        bar.update(self._tasks[name], completed=done, total=total, text=text)

    @staticmethod
    def _count(states: list[Any]) -> int:
        return sum(state.status in ("done", "failed") for state in states)


@contextlib.contextmanager
def following(progress: Callable[[Any], None] | bool | None, kind: type[Bars]) -> Iterator[Any]:
    """Lend what is called with a Study, or the points of a sweep: what is given, or, if it is True, bars of a kind."""
    if not isinstance(progress, bool):
        yield progress
        return
    with kind(not progress) as bars:
        yield bars
