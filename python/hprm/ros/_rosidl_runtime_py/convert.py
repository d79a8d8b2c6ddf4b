"""Messages as dicts and as YAML."""

from __future__ import annotations

import array
from collections import OrderedDict
from typing import Any

import numpy


def message_to_ordereddict(message: Any) -> OrderedDict[str, Any]:
    """Return the fields of a message, with those of the messages within it."""
    return OrderedDict(
        (name, _plain(getattr(message, name))) for name in message.get_fields_and_field_types()
    )


def message_to_yaml(message: Any) -> str:
    """Return a message as YAML, which ``ros2 topic pub`` reads too."""
    import yaml

    fields = _dict(message_to_ordereddict(message))
    return str(yaml.safe_dump(fields, sort_keys=False, allow_unicode=True))


def _plain(value: Any) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return message_to_ordereddict(value)
    if isinstance(value, numpy.ndarray | array.array):
        return value.tolist()
    if isinstance(value, list | tuple | set):
        return [_plain(it) for it in value]
    if isinstance(value, bytes):
        return value[0]
    return value


def _dict(value: Any) -> Any:
    if isinstance(value, OrderedDict):
        return {name: _dict(it) for name, it in value.items()}
    return [_dict(it) for it in value] if isinstance(value, list) else value
