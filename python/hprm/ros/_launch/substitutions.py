"""Texts that are known when a launch file is evaluated, as in ``launch.substitutions``."""

from __future__ import annotations

import importlib
import math
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from uuid import uuid4

from hprm.ros._launch._entities import (
    LaunchContext,
    SomeText,
    Substitution,
    described,
    normalized,
    perform,
    truth,
)
from hprm.ros._launch._plans import LaunchError


class SubstitutionFailure(LaunchError):
    """A substitution has no text."""


class TextSubstitution(Substitution):
    """A text as it is."""

    def __init__(self, *, text: str) -> None:
        """Take the text."""
        if not isinstance(text, str):
            raise TypeError(f"TextSubstitution takes a text, not {text!r}")
        self.text = text

    def perform(self, context: LaunchContext) -> str:
        """Return the text."""
        return self.text

    def describe(self) -> str:
        """Return the text in quotes."""
        return repr(self.text)


class LaunchConfiguration(Substitution):
    """The value of a launch argument, or of another configuration."""

    def __init__(self, variable_name: SomeText, *, default: SomeText | None = None) -> None:
        """Take the name, and what counts if there is no value."""
        self.variable_name = normalized(variable_name)
        self._default = default

    def perform(self, context: LaunchContext) -> str:
        """Return the value; raise ``SubstitutionFailure`` if there is none."""
        name = perform(context, self.variable_name)
        context.plan.known.add(name)
        if name in context.launch_configurations:
            value = context.launch_configurations[name]
            return value if isinstance(value, str) else str(value)
        if self._default is None:
            known = ", ".join(sorted(context.launch_configurations)) or "none"
            raise SubstitutionFailure(
                f"launch configuration '{name}' does not exist; there are: {known}"
            )
        return perform(context, _as_text(self._default))

    def describe(self) -> str:
        """Return its name."""
        return f"LaunchConfiguration({described(self.variable_name)})"


class PathJoinSubstitution(Substitution):
    """Parts of a path, with slashes between them."""

    def __init__(self, substitutions: Iterable[SomeText]) -> None:
        """Take the parts; several texts in a list are one part."""
        self.substitutions = [normalized(part) for part in substitutions]

    def perform(self, context: LaunchContext) -> str:
        """Return the path."""
        return os.path.join(*(perform(context, part) for part in self.substitutions))

    def __truediv__(self, other: SomeText) -> PathJoinSubstitution:
        return PathJoinSubstitution([*self.substitutions, other])

    def describe(self) -> str:
        """Return the parts."""
        return f"PathJoinSubstitution({', '.join(map(described, self.substitutions))})"


class PathSubstitution(PathJoinSubstitution):
    """A path to which ``/`` adds parts."""

    def __init__(self, path: SomeText) -> None:
        """Take the first part."""
        super().__init__([path])


class EnvironmentVariable(Substitution):
    """The value of a variable of the environment."""

    def __init__(self, name: SomeText, *, default_value: SomeText | None = None) -> None:
        """Take the name, and what counts if the variable is not set."""
        self._name = normalized(name)
        self._default = default_value

    def perform(self, context: LaunchContext) -> str:
        """Return the value; raise ``SubstitutionFailure`` if there is none."""
        name = perform(context, self._name)
        if name in context.environment:
            return context.environment[name]
        if self._default is None:
            raise SubstitutionFailure(f"environment variable '{name}' does not exist")
        return perform(context, self._default)


class PythonExpression(Substitution):
    """The value of an expression in Python."""

    def __init__(self, expression: SomeText, python_modules: SomeText = ("math",)) -> None:
        """Take the expression, and modules whose names it uses."""
        self.expression = normalized(expression)
        names = [python_modules] if isinstance(python_modules, str) else python_modules
        self.python_modules = [normalized(name) for name in names]

    def perform(self, context: LaunchContext) -> str:
        """Return the value as text."""
        expression = perform(context, self.expression)
        scope: dict[str, Any] = {}
        for name in self.python_modules:
            module = importlib.import_module(perform(context, name))
            scope |= {module.__name__: module, **vars(module)}
        try:
            return str(eval(expression, {}, scope))
        except Exception as error:
            raise SubstitutionFailure(f"the expression {expression!r} fails: {error!r}") from None


class Command(Substitution):
    """What a command prints."""

    def __init__(self, command: SomeText, *, on_stderr: SomeText = "fail") -> None:
        """Take the command, and what its standard error means: fail, ignore, warn or capture."""
        self.command = normalized(command)
        self.on_stderr = normalized(on_stderr)

    def perform(self, context: LaunchContext) -> str:
        """Run the command, and return its output."""
        command = perform(context, self.command)
        on_stderr = perform(context, self.on_stderr)
        try:
            run = subprocess.run(
                shlex.split(command),
                env=context.environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT if on_stderr == "capture" else subprocess.PIPE,
                text=True,
                check=False,
            )
        except OSError as error:
            raise SubstitutionFailure(f"the command {command!r} fails: {error}") from None
        if run.returncode:
            raise SubstitutionFailure(
                f"the command {command!r} ends with {run.returncode}: {(run.stderr or '').strip()}"
            )
        if run.stderr and on_stderr == "fail":
            raise SubstitutionFailure(
                f"the command {command!r} writes to its standard error: {run.stderr.strip()}"
            )
        if run.stderr and on_stderr == "warn":
            context.plan.messages.append(f"{command}: {run.stderr.strip()}")
        return run.stdout


class FindExecutable(Substitution):
    """The path of a program that the variable ``PATH`` finds."""

    def __init__(self, *, name: SomeText) -> None:
        """Take the name."""
        self.name = normalized(name)

    def perform(self, context: LaunchContext) -> str:
        """Return the path; raise ``SubstitutionFailure`` if there is none."""
        name = perform(context, self.name)
        found = shutil.which(name, path=context.environment.get("PATH"))
        if found is None:
            raise SubstitutionFailure(f"executable '{name}' is not on the PATH")
        return found


class ThisLaunchFile(Substitution):
    """The path of the current launch file."""

    def perform(self, context: LaunchContext) -> str:
        """Return the path."""
        if context.file is None:
            raise SubstitutionFailure("there is no launch file here")
        return str(context.file)


class ThisLaunchFileDir(Substitution):
    """The folder of the current launch file."""

    def perform(self, context: LaunchContext) -> str:
        """Return the path."""
        if context.file is None:
            raise SubstitutionFailure("there is no launch file here")
        return str(context.folder)


class LaunchLogDir(Substitution):
    """The folder for logs."""

    def perform(self, context: LaunchContext) -> str:
        """Return the path."""
        from hprm.ros.logging import get_logging_directory

        return str(get_logging_directory())


class FileContent(Substitution):
    """The text of a file."""

    def __init__(self, path: SomeText) -> None:
        """Take the path."""
        self.path = normalized(path)

    def perform(self, context: LaunchContext) -> str:
        """Return the text; raise ``SubstitutionFailure`` if the file cannot be read."""
        path = Path(perform(context, self.path))
        try:
            return path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SubstitutionFailure(f"the file {path} cannot be read: {error}") from None


class AnonName(Substitution):
    """A name with a unique end; equal names have equal ends in one launch."""

    def __init__(self, name: SomeText) -> None:
        """Take the name."""
        self.name = normalized(name)

    def perform(self, context: LaunchContext) -> str:
        """Return the name with its end."""
        name = perform(context, self.name)
        key = f"anon{name}"
        if key not in context.launch_configurations:
            context.launch_configurations[key] = f"{name}_{uuid4().hex[:12]}"
        return str(context.launch_configurations[key])


class LocalSubstitution(Substitution):
    """What is known only while a launch runs: not supported."""

    def __init__(self, expression: str, description: str | None = None) -> None:
        """Take the expression."""
        self.expression = expression

    def perform(self, context: LaunchContext) -> str:
        """Raise ``SubstitutionFailure``: a launch is evaluated before it runs."""
        raise SubstitutionFailure(
            f"LocalSubstitution('{self.expression}') is not supported: "
            "a launch is evaluated before it runs"
        )


class EqualsSubstitution(Substitution):
    """Whether two texts are equal: as bools, as numbers, or else letter by letter."""

    def __init__(self, left: SomeText, right: SomeText) -> None:
        """Take both texts."""
        self._sides = [normalized(_as_text(left)), normalized(_as_text(right))]

    def perform(self, context: LaunchContext) -> str:
        """Return ``true`` or ``false``."""
        left, right = (perform(context, side) for side in self._sides)
        return _said(_equal(left, right))


class NotEqualsSubstitution(EqualsSubstitution):
    """Whether two texts differ."""

    def perform(self, context: LaunchContext) -> str:
        """Return ``true`` or ``false``."""
        return _said(super().perform(context) == "false")


def _as_text(value: SomeText) -> SomeText:
    return str(value) if isinstance(value, bool | int | float) else value


def _said(value: bool) -> str:
    return "true" if value else "false"


def _equal(left: str, right: str) -> bool:
    bools = {"true": True, "1": True, "false": False, "0": False}
    if left.lower() in bools and right.lower() in bools:
        return bools[left.lower()] == bools[right.lower()]
    try:
        return math.isclose(float(left), float(right))
    except ValueError:
        return left == right


class NotSubstitution(Substitution):
    """The opposite of a condition."""

    def __init__(self, value: SomeText) -> None:
        """Take the condition."""
        self.value = normalized(value)

    def perform(self, context: LaunchContext) -> str:
        """Return ``true`` or ``false``."""
        return _said(not truth(perform(context, self.value)))


class AllSubstitution(Substitution):
    """Whether all conditions hold."""

    def __init__(self, *args: SomeText) -> None:
        """Take the conditions."""
        self.args = [normalized(argument) for argument in args]

    def perform(self, context: LaunchContext) -> str:
        """Return ``true`` or ``false``."""
        return _said(all(truth(perform(context, argument)) for argument in self.args))


class AnySubstitution(AllSubstitution):
    """Whether one of several conditions holds."""

    def perform(self, context: LaunchContext) -> str:
        """Return ``true`` or ``false``."""
        return _said(any(truth(perform(context, argument)) for argument in self.args))


class AndSubstitution(AllSubstitution):
    """Whether both conditions hold."""

    def __init__(self, left: SomeText, right: SomeText) -> None:
        """Take the conditions."""
        super().__init__(left, right)


class OrSubstitution(AnySubstitution):
    """Whether one of two conditions holds."""

    def __init__(self, left: SomeText, right: SomeText) -> None:
        """Take the conditions."""
        super().__init__(left, right)


class IfElseSubstitution(Substitution):
    """One of two texts."""

    def __init__(
        self, condition: SomeText, if_value: SomeText = "", else_value: SomeText = ""
    ) -> None:
        """Take the condition, and the texts for when it holds and when not."""
        self._condition = normalized(condition)
        self._texts = {True: normalized(if_value), False: normalized(else_value)}

    def perform(self, context: LaunchContext) -> str:
        """Return the text for the condition."""
        return perform(context, self._texts[truth(perform(context, self._condition))])
