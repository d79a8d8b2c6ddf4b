"""Times of programs in plain Python: ``"10 ms"``, a ``timedelta``, or integers of nanoseconds."""

from datetime import timedelta
from typing import TypeAlias

from hprm._hprm import nanoseconds
from hprm._mistakes import ProgramError
from hprm._places import Place

#: A time: text with a unit, a ``timedelta``, or a whole number of nanoseconds.
Time: TypeAlias = str | timedelta | int


def stated(name: str, time: Time | None, place: Place) -> int | None:
    """Return the time that a program states as ``name`` at a place, if it states one.

    Raises ``ProgramError`` if it is none.
    """
    try:
        return None if time is None else nanoseconds(time)
    except (TypeError, ValueError) as error:
        raise ProgramError(f"`{name}`: {error}", place) from None
