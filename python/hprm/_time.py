"""Units of time: what turns a number of them into nanoseconds."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeVar

    Number = TypeVar("Number", int, float)

instant_t = int
interval_t = int

BILLION = 1_000_000_000
FOREVER = 0x7FFFFFFFFFFFFFFF
# Not the most negative number of 64 bits: programs compare with the value that they know.
NEVER = -0xFFFFFFFFFFFFFFFF


def _words(name: str) -> str:
    """Return the name of a unit in words."""
    short = {
        "NSEC": "nanoseconds",
        "USEC": "microseconds",
        "MSEC": "milliseconds",
        "SEC": "seconds",
    }
    base = name.removesuffix("S")
    return short.get(base, "seconds" if base == "SEC" else f"{base.lower()}s")


def _unit(name: str, nanoseconds: int) -> Callable[[Number], Number]:
    def unit(number: Number) -> Number:
        return number * nanoseconds

    unit.__name__ = unit.__qualname__ = name
    unit.__doc__ = f"Return the nanoseconds of that many {_words(name)}: a float of a float."
    return unit


NSEC = _unit("NSEC", 1)
NSECS = _unit("NSECS", 1)
USEC = _unit("USEC", 1_000)
USECS = _unit("USECS", 1_000)
MSEC = _unit("MSEC", 1_000_000)
MSECS = _unit("MSECS", 1_000_000)
SEC = _unit("SEC", BILLION)
SECS = _unit("SECS", BILLION)
MINUTE = _unit("MINUTE", 60 * BILLION)
MINUTES = _unit("MINUTES", 60 * BILLION)
HOUR = _unit("HOUR", 3_600 * BILLION)
HOURS = _unit("HOURS", 3_600 * BILLION)
DAY = _unit("DAY", 86_400 * BILLION)
DAYS = _unit("DAYS", 86_400 * BILLION)
WEEK = _unit("WEEK", 7 * 86_400 * BILLION)
WEEKS = _unit("WEEKS", 7 * 86_400 * BILLION)
