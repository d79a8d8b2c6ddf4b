"""Parameters of executables: which values they have, and the plain data that the runtime reads."""

from __future__ import annotations

import operator
from datetime import timedelta
from typing import Any

from hprm._findings import NOT_GIVEN
from hprm._hprm import nanoseconds
from hprm._mistakes import ProgramError
from hprm._places import Place

#: The deepest nesting of lists, tuples and dictionaries.
_DEEPEST = 50


def of(arguments: dict[str, Any], place: Place) -> list[list[Any]]:
    """Return names and values of the parameters with which a constructor was called.

    Raises ``ProgramError`` if one cannot be given to an executable.
    """
    return [[name, _data(name, value, place, 0)] for name, value in arguments.items()]


def _data(name: str, value: Any, place: Place, depth: int) -> Any:
    def inner(it: Any) -> Any:
        return _data(name, it, place, depth + 1)

    if depth > _DEEPEST:
        raise ProgramError(
            f"the parameter `{name}` is nested more than {_DEEPEST} deep", place, code=NOT_GIVEN
        )
    match value:
        case None | bool():
            return value
        case str():
            # Of a member of an enumeration, what it stands for.
            return str.__str__(value)
        case float():
            return {"float": repr(float(value))}
        case timedelta():
            return {"time": nanoseconds(value)}
        case list():
            return [inner(it) for it in value]
        case tuple():
            return {"tuple": [inner(it) for it in value]}
        case dict():
            return {"dict": [[inner(key), inner(it)] for key, it in value.items()]}
    try:
        number = operator.index(value)
    except TypeError:
        raise ProgramError(
            f"the parameter `{name}` of an executable cannot be of the type {type(value).__name__}",
            place,
            "an executable is given None, bool, int, float, str and timedelta, and lists, tuples"
            " and dictionaries of those",
            NOT_GIVEN,
        ) from None
    if not -(2**63) <= number < 2**63:
        raise ProgramError(
            f"the parameter `{name}` of an executable has more than 64 bits: {number}",
            place,
            "give it as a text, or in parts",
            NOT_GIVEN,
        )
    return number
