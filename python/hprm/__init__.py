"""Deterministic, zero-copy middleware for robots and autonomous agents.

A program is reactors that exchange messages with logical tags. A reactor is a class:

>>> import hprm
>>> class Counter(hprm.Reactor, timeout="20 ms", fast=True):
...     tick = hprm.Timer("10 ms")
...
...     @hprm.reaction(tick)
...     def show(self):
...         print(self.elapsed() // 1_000_000, "ms")
>>> hprm.run(Counter())
0 ms
10 ms
20 ms

A reactor
    ``Reactor``, ``Federation`` (whose parts are processes), ``federate``, ``Restart``
What its class declares
    ``Input``, ``Output``, ``Timer``, ``Action``, ``PhysicalAction``, ``Mode``, ``reaction``,
    ``startup``, ``shutdown``, ``reset``
What its constructor calls
    ``connect``
Running and testing
    ``run``, ``check``, ``hprm.testing``; the command ``hprm``
Looking at what runs
    ``watch``
In bodies
    ``background`` (what outlives a tag), ``empty`` and ``empty_like`` (arrays that are sent without
    a copy), ``Tag``
Errors
    ``ProgramError``, ``ProgramFailed``, ``ProgramWarning``, ``WatchError``

Times are a text with a unit (``"10 ms"``), a ``datetime.timedelta``, or whole numbers of
nanoseconds (``Time``); ``MSEC(10)`` and the like make nanoseconds.

What bodies of ``.lf`` files know without an import is here as well, for modules that they import:
``MSEC``, ``FOREVER``, ``Make``, ``ReactorBase``, ``port_capsule`` and so on.
"""

# ruff: noqa: E402, I001
from __future__ import annotations

try:
    from hprm import _startup

    # Before anything that takes time to load.
    _startup.quiet()

    from hprm._classes import Make, ReactorBase
    from hprm._hprm import Tag, action_capsule_t, port_capsule
    from hprm._memory import empty, empty_like
    from hprm._time import (
        BILLION,
        DAY,
        DAYS,
        FOREVER,
        HOUR,
        HOURS,
        MINUTE,
        MINUTES,
        MSEC,
        MSECS,
        NEVER,
        NSEC,
        NSECS,
        SEC,
        SECS,
        USEC,
        USECS,
        WEEK,
        WEEKS,
        instant_t as instant_t,
        interval_t as interval_t,
    )
except (ImportError, AttributeError) as error:
    from hprm import _hidden

    _hidden.refuse(error)
    raise

# Each start would wait for `typing`, which takes as long as the rest of this.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from hprm._connect import connect
    from hprm._coroutines import background
    from hprm._duration import Time
    from hprm._launching import check, run
    from hprm._mistakes import ProgramError, ProgramFailed, ProgramWarning
    from hprm._parts import Action, Input, Mode, Output, PhysicalAction, Timer
    from hprm._reactions import reaction, reset, shutdown, startup
    from hprm._reactor import Federation, Reactor, federate
    from hprm._restart import Restart
    from hprm._watching import WatchError, watch

# Programs of `.lf` files do without these, and start sooner.
_LOADED_ON_DEMAND = {
    **dict.fromkeys(("connect",), "hprm._connect"),
    **dict.fromkeys(("background",), "hprm._coroutines"),
    **dict.fromkeys(("Time",), "hprm._duration"),
    **dict.fromkeys(("check", "run"), "hprm._launching"),
    **dict.fromkeys(("ProgramError", "ProgramFailed", "ProgramWarning"), "hprm._mistakes"),
    **dict.fromkeys(
        ("Action", "Input", "Mode", "Output", "PhysicalAction", "Timer"), "hprm._parts"
    ),
    **dict.fromkeys(("reaction", "reset", "shutdown", "startup"), "hprm._reactions"),
    **dict.fromkeys(("Federation", "Reactor", "federate"), "hprm._reactor"),
    **dict.fromkeys(("Restart",), "hprm._restart"),
    **dict.fromkeys(("WatchError", "watch"), "hprm._watching"),
}


def __getattr__(name: str) -> Any:
    """Load what programs of Python objects are made of, when it is used first."""
    module = _LOADED_ON_DEMAND.get(name)
    if module is None:
        raise AttributeError(f"module 'hprm' has no attribute {name!r}")
    import importlib

    try:
        value = globals()[name] = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        from hprm import _hidden

        _hidden.refuse(error)
        raise
    return value


def __dir__() -> list[str]:
    """List what is loaded, and what is loaded on demand."""
    return sorted({*globals(), *_LOADED_ON_DEMAND})


__all__ = [
    "Action",
    "BILLION",
    "DAY",
    "DAYS",
    "FOREVER",
    "Federation",
    "HOUR",
    "HOURS",
    "Input",
    "MINUTE",
    "MINUTES",
    "MSEC",
    "MSECS",
    "Make",
    "Mode",
    "NEVER",
    "NSEC",
    "NSECS",
    "Output",
    "PhysicalAction",
    "ProgramError",
    "ProgramFailed",
    "ProgramWarning",
    "Reactor",
    "ReactorBase",
    "Restart",
    "SEC",
    "SECS",
    "Tag",
    "Time",
    "Timer",
    "USEC",
    "USECS",
    "WEEK",
    "WEEKS",
    "WatchError",
    "action_capsule_t",
    "background",
    "check",
    "connect",
    "empty",
    "empty_like",
    "federate",
    "port_capsule",
    "reaction",
    "reset",
    "run",
    "shutdown",
    "startup",
    "watch",
]
