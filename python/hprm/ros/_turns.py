"""Which thread of a script runs, and whether logical time waits for it: one thread at a time.

The loop of the federate has a thread of its own. The threads of the script block in calls such as
``rclpy.spin``; a reaction of the federate wakes one of them, which *holds* its tag until it blocks
again. What the thread publishes meanwhile has that tag. This owns no queues and no callbacks: a
blocked thread states a condition, which says whether there is something for it.

A thread that does not block again within the patience loses its hold, so that one that has gone
elsewhere stops no federation; it gets a hold with the next reaction that wakes it.
"""

from __future__ import annotations

import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from threading import get_ident

from hprm._hprm import Turn

Condition = Callable[[], bool]

#: After how many seconds it is found out whether a thread that holds a tag has ended.
LOOKS_FOR_ENDED_S = 0.05

#: With what the paths of code begin that is not of scripts.
NOT_OF_SCRIPTS = (
    os.path.dirname(os.path.dirname(os.path.abspath(__file__))),
    os.path.dirname(os.__file__),
    "<frozen ",
)


def place(ident: int) -> str:
    """Return where a thread is in the code of its script, as a traceback shows it."""
    frame = sys._current_frames().get(ident)
    theirs = None if frame is None else of_scripts(traceback.extract_stack(frame))
    return "" if theirs is None else "".join(traceback.format_list([theirs]))


def of_scripts(frames: traceback.StackSummary) -> traceback.FrameSummary | None:
    """Return the innermost frame that is of a script of the user; none if there is none."""
    theirs = (it for it in reversed(frames) if not it.filename.startswith(NOT_OF_SCRIPTS))
    return next(theirs, None)


class Waiter:
    """A thread of the script that is blocked."""

    __slots__ = ("condition", "ident", "sleeps", "wakes")

    def __init__(self, ident: int, condition: Condition, sleeps: bool) -> None:
        """Block the thread ``ident`` until the condition is true."""
        self.ident = ident
        self.sleeps = sleeps
        self.condition = condition
        self.wakes = Turn()


class Turns:
    """The threads of a script, and which of them hold logical time.

    Parameters
    ----------
    patience
        For how many seconds a thread may hold a tag without blocking again.
    with_sleepers
        The same while another thread sleeps, which may have locks that it waits for.
    on_lost
        Is called with the number of a thread that has lost its hold, and after how many seconds.

    """

    def __init__(
        self, patience: float, with_sleepers: float, on_lost: Callable[[int, float], None]
    ) -> None:
        """Begin without any threads."""
        self._lock = threading.Lock()
        # Given when the last thread has released the tag that the federate waits for.
        self._settled = Turn()
        self._is_settling = False
        self._patience, self._with_sleepers = patience, with_sleepers
        self._on_lost = on_lost
        self._waiters: list[Waiter] = []
        #: Whose condition was false when nothing but that thread could have made it true.
        self._looked: Waiter | None = None
        #: The numbers of the threads that hold the tag, and of what is put by; changed here only.
        self.holders: set[int] = set()
        #: The last number by which a tag was put by; those of threads are positive.
        self._put_by = 0
        self._is_over = False

    def holds(self) -> bool:
        """Return whether this thread holds the tag of a reaction that waits for it."""
        return get_ident() in self.holders

    def block(
        self, condition: Condition, poke: Callable[[], None], *, sleeps: bool = False
    ) -> None:
        """Block this thread until the condition is true, and it holds a tag; or all turns end.

        ``poke`` has the federate look at the conditions, for a thread that holds no tag: what it
        waits for may be there already.
        """
        ident = get_ident()
        waiter: Waiter | None = None
        try:
            with self._lock:
                if self._is_over:
                    return
                held = ident in self.holders
                if held and condition():
                    return
                waiter = Waiter(ident, condition, sleeps)
                self._waiters.append(waiter)
                is_settled = False
                if held:
                    self.holders.remove(ident)
                    if self._is_settling and not self.holders:
                        self._is_settling, is_settled = False, True
                        self._looked = waiter
            if not held:
                poke()
            waiter.wakes.take(giving=self._settled if is_settled else None)
        except BaseException:
            # A signal may interrupt all of this.
            with self._lock:
                if waiter in self._waiters:
                    self._waiters.remove(waiter)
            raise

    def settle(self) -> None:
        """Wake the threads for which there is something, one after the other, and wait for each.

        The federate calls it in a reaction, which ends when no thread holds its tag.
        """
        # Each time that anything happens, so this calls no more functions than it has to.
        waiters = self._waiters
        while True:
            with self._lock:
                if self.holders:
                    self._wait()
                waiter = self._next()
                if waiter is None:
                    return
                waiters.remove(waiter)
                self.holders.add(waiter.ident)
                self._looked, self._is_settling = None, True
            self._settled.take(LOOKS_FOR_ENDED_S, waiter.wakes)
            looked = self._looked
            if looked is not None and waiters == [looked] and not self.holders:
                # It has found nothing more. A thread that blocks meanwhile has the federate look.
                self._looked = None
                return

    def blocked(self) -> list[int]:
        """Return the numbers of the threads that are blocked."""
        with self._lock:
            return [it.ident for it in self._waiters]

    def take(self, ident: int) -> None:
        """Let a thread hold the tag that this one holds: it has been given something to run."""
        with self._lock:
            self.holders.add(ident)

    def put_by(self) -> int:
        """Hold the tag for whichever thread adopts the number that is returned."""
        with self._lock:
            self._put_by -= 1
            self.holders.add(self._put_by)
            return self._put_by

    def adopt(self, number: int) -> bool:
        """Let this thread hold the tag that was put by; return whether it held none before."""
        ident = threading.get_ident()
        with self._lock:
            if number not in self.holders:
                # It is lost, or all turns have ended.
                return False
            is_new = ident not in self.holders
            self.holders.add(ident)
            self.holders.discard(number)
            return is_new

    def let_go(self, ident: int) -> None:
        """Have a blocked thread go on beside this one, which holds the tag, and may wait for it."""
        with self._lock:
            waiter = next((it for it in self._waiters if it.ident == ident), None)
            if waiter is not None and waiter.condition():
                self._waiters.remove(waiter)
                self.holders.add(ident)
                waiter.wakes.give()

    def leave(self) -> None:
        """Let this thread hold no tag any more: it ends, or runs what is none of the script."""
        with self._lock:
            is_settled = self._release(threading.get_ident())
        if is_settled:
            self._settled.give()

    def end(self) -> None:
        """Wake all threads: there are no more turns."""
        with self._lock:
            self._is_over = True
            self.holders.clear()
            for waiter in self._waiters:
                waiter.wakes.give()
            self._waiters.clear()
            self._settled.give()

    def _next(self) -> Waiter | None:
        """Find a thread for which there is something."""
        looked, self._looked = self._looked, None
        if not self._is_over:
            for waiter in self._waiters:
                if waiter is not looked and waiter.condition():
                    return waiter
        return None

    def _release(self, ident: int) -> bool:
        """Have a thread hold no tag; return whether the federate is to be told, which waits."""
        if ident not in self.holders:
            return False
        self.holders.remove(ident)
        if self.holders or not self._is_settling:
            return False
        self._is_settling = False
        return True

    def _wait(self) -> None:
        """Wait until no thread holds the tag, without the lock meanwhile."""
        since = time.monotonic()
        while self.holders and not self._is_over:
            self._is_settling = True
            self._lock.release()
            try:
                # It may be given for an earlier wait that did not last: the holders count.
                is_told = self._settled.take(LOOKS_FOR_ENDED_S)
            finally:
                self._lock.acquire()
            if is_told:
                continue
            self._is_settling = False
            # A thread that has ended does not tell it.
            running = _running()
            self.holders = {it for it in self.holders if it < 0 or it in running}
            sleeps = any(it.sleeps for it in self._waiters)
            patience = self._with_sleepers if sleeps else self._patience
            if time.monotonic() > since + patience:
                lost, self.holders = self.holders, set()
                for ident in lost:
                    self._on_lost(ident, patience)


def _running() -> set[int]:
    """The numbers of the threads that may come back, from whatever they do."""
    threads = threading.enumerate()
    first = threading.main_thread()
    if not first.is_alive() and any(it.is_alive() and not it.daemon for it in threads):
        # It is at its end, and only waits for others.
        threads.remove(first)
    return {it.ident for it in threads if it.ident is not None}
