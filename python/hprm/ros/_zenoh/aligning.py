"""Tags for what comes from elsewhere by the stamps of its headers: a machine that knows no clock.

A message gets as tag its stamp and a stated wait, so the order and the distances of messages are
those of their stamps, if all arrive within the wait. What comes later than that gets the time of
its arrival, and is counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

#: How many nanoseconds a stamp may be ahead of the clock here.
AHEAD_NS = 10_000_000_000


class Aligning:
    """When messages are due.

    Parameters
    ----------
    wait_ns
        How much later than its stamp a message may arrive.
    warn
        Is told of the first message of a topic that is not due by its stamp.

    """

    def __init__(self, wait_ns: int, warn: Callable[[str], None]) -> None:
        """Begin without any messages."""
        self._wait = wait_ns
        self._warn = warn
        self._wrong: Counter[tuple[str, str]] = Counter()

    def due(self, topic: str, message: Any, now: int) -> int:
        """Return at which time a message is due that has arrived now: not before now."""
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0):
            return now
        due = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec) + self._wait
        if due < now:
            self._note(topic, "late", (now - due) / 1e6)
            return now
        if due > now + self._wait + AHEAD_NS:
            self._note(topic, "ahead", (due - self._wait - now) / 1e6)
            return now
        return due

    def report(self) -> None:
        """Say in total which messages were not due by their stamps."""
        for (topic, kind), count in self._wrong.items():
            if count > 1:
                self._warn(f"{count} messages of {topic} {_TOTAL[kind]}")

    def _note(self, topic: str, kind: str, by_ms: float) -> None:
        self._wrong[topic, kind] += 1
        if self._wrong[topic, kind] == 1:
            wait = f"{self._wait / 1e6:g} ms"
            self._warn(_FIRST[kind].format(topic=topic, by=f"{by_ms:.3g} ms", wait=wait))


_FIRST = {
    "late": (
        "a message of {topic} has arrived {by} later than its stamp and the wait of {wait}, so its"
        " tag is the time of its arrival"
    ),
    "ahead": (
        "the stamp of a message of {topic} is {by} ahead of the clock here, so its tag is the time"
        " of its arrival: the clocks of the machines differ"
    ),
}

_TOTAL = {
    "late": "have arrived later than their stamps and the wait",
    "ahead": "had stamps that were ahead of the clock here",
}
