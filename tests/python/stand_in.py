"""A small way to declare programs in Python, for the tests of the extension module.

It makes the JSON by hand, so that these tests depend on nothing but what the module is given. A
reactor is an object of a class with lists of what it has; its reactions are methods.
"""

from __future__ import annotations

import inspect
import json
import linecache
from collections.abc import Callable, Iterator
from typing import Any

Body = Callable[[Any], Any]


class Reactor:
    """A reactor: subclasses say what it has."""

    federated = False
    #: Of the main reactor: its file, if no reaction of it tells.
    file: str | None = None
    #: ``input x``, ``output[3] y``, ``mutable z``.
    ports: tuple[str, ...] = ()
    #: Name, offset and period.
    timers: tuple[tuple[Any, ...], ...] = ()
    #: Name, and other fields of an action.
    actions: tuple[dict[str, Any], ...] = ()
    #: The first one is initial.
    modes: tuple[str, ...] = ()
    #: Other fields of children, and of what lies in modes, by name.
    options: dict[str, dict[str, Any]] = {}
    #: From, to, and other fields.
    connections: tuple[tuple[Any, ...], ...] = ()
    #: Fields of a reaction; its methods are NAME, NAME_late and NAME_tardy.
    reactions: tuple[dict[str, Any], ...] = ()
    #: Of values that are set.
    types: dict[str, Any] = {}
    #: What federates compare.
    facts: tuple[tuple[str, str], ...] = ()
    api: Any

    def children(self) -> dict[str, Reactor | list[Reactor]]:
        """Return what it contains, by name."""
        kinds = Reactor | list
        return {name: it for name, it in vars(self).items() if isinstance(it, kinds)}


class Declared:
    """What the extension module is given."""

    def __init__(self, main: Reactor, **properties: Any) -> None:
        """Declare a program."""
        self.file = main.file or inspect.getfile(type(main))
        self.reactors: list[dict[str, Any]] = []
        self.instances: dict[str, Reactor] = {}
        number = self._add(main, type(main).__name__)
        values = [
            {"name": name, "at": [0, 1, 0, 0], "value": it} for name, it in properties.items()
        ]
        document = {
            "files": [{"path": self.file, "text": "".join(linecache.getlines(self.file))}],
            "properties": values,
            "main": number,
            "reactors": self.reactors,
            "modules": [],
        }
        self.text = json.dumps(document)

    def types(self, reactor: str) -> dict[str, Any]:
        """Return the types of what may be set."""
        return self.instances[reactor].types

    def bind(self, reactor: str, parts: dict[str, object], api: object) -> None:
        """Give an instance its ports, actions and modes."""
        vars(self.instances[reactor]).update(parts, api=api)

    def bodies(self, reactor: str, reaction: int) -> tuple[Reactor, tuple[Body, Any, Any]]:
        """Return an instance, and the functions of a reaction of it."""
        instance = self.instances[reactor]
        cls, name = type(instance), instance.reactions[reaction]["name"]
        late, tardy = (getattr(cls, f"{name}_{kind}", None) for kind in ("late", "tardy"))
        return instance, (getattr(cls, name), late, tardy)

    def _add(self, it: Reactor, full: str) -> int:
        self.instances[full] = it
        children = []
        for name, child in it.children().items():
            bank = isinstance(child, list)
            members = [
                self._add(member, f"{full}.{name}[{at}]" if bank else f"{full}.{name}")
                for at, member in enumerate(child if isinstance(child, list) else [child])
            ]
            fields = {"name": name, "at": self._at(it), "members": members, "bank": bank}
            children.append(fields | self._option(it, name))
        self.reactors.append(
            {
                "name": type(it).__name__,
                "at": self._at(it),
                "federated": it.federated,
                "ports": list(self._ports(it)),
                "timers": [
                    {"name": name, "at": self._at(it), "offset": offset, "period": period}
                    | self._option(it, name)
                    for name, offset, period in it.timers
                ],
                "actions": [
                    {"at": self._at(it), "physical": False} | action for action in it.actions
                ],
                "modes": [
                    {"name": name, "at": self._at(it), "initial": at == 0}
                    for at, name in enumerate(it.modes)
                ],
                "children": children,
                "connections": list(self._connections(it)),
                "reactions": [self._reaction(it, **reaction) for reaction in it.reactions],
                "facts": list(it.facts),
            }
        )
        return len(self.reactors) - 1

    def _at(self, it: Reactor, method: str | None = None) -> list[int]:
        function = getattr(type(it), method) if method else None
        code = getattr(function, "__code__", None)
        return [0, code.co_firstlineno if code else 1, 0, -1]

    @staticmethod
    def _option(it: Reactor, name: str) -> dict[str, Any]:
        return it.options.get(name, {})

    def _ports(self, it: Reactor) -> Iterator[dict[str, Any]]:
        for port in it.ports:
            kind, name = port.split()
            kind, _, width = kind.rstrip("]").partition("[")
            fields = {"name": name, "at": self._at(it), "kind": kind}
            yield fields | {"width": int(width) if width else None}

    def _connections(self, it: Reactor) -> Iterator[dict[str, Any]]:
        for source, target, *rest in it.connections:
            ends = {"from": [self._named(it, source)], "to": [self._named(it, target)]}
            yield {"at": self._at(it), **ends} | (rest[0] if rest else {})

    def _reaction(self, it: Reactor, name: str, **fields: Any) -> dict[str, Any]:
        at = self._at(it, name)
        events = ("startup", "shutdown", "reset")

        def named(text: str) -> Any:
            return text if text in events else self._named(it, text, at)

        def effect(text: str) -> dict[str, Any]:
            mode, _, how = text.partition(".")
            if mode in it.modes:
                return {"at": at, "mode": it.modes.index(mode), "history": how == "history"}
            return self._named(it, text, at)

        return {
            **fields,
            "name": name,
            "at": at,
            "triggers": [named(text) for text in fields.get("triggers", ())],
            "sources": [named(text) for text in fields.get("sources", ())],
            "effects": [effect(text) for text in fields.get("effects", ())],
            "tardy": hasattr(type(it), f"{name}_tardy"),
        }

    def _named(self, it: Reactor, text: str, at: list[int] | None = None) -> dict[str, Any]:
        child, _, name = text.rpartition(".")
        return {"at": at or self._at(it), "child": child or None, "name": name}
