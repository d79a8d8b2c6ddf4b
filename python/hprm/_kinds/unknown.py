"""Objects of classes that a process does not know, which only looks at what others send.

Each is made of what the class would be made of: its attributes, or its name.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any


def instance(module: str, name: str, names: tuple[str, ...], *values: Any) -> SimpleNamespace:
    """Make a namespace of the attributes of a dataclass, a class of attrs, or a named tuple."""
    return SimpleNamespace(**dict(zip(names, values, strict=True)))


def model(module: str, name: str, state: dict[str, Any]) -> SimpleNamespace:
    """Make a namespace of the fields of a model of pydantic."""
    return SimpleNamespace(**state["__dict__"])


def member(module: str, name: str, which: str) -> str:
    """Name a member of an enumeration."""
    return which


def flags(module: str, name: str, value: int) -> int:
    """Return the number of a combination of flags."""
    return value


#: What stands in for what a function of ``classes`` would make, by the names of those.
STAND_INS: dict[str, Callable[..., Any]] = {
    "instance": instance,
    "named_tuple": instance,
    "member": member,
    "flags": flags,
    "model": model,
}
