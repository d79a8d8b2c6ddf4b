"""What launch files are made of: entities that are visited, substitutions, and the context.

The context is the state of an evaluation: configurations, environment, the file that is being read,
and what groups and includes add. It ends in a plan; nothing is started here.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from hprm.ros._launch._plans import LaunchError, LaunchPlan
from hprm.ros._overrides import Value


class Substitution:
    """A text that is known when a launch file is evaluated."""

    def perform(self, context: LaunchContext) -> str:
        """Return the text."""
        raise NotImplementedError(f"{type(self).__name__} has no method perform")

    def describe(self) -> str:
        """Return what it is, for messages."""
        return f"{type(self).__name__}()"


#: A text, a path, a substitution, or several ones that are joined.
SomeText: TypeAlias = Any
#: Old and new name, or name and value.
Pair: TypeAlias = tuple[Any, Any]


class _Plain(Substitution):
    def __init__(self, text: str) -> None:
        self.text = text

    def perform(self, context: LaunchContext) -> str:
        return self.text

    def describe(self) -> str:
        return repr(self.text)


def normalized(text: SomeText) -> list[Substitution]:
    """Return substitutions for what may be a text, a path, a substitution or several ones."""
    if isinstance(text, Substitution):
        return [text]
    if isinstance(text, str):
        return [_Plain(text)]
    if isinstance(text, os.PathLike):
        return [_Plain(os.fspath(text))]
    if isinstance(text, Iterable) and not isinstance(text, bytes | Mapping):
        return [each for some in text for each in normalized(some)]
    raise TypeError(f"{text!r} is neither a text nor a substitution")


def perform(context: LaunchContext, text: SomeText) -> str:
    """Return the text that substitutions make together."""
    return "".join(each.perform(context) for each in normalized(text))


def described(text: SomeText) -> str:
    """Return how substitutions are shown in messages."""
    return " + ".join(each.describe() for each in normalized(text))


def named(it: object, **facts: Any) -> str:
    """Return which class of ``launch`` or ``launch_ros`` this is of, and texts that it states."""
    module = type(it).__module__.removeprefix("hprm.ros._")
    # Files whose names begin so are parts of their package.
    module = ".".join(part for part in module.split(".") if not part.startswith("_"))
    stated = [f" {name}={described(text)}" for name, text in facts.items() if text is not None]
    return f"<{module}.{type(it).__name__}{''.join(stated)}>"


def shown(it: object) -> str:
    """Return what something is that is not what it should be, without addresses."""
    if type(it).__module__.startswith("hprm.ros._"):
        return named(it)
    return re.sub(r" at 0x[0-9a-f]+", "", repr(it))


def checked(entities: Iterable[Any], where: str = "") -> list[Any]:
    """Return entities as a list; raise ``LaunchError``, which says where, if one is none."""
    several = list(entities)
    for entity in several:
        if not isinstance(entity, LaunchDescriptionEntity):
            place = f"{where}: " if where else ""
            raise LaunchError(f"{place}{shown(entity)} is no action and no launch description")
    return several


def truth(text: str, what: str = "a condition") -> bool:
    """Return what a text says; raise ``LaunchError`` if it is neither true nor false."""
    plain = text.strip().lower()
    if plain in ("true", "1"):
        return True
    if plain in ("false", "0"):
        return False
    raise LaunchError(f"{what} is '{text}': it has to be true, 1, false or 0")


def flag(context: LaunchContext, value: Any, what: str) -> bool:
    """Return a bool, which may be stated by a text or a substitution."""
    return value if isinstance(value, bool) else truth(perform(context, value), what)


def number(context: LaunchContext, value: Any, what: str) -> float:
    """Return a number, which may be stated by a text or a substitution."""
    stated = str(value) if isinstance(value, int | float) else perform(context, value)
    try:
        return float(stated)
    except ValueError:
        raise LaunchError(f"{what} is '{stated}': it is no number") from None


class LaunchDescriptionEntity:
    """What is visited when a launch file is evaluated."""

    def visit(self, context: LaunchContext) -> None:
        """Add to the plan what this entity asks for."""
        raise NotImplementedError(f"{type(self).__name__} has no method visit")


class Condition:
    """What decides whether an action counts."""

    def __init__(self, *, predicate: Callable[[LaunchContext], bool] | None = None) -> None:
        """Take the function that decides."""
        self._predicate = predicate

    def evaluate(self, context: LaunchContext) -> bool:
        """Return whether the action counts."""
        return self._predicate is None or self._predicate(context)


class Action(LaunchDescriptionEntity):
    """An entity that does something, if its condition holds."""

    def __init__(self, *, condition: Condition | None = None) -> None:
        """Take the condition."""
        self.condition = condition

    def visit(self, context: LaunchContext) -> None:
        """Do it if the condition holds, and visit what comes of it."""
        if self.condition is not None and not self.condition.evaluate(context):
            return
        for entity in self.execute(context) or ():
            visit(entity, context)

    def execute(self, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Do it; return what is to be visited then."""
        raise NotImplementedError(f"{type(self).__name__} has no method execute")

    def describe(self) -> str:
        """Return what it is, for those that read a launch description as text."""
        return named(self)


class LaunchDescription(LaunchDescriptionEntity):
    """The entities of a launch file, in order."""

    def __init__(
        self,
        initial_entities: Iterable[LaunchDescriptionEntity] | None = None,
        *,
        deprecated_reason: str | None = None,
    ) -> None:
        """Begin with some entities."""
        self.entities = list(initial_entities or ())
        self.deprecated_reason = deprecated_reason

    def add_entity(self, entity: LaunchDescriptionEntity) -> None:
        """Add an entity at the end."""
        self.entities.append(entity)

    add_action = add_entity

    def visit(self, context: LaunchContext) -> None:
        """Visit all entities."""
        if self.deprecated_reason:
            context.plan.messages.append(
                f"this launch file is deprecated: {self.deprecated_reason}"
            )
        for entity in self.entities:
            visit(entity, context)


def visit(entity: Any, context: LaunchContext) -> None:
    """Visit an entity; raise ``LaunchError`` if it is none."""
    checked([entity])
    entity.visit(context)


@dataclass
class LaunchContext:
    """The state of an evaluation."""

    launch_configurations: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=lambda: dict(os.environ))
    #: The launch file that is being evaluated.
    file: Path | None = None
    #: The namespace of a group, absolute or empty.
    namespace: str = ""
    #: Parameters and remappings that a group sets for all its nodes.
    parameters: list[Path | tuple[str, Value]] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    delay: float = 0.0
    plan: LaunchPlan = field(default_factory=LaunchPlan)
    #: Whether the arguments are looked for, and nothing else.
    finds_arguments: bool = False
    #: Which launch files include the current one.
    including: tuple[Path, ...] = ()
    #: What follows when processes of actions end: whether the launch ends, and what is said.
    exits: list[tuple[Any, bool, list[str]]] = field(default_factory=list)
    #: What else follows when something happens.
    reactions: list[Any] = field(default_factory=list)
    #: Actions that were visited, and their plans.
    started: list[tuple[Any, Any]] = field(default_factory=list)
    #: Whether what is visited happens later than the start of the launch.
    is_later: bool = False

    @property
    def folder(self) -> Path:
        """The folder of the current launch file."""
        return Path.cwd() if self.file is None else self.file.parent

    def perform_substitution(self, substitution: Substitution) -> str:
        """Return the text of a substitution."""
        return substitution.perform(self)

    @contextmanager
    def apart(self) -> Iterator[LaunchPlan]:
        """Collect in another plan what happens later; take back, in the end, what that sets."""
        outer, delay, is_later = self.plan, self.delay, self.is_later
        self.plan = LaunchPlan(arguments=outer.arguments, known=outer.known)
        self.delay, self.is_later = 0.0, True
        with self.scope():
            yield self.plan
        self.plan, self.delay, self.is_later = outer, delay, is_later

    @contextmanager
    def scope(self, *, forwarding: bool = True) -> Iterator[None]:
        """Take back, in the end, what a group sets; without forwarding it begins empty."""
        names = ("launch_configurations", "environment", "parameters", "remappings")
        saved = {name: copy(getattr(self, name)) for name in names}
        namespace = self.namespace
        if not forwarding:
            self.launch_configurations = {}
            self.environment = dict(os.environ)
            self.parameters, self.remappings, self.namespace = [], [], ""
        yield
        for name, value in saved.items():
            setattr(self, name, value)
        self.namespace = namespace
