"""Buffers of any format and shape: what ``memoryview`` and ``PickleBuffer`` show.

They arrive as read-only views over the bytes. What elements of a format are is not looked into,
apart from two things: they must not be addresses, which lead nowhere in another process, and their
size must be right wherever Python itself would rely on it.
"""

import re
import struct
from pickle import PickleBuffer
from typing import Any

from hprm import _hprm
from hprm._kinds import Parts

# In a format without the names of fields: objects, pointers, functions, and strings of C.
_ADDRESSES = re.compile(r"[OPX&z]|Z(?![fdg])")
_NAMES = re.compile(r":[^:]*:")


def memory(
    data: memoryview,
    layout: str,
    shape: tuple[int, ...],
    itemsize: int | None = None,
    fortran: bool = False,
) -> memoryview:
    """Make a view, read-only, of what has arrived."""
    if itemsize is None:
        itemsize = struct.calcsize(layout)
    if _holds_addresses(layout) or _size(layout, itemsize) != itemsize:
        raise ValueError(f"malformed payload: no buffer has the format {layout!r} here")
    return _hprm.shaped(data, layout, list(shape), itemsize, fortran)


def layout_of(
    view: memoryview,
) -> tuple[PickleBuffer, tuple[str, tuple[int, ...] | None, int, bool]]:
    """Return the bytes of a buffer, in a row, and what else ``memory`` needs.

    Raises ``TypeError`` if its elements cannot be sent.
    """
    if _holds_addresses(view.format):
        raise TypeError(
            f"a buffer of the format {view.format!r} holds addresses, which lead nowhere in "
            "another process; send what is there, for example in a list"
        )
    if view.itemsize == 0 or _size(view.format, view.itemsize) != view.itemsize:
        raise TypeError(
            f"a buffer of the format {view.format!r} with elements of {view.itemsize} bytes cannot "
            "be sent; send bytes(...) of it"
        )
    if view.contiguous:
        data = PickleBuffer(PickleBuffer(view).raw())
    else:
        data = PickleBuffer(view.tobytes())
    fortran = view.f_contiguous and not view.c_contiguous
    return data, (view.format, view.shape, view.itemsize, fortran)


def take(value: memoryview | PickleBuffer) -> Parts:
    """Take a buffer apart."""
    data, layout = layout_of(memoryview(value))
    return memory, (data, *layout)


def elements(value: memoryview | PickleBuffer) -> tuple[str, Any]:
    """Return what a buffer shows, in words, and its bytes in the order of C: for digests."""
    view = memoryview(value)
    data = PickleBuffer(view).raw() if view.c_contiguous else view.tobytes()
    return f"{view.format} {view.shape} {view.itemsize}", data


def _holds_addresses(layout: str) -> bool:
    return _ADDRESSES.search(_NAMES.sub("", layout)) is not None


def _size(layout: str, otherwise: int) -> int:
    """Return how many bytes Python takes for an element of a format; it does not know them all."""
    try:
        return struct.calcsize(layout)
    except struct.error:
        return otherwise
