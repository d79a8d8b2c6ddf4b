"""Durations: spans of time in nanoseconds, as in ``rclpy.duration``."""

from __future__ import annotations

import math
from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros.constants import S_TO_NS

_LIMIT = 1 << 63


class Duration:
    """A span of time, which may be negative.

    Parameters
    ----------
    seconds
        Whole or fractional seconds.
    nanoseconds
        Nanoseconds to add; a fractional part is cut off.

    Raises
    ------
    OverflowError
        If the sum does not fit into 64 bits.

    """

    __slots__ = ("_nanoseconds",)

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        """Add up seconds and nanoseconds."""
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not -_LIMIT <= total < _LIMIT:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._nanoseconds = total

    @property
    def nanoseconds(self) -> int:
        """The whole span in nanoseconds."""
        return self._nanoseconds

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._nanoseconds})"

    def __str__(self) -> str:
        if self._nanoseconds == Infinite._nanoseconds:
            return "Infinite"
        return f"{self._nanoseconds} nanoseconds"

    def __add__(self, other: Duration) -> Duration:
        if isinstance(other, Duration):
            return Duration(nanoseconds=self._nanoseconds + other._nanoseconds)
        return NotImplemented

    def __sub__(self, other: Duration) -> Duration:
        if isinstance(other, Duration):
            return Duration(nanoseconds=self._nanoseconds - other._nanoseconds)
        return NotImplemented

    def __mul__(self, other: float) -> Duration:
        if isinstance(other, int):
            return Duration(nanoseconds=self._nanoseconds * other)
        if not isinstance(other, float):
            return NotImplemented
        if math.isfinite(other):
            return Duration(nanoseconds=int(self._nanoseconds * other))
        if other == math.inf:
            return Infinite
        raise ValueError("Can't multiply duration with nan")

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Duration):
            return self._nanoseconds == other._nanoseconds
        return NotImplemented

    # As in rclpy: durations are compared, not used as keys.
    __hash__ = None  # type: ignore[assignment]

    def __lt__(self, other: object) -> bool:
        if isinstance(other, Duration):
            return self._nanoseconds < other._nanoseconds
        return NotImplemented

    def __le__(self, other: object) -> bool:
        if isinstance(other, Duration):
            return self._nanoseconds <= other._nanoseconds
        return NotImplemented

    def __gt__(self, other: object) -> bool:
        if isinstance(other, Duration):
            return self._nanoseconds > other._nanoseconds
        return NotImplemented

    def __ge__(self, other: object) -> bool:
        if isinstance(other, Duration):
            return self._nanoseconds >= other._nanoseconds
        return NotImplemented

    def to_msg(self) -> Any:
        """Return the duration as a ``builtin_interfaces.msg.Duration``."""
        sec, nanosec = divmod(self._nanoseconds, S_TO_NS)
        return interface("builtin_interfaces.msg", "Duration")(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: Any) -> Duration:
        """Return the duration that a ``builtin_interfaces.msg.Duration`` states.

        Raises ``TypeError`` for anything else.
        """
        if not isinstance(msg, interface("builtin_interfaces.msg", "Duration")):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


#: The longest duration, which stands for no limit.
Infinite = Duration(nanoseconds=_LIMIT - 1)
