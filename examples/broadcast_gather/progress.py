"""One progress bar on a terminal, or one line per step where there is none."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn


class ProgressBar:
    """Shows how far a sequence of equal steps has come, on the error stream."""

    def __init__(self, steps: int) -> None:
        """Starts at zero of ``steps`` steps."""
        self._steps = steps
        self._done = 0
        columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"))
        # No thread redraws it: that would disturb what is measured meanwhile.
        self._progress = Progress(
            *columns, console=Console(stderr=True), auto_refresh=False, transient=True
        )
        self._terminal = self._progress.console.is_terminal
        self._task = self._progress.add_task("", total=steps)
        if self._terminal:
            self._progress.start()

    def show(self, label: str, fraction: float) -> None:
        """Draws the current step, which is called ``label``, at this fraction of its own work."""
        if self._terminal:
            completed = self._done + fraction
            self._progress.update(self._task, completed=completed, description=label, refresh=True)

    def step_done(self, label: str) -> None:
        """Counts the current step as done."""
        self._done += 1
        if not self._terminal:
            self._progress.console.print(f"{label}: done ({self._done} of {self._steps})")

    def close(self) -> None:
        """Takes the bar off the terminal, so that what follows starts on a clean line."""
        if self._terminal:
            self._progress.stop()
