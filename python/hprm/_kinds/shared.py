"""Arrays of libraries that share memory by DLPack, whichever they are.

Elements travel as an array of NumPy. A library that says what its namespace is gets them back;
otherwise they arrive as NumPy's.
"""

import importlib
from typing import Any

import numpy

from hprm._kinds import Parts, loaded


def of_namespace(array: Any, name: str | None, *, trusted: bool) -> Any:
    """Make an array of the library of that name, or leave it NumPy's if there is none."""
    if name is None:
        return array
    module: Any = loaded(name)
    if module is None and trusted:
        module = importlib.import_module(name)
    if not hasattr(module, "from_dlpack"):
        raise LookupError(f"an array of {name} has arrived, and the program has not imported that")
    return module.asarray(array)


def taker(kind: type) -> Any:
    """Return what takes apart arrays of a class; None for a class that adds to another."""
    torch = loaded("torch")
    known = (numpy.ndarray,) if torch is None else (numpy.ndarray, torch.Tensor)
    return None if issubclass(kind, known) else _take_shared


def _take_shared(value: Any) -> Parts | None:
    try:
        array = numpy.from_dlpack(value)
    except (BufferError, RuntimeError, TypeError, ValueError):
        # On another device, or of elements that NumPy does not know.
        return None
    namespace = getattr(value, "__array_namespace__", None)
    name = None if namespace is None else namespace().__name__
    found = loaded(name or "")
    return of_namespace, (array, name if hasattr(found, "from_dlpack") else None)
