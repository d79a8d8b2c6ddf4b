"""How long agent and detector compute for each frame, and what a program says at its end."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

from session import Session


def say(session: Session, told: dict[str, Any]) -> None:
    """Adds a line to the results of a session. Federates say theirs at the same time."""
    line = json.dumps(told).encode() + b"\n"
    descriptor = os.open(session.out, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    try:
        os.write(descriptor, line)
    finally:
        os.close(descriptor)


def say_drive(session: Session, options: Any, drove: str) -> None:
    """Says for the simulator how long each frame took, how far the car has come, and with what."""
    took = json.loads(Path(options.measure).read_text())["latencies_ns"]
    models = f"agent {options.agent}, detector {options.detector}"
    say(session, {"role": "simulator", "latencies_ns": took, "drove": drove, "models": models})


class Clock:
    """Stands for an agent or a detector, and measures one of its methods."""

    def __init__(self, inner: Any, method: str) -> None:
        """Measures calls of this method."""
        self._call = getattr(inner, method)
        self._took: list[int] = []
        setattr(self, method, self._measured)

    def _measured(self, *arguments: Any) -> Any:
        began = time.perf_counter_ns()
        result = self._call(*arguments)
        self._took.append(time.perf_counter_ns() - began)
        return result

    def say(self, session: Session, role: str) -> None:
        """Writes down what was measured."""
        say(session, {"role": role, "computed_ns": self._took})
