"""Contexts: whether a program runs, as ``rclpy.context``.

All contexts of a process share one federate. It leaves its federation when the last of them is shut
down.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

from hprm.ros import _process
from hprm.ros._log_console import output
from hprm.ros._log_levels import levels
from hprm.ros._ros_arguments import RosArguments, parse_ros_arguments
from hprm.ros.exceptions import NotInitializedException, RCLError

_initialized: list[Context] = []


class Context:
    """The time from ``init`` to ``shutdown``."""

    def __init__(self) -> None:
        """Make a context that is not initialized."""
        self._lock = threading.RLock()
        self._callbacks: list[Callable[[], Any]] = []
        self._is_ok = False
        self._was_ok = False
        self.arguments = RosArguments()
        self._domain_id = 0

    @property
    def handle(self) -> Context:
        """The context itself, which has no native half."""
        return self

    def __enter__(self) -> Context:
        """Begin the context, unless it has begun."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End it."""
        self.try_shutdown()

    def init(
        self,
        args: Sequence[str] | None = None,
        *,
        initialize_logging: bool = True,
        domain_id: int | None = None,
    ) -> None:
        """Begin, with the arguments of the command line, or with others."""
        with self._lock:
            if self._is_ok:
                raise RuntimeError("Context.init() must only be called once")
            self.arguments = parse_ros_arguments(sys.argv if args is None else args)
            _process.begin_again()
            if domain_id is not None:
                if domain_id < 0:
                    raise RuntimeError(f"Domain id ({domain_id}) should not be lower than zero.")
                self._domain_id = domain_id
            if initialize_logging and not _initialized:
                _configure_log(self.arguments)
            self._is_ok = self._was_ok = True
            if self not in _initialized:
                _initialized.append(self)
        runtime = _process.runtime()
        _process.on_stop(self._stop)
        if not runtime.can_run:
            self._stop()

    def ok(self) -> bool:
        """Return whether it has begun and has not ended."""
        return self._is_ok

    def get_domain_id(self) -> int:
        """Return the number of the domain."""
        if not self._was_ok:
            raise NotInitializedException(
                "Context must be initialized before it can have a domain id"
            )
        return self._domain_id

    def shutdown(self) -> None:
        """End; it must have begun."""
        if not self._was_ok:
            raise RuntimeError("Context must be initialized before it can be shutdown")
        if not self._stop() and not _process.is_stranded():
            raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")
        self._leave()

    def try_shutdown(self) -> None:
        """End, if it has begun."""
        if self._stop() or self._was_ok:
            self._leave()

    def on_shutdown(self, callback: Callable[[], Any]) -> None:
        """Call ``callback`` when the context ends, or now if it has ended."""
        with self._lock:
            if self._is_ok or not self._was_ok:
                self._callbacks.append(callback)
                return
        callback()

    def destroy(self) -> None:
        """End, if it has begun."""
        self.try_shutdown()

    def _stop(self) -> bool:
        """Be no longer ok; return whether it was."""
        with self._lock:
            if not self._is_ok:
                return False
            self._is_ok = False
            callbacks, self._callbacks = self._callbacks, []
        _process.note_stop()
        for callback in callbacks:
            callback()
        _process.runtime().wake()
        return True

    def _leave(self) -> None:
        if self in _initialized:
            _initialized.remove(self)
        if not _initialized:
            _process.runtime().leave()


def _configure_log(arguments: RosArguments) -> None:
    """Write what the command line asks for."""
    output.to_console = arguments.log_to_console
    if arguments.level is not None:
        levels.set("", arguments.level)
    for name, level in arguments.levels.items():
        levels.set(name, level)
