"""What happens at logical times, and when a reaction is needed for the next of it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from heapq import heappop, heappush


class Alarm:
    """Something that happens at a logical time, or again and again."""

    __slots__ = ("action", "due_ns", "is_on", "period_ns")

    def __init__(self, action: Callable[[], object], period_ns: int = 0) -> None:
        """Call ``action`` when it is due, unless it is cancelled before.

        With a period, it is due again after that if ``action`` returns true.
        """
        self.action = action
        self.period_ns = period_ns
        self.due_ns = 0
        self.is_on = True

    def cancel(self) -> None:
        """Do nothing when it is due."""
        self.is_on = False


class Alarms:
    """All alarms of a process."""

    __slots__ = ("_count", "_heap", "_scheduled")

    def __init__(self) -> None:
        """Begin without alarms."""
        #: When each is due, in their order; those of one time in the order in which they were set.
        self._heap: list[tuple[int, int, Alarm]] = []
        self._count = itertools.count()
        #: For which times a reaction was asked for.
        self._scheduled: set[int] = set()

    def set(self, due_ns: int, alarm: Alarm) -> None:
        """Have an alarm happen at a time."""
        alarm.due_ns = due_ns
        heappush(self._heap, (due_ns, next(self._count), alarm))

    def set_again(self, now: int, alarm: Alarm) -> None:
        """Have one with a period happen again after ``now``, not for what was missed."""
        due_ns, period_ns = alarm.due_ns, alarm.period_ns
        self.set(due_ns + ((now - due_ns) // period_ns + 1) * period_ns, alarm)

    def happen(self, now: int) -> None:
        """Do what is due."""
        heap = self._heap
        self._scheduled.discard(now)
        while heap and heap[0][0] <= now:
            alarm = heappop(heap)[2]
            if alarm.is_on and alarm.action() and alarm.period_ns:
                # From its tag on: no error adds up.
                alarm.due_ns = due_ns = now + alarm.period_ns
                heappush(heap, (due_ns, next(self._count), alarm))

    def next(self) -> int | None:
        """Return for which time a reaction is to be asked for, if that has not happened."""
        heap = self._heap
        while heap and not heap[0][2].is_on:
            heappop(heap)
        if not heap or heap[0][0] in self._scheduled:
            return None
        due_ns = heap[0][0]
        self._scheduled.add(due_ns)
        return due_ns
