"""The buffer of transforms that programs use: lookups may wait, as in ``tf2_ros.Buffer``."""

from __future__ import annotations

import threading
from collections.abc import Callable
from time import monotonic
from typing import Any

from hprm.ros import _process
from hprm.ros._interfaces import interface
from hprm.ros._tf2_ros._core import BufferCore, nanoseconds
from hprm.ros._tf2_ros.buffer_interface import BufferInterface
from hprm.ros.duration import Duration
from hprm.ros.task import Future
from hprm.ros.utilities import ok

_NOW = Duration()


class Buffer(BufferCore, BufferInterface):
    """Transforms between frames, over time, and waiting for them.

    A lookup with a ``timeout`` waits in logical time. In a callback of an executor with one thread,
    transforms that other callbacks would receive do not come meanwhile; the asynchronous methods
    wait without holding up anything.

    Parameters
    ----------
    cache_time
        How long transforms are kept, 10 seconds if it is not given.
    node
        A node that gets the service ``tf2_frames``, which tells of all frames in YAML.

    """

    def __init__(self, cache_time: Duration | None = None, node: Any = None) -> None:
        """Begin without frames."""
        BufferCore.__init__(self, cache_time)
        BufferInterface.__init__(self)
        self._changed = threading.Condition()
        self._listeners: list[Callable[[], None]] = []
        if node is not None:
            graph = interface("tf2_msgs.srv", "FrameGraph")
            self.srv = node.create_service(graph, "tf2_frames", self._answer)

    def _answer(self, request: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response

    def set_transform(self, transform: Any, authority: str) -> None:
        """Add a ``TransformStamped`` of a frame that moves, and wake up what waits for it."""
        super().set_transform(transform, authority)
        self._tell()

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Add a ``TransformStamped`` of a frame that never moves, and wake up what waits for it."""
        super().set_transform_static(transform, authority)
        self._tell()

    def _tell(self) -> None:
        with self._changed:
            self._changed.notify_all()
            listeners = list(self._listeners)
        for listener in listeners:
            listener()
        if ok():
            # What adds a transform may be a thread that the runtime does not know.
            _process.runtime().wake()

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = _NOW
    ) -> Any:
        """Return the transform from a source frame to a target frame, at a time (0: the latest).

        It waits for up to ``timeout``, and raises what ``lookup_transform_core`` does.
        """
        self.can_transform(target_frame, source_frame, time, timeout)
        return self.lookup_transform_core(target_frame, source_frame, time)

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """Return the transform from a source frame to a target frame, when there is one."""
        return await self.wait_for_transform_async(target_frame, source_frame, time)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = _NOW,
    ) -> Any:
        """Return the transform between two frames at two times; wait for up to ``timeout``."""
        frames = (target_frame, target_time, source_frame, source_time, fixed_frame)
        self.can_transform_full(*frames, timeout)
        return self.lookup_transform_full_core(*frames)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> Any:
        """Return the transform between two frames at two times, when there is one."""
        frames = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return await self.wait_for_transform_full_async(*frames)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = _NOW,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Return whether there is a transform; wait for up to ``timeout``.

        With ``return_debug_tuple`` it is a tuple, and tells why not.
        """
        return self._waited(
            lambda: self.can_transform_core(target_frame, source_frame, time),
            timeout,
            return_debug_tuple,
        )

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = _NOW,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Return whether there is a transform between two times; wait for up to ``timeout``."""
        frames = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._waited(
            lambda: self.can_transform_full_core(*frames), timeout, return_debug_tuple
        )

    def _waited(
        self, check: Callable[[], tuple[bool, str]], timeout: Any, as_tuple: bool
    ) -> bool | tuple[bool, str]:
        limit = nanoseconds(timeout, "duration")
        result = check()
        if not result[0] and limit > 0:
            if ok():
                _process.runtime().block(lambda: check()[0], limit)
                result = check()
            else:
                result = self._wait_by_the_clock(check, limit)
        return result if as_tuple else result[0]

    def _wait_by_the_clock(
        self, check: Callable[[], tuple[bool, str]], limit: int
    ) -> tuple[bool, str]:
        """Wait where there is no logical time: ``rclpy.init`` was not called."""
        end = monotonic() + limit / 1e9
        with self._changed:
            result = check()
            while not result[0] and (left := end - monotonic()) > 0:
                self._changed.wait(left)
                result = check()
        return result

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """Return a future of the transform from a source frame to a target frame."""
        frames = (target_frame, source_frame, time)
        return self._future(
            lambda: self.can_transform_core(*frames)[0],
            lambda: self.lookup_transform_core(*frames),
        )

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> Any:
        """Return a future of the transform between two frames at two times."""
        frames = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._future(
            lambda: self.can_transform_full_core(*frames)[0],
            lambda: self.lookup_transform_full_core(*frames),
        )

    def _future(self, check: Callable[[], bool], lookup: Callable[[], Any]) -> Any:
        future: Future[Any] = Future()

        def look() -> None:
            if future.done() or not check():
                return
            try:
                future.set_result(lookup())
            except Exception as error:
                future.set_exception(error)

        look()
        if not future.done():
            with self._changed:
                self._listeners.append(look)
            future.add_done_callback(lambda _: self._forget(look))
        return future

    def _forget(self, listener: Callable[[], None]) -> None:
        with self._changed:
            self._listeners.remove(listener)
