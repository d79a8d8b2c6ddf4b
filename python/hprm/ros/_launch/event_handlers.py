"""What is done when something happens, as in ``launch.event_handlers``.

A launch is evaluated before it runs. So a handler counts if it says what is known before: that an
action starts with another one, or that the launch ends with it, or what is said then. Any other one
is an error.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hprm.ros._launch._entities import LaunchContext, perform, visit
from hprm.ros._launch._plans import LaunchError


class EventHandler:
    """What is done when something happens."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take any arguments: a launch that uses it is refused."""

    def register(self, context: LaunchContext) -> None:
        """Add to the plan what the handler asks for, or raise ``LaunchError``."""
        raise LaunchError(
            f"{type(self).__name__} is not supported: a launch is evaluated before it runs; "
            "OnProcessStart, and OnProcessExit with Shutdown and LogInfo, are"
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
    """What is said, and perhaps the end of the launch, at the end of an action."""

    def __init__(self, *, target_action: Any = None, on_exit: Any, **kwargs: Any) -> None:
        """Take the action whose end counts, and the actions then."""
        super().__init__(**kwargs)
        self._target = target_action
        self._actions = _listed(on_exit, "on_exit", "OnProcessExit")

    def register(self, context: LaunchContext) -> None:
        """Add that to the plan."""
        found = None if self._target is None else at_exit(context, self._actions)
        if found is None:
            raise LaunchError(
                "OnProcessExit is supported with a target_action, Shutdown() and LogInfo() only: "
                "what else starts at the end of a process is not known before it runs"
            )
        context.exits.append((self._target, *found))


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


def at_exit(context: LaunchContext, actions: Iterable[Any]) -> tuple[bool, list[str]] | None:
    """Return whether actions at the end of a process end the launch, and what they say.

    There is none if one of them does anything else.
    """
    from hprm.ros._launch.actions import LogInfo, Shutdown

    said: list[str] = []
    ends = False
    for action in actions:
        if not isinstance(action, Shutdown | LogInfo):
            return None
        if action.condition is not None and not action.condition.evaluate(context):
            continue
        if isinstance(action, LogInfo):
            said.append(perform(context, action.msg))
        ends = ends or isinstance(action, Shutdown)
    return ends, said
