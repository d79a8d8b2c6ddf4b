"""Messages, services and actions of ROS 2 without ROS: packages to import, and classes by name.

``install`` lets Python import the standard packages, and those of users, under their own names.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from hprm.ros._messages.definitions import DefinitionError
from hprm.ros._messages.finder import MessageFinder, resolve

__all__ = ["DefinitionError", "class_of", "find_beside", "install", "type_name"]

_finder = MessageFinder()


def install(comes_first: bool = False) -> None:
    """Let Python import packages of messages.

    An installation of ROS goes first, unless ``comes_first``.
    """
    _finder.comes_first = comes_first
    if _finder not in sys.meta_path:
        sys.meta_path.insert(0, _finder)


def find_beside(programs: Sequence[str]) -> None:
    """Look for packages of messages beside these programs, too, which run in other processes."""
    _finder.others = tuple(programs)
    _finder.invalidate_caches()


def class_of(name: str) -> Any:
    """Find a class by its name, as ``std_msgs/msg/String`` or ``std_msgs/String``.

    Raises ``LookupError`` if there is none.
    """
    if name.count("/") not in (1, 2):
        raise LookupError(f"{name!r}: types have names like std_msgs/msg/String")
    return resolve(name)


def type_name(kind: type) -> str:
    """Return the name of the class of a message, a service or an action, with its package."""
    package, interface, *_ = kind.__module__.split(".")
    return f"{package}/{interface}/{kind.__name__}"
