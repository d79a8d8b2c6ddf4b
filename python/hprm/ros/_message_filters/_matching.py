"""Which messages of several inputs belong together: a machine without callbacks and clocks.

Each input has a queue of a bounded length. A message leaves its queue in a set, or because there is
no room for it, and then it is unmatched. So at any time, the messages that an input has received
are those that were matched, those that are unmatched, and those that wait.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any


@dataclass
class Counts:
    """What has become of the messages of one input."""

    received: int = 0
    matched: int = 0
    #: Left the queue without a set: no room, or another message with the same stamp.
    unmatched: int = 0

    @property
    def waiting(self) -> int:
        """Messages that may still be matched."""
        return self.received - self.matched - self.unmatched


class ExactMatching:
    """Messages belong together if they have the same stamp."""

    def __init__(self, inputs: int, queue_size: int) -> None:
        """Begin with empty queues, one for each input."""
        #: The messages that wait, by stamp, in the order of their arrival.
        self.queues: list[dict[int, Any]] = [{} for _ in range(inputs)]
        self.counts = [Counts() for _ in range(inputs)]
        self._queue_size = queue_size

    def add(self, index: int, stamp: int, message: Any) -> list[tuple[Any, ...]]:
        """Take a message of an input, with its stamp; return the sets that it completes."""
        queue, counts = self.queues[index], self.counts[index]
        counts.received += 1
        # A message with the stamp of another one takes its place in the queue.
        counts.unmatched += stamp in queue
        queue[stamp] = message
        while len(queue) > self._queue_size:
            del queue[min(queue)]
            counts.unmatched += 1
        return [self._taken(stamps) for stamps in self._complete(index, stamp)]

    def _complete(self, index: int, stamp: int) -> Iterable[Sequence[int]]:
        if all(stamp in queue for queue in self.queues):
            yield [stamp] * len(self.queues)

    def _taken(self, stamps: Sequence[int]) -> tuple[Any, ...]:
        for counts in self.counts:
            counts.matched += 1
        return tuple(queue.pop(at) for queue, at in zip(self.queues, stamps, strict=True))


class ApproximateMatching(ExactMatching):
    """Messages belong together if all their stamps are less than ``slop`` apart.

    A new message is matched with those whose stamps are nearest to its own. A set is complete when
    its last message has come; no message waits for a better set.
    """

    def __init__(self, inputs: int, queue_size: int, slop: int) -> None:
        """Begin with empty queues; ``slop`` is in nanoseconds."""
        super().__init__(inputs, queue_size)
        self._slop = slop

    def _complete(self, index: int, stamp: int) -> Iterator[Sequence[int]]:
        if stamp not in self.queues[index]:
            return
        near = [
            [stamp] if other == index else self._near(queue, stamp)
            for other, queue in enumerate(self.queues)
        ]
        for stamps in product(*near):
            if max(stamps) - min(stamps) < self._slop:
                yield stamps
                return

    def _near(self, queue: dict[int, Any], stamp: int) -> list[int]:
        """Return the stamps that are not too far away, the nearest ones first."""
        near = [other for other in queue if abs(other - stamp) <= self._slop]
        return sorted(near, key=lambda other: abs(other - stamp))
