"""A program of Python objects, declared to the runtime: its structure as data, and its bodies.

The structure is JSON, which the runtime checks by the rules of the language; it binds ports to the
reactors that run in this process, and calls their bodies.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cached_property
from typing import Any

from hprm import _construction, _coroutines, _facts, _structure
from hprm._class_body import handler_of
from hprm._hprm import Api
from hprm._parts import Action, Output
from hprm._reactor import Reactor
from hprm._types import accepted

Body = Callable[..., Any]


class Declared:
    """A program: its main reactor, and what that contains."""

    def __init__(self, main: Reactor, *, federated: bool = True, is_test: bool = False) -> None:
        """Declare the program whose main reactor is ``main``.

        Federations in a program that is not ``federated`` are ordinary reactors. In a test in
        virtual time, physical actions follow logical time.
        """
        if _construction.of(main).container is not None:
            raise ValueError(f"this {type(main).__name__} is contained in another reactor")
        unbind(main)
        self.main = main
        self._federated = federated
        self.is_test = is_test
        self._by_name: dict[str, Reactor] = {}
        self._note(main, type(main).__name__)

    @cached_property
    def text(self) -> str:
        """The structure of the program, as JSON."""
        structure = _structure.of(self.main, self._federated)
        structure["modules"] = _facts.of_code(self.main)
        return json.dumps(structure)

    def bind(self, reactor: str, parts: dict[str, Any], api: Api) -> None:
        """Let the attributes of a reactor, which runs here, be its ports, actions and modes."""
        vars(self._by_name[reactor]).update(parts, _hprm_api_=api)

    def bodies(self, reactor: str, reaction: int) -> tuple[Reactor, tuple[Body, Any, Any]]:
        """Return a reactor, and the body of one of its reactions with its handlers."""
        instance = self._by_name[reactor]
        cls = type(instance)
        declared = cls._hprm_reactions_[reaction]

        def body(function: Any) -> Any:
            return None if function is None else _coroutines.called(function)

        late, tardy = (handler_of(cls, declared, it) for it in (declared.late, declared.tardy))
        return instance, (body(declared.function), body(late), body(tardy))

    def types(self, reactor: str) -> dict[str, Any]:
        """Return what ``isinstance`` accepts, for outputs and actions of a reactor with a type."""
        parts = type(self._by_name[reactor])._hprm_parts_
        typed = {
            name: accepted(part.type)
            for name, part in parts.items()
            if isinstance(part, Output | Action)
        }
        return {name: types for name, types in typed.items() if types is not None}

    def _note(self, reactor: Reactor, name: str) -> None:
        self._by_name[name] = reactor
        for called, child in _construction.of(reactor).children.items():
            if isinstance(child, list):
                for index, member in enumerate(child):
                    self._note(member, f"{name}.{called}[{index}]")
            else:
                self._note(child, f"{name}.{called}")


def unbind(reactor: Reactor) -> None:
    """Let a reactor, and what it contains, have handles again: an earlier run has bound its parts.

    Its state stays as that run has left it.
    """
    found = vars(reactor)
    if found.pop("_hprm_api_", None) is not None:
        for name in type(reactor)._hprm_parts_:
            found.pop(name, None)
    for child in _construction.of(reactor).children.values():
        for member in child if isinstance(child, list) else [child]:
            unbind(member)


def load(path: str, properties: list[str]) -> Declared:
    """Load the program at ``path``: ``FILE.py`` or ``FILE.py:NAME``."""
    from hprm import _loading

    return _loading.load(path, properties)
