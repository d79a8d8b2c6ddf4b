"""Filters that give out messages of several inputs together."""

from __future__ import annotations

import atexit
import threading
import weakref
from collections.abc import Sequence
from typing import Any

from hprm.ros._message_filters._matching import ApproximateMatching, Counts, ExactMatching
from hprm.ros._message_filters._simple import SimpleFilter, arrival, stamp_of
from hprm.ros.duration import Duration
from hprm.ros.logging import get_logger

_LOGGER = "message_filters"


class TimeSynchronizer(SimpleFilter):
    """Messages of several filters that have the same stamp.

    Callbacks get one message of each input, in the order of the inputs.

    Parameters
    ----------
    fs
        The filters that messages come from.
    queue_size
        How many messages of each input may wait for the others.

    """

    #: Whether messages without a header have the time of their arrival as stamp.
    allow_headerless = False
    _sync_arrival_time = False

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        """Connect the synchronizer to its inputs."""
        super().__init__()
        self._begin(fs, queue_size, ExactMatching(len(fs), queue_size))

    def _begin(self, fs: Sequence[SimpleFilter], queue_size: int, matching: ExactMatching) -> None:
        self.queue_size = queue_size
        self._lock = threading.Lock()
        self._matching = matching
        self._reported: list[int] = [0] * len(fs)
        self._names = [_name(source, index) for index, source in enumerate(fs)]
        self.connectInput(fs)
        _alive.add(self)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:
        """Take the messages of the inputs."""
        self.input_connections = [
            source.registerCallback(self.add, queue, index)
            for index, (source, queue) in enumerate(zip(fs, self.queues, strict=True))
        ]

    @property
    def queues(self) -> list[dict[int, Any]]:
        """The messages of each input that wait, by stamps in nanoseconds."""
        return self._matching.queues

    @property
    def counts(self) -> list[Counts]:
        """For each input, how many messages were received, matched and left unmatched."""
        return self._matching.counts

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Take a message of an input."""
        index = my_queue_index
        if index is None:
            index = next(at for at, queue in enumerate(self.queues) if queue is my_queue)
        if self._sync_arrival_time:
            stamp = arrival()
        else:
            found = stamp_of(msg, self.allow_headerless, "message_filters_approx")
            if found is None:
                counts = self.counts[index]
                counts.received += 1
                counts.unmatched += 1
                return
            stamp = found
        with self._lock:
            sets = self._matching.add(index, stamp.nanoseconds, msg)
        for messages in sets:
            self.signalMessage(*messages)

    def report(self) -> None:
        """Say on the log how many messages of which input are unmatched, if there are new ones."""
        unmatched = [counts.unmatched + counts.waiting for counts in self.counts]
        if unmatched == self._reported:
            return
        self._reported = unmatched
        inputs = ", ".join(
            f"{number} of {counts.received} from {name}"
            for number, counts, name in zip(unmatched, self.counts, self._names, strict=True)
        )
        get_logger(_LOGGER).warning(f"messages without a match: {inputs}")


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Messages of several filters whose stamps differ by less than a limit.

    Parameters
    ----------
    fs
        The filters that messages come from.
    queue_size
        How many messages of each input may wait for the others.
    slop
        The limit, in seconds.
    allow_headerless
        Whether messages without a header take part, with the time of their arrival.
    sync_arrival_time
        Whether all messages take part with the time of their arrival, whatever their headers say.

    """

    def __init__(
        self,
        fs: Sequence[SimpleFilter],
        queue_size: int,
        slop: float,
        allow_headerless: bool = False,
        sync_arrival_time: bool = False,
    ) -> None:
        """Connect the synchronizer to its inputs."""
        SimpleFilter.__init__(self)
        self.slop = Duration(seconds=slop)
        self.allow_headerless = allow_headerless
        self._sync_arrival_time = sync_arrival_time
        matching = ApproximateMatching(len(fs), queue_size, self.slop.nanoseconds)
        self._begin(fs, queue_size, matching)


def _name(source: SimpleFilter, index: int) -> str:
    topic = source.getTopic() if hasattr(source, "getTopic") else None
    return topic if isinstance(topic, str) else f"input {index}"


_alive: weakref.WeakSet[TimeSynchronizer] = weakref.WeakSet()


def report_unmatched() -> None:
    """Have all synchronizers of the process say what is unmatched; what they have said, not again.

    At the end of a process that happens by itself.
    """
    for synchronizer in sorted(_alive, key=lambda one: one._names):
        synchronizer.report()


atexit.register(report_unmatched)
