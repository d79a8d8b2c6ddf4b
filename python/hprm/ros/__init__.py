"""rclpy's API on HPRM: nodes whose callbacks run in the order of tags, the same on every run.

``import hprm.ros as rclpy`` in a program, or ``hprm ros run script.py`` for one that is left as it
is. No ROS installation is needed.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from hprm.ros import _messages
from hprm.ros.context import Context
from hprm.ros.executors import Executor, SingleThreadedExecutor
from hprm.ros.parameter import Parameter
from hprm.ros.signals import SignalHandlerOptions, install_signal_handlers
from hprm.ros.task import Future
from hprm.ros.utilities import get_default_context, ok, shutdown, try_shutdown

_messages.install()

if TYPE_CHECKING:
    from types import TracebackType

    from hprm.ros.node import Node

__all__ = [
    "Context",
    "Future",
    "Parameter",
    "SignalHandlerOptions",
    "create_node",
    "get_default_context",
    "get_global_executor",
    "init",
    "ok",
    "shutdown",
    "spin",
    "spin_once",
    "spin_until_future_complete",
    "try_shutdown",
]

_executor: Executor | None = None


def __getattr__(name: str) -> Any:
    """Import a module of the package when it is named first, as ``rclpy.logging``."""
    if not name.startswith("_"):
        try:
            return importlib.import_module(f"hprm.ros.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"hprm.ros.{name}":
                raise
    raise AttributeError(f"module 'rclpy' has no attribute {name!r}")


class InitContextManager:
    """What ``init`` returns: a context manager that shuts down at its end."""

    def __init__(self, context: Context) -> None:
        """Shut ``context`` down at the end."""
        self.context = context

    def __enter__(self) -> InitContextManager:
        """Return the manager."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Shut down, if that has not happened."""
        try_shutdown(context=self.context)


def init(
    *,
    args: Sequence[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> InitContextManager:
    """Begin: before nodes are made.

    Parameters
    ----------
    args
        The arguments, with those behind ``--ros-args``; those of the command line if there are
        none.
    context
        The context that begins; the default one if it is left out.
    domain_id
        The number of the domain.
    signal_handler_options
        Which signals shut down; by default SIGINT and SIGTERM, for the default context.

    """
    chosen = get_default_context() if context is None else context
    if signal_handler_options is None:
        signal_handler_options = (
            SignalHandlerOptions.ALL if context is None else SignalHandlerOptions.NO
        )
    chosen.init(args, domain_id=domain_id)
    if signal_handler_options != SignalHandlerOptions.NO:
        install_signal_handlers(signal_handler_options)
    return InitContextManager(chosen)


def create_node(node_name: str, **keywords: Any) -> Node:
    """Make a node; the keywords are those of ``Node``."""
    from hprm.ros.node import Node

    return Node(node_name, **keywords)


def get_global_executor() -> Executor:
    """Return the executor of programs that make none themselves."""
    global _executor
    if _executor is None or not _executor._can_spin():
        _executor = SingleThreadedExecutor()
    return _executor


@contextmanager
def _executing(node: Node, executor: Executor | None) -> Iterator[Executor]:
    """Have an executor, or the global one, run the callbacks of a node meanwhile."""
    chosen = get_global_executor() if executor is None else executor
    chosen.add_node(node)
    try:
        yield chosen
    finally:
        chosen.remove_node(node)


def spin(node: Node, executor: Executor | None = None) -> None:
    """Run the callbacks of a node until the context is shut down."""
    with _executing(node, executor) as chosen:
        context = chosen.context
        while context.ok():
            chosen.spin_once()


def spin_once(
    node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Wait for one callback of a node, no longer than the timeout, and run it."""
    with _executing(node, executor) as chosen:
        chosen.spin_once(timeout_sec=timeout_sec)


def spin_until_future_complete(
    node: Node,
    future: Future[Any],
    executor: Executor | None = None,
    timeout_sec: float | None = None,
) -> None:
    """Run the callbacks of a node until a future is done, or for so long."""
    with _executing(node, executor) as chosen:
        chosen.spin_until_future_complete(future, timeout_sec)
