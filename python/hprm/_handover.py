"""Arrays and numbers that go to another federate of the same process, as they are."""

import sys
from typing import Any

# Types of Python's library whose values nobody can change, by the names of their modules.
_UNCHANGING = {
    "builtins": ("complex", "range", "ellipsis"),
    "datetime": ("date", "datetime", "time", "timedelta", "timezone"),
    "decimal": ("Decimal",),
    "fractions": ("Fraction",),
    "uuid": ("UUID",),
}


def frozen(value: Any, small: int) -> Any:
    """Return an array that nobody can change; numbers and the like as they are; otherwise None.

    An array of up to ``small`` bytes that somebody can write to is copied. A larger one becomes
    read-only, and so does what it is a view of: the caller knows that nobody else has a reference
    to them. Over memory that is not an array's, and that somebody can write to, it is copied as
    well.
    """
    kind = type(value)
    if kind.__qualname__ in _UNCHANGING.get(kind.__module__, ()):
        # A zone that a program defines is one of its classes.
        zone = getattr(value, "tzinfo", None)
        return value if zone is None or type(zone).__module__ == "datetime" else None
    numpy = sys.modules.get("numpy")
    if numpy is None:
        return None
    if isinstance(value, numpy.generic):
        return None if isinstance(value, numpy.void | numpy.object_) else value
    if type(value) is not numpy.ndarray or value.dtype.hasobject:
        return None
    arrays = [value]
    while isinstance(arrays[-1].base, numpy.ndarray):
        arrays.append(arrays[-1].base)
    safe = _is_read_only(arrays[-1].base)
    if safe and not any(array.flags.writeable for array in arrays):
        return value
    if value.nbytes <= small or not safe:
        value = value.copy(order="K")
        arrays = [value]
    for array in arrays:
        array.flags.writeable = False
    return value


def _is_read_only(memory: Any) -> bool:
    """Tell whether nobody can write to what an array lies over; None is its own memory."""
    if memory is None:
        return True
    try:
        with memoryview(memory) as view:
            return view.readonly
    except TypeError:
        return False
