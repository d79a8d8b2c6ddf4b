"""Values as bytes for programs that know nothing of HPRM: what ``hprm mirror`` sends.

A value has one form, which the user names; nothing is guessed from the value. What has no such form
raises ``Unsendable``. Messages of ROS 2 are made in ``hprm.ros._filling``; this does not know where
the bytes go.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from hprm._views import parts_of

#: The kinds of arrays that are numbers or truth values: their bytes can be read by their type.
_KINDS = "biufc"


class Unsendable(Exception):
    """A value has no bytes in that form; the text says why."""


class Payload(NamedTuple):
    """What is sent for a value."""

    data: bytes
    #: How Zenoh calls what it is.
    encoding: str


Form = Callable[[Any], Payload]


def raw(value: Any) -> Payload:
    """Return the bytes of bytes, of a text in UTF-8, or of an array of numbers in C order.

    A number of NumPy is an array without dimensions. The encoding of an array has its type and its
    shape: ``zenoh/bytes;|u1[480,640,3]``.
    """
    if isinstance(value, (np.ndarray, np.generic)) and not isinstance(value, (np.str_, np.bytes_)):
        if isinstance(value, np.ma.MaskedArray) or value.dtype.kind not in _KINDS:
            raise Unsendable(f"{kind_of(value)} of {value.dtype} has no bytes that others can read")
        shape = ",".join(map(str, value.shape))
        return Payload(value.tobytes(), f"zenoh/bytes;{value.dtype.str}[{shape}]")
    if isinstance(value, str):
        return Payload(_utf8(value), "zenoh/string")
    if isinstance(value, (bytes, bytearray, memoryview)):
        return Payload(bytes(value), "zenoh/bytes")
    raise Unsendable(f"{kind_of(value)} is no bytes, no text and no array; try --as json")


def as_json(value: Any) -> Payload:
    """Return a value as JSON: arrays are lists, and objects of classes have their fields."""
    try:
        text = json.dumps(plain(value), allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        why = str(error).replace("Out of range float values are", "infinity and NaN are")
        raise Unsendable(f"it has no JSON: {why}") from None
    except RecursionError:
        raise Unsendable("it has no JSON: it is nested too deep") from None
    return Payload(_utf8(text), "application/json")


def plain(value: Any) -> Any:
    """Return a value that consists of dicts, lists, numbers and texts, as far as there are such."""
    fields = parts_of(value)
    if fields is not None:
        made = {str(key): plain(it) for key, it in fields.items()}
        if len(made) < len(fields):
            raise ValueError("two keys of a dict are the same text")
        return made
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError("a masked array has values that are none")
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        item = value.item()
        # A number that is wider than those of Python stays one of NumPy.
        return float(item) if isinstance(item, np.floating) else item
    if isinstance(value, (list, tuple)):
        return [plain(it) for it in value]
    return value


def kind_of(value: Any) -> str:
    """Return what a value is, with its article."""
    if isinstance(value, np.ndarray):
        return "an array"
    if value is None:
        return "None"
    name = "object with fields" if isinstance(value, SimpleNamespace) else type(value).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _utf8(text: str) -> bytes:
    try:
        return text.encode()
    except UnicodeEncodeError:
        raise Unsendable("it is a text with half a character, which UTF-8 does not have") from None
