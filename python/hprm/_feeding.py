"""What a test gives a reactor: values of inputs, and events of physical actions, at chosen times.

They are checked where the test states them, and a reactor beside the tested one sets and schedules
them. What the tested one does is none of this.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Set
from typing import Any, NamedTuple

from hprm import _construction, _structure
from hprm._connect import connect
from hprm._duration import Time
from hprm._hprm import nanoseconds
from hprm._mistakes import one
from hprm._parts import Action, Input, Output, Part, PhysicalAction
from hprm._reactions import reaction, startup
from hprm._reactor import Reactor
from hprm._types import accepted

#: What a test states: by input or action, values with their times.
Stated = Mapping[str, Iterable[tuple[Time, Any]]]

# What has several entries, and is no list of times with values.
_NO_LISTS = (str, bytes, Mapping)

# A member of a bank: `cameras[1]`.
_MEMBER = re.compile(r"(\w+)\[(\d+)\]")


class Fed(NamedTuple):
    """An input, or a physical action, that a test may name."""

    owner: Reactor
    part: Part

    @property
    def is_action(self) -> bool:
        """Whether it is an action."""
        return isinstance(self.part, Action)

    @property
    def min_delay(self) -> int:
        """How long after the time in the test an event comes at least, in nanoseconds."""
        if not self.is_action:
            return 0
        return _structure.time_of(self.owner, self.part, "min_delay") or 0

    def tag_of(self, elapsed: int) -> tuple[int, int]:
        """Return the earliest tag of an event at this time after the start."""
        delay = self.min_delay
        return (elapsed + delay, 1 if self.is_action and delay == 0 else 0)

    def __str__(self) -> str:
        """Return what it is."""
        return "action" if self.is_action else "input"


class Events:
    """The events that a test states for a reactor, by their times."""

    def __init__(self, reactor: Reactor, stated: Stated, timeout: Time) -> None:
        """Take what a test states that ends at ``timeout``.

        Raises ``ValueError`` and ``TypeError``, which name the input and the time.
        """
        self.reactor = reactor
        self.fed: dict[str, Fed] = {}
        self.at: dict[int, dict[str, Any]] = {}
        self.timeout = timeout
        self.end = nanoseconds(timeout)
        for name, values in _by_name(stated):
            fed = self.fed[name] = _find(reactor, name)
            for time, value in _pairs(fed, name, values):
                self._add(fed, name, time, value)

    def _add(self, fed: Fed, name: str, time: Time, value: Any) -> None:
        elapsed = nanoseconds(time)
        if fed.tag_of(elapsed) > (self.end, 0):
            delay = " with its `min_delay`" if fed.min_delay else ""
            raise ValueError(
                f"the event of the {fed} {name} at {_unit(time)} comes{delay} after the timeout of"
                f" the test, {_unit(self.timeout)}: state a later timeout=..."
            )
        at = self.at.setdefault(elapsed, {})
        if name in at:
            raise ValueError(f"the {fed} {name} has two values at {time}")
        _check(fed, name, time, value)
        at[name] = value

    def feeder(self) -> Reactor | None:
        """Make the reactor that has these events happen, to be connected by :meth:`join`.

        All inputs are connected, so that none is taken for one that was forgotten. None is made for
        a reactor that has no inputs and gets no events.
        """
        declared = type(self.reactor)._hprm_parts_
        inputs = {name: part for name, part in declared.items() if isinstance(part, Input)}
        if not inputs and not self.at:
            return None
        ports: dict[str, Part] = {
            name: Output(width=part.width_of(self.reactor)) for name, part in inputs.items()
        }
        due: Action[Any] = Action()

        def unused(name: str) -> str:
            while name in ports:
                name += "_"
            return name

        due_is = unused("due")

        @reaction(startup, effects=[due, *ports.values()])  # type: ignore[list-item]
        def begin(feeder: Any) -> None:
            self._send(feeder, self.at.get(0, {}))
            for time in sorted(self.at):
                if time:
                    getattr(feeder, due_is).schedule(time, self.at[time])

        @reaction(due, effects=list(ports.values()))  # type: ignore[arg-type]
        def feed(feeder: Any) -> None:
            self._send(feeder, getattr(feeder, due_is).value)

        names = {due_is: due, unused("begin"): begin, unused("feed"): feed}
        made: type[Reactor] = type("Feeder", (Reactor,), {**ports, **names})
        return made()

    def join(self, feeder: Reactor) -> None:
        """Connect the feeder, in the constructor of what contains both."""
        for name, part in type(feeder)._hprm_parts_.items():
            if isinstance(part, Output):
                connect(getattr(feeder, name), getattr(self.reactor, name))

    def _send(self, feeder: Any, values: dict[str, Any]) -> None:
        for name, value in values.items():
            owner, part = fed = self.fed[name]
            if fed.is_action:
                getattr(owner, part.name).schedule(0, value)
            elif part.width_of(owner) is None:
                getattr(feeder, name).set(value)
            else:
                for channel, each in zip(getattr(feeder, name), value, strict=True):
                    if each is not None:
                        channel.set(each)


def _by_name(stated: Any) -> Iterable[tuple[str, Any]]:
    """Return what a test states for each name, unless it is stated in another way."""
    form = f"write inputs={{{_form('NAME')}}}"
    if not isinstance(stated, Mapping):
        kind = one(type(stated).__name__)
        raise TypeError(f"`inputs` is a dictionary, and this is {kind}: {form}")
    for name in stated:
        if not isinstance(name, str):
            raise TypeError(f"`inputs` has names, and {_shown(name)} is none: {form}")
    return stated.items()


def _pairs(fed: Fed, name: str, values: Any) -> Iterator[tuple[Time, Any]]:
    """Return the times and the values that a test states for one name."""
    form = f"write inputs={{{_form(name)}}}"
    if not isinstance(values, Iterable) or isinstance(values, _NO_LISTS):
        raise TypeError(
            f"the {fed} {name} takes a list of times with values, and {_shown(values)} is none:"
            f" {form}"
        )
    for it in values:
        pair: Any = () if isinstance(it, (*_NO_LISTS, Set)) else it
        try:
            time, value = pair
        except (TypeError, ValueError):
            raise TypeError(
                f"the {fed} {name} takes a list of times with values, and its entry {_shown(it)}"
                f" is no time with a value: {form}"
            ) from None
        yield time, value


def _form(name: str) -> str:
    """Return how values are stated for a name."""
    return f'"{name}": [("0 ms", VALUE), ("10 ms", VALUE)]'


def _unit(time: Time) -> str:
    return f"{time} ns" if isinstance(time, int) else str(time)


def _find(reactor: Reactor, name: str) -> Fed:
    """Return what a test names, also a physical action of a contained reactor."""
    *path, last = name.split(".")
    owner: Reactor | None = reactor
    for step in path:
        owner = None if owner is None else _child(owner, step)
    part = None if owner is None else type(owner)._hprm_parts_.get(last)
    if owner is not None and part is not None and _may_be_fed(reactor, owner, part):
        return Fed(owner, part)
    called = type(reactor).__name__
    if isinstance(part, Action):
        raise ValueError(
            f"{name} of {called} is a logical action, which only its own reactions schedule"
        )
    known = ", ".join(_names(reactor, reactor, "")) or "none"
    raise ValueError(f"{called} has no input or physical action {name}; it has: {known}")


def _may_be_fed(tested: Reactor, owner: Reactor, part: Part) -> bool:
    return isinstance(part, PhysicalAction) or (owner is tested and isinstance(part, Input))


def _child(container: Reactor, step: str) -> Reactor | None:
    children = _construction.of(container).children
    match _MEMBER.fullmatch(step):
        case None:
            found = children.get(step)
            return None if isinstance(found, list) else found
        case member:
            bank, index = children.get(member[1]), int(member[2])
            return bank[index] if isinstance(bank, list) and index < len(bank) else None


def _names(tested: Reactor, owner: Reactor, prefix: str) -> Iterator[str]:
    """Return the names that a test may use."""
    for name, part in type(owner)._hprm_parts_.items():
        if _may_be_fed(tested, owner, part):
            yield prefix + name
    for called, child in _construction.of(owner).children.items():
        if isinstance(child, list):
            for index, member in enumerate(child):
                yield from _names(tested, member, f"{prefix}{called}[{index}].")
        else:
            yield from _names(tested, child, f"{prefix}{called}.")


def _check(fed: Fed, name: str, time: Time, value: Any) -> None:
    """Refuse a value that the input or the action does not accept."""
    width = _structure.width_of(fed.owner, fed.part)
    if width is None:
        # An event of an action need not have a value.
        if not (fed.is_action and value is None):
            _check_type(fed, name, time, value)
        return
    if not isinstance(value, list | tuple) or len(value) != width:
        raise ValueError(
            f"the input {name} is a multiport of width {width}, and its value at {time} is"
            f" {_shown(value)}: write a list of {width} values, with None for an absent channel"
        )
    for index, each in enumerate(value):
        if each is not None:
            _check_type(fed, f"{name}[{index}]", time, each)


def _check_type(fed: Fed, name: str, time: Time, value: Any) -> None:
    types = accepted(fed.part.type)
    if types is None or isinstance(value, types):
        return
    takes = " or ".join(it.__name__ for it in types)
    raise TypeError(
        f"the {fed} {name} accepts {takes}, and its value at {time} is {_shown(value)}, of type"
        f" {type(value).__name__}"
    )


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
