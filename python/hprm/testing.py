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
from hprm._declared import Declared
from hprm._duration import Time
from hprm._feeding import Events
from hprm._hprm import nanoseconds
from hprm._launching import check
from hprm._mistakes import ProgramError, failed
from hprm._parts import Output
from hprm._reactions import reaction
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
        with None for absent channels. Two values at one time are an error. A name may also be that
        of a physical action, ``"frame"``, or ``"camera.frame"`` of a reactor inside: its events are
        scheduled at these times, and come after its ``min_delay``, as its ``spacing`` allows.
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
        If a reaction fails; what has happened is told on the standard error. After Ctrl-C it is a
        ``KeyboardInterrupt``, too.
    TypeError
        If a value is of another type than its input or action declares.
    ValueError
        If the reactor has no input or physical action of that name, or one gets two values at one
        time.

    Notes
    -----
    Physical connections follow virtual time, and so do physical actions: if a reaction schedules
    one, its delay counts from the current tag. What anything but a reaction schedules, such as a
    thread, is dropped with a ``RuntimeWarning``: when it would come depends on the machine.

    """
    # What is wrong is at the call, so pytest need not show what is below it.
    __tracebackhide__ = True
    try:
        events = Events(reactor, inputs or {})
    except (TypeError, ValueError) as error:
        raise error.with_traceback(None) from error.__cause__
    outputs: dict[str, list[tuple[int, Any]]] = {
        name: [] for name, part in type(reactor)._hprm_parts_.items() if isinstance(part, Output)
    }
    bench = _bench(reactor, events, outputs)
    properties = ["fast=true", f"timeout={nanoseconds(timeout)} ns"]
    try:
        declared = Declared(bench, federated=False, is_test=True)
        check(declared, properties)
    except ProgramError as error:
        raise error.with_traceback(None) from error.__cause__
    with tempfile.TemporaryDirectory(prefix="hprm-") as folder:
        path = os.path.join(folder, "trace")
        failures: list[str] = []
        code = _hprm.run_declared(declared, properties, logical_trace=path, failures=failures)
        if code:
            raise failed(code, failures)
        with open(path, encoding="utf-8") as file:
            trace = file.read().splitlines()
    return Result(outputs, trace)


def _bench(reactor: Reactor, events: Events, outputs: dict[str, list[tuple[int, Any]]]) -> Reactor:
    """Make a program that feeds a reactor and notes what it sets."""
    parts = type(reactor)._hprm_parts_
    feeder = events.feeder()

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
        if feeder is not None:
            self.feeder = feeder
            events.join(feeder)

    notes = {f"note_{name}": note(name) for name in outputs}
    bench: type[Reactor] = type("Bench", (Reactor,), {"__init__": make, **notes})
    return bench()
