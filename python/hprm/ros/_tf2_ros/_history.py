"""What is known of one frame: where it was in its parent frame, at which times."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import NamedTuple, TypeAlias

from hprm.ros._tf2_ros._errors import ExtrapolationException
from hprm.ros._tf2_ros._geometry import Rigid, interpolate


class Sample(NamedTuple):
    """A transform from a frame to its parent at a time, in nanoseconds; 0 is that of a static."""

    stamp: int
    parent: str
    transform: Rigid


def seconds(nanoseconds: int) -> str:
    """Return how a time is shown."""
    return f"{nanoseconds / 1e9:.6f}"


class StaticHistory:
    """A frame that never moves: one transform for all times."""

    def __init__(self) -> None:
        """Begin without data."""
        self._sample: Sample | None = None

    def add(self, sample: Sample) -> bool:
        """Replace the transform."""
        self._sample = sample._replace(stamp=0)
        return True

    def latest(self) -> Sample | None:
        """Return the transform."""
        return self._sample

    def at(self, time: int) -> Sample | None:
        """Return the transform, whatever the time is."""
        return self._sample

    def clear(self) -> None:
        """Keep the transform: it is true for all times."""

    def span(self) -> tuple[int, int, int]:
        """Return no oldest and latest time, and that there is one transform."""
        return 0, 0, 1


class MovingHistory:
    """A frame that moves: transforms by time, as far back as the buffer reaches."""

    def __init__(self, cache_time: int) -> None:
        """Begin without data; they are kept for ``cache_time`` nanoseconds."""
        self._cache_time = cache_time
        self._stamps: list[int] = []
        self._samples: list[Sample] = []

    def add(self, sample: Sample) -> bool:
        """Add a transform; return whether it is not too old to be kept."""
        if self._stamps and sample.stamp < self._stamps[-1] - self._cache_time:
            return False
        first = bisect_left(self._stamps, sample.stamp)
        at = bisect_right(self._stamps, sample.stamp)
        if sample not in self._samples[first:at]:
            self._stamps.insert(at, sample.stamp)
            self._samples.insert(at, sample)
        outdated = bisect_left(self._stamps, self._stamps[-1] - self._cache_time)
        del self._stamps[:outdated], self._samples[:outdated]
        return True

    def latest(self) -> Sample | None:
        """Return the transform of the latest time."""
        return self._samples[-1] if self._samples else None

    def at(self, time: int) -> Sample | None:
        """Return the transform at a time, between those that are known; 0 is the latest time.

        Raises ``ExtrapolationException`` if the time is not between two known ones.
        """
        if not self._samples or time == 0:
            return self.latest()
        before = bisect_right(self._stamps, time) - 1
        if before >= 0 and self._stamps[before] == time:
            return self._samples[before]
        if len(self._samples) == 1:
            raise ExtrapolationException(
                f"Lookup would require extrapolation at time {seconds(time)}, "
                f"but only time {seconds(self._stamps[0])} is in the buffer"
            )
        if before < 0:
            raise ExtrapolationException(
                "Lookup would require extrapolation into the past.  Requested time "
                f"{seconds(time)} but the earliest data is at time {seconds(self._stamps[0])}"
            )
        if before == len(self._samples) - 1:
            raise ExtrapolationException(
                "Lookup would require extrapolation into the future.  Requested time "
                f"{seconds(time)} but the latest data is at time {seconds(self._stamps[-1])}"
            )
        older, newer = self._samples[before], self._samples[before + 1]
        if older.parent != newer.parent:
            return older
        ratio = (time - older.stamp) / (newer.stamp - older.stamp)
        return Sample(time, older.parent, interpolate(older.transform, newer.transform, ratio))

    def clear(self) -> None:
        """Forget all transforms."""
        self._stamps.clear()
        self._samples.clear()

    def span(self) -> tuple[int, int, int]:
        """Return the oldest time, the latest time, and how many transforms there are."""
        if not self._stamps:
            return 0, 0, 0
        return self._stamps[0], self._stamps[-1], len(self._stamps)


History: TypeAlias = StaticHistory | MovingHistory
