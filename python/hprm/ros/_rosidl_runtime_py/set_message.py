"""Filling messages from dicts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def set_message_fields(msg: Any, values: Mapping[str, Any]) -> None:
    """Set fields of a message, and of messages within it, from a dict.

    Numbers become those of the field's type. Raises ``AttributeError`` for a name that is no
    field, ``TypeError`` for values that are no dict, and ``ValueError`` for a value that cannot be
    converted.
    """
    if not isinstance(values, Mapping):
        raise TypeError(f"fields of {type(msg).__name__} are set from a dict, not {values!r}")
    fields = {it.name: it.type for it in msg.__hprm_structure__.fields}
    for name, value in values.items():
        if name not in fields:
            raise AttributeError(f"{type(msg).__name__!r} object has no attribute {name!r}")
        kind = msg.__hprm_kinds__[name]
        if fields[name].many is None:
            setattr(msg, name, _converted(kind, value))
        else:
            setattr(msg, name, [_converted(kind, it) for it in value])


def _converted(kind: Any, value: Any) -> Any:
    if isinstance(value, kind):
        return value
    if hasattr(kind, "get_fields_and_field_types"):
        made = kind()
        set_message_fields(made, value)
        return made
    return bytes([value]) if kind is bytes else kind(value)
