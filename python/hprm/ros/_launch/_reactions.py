"""What follows in a launch when something happens: as data, and as functions of launch files.

A launch file is evaluated before anything starts, and so are the actions of handlers, in the place
in which the handler is registered. What a function of a handler returns is evaluated there, too,
but when something happens.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Coroutine, Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any, Literal

from hprm.ros._launch._entities import LaunchContext, shown, visit
from hprm.ros._launch._plans import LaunchError, LaunchPlan
from hprm.ros._launch.launch_description_sources import being_read

Kind = Literal["start", "exit", "output", "complete", "shutdown"]

_OWN = os.path.dirname(os.path.dirname(os.path.abspath(__file__))) + os.sep


@dataclass
class Reaction:
    """What follows when something happens."""

    kind: Kind
    #: Whether it does if that happens to the process of an action.
    counts: Callable[[Any], bool]
    #: What follows an event.
    answer: Callable[[Any], LaunchPlan]
    #: Where the handler is in its launch file.
    place: str
    once: bool = False
    #: What follows, if that is known before.
    plan: LaunchPlan | None = None
    is_over: bool = False


def place() -> str:
    """Return which file and line of a launch file is calling."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_OWN):
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def visited(context: LaunchContext, entities: Iterable[Any]) -> LaunchPlan:
    """Return what entities ask for that are visited later, in the context as it is now."""
    with context.apart() as plan:
        for entity in entities:
            visit(entity, context)
    return plan


def calling(
    context: LaunchContext, function: Callable[..., Any], takes_context: bool
) -> Callable[[Any], LaunchPlan]:
    """Return what calls a function with an event, and visits what that returns."""
    # What is set behind the handler is not for it; lists of what has started are shared.
    own = copy(context)
    own.launch_configurations = dict(context.launch_configurations)
    own.environment = dict(context.environment)
    own.parameters, own.remappings = list(context.parameters), list(context.remappings)

    def answer(event: Any) -> LaunchPlan:
        with being_read(own.file):
            returned = function(event, own) if takes_context else function(event)
        if isinstance(returned, Coroutine):
            returned.close()
            raise LaunchError("its function is a coroutine, which is not supported")
        return visited(own, listed(returned))

    return answer


def listed(entities: Any) -> list[Any]:
    """Return a list of what may be none, one entity or several ones."""
    if entities is None:
        return []
    is_one = isinstance(entities, str | bytes | Mapping) or not isinstance(entities, Iterable)
    return [entities] if is_one else list(entities)


def matcher(target: Any, is_action: Callable[[Any], bool], where: str) -> Callable[[Any], bool]:
    """Return what tells whether something of an action counts: all, this one, or what matches."""
    if target is None:
        return lambda action: True
    if is_action(target):
        return lambda action: action is target
    if callable(target):
        return lambda action: bool(target(action))
    raise LaunchError(
        f"{where}: {shown(target)} is neither an action that starts a process nor a function"
    )
