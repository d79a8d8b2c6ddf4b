"""``typing.NamedTuple`` for modules that each start loads: ``typing`` takes as long as all of them.

A module has ``from __future__ import annotations``, and checkers of types see the original.
"""

from __future__ import annotations

from collections import namedtuple

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


class _Maker(type):
    """Makes a named tuple of what a class declares."""

    def __new__(cls, name: str, bases: tuple[type, ...], body: dict[str, Any]) -> Any:
        if not bases:
            return super().__new__(cls, name, bases, body)
        fields = body["__annotations__"]
        defaults = [body[field] for field in fields if field in body]
        made = namedtuple(name, fields, defaults=defaults)  # type: ignore[misc]
        for attribute, value in body.items():
            if attribute not in fields:
                setattr(made, attribute, value)
        return made


class NamedTuple(metaclass=_Maker):
    """A class that derives from this is a named tuple."""
