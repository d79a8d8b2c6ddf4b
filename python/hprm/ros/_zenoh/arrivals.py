"""What has come from elsewhere, until the hub asks for it: a queue with a bound.

Threads of Zenoh put things into it, and do nothing else. Only messages of topics count for its
bound: those that are too many are lost, and counted.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

#: How many messages may wait, and how many bytes of them.
MESSAGES, BYTES = 10_000, 512 * 2**20


class Arrivals:
    """The queue.

    Parameters
    ----------
    warn
        Is told when messages of a topic are lost for the first time.

    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        """Begin with an empty queue."""
        self._warn = warn
        self._lock = threading.Lock()
        self._waiting: deque[tuple[Any, ...]] = deque()
        self._messages = 0
        self._bytes = 0
        self._is_asked = False
        #: Has the hub call :meth:`take` soon; none until it runs.
        self._wake: Callable[[], None] | None = None
        self.dropped: Counter[str] = Counter()

    def begin(self, wake: Callable[[], None]) -> None:
        """Have ``wake`` called, in any thread, when there is something."""
        with self._lock:
            self._wake = wake
            asks = bool(self._waiting)
            self._is_asked = asks
        if asks:
            wake()

    def message(self, topic: str, payload: bytes, attachment: bytes) -> None:
        """Put a message of a topic."""
        with self._lock:
            is_full = self._messages >= MESSAGES or (
                self._messages > 0 and self._bytes + len(payload) > BYTES
            )
            if is_full:
                self.dropped[topic] += 1
                is_first = self.dropped[topic] == 1
            else:
                self._messages += 1
                self._bytes += len(payload)
        if not is_full:
            self.put("message", topic, payload, attachment)
        elif is_first:
            self._warn(
                f"messages of {topic} from elsewhere are lost: they come faster than the hub"
                " forwards them"
            )

    def put(self, *what: Any) -> None:
        """Put anything else."""
        with self._lock:
            self._waiting.append(what)
            wake = None if self._is_asked else self._wake
            self._is_asked = self._is_asked or wake is not None
        if wake is not None:
            wake()

    def take(self) -> list[tuple[Any, ...]]:
        """Take all that waits."""
        with self._lock:
            taken = list(self._waiting)
            self._waiting.clear()
            self._is_asked = False
            self._messages = self._bytes = 0
        return taken
