"""Arrays and numbers that go to another federate of the same process.

Of an array only the memory is shared, and that is made read-only for good: an array that lies
over an object of Python that gives no writable buffer can never be made writeable. What else an
array has, such as its shape, can be changed; so each receiver gets an array of its own.
"""

import copy
from typing import Any

from hprm import _hprm
from hprm._kinds import loaded

# Types of Python's library whose values are immutable, by the names of their modules.
_UNCHANGING = {
    "builtins": ("complex", "range", "ellipsis"),
    "datetime": ("date", "datetime", "time", "timedelta", "timezone"),
    "decimal": ("Decimal",),
    "fractions": ("Fraction",),
    "uuid": ("UUID",),
}

# Memory that cannot be written. A read-only view of other memory may show what its owner writes.
_READ_ONLY = (bytes, _hprm.Memory, _hprm.Frozen)


def frozen(value: Any, small: int) -> Any:
    """Return an array that cannot be changed, for ``opened``; numbers and the like; otherwise None.

    An array of up to ``small`` bytes that can be written to is copied. The memory of a larger one
    becomes read-only, and so does what it is a view of: the caller knows that there is no other
    reference to them. Over memory that is not an array's, and that its owner may be able to write
    to, it is copied as well.
    """
    kind = type(value)
    if kind.__qualname__ in _UNCHANGING.get(kind.__module__, ()):
        # A zone that a program defines is one of its classes.
        zone = getattr(value, "tzinfo", None)
        return value if zone is None or type(zone).__module__ == "datetime" else None
    numpy = loaded("numpy")
    if numpy is None:
        return None
    if isinstance(value, numpy.generic):
        return None if isinstance(value, numpy.void | numpy.object_) else value
    if type(value) is not numpy.ndarray or value.dtype.hasobject:
        return None
    if value.nbytes == 0:
        return _empty(value)
    memory = _read_only_memory(numpy, value, small)
    if memory is None:
        return _copied(numpy, value)
    return _over(numpy, value, memory)


def opened(value: Any) -> Any:
    """Return what a receiver gets of what ``frozen`` has returned."""
    numpy = loaded("numpy")
    if numpy is None or type(value) is not numpy.ndarray:
        return value
    return _over(numpy, value, value.base) if value.nbytes else _empty(value)


def _read_only_memory(numpy: Any, value: Any, small: int) -> Any:
    """Return the memory that an array lies over, made read-only; None if that cannot be."""
    arrays = [value]
    while isinstance(arrays[-1].base, numpy.ndarray):
        arrays.append(arrays[-1].base)
    owner = arrays[-1]
    if type(owner.base) in _READ_ONLY:
        return owner.base
    if owner.base is not None:
        return None
    if any(array.flags.writeable for array in arrays):
        if value.nbytes <= small:
            return None
        for array in arrays:
            array.flags.writeable = False
    return _hprm.freeze(owner)


def _over(numpy: Any, array: Any, memory: Any) -> Any:
    """Return an array like another one, over the memory in which that lies."""
    offset = _address(array) - _address(numpy.frombuffer(memory, numpy.uint8))
    dtype = _own_dtype(array.dtype)
    return numpy.ndarray(array.shape, dtype, memory, offset, array.strides)


def _copied(numpy: Any, array: Any) -> Any:
    """Return a copy of an array, of every byte of it, over memory that cannot be written."""
    from hprm._kinds import arrays

    order: Any = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
    memory = arrays.raw(array).tobytes(order)
    return numpy.ndarray(array.shape, _own_dtype(array.dtype), memory, order=order)


def _empty(array: Any) -> Any:
    """Return a copy of an array of no bytes."""
    made = array.copy(order="K")
    made.flags.writeable = False
    return made


def _own_dtype(dtype: Any) -> Any:
    """Return a dtype of its own: the fields of a dtype can be given other names."""
    return dtype if dtype.names is None else copy.deepcopy(dtype)


def _address(array: Any) -> int:
    return int(array.__array_interface__["data"][0])
