"""How viewers show values: as images, point clouds, fields that can be plotted, and texts.

Nothing here knows a viewer. ``views`` takes a value apart, whatever it is made of; what is in a
dict or an object, and is not a field, has a path of its own.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

#: A list of numbers that is longer is no field.
LONGEST_LIST = 4096

#: How deep in a value something is shown.
_DEPTH = 8

#: What can be plotted: as in JSON.
Field: TypeAlias = "bool | int | float | str | list[Field] | dict[str, Field] | None"

_Array: TypeAlias = npt.NDArray[Any]


@dataclass(frozen=True)
class Image:
    """Rows of pixels, in an encoding of ROS: ``rgb8``, ``mono8``, ``32FC1``."""

    encoding: str
    pixels: _Array


@dataclass(frozen=True)
class Cloud:
    """Points: rows of x, y and z, and perhaps of intensity."""

    points: _Array


@dataclass(frozen=True)
class Fields:
    """Numbers, texts and lists of them, by names."""

    fields: dict[str, Field]


@dataclass(frozen=True)
class Text:
    """A text that is a message."""

    text: str


@dataclass(frozen=True)
class Nothing:
    """What cannot be shown."""

    why: str


View: TypeAlias = Image | Cloud | Fields | Text | Nothing


def views(value: Any) -> Iterator[tuple[str, View]]:
    """Return what is shown of a value: for each part its path in the value, and the view.

    The path of the value itself is empty, that of a part is like ``/pose/position``.
    """
    shown = _fields_or_view(value)
    if isinstance(shown, (Image, Cloud, Nothing, Fields, Text)):
        yield "", shown
        return
    parts: dict[str, View] = {}
    fields = _fields(shown, "", parts, _DEPTH)
    if fields:
        yield "", Fields(fields)
    yield from parts.items()


def _fields_or_view(value: Any) -> View | Mapping[Any, Any]:
    """Return how a value is shown; or its parts by their names."""
    if isinstance(value, str):
        return Text(value)
    parts = parts_of(value)
    if parts is not None:
        return parts
    return _array(value) if isinstance(value, np.ndarray) else _plain(value)


def _fields(
    parts: Mapping[Any, Any], path: str, others: dict[str, View], depth: int
) -> dict[str, Field]:
    """Return those parts that are fields, and put the others where they belong."""
    fields: dict[str, Field] = {}
    for key, value in parts.items():
        name, inner = str(key), parts_of(value)
        below = f"{path}/{name}"
        if inner is not None and depth > 0:
            if nested := _fields(inner, below, others, depth - 1):
                fields[name] = nested
        elif isinstance(value, str):
            fields[name] = value
        else:
            shown = _array(value) if isinstance(value, np.ndarray) else _plain(value)
            if isinstance(shown, Fields):
                fields[name] = shown.fields["value"]
            else:
                others[below] = shown
    return fields


def parts_of(value: Any) -> Mapping[Any, Any] | None:
    """Return the members of a dict, or the attributes of an object that has nothing else."""
    if isinstance(value, Mapping):
        return value
    if isinstance(value, SimpleNamespace):
        return vars(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {it.name: getattr(value, it.name) for it in dataclasses.fields(value)}
    messages = getattr(type(value), "_fields_and_field_types", None)
    if isinstance(messages, dict):
        return {it: getattr(value, it) for it in messages}
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return dict(zip(value._fields, value, strict=True))
    return None


def _plain(value: Any) -> Fields | Nothing:
    """Return how a value is shown that is no array and has no parts with names."""
    field = _field(value)
    return Nothing(_kind(value)) if field is _NONE else Fields({"value": field})


# A field may be None.
_NONE: Any = object()


def _field(value: Any) -> Any:
    """Return a value as in JSON; ``_NONE`` if it is nothing that can be plotted."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, (bool, int)):
        return value
    if isinstance(value, float):
        # JSON has no others.
        return value if math.isfinite(value) else None
    if isinstance(value, (list, tuple)) and len(value) <= LONGEST_LIST:
        members = [_field(it) for it in value]
        return _NONE if any(it is _NONE for it in members) else members
    return _NONE


def _array(array: _Array) -> View:
    kind, shape = array.dtype, array.shape
    width = shape[-1] if shape else 0
    if kind.kind not in "buif":
        return Nothing(_kind(array))
    if array.ndim == 0:
        return Fields({"value": _field(array[()])})
    if array.ndim == 1 and array.size <= LONGEST_LIST:
        return Fields({"value": _field(array.tolist())})
    if kind == np.uint8:
        encodings = {1: "mono8", 3: "rgb8", 4: "rgba8"}
        encoding = "mono8" if array.ndim == 2 else encodings.get(width)
        if array.ndim in (2, 3) and encoding is not None and array.size > 0:
            return Image(encoding, array)
    elif array.ndim == 2 and array.size > 0:
        if kind == np.uint16:
            return Image("mono16", array)
        if kind.kind == "f":
            return Cloud(array) if width in (3, 4) else Image("32FC1", array)
    return Nothing(_kind(array))


def _kind(value: Any) -> str:
    """Name what a value is, for people."""
    if isinstance(value, np.ndarray):
        return f"an array({value.dtype} {'x'.join(map(str, value.shape))})"
    name = type(value).__name__
    if isinstance(value, (list, tuple)):
        return f"a {name} of {len(value)} members"
    return f"{'an' if name[:1] in tuple('aeiouAEIOU') else 'a'} {name}"
