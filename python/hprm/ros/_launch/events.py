"""Events of a launch, as in ``launch.events``; only ``Shutdown`` can be asked for here."""

from __future__ import annotations

from collections.abc import Callable


class Event:
    """What happens while a launch runs."""


class Shutdown(Event):
    """The launch ends."""

    def __init__(self, *, reason: str = "reason not given", due_to_sigint: bool = False) -> None:
        """Say why."""
        self.reason = reason
        self.due_to_sigint = due_to_sigint


def matches_action(target_action: object) -> Callable[[object], bool]:
    """Return what tells whether an action is this one."""
    return lambda action: action is target_action
