"""How far a run is, on standard error."""

import sys
import time
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress as Bar,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

if TYPE_CHECKING:  # cli starts without what simulates
    from ..runs.stages import Stage
    from ..runs.studies import Study

SECONDS_BETWEEN_LINES = 10
SECONDS_BETWEEN_UPDATES = 0.5


Own = TypeVar("Own", bound="Bars")


class Bars:
    """Bars on a terminal; None elsewhere, and when quiet.  The text at the end of each is its field "text"."""

    def __init__(self, quiet: bool, *columns: ProgressColumn):
        console = Console(stderr=True)
        shown = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            *columns,
            TextColumn("{task.fields[text]}"),
        )
        self._bar = Bar(*shown, console=console) if console.is_terminal and not quiet else None
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


class Progress(Bars):
    """A bar for each stage on a terminal; elsewhere a plain line for each tenth of a stage, if that is not too often;
    nothing when quiet.  Called with the Study.
    """

    def __init__(self, quiet: bool):
        super().__init__(quiet, TimeRemainingColumn())
        self._stage: Stage | None = None
        self._shownAt = 0.0

    def __call__(self, study: "Study") -> None:
        stage, now = study.stage, time.monotonic()
        if self._quiet:
            return
        if self._stage is None:
            for note in study.notes:
                self._say(f"note: {note}")
        if stage is not self._stage:
            self._begin(study, now)
        seconds = SECONDS_BETWEEN_UPDATES if self._bar else SECONDS_BETWEEN_LINES
        if not stage.isDone and now < self._shownAt + seconds:
            return
        self._shownAt = now
        verdict = f", {study.verdicts[study.index].level}" if stage.isDone and study.index in study.verdicts else ""
        text = f"{self._rate(stage, now)} {stage.unit}s/s, {study.status()}{verdict}"
        if self._bar:
            self._bar.update(self._task, completed=stage.position, text=text)
        else:
            count = f"{stage.position}" if stage.isWhole else f"{stage.position} of {stage.steps}"
            self._say(f"{self._title(study)}: {stage.unit} {count}, {self._remaining(stage, now)}{text}")

    def _begin(self, study: "Study", now: float) -> None:
        self._stage, self._beganAt, self._firstStep = study.stage, now, study.stage.position - 1
        self._shownAt = now - SECONDS_BETWEEN_LINES + 2  # soon, to show that something happens
        if self._bar:
            self._task = self._bar.add_task(
                self._title(study),
                total=None if study.stage.isWhole else study.stage.steps,
                completed=study.stage.position,
                text="",
            )

    @staticmethod
    def _title(study: "Study") -> str:
        count = len(study.config.stages)
        return study.stage.title if count == 1 else f"{study.index + 1}/{count} {study.stage.title}"

    def _rate(self, stage: "Stage", now: float) -> str:
        return f"{(stage.position - self._firstStep) / max(now - self._beganAt, 1e-3):.3g}"

    def _remaining(self, stage: "Stage", now: float) -> str:
        if stage.isWhole or stage.isDone:
            return ""
        seconds = int((now - self._beganAt) / (stage.position - self._firstStep) * (stage.steps - stage.position))
        return f"{seconds // 60}:{seconds % 60:02d} left, "
