"""Points in time of one clock, as in ``rclpy.time``."""

from __future__ import annotations

from typing import Any, overload

from hprm.ros._interfaces import interface
from hprm.ros.clock_type import ClockType
from hprm.ros.constants import S_TO_NS
from hprm.ros.duration import Duration

_LIMIT = 1 << 63


class Time:
    """A point in time: a span since the epoch of a kind of clock.

    Only times of one kind of clock are compared and subtracted; others raise ``TypeError``.

    Parameters
    ----------
    seconds
        Whole or fractional seconds since the epoch.
    nanoseconds
        Nanoseconds to add; a fractional part is cut off.
    clock_type
        The kind of clock.

    Raises
    ------
    TypeError
        If ``clock_type`` is no ``ClockType``.
    ValueError
        If one of the numbers is negative.
    OverflowError
        If the sum does not fit into 64 bits.

    """

    __slots__ = ("_clock_type", "_nanoseconds")

    def __init__(
        self,
        *,
        seconds: float = 0,
        nanoseconds: int = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        """Add up seconds and nanoseconds since the epoch."""
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if seconds < 0:
            raise ValueError("Seconds value must not be negative")
        if nanoseconds < 0:
            raise ValueError("Nanoseconds value must not be negative")
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if total >= _LIMIT:
            raise OverflowError("Total nanoseconds value is too large to store in C time point.")
        self._nanoseconds = total
        self._clock_type = clock_type

    @property
    def nanoseconds(self) -> int:
        """The nanoseconds since the epoch of the clock."""
        return self._nanoseconds

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Return whole seconds since the epoch, and the nanoseconds beyond."""
        return divmod(self._nanoseconds, S_TO_NS)

    @property
    def clock_type(self) -> ClockType:
        """The kind of clock."""
        return self._clock_type

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self._nanoseconds}, clock_type={self._clock_type.name})"

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return self._at(self._nanoseconds + other.nanoseconds)
        except OverflowError as error:
            raise OverflowError("Addition leads to overflow in C storage.") from error

    __radd__ = __add__

    @overload
    def __sub__(self, other: Time) -> Duration: ...

    @overload
    def __sub__(self, other: Duration) -> Time: ...

    def __sub__(self, other: Time | Duration) -> Time | Duration:
        if isinstance(other, Time):
            if self._clock_type != other._clock_type:
                raise TypeError("Can't subtract times with different clock types")
            return Duration(nanoseconds=self._nanoseconds - other._nanoseconds)
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return self._at(self._nanoseconds - other.nanoseconds)
        except ValueError as error:
            raise ValueError("Subtraction leads to negative time.") from error

    def _at(self, nanoseconds: int) -> Time:
        return Time(nanoseconds=nanoseconds, clock_type=self._clock_type)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Time):
            return self._nanoseconds == self._comparable(other)
        return NotImplemented

    # As in rclpy: times are compared, not used as keys.
    __hash__ = None  # type: ignore[assignment]

    def __lt__(self, other: object) -> bool:
        if isinstance(other, Time):
            return self._nanoseconds < self._comparable(other)
        return NotImplemented

    def __le__(self, other: object) -> bool:
        if isinstance(other, Time):
            return self._nanoseconds <= self._comparable(other)
        return NotImplemented

    def __gt__(self, other: object) -> bool:
        if isinstance(other, Time):
            return self._nanoseconds > self._comparable(other)
        return NotImplemented

    def __ge__(self, other: object) -> bool:
        if isinstance(other, Time):
            return self._nanoseconds >= self._comparable(other)
        return NotImplemented

    def _comparable(self, other: Time) -> int:
        if self._clock_type != other._clock_type:
            raise TypeError("Can't compare times with different clock types")
        return other._nanoseconds

    def to_msg(self) -> Any:
        """Return the time as a ``builtin_interfaces.msg.Time``; the kind of clock is lost."""
        sec, nanosec = divmod(self._nanoseconds, S_TO_NS)
        return interface("builtin_interfaces.msg", "Time")(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        """Return the time that a ``builtin_interfaces.msg.Time`` states, of a kind of clock.

        Raises ``TypeError`` for anything else.
        """
        if not isinstance(msg, interface("builtin_interfaces.msg", "Time")):
            raise TypeError("Must pass a builtin_interfaces.msg.Time object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)
