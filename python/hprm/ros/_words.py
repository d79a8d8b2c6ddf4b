"""The words of `hprm ros run`: scripts with their arguments; what looks like a mistake there."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence

#: What stands between scripts that run together.
AND = "+"

#: What a script of rclpy has.
_IMPORTS = (b"rclpy", b"hprm.ros")


def programs(words: Sequence[str]) -> list[list[str]]:
    """Part the words of several scripts."""
    found: list[list[str]] = [[]]
    for word in words:
        if word == AND:
            found.append([])
        else:
            found[-1].append(word)
    return found


def errors(found: Sequence[Sequence[str]]) -> list[str]:
    """Say which scripts are not there."""
    wrong = [f"there is no file {it[0]}" for it in found if it and not os.path.isfile(it[0])]
    if not all(found):
        wrong.append(f"there is no script before or behind a {AND}")
    return wrong


def warnings(found: Sequence[Sequence[str]]) -> Iterator[str]:
    """Name arguments that are scripts of rclpy themselves, and the command that runs these."""
    for script, *arguments in found:
        taken = [it for it in _plain(arguments) if _is_script(arguments[it])]
        if not taken:
            continue
        command = ["hprm", "ros", "run", script]
        for number, word in enumerate(arguments):
            command += [AND, word] if number in taken else [word]
        names = ", ".join(arguments[it] for it in taken)
        yield (
            f"warning: no script of its own, but an argument of {script}: {names}\n"
            f"  hint: put a {AND} between scripts: {shlex.join(command)}"
        )


def _plain(arguments: Sequence[str]) -> Iterator[int]:
    """Find the arguments that are no options of a script, and no values of options."""
    before = ""
    for number, word in enumerate(arguments):
        if word == "--ros-args":
            return
        if not word.startswith("-") and not before.startswith("-"):
            yield number
        before = word


def _is_script(path: str) -> bool:
    """Whether this is a file in Python that imports rclpy."""
    if not path.endswith(".py") or not os.path.isfile(path):
        return False
    with open(path, "rb") as file:
        text = file.read()
    return any(it in text for it in _IMPORTS)
