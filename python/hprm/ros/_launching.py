"""``hprm launch``: starting what a launch file asks for, as one federation."""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import sys
import traceback
from pathlib import Path

from hprm.ros._coordinator import coordinate
from hprm.ros._following import Following
from hprm.ros._launch import (
    LaunchError,
    LaunchIntrospector,
    NodePlan,
    declared_arguments,
    evaluate,
    parse_arguments,
)
from hprm.ros._launch._packages import find_package
from hprm.ros._launch._plans import ArgumentPlan, ProcessPlan
from hprm.ros._launch.launch_description_sources import load
from hprm.ros._members import Plan
from hprm.ros._zenoh.session import Settings

#: Runs another program after so many seconds: it is in no federation, so the clock counts.
_LATER = """\
import os, signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_DFL)
time.sleep(float(sys.argv[1]))
os.execvp(sys.argv[2], sys.argv[2:])
"""


def launch(options: argparse.Namespace, settings: Settings | None = None) -> int:
    """Start what the command line names, and return the exit code."""
    try:
        file, words = _file(options.file, options.arguments)
        arguments = parse_arguments(words)
        if options.show_args:
            _show(declared_arguments(file, arguments))
            return 0
        if options.print_description:
            print(LaunchIntrospector().format_launch_description(load(Path(file).resolve())))
            return 0
        plan = evaluate(file, arguments)
        following = Following(plan, _plan)
        if options.fast:
            following.refuse_fast()
    except LaunchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except Exception as error:
        # Of the code in a launch file.
        _show_theirs(error)
        return 1
    for name in sorted(set(arguments) - plan.known):
        print(f"warning: nothing takes the launch argument '{name}'", file=sys.stderr)
    for message in plan.messages:
        print(message)
    if not following.first:
        print(f"error: {options.file} starts nothing", file=sys.stderr)
        return 1
    return coordinate(
        following.first,
        settings,
        options.logical_trace,
        is_fast=options.fast,
        following=following if plan.reactions else None,
    )


def _file(stated: str, words: list[str]) -> tuple[str, list[str]]:
    """Return the launch file that is stated, perhaps by a package and its name, and other words."""
    if not words or ":=" in words[0] or Path(stated).suffix or Path(stated).exists():
        return stated, words
    folder, name = find_package(stated, Path.cwd()), words[0]
    found = sorted(folder.rglob(name), key=lambda it: (it.parent != folder / "launch", it))
    if not found:
        raise LaunchError(f"package '{stated}' ({folder}) has no launch file '{name}'")
    return str(found[0]), words[1:]


def _show_theirs(error: Exception) -> None:
    """Show what code in a launch file raises as Python does, without what has called that code."""
    # All of the package: some of it loads the file.
    own = os.path.dirname(os.path.dirname(__file__)) + os.sep
    frames = [
        it
        for it in traceback.extract_tb(error.__traceback__)
        if not it.filename.startswith((own, "<frozen "))
    ]
    if not frames and not isinstance(error, SyntaxError):
        raise error
    says = traceback.format_exception_only(error)
    head = ["Traceback (most recent call last):\n"] if frames else []
    print("".join([*head, *traceback.format_list(frames), *says]), end="", file=sys.stderr)


def _check(stated: ProcessPlan) -> None:
    """Raise a ``LaunchError`` if there is no such command."""
    command, folder = stated.command[0], stated.folder or Path()
    places = stated.environment.get("PATH")
    if shutil.which(folder / command if "/" in command else command, path=places) is None:
        raise LaunchError(f"there is no command '{command}' that can be executed")


def _plan(stated: NodePlan | ProcessPlan) -> Plan:
    """Make the plan of a process."""
    if isinstance(stated, ProcessPlan):
        text = " ".join(stated.command)
        command = ("sh", "-c", text) if stated.shell else tuple(stated.command)
        name = stated.name or (shlex.split(text) if stated.shell else command)[0]
        if not stated.shell:
            _check(stated)
        if stated.delay:
            command = (sys.executable, "-c", _LATER, str(stated.delay), *command)
        return Plan(
            name.rpartition("/")[2],
            command,
            stated.environment,
            is_member=False,
            is_required=stated.required,
            folder=stated.folder,
            respawn=stated.respawn,
            farewell=tuple(stated.farewell),
        )
    name = stated.executable or stated.script.stem
    words = [sys.executable, "-m", "hprm.ros"]
    if stated.function is None:
        words += ["run", str(stated.script)]
    else:
        root = stated.root or stated.script.parent
        module = ".".join(stated.script.relative_to(root).with_suffix("").parts)
        words += ["call", str(root), module.removesuffix(".__init__"), stated.function]
    words += stated.command_line()
    return Plan(
        name,
        tuple(words),
        stated.environment,
        is_required=stated.required,
        delay_ns=round(stated.delay * 1e9),
        script=str(stated.script),
        respawn=stated.respawn,
        farewell=tuple(stated.farewell),
    )


def _show(arguments: list[ArgumentPlan]) -> None:
    """Show the arguments of a launch file, as ``ros2 launch`` does."""
    print("Arguments (pass arguments as '<name>:=<value>'):")
    if not arguments:
        print("\n  No arguments.")
    for it in arguments:
        print(f"\n    '{it.name}':")
        print(f"        {it.description or 'no description given'}")
        if it.choices:
            print(f"        one of: {', '.join(map(repr, it.choices))}")
        if it.default is not None:
            print(f"        (default: {it.default!r})")
