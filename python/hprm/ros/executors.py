"""Executors, as ``rclpy.executors``: threads that spin, and run the callbacks of nodes.

Callbacks run one at a time, in the order of tags and, at one tag, in the order in which their
entities were made; so all executors run them in the same order. With several threads, a callback
may block, in a call to a service for example, while others run.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from inspect import iscoroutinefunction
from threading import get_ident
from types import TracebackType
from typing import TYPE_CHECKING, Any

from hprm.ros import _process
from hprm.ros.task import Future, Task

if TYPE_CHECKING:
    from hprm.ros._entity import Entity
    from hprm.ros.context import Context
    from hprm.ros.node import Node


#: What ends a wait before there is something to do.
IsOver = Callable[[], bool]


class TimeoutException(Exception):
    """There was nothing to do within the timeout."""


class ShutdownException(Exception):
    """The executor was shut down."""


class ExternalShutdownException(Exception):
    """The context was shut down while an executor was spinning."""


class ConditionReachedException(Exception):
    """What was waited for has happened."""


class Search:
    """What an executor waits for: something to do."""

    __slots__ = ("executor", "found", "is_over", "nodes", "turns")

    def __init__(
        self, executor: Executor, is_over: IsOver | None = None, nodes: list[Node] | None = None
    ) -> None:
        """Look for something of some of the nodes, or of all, until that is over."""
        self.executor = executor
        self.is_over = is_over
        self.nodes = nodes
        self.turns = executor._runtime.turns
        self.found: Task[Any] | Entity | None = None

    def look(self) -> bool:
        """Return whether there is something to do, or the wait is over."""
        self.found = None
        executor = self.executor
        if executor._is_shutdown or not executor._context._is_ok:
            return True
        if self.is_over is not None and self.is_over():
            return True
        # One callback at a time: one that blocks holds no tag.
        holders = self.turns.holders
        if not holders or (len(holders) == 1 and get_ident() in holders):
            self.found = executor._first(self.nodes)
        return self.found is not None


class Executor:
    """Runs the callbacks of nodes in the thread that spins."""

    def __init__(self, *, context: Context | None = None) -> None:
        """Make an executor without nodes."""
        from hprm.ros.utilities import get_default_context

        self._context = get_default_context() if context is None else context
        #: Another tuple when there are others: threads that look through it need no lock.
        self._nodes: tuple[Node, ...] = ()
        self._tasks: list[Task[Any]] = []
        self._lock = threading.RLock()
        self._is_shutdown = False
        self._spinning: int | None = None
        #: Has one element unless a thread spins: quicker than a lock, at each callback.
        self._may_spin = [True]
        self._runtime = _process.runtime()
        #: That of the thread that spins: one for all times, as it begins anew at each callback.
        self._search = Search(self)
        self._context.on_shutdown(self.wake)

    @property
    def context(self) -> Context:
        """The context with which it ends."""
        return self._context

    def __enter__(self) -> Executor:
        """Return the executor."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Shut it down."""
        self.shutdown()

    def _can_spin(self) -> bool:
        """Whether it runs callbacks in what has begun last in this process."""
        return self._context.ok() and self._runtime is _process.runtime()

    # What it has to do.

    def add_node(self, node: Node) -> bool:
        """Run the callbacks of a node from now on; return whether it is new here."""
        with self._lock:
            if node in self._nodes:
                return False
            # Before the node learns of it, which would add itself otherwise.
            self._nodes = (*self._nodes, node)
            node.executor = self
        self.wake()
        return True

    def remove_node(self, node: Node) -> None:
        """Run the callbacks of a node no more."""
        with self._lock:
            if node in self._nodes:
                self._nodes = tuple(it for it in self._nodes if it is not node)

    def get_nodes(self) -> list[Node]:
        """Return the nodes."""
        return list(self._nodes)

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task[Any]:
        """Run a function or a coroutine; return what becomes of it."""
        task: Task[Any] = Task(callback, args, kwargs, executor=self)
        with self._lock:
            self._tasks.append(task)
        self.wake()
        return task

    def wake(self) -> None:
        """Have a thread that spins look for something to do."""
        self._runtime.wake()

    def later(self, action: Callable[[], None]) -> None:
        """Call ``action`` at the next tag of the clock."""
        self._runtime.request(action)

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Spin no more; return whether nothing is left to run.

        Threads of callbacks end with their callbacks, whether it waits for them or not.
        """
        with self._lock:
            self._is_shutdown = True
            spinning = self._spinning
        turns = self._runtime.turns
        if spinning is not None and spinning != threading.get_ident() and turns.holds():
            # What follows may be that this thread waits for that one.
            turns.let_go(spinning)
        self.wake()
        return True

    # Spinning.

    def spin(self) -> None:
        """Run callbacks until the context or the executor is shut down."""
        while self._context.ok() and not self._is_shutdown:
            self.spin_once()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one callback, no longer than the timeout, and run it."""
        self._spin_once(timeout_sec, None)

    def spin_until_future_complete(
        self, future: Future[Any], timeout_sec: float | None = None
    ) -> None:
        """Run callbacks until a future is done, or for so long."""
        if not future.done() and future._executor is None:
            future._set_executor(self)
        if timeout_sec is None or timeout_sec < 0:
            while self._context.ok() and not future.done() and not self._is_shutdown:
                self._spin_once(None, future.done)
            return
        until = self._runtime.now() + round(timeout_sec * 1e9)
        while self._context.ok() and not future.done() and not self._is_shutdown:
            left = until - self._runtime.now()
            if left <= 0:
                return
            self._spin_once(left / 1e9, future.done)

    def spin_once_until_future_complete(
        self, future: Future[Any], timeout_sec: float | None = None
    ) -> None:
        """Wait for one callback, or until a future is done, no longer than the timeout."""
        if not future.done():
            self._spin_once(timeout_sec, future.done)

    def _spin_once(self, timeout_sec: float | None, is_over: IsOver | None) -> None:
        try:
            self._may_spin.pop()
        except IndexError:
            raise RuntimeError("Executor is already spinning") from None
        self._spinning = get_ident()
        try:
            self._search.is_over = is_over
            found = self._wait(timeout_sec, self._search)
            if isinstance(found, Task):
                self._run(*self._taken(found))
            elif found is not None:
                self._call(found)
        finally:
            self._search.is_over = self._spinning = None
            self._may_spin.append(True)

    def _runs_callbacks_in_this_thread(self) -> bool:
        """Whether this thread runs a callback, and takes what is for others only after it."""
        return self._spinning == threading.get_ident()

    def wait_for_ready_callbacks(
        self,
        timeout_sec: float | None = None,
        nodes: list[Node] | None = None,
        condition: IsOver | None = None,
    ) -> tuple[Task[Any], Entity | None, Node | None]:
        """Wait for a callback; return a task that runs it in any thread, and whose it is.

        Logical time waits until the task has run.

        Raises
        ------
        TimeoutException
            If there is nothing in time.
        ShutdownException
            If the executor was shut down.
        ConditionReachedException
            If ``condition`` is true.

        """
        found = self._wait(timeout_sec, Search(self, condition, nodes))
        if self._is_shutdown:
            raise ShutdownException
        if found is None:
            is_reached = condition is not None and condition()
            raise ConditionReachedException if is_reached else TimeoutException
        task, entity = self._taken(found)
        return self._handed(task, entity), entity, None if entity is None else entity._node

    def _handed(self, task: Task[Any], entity: Entity | None) -> Task[Any]:
        """Return a task that runs another one, at this tag, in the thread that calls it."""
        turns = self._runtime.turns
        number = turns.put_by()

        def run() -> Any:
            is_new = turns.adopt(number)
            held = turns.holds()
            try:
                Executor._run(self, task, entity)
                return task.result()
            finally:
                if is_new:
                    turns.leave()
                if not held:
                    self.wake()

        return Task(run, executor=self)

    def _call(self, entity: Entity) -> None:
        """Run the callback of an entity in this thread; what it raises, this raises."""
        # Few callbacks are coroutines, which need a task.
        group = entity.callback_group
        group.beginning_execution(entity)
        callback = entity.take()
        if not entity.is_plain and iscoroutinefunction(callback):
            self._run(Task(callback, executor=self), entity)
            return
        try:
            callback()
        finally:
            group.ending_execution(entity)

    def _wait(self, timeout_sec: float | None, search: Search) -> Task[Any] | Entity | None:
        """Wait for the next thing to do; none if there is an end of the wait before."""
        if timeout_sec is None or timeout_sec < 0:
            self._runtime.wait(search.look)
        else:
            self._runtime.wait(search.look, round(timeout_sec * 1e9))
        if self._is_shutdown:
            return None
        if not self._context._is_ok:
            raise ExternalShutdownException
        # Nothing here keeps it for longer than the program does.
        found, search.found = search.found, None
        # Something else may have taken it meanwhile.
        if isinstance(found, Task):
            if found.is_ready:
                return found
        elif found is not None and found.has_work() and found.callback_group.can_execute(found):
            return found
        return self._first(search.nodes)

    def _first(self, nodes: list[Node] | None = None) -> Task[Any] | Entity | None:
        """Find the first thing to do, for some of the nodes."""
        # Each callback is looked for here, so this calls no more functions than it has to.
        if self._tasks:
            task = self._first_task()
            if task is not None:
                return task
        for node in self._nodes:
            if nodes is None or node in nodes:
                for entity in node._entities:
                    if entity.has_work() and entity.callback_group.can_execute(entity):
                        return entity
        return None

    def _first_task(self) -> Task[Any] | None:
        """Find the first task to run, and forget those that are done."""
        for task in list(self._tasks):
            if task.done():
                self._tasks.remove(task)
            elif task.is_ready:
                return task
        return None

    def _taken(self, found: Task[Any] | Entity) -> tuple[Task[Any], Entity | None]:
        """Take what a callback needs, so that nothing else finds it."""
        if isinstance(found, Task):
            found.is_ready = False
            return found, None
        found.callback_group.beginning_execution(found)
        return Task(found.take(), executor=self), found

    def _run(self, task: Task[Any], entity: Entity | None) -> None:
        """Run a task in this thread; what a callback raises, this raises."""
        try:
            task()
        finally:
            if entity is not None and task.done():
                entity.callback_group.ending_execution(entity)
        if not task.done():
            if entity is not None:
                # A callback with `await`: its group stays busy.
                task.add_done_callback(lambda _: entity.callback_group.ending_execution(entity))
                self._tasks.append(task)
            return
        error = task.exception()
        if error is not None:
            raise error


class SingleThreadedExecutor(Executor):
    """Runs callbacks in the thread that spins."""


class MultiThreadedExecutor(Executor):
    """Runs each callback in a thread of its own, so that one may block while others run."""

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        """Make an executor without nodes; at most so many callbacks are open."""
        super().__init__(context=context)
        if num_threads is not None and num_threads < 2:
            num_threads = 2
        self._limit = num_threads
        self._errors: list[BaseException] = []
        self._running = 0

    def _runs_callbacks_in_this_thread(self) -> bool:
        return False

    def _first(self, nodes: list[Node] | None = None) -> Task[Any] | Entity | None:
        if self._limit is not None and self._running >= self._limit:
            return None
        return super()._first(nodes)

    def _spin_once(self, timeout_sec: float | None, is_over: IsOver | None) -> None:
        # Here rclpy's executor of several threads ends its spin, rather than raising.
        with suppress(ExternalShutdownException):
            super()._spin_once(
                timeout_sec, lambda: bool(self._errors) or (is_over is not None and is_over())
            )
        if self._errors:
            raise self._errors.pop(0)

    def _call(self, entity: Entity) -> None:
        self._run(*self._taken(entity))

    def _run(self, task: Task[Any], entity: Entity | None) -> None:
        self._running += 1
        may_begin = threading.Event()

        def run() -> None:
            may_begin.wait()
            try:
                super(MultiThreadedExecutor, self)._run(task, entity)
            except BaseException as error:
                self._errors.append(error)
            finally:
                self._running -= 1
                held = self._runtime.turns.holds()
                self._runtime.turns.leave()
                if not held:
                    # It has lost its tag, so no reaction ends with it, and looks at what it did.
                    self.wake()

        thread = threading.Thread(target=run, name="callback", daemon=True)
        thread.start()
        assert thread.ident is not None
        self._runtime.turns.take(thread.ident)
        may_begin.set()
