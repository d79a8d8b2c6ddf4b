"""Reactions that are coroutines: ``async def`` bodies run to their end within their tag.

Each thread that runs bodies has an event loop of its own, which runs only while a body does. What
is to go on after the tag runs in the background, and schedules a physical action when it is done.
"""

from __future__ import annotations

import functools
import inspect
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm._mistakes import one

if TYPE_CHECKING:
    import asyncio

_local = threading.local()


def called(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that runs ``function`` to its end, which may be a coroutine function."""
    if not inspect.iscoroutinefunction(function):
        return function

    @functools.wraps(function)
    def run(reactor: object) -> object:
        return _loop().run_until_complete(_alone(function, reactor))

    return run


async def _alone(function: Callable[..., Any], reactor: object) -> object:
    """Return what a body returns, and refuse tasks that it leaves behind, which would not go on."""
    import asyncio

    before = asyncio.all_tasks()
    returned: object = await function(reactor)
    left = [task for task in asyncio.all_tasks() - before if not task.done()]
    for task in left:
        task.cancel()
    if left:
        await asyncio.gather(*left, return_exceptions=True)
        name = getattr(left[0].get_coro(), "__qualname__", "a task")
        raise RuntimeError(
            f"{name} was not done at the end of the reaction that started it: await it, or run it"
            " with hprm.background(...) and schedule a physical action when it is done"
        )
    return returned


def _loop() -> asyncio.AbstractEventLoop:
    """Return the event loop of this thread for bodies."""
    import asyncio

    loop: asyncio.AbstractEventLoop | None = getattr(_local, "loop", None)
    if loop is None or loop.is_closed():
        loop = _local.loop = asyncio.new_event_loop()
    return loop


class _Background:
    """The event loop of the process that runs what outlives a tag, in a thread of its own."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.loop: asyncio.AbstractEventLoop | None = None
        self.thread: threading.Thread | None = None

    def start(self) -> asyncio.AbstractEventLoop:
        import asyncio

        with self.lock:
            if self.loop is None:
                self.loop = asyncio.new_event_loop()
                self.thread = threading.Thread(
                    target=self.loop.run_forever, name="hprm background", daemon=True
                )
                self.thread.start()
            return self.loop


_background = _Background()


def background(coroutine: Any, action: Any = None) -> None:
    """Run a coroutine beside the reactions; its result is scheduled on a physical action.

    Parameters
    ----------
    coroutine : coroutine
        What goes on after the tag of the reaction that starts it, on an event loop of this process
        in a thread of its own. An exception that it raises ends the program.
    action : physical action, optional
        The physical action that is scheduled with the result, such as ``self.answer``.

    """
    import asyncio

    if not inspect.isawaitable(coroutine):
        call = f": call it, hprm.background({_name(coroutine)}(...))" if callable(coroutine) else ""
        given = one(type(coroutine).__name__)
        raise TypeError(f"hprm.background takes a coroutine, and this is {given}{call}")

    async def run() -> None:
        result = await coroutine
        if action is None:
            return
        try:
            action.schedule(0, result)
        except TypeError as error:
            raise TypeError(f"what {_name(coroutine)} has returned: {error}") from None

    future = asyncio.run_coroutine_threadsafe(run(), _background.start())
    future.add_done_callback(_tell)


def _name(coroutine: Any) -> str:
    """Return what a coroutine, or a function that makes one, is called."""
    if inspect.ismethod(coroutine):
        return f"self.{coroutine.__name__}"
    return str(getattr(coroutine, "__qualname__", "the coroutine"))


def _tell(future: Any) -> None:
    """Let an exception end the program, as that of a thread does."""
    error = None if future.cancelled() else future.exception()
    if error is not None:
        arguments = (type(error), error, error.__traceback__, _background.thread)
        threading.excepthook(threading.ExceptHookArgs(arguments))
