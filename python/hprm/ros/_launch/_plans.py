"""What a launch comes to: processes to start, as data."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from hprm.ros._overrides import Scalar, Value

#: A file of parameters, or values by name.
Parameters: TypeAlias = Path | dict[str, Value]


class LaunchError(Exception):
    """A launch file is wrong, or asks for what is not there; the message says where."""


@dataclass(frozen=True)
class Respawn:
    """How a process that has ended is started again."""

    delay: float = 0.0
    #: How often; always if it is negative.
    retries: int = -1


@dataclass
class NodePlan:
    """A node to start: a program in Python, with what its command line tells it."""

    script: Path
    name: str | None = None
    namespace: str | None = None
    #: The later one of two values counts.
    parameters: list[Parameters] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)
    #: What its environment has beyond that of the launch, or has another value there.
    environment: dict[str, str] = field(default_factory=dict)
    #: The function that the entry point names (``talker:main``), instead of the script's end.
    function: str | None = None
    #: The folder from which the script's package is imported.
    root: Path | None = None
    package: str | None = None
    executable: str = ""
    #: Seconds after the start of the launch.
    delay: float = 0.0
    #: Whether the launch ends when it ends.
    required: bool = False
    respawn: Respawn | None = None
    #: What is said when it has ended.
    farewell: list[str] = field(default_factory=list)
    output: str = "log"

    def command_line(self) -> list[str]:
        """Return the arguments behind the script: its own ones, then those after ``--ros-args``."""
        words: list[str] = []
        if self.name is not None:
            words += ["-r", f"__node:={self.name}"]
        if self.namespace is not None:
            words += ["-r", f"__ns:={self.namespace}"]
        for some in self.parameters:
            if isinstance(some, Path):
                words += ["--params-file", str(some)]
            else:
                for name, value in some.items():
                    words += ["-p", f"{name}:={as_yaml(value)}"]
        for old, new in self.remappings:
            words += ["-r", f"{old}:={new}"]
        return [*self.arguments, "--ros-args", *words] if words else list(self.arguments)


@dataclass
class ProcessPlan:
    """Another program to start."""

    command: list[str]
    name: str | None = None
    environment: dict[str, str] = field(default_factory=dict)
    folder: Path | None = None
    #: Whether a shell reads the command, which then is one text.
    shell: bool = False
    delay: float = 0.0
    required: bool = False
    respawn: Respawn | None = None
    #: What is said when it has ended.
    farewell: list[str] = field(default_factory=list)
    output: str = "log"


@dataclass
class ArgumentPlan:
    """An argument that a launch file declares."""

    name: str
    default: str | None
    description: str | None
    choices: list[str] | None


@dataclass
class LaunchPlan:
    """What a launch file asks for, in its order."""

    processes: list[NodePlan | ProcessPlan] = field(default_factory=list)
    #: What ``LogInfo`` says.
    messages: list[str] = field(default_factory=list)
    arguments: list[ArgumentPlan] = field(default_factory=list)
    #: The names of configurations that something has declared or asked for.
    known: set[str] = field(default_factory=set)
    #: Whether the launch ends then, for what follows when something happens.
    ends: bool = False
    #: What follows when something happens (``_reactions.py``).
    reactions: list[Any] = field(default_factory=list)
    #: The actions of launch files with the processes that they start.
    started: list[tuple[Any, NodePlan | ProcessPlan]] = field(default_factory=list)
    #: What follows when their processes end: whether the launch ends, and what is said.
    exits: list[tuple[Any, bool, list[str]]] = field(default_factory=list)

    @property
    def nodes(self) -> list[NodePlan]:
        """The nodes among the processes."""
        return [plan for plan in self.processes if isinstance(plan, NodePlan)]


def as_yaml(value: Value) -> str:
    """Return a value as YAML of the command line, which reads it as the same value."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(_scalar_yaml, value))}]"
    return _scalar_yaml(value)


def _scalar_yaml(value: Scalar) -> str:
    if isinstance(value, float) and not isinstance(value, int):
        if math.isnan(value):
            return ".nan"
        if math.isinf(value):
            return "-.inf" if value < 0 else ".inf"
        return repr(value)
    # What JSON has for texts, integers and bools, YAML reads as the same.
    return json.dumps(value)
