"""Events of a launch, as in ``launch.events``; only ``Shutdown`` can be asked for here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Event:
    """What happens while a launch runs."""

    #: What is called so in a launch.
    name = "launch.Event"


class Shutdown(Event):
    """The launch ends."""

    name = "launch.events.Shutdown"

    def __init__(self, *, reason: str = "reason not given", due_to_sigint: bool = False) -> None:
        """Say why."""
        self.reason = reason
        self.due_to_sigint = due_to_sigint


class ExecutionComplete(Event):
    """What an action has done is over."""

    name = "launch.events.ExecutionComplete"

    def __init__(self, *, action: Any) -> None:
        """Say of which action."""
        self.action = action


def matches_action(target_action: object) -> Callable[[object], bool]:
    """Return what tells whether an action is this one."""
    return lambda action: action is target_action


# It needs what is above.
from hprm.ros._launch.events import process as process  # noqa: E402
