"""What is done when something happens, as in ``launch.event_handlers``.

A launch is evaluated before it runs. So a handler counts if it says what is known before: that an
action starts with another one, or that the launch ends with it. Any other one is an error.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hprm.ros._launch._entities import LaunchContext, visit
from hprm.ros._launch._plans import LaunchError


class EventHandler:
    """What is done when something happens."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take any arguments: a launch that uses it is refused."""

    def register(self, context: LaunchContext) -> None:
        """Add to the plan what the handler asks for, or raise ``LaunchError``."""
        raise LaunchError(
            f"{type(self).__name__} is not supported: a launch is evaluated before it runs; "
            "OnProcessStart, and OnProcessExit with Shutdown, are"
        )


class OnProcessStart(EventHandler):
    """Actions with the start of another one."""

    def __init__(self, *, target_action: Any = None, on_start: Any, **kwargs: Any) -> None:
        """Take the action that is waited for, and the actions then."""
        super().__init__(**kwargs)
        self._actions = _listed(on_start, "on_start", "OnProcessStart")

    def register(self, context: LaunchContext) -> None:
        """Visit the actions: all processes start together."""
        for action in self._actions:
            visit(action, context)


class OnProcessExit(EventHandler):
    """The end of the launch with the end of an action."""

    def __init__(self, *, target_action: Any = None, on_exit: Any, **kwargs: Any) -> None:
        """Take the action whose end counts, and the actions then."""
        super().__init__(**kwargs)
        self._target = target_action
        self._actions = _listed(on_exit, "on_exit", "OnProcessExit")

    def register(self, context: LaunchContext) -> None:
        """Have the launch end with the action."""
        if self._target is None or not ends_the_launch(self._actions):
            raise LaunchError(
                "OnProcessExit is supported with a target_action and Shutdown() only: "
                "what else starts at the end of a process is not known before it runs"
            )
        context.required.append(self._target)


class OnExecutionComplete(EventHandler):
    """Not supported."""


class OnProcessIO(EventHandler):
    """Not supported."""


class OnShutdown(EventHandler):
    """Not supported."""


def _listed(actions: Any, name: str, handler: str) -> list[Any]:
    if callable(actions):
        raise LaunchError(
            f"{handler} with a function as {name} is not supported: a launch is evaluated before "
            "it runs"
        )
    return list(actions) if isinstance(actions, Iterable) else [actions]


def ends_the_launch(actions: Iterable[Any]) -> bool:
    """Return whether one of some actions ends the launch, and no other one does anything."""
    from hprm.ros._launch.actions import LogInfo, Shutdown

    actions = list(actions)
    ends = [action for action in actions if isinstance(action, Shutdown)]
    return bool(ends) and all(isinstance(action, Shutdown | LogInfo) for action in actions)
