"""Of NumPy: the dtypes with fields, numbers, and arrays that the native half leaves over."""

import json
import math
from typing import Any

import numpy

from hprm._kinds import Parts


def description_of(dtype: Any) -> bytes | None:
    """Describe a dtype with fields; None if a package has added it, or pickle must carry it."""
    described = _described(dtype)
    if described is None:
        return None
    text = json.dumps(described, separators=(",", ":")).encode()
    return text if dtype_of(text) == dtype else None


def dtype_of(text: bytes) -> Any:
    """Make a dtype of its description."""
    return _dtype(json.loads(text))


def raw(array: Any) -> Any:
    """Return an array with elements of which NumPy copies every byte.

    Of elements with fields it copies the fields, not what is between them.
    """
    return array if array.dtype.names is None else array.view(f"V{array.dtype.itemsize}")


def scalar(array: Any) -> Any:
    """Make a number of NumPy, or a record."""
    if array.dtype.names is None:
        return array[()].copy()
    return numpy.frombuffer(bytearray(array.tobytes()), array.dtype)[0]


def text_scalar(text: str | bytes) -> Any:
    """Make a string of NumPy."""
    return numpy.str_(text) if isinstance(text, str) else numpy.bytes_(text)


def objects(shape: tuple[int, ...], members: list[Any]) -> Any:
    """Make an array of objects."""
    if len(members) != math.prod(shape):
        raise ValueError("malformed payload: an array of another shape than its members have")
    array = numpy.empty(len(members), object)
    for at, member in enumerate(members):
        array[at] = member
    return array.reshape(shape)


def masked(data: Any, mask: Any, fill_value: Any, hard: bool) -> Any:
    """Make a masked array."""
    made = numpy.ma.MaskedArray(data, mask, fill_value=fill_value, hard_mask=hard, copy=False)
    # A shared mask could be changed through another array.
    made.unshare_mask()
    return made


def taker(kind: type) -> Any:
    """Return what takes apart values of a class of NumPy."""
    if kind is numpy.ndarray:
        return _take_objects
    if kind in (numpy.str_, numpy.bytes_):
        base = str if kind is numpy.str_ else bytes
        return lambda value: (text_scalar, (base(value),))
    if issubclass(kind, numpy.generic):
        return _take_scalar
    if kind is numpy.ma.MaskedArray:
        return _take_masked
    return None


def _take_scalar(value: Any) -> Parts | None:
    array = numpy.asarray(value)
    # One of objects, or of no bytes.
    if array.dtype.hasobject or type(array[()]) is not type(value):
        return None
    return scalar, (array,)


def _take_objects(array: Any) -> Parts | None:
    if array.dtype != object:
        return None
    return objects, (array.shape, array.ravel().tolist())


def _take_masked(array: Any) -> Parts | None:
    if array.dtype.names is not None or array.dtype.hasobject or set(array.__dict__) - _MASKED:
        return None
    data = array.data
    if type(data) is not numpy.ndarray:
        return None
    mask = False if array.mask is numpy.ma.nomask else numpy.asarray(array.mask)
    return masked, (data, mask, _fill_value(array), bool(array.hardmask))


def _fill_value(array: Any) -> Any:
    """Return what stands for masked elements; a masked array makes it when it is first asked."""
    # `array.fill_value` would store the default in the array, so a copy is asked.
    return numpy.asarray(array.view().fill_value)


# What a masked array has besides what is sent.
_MASKED = {
    "_mask",
    "_fill_value",
    "_hardmask",
    "_sharedmask",
    "_isfield",
    "_baseclass",
    "_optinfo",
    "_basedict",
}


def _described(dtype: Any) -> Any:
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        inner = _described(base)
        return None if inner is None else [inner, list(shape)]
    if dtype.names is None:
        return dtype.str if type(dtype).__module__ == "numpy.dtypes" else None
    if dtype.type is not numpy.void:
        return None
    fields = [dtype.fields[name] for name in dtype.names]
    formats = [_described(field[0]) for field in fields]
    titles = [field[2] if len(field) > 2 else None for field in fields]
    if None in formats or any(not isinstance(title, str | None) for title in titles):
        return None
    return {
        "names": list(dtype.names),
        "formats": formats,
        "offsets": [field[1] for field in fields],
        "titles": titles,
        "itemsize": dtype.itemsize,
        "align": dtype.isalignedstruct,
    }


def _dtype(described: Any) -> Any:
    match described:
        case str():
            return numpy.dtype(described)
        case [base, [*shape]]:
            return numpy.dtype((_dtype(base), tuple(shape)))
        case {"names": _, "formats": list(), "align": _}:
            return _dtype_of_fields(described)
    raise ValueError("malformed payload: this describes no dtype")


def _dtype_of_fields(described: dict[str, Any]) -> Any:
    spec: Any = {name: described[name] for name in ("names", "offsets", "itemsize")}
    spec["formats"] = [_dtype(each) for each in described["formats"]]
    if any(title is not None for title in described["titles"]):
        spec["titles"] = described["titles"]
    return numpy.dtype(spec, align=bool(described["align"]))
