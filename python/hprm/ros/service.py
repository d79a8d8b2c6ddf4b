"""Services, as ``rclpy.service``."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm.ros._entity import Queue
from hprm.ros._interface import check_callback, copy_of
from hprm.ros._service_end import ServiceEnd
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.task import Future

if TYPE_CHECKING:
    from hprm.ros._graph import Endpoint
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile


class Service(ServiceEnd):
    """Answers requests."""

    order = 4

    def __init__(
        self,
        node: Node,
        srv_type: type[Any],
        endpoint: Endpoint,
        callback: Callable[[Any, Any], Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
    ) -> None:
        """Make the service of a node, which is an endpoint."""
        check_callback(callback)
        super().__init__(node, srv_type, endpoint, qos_profile, callback_group)
        self.callback = callback
        # No request is lost, however many wait: each has a client that waits, too.
        self._queue = Queue(None)

    def deliver(self, request: Any) -> None:
        """Put a request into the queue: the client, its number, and the message."""
        if not self._destroyed and self._wants.takes_call(request):
            self._queue.put(request[:3])

    def has_work(self) -> bool:
        """Return whether a request waits."""
        return len(self._queue) > 0 and not self._destroyed

    def take(self) -> Callable[[], Any]:
        """Take the oldest request."""
        client, number, request = self._queue.take()
        request = copy_of(request)
        if inspect.iscoroutinefunction(self.callback):

            async def awaits() -> None:
                self._introspection.tell("REQUEST_RECEIVED", client, number, request)
                response = await self.callback(request, self.srv_type.Response())
                self._answer(client, number, response)

            return awaits

        def answer() -> None:
            self._introspection.tell("REQUEST_RECEIVED", client, number, request)
            response = self.callback(request, self.srv_type.Response())
            self._answer(client, number, response)

        return answer

    def send_response(self, response: Any, header: tuple[str, int]) -> None:
        """Send a response to the request with that header."""
        self._answer(*header, response)

    def destroy(self) -> None:
        """Answer no more requests."""
        super().destroy()
        self._node._runtime.withdraw(self._request, self.deliver)

    def _answer(self, client: str, number: int, response: Any) -> None:
        if isinstance(response, Future):
            # Of an action: its result comes later, and other callbacks of the group before it.
            response.add_done_callback(lambda it: self._answer(client, number, it.result()))
            return
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
        self._introspection.tell("RESPONSE_SENT", client, number, response)
        call = self._offer.of_call(client, number, copy_of(response))
        self._node._runtime.publish(self._response, call)
