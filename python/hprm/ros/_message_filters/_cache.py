"""A filter that remembers the latest messages by their stamps."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from typing import Any, NamedTuple

from hprm.ros._message_filters._simple import SimpleFilter, stamp_of
from hprm.ros.time import Time


class _Entry(NamedTuple):
    stamp: Time
    #: The order of arrival, so that messages with one stamp stay in it.
    number: int
    message: Any


class Cache(SimpleFilter):
    """The messages of a filter with the latest stamps.

    Parameters
    ----------
    f
        The filter that messages come from.
    cache_size
        How many messages are remembered; beyond that, the oldest stamp is forgotten.
    allow_headerless
        Whether messages without a header are remembered, with the time of their arrival.

    """

    def __init__(
        self, f: SimpleFilter, cache_size: int = 1, allow_headerless: bool = False
    ) -> None:
        """Connect the cache to a filter."""
        super().__init__()
        self.cache_size = cache_size
        self.allow_headerless = allow_headerless
        self._entries: list[_Entry] = []
        self._number = 0
        self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:
        """Remember the messages of a filter, too."""
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Remember a message, and forward it."""
        stamp = stamp_of(msg, self.allow_headerless, "message_filters_cache")
        if stamp is None:
            return
        self._number += 1
        insort(self._entries, _Entry(stamp, self._number, msg))
        if len(self._entries) > self.cache_size:
            del self._entries[0]
        self.signalMessage(msg)

    @property
    def cache_msgs(self) -> list[Any]:
        """The messages, by their stamps."""
        return [entry.message for entry in self._entries]

    @property
    def cache_times(self) -> list[Time]:
        """The stamps, the oldest first."""
        return [entry.stamp for entry in self._entries]

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:
        """Return the messages with stamps between two times, which count, too."""
        assert from_stamp <= to_stamp, "the interval ends before it begins"
        times = self.cache_times
        return self.cache_msgs[bisect_left(times, from_stamp) : bisect_right(times, to_stamp)]

    def getElemAfterTime(self, stamp: Time) -> Any:
        """Return the oldest message that is not older than a time, or ``None``."""
        at = bisect_left(self.cache_times, stamp)
        return self._entries[at].message if at < len(self._entries) else None

    def getElemBeforeTime(self, stamp: Time) -> Any:
        """Return the newest message that is not newer than a time, or ``None``."""
        at = bisect_right(self.cache_times, stamp)
        return self._entries[at - 1].message if at else None

    def getLastestTime(self) -> Time | None:
        """Return the newest stamp, or ``None``; the name is that of the package of ROS 2."""
        return self._entries[-1].stamp if self._entries else None

    #: Its name in newer distributions.
    getLatestTime = getLastestTime  # noqa: N815

    def getOldestTime(self) -> Time | None:
        """Return the oldest stamp, or ``None``."""
        return self._entries[0].stamp if self._entries else None

    def getLast(self) -> Any:
        """Return the message with the newest stamp, or ``None``."""
        latest = self.getLastestTime()
        return None if latest is None else self.getElemAfterTime(latest)
