"""Names of a reactor that its bodies use without naming them: refused before the program starts.

Compiled code tells in no time which bodies may be meant; only those are looked at more closely, by
``hprm._lint``, which is not imported otherwise.
"""

import re
from collections.abc import Callable, Container, Iterator
from types import CodeType
from typing import Any

from hprm._classes import ReactorBase
from hprm._source import ClassSource

Bodies = tuple[Callable[..., Any], Callable[..., Any] | None, Callable[..., Any] | None]


def check(
    cls: ClassSource, made: type[ReactorBase], bodies: list[Bodies], known: Container[str]
) -> None:
    """Refuse a class with such a body, if the module does not have what it uses either.

    ``made`` has what preambles have defined, besides parameters and methods.
    """
    names = {*vars(made), *(name for name, _ in cls.state), *(name for name, _, _ in cls.parts)}
    names = {name for name in names if name not in known and not name.startswith("_")}
    for reaction, functions in zip(cls.reactions, bodies, strict=True):
        handlers = (reaction.body, reaction.deadline, reaction.tardy)
        suspects = names.difference(reaction.arguments)
        for code, function in zip(handlers, functions, strict=True):
            if code is None or function is None:
                continue
            used = suspects.intersection(_used(function.__code__))
            # Compiled code does not tell `self.count` from `count` at once; the text does.
            if any(re.search(rf"(?<![\w.]){name}\b", code.text) for name in used):
                from hprm import _lint

                _lint.refuse(code, reaction, cls, known)


def _used(code: CodeType) -> Iterator[str]:
    """Find the names of globals and attributes in a body and in all functions inside."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _used(constant)
