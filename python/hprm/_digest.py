"""Values as the logical trace knows them: taken apart for a digest, and a short text for people.

The walk over the basic types, and the hash, are in the native half; what is foreign to it comes
here. Nothing here may depend on the address of an object, on the seed of hashes, or on how often an
object is shared.
"""

import copyreg
import enum
import pickle
import sys
import types
from typing import Any

from hprm import _kinds
from hprm._kinds import loaded

# What `take_apart` returns: what to do, a name that tells the type, and what it holds.
Parts = tuple[str, str, Any]

_NAMED = (type, types.FunctionType, types.BuiltinFunctionType, types.ModuleType)

# The longest text of a scalar, in characters.
_TEXT = 60

# More bits than these make a number unreadable.
_BITS = 128

# Classes of paths, of which `str` says all.
_PATHS = ("PosixPath", "WindowsPath", "PurePosixPath", "PureWindowsPath")


def take_apart(value: Any) -> Parts:
    """Say what a value that is not of a basic type consists of.

    ``members`` have an order that matters and ``unordered`` ones have not; ``bytes`` are a buffer;
    ``named`` is only a name, and so is what is ``opaque``, which does not tell everything.
    """
    try:
        return _take_apart(value)
    except Exception:
        # Whatever a class of the program does when it is asked for its state.
        return "opaque", _label(type(value)), None


def text(value: Any) -> str:
    """Return a short text for people."""
    kind = type(value)
    if isinstance(value, enum.Enum):
        return f"{kind.__qualname__}.{value.name}"
    if kind is int and value.bit_length() > _BITS:
        return f"int of {value.bit_length()} bits"
    if value is None or kind in (bool, int, float, complex):
        return repr(value)
    if kind in (str, bytes):
        shown = repr(value[:_TEXT])
        return shown if len(value) <= _TEXT else f"{shown}... ({len(value)})"
    numpy = loaded("numpy")
    if numpy is not None and isinstance(value, numpy.ndarray):
        return f"{kind.__name__} {value.dtype} {value.shape}"
    if numpy is not None and isinstance(value, numpy.generic):
        return repr(value)[:_TEXT]
    if kind in (memoryview, pickle.PickleBuffer):
        view = memoryview(value)
        return f"memoryview {view.format} {view.shape}"
    if kind in (list, tuple, dict, set, frozenset, bytearray):
        return f"{kind.__name__} of {len(value)}"
    return _label(kind)


def _take_apart(value: Any) -> Parts:
    kind = type(value)
    if isinstance(value, _NAMED):
        name = getattr(value, "__qualname__", value.__name__)
        name = f"{getattr(value, '__module__', '')}.{name}"
        # Anonymous functions may differ and have the same name.
        hidden = not isinstance(value, type) and ("<lambda>" in name or "<locals>" in name)
        return ("opaque" if hidden else "named"), name, None
    if isinstance(value, enum.Enum):
        return "named", f"{_label(kind)}.{value.name}", None
    if kind in (memoryview, pickle.PickleBuffer):
        # What is sent as either arrives as the first.
        from hprm._kinds import buffers

        shown, held = buffers.elements(value)
        return "bytes", f"buffer {shown}", held
    pathlib = sys.modules.get("pathlib")
    if pathlib is not None and kind in (getattr(pathlib, name) for name in _PATHS):
        # What pickle takes of a path is how it was written, from Python 3.13 on.
        return "members", f"path {kind.__name__}", [str(value)]
    if isinstance(value, (set, frozenset)):
        if kind in (set, frozenset):
            return "unordered", kind.__name__, list(value)
        return "members", _label(kind), [frozenset(value), _sorted(getattr(value, "__dict__", {}))]
    numpy = loaded("numpy")
    if numpy is not None:
        if isinstance(value, numpy.ndarray):
            return _array(numpy, value)
        if isinstance(value, numpy.generic):
            return "members", f"scalar {_label(kind)}", [numpy.asarray(value)]
    parts = _of_library(kind, value)
    if parts is not None:
        return "members", _label(kind), parts
    if numpy is not None and hasattr(kind, "__dlpack__"):
        shared = _shared(numpy, value)
        if shared is not None:
            return "members", _label(kind), [shared]
    return _reduced(value)


def _of_library(kind: type, value: Any) -> list[Any] | None:
    """Take a value of a known library apart as messages do, without what only buffers show."""
    if kind.__module__.partition(".")[0] == "pyarrow":
        from hprm._kinds import arrow

        return arrow.elements(value) if arrow.taker(kind) is not None else None
    if kind.__module__.partition(".")[0] in ("pandas", "torch"):
        parts = _kinds.take_apart(value)
        return None if parts is None else list(parts[1])
    return None


def _array(numpy: Any, array: Any) -> Parts:
    dtype = array.dtype
    if type(array) is not numpy.ndarray:
        members = [array.view(numpy.ndarray), _sorted(getattr(array, "__dict__", {}))]
        if isinstance(array, numpy.ma.MaskedArray):
            mask = numpy.ma.getmaskarray(array)
            members = [mask, array.filled()]
        return "members", _label(type(array)), members
    name = f"array {dtype.str} {array.shape}"
    if dtype.names is not None:
        # The bytes between the fields are whatever was there.
        return "members", f"{name} {dtype.names}", [array[field] for field in dtype.names]
    if dtype.hasobject:
        return "members", name, array.ravel().tolist()
    if dtype.kind in "fc":
        if dtype.itemsize > (8 if dtype.kind == "f" else 16):
            # Extended precision has bytes without a meaning.
            return "members", name, [repr(number) for number in array.ravel()]
        array = _with_one_nan(numpy, array)
    if dtype.itemsize == 0 or array.size == 0:
        return "bytes", name, b""
    return "bytes", name, numpy.ascontiguousarray(array).reshape(-1).view(numpy.uint8)


def _with_one_nan(numpy: Any, array: Any) -> Any:
    """Give all NaNs the same bits."""
    if array.dtype.kind == "c":
        parts = [_with_one_nan(numpy, array.real), _with_one_nan(numpy, array.imag)]
        if parts[0] is array.real and parts[1] is array.imag:
            return array
        array = numpy.empty_like(array)
        array.real, array.imag = parts
        return array
    nan = numpy.isnan(array)
    return numpy.where(nan, array.dtype.type(numpy.nan), array) if nan.any() else array


def _shared(numpy: Any, value: Any) -> Any:
    """Return the elements of another library's tensor, if they can be reached without a copy."""
    detach = getattr(value, "detach", None)
    try:
        return numpy.from_dlpack(value if detach is None else detach())
    except Exception:
        return None


def _reduced(value: Any) -> Parts:
    """Take an object apart as pickle would."""
    kind = type(value)
    reduce = copyreg.dispatch_table.get(kind)
    reduced = value.__reduce_ex__(5) if reduce is None else reduce(value)
    if isinstance(reduced, str):
        return "named", f"{_label(kind)} {reduced}", None
    make, arguments, state, items, pairs = (tuple(reduced) + (None,) * 3)[:5]
    members = [
        make,
        tuple(arguments),
        _sorted(state),
        None if items is None else list(items),
        None if pairs is None else [tuple(pair) for pair in pairs],
    ]
    return "members", _label(kind), members


def _sorted(state: Any) -> Any:
    """Sort attributes by name: in which order an object got them does not matter."""
    if isinstance(state, dict) and all(isinstance(name, str) for name in state):
        return dict(sorted(state.items()))
    if isinstance(state, tuple) and len(state) == 2:
        return tuple(_sorted(part) for part in state)
    return state


def _label(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
