"""How long it takes from a frame to its control: all the communication and inference between."""

from __future__ import annotations

import json
import time
from pathlib import Path

PROGRESS = "progress "
_EVERY = 20


class MeasureError(Exception):
    """What was measured cannot be written; the message says where and why."""


class Latencies:
    """Measures frames, and writes the result into a file, if one is named."""

    def __init__(self, file: str, frames: int) -> None:
        self._file, self._frames = file, frames
        self._sent_at = 0
        self._took: list[int] = []
        self._begun = time.perf_counter_ns()
        if file:
            # A name that cannot be written is told before the drive.
            self._write("")

    def frame_sent(self) -> None:
        """A frame has been set."""
        self._sent_at = time.perf_counter_ns()

    def control_came(self) -> None:
        """Its control is there."""
        self._took.append(time.perf_counter_ns() - self._sent_at)
        if self._file and len(self._took) % _EVERY == 0:
            print(f"{PROGRESS}{len(self._took)} {self._frames}", flush=True)

    def save(self) -> None:
        """Writes what was measured."""
        if self._file:
            seconds = (time.perf_counter_ns() - self._begun) / 1e9
            told = {"latencies_ns": self._took, "frames_a_second": len(self._took) / seconds}
            self._write(json.dumps(told))

    def _write(self, text: str) -> None:
        try:
            Path(self._file).write_text(text)
        except OSError as error:
            raise MeasureError(f"{self._file} cannot be written: {error.strerror}") from None
