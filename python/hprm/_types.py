"""The types of ports at run time: what ``isinstance`` accepts for a value."""

from __future__ import annotations

import types
from typing import Any, Union, get_args, get_origin

# What type checkers accept for another type, as Python's documentation has it.
_PROMOTED: dict[Any, tuple[type, ...]] = {float: (float, int), complex: (complex, float, int)}


def accepted(declared: Any) -> tuple[type, ...] | None:
    """Return what a value may be an instance of; None if that cannot be told, or is anything."""
    # From Python 3.11 on, it is a class.
    if declared is Any:
        return None
    if declared is None:
        return (type(None),)
    origin = get_origin(declared)
    if origin in (Union, types.UnionType):
        found = [accepted(one) for one in get_args(declared)]
        if any(one is None for one in found):
            return None
        return tuple(type_ for one in found if one is not None for type_ in one)
    plain = origin or declared
    if plain in _PROMOTED:
        return _PROMOTED[plain]
    if not isinstance(plain, type) or plain is object:
        return None
    if getattr(plain, "_is_protocol", False) and not getattr(plain, "_is_runtime_protocol", False):
        return None
    return (plain,)
