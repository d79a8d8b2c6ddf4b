"""Pickling what is not of the basic types, with its large buffers out of band."""

import io
import pickle
import sys
from collections.abc import Sequence
from typing import Any


class _Pickler(pickle.Pickler):
    """Takes all arrays out of band; pickle alone leaves some layouts and types in the stream."""

    def reducer_override(self, obj: Any) -> Any:
        numpy = sys.modules.get("numpy")
        if numpy is None or type(obj) is not numpy.ndarray:
            return NotImplemented
        if obj.dtype.hasobject or obj.dtype.itemsize == 0 or obj.size == 0:
            return NotImplemented
        order = "F" if obj.flags.f_contiguous and not obj.flags.c_contiguous else "C"
        elements = obj.ravel(order)
        buffer = pickle.PickleBuffer(elements.view(numpy.uint8))
        return _array, (buffer, obj.dtype, obj.shape, order)


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
