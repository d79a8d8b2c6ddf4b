"""Unit tests of reactors: inputs at tags, outputs as lists, in virtual time.

A program runs to its end without waiting: logical time advances as fast as its reactions run.

>>> import hprm, hprm.testing
>>> class Double(hprm.Reactor):
...     number = hprm.Input(int)
...     doubled = hprm.Output(int)
...
...     @hprm.reaction(number, effects=[doubled])
...     def double(self):
...         self.doubled.set(2 * self.number.value)
>>> result = hprm.testing.run(Double(), inputs={"number": [("0 ms", 1), ("10 ms", 2)]})
>>> result.outputs["doubled"]
[(0, 2), (10000000, 4)]
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from hprm import _hprm
from hprm._connect import connect
from hprm._declared import Declared
from hprm._duration import Time
from hprm._hprm import nanoseconds
from hprm._launching import check
from hprm._mistakes import ProgramFailed
from hprm._parts import Action, Input, Output, Part
from hprm._reactions import reaction, startup
from hprm._reactor import Reactor

_DEFAULT = 10 * 10**9


@dataclass(frozen=True)
class Result:
    """What a reactor has done.

    Attributes
    ----------
    outputs : dict of str to list of (int, object)
        By output: the values that were set, each with its time in nanoseconds after the start. Of a
        multiport, a value is a list with None for absent channels.
    trace : list of str
        The logical trace: what happened at each tag, line by line.

    """

    outputs: dict[str, list[tuple[int, Any]]]
    trace: list[str] = field(repr=False)


def run(
    reactor: Reactor,
    *,
    inputs: Mapping[str, Iterable[tuple[Time, Any]]] | None = None,
    timeout: Time = _DEFAULT,
) -> Result:
    """Run a reactor in virtual time, and return what it has set.

    Parameters
    ----------
    reactor : Reactor
        The reactor, or a whole program, also a federation.
    inputs : dict of str to list of (Time, object), optional
        By input: the values that it gets, each with its time after the start; of a multiport, lists
        with None for absent channels. Two values at one time are an error.
    timeout : Time, default 10 s
        When the run ends, if nothing has ended it before. Nothing is waited for.

    Returns
    -------
    Result
        What was set, and the logical trace.

    Raises
    ------
    ProgramError
        If something is wrong with the program.
    ProgramFailed
        If a reaction fails; what has happened is told on the standard error.
    ValueError
        If the reactor has no input of that name, or it gets two values at one time.

    """
    events = _events(reactor, inputs or {})
    outputs: dict[str, list[tuple[int, Any]]] = {
        name: [] for name, part in type(reactor)._hprm_parts_.items() if isinstance(part, Output)
    }
    bench = _bench(reactor, events, outputs)
    properties = ["fast=true", f"timeout={nanoseconds(timeout)} ns"]
    declared = Declared(bench, federated=False)
    check(declared, properties)
    with tempfile.TemporaryDirectory(prefix="hprm-") as folder:
        path = os.path.join(folder, "trace")
        failures: list[str] = []
        code = _hprm.run_declared(declared, properties, logical_trace=path, failures=failures)
        if code:
            raise ProgramFailed(code, *failures[:1])
        with open(path, encoding="utf-8") as file:
            trace = file.read().splitlines()
    return Result(outputs, trace)


def _events(
    reactor: Reactor, inputs: Mapping[str, Iterable[tuple[Time, Any]]]
) -> dict[int, dict[str, Any]]:
    """Sort the values of all inputs by their times."""
    events: dict[int, dict[str, Any]] = {}
    for name, values in inputs.items():
        part = type(reactor)._hprm_parts_.get(name)
        if not isinstance(part, Input):
            known = [it.name for it in type(reactor)._hprm_parts_.values() if isinstance(it, Input)]
            raise ValueError(
                f"{type(reactor).__name__} has no input {name}; it has: {', '.join(known)}"
            )
        for time, value in values:
            at = events.setdefault(nanoseconds(time), {})
            if name in at:
                raise ValueError(f"the input {name} has two values at {time}")
            at[name] = value
    return events


def _bench(
    reactor: Reactor,
    events: dict[int, dict[str, Any]],
    outputs: dict[str, list[tuple[int, Any]]],
) -> Reactor:
    """Make a program that feeds a reactor and notes what it sets."""
    fed = sorted({name for values in events.values() for name in values})
    parts = type(reactor)._hprm_parts_

    def width(name: str) -> Any:
        return None if (known := parts[name].width_of(reactor)) is None else known

    ports: dict[str, Part] = {name: Output(width=width(name)) for name in fed}
    due: Action[Any] = Action()

    def send(self: Any, values: dict[str, Any]) -> None:
        for name, value in values.items():
            port = getattr(self, name)
            if width(name) is None:
                port.set(value)
            else:
                for channel, one in zip(port, value, strict=True):
                    if one is not None:
                        channel.set(one)

    @reaction(startup, effects=[due, *ports.values()])  # type: ignore[list-item]
    def begin(self: Any) -> None:
        send(self, events.get(0, {}))
        for time in sorted(events):
            if time:
                self.due_.schedule(time, events[time])

    @reaction(due, effects=list(ports.values()))  # type: ignore[arg-type]
    def feed(self: Any) -> None:
        send(self, self.due_.value)

    feeder = type("Feeder", (Reactor,), {**ports, "due_": due, "begin": begin, "feed": feed})

    def note(name: str) -> Any:
        @reaction(lambda self: getattr(self.reactor, name))
        def noted(self: Any) -> None:
            port = getattr(self.reactor, name)
            is_multiport = parts[name].width_of(reactor) is not None
            value = [it.get() for it in port] if is_multiport else port.value
            outputs[name].append((self.elapsed(), value))

        return noted

    def make(self: Any) -> None:
        self.reactor = reactor
        if fed:
            self.feeder = feeder()
        for name in fed:
            connect(getattr(self.feeder, name), getattr(reactor, name))

    notes = {f"note_{name}": note(name) for name in outputs}
    bench: type[Reactor] = type("Bench", (Reactor,), {"__init__": make, **notes})
    return bench()
