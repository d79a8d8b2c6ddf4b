"""Clocks, as ``rclpy.clock``.

In a callback, system time and ROS time are the time of its tag: the same on every run. Elsewhere,
they are what the clock of the machine shows. A ROS clock whose time is *active* shows what a time
source has set last, and so do timers and sleeps by it.
"""

from __future__ import annotations

import time as machine
from collections.abc import Callable
from typing import TYPE_CHECKING

from hprm.ros import _process
from hprm.ros._time_jumps import ClockChange, JumpHandle, JumpThreshold, TimeJump
from hprm.ros.clock_type import ClockType
from hprm.ros.duration import Duration
from hprm.ros.time import Time

if TYPE_CHECKING:
    from hprm.ros.context import Context

__all__ = [
    "Clock",
    "ClockChange",
    "ClockType",
    "JumpHandle",
    "JumpThreshold",
    "ROSClock",
    "TimeJump",
]


class Clock:
    """Tells the time."""

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> Clock:
        """Make a clock, which is a ``ROSClock`` if it tells ROS time."""
        is_ros = cls is Clock and clock_type is ClockType.ROS_TIME
        return object.__new__(ROSClock if is_ros else cls)

    def __init__(self, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> None:
        """Make a clock."""
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        self._clock_type = clock_type
        self._is_steady = clock_type == ClockType.STEADY_TIME
        #: Only a ROS clock's time is set: by a time source, while it is active.
        self._is_active, self._set_to = False, 0
        self._jump_handles: list[JumpHandle] = []
        #: How many threads sleep by it.
        self._sleepers = 0

    @property
    def clock_type(self) -> ClockType:
        """Which time it tells."""
        return self._clock_type

    def __repr__(self) -> str:
        """Return the type."""
        return f"Clock(clock_type={self.clock_type.name})"

    @property
    def is_set(self) -> bool:
        """Whether something sets its time, so that it does not pass by itself."""
        return self._is_active

    def now(self) -> Time:
        """Return the time."""
        return Time(nanoseconds=self._now(), clock_type=self._clock_type)

    def _now(self) -> int:
        if self._is_active:
            return self._set_to
        runtime = _process.current or _process.runtime()
        if self._is_steady and not runtime.is_fast:
            return machine.monotonic_ns()
        return runtime.now()

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: Callable[[], None] | None = None,
        post_callback: Callable[[TimeJump], None] | None = None,
    ) -> JumpHandle:
        """Have functions called before and after each jump of the time that counts.

        Parameters
        ----------
        threshold
            Which jumps count: only ROS time that is active jumps.
        pre_callback
            Is called without arguments, before the time is set.
        post_callback
            Is called with the jump, when the time was set.

        """
        return JumpHandle(
            clock=self,
            threshold=threshold,
            pre_callback=pre_callback,
            post_callback=post_callback,
        )

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Sleep until a time.

        Returns
        -------
        bool
            False if the context was shut down before, or ROS time became active or inactive.

        """
        if until.clock_type != self._clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        return self._sleep(until.nanoseconds - self._now(), context)

    def sleep_for(self, rel_time: Duration, context: Context | None = None) -> bool:
        """Sleep for a time; the result is that of :meth:`sleep_until`."""
        return self._sleep(rel_time.nanoseconds, context)

    def _sleep(self, nanoseconds: int, context: Context | None) -> bool:
        from hprm.ros.exceptions import NotInitializedException
        from hprm.ros.utilities import get_default_context

        context = get_default_context() if context is None else context
        if not context.ok():
            raise NotInitializedException
        was_set, until = self.is_set, self._now() + nanoseconds
        if nanoseconds > 0:

            def is_over() -> bool:
                passed = was_set and self._now() >= until
                return passed or self.is_set != was_set or not context.ok()

            self._sleepers += 1
            try:
                _process.runtime().block(is_over, None if was_set else nanoseconds)
            finally:
                self._sleepers -= 1
        return context.ok() and self.is_set == was_set


class ROSClock(Clock):
    """The clock of nodes."""

    def __init__(self, *, clock_type: ClockType = ClockType.ROS_TIME) -> None:
        """Make a clock whose time is not active."""
        super().__init__(clock_type=clock_type)
        #: What is called with each jump, and the time before it.
        self._followers: list[Callable[[TimeJump, int], None]] = []

    @property
    def ros_time_is_active(self) -> bool:
        """Whether the time is what a time source has set."""
        return self._is_active

    def set_ros_time_override(self, time: Time) -> None:
        """Set the time that the clock shows while ROS time is active."""
        if not isinstance(time, Time):
            raise TypeError(
                f"Time must be specified as rclpy.time.Time. Received type: {type(time)}"
            )
        if not self._is_active:
            self._set_to = time.nanoseconds
            return
        delta = Duration(nanoseconds=time.nanoseconds - self._set_to)
        self._jump(TimeJump(ClockChange.ROS_TIME_NO_CHANGE, delta), set_to=time.nanoseconds)

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        if enabled is not self._is_active:
            change = ClockChange.ROS_TIME_ACTIVATED if enabled else ClockChange.ROS_TIME_DEACTIVATED
            self._jump(TimeJump(change, Duration()), is_active=enabled)

    def _jump(
        self, jump: TimeJump, *, set_to: int | None = None, is_active: bool | None = None
    ) -> None:
        for handle in list(self._jump_handles):
            handle.before(jump)
        before_ns = self._now()
        self._set_to = self._set_to if set_to is None else set_to
        self._is_active = self._is_active if is_active is None else is_active
        for follow in list(self._followers):
            follow(jump, before_ns)
        for handle in list(self._jump_handles):
            handle.after(jump)
        if self._sleepers:
            _process.runtime().wake()

    def _follow(self, follower: Callable[[TimeJump, int], None]) -> None:
        """Have a function called with each jump, before the callbacks of the program."""
        self._followers.append(follower)

    def _unfollow(self, follower: Callable[[TimeJump, int], None]) -> None:
        if follower in self._followers:
            self._followers.remove(follower)
