"""Clients of services, as ``rclpy.client``."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm.ros._interface import copy_of
from hprm.ros._service_end import ServiceEnd
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.task import Future

if TYPE_CHECKING:
    from hprm.ros._graph import Endpoint
    from hprm.ros.context import Context
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile

_numbers = itertools.count(1)


class Client(ServiceEnd):
    """Sends requests to a service."""

    order = 3

    def __init__(
        self,
        node: Node,
        context: Context,
        srv_type: type[Any],
        endpoint: Endpoint,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup,
    ) -> None:
        """Make the client of a node that is an endpoint of a service."""
        super().__init__(node, srv_type, endpoint, qos_profile, callback_group)
        self.context = context
        #: By which responses find this client, the same on every run.
        self._name = f"{node.get_fully_qualified_name()}#{next(_numbers)}"
        self._count = 0
        self._pending: dict[int, Future[Any]] = {}
        self._arrived: deque[tuple[int, Any]] = deque()

    def call_async(self, request: Any) -> Future[Any]:
        """Send a request, and return the future of its response.

        Raises
        ------
        TypeError
            If it is no request of this service.

        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        self._count += 1
        future: Future[Any] = Future()
        future._set_executor(self._node.executor)
        self._pending[self._count] = future
        self._introspection.tell("REQUEST_SENT", self._name, self._count, request)
        call = self._offer.of_call(self._name, self._count, copy_of(request))
        self._node._runtime.publish(self._request, call)
        return future

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request, and wait for the response while another thread spins.

        Raises
        ------
        RuntimeError
            If only this thread could take the response.
        TimeoutError
            If the response does not come in time.

        """
        if self._node._is_spun_by_this_thread():
            raise RuntimeError(
                f"call() of the service {self.srv_name} would wait forever: the response is taken"
                " by the thread that spins, which is this one\n"
                "  hint: use call_async(), or a MultiThreadedExecutor with callback groups"
            )
        future = self.call_async(request)
        timeout_ns = None if timeout_sec is None else round(timeout_sec * 1e9)
        self._node._runtime.block(lambda: future.done() or not self.context.ok(), timeout_ns)
        if not future.done() and timeout_sec is not None and self.context.ok():
            raise TimeoutError
        return future.result()

    def remove_pending_request(self, future: Future[Any]) -> None:
        """Wait for the response of a request no more."""
        self._pending = {key: it for key, it in self._pending.items() if it is not future}

    def service_is_ready(self) -> bool:
        """Return whether a node serves the service."""
        return self._node._runtime.serves(self._endpoint)

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until a node serves the service, or for so long; return whether one does."""
        return self._node._runtime.wait_for_service(
            self._endpoint, None if timeout_sec is None else round(timeout_sec * 1e9)
        )

    def deliver(self, response: Any) -> None:
        """Take a response: of which client it is, its number, and the message."""
        client, number, message = response[:3]
        is_own = client == self._name and number in self._pending and not self._destroyed
        if is_own and self._wants.takes_call(response):
            self._arrived.append((number, message))

    def has_work(self) -> bool:
        """Return whether a response waits."""
        return bool(self._arrived) and not self._destroyed

    def take(self) -> Callable[[], Any]:
        """Take the oldest response."""
        number, message = self._arrived.popleft()
        future = self._pending.pop(number, None)

        def complete() -> None:
            self._introspection.tell("RESPONSE_RECEIVED", self._name, number, message)
            if future is not None and not future.done():
                # The node may have another executor than when it has sent the request.
                future._set_executor(self._node.executor)
                future.set_result(copy_of(message))

        return complete

    def destroy(self) -> None:
        """Take no more responses."""
        super().destroy()
        self._node._runtime.withdraw(self._response, self.deliver)
