"""Evaluating a launch file: from its path and arguments to a plan."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hprm.ros._launch._entities import LaunchContext, LaunchDescription, visit
from hprm.ros._launch._plans import (
    ArgumentPlan,
    LaunchError,
    LaunchPlan,
    NodePlan,
    ProcessPlan,
)
from hprm.ros._launch._reactions import Reaction
from hprm.ros._launch.launch_description_sources import load


def parse_arguments(words: Iterable[str]) -> dict[str, str]:
    """Return launch arguments of a command line; raise ``LaunchError`` if one is none."""
    arguments = {}
    for word in words:
        name, separator, value = word.partition(":=")
        if not separator or not name:
            raise LaunchError(f"'{word}' is no launch argument: it is written NAME:=VALUE")
        arguments[name] = value
    return arguments


def evaluate(path: str | Path, arguments: Mapping[str, str] | None = None) -> LaunchPlan:
    """Return what a launch file asks for; nothing is started.

    Raises ``LaunchError`` with one message that names the file, for anything that is wrong in it or
    in what it includes; exceptions of code in Python launch files stay as they are.
    """
    file = Path(path).resolve()
    context = LaunchContext(dict(arguments or {}), file=file, including=(file,))
    return _evaluated(context, lambda: load(file))


def declared_arguments(
    path: str | Path, arguments: Mapping[str, str] | None = None
) -> list[ArgumentPlan]:
    """Return the arguments that a launch file declares, also if some that it needs are not given.

    Raises ``LaunchError`` if the file cannot be read. What it includes is looked at as far as that
    is known without the values of these.
    """
    file = Path(path).resolve()
    context = LaunchContext(dict(arguments or {}), file=file, including=(file,))
    context.finds_arguments = True
    description = load(file)
    with contextlib.suppress(LaunchError):
        visit(description, context)
    return context.plan.arguments


def evaluate_description(description: LaunchDescription, folder: Path) -> LaunchPlan:
    """Return what a launch description asks for that is no file."""
    context = LaunchContext(file=folder / "description")
    return _evaluated(context, lambda: description)


def _evaluated(context: LaunchContext, get: object) -> LaunchPlan:
    assert callable(get)
    try:
        visit(get(), context)
    except LaunchError as error:
        text = str(error)
        if context.file is not None and str(context.file) not in text:
            raise type(error)(f"{context.file}: {text}") from None
        raise
    plan = context.plan
    plan.reactions, plan.started, plan.exits = context.reactions, context.started, context.exits
    for action, process in plan.started:
        note_exits(plan, action, process)
    while any(_joins(plan, it) for it in plan.reactions):
        pass
    return plan


def note_exits(plan: LaunchPlan, action: Any, process: NodePlan | ProcessPlan) -> None:
    """Note what is said, and whether the launch ends, when the process of an action has ended."""
    for target, ends, said in plan.exits:
        if target is action:
            process.required |= ends
            process.farewell += said


def _joins(plan: LaunchPlan, reaction: Reaction) -> bool:
    """Add what starts with a process from the beginning; return whether there was any."""
    follows = reaction.plan
    if reaction.kind != "start" or reaction.is_over or follows is None or follows.ends:
        return False
    starts = (action for action, it in plan.started if any(it is own for own in plan.processes))
    if not any(map(reaction.counts, starts)):
        return False
    plan.processes += follows.processes
    plan.messages += follows.messages
    reaction.is_over = True
    return True
