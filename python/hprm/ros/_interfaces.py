"""Message classes that the library itself makes, imported at their first use.

Modules of messages are found by name (``builtin_interfaces.msg``), so it is the same whether they
are those of this package or of a ROS installation; and ``import hprm.ros.time`` imports none.
"""

from functools import cache
from importlib import import_module
from typing import Any


@cache
def interface(module: str, name: str) -> Any:
    """Return the class of an interface, as ``interface("builtin_interfaces.msg", "Time")``."""
    return getattr(import_module(module), name)
