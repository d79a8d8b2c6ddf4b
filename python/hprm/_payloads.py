"""Values as bytes for programs that know nothing of HPRM: what ``hprm mirror`` sends.

A value has one form, which the user names; nothing is guessed from the value. What has no such form
raises ``Unsendable``. This does not know where the bytes go.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt


class Unsendable(Exception):
    """A value has no bytes in that form; the text says why."""


class Payload(NamedTuple):
    """What is sent for a value."""

    data: bytes
    #: How Zenoh calls what it is.
    encoding: str


Form = Callable[[Any], Payload]


def raw(value: Any) -> Payload:
    """Return the bytes of bytes, of a text in UTF-8, or of an array in C order.

    A number of NumPy is an array without dimensions.

    The encoding of an array has its type and its shape: ``zenoh/bytes;|u1[480,640,3]``.
    """
    if isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject:
        shape = ",".join(map(str, value.shape))
        return Payload(value.tobytes(), f"zenoh/bytes;{value.dtype.str}[{shape}]")
    if isinstance(value, str):
        return Payload(value.encode(), "zenoh/string")
    if isinstance(value, (bytes, bytearray, memoryview)):
        return Payload(bytes(value), "zenoh/bytes")
    raise Unsendable(f"{_kind(value)} is no bytes, no text and no array; --as json sends it")


def as_json(value: Any) -> Payload:
    """Return a value as JSON: arrays are lists, and objects of classes have their attributes."""
    try:
        text = json.dumps(plain(value), allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        raise Unsendable(f"it has no JSON: {error}") from None
    return Payload(text.encode(), "application/json")


def plain(value: Any) -> Any:
    """Return a value that consists of dicts, lists, numbers and texts, as far as there are such."""
    fields = fields_of(value)
    if fields is not None:
        return {str(key): plain(it) for key, it in fields.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, (list, tuple)):
        return [plain(it) for it in value]
    return value


def fields_of(value: Any) -> Mapping[Any, Any] | None:
    """Return what a dict, or an object of a class, has in it; none if it is neither."""
    if isinstance(value, Mapping):
        return value
    if isinstance(value, SimpleNamespace):
        return vars(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {it.name: getattr(value, it.name) for it in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return dict(value._asdict())
    return None


def message_of(kind: Any, value: Any) -> Any:
    """Make a message of ROS 2 of a class from a value.

    A dict, or an object of a class, has the fields of the message; anything else is the only field
    of a message that has one, as ``data`` of ``std_msgs/msg/String``.
    """
    if isinstance(value, kind):
        return value
    message = kind()
    names = list(message.get_fields_and_field_types())
    fields = fields_of(value)
    if fields is None:
        if len(names) != 1:
            described = f"{kind.__name__}: {', '.join(names)}"
            raise Unsendable(f"{_kind(value)} has none of the fields of {described}")
        fields = {names[0]: value}
    try:
        _fill(message, fields)
    except (AssertionError, AttributeError, OverflowError, TypeError, ValueError) as error:
        raise Unsendable(f"it is no {kind.__name__}: {error}") from None
    return message


def _fill(message: Any, fields: Mapping[Any, Any]) -> None:
    from hprm.ros._rosidl_runtime_py import set_message_fields

    for name, value in fields.items():
        if isinstance(value, np.ndarray) and hasattr(message, name):
            # An image of some megabytes is no list of numbers.
            setattr(message, name, _flat(value, np.asarray(getattr(message, name))))
        else:
            set_message_fields(message, {name: plain(value)})


def _flat(value: npt.NDArray[Any], field: npt.NDArray[Any]) -> Any:
    """Return an array as a field of messages has it; a list, if that has no arrays."""
    if field.dtype.hasobject or field.ndim != 1:
        return value.tolist()
    return value.reshape(-1).astype(field.dtype, casting="same_kind", copy=False)


def _kind(value: Any) -> str:
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
