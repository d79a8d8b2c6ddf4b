"""Deterministic, zero-copy middleware for robots and autonomous agents.

Programs are written in ``.lf`` files and run by ``hprm run``; what their bodies use is here as
well, for the modules that they import.
"""

# ruff: noqa: E402, I001
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
    instant_t,
    interval_t,
)

__all__ = [
    "BILLION",
    "DAY",
    "DAYS",
    "FOREVER",
    "HOUR",
    "HOURS",
    "MINUTE",
    "MINUTES",
    "MSEC",
    "MSECS",
    "NEVER",
    "NSEC",
    "NSECS",
    "SEC",
    "SECS",
    "USEC",
    "USECS",
    "WEEK",
    "WEEKS",
    "Make",
    "ReactorBase",
    "Tag",
    "action_capsule_t",
    "empty",
    "empty_like",
    "instant_t",
    "interval_t",
    "port_capsule",
]
