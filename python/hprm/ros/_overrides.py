"""Values that parameters are given from outside, for nodes whose names fit a pattern.

In a pattern, ``*`` stands for one token of a full name (``/robot/*``), ``**`` for any number.
"""

from __future__ import annotations

import re
from typing import TypeAlias

Scalar: TypeAlias = bool | int | float | str
Value: TypeAlias = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]


class Overrides:
    """Values of parameters by patterns of nodes' names, in the order in which they were stated."""

    def __init__(self) -> None:
        """Begin with none."""
        self._patterns: dict[str, dict[str, Value]] = {}

    def add(self, pattern: str, name: str, value: Value) -> None:
        """Add a value; it replaces one of the same pattern and name."""
        if not pattern.startswith("/"):
            pattern = f"/{pattern}"
        self._patterns.setdefault(pattern, {})[name] = value

    def of(self, node: str) -> dict[str, Value]:
        """Return the values for a node, by its full name; of two that fit, the later one counts."""
        found: dict[str, Value] = {}
        for pattern, values in self._patterns.items():
            if pattern_matches(pattern, node):
                found.update(values)
        return found

    def __bool__(self) -> bool:
        return bool(self._patterns)


def pattern_matches(pattern: str, node: str) -> bool:
    """Return whether a pattern fits the full name of a node."""
    tokens = [
        r"(/\w+)*" if token == "**" else r"/\w+" if token == "*" else f"/{re.escape(token)}"
        for token in pattern.strip("/").split("/")
    ]
    return re.fullmatch("".join(tokens), node, flags=re.ASCII) is not None
