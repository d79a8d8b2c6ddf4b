"""How messages travel between the four programs: a module for each library, with a class `Ends`.

`Ends(session, role)` connects a program to its neighbours; `send(edge, message)` and
`receive(edge)` are for the edges that begin and end there. A message is a tuple, the pixels first
if it has any, or None for the last one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

ROLES = ("simulator", "agent", "detector", "fusion")

EDGES = {
    "birdview": ("simulator", "agent"),
    "picture": ("simulator", "detector"),
    "plan": ("agent", "fusion"),
    "sight": ("detector", "fusion"),
    "control": ("fusion", "simulator"),
}
"""From which program to which each edge leads."""


def leaving(role: str) -> list[str]:
    """The edges that begin at a program."""
    return [edge for edge, (source, _) in EDGES.items() if source == role]


def arriving(role: str) -> list[str]:
    """The edges that end at a program."""
    return [edge for edge, (_, target) in EDGES.items() if target == role]


def parted(message: Any) -> tuple[np.ndarray | None, Any]:
    """The pixels of a message, and the rest of it."""
    if message is not None and isinstance(message[0], np.ndarray):
        return message[0], message[1:]
    return None, message


def joined(pixels: np.ndarray | None, rest: Any) -> Any:
    """The message of these parts."""
    return rest if pixels is None else (pixels, *rest)
