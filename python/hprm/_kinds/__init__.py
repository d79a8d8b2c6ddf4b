"""Values of known classes: of what parts they are made, and making them again.

The native half walks a value. What is not of a basic type it shows to ``take_apart``, which returns
a number and the parts, values themselves; at the other end ``make`` gets them back. What the
numbers mean is in ``_MAKERS`` and never changes. Whatever comes from the network can only choose
among these, and no class is made but those that ``classes`` lets pass; no code travels.

No library is imported here because it might be installed: a value of it exists only where the
program has imported it, and where one arrives it is needed.
"""

import importlib
import sys
from collections.abc import Callable
from pickle import PickleBuffer
from typing import Any

__all__ = [
    "PickleBuffer",
    "Written",
    "loaded",
    "make",
    "make_or_stand_in",
    "place",
    "slots_alone",
    "take_apart",
]

# The function that makes a value again, and of what.
Parts = tuple[Callable[..., Any], tuple[Any, ...]]

# For each number, the module and the function in it. Numbers are part of the format of messages.
_MAKERS = {
    0: ("standard", "text"),
    1: ("standard", "decimal_"),
    2: ("standard", "fraction"),
    3: ("standard", "datetime_"),
    4: ("standard", "date"),
    5: ("standard", "time"),
    6: ("standard", "timedelta"),
    7: ("standard", "timezone"),
    8: ("standard", "zone"),
    9: ("standard", "uuid_"),
    10: ("standard", "path"),
    11: ("standard", "range_"),
    12: ("standard", "slice_"),
    13: ("standard", "ellipsis_"),
    14: ("buffers", "memory"),
    15: ("standard", "array_"),
    16: ("classes", "instance"),
    17: ("classes", "named_tuple"),
    18: ("classes", "member"),
    19: ("classes", "flags"),
    20: ("classes", "model"),
    21: ("arrays", "scalar"),
    22: ("arrays", "text_scalar"),
    23: ("arrays", "objects"),
    24: ("arrays", "masked"),
    25: ("tensors", "tensor"),
    26: ("shared", "of_namespace"),
    27: ("arrow", "schema"),
    28: ("arrow", "batch"),
    29: ("arrow", "table"),
    30: ("arrow", "array_"),
    31: ("arrow", "chunked"),
    32: ("frames", "frame"),
    33: ("frames", "series"),
    34: ("frames", "index"),
    35: ("frames", "range_index"),
    36: ("frames", "multi_index"),
    37: ("frames", "categorical"),
    38: ("frames", "zoned"),
    39: ("frames", "masked"),
    40: ("frames", "strings"),
    41: ("frames", "arrow_backed"),
    42: ("frames", "timestamp"),
    43: ("frames", "duration"),
    44: ("frames", "missing"),
    45: ("arrow", "scalar"),
    46: ("frames", "periods"),
    47: ("frames", "intervals"),
    48: ("zones", "zone"),
}

# Whose classes are whose, by the first name of their modules.
_LIBRARIES = {
    "numpy": "arrays",
    "torch": "tensors",
    "pyarrow": "arrow",
    "pandas": "frames",
    "pytz": "zones",
}

# More classes than a program sends: forget all, rather than grow.
_CACHE_LIMIT = 1024

# Whose functions have to know whether the sender is trusted.
_TRUSTING = ("classes", "arrow", "shared")

_Taker = Callable[[Any], Parts | None]

_takers: dict[type, _Taker | None] = {}
_slots: dict[type, tuple[Any, ...] | None] = {}
_makers: dict[int, tuple[Callable[..., Any], bool]] = {}
_codes: dict[Callable[..., Any], int] = {}


class Written:
    """Bytes that write themselves into a buffer of ``length``, once it is there."""

    __slots__ = ("length", "write")

    def __init__(self, length: int, write: Callable[[Any], object]) -> None:
        """Let ``write`` write, which must not keep the buffer."""
        self.length = length
        self.write = write


def loaded(name: str) -> Any:
    """Return a module that the program has imported, all of it; None if it has not."""
    module = sys.modules.get(name)
    if getattr(getattr(module, "__spec__", None), "_initializing", False):
        # Another thread imports it just now. This waits until that is done.
        return importlib.import_module(name)
    return module


def take_apart(value: Any) -> tuple[int, tuple[Any, ...]] | None:
    """Return how a value is made and its parts; None if its class is not known."""
    kind = type(value)
    try:
        taker = _takers[kind]
    except KeyError:
        taker = _remember(kind)
    parts = None if taker is None else taker(value)
    if parts is None:
        return None
    maker, members = parts
    try:
        return _codes[maker], members
    except KeyError:
        return _code(maker), members


def make(code: int, members: tuple[Any, ...], trusted: bool) -> Any:
    """Make a value. Modules are imported for a ``trusted`` sender only."""
    try:
        maker, asks = _makers[code]
    except KeyError:
        maker, asks = _maker(code)
    return maker(*members, trusted=trusted) if asks else maker(*members)


def make_or_stand_in(code: int, members: tuple[Any, ...]) -> Any:
    """Make a value; of a class that is not known here, what stands in for it."""
    try:
        return make(code, members, trusted=False)
    except (AttributeError, LookupError):
        module, function = _MAKERS.get(code, ("", ""))
        if module != "classes":
            raise
        from hprm._kinds.unknown import STAND_INS

        return STAND_INS[function](*members)


def slots_alone(kind: type) -> tuple[Any, ...] | None:
    """Return the descriptors of a class's slots, if taking its objects apart runs no code of it.

    Then their attributes are in these slots, in their dict or, for a named tuple, among its
    members, and nowhere else. None if that is not sure.
    """
    try:
        return _slots[kind]
    except KeyError:
        from hprm._kinds import classes

        if len(_slots) >= _CACHE_LIMIT:
            _slots.clear()
        _slots[kind] = found = classes.slots_alone(kind)
        return found


def place(code: int, members: tuple[Any, ...], index: int) -> str:
    """Say for people where in a value a part is."""
    module, name = _MAKERS[code]
    if module == "classes" and name in ("instance", "named_tuple") and index >= _NAMES:
        return f".{members[_NAMES - 1][index - _NAMES]}"
    return ""


# An object is three parts that name its class and its attributes, and these.
_NAMES = 3


def _code(maker: Callable[..., Any]) -> int:
    names = maker.__module__.rpartition(".")[2], maker.__name__
    code = next(code for code, each in _MAKERS.items() if each == names)
    _codes[maker] = code
    return code


def _maker(code: int) -> tuple[Callable[..., Any], bool]:
    if code not in _MAKERS:
        raise ValueError(f"malformed payload: nothing is made by the number {code}")
    module, name = _MAKERS[code]
    maker = getattr(importlib.import_module(f"hprm._kinds.{module}"), name)
    _makers[code] = maker, module in _TRUSTING
    return _makers[code]


def _remember(kind: type) -> _Taker | None:
    if len(_takers) >= _CACHE_LIMIT:
        _takers.clear()
    _takers[kind] = taker = _taker(kind)
    return taker


def _taker(kind: type) -> _Taker | None:
    library = _LIBRARIES.get(kind.__module__.partition(".")[0])
    if library is not None:
        found: _Taker | None = importlib.import_module(f"hprm._kinds.{library}").taker(kind)
        if found is not None:
            return found
    from hprm._kinds import classes, standard

    found = standard.TAKERS.get(kind) or classes.taker(kind)
    if found is None and hasattr(kind, "__dlpack__") and "numpy" in sys.modules:
        from hprm._kinds import shared

        found = shared.taker(kind)
    return found
