"""Times of programs in plain Python: ``"10 ms"``, a ``timedelta``, or integers of nanoseconds."""

from datetime import timedelta
from typing import TypeAlias

from hprm import _findings
from hprm._hprm import nanoseconds
from hprm._mistakes import ProgramError, warn
from hprm._places import Place

#: A time: text with a unit, a ``timedelta``, or a whole number of nanoseconds.
Time: TypeAlias = str | timedelta | int

# Nanoseconds below which a number without a unit is hardly meant.
_LEAST = 1_000


def stated(name: str, time: Time | None, place: Place) -> int | None:
    """Return the time that a program states as ``name`` at a place, if it states one.

    Raises ``ProgramError`` if it is none.
    """
    if time is None:
        return None
    try:
        number = nanoseconds(time)
    except (TypeError, ValueError) as error:
        raise ProgramError(f"`{name}`: {error}", place, code=_findings.NO_TIME) from None
    if 0 < number < _LEAST and not isinstance(time, str | timedelta):
        warn(
            f"`{name}` is {number} ns: a number without a unit counts nanoseconds",
            place,
            f'write "{number} ms", or "{number} ns" if that is meant',
        )
    return number
