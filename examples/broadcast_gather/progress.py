"""One progress bar on a terminal, or one line per step where there is none."""

from __future__ import annotations

import sys
from typing import TextIO

_WIDTH = 40


class ProgressBar:
    """Shows how far a sequence of equal steps has come."""

    def __init__(self, steps: int, stream: TextIO = sys.stderr) -> None:
        """Starts at zero of ``steps`` steps; draws on ``stream``."""
        self._steps = steps
        self._stream = stream
        self._done = 0
        self._terminal = stream.isatty()

    def show(self, label: str, fraction: float) -> None:
        """Draws the current step, which is called ``label``, at this fraction of its own work."""
        if not self._terminal:
            return
        overall = (self._done + fraction) / self._steps
        filled = round(overall * _WIDTH)
        bar = "█" * filled + "░" * (_WIDTH - filled)
        self._stream.write(f"\r{bar} {overall:4.0%}  {label}\x1b[K")
        self._stream.flush()

    def step_done(self, label: str) -> None:
        """Counts the current step as done."""
        self._done += 1
        if not self._terminal:
            self._stream.write(f"{label}: done ({self._done} of {self._steps})\n")

    def close(self) -> None:
        """Takes the bar off the terminal, so that what follows starts on a clean line."""
        if self._terminal:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
