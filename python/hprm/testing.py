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

from hprm import _construction, _hprm, _nested
from hprm._declared import Declared, unbind
from hprm._duration import Time
from hprm._feeding import Events
from hprm._launching import check
from hprm._mistakes import ProgramError, failed, one
from hprm._parts import Output
from hprm._reactions import reaction
from hprm._reactor import Reactor


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
    reactor: Reactor | type[Reactor],
    *,
    inputs: Mapping[str, Iterable[tuple[Time, Any]]] | None = None,
    timeout: Time = "10 s",
) -> Result:
    """Run a reactor in virtual time, and return what it has set.

    Parameters
    ----------
    reactor : Reactor or type
        The reactor, or a whole program, also a federation; or its class if the constructor needs no
        arguments. The same object can run again, and begins with the state that it has then.
    inputs : dict of str to list of (Time, object), optional
        By input: the values that it gets, each with its time after the start; of a multiport, lists
        with None for absent channels. Two values at one time are an error. A name may also be that
        of a physical action, ``"frame"``, or ``"camera.frame"`` of a reactor inside: its events are
        scheduled at these times, and come after its ``min_delay``, as its ``spacing`` allows.
    timeout : Time, default 10 s
        When the run ends, if nothing has ended it before. Nothing is waited for. An event after it
        is an error.

    Returns
    -------
    Result
        What was set, and the logical trace.

    Raises
    ------
    ProgramError
        If something is wrong with the program, or a reaction or a constructor of a reactor calls
        this.
    ProgramFailed
        If a reaction fails; what has happened is told on the standard error. After Ctrl-C it is a
        ``KeyboardInterrupt``, too.
    TypeError
        If a value is of another type than its input or action declares, or ``inputs`` is none.
    ValueError
        If the reactor has no input or physical action of that name, or one gets two values at one
        time, or a value after the timeout.

    Notes
    -----
    Physical connections follow virtual time, and so do physical actions: if a reaction schedules
    one, its delay counts from the current tag. What anything but a reaction schedules, such as a
    thread, is dropped with a ``RuntimeWarning``: when it would come depends on the machine.

    """
    # What is wrong is at the call, so pytest need not show what is below it.
    __tracebackhide__ = True
    _nested.refuse("hprm.testing.run")
    tested = reactor() if isinstance(reactor, type) else reactor
    if not isinstance(tested, Reactor):
        kind = one(type(tested).__name__)
        raise TypeError(f"hprm.testing.run takes a hprm.Reactor, not {kind}")
    try:
        events = Events(tested, {} if inputs is None else inputs, timeout)
    except (TypeError, ValueError) as error:
        raise error.with_traceback(None) from error.__cause__
    try:
        return _run(tested, events)
    except ProgramError as error:
        raise error.with_traceback(None) from error.__cause__


def _run(reactor: Reactor, events: Events) -> Result:
    """Run a reactor with these events; afterwards, it is in no program, and can run again."""
    construction = _construction.of(reactor)
    if construction.container is not None:
        container = type(construction.container).__name__
        raise ProgramError(
            f"this {type(reactor).__name__} is contained in {container}, so it cannot be tested"
            " alone",
            construction.place,
            "make another one for the test, or test the reactor that contains this one",
        )
    # The connections of the test are between handles.
    unbind(reactor)
    outputs: dict[str, list[tuple[int, Any]]] = {
        name: [] for name, part in type(reactor)._hprm_parts_.items() if isinstance(part, Output)
    }
    properties = ["fast=true", f"timeout={events.end} ns"]
    try:
        declared = Declared(_bench(reactor, events, outputs), federated=False, is_test=True)
        check(declared, properties)
        with tempfile.TemporaryDirectory(prefix="hprm-") as folder:
            path = os.path.join(folder, "trace")
            failures: list[str] = []
            code = _hprm.run_declared(declared, properties, logical_trace=path, failures=failures)
            if code:
                raise failed(code, failures)
            with open(path, encoding="utf-8") as file:
                trace = file.read().splitlines()
    finally:
        construction.leave_container()
    return Result(outputs, trace)


def _bench(reactor: Reactor, events: Events, outputs: dict[str, list[tuple[int, Any]]]) -> Reactor:
    """Make a program that feeds a reactor and notes what it sets."""
    parts = type(reactor)._hprm_parts_
    feeder = events.feeder()

    def note(name: str) -> Any:
        @reaction(lambda _: getattr(reactor, name))
        def noted(self: Any) -> None:
            port = getattr(reactor, name)
            is_multiport = parts[name].width_of(reactor) is not None
            value = [it.get() for it in port] if is_multiport else port.value
            outputs[name].append((self.elapsed(), value))

        return noted

    def make(self: Any) -> None:
        setattr(self, _name_of(reactor), reactor)
        if feeder is not None:
            self.feeder = feeder
            events.join(feeder)

    notes = {f"note_{name}": note(name) for name in outputs}
    bench: type[Reactor] = type("Bench", (Reactor,), {"__init__": make, **notes})
    return bench()


def _name_of(reactor: Reactor) -> str:
    """Return what messages and the trace call the reactor: the name of its class, if it can be."""
    name = type(reactor).__name__
    is_free = name != "feeder" and not name.startswith("_") and not hasattr(Reactor, name)
    return name if is_free else "reactor"
