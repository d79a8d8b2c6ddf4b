"""Calling functions of a launch file, so that neither signals nor the end of the launch wait.

Signals are noted, and what follows of them is done in the loop of the coordinator: never in the
middle of something else, such as the start of a process. Only a function of a launch file, which
may take any time, is interrupted.
"""

from __future__ import annotations

import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TypeVar

from hprm._hprm import ONE_SIGNAL_S

Result = TypeVar("Result")


class Interrupted(KeyboardInterrupt):
    """A function of a launch file does not go on, because of a signal."""


class Late(Interrupted):
    """A function of a launch file does not go on, because the launch has to end by now."""


class Functions:
    """Calls functions of a launch file, in the main thread, and notes signals."""

    def __init__(self) -> None:
        """Begin without a signal."""
        #: The signals of which nothing has followed by now.
        self.came: deque[int] = deque()
        #: When functions have to be over, if the launch ends.
        self.until: float | None = None
        self._is_within = False
        self._is_late = False
        self._noted_at = -ONE_SIGNAL_S

    def call(self, function: Callable[..., Result], *arguments: object) -> Result:
        """Call a function; raise ``Interrupted`` if it does not go on."""
        timer = None
        try:
            self._is_within = True
            if self.came:
                raise Interrupted
            if self.until is not None:
                timer = threading.Timer(max(self.until - time.monotonic(), 0), self._end)
                timer.start()
            return function(*arguments)
        finally:
            self._is_within = False
            if timer is not None:
                timer.cancel()
                if timer.is_alive():
                    timer.join()

    def is_again(self) -> bool:
        """Return, in the handler of a signal, whether it is the one that has just been noted."""
        return not self._is_late and time.monotonic() < self._noted_at + ONE_SIGNAL_S

    def note(self, number: int) -> bool:
        """Note a signal, in its handler; return whether it is none of ``_end``."""
        is_late, self._is_late = self._is_late, False
        if not is_late:
            self._noted_at = time.monotonic()
            self.came.append(number)
        return not is_late

    def interrupt(self) -> None:
        """Interrupt the function that is being called, if there is one: once."""
        if self._is_within:
            self._is_within = False
            raise Late if not self.came else Interrupted

    def _end(self) -> None:
        """Interrupt what is called in the main thread, which only a signal can do."""
        if self._is_within:
            self._is_late = True
            main = threading.main_thread().ident
            assert main is not None
            signal.pthread_kill(main, signal.SIGINT)
