"""Substitutions in the texts of YAML launch files: ``$(var name)`` and others.

Between ``$(`` and ``)`` are a name and arguments, which have substitutions and quotes of their own.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from hprm.ros._launch import substitutions as subs
from hprm.ros._launch._entities import SomeText, Substitution
from hprm.ros._launch._plans import LaunchError

_NAME = re.compile(r"[A-Za-z_][\w-]*")


def parse(text: str) -> list[Substitution]:
    """Return the substitutions of a text; raise ``LaunchError`` if they cannot be read."""
    parts, at = _parts(text, 0, "")
    assert at == len(text)
    return parts


def _parts(text: str, at: int, ends: str) -> tuple[list[Substitution], int]:
    """Read up to one of the characters that end it; return what there is, and where it ends."""
    parts: list[Substitution] = []
    plain = ""
    while at < len(text) and text[at] not in ends:
        if text.startswith("$(", at):
            if plain:
                parts.append(subs.TextSubstitution(text=plain))
                plain = ""
            found, at = _substitution(text, at + 2)
            parts.append(found)
            continue
        if text[at] == "\\" and at + 1 < len(text):
            at += 1
        plain += text[at]
        at += 1
    if plain or not parts:
        parts.append(subs.TextSubstitution(text=plain))
    return parts, at


def _substitution(text: str, at: int) -> tuple[Substitution, int]:
    name = _NAME.match(text, at)
    if name is None:
        raise LaunchError(f"'{text}': there is no name behind $(")
    at = name.end()
    arguments: list[SomeText] = []
    while True:
        while at < len(text) and text[at] == " ":
            at += 1
        if at == len(text):
            raise LaunchError(f"'{text}': $({name[0]} is not closed")
        if text[at] == ")":
            return _made(name[0], arguments, text), at + 1
        if text[at] in "'\"":
            argument, end = _parts(text, at + 1, text[at])
            at = end + 1
        else:
            argument, at = _parts(text, at, " )")
        arguments.append(argument)


def _made(name: str, arguments: list[SomeText], text: str) -> Substitution:
    make = _MAKERS.get(name)
    if make is None:
        known = ", ".join(sorted(_MAKERS))
        raise LaunchError(f"'{text}': there is no substitution '{name}'; there are: {known}")
    try:
        return make(*arguments)
    except TypeError:
        raise LaunchError(f"'{text}': $({name}) does not take {len(arguments)} arguments") from None


def _joined(arguments: tuple[SomeText, ...]) -> SomeText:
    """Return arguments as one text, with blanks between them."""
    texts: list[SomeText] = []
    for argument in arguments:
        texts += [" ", argument] if texts else [argument]
    return texts


def _share(package: SomeText) -> Substitution:
    from hprm.ros._launch_ros.substitutions import FindPackageShare

    return FindPackageShare(package)


def _program(executable: SomeText, package: SomeText) -> Substitution:
    from hprm.ros._launch_ros.substitutions import ExecutableInPackage

    return ExecutableInPackage(executable, package)


def _parameter(name: SomeText) -> Substitution:
    from hprm.ros._launch_ros.substitutions import Parameter

    return Parameter(name)


def _variable(name: SomeText, default: SomeText | None = None) -> Substitution:
    return subs.LaunchConfiguration(name, default=default)


def _environment(name: SomeText, default: SomeText | None = None) -> Substitution:
    return subs.EnvironmentVariable(name, default_value=default)


_MAKERS: dict[str, Callable[..., Substitution]] = {
    "all": subs.AllSubstitution,
    "and": subs.AndSubstitution,
    "anon": subs.AnonName,
    "any": subs.AnySubstitution,
    "command": lambda *words: subs.Command(_joined(words)),
    "dirname": subs.ThisLaunchFileDir,
    "env": _environment,
    "equals": subs.EqualsSubstitution,
    "eval": lambda *words: subs.PythonExpression(_joined(words)),
    "exec-in-pkg": _program,
    "file-content": subs.FileContent,
    "filename": subs.ThisLaunchFile,
    "find-exec": lambda name: subs.FindExecutable(name=name),
    "find-pkg-prefix": _share,
    "find-pkg-share": _share,
    "if": subs.IfElseSubstitution,
    "launch_log_dir": subs.LaunchLogDir,
    "log_dir": subs.LaunchLogDir,
    "not": subs.NotSubstitution,
    "not-equals": subs.NotEqualsSubstitution,
    "or": subs.OrSubstitution,
    "param": _parameter,
    "var": _variable,
}
