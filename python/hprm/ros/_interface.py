"""What the runtime has to know of message classes: their names, and how to copy a message."""

from __future__ import annotations

import copy
import inspect
from typing import Any

from hprm.ros import _messages
from hprm.ros.exceptions import NoTypeSupportImportedException

#: What classes of interfaces have; those of actions are made of some of both kinds.
_HAS = {"message": "get_fields_and_field_types", "service": "Request", "action": "Impl"}


def type_name(cls: Any, kind: str) -> str:
    """Return the name of an interface: ``std_msgs/msg/String``.

    Raises
    ------
    NoTypeSupportImportedException
        If this is no class of a ``message``, a ``service`` or an ``action``, whichever is asked.

    """
    parts = getattr(cls, "__module__", "").split(".") if isinstance(cls, type) else []
    if len(parts) < 2 or parts[1] not in ("msg", "srv", "action") or not hasattr(cls, _HAS[kind]):
        # A message may be large: it is not shown.
        is_short = cls is None or isinstance(cls, type)
        what = repr(cls) if is_short else f"an instance of {type(cls)!r}"
        article = "an" if kind == "action" else "a"
        raise NoTypeSupportImportedException(f"{what} is no class of {article} {kind}")
    return _messages.type_name(cls)


def check_callback(callback: Any) -> None:
    """Raise a TypeError if what is to be called cannot be."""
    if not callable(callback):
        raise TypeError(f"a callback has to be callable, and {callback!r} is not")


def takes(callback: Any, number: int) -> bool:
    """Return whether something can be called with so many arguments, as far as that is known."""
    try:
        inspect.signature(callback).bind(*[object()] * number)
    except TypeError:
        return False
    except ValueError:
        # Some functions in C do not tell.
        return number == 1
    return True


def copy_of(message: Any) -> Any:
    """Return a copy of a message, which shares large arrays with it."""
    copied = getattr(message, "_copied", None)
    return copy.deepcopy(message) if copied is None else copied()
