"""What one process can measure without another: placing an array, and serialization.

Run as `alone.py place` or `alone.py encode` with the session in the environment; its transport
names the method. Placing is timed from an array of the program's own to the moment from which a
reader could have it. Serialization leaves the bytes of arrays where they are, if the method can.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

import numpy as np
from script import Cell, cells_of
from session import Session

_BATCH_NS = 200_000
"""Serialization is timed in batches of about that length: a clock has its price too."""

_PAUSES = 3
"""Most of the time of placing is pauses."""


def main(role: str) -> None:
    """Measures all cells."""
    session = Session.here()
    methods: Any = importlib.import_module(
        "methods." + ("placing" if role == "place" else "codecs")
    )
    method = getattr(methods, session.transport)(session)
    measure = _place if role == "place" else _encode
    with open(session.out, "w") as out:
        for cell in cells_of(session.plan):
            measure(cell, method, out)


def _place(cell: Cell, method: Any, out: TextIO) -> None:
    array = np.random.default_rng(cell.size).random((cell.size // 16, 2))
    method.prepare(array)
    times: list[int] = []
    began = time.monotonic()
    for index in range(cell.warm_up + cell.rounds):
        started = time.perf_counter_ns()
        method.place(array)
        took = time.perf_counter_ns() - started
        method.release()
        if index >= cell.warm_up:
            times.append(took)
            if time.monotonic() - began > _PAUSES * cell.budget_s:
                break
        # As in HPRM's program, where the reader needs time: caches are no warmer than after that.
        time.sleep(0.002 + 4e-9 * took)
    _say(out, cell, cell.size, times)


def _encode(cell: Cell, method: Any, out: TextIO) -> None:
    generator = np.random.default_rng(cell.size)
    nested = {
        "frame": 7,
        "cameras": {f"camera {i}": generator.random(cell.size // 80) for i in range(10)},
    }
    values = {"array": generator.random(cell.size // 8), "dict of ten": nested}
    for name, value in values.items():
        if not method.takes(value):
            continue
        encoded = method.arrived(value)
        _check(value, method.deserialize(encoded))
        _say(out, cell, f"{name}, out", _timed(cell, lambda value=value: method.serialize(value)))
        _say(out, cell, f"{name}, in", _timed(cell, lambda at=encoded: method.deserialize(at)))


def _timed(cell: Cell, call: Callable[[], Any]) -> list[int]:
    """The time of one call, each as the mean of a batch."""
    for _ in range(min(cell.warm_up, 10)):
        started = time.perf_counter_ns()
        call()
        took = time.perf_counter_ns() - started
    batch = max(1, _BATCH_NS // max(took, 1))
    times: list[int] = []
    began = time.monotonic()
    while len(times) < cell.rounds and (not times or time.monotonic() - began < cell.budget_s):
        started = time.perf_counter_ns()
        for _ in range(batch):
            call()
        times.append((time.perf_counter_ns() - started) // batch)
    return times


def _say(out: TextIO, cell: Cell, size: int | str, times: list[int]) -> None:
    out.write(json.dumps({"workload": cell.workload, "size": size, "times_ns": times}) + "\n")
    out.flush()


def _check(sent: Any, got: Any) -> None:
    if isinstance(sent, dict):
        for key, value in sent.items():
            _check(value, got[key])
    elif not np.array_equal(sent, got):
        raise ValueError("what was deserialized differs from what was serialized")


if __name__ == "__main__":
    main(sys.argv[1])
