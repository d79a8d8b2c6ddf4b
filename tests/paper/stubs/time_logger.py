"""Stands for the paper's module that keeps when each node began and ended each frame."""

from __future__ import annotations

import json
import time
from pathlib import Path


class TimeLogger:
    """Keeps marks, and writes them down once they are as many as there are steps."""

    def __init__(self, warmup_steps: int, total_steps: int, name: str, save_dir: str) -> None:
        """Has none yet."""
        self._file = Path(save_dir, f"{name}.json")
        self._steps = total_steps
        self._began = 0.0
        self._marks: list[tuple[float, float]] = []

    def start(self) -> None:
        """The first frame begins."""

    def log(self) -> None:
        """A frame is over."""

    def mark_start(self) -> None:
        """A node begins with a frame."""
        self._began = time.time()

    def mark_end(self) -> None:
        """A node is ready with a frame."""
        self._marks.append((self._began, time.time()))
        if len(self._marks) == self._steps:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.write_text(json.dumps(self._marks))
