"""Pickling what is not of the basic types, with its large buffers out of band."""

import contextlib
import io
import json
import pickle
from collections.abc import Sequence
from typing import Any

from hprm import _kinds
from hprm._kinds import buffers, loaded

# Libraries whose values have large buffers, which pickle alone would leave in the stream.
_LIBRARIES = ("array", "torch", "pyarrow", "pandas")


class _View:
    """A buffer that is a memoryview for its receiver."""

    def __init__(self, buffer: pickle.PickleBuffer) -> None:
        self.buffer = buffer

    def __reduce__(self) -> Any:
        return memoryview, (self.buffer,)


class _Buffers:
    """The buffers of a pickle, in its order."""

    def __init__(self) -> None:
        self.taken: list[Any] = []
        # What each of them shows, if it is one of the program.
        self.layouts: list[Any] = []
        # Those that were made here, by address.
        self._bytes: dict[int, pickle.PickleBuffer] = {}

    def of_bytes(self, data: Any) -> pickle.PickleBuffer:
        """Return a buffer that is nothing but bytes."""
        buffer = pickle.PickleBuffer(data)
        self._bytes[id(buffer)] = buffer
        return buffer

    def take(self, buffer: pickle.PickleBuffer) -> bool:
        """Take a buffer out of band."""
        data, layout = buffer, None
        if id(buffer) not in self._bytes:
            data, layout = buffers.layout_of(memoryview(buffer))
        self.taken.append(data)
        self.layouts.append(layout)
        return False


class _Pickler(pickle.Pickler):
    """Takes all arrays out of band; pickle alone leaves some layouts and types in the stream."""

    def __init__(self, file: Any, found: _Buffers) -> None:
        super().__init__(file, protocol=5, buffer_callback=found.take)
        self._found = found

    def reducer_override(self, obj: Any) -> Any:
        kind = type(obj)
        if kind is memoryview or kind.__module__.partition(".")[0] in _LIBRARIES:
            return NotImplemented if isinstance(obj, type) else self._by_parts(obj)
        numpy = loaded("numpy")
        if numpy is None or kind not in (numpy.ndarray, numpy.void):
            return NotImplemented
        if kind is numpy.void:
            return self._by_parts(obj)
        if obj.dtype.hasobject or obj.dtype.itemsize == 0 or obj.size == 0:
            return NotImplemented
        from hprm._kinds import arrays

        order = "F" if obj.flags.f_contiguous and not obj.flags.c_contiguous else "C"
        elements = arrays.raw(obj).ravel(order)
        return _array, (
            self._found.of_bytes(elements.view(numpy.uint8)),
            obj.dtype,
            obj.shape,
            order,
        )

    def _by_parts(self, obj: Any) -> Any:
        parts = _kinds.take_apart(obj)
        if parts is None:
            return NotImplemented
        code, members = parts
        return _kinds.make, (code, tuple(map(self._out_of_band, members)), True)

    def _out_of_band(self, part: Any) -> Any:
        if type(part) is _kinds.Written:
            data = bytearray(part.length)
            part.write(data)
            return _View(self._found.of_bytes(data))
        return _View(self._found.of_bytes(part)) if type(part) is pickle.PickleBuffer else part


def _array(buffer: Any, dtype: Any, shape: tuple[int, ...], order: Any) -> Any:
    """Make an array over a buffer; read-only if the buffer is."""
    import numpy

    return numpy.ndarray(shape, dtype, buffer, order=order)


def dumps(value: Any) -> tuple[bytes, list[Any]]:
    """Return the pickle of a value, and its buffers; the last one says what the others show."""
    file, found = io.BytesIO(), _Buffers()
    try:
        _Pickler(file, found).dump(value)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        # Only programs that fail pay for it; whatever becomes of the hint, the error must be shown.
        with contextlib.suppress(Exception):
            from hprm import _hints

            _hints.explain_unpicklable(error, __file__)
        raise
    layouts = [json.dumps(found.layouts).encode()] if found.taken else []
    return file.getvalue(), found.taken + layouts


def loads(data: Any, given: Sequence[Any]) -> Any:
    """Rebuild a value. Only for bytes of peers that have proved to belong to the federation."""
    *parts, layouts = given or [b"[]"]
    shown = [
        part if layout is None else buffers.memory(memoryview(part), *layout)
        for part, layout in zip(parts, json.loads(bytes(layouts)), strict=True)
    ]
    return pickle.loads(data, buffers=shown)
