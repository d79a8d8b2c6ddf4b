"""Times of programs in plain Python: ``"10 ms"``, a ``timedelta``, or integers of nanoseconds."""

from datetime import timedelta
from typing import TypeAlias

from hprm import _hprm
from hprm._mistakes import ProgramError
from hprm._places import Place

#: A time: text with a unit, a ``timedelta``, or a whole number of nanoseconds.
Time: TypeAlias = str | timedelta | int

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
            number = _hprm.nanoseconds(time)
        case float():
            seconds = f"{time:.9f}".rstrip("0").rstrip(".")
            raise TypeError(f'{_EXPECTED}, and this is the float {time}: write "{seconds} s"')
        case _:
            raise TypeError(f"{_EXPECTED}, and this is a {type(time).__name__}")
    if number < 0:
        raise ValueError(f"a time counts forward, and {time} is negative")
    if number > _LONGEST:
        raise ValueError(f"a time has at most {_LONGEST} nanoseconds, which is 292 years")
    return number


def stated(name: str, time: Time | None, place: Place) -> int | None:
    """Return the time that a program states as ``name`` at a place, if it states one.

    Raises ``ProgramError`` if it is none.
    """
    try:
        return None if time is None else nanoseconds(time)
    except (TypeError, ValueError) as error:
        raise ProgramError(f"`{name}`: {error}", place) from None
