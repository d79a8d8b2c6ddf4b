"""What a process of a session is told: its role, where to meet the others, what to measure."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

VARIABLE = "HPRM_BENCH_SESSION"
"""The environment variable with the session as JSON, for processes whose arguments are not ours."""

MEETING_LIMIT_S = 30.0
_LOOK_EVERY_S = 0.002
T = TypeVar("T")


@dataclass(frozen=True)
class Session:
    """One run of one contender: a hub, and nodes that answer it."""

    name: str
    """Different for each session, and short enough for the name of a segment."""
    transport: str
    nodes: int
    directory: str
    """Empty at the start and removed after the end: for sockets and small files."""
    out: str
    """Where the hub writes its results, a line of JSON for each cell."""
    plan: list[dict[str, Any]]
    largest: int
    """The size in bytes of the longest message."""
    hub_cpu: int | None = None
    node_cpu: int | None = None
    options: dict[str, Any] | None = None
    """What distinguishes the contenders of one transport."""

    @classmethod
    def read(cls, text: str) -> Session:
        """The session that travelled as JSON."""
        return cls(**json.loads(text))

    @classmethod
    def here(cls) -> Session:
        """The session that this process belongs to."""
        return cls.read(os.environ[VARIABLE])

    def option(self, name: str, default: Any = None) -> Any:
        """One of the options of the contender."""
        return (self.options or {}).get(name, default)

    def path(self, name: str) -> str:
        """A file of this session."""
        return str(Path(self.directory) / name)


def pin(cpu: int | None) -> None:
    """Keeps this process, and the threads that it has or will have, on one processor."""
    if cpu is not None:
        for thread in os.listdir("/proc/self/task"):
            os.sched_setaffinity(int(thread), {cpu})


def until(what: str, attempt: Callable[[], T | None]) -> T:
    """Tries until there is a result, for as long as processes may need to meet."""
    deadline = time.monotonic() + MEETING_LIMIT_S
    while (result := attempt()) is None or result is False:
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what}: nothing within {MEETING_LIMIT_S:.0f} s")
        time.sleep(_LOOK_EVERY_S)
    return result
