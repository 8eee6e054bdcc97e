"""How far a run is, on standard error."""
import sys

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress as Bar, TextColumn, TimeRemainingColumn


class Progress:
    """A bar on a terminal, ten plain lines elsewhere, nothing when quiet.  Called with the Simulation and its observables."""

    def __init__(self, steps, quiet):
        self._steps, self._quiet, self._printed = steps, quiet, 0
        columns = (TextColumn("sampling"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.fields[text]}"))
        console = Console(stderr=True)
        self._bar = Bar(*columns, console=console) if console.is_terminal and not quiet else None

    def __enter__(self):
        if self._bar:
            self._bar.start()
            self._task = self._bar.add_task("", total=self._steps, text="")
        return self

    def __exit__(self, *_):
        if self._bar:
            self._bar.stop()

    def __call__(self, simulation, row):
        step, text = row["step"], f"energy {row['energy (kT)']:.0f} kT, accepted {row['acceptance']:.0%}, flips {row['flipAcceptance']:.0%}"
        if self._bar:
            self._bar.update(self._task, completed=step, text=text)
        elif not self._quiet and 10*step//self._steps > self._printed:
            self._printed = 10*step//self._steps
            print(f"step {step} of {self._steps}: {text}", file=sys.stderr, flush=True)
