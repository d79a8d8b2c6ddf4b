"""What a name in a body was meant to be: a part of the reactor, or something similar."""

import builtins
import difflib
import sys
from collections.abc import Iterable

from hprm._source import ClassSource, ReactionSource

# What programs for the C target call, and what that is here.
_C_TARGET = {
    "lf_set": "port.set(value)",
    "lf_schedule": "action.schedule(offset, value)",
    "lf_request_stop": "lf.request_stop()",
    "lf_time_logical": "lf.time.logical()",
    "lf_time_logical_elapsed": "lf.time.logical_elapsed()",
    "lf_time_physical": "lf.time.physical()",
    "lf_time_physical_elapsed": "lf.time.physical_elapsed()",
    "lf_tag": "lf.tag()",
    "lf_print": "print(...)",
    "SET": "port.set(value)",
    "schedule": "action.schedule(offset, value)",
}

# Under what names people know modules.
_MODULES = {
    "np": "import numpy as np",
    "pd": "import pandas as pd",
    "plt": "import matplotlib.pyplot as plt",
    "torch": "import torch",
    "cv2": "import cv2",
}

_MODULE = "`{0}` is a module; add `{1}` to a `preamble {{= ... =}}` at the top of the file"


def of_reactor(
    name: str, cls: ClassSource, reaction: ReactionSource | None, port: str = ""
) -> str | None:
    """Say how to reach what a reactor calls ``name``, perhaps with the ``port`` of a contained one.

    ``None`` if it has nothing of that name. Without a reaction, it is for a method or a value.
    """
    for what, names in (
        ("a parameter", [name for name, _ in cls.parameters]),
        ("a state variable", [name for name, _ in cls.state]),
        ("a method", [method[0] for method in cls.methods]),
    ):
        if name in names:
            return f"`{name}` is {what} of this reactor: write `self.{name}`"
    for part, kind, contained in cls.parts:
        if part != name:
            continue
        if reaction is None:
            return (
                f"`{name}` is {_article(kind)} of this reactor, and only its reactions can use it"
            )
        if contained is not None:
            return _contained(name, kind, contained, port)
        return f"`{name}` is {_article(kind)} of this reactor; {_ADD[kind].format(name)}"
    return None


_ADD = {
    "input": "add it to the triggers, `reaction({0})`, or behind them to read it only, "
    "`reaction(...) {0}`",
    "output": "add `-> {0}` to the reaction",
    "action": "add `-> {0}` to the reaction to schedule it, or `{0}` to the triggers",
    "timer": "it triggers reactions, and a body cannot use it",
    "mode": "add `-> reset({0})` or `-> history({0})` to the reaction",
}


def _article(kind: str) -> str:
    words = {"instance": "a contained reactor", "bank": "a bank"}
    return words.get(kind, f"{'an' if kind[0] in 'aio' else 'a'} {kind}")


def _contained(
    name: str, kind: str, contained: tuple[str, list[tuple[str, str]]], port: str
) -> str:
    cls, ports = contained
    found = dict(ports).get(port)
    if found is None and port:
        return missing_port(name, port, contained)
    if found is not None:
        return contained_port(name, port, found)
    return (
        f"`{name}` is {_article(kind)} of this reactor; name the ports that the reaction uses: "
        f"`reaction({name}.output)` or `-> {name}.input`"
    )


def contained_port(name: str, port: str, kind: str) -> str:
    """Say how a reaction names a port of a contained reactor."""
    if kind == "input":
        return f"`{name}.{port}` is an input of a contained reactor; add `-> {name}.{port}`"
    return (
        f"`{name}.{port}` is an output of a contained reactor; add it to the triggers, "
        f"`reaction({name}.{port})`"
    )


def missing_port(name: str, port: str, contained: tuple[str, list[tuple[str, str]]]) -> str:
    """Say which ports there are."""
    cls, ports = contained
    names = [name for name, _ in ports]
    like = did_you_mean(port, names)
    return like or f"the ports of `{cls}`: {', '.join(f'`{name}`' for name in names) or 'none'}"


def elsewhere(name: str, known: Iterable[str]) -> str | None:
    """Say what a name without a meaning might be, perhaps one of the ``known``."""
    if name in _C_TARGET:
        return f"in the Python target, this is `{_C_TARGET[name]}`"
    if name in _MODULES:
        return _MODULE.format(name, _MODULES[name])
    if name in sys.stdlib_module_names:
        return _MODULE.format(name, f"import {name}")
    return did_you_mean(name, [*known, *dir(builtins)])


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """Ask for the most similar name."""
    candidates = {other for other in known if other != name and not other.startswith("_")}
    lower = {other.lower(): other for other in sorted(candidates, reverse=True)}
    found = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.75)
    return f"did you mean `{lower[found[0]]}`?" if found else None
