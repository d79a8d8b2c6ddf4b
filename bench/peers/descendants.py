"""The processes that the harness has started, directly or not: found and ended by their ids.

Daemons of peers detach from their parents. The kernel gives such orphans to the harness, once it
has asked for them, so they can be found as its children; nothing else on the machine is touched.
"""

from __future__ import annotations

import ctypes
import os
import signal
import time
from contextlib import suppress
from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36
_LOOK_EVERY_S = 0.02


def adopt_orphans() -> None:
    """Makes orphans among the descendants children of this process."""
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "cannot adopt orphans")


def all_of(process: int) -> list[int]:
    """The ids of all descendants that run, parents before their children."""
    children: dict[int, list[int]] = {}
    for directory in Path("/proc").iterdir():
        if directory.name.isdecimal():
            state, parent = _state_and_parent(directory)
            if state not in ("", "Z", "X"):
                children.setdefault(parent, []).append(int(directory.name))
    found: list[int] = []
    waiting = [process]
    while waiting:
        found += (next_ones := children.get(waiting.pop(), []))
        waiting += next_ones
    return found


def end_all(grace_s: float) -> None:
    """Ends every descendant: it is given time to end by itself, then asked to, then killed."""
    for number, patience_s in ((None, grace_s), (signal.SIGTERM, 3.0), (signal.SIGKILL, 10.0)):
        deadline = time.monotonic() + patience_s
        signalled: set[int] = set()
        while processes := all_of(os.getpid()):
            if number is not None:
                for process in set(processes) - signalled:
                    with suppress(ProcessLookupError):
                        os.kill(process, number)
                signalled.update(processes)
            if time.monotonic() > deadline:
                break
            time.sleep(_LOOK_EVERY_S)
        else:
            break
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG) != (0, 0):
            pass


def _state_and_parent(directory: Path) -> tuple[str, int]:
    """What the kernel says of a process; an empty state if it has ended in between."""
    try:
        fields = (directory / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return "", 0
    return fields[0], int(fields[1])
