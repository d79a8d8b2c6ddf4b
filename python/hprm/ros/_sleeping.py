"""``time.sleep`` in programs that run as they are: a callback that sleeps lets logical time pass.

Its thread holds the tag of what has woken it, so the federate would stand still for as long as it
sleeps: what it has published would leave afterwards, and nothing could cancel what it does. A
thread that holds no tag sleeps as ever.
"""

from __future__ import annotations

import time

from hprm.ros import _process

_sleep = time.sleep


def install() -> None:
    """Have ``time.sleep`` sleep in logical time where a thread holds a tag."""
    time.sleep = sleep  # type: ignore[assignment]


def sleep(seconds: float, /) -> None:
    """Sleep for so long."""
    runtime = _process.running()
    holds = runtime is not None and runtime.turns.holds()
    if runtime is None or not holds or not isinstance(seconds, int | float) or not seconds > 0:
        _sleep(seconds)
        return
    begun = time.monotonic()
    runtime.block(lambda: False, round(seconds * 1e9), sleeps=True)
    # What is waited for outside may need all of it, and logical time may lag behind the clock.
    left = seconds - (time.monotonic() - begun)
    if left > 0 and not runtime.is_fast:
        _sleep(left)
