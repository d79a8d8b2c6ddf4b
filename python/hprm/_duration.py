"""Times of programs in plain Python: ``"10 ms"``, a ``timedelta``, or integers of nanoseconds."""

import re
from datetime import timedelta
from typing import TypeAlias

#: A time: text with a unit, a ``timedelta``, or a whole number of nanoseconds.
Time: TypeAlias = str | timedelta | int

_UNITS = {
    **dict.fromkeys(("ns", "nsec", "nsecs"), 1),
    **dict.fromkeys(("us", "usec", "usecs"), 10**3),
    **dict.fromkeys(("ms", "msec", "msecs"), 10**6),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 10**9),
    **dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60 * 10**9),
    **dict.fromkeys(("h", "hour", "hours"), 3_600 * 10**9),
    **dict.fromkeys(("d", "day", "days"), 86_400 * 10**9),
    **dict.fromkeys(("week", "weeks"), 7 * 86_400 * 10**9),
}
_TEXT = re.compile(r"\s*(\d+(?:_\d+)*)(?:\.(\d+))?\s*([a-z]*)\s*", re.ASCII)
_LONGEST = 2**63 - 1
_EXPECTED = 'a time is "10 ms", a timedelta, or a whole number of nanoseconds'


def nanoseconds(time: Time) -> int:
    """Return a time in nanoseconds.

    Raises ``TypeError`` or ``ValueError`` if it is none, is negative, or is longer than 292 years.
    """
    match time:
        case bool():
            raise TypeError(f"{_EXPECTED}, and this is {time}")
        case int():
            number = time
        case timedelta():
            number = (time.days * 86_400 + time.seconds) * 10**9 + time.microseconds * 1_000
        case str():
            number = _of_text(time)
        case float():
            raise TypeError(f'{_EXPECTED}, and this is the float {time}: write f"{{{time}}} s"')
        case _:
            raise TypeError(f"{_EXPECTED}, and this is a {type(time).__name__}")
    if number < 0:
        raise ValueError(f"a time counts forward, and {time} is negative")
    if number > _LONGEST:
        raise ValueError(f"a time has at most {_LONGEST} nanoseconds, which is 292 years")
    return number


def _of_text(text: str) -> int:
    """Read a number and its unit; of a fraction, what is less than a nanosecond is left out."""
    if text.strip() == "forever":
        return _LONGEST
    found = _TEXT.fullmatch(text)
    if found is None:
        raise ValueError(f"{_EXPECTED}, and this is {text!r}")
    whole, fraction, unit = found.groups()
    if unit not in _UNITS:
        if unit == "" and int(whole) == 0 and not fraction:
            return 0
        known = "ns, us, ms, s, min, h, d"
        what = f"{unit!r} is no unit of time" if unit else f"{text!r} has no unit"
        raise ValueError(f"{what}; the units are {known}")
    number = int(whole) * _UNITS[unit]
    if fraction:
        number += int(fraction) * _UNITS[unit] // 10 ** len(fraction)
    return number
