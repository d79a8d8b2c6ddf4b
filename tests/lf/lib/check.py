"""What the programs of the corpus use to check themselves.

A process that has begun a `Trace` ends with exit code 1 unless the trace was found right, so a
program that never comes to its check has failed as well.
"""

from __future__ import annotations

import atexit
import os
import sys
from typing import Any

_open: list[Trace] = []


class Trace:
    """What a reactor saw, to be compared with what it should have seen."""

    def __init__(self, *expected: Any) -> None:
        """Begin, with what is expected."""
        self._expected = list(expected)
        self._seen: list[Any] = []
        _open.append(self)

    def note(self, *what: Any) -> None:
        """Add an entry: one thing, or several as a tuple."""
        self._seen.append(what[0] if len(what) == 1 else what)

    def __len__(self) -> int:
        """How many entries there are."""
        return len(self._seen)

    def end(self, in_any_order: bool = False) -> None:
        """Compare; a difference ends the program with exit code 1."""
        seen, expected = self._seen, self._expected
        if in_any_order:
            seen, expected = sorted(seen), sorted(expected)
        if seen != expected:
            print(f"expected {expected}\n    seen {seen}", file=sys.stderr)
            sys.exit(1)
        _open.remove(self)


def now(lf: Any) -> tuple[int, int]:
    """The current tag: milliseconds since the start, and the microstep."""
    elapsed = lf.time.logical_elapsed()
    assert elapsed % 1_000_000 == 0, "a program of the corpus keeps to whole milliseconds"
    return elapsed // 1_000_000, lf.tag().microstep


def _left_open() -> None:
    if _open:
        print(f"{len(_open)} traces were never checked", file=sys.stderr, flush=True)
        os._exit(1)


atexit.register(_left_open)
