"""Logical time that does not wait for the physical one: ``--fast``.

Nothing physical triggers a federate then. What threads of the script ask for while they hold no tag
is done at a tag a little later. While a thread of the script runs outside of ``rclpy``, nothing is
known of what it will ask for, so logical time passes no quicker than the physical one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable

#: How much later, in nanoseconds, is done what threads without a tag have asked for.
STEP_NS = 1_000_000

#: For how many seconds the first tag waits for threads to block.
BEGINNING_S = 0.5


class Pace:
    """When a federate has to look for what the threads of its script ask for."""

    def __init__(self, blocked: Callable[[], Iterable[int]]) -> None:
        """Take what returns the threads that are blocked in ``rclpy``."""
        self._blocked = blocked
        self._changed = threading.Condition()
        self._asked = False
        self._is_planned = False
        #: Logical and physical time when a thread was first found to run.
        self._since: tuple[int, float] | None = None

    def ask(self) -> None:
        """Have the federate look soon."""
        with self._changed:
            self._asked = True
            self._changed.notify()

    def wait_for_threads(self) -> None:
        """Wait for the threads that are about to block, before the first tag."""
        until = time.monotonic() + BEGINNING_S
        while self._has_running_threads() and time.monotonic() < until:
            time.sleep(0.0005)

    def looks(self) -> None:
        """Note that the federate looks now."""
        with self._changed:
            self._asked = self._is_planned = False

    def end_tag(self, now: int) -> bool:
        """Wait as long as the tag of that time has to last; return whether to look a step later."""
        is_real = self._has_running_threads()
        if not is_real:
            self._since = None
        elif self._since is None:
            self._since = (now, time.monotonic())
        with self._changed:
            if self._since is not None:
                logical, physical = self._since
                left = physical + (now - logical) / 1e9 - time.monotonic()
                self._changed.wait_for(lambda: self._asked, max(left, 0))
            if self._is_planned or not (self._asked or is_real):
                return False
            self._is_planned = True
            return True

    def _has_running_threads(self) -> bool:
        known = {*self._blocked(), threading.get_ident()}
        return any(it.is_alive() and it.ident not in known for it in threading.enumerate())
