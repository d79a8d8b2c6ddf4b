"""What all modules need, as ``rclpy.utilities``."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hprm.ros.context import Context

_lock = threading.Lock()
_default: Context | None = None


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the context of programs that make none themselves."""
    global _default
    from hprm.ros.context import Context

    with _lock:
        if _default is None:
            _default = Context()
        return _default


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """Return the arguments of the program itself, without those of ROS."""
    import sys

    from hprm.ros._ros_arguments import parse_ros_arguments

    return parse_ros_arguments(sys.argv if args is None else args).others


def ok(*, context: Context | None = None) -> bool:
    """Return whether a context has begun and has not ended."""
    return (get_default_context() if context is None else context).ok()


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """End a context; with the default one, signals do again what they do without rclpy."""
    (get_default_context() if context is None else context).shutdown()
    _uninstall_handlers(context, uninstall_handlers)


def try_shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """End a context, if it has begun, as :func:`shutdown` does."""
    (get_default_context() if context is None else context).try_shutdown()
    _uninstall_handlers(context, uninstall_handlers)


def _uninstall_handlers(context: Context | None, wanted: bool | None) -> None:
    from hprm.ros.signals import uninstall_signal_handlers

    if wanted or (wanted is None and context in (None, get_default_context())):
        uninstall_signal_handlers()


def get_rmw_implementation_identifier() -> str:
    """Return what carries messages."""
    return "hprm"


def get_available_rmw_implementations() -> set[str]:
    """Return what may carry messages."""
    return {get_rmw_implementation_identifier()}


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Return a timeout in nanoseconds; -1 if there is none."""
    if timeout_sec is None or timeout_sec < 0:
        return -1
    return int(float(timeout_sec) * 1e9)
