"""The runtime of this process, its contexts, and the signals that ask it for its end."""

from __future__ import annotations

import atexit
import json
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any

from hprm.ros import _meeting
from hprm.ros._log_console import output
from hprm.ros._runtime import Runtime
from hprm.ros.exceptions import RCLError

_lock = threading.Lock()
#: The runtime of this process, once there is one.
current: Runtime | None = None
_on_stop: list[Callable[[], object]] = []


def runtime() -> Runtime:
    """Return the runtime of this process; the first call makes it."""
    global current
    made = current
    if made is not None:
        return made
    with _lock:
        if current is None:
            current = _made(_meeting.of_this_process())
        return current


def running() -> Runtime | None:
    """Return the runtime of this process, if it has one."""
    return current


def note_stop(by_signal: bool = False) -> None:
    """Note that the script is asked for its end by this thread, or by a signal."""
    if current is not None:
        current.note_stop(by_signal)


def is_stranded() -> bool:
    """Return whether the federation of this process has ended because of another process."""
    return current is not None and current.is_stranded


def begin_again() -> None:
    """Have another runtime if the process has left its federation and is a federation of its own.

    Raises
    ------
    RCLError
        If it was one of several in its federation, and has left it.

    """
    global current
    with _lock:
        if current is None or not current.has_left:
            return
        meeting = current.meeting.again()
        if meeting is None:
            raise RCLError(
                "failed to initialize: this script has left its federation, at the shutdown of its"
                " last context, and cannot come back\n"
                "  hint: shut down once, at the end; a script that runs alone may begin again"
            )
        current = _made(meeting)


def _made(meeting: _meeting.Meeting) -> Runtime:
    made = Runtime(meeting)
    atexit.register(_leave_at_exit, made)
    # A message that a callback logs has the time of its tag.
    output.set_time_source(made.now)
    made.on_end.append(lambda code: _ended(made, code))
    return made


def _leave_at_exit(runtime: Runtime) -> None:
    """Leave when the process ends; a signal ends it at once then."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    ours = signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _interrupt)
    if ours and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    runtime.leave()


def on_stop(action: Callable[[], object]) -> None:
    """Call ``action`` when the process is asked for its end, or its federation has ended."""
    _on_stop.append(action)


def handle_signals(*numbers: int) -> None:
    """Let these of SIGINT and SIGTERM shut all contexts down, and the other one not.

    A signal for which the program has a handler of its own keeps that.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number, default, ours in _handlers():
        if signal.getsignal(number) in (default, ours):
            signal.signal(number, ours if number in numbers else default)


def handled_signals() -> list[int]:
    """Return which signals shut all contexts down."""
    return [number for number, _, ours in _handlers() if signal.getsignal(number) == ours]


def _handlers() -> list[tuple[int, Any, Any]]:
    return [
        (signal.SIGINT, signal.default_int_handler, _interrupt),
        (signal.SIGTERM, signal.SIG_DFL, _terminate),
    ]


def _interrupt(number: int, frame: FrameType | None) -> Any:
    _stop()
    signal.default_int_handler(number, frame)


def _terminate(number: int, frame: FrameType | None) -> None:
    _stop()


def _stop() -> None:
    note_stop(by_signal=True)
    # In another thread: this one may have locks of the runtime.
    threading.Thread(target=_call_all, daemon=True).start()


def _call_all() -> None:
    for action in list(_on_stop):
        action()


def _ended(runtime: Runtime, code: int) -> None:
    if runtime.is_stranded:
        # Before anything that follows from it.
        runtime.meeting.strand()
    if runtime is current:
        _call_all()
    if code:
        for failure in runtime.failures:
            print(f"error: {json.loads(failure)['message']}", file=sys.stderr)
