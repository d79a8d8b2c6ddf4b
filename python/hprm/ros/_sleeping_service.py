"""Services of all nodes, which are made when they are asked first.

A node that nothing asks does not have to look at them, and imports no types for them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm.ros._entity import Entity
from hprm.ros._graph import Flow
from hprm.ros._interfaces import interface
from hprm.ros.service import Service

if TYPE_CHECKING:
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile


class _Awake(Service):
    """A service whose requests something else takes."""

    def destroy(self) -> None:
        """Answer no more requests."""
        Entity.destroy(self)


class SleepingService:
    """A service of ``rcl_interfaces`` that is made with its first request."""

    def __init__(
        self, node: Node, kind: str, name: str, answer: Callable[[Any, Any], Any], qos: QoSProfile
    ) -> None:
        """Declare the service ``name`` of a node; ``kind`` is the name of its type."""
        self._node = node
        self._kind = kind
        full_name = node.resolve_service_name(f"{node.get_name()}/{name}")
        self._answer = answer
        self._qos = qos
        self._service: Service | None = None
        type_ = f"rcl_interfaces/srv/{kind}"
        self._endpoint = node._endpoint("service", full_name, type_, qos)
        node._runtime.declare(self._endpoint, self.deliver)

    def deliver(self, request: Any) -> None:
        """Put a request into the queue of the service."""
        if self._service is None:
            type_ = interface("rcl_interfaces.srv", self._kind)
            group = self._node.default_callback_group
            self._service = self._node._add(
                _Awake(self._node, type_, self._endpoint, self._answer, group, self._qos)
            )
        self._service.deliver(request)

    def destroy(self) -> None:
        """Take no more requests."""
        self._node._runtime.withdraw(Flow("request", self._endpoint.name), self.deliver)
