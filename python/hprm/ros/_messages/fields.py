"""Fields of messages: what may be assigned to one, what it holds then, and what it holds at first.

A sequence of numbers is an ``array.array``, which can grow, or the NumPy array that a program has
assigned, which is not copied. A fixed number of numbers is a NumPy array. What is refused raises
``AssertionError``.
"""

from __future__ import annotations

import array
from collections import UserList, UserString
from collections.abc import Callable, Sequence, Set
from math import inf, isinf
from typing import Any

from hprm.ros._messages import arrays
from hprm.ros._messages.definitions import Field, limits

#: For each type of numbers, the code of ``array.array`` and the name of NumPy's dtype.
NUMBERS = {
    "float32": ("f", "float32"),
    "float64": ("d", "float64"),
    "int8": ("b", "int8"),
    "uint8": ("B", "uint8"),
    "char": ("B", "uint8"),
    "int16": ("h", "int16"),
    "uint16": ("H", "uint16"),
    "int32": ("i", "int32"),
    "uint32": ("I", "uint32"),
    "int64": ("q", "int64"),
    "uint64": ("Q", "uint64"),
}

_LARGEST_FLOAT = {"float32": 3.402823466e38, "float64": 1.7976931348623157e308}
_FLOAT_NAMES = {"float32": "float", "float64": "double"}

Put = Callable[[Any, Any], None]
Check = Callable[[Any], Any]


def checker(it: Field, kind: type) -> Check:
    """Return what checks a value for a field and returns what the field holds then.

    ``kind`` is the class of one value.
    """
    if it.type.many is None:
        return _one(it, kind)
    if it.type.base in NUMBERS:
        return _fixed_numbers(it, kind) if it.type.many == "array" else _numbers(it, kind)
    return _many(it, kind)


def converter(it: Field, check: Check) -> Check:
    """Return what makes the value of a field of an argument of the constructor.

    Numbers in a sequence are converted there, as integers to floats.
    """
    if it.type.many is None or it.type.base not in NUMBERS:
        return check
    code, dtype = NUMBERS[it.type.base]
    refused = _elements(it, float if code in "fd" else int).refused

    def converted(value: Any) -> Any:
        if arrays.is_array(value):
            if value.dtype == dtype:
                return check(value)
            value = value.tolist()
        if isinstance(value, _BYTES) and code in "bB" and it.type.many != "array":
            return check(_of_bytes(code, value))
        try:
            is_fixed = it.type.many == "array"
            made = arrays.array(value, dtype) if is_fixed else array.array(code, value)
        except (TypeError, ValueError, OverflowError):
            raise AssertionError(refused) from None
        return check(made)

    return converted


def python_type(base: str) -> type | None:
    """Return the class of a value of a basic type, or None for a message."""
    if base.startswith(("int", "uint")) or base == "char":
        return int
    return {"float32": float, "float64": float, "bool": bool, "byte": bytes}.get(
        base, str if base in ("string", "wstring") else None
    )


def _one(it: Field, kind: type) -> Check:
    base, name = it.type.base, it.name
    if it.type.is_message:
        refused = f"The '{name}' field must be a sub message of type '{kind.__name__}'"
        return _instance(kind, refused, lambda value: value)
    if base == "byte":
        return _octet(name)
    refused = f"The '{name}' field must be of type '{kind.__name__}'"
    if kind is int:
        return _integer(base, name, refused)
    if base == "float32":
        return _float(name, refused)
    if it.type.bound is not None:
        return _bounded_text(name, it.type.bound)
    # Objects of derived classes, as `numpy.float64`, become what they stand for.
    return _instance(kind, refused, _PLAIN[kind])


def _instance(kind: type, refused: str, plain: Check) -> Check:
    def check(value: Any) -> Any:
        if value.__class__ is kind:
            return value
        if isinstance(value, kind):
            return plain(value)
        raise AssertionError(refused)

    return check


def _integer(base: str, name: str, refused: str) -> Check:
    low, high = limits(base)
    sign = "an unsigned integer" if low == 0 else "an integer"
    outside = f"The '{name}' field must be {sign} in [{low}, {high}]"

    def check(value: Any) -> Any:
        if not isinstance(value, int):
            raise AssertionError(refused)
        if not low <= value <= high:
            raise AssertionError(outside)
        return value if value.__class__ is int else int(value)

    return check


def _float(name: str, refused: str) -> Check:
    largest = _LARGEST_FLOAT["float32"]
    outside = f"The '{name}' field must be a float in [{-largest}, {largest}]"

    def check(value: Any) -> Any:
        if not isinstance(value, float):
            raise AssertionError(refused)
        if not -largest <= value <= largest and abs(value) < inf:
            raise AssertionError(outside)
        return value if value.__class__ is float else float(value)

    return check


def _octet(name: str) -> Check:
    refused = f"The '{name}' field must be of type 'bytes' or 'ByteString' with length 1"

    def check(value: Any) -> Any:
        if not isinstance(value, bytes | bytearray) or len(value) != 1:
            raise AssertionError(refused)
        return bytes(value)

    return check


def _bounded_text(name: str, bound: int) -> Check:
    refused = f"The '{name}' field must be string value not longer than {bound}"

    def check(value: Any) -> Any:
        if not isinstance(value, str | UserString) or len(value) > bound:
            raise AssertionError(refused)
        return value if value.__class__ is str else str(value)

    return check


def _numbers(it: Field, kind: type) -> Check:
    """Of a sequence of numbers."""
    code, dtype = NUMBERS[it.type.base]
    name, size = it.name, it.type.size
    of_elements = _elements(it, kind)

    def fits(value: Any, what: str) -> None:
        if size is not None and len(value) > size:
            raise AssertionError(f"The '{name}' {what} must have a size <= {size}")

    def check(value: Any) -> Any:
        if isinstance(value, array.array):
            if value.typecode != code:
                raise AssertionError(
                    f"The '{name}' array.array() must have the type code of '{code}'"
                )
            fits(value, "array.array()")
            return value
        if arrays.is_array(value):
            if value.dtype != dtype:
                raise AssertionError(_wrong_dtype(name, dtype))
            if value.ndim != 1:
                raise AssertionError(
                    f"The '{name}' numpy.ndarray() must have one dimension; assign a.reshape(-1)"
                )
            fits(value, "numpy.ndarray()")
            return value
        if isinstance(value, _BYTES) and code == "B" and (size is None or len(value) <= size):
            return _of_bytes(code, value)
        of_elements(value)
        return _array(code, value, of_elements.refused)

    return check


def _fixed_numbers(it: Field, kind: type) -> Check:
    """Of a fixed number of numbers."""
    code, dtype = NUMBERS[it.type.base]
    name, size = it.name, it.type.size
    of_elements = _elements(it, kind)

    def check(value: Any) -> Any:
        if arrays.is_array(value):
            if value.dtype != dtype:
                raise AssertionError(_wrong_dtype(name, dtype))
            if value.shape != (size,):
                raise AssertionError(f"The '{name}' numpy.ndarray() must have a size of {size}")
            return value
        of_elements(value)
        return arrays.array(_array(code, list(value), of_elements.refused), dtype)

    return check


def _many(it: Field, kind: type) -> Check:
    """Of many values that are no numbers."""
    of_elements = _elements(it, kind)

    def check(value: Any) -> Any:
        of_elements(value)
        return value

    return check


class _elements:  # noqa: N801
    """Checks the values of a list, or another container, for a field."""

    def __init__(self, it: Field, kind: type) -> None:
        self.kind, self.bound = kind, it.type.bound
        self.size, self.is_fixed = it.type.size, it.type.many == "array"
        says = ["a set or sequence"]
        if self.size is not None:
            says.append(f"with length {'' if self.is_fixed else '<= '}{self.size}")
        if self.bound is not None:
            says.append(f"and each string value not longer than {self.bound}")
        says.append(f"and each value of type '{kind.__name__}'")
        if kind is int:
            low, high = limits(it.type.base)
            sign = "unsigned integer" if low == 0 else "integer"
            says.append(f"and each {sign} in [{low}, {high}]")
        elif kind is float:
            largest = _LARGEST_FLOAT[it.type.base]
            says.append(f"and each {_FLOAT_NAMES[it.type.base]} in [{-largest:f}, {largest:f}]")
        self.refused = f"The '{it.name}' field must be {' '.join(says)}"

    def __call__(self, value: Any) -> None:
        """Check a value."""
        if not isinstance(value, Sequence | Set | UserList) or isinstance(value, str | UserString):
            raise AssertionError(self.refused)
        if self.size is not None and (
            len(value) != self.size if self.is_fixed else len(value) > self.size
        ):
            raise AssertionError(self.refused)
        kinds = set(map(type, value))
        if kinds != {self.kind} and not all(issubclass(it, self.kind) for it in kinds):
            raise AssertionError(self.refused)
        if self.bound is not None and any(len(it) > self.bound for it in value):
            raise AssertionError(self.refused)


def _array(code: str, value: Any, refused: str) -> array.array[Any]:
    """Make an array of checked numbers."""
    try:
        listed = value if isinstance(value, list) else list(value)
        made: array.array[Any] = array.array(code, listed)
    except OverflowError:
        raise AssertionError(refused) from None
    # Python makes an infinity of a number that is too large for a float of 32 bits.
    infinite = code == "f" and (inf in made or -inf in made)
    if infinite and any(isinf(a) and not isinf(b) for a, b in zip(made, value, strict=True)):
        raise AssertionError(refused)
    return made


def _of_bytes(code: str, value: bytes | bytearray | memoryview) -> array.array[Any]:
    made: array.array[Any] = array.array(code)
    made.frombytes(value)
    return made


def _wrong_dtype(name: str, dtype: str) -> str:
    return f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype}'"


_PLAIN: dict[type, Check] = {float: float, bool: bool, str: str.__str__}

_BYTES = (bytes, bytearray, memoryview)
