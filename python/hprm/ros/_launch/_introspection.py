"""A launch description as a tree of text, as in ``launch``.

Nothing is evaluated for it: conditions and substitutions are shown as they are written. Objects
have no addresses, so the text is the same on every run.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from hprm.ros._launch._entities import Action, LaunchDescription, described, named
from hprm.ros._launch.actions import (
    ExecuteProcess,
    GroupAction,
    LogInfo,
    RegisterEventHandler,
    Shutdown,
    TimerAction,
)


@dataclass
class _Branch:
    text: str
    below: list[_Branch] = field(default_factory=list)


class LaunchIntrospector:
    """Shows launch descriptions."""

    def format_launch_description(self, launch_description: LaunchDescription) -> str:
        """Return a launch description as text: a line for it, and one for each entity.

        What is within groups, timers and handlers of events is below these.
        """
        lines = [named(launch_description)]
        lines += _tree(_entities(launch_description.entities), "")
        return "\n".join(lines)


def _tree(branches: list[_Branch], before: str) -> Iterable[str]:
    for number, branch in enumerate(branches, start=1):
        is_last = number == len(branches)
        yield f"{before}{'└── ' if is_last else '├── '}{branch.text}"
        yield from _tree(branch.below, f"{before}{'    ' if is_last else '│   '}")


def _entities(entities: Iterable[Any]) -> list[_Branch]:
    return [_entity(it) for it in entities]


def _entity(entity: Any) -> _Branch:
    if isinstance(entity, LaunchDescription):
        return _Branch(named(entity), _entities(entity.entities))
    if not isinstance(entity, Action):
        return _Branch(f"Unknown entity('{entity}')")
    if isinstance(entity, LogInfo):
        return _Branch(f"LogInfo({described(entity.msg)})")
    if isinstance(entity, Shutdown):
        return _Branch("EmitEvent(event='launch.events.Shutdown')")
    if isinstance(entity, ExecuteProcess):
        return _Branch(_process(entity))
    if isinstance(entity, RegisterEventHandler):
        handler = entity.event_handler
        text, actions = handler.describe()
        title = f"RegisterEventHandler('{named(handler)}'):"
        return _Branch(title, [_Branch(text, _entities(actions))])
    below = entity.actions if isinstance(entity, GroupAction | TimerAction) else []
    return _Branch(f"Action('{entity.describe()}')", _entities(below))


def _process(action: ExecuteProcess) -> str:
    words = ", ".join(map(described, action.cmd))
    folder = None if action.cwd is None else f"'{described(action.cwd)}'"
    variables = None
    if action.env is not None:
        pairs = (f"{described(name)}: {described(value)}" for name, value in action.env.items())
        variables = f"{{{', '.join(pairs)}}}"
    return f"ExecuteProcess(cmd=[{words}], cwd={folder}, env={variables}, shell={action.shell})"
