"""Jumps of time, and what is called at them: what ``rclpy.clock`` has beside clocks."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from types import TracebackType
from typing import TYPE_CHECKING

from hprm.ros.duration import Duration

if TYPE_CHECKING:
    from hprm.ros.clock import Clock


class ClockChange(IntEnum):
    """What has happened to the source of a clock's time."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


class JumpThreshold:
    """Which jumps count."""

    def __init__(
        self,
        *,
        min_forward: Duration | None,
        min_backward: Duration | None,
        on_clock_change: bool = True,
    ) -> None:
        """Take the smallest jumps that count.

        Parameters
        ----------
        min_forward
            A positive duration; without it, no jump forward counts.
        min_backward
            A negative duration; without it, no jump backward counts.
        on_clock_change
            Whether it counts that the source of the time changes.

        """
        if min_forward is not None and min_forward.nanoseconds <= 0:
            raise ValueError("min_forward must be a positive non-zero duration")
        if min_backward is not None and min_backward.nanoseconds >= 0:
            raise ValueError("min_backward must be a negative non-zero duration")
        if min_forward is None and min_backward is None and not on_clock_change:
            raise ValueError("At least one jump threshold must be enabled")
        self.min_forward = min_forward
        self.min_backward = min_backward
        self.on_clock_change = on_clock_change

    def counts(self, jump: TimeJump) -> bool:
        """Return whether a jump counts."""
        if jump.clock_change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED):
            return self.on_clock_change
        forward, backward = self.min_forward, self.min_backward
        return (forward is not None and jump.delta >= forward) or (
            backward is not None and jump.delta <= backward
        )


class TimeJump:
    """A jump of a clock's time."""

    def __init__(self, clock_change: ClockChange, delta: Duration) -> None:
        """Say what has changed, and by how much the time has."""
        if not isinstance(clock_change, ClockChange):
            raise TypeError("clock_change must be an instance of rclpy.clock.ClockChange")
        self._clock_change = clock_change
        self._delta = delta

    @property
    def clock_change(self) -> ClockChange:
        """What has happened to the source of the time."""
        return self._clock_change

    @property
    def delta(self) -> Duration:
        """By how much the time has changed."""
        return self._delta


class JumpHandle:
    """Callbacks for the jumps of a clock, until they are unregistered."""

    def __init__(
        self,
        *,
        clock: Clock,
        threshold: JumpThreshold,
        pre_callback: Callable[[], None] | None,
        post_callback: Callable[[TimeJump], None] | None,
    ) -> None:
        """Have callbacks called before and after each jump that counts."""
        if pre_callback is None and post_callback is None:
            raise ValueError("One of pre_callback or post_callback must be callable")
        if pre_callback is not None and not callable(pre_callback):
            raise ValueError("pre_callback must be callable if given")
        if post_callback is not None and not callable(post_callback):
            raise ValueError("post_callback must be callable if given")
        self._clock = clock
        self._threshold = threshold
        self._pre_callback = pre_callback
        self._post_callback = post_callback
        clock._jump_handles.append(self)

    def unregister(self) -> None:
        """Call back no more."""
        if self in self._clock._jump_handles:
            self._clock._jump_handles.remove(self)

    def before(self, jump: TimeJump) -> None:
        """Call back before a jump, if it counts."""
        if self._pre_callback is not None and self._threshold.counts(jump):
            self._pre_callback()

    def after(self, jump: TimeJump) -> None:
        """Call back after a jump, if it counts."""
        if self._post_callback is not None and self._threshold.counts(jump):
            self._post_callback(jump)

    def __enter__(self) -> JumpHandle:
        """Return the handle."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Unregister the callbacks."""
        self.unregister()
