"""Futures and tasks, as ``rclpy.task``."""

from __future__ import annotations

import inspect
import sys
import threading
import warnings
from collections.abc import Callable, Generator
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Future(Generic[T]):
    """A result that may come later."""

    def __init__(self, *, executor: Any = None) -> None:
        """Make one without a result; its callbacks run in ``executor``."""
        self._done = False
        self._cancelled = False
        self._result: T | None = None
        self._exception: BaseException | None = None
        self._exception_fetched = False
        self._callbacks: list[Callable[[Future[T]], Any]] = []
        #: What goes on in coroutines that await this: at once, rather than as a task of its own.
        self._waiters: list[Callable[[], None]] = []
        self._lock = threading.RLock()
        self._executor: Any = None
        self._set_executor(executor)

    def __del__(self) -> None:
        """Tell of an exception that nothing has asked for."""
        if self._exception is not None and not self._exception_fetched:
            warnings.warn(
                f"The following exception was never retrieved: {self._exception}",
                RuntimeWarning,
                stacklevel=2,
            )

    def __await__(self) -> Generator[Future[T] | None, None, T | None]:
        """Wait in a coroutine: of an executor, or of asyncio, which looks again and again."""
        # It takes 30 ms to import, and no loop of it runs where nothing has imported it.
        asyncio = sys.modules.get("asyncio.events")
        foreign = asyncio is not None and asyncio._get_running_loop() is not None
        while not self._done and not self._cancelled:
            yield None if foreign else self
        return self.result()

    def cancel(self) -> None:
        """Be done without a result, unless there is one."""
        with self._lock:
            if self._done:
                return
            self._cancelled = True
        self._call_back()

    def cancelled(self) -> bool:
        """Return whether it was cancelled."""
        return self._cancelled

    def done(self) -> bool:
        """Return whether there is a result, or an exception, or it was cancelled."""
        return self._done or self._cancelled

    def result(self) -> T | None:
        """Return the result, or raise the exception; none if it is not done."""
        if self._exception is not None:
            self._exception_fetched = True
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        """Return the exception; none if there is a result, or nothing yet."""
        self._exception_fetched = True
        return self._exception

    def set_result(self, result: T) -> None:
        """Set the result, which calls the callbacks."""
        with self._lock:
            self._result = result
            self._done, self._cancelled = True, False
        self._call_back()

    def set_exception(self, exception: BaseException) -> None:
        """Set an exception instead of a result, which calls the callbacks."""
        with self._lock:
            self._exception = exception
            self._exception_fetched = False
            self._done, self._cancelled = True, False
        self._call_back()

    def add_done_callback(self, callback: Callable[[Future[T]], Any]) -> None:
        """Call ``callback`` with this future when it is done, or soon if it is done."""
        with self._lock:
            if not self.done():
                self._callbacks.append(callback)
                return
        self._run(callback)

    def remove_done_callback(self, callback: Callable[[Future[T]], Any]) -> bool:
        """Call ``callback`` no longer; return whether it was to be called."""
        with self._lock:
            if callback not in self._callbacks:
                return False
            self._callbacks.remove(callback)
            return True

    def _set_executor(self, executor: Any) -> None:
        self._executor = executor

    def _call_back(self) -> None:
        with self._lock:
            callbacks, self._callbacks = self._callbacks, []
            waiters, self._waiters = self._waiters, []
        for go_on in waiters:
            go_on()
        for callback in callbacks:
            self._run(callback)
        executor = self._executor
        if executor is not None:
            executor.wake()

    def _when_done(self, go_on: Callable[[], None]) -> None:
        """Call ``go_on`` when this is done, or now if it is."""
        with self._lock:
            if not self.done():
                self._waiters.append(go_on)
                return
        go_on()

    def _run(self, callback: Callable[[Future[T]], Any]) -> None:
        if self._executor is not None:
            self._executor.create_task(callback, self)
            return
        try:
            callback(self)
        except Exception as error:
            warnings.warn(f"Unhandled exception in done callback: {error}", stacklevel=2)


class Task(Future[T]):
    """A function or a coroutine that an executor runs."""

    def __init__(
        self,
        handler: Callable[..., Any] | Any,
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
        executor: Any = None,
    ) -> None:
        """Run ``handler(*args, **kwargs)``."""
        super().__init__(executor=executor)
        self._arguments = (tuple(args), dict(kwargs or {}))
        if inspect.iscoroutinefunction(handler):
            handler = handler(*self._arguments[0], **self._arguments[1])
        self._handler: Any = handler
        self._executing = False
        #: Whether it can go on.
        self.is_ready = True

    def __call__(self) -> None:
        """Run it to its end, or to what it awaits."""
        if self.done() or self._executing:
            return
        self._executing, self.is_ready = True, False
        try:
            if inspect.iscoroutine(self._handler):
                self._step()
            else:
                arguments, keywords = self._arguments
                self.set_result(self._handler(*arguments, **keywords))
        except Exception as error:
            self.set_exception(error)
        finally:
            self._executing = False

    def executing(self) -> bool:
        """Return whether it runs at the moment."""
        return self._executing

    def cancel(self) -> None:
        """Go on no more."""
        super().cancel()
        if inspect.iscoroutine(self._handler):
            self._handler.close()

    def _step(self) -> None:
        try:
            awaited = self._handler.send(None)
        except StopIteration as end:
            self.set_result(end.value)
            return
        if isinstance(awaited, Future):
            awaited._when_done(self._go_on)
        elif self._executor is not None:
            # It waits for nothing that is known here: it is asked again at a later tag.
            self._executor.later(self._go_on)

    def _go_on(self) -> None:
        self.is_ready = True
        if self._executor is not None:
            self._executor.wake()
