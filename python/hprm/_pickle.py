"""Pickling what is not of the basic types, with its large buffers out of band."""

import io
import pickle
import sys
from collections.abc import Sequence
from typing import Any

from hprm import _kinds

# Libraries whose values have large buffers, which pickle alone would leave in the stream.
_LIBRARIES = ("array", "torch", "pyarrow", "pandas")


class _View:
    """A buffer that is a memoryview for its receiver."""

    def __init__(self, buffer: pickle.PickleBuffer) -> None:
        self.buffer = buffer

    def __reduce__(self) -> Any:
        return memoryview, (self.buffer,)


class _Pickler(pickle.Pickler):
    """Takes all arrays out of band; pickle alone leaves some layouts and types in the stream."""

    def reducer_override(self, obj: Any) -> Any:
        kind = type(obj)
        if kind is memoryview or kind.__module__.partition(".")[0] in _LIBRARIES:
            parts = None if isinstance(obj, type) else _kinds.take_apart(obj)
            if parts is None:
                return NotImplemented
            code, members = parts
            return _kinds.make, (code, tuple(map(_out_of_band, members)), True)
        numpy = sys.modules.get("numpy")
        if numpy is None or kind is not numpy.ndarray:
            return NotImplemented
        if obj.dtype.hasobject or obj.dtype.itemsize == 0 or obj.size == 0:
            return NotImplemented
        order = "F" if obj.flags.f_contiguous and not obj.flags.c_contiguous else "C"
        elements = obj.ravel(order)
        buffer = pickle.PickleBuffer(elements.view(numpy.uint8))
        return _array, (buffer, obj.dtype, obj.shape, order)


def _out_of_band(part: Any) -> Any:
    if type(part) is _kinds.Written:
        data = bytearray(part.length)
        part.write(data)
        return _View(pickle.PickleBuffer(data))
    return _View(part) if type(part) is pickle.PickleBuffer else part


def _array(buffer: Any, dtype: Any, shape: tuple[int, ...], order: Any) -> Any:
    """Make an array over a buffer; read-only if the buffer is."""
    import numpy

    return numpy.ndarray(shape, dtype, buffer, order=order)


def dumps(value: Any) -> tuple[bytes, list[memoryview]]:
    """Return the pickle of a value, and its buffers."""
    buffers: list[memoryview] = []

    def keep(buffer: pickle.PickleBuffer) -> bool:
        try:
            buffers.append(buffer.raw())
        except BufferError:
            # Not contiguous: into the pickle.
            return True
        return False

    file = io.BytesIO()
    _Pickler(file, protocol=5, buffer_callback=keep).dump(value)
    return file.getvalue(), buffers


def loads(data: Any, buffers: Sequence[Any]) -> Any:
    """Rebuild a value. Only for bytes of peers that have proved to belong to the federation."""
    return pickle.loads(data, buffers=buffers)
