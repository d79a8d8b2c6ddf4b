"""The structure of a program of Python objects, as the plain data that the runtime reads.

Nothing is checked here that the rules of the language check. Times become nanoseconds, places
become numbers of a file with lines and columns.
"""

from __future__ import annotations

import linecache
from collections.abc import Callable, Mapping
from typing import Any

from hprm import _construction, _duration, _places
from hprm._connect import Connection, check_types
from hprm._construction import Construction
from hprm._facts import of_parameters
from hprm._handles import Handle, parts
from hprm._mistakes import ProgramError
from hprm._parts import Action, History, Input, Mode, Part, Timer
from hprm._places import Place
from hprm._reactions import Event, Reaction
from hprm._reactor import Federation, Reactor

Data = dict[str, Any]

#: Target properties that are times.
TIMES = frozenset(("timeout", "start-time-multiple", "spin", "period", "test-offset"))


def of(main: Reactor, federated: bool) -> Data:
    """Return the structure of a program: its files, its properties, and its reactors.

    A federation that is not to run as one, but to be tested, is an ordinary reactor.
    """
    return _Structure(main, federated).data


class _Structure:
    def __init__(self, main: Reactor, federated: bool) -> None:
        self._federated = federated
        self._files: dict[str, int] = {}
        self._reactors: list[Data] = []
        place = _place_of_class(type(main))
        self._at(place)
        stated = type(main)._hprm_properties_
        properties = [
            {"name": name, "at": self._at(place), "value": _value(name, value, place)}
            for name, (value, place) in stated.items()
        ]
        number = self._reactor(main)
        files = [
            {"path": _places.shown(path), "text": "".join(linecache.getlines(path))}
            for path in self._files
        ]
        self.data: Data = {
            "files": files,
            "properties": properties,
            "main": number,
            "reactors": self._reactors,
        }

    def _at(self, place: Place) -> list[int]:
        file = self._files.setdefault(place.path, len(self._files))
        return [file, place.line, place.column, place.end]

    def _reactor(self, reactor: Reactor) -> int:
        construction = _construction.of(reactor)
        children = [
            self._child(reactor, name, child) for name, child in construction.children.items()
        ]
        cls = type(reactor)
        declared = cls._hprm_parts_.values()
        modes = [part for part in declared if isinstance(part, Mode)]

        def number(mode: Mode | None) -> int | None:
            return None if mode is None else [it.name for it in modes].index(mode.name)

        data = {
            "name": cls.__name__,
            "at": self._at(_place_of_class(cls)),
            "federated": self._federated and isinstance(reactor, Federation),
            "executable": cls._hprm_executable_,
            "parameters": self._parameters(cls, construction),
            "ports": [self._port(reactor, it) for it in declared if it.kind in ("input", "output")],
            "timers": [
                self._timer(reactor, it, number) for it in declared if isinstance(it, Timer)
            ],
            "actions": [
                self._action(reactor, it, number) for it in declared if isinstance(it, Action)
            ],
            "modes": [
                {"name": it.name, "at": self._at(it.place), "initial": it.initial} for it in modes
            ],
            "children": [dict(child, mode=number(child["mode"])) for child in children],
            "connections": [
                self._connection(reactor, it, number) for it in construction.connections
            ],
            "reactions": [self._reaction(reactor, it, number) for it in cls._hprm_reactions_],
            "facts": of_parameters(construction.arguments),
        }
        self._reactors.append(data)
        return len(self._reactors) - 1

    def _parameters(self, cls: type[Reactor], construction: Construction) -> list[list[Any]]:
        """Return what an executable is given; other reactors have used their parameters."""
        if not cls._hprm_executable_ or not construction.arguments:
            return []
        # Only a program with executables that have parameters needs the module.
        from hprm import _given

        return _given.of(construction.arguments, construction.place)

    def _child(self, container: Reactor, name: str, child: Reactor | list[Reactor]) -> Data:
        members = child if isinstance(child, list) else [child]
        first = _construction.of(members[0])
        stated = {"host": None, "maxwait": None, "transient": False, "restart": None}
        if self._federated:
            stated |= first.federate
        return {
            "name": name,
            "at": self._at(first.place),
            "members": [self._reactor(member) for member in members],
            "bank": isinstance(child, list),
            "mode": first.mode_of_container,
            **stated,
        }

    def _port(self, reactor: Reactor, part: Part) -> Data:
        kind = "mutable" if isinstance(part, Input) and part.mutable else part.kind
        width = width_of(reactor, part)
        return {"name": part.name, "at": self._at(part.place), "kind": kind, "width": width}

    def _timer(self, reactor: Reactor, part: Timer, number: Callable[..., Any]) -> Data:
        return {
            "name": part.name,
            "at": self._at(part.place),
            "offset": time_of(reactor, part, "offset"),
            "period": time_of(reactor, part, "period"),
            "mode": number(part.mode),
        }

    def _action(self, reactor: Reactor, part: Action[Any], number: Callable[..., Any]) -> Data:
        return {
            "name": part.name,
            "at": self._at(part.place),
            "physical": part.physical,
            "min_delay": time_of(reactor, part, "min_delay"),
            "spacing": time_of(reactor, part, "spacing"),
            "policy": part.policy,
            "mode": number(part.mode),
        }

    def _connection(
        self, reactor: Reactor, connection: Connection, number: Callable[..., Any]
    ) -> Data:
        def row(handles: list[Handle]) -> list[Data]:
            return [self._handle(reactor, handle, connection.place) for handle in handles]

        check_types(connection, _channels)
        return {
            "at": self._at(connection.place),
            "from": row(connection.sources),
            "to": row(connection.destinations),
            "repeated": connection.repeated,
            "after": connection.after,
            "physical": connection.physical,
            "serializer": connection.serializer,
            "absent_after": connection.absent_after,
            "compress": connection.compress,
            "bound": None if connection.bound is None else list(connection.bound),
            "mode": number(connection.mode),
        }

    def _reaction(self, reactor: Reactor, reaction: Reaction, number: Callable[..., Any]) -> Data:
        def all_of(named: tuple[Any, ...]) -> list[Any]:
            return [data for it in named for data in self._named(reactor, reaction, it, number)]

        deadline = reaction.deadline
        if callable(deadline):
            deadline = _late(reactor, reaction.place, "the deadline", deadline)
        return {
            "name": reaction.name,
            "at": self._at(reaction.place),
            "triggers": all_of(reaction.triggers),
            "sources": all_of(reaction.sources),
            "effects": all_of(reaction.effects),
            "deadline": _duration.stated("deadline", deadline, reaction.place),
            "tardy": reaction.tardy is not None,
            "mode": number(reaction.mode),
        }

    def _named(
        self, reactor: Reactor, reaction: Reaction, named: Any, number: Callable[..., Any]
    ) -> list[Any]:
        """Return what a reaction names as a trigger, a source or an effect."""
        at = self._at(reaction.place)
        if isinstance(named, Event):
            return [named.name]
        if isinstance(named, Mode | History):
            mode = named.mode if isinstance(named, History) else named
            return [{"at": at, "mode": number(mode), "history": isinstance(named, History)}]
        if isinstance(named, Part):
            return [_reference(at, None, None, (named.name, None))]
        chosen = _late(reactor, reaction.place, f"a port of reaction {reaction.name}", named)
        handles = [chosen] if isinstance(chosen, Handle) else list(chosen)
        if not all(isinstance(handle, Handle) for handle in handles):
            raise ProgramError(
                f"a function that reaction {reaction.name} names gives no port",
                reaction.place,
                "it gives a port of a contained reactor: lambda self: self.camera.image",
            )
        found = [self._handle(reactor, handle, reaction.place) for handle in handles]
        whole = _whole_banks(reactor, found)
        for it in whole:
            _refuse_a_share(it, reaction.place)
        return whole

    def _handle(self, reactor: Reactor, handle: Handle, place: Place) -> Data:
        """Return the reference for a port of ``reactor``, or of what it contains."""
        owner, part, channel = parts(handle)
        at = self._at(place)
        if owner is reactor:
            return _reference(at, None, None, (part.name, channel))
        inner = _construction.of(owner)
        if inner.container is not reactor:
            raise ProgramError(
                f"{handle!r} is not of {type(reactor).__name__}, and not of what it contains",
                place,
                f"assign the {type(owner).__name__} to an attribute of self, and name its ports"
                " only in the reactor that contains it",
            )
        return _reference(at, inner.name, inner.member, (part.name, channel))


def _reference(
    at: list[int], child: str | None, member: int | None, port: tuple[str, int | None]
) -> Data:
    name, channel = port
    return {"at": at, "child": child, "member": member, "name": name, "channel": channel}


def _whole_banks(reactor: Reactor, references: list[Data]) -> list[Data]:
    """Name a port of all members of a bank once."""
    found: list[Data] = []
    members: dict[tuple[str, str], list[int]] = {}
    for it in references:
        if it["member"] is None or it["channel"] is not None:
            found.append(it)
            continue
        key = it["child"], it["name"]
        if key not in members:
            found.append(it)
        members.setdefault(key, []).append(it["member"])
    for it in found:
        bank = _construction.of(reactor).children.get(it["child"] or "")
        named = members.get((it["child"], it["name"]))
        if isinstance(bank, list) and named == list(range(len(bank))):
            it["member"] = None
    return found


def _refuse_a_share(named: Data, place: Place) -> None:
    """Refuse one member or one channel: the rule is the language's, what to write is Python's."""
    name, child = named["name"], named["child"]
    if named["channel"] is not None:
        hint = f"name the multiport: lambda self: self.{child + '.' if child else ''}{name}"
    elif named["member"] is not None:
        hint = f"name the port of all members: lambda self: [it.{name} for it in self.{child}]"
    else:
        return
    message = "a reaction cannot name one member of a bank, or one channel"
    raise ProgramError(message, place, hint, "LF0312")


def _channels(handle: Handle) -> int:
    """Return how many channels a connection joins at a port."""
    owner, part, channel = parts(handle)
    width = None if channel is not None else width_of(owner, part)
    return 1 if width is None else width


def width_of(reactor: Reactor, part: Part) -> int | None:
    """Return the number of channels of a port; none if it is not a multiport."""
    found: int | None = _late(reactor, part.place, f"the width of {part.name}", part.width_of)
    return found


def _place_of_class(cls: type) -> Place:
    """Return the line of the class statement, as far as it is known."""
    place: Place = cls._hprm_place_  # type: ignore[attr-defined]
    return place


def _late(reactor: Reactor, place: Place, what: str, function: Callable[[Any], Any]) -> Any:
    """Call a function of the reactor that the program states instead of a value."""
    try:
        return function(reactor)
    except ProgramError:
        raise
    except Exception as error:
        # Only a program with a mistake needs the module.
        from hprm import _hints

        message = f"{what} raised {type(error).__name__}: {error}"
        raise ProgramError(message, place, _hints.of(error)) from error


def time_of(reactor: Reactor, part: Part, name: str) -> int | None:
    """Return a time of a timer or an action in nanoseconds; none if the class states none."""
    stated: Any = getattr(part, name)
    if callable(stated):
        stated = _late(reactor, part.place, f"the {name} of {part.name}", stated)
        stated = _duration.stated(name, stated, part.place)
    nanoseconds: int | None = stated
    return nanoseconds


def _value(name: str, stated: Any, place: Place) -> Any:
    """Return the value of a target property."""
    if name in TIMES and stated not in ("auto", "off"):
        return {"time": _duration.stated(name, stated, place)}
    match stated:
        case bool() | int():
            return stated
        case str():
            return {"text": stated}
        case list() | tuple():
            return {"list": [_value("", one, place) for one in stated]}
        case Mapping():
            entries = [
                {"name": key, "at": [0, 1, 0, -1], "value": _value(key, one, place)}
                for key, one in stated.items()
            ]
            return {"dictionary": entries}
    raise ProgramError(f"the property `{name}` is a {type(stated).__name__}", place)
