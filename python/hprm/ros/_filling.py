"""Messages of ROS 2 made of values of any program, for ``hprm mirror``.

Nothing is converted that would change it: a number must fit into its field, and what is no text
does not become one. That is stricter than ``rosidl_runtime_py``, whose values a person types.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from hprm._payloads import Unsendable, kind_of
from hprm._views import parts_of


def message_of(kind: Any, value: Any) -> Any:
    """Make a message of a class from a value.

    A dict, or an object of a class, has the fields of the message; anything else is the only field
    of a message that has one, as ``data`` of ``std_msgs/msg/String``.
    """
    if isinstance(value, kind):
        return value
    names = list(kind.get_fields_and_field_types())
    fields = parts_of(value)
    if fields is None:
        if len(names) != 1:
            has = f"the fields {', '.join(names)}" if names else "no fields"
            raise Unsendable(f"{kind.__name__} has {has}, and the value is {kind_of(value)}")
        fields = {names[0]: value}
    try:
        return _filled(kind, fields, "")
    except RecursionError:
        raise Unsendable("it is nested too deep") from None


def _filled(kind: Any, fields: Mapping[Any, Any], place: str) -> Any:
    message = kind()
    types = {it.name: it.type for it in kind.__hprm_structure__.fields}
    for name, value in fields.items():
        if name not in types:
            raise Unsendable(
                f"{kind.__name__} has no field {name!r}; its fields: {', '.join(types) or 'none'}"
            )
        where = f"{place}{name}"
        kind_of_field = kind.__hprm_kinds__[name]
        if types[name].many is None:
            made = _one(kind_of_field, value, where)
        else:
            made = _many(kind_of_field, value, getattr(message, name), where)
        try:
            setattr(message, name, made)
        except (AssertionError, OverflowError, TypeError, ValueError) as error:
            raise Unsendable(f"{where}: {error}") from None
    return message


def _one(kind: Any, value: Any, where: str) -> Any:
    """Return a value of a field that is no sequence."""
    if isinstance(value, np.generic):
        value = value.item()
    if hasattr(kind, "get_fields_and_field_types"):
        if isinstance(value, kind):
            return value
        fields = parts_of(value)
        if fields is not None:
            return _filled(kind, fields, f"{where}.")
    elif kind is float and isinstance(value, (int, float, np.floating)):
        if not isinstance(value, bool):
            return float(value)
    elif kind is bytes and isinstance(value, int) and 0 <= value < 256:
        return bytes([value])
    elif isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
        return value
    raise Unsendable(f"{where} takes {kind.__name__}, and the value is {kind_of(value)}")


def _many(kind: Any, value: Any, before: Any, where: str) -> Any:
    """Return a value of a field that is a sequence; ``before`` is what the field has without it."""
    if isinstance(value, (bytes, bytearray)) and kind is int:
        value = np.frombuffer(value, np.uint8)
    has_numbers = kind in (int, float, bool)
    if isinstance(value, np.ndarray) and has_numbers and value.dtype.kind in "biuf":
        # An image of some megabytes is no list of numbers.
        return _flat(value, np.asarray(before), where)
    if isinstance(value, (np.ndarray, list, tuple)) and parts_of(value) is None:
        items = value.reshape(-1).tolist() if isinstance(value, np.ndarray) else value
        return [_one(kind, it, f"{where}[{at}]") for at, it in enumerate(items)]
    raise Unsendable(f"{where} is a sequence, and the value is {kind_of(value)}")


def _flat(value: npt.NDArray[Any], field: npt.NDArray[Any], where: str) -> Any:
    """Return an array of numbers as a field has it, if each of them fits."""
    flat = value.reshape(-1)
    if field.dtype.kind not in "biuf":
        return flat.tolist()
    if flat.dtype == field.dtype:
        return flat
    with np.errstate(over="ignore", invalid="ignore"):
        made = flat.astype(field.dtype)
    is_kept = made == flat
    if field.dtype.kind == "f":
        # It is rounded, as any number; but a large one must not become infinite.
        is_kept = np.isfinite(made) | ~np.isfinite(flat)
    if not is_kept.all():
        wrong = flat[~is_kept][0]
        raise Unsendable(f"{where} has numbers of {field.dtype}, and {wrong} is none")
    return made
