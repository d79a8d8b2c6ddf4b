"""Timers and rates, as ``rclpy.timer``: they are due at logical times.

A timer whose clock something sets (``use_sim_time``) is due when that is set to its time or a later
one; it is called once then, however many periods have passed. A timer without a period is due again
after each call, at a tag of the clock: it would stop logical time otherwise.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from hprm.ros._alarms import Alarm
from hprm.ros._entity import Entity
from hprm.ros._time_jumps import ClockChange, TimeJump
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.clock import Clock, ROSClock
from hprm.ros.clock_type import ClockType
from hprm.ros.exceptions import InvalidHandle, RCLError, ROSInterruptException
from hprm.ros.time import Time

if TYPE_CHECKING:
    from hprm.ros.context import Context
    from hprm.ros.node import Node


class TimerInfo:
    """When a timer was due, and when it was called: the argument of a callback that takes one."""

    def __init__(
        self,
        *,
        expected_call_time: int = 0,
        actual_call_time: int = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        """Take the times in nanoseconds, by a clock of that type."""
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if expected_call_time < 0 or actual_call_time < 0:
            raise ValueError("call time values must not be negative")
        self._expected_call_time = Time(nanoseconds=expected_call_time, clock_type=clock_type)
        self._actual_call_time = Time(nanoseconds=actual_call_time, clock_type=clock_type)

    @property
    def expected_call_time(self) -> Time:
        """When it was due."""
        return self._expected_call_time

    @property
    def actual_call_time(self) -> Time:
        """When it was called."""
        return self._actual_call_time


class Timer(Entity):
    """Calls back after each period."""

    order = 0

    def __init__(
        self,
        node: Node,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup,
        timer_period_ns: int,
        clock: Clock,
        *,
        autostart: bool = True,
    ) -> None:
        """Begin a period now."""
        _check(timer_period_ns)
        super().__init__(node, callback_group)
        self.callback = callback
        self.clock = clock
        self._period = timer_period_ns
        self._runtime = node._runtime
        self._alarm: Alarm | None = None
        self._last = clock._now()
        self._due = self._is_due_since = 0
        self._is_due = False
        #: Whether its alarm is not set again before the call that is due is taken.
        self._stands = False
        self._cancelled = not autostart
        if isinstance(clock, ROSClock):
            clock._follow(self._jump)
        if autostart:
            self._begin()

    @property
    def callback(self) -> Callable[..., Any] | None:
        """What is called after each period: with a ``TimerInfo`` if a parameter says so."""
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any] | None) -> None:
        self._callback = value
        # Here, and not at each call.
        self.is_plain = not inspect.iscoroutinefunction(value)
        self._info_name = None if value is None else _parameter_of_info(value)

    @property
    def timer_period_ns(self) -> int:
        """The period, in nanoseconds; a new one counts from the next call on."""
        return self._period

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        _check(int(value))
        self._period = int(value)
        if not self._cancelled:
            self._begin()

    def is_ready(self) -> bool:
        """Return whether a call is due."""
        return self._is_due

    def is_canceled(self) -> bool:
        """Return whether it was cancelled."""
        return self._cancelled

    def cancel(self) -> None:
        """Call back no more, until :meth:`reset`."""
        self._cancelled, self._is_due = True, False
        if self._alarm is not None:
            self._alarm.cancel()

    def reset(self) -> None:
        """Begin a period now."""
        self._cancelled, self._is_due = False, False
        self._begin()

    def time_since_last_call(self) -> int:
        """Return the nanoseconds since the last call."""
        return self.clock._now() - self._last

    def time_until_next_call(self) -> int | None:
        """Return the nanoseconds until the next call; none if it is cancelled."""
        if self._cancelled:
            return None
        now = self.clock._now()
        return self._due_after(now) - now

    def destroy(self) -> None:
        """Call back no more."""
        self.cancel()
        if isinstance(self.clock, ROSClock):
            self.clock._unfollow(self._jump)
        super().destroy()

    def has_work(self) -> bool:
        """Return whether a call is due."""
        return self._is_due and not self._destroyed

    def take(self) -> Callable[[], Any]:
        """Take the call that is due."""
        if self._destroyed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")
        self._last = now = self.clock._now()
        was_due = self._is_due_since
        if self._stands:
            self._due = self._due_after(now)
            was_due = self._due - self._period
            self._stands = False
            if self._alarm is not None:
                self._runtime.call_again(self._alarm)
        self._is_due = False
        if not self._period:
            self._runtime.request(self._due_again)
        if self._callback is None:
            return lambda: None
        if self._info_name is None:
            return self._callback
        info = TimerInfo(
            expected_call_time=was_due,
            actual_call_time=now,
            clock_type=self.clock.clock_type,
        )
        return partial(self._callback, **{self._info_name: info})

    def _begin(self, after_ns: int | None = None) -> None:
        """Begin a period, or the rest of one."""
        if self._alarm is not None:
            self._alarm.cancel()
        self._stands = False
        delay = self._period if after_ns is None else after_ns
        self._due = self.clock._now() + delay
        if not self.clock.is_set:
            self._alarm = self._runtime.call_at(delay, self._elapsed, self._period)

    def _elapsed(self) -> bool:
        """Be due, and return whether this is to be called after the next period, too."""
        # At its tag, which is later than it was thought to be if the federation had not begun then.
        self._is_due_since = now = self.clock._now()
        was_due, self._is_due = self._is_due, True
        if self._period:
            self._due = now + self._period
        # Where nothing spins, nothing need happen at each period. Logical time that does not wait
        # for the clock needs tags, though: threads that have blocked may be noticed only there.
        if was_due and not self._runtime.is_fast:
            self._stands = bool(self._period)
            return False
        return True

    def _due_after(self, now: int) -> int:
        """Return when it is due after ``now``: periods have passed, perhaps, as a call waits."""
        if not self._stands or now < self._due:
            return self._due
        return self._due + (1 + (now - self._due) // self._period) * self._period

    def _due_again(self) -> None:
        """Be due again, as a timer without a period is after each call."""
        if not self._cancelled and not self._destroyed and not self._period:
            self._is_due, self._is_due_since = True, self.clock._now()

    def _jump(self, jump: TimeJump, before_ns: int) -> None:
        """Follow a clock that was set, or whose time is no longer what it was."""
        if self._cancelled:
            return
        now = self.clock._now()
        if jump.clock_change is not ClockChange.ROS_TIME_NO_CHANGE:
            # The rest of the period is the same in the new time.
            self._begin(max(self._due_after(before_ns) - before_ns, 0))
        elif now < self._last:
            self._last = now
            self._begin()
        elif self._due <= now:
            self._is_due, self._is_due_since = True, self._due
            missed = (now - self._due) // self._period if self._period else 0
            self._due += (1 + missed) * self._period


def _check(period_ns: int) -> None:
    if period_ns < 0:
        raise RCLError("failed to create timer: timer period must be non-negative")


def _parameter_of_info(callback: Callable[..., Any]) -> str | None:
    """Return the name of the parameter that is annotated as a ``TimerInfo``, if there is one."""
    try:
        parameters = inspect.signature(callback).parameters.values()
    except (TypeError, ValueError):
        return None
    for it in parameters:
        stated = it.annotation
        # Annotations are text where a program says so.
        if stated is TimerInfo or (isinstance(stated, str) and stated.endswith("TimerInfo")):
            return it.name
    return None


class Rate:
    """Sleeps until the next period, in a thread while another one spins."""

    def __init__(self, timer: Timer, *, context: Context) -> None:
        """Sleep until the timer is due."""
        self._timer = timer
        self._context = context
        self._count = 0
        self._destroyed = False
        timer.callback = self._tick

    def sleep(self) -> None:
        """Sleep until the end of the period.

        Raises
        ------
        ROSInterruptException
            If the context is shut down meanwhile.
        RuntimeError
            If it is this thread that would end the period.

        """
        if not self._context.ok():
            raise ROSInterruptException
        if self._destroyed:
            raise RuntimeError("Rate cannot sleep because it has been destroyed")
        count, node = self._count, self._timer._node
        if node._is_spun_by_this_thread():
            raise RuntimeError(
                "sleep() of a rate would wait forever: the rate follows a timer, whose callback"
                " runs in the thread that spins, which is this one\n"
                "  hint: use the clock's sleep_for(), or a MultiThreadedExecutor"
            )
        node._runtime.block(
            lambda: self._count > count or self._destroyed or not self._context.ok(), None
        )
        if self._destroyed and self._count == count:
            raise ROSInterruptException
        if not self._context.ok():
            raise ROSInterruptException

    def destroy(self) -> None:
        """Wake what sleeps, and end."""
        self._destroyed = True
        self._timer._node._runtime.wake()

    def _tick(self) -> None:
        self._count += 1
