"""What services and clients tell of requests and responses, as ``rclpy.service_introspection``.

``configure_introspection`` of both takes the state. What is told goes to the topic of the service's
name and ``/_service_event``, with messages of the class ``Event`` of the service.
"""

from __future__ import annotations

import hashlib
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from hprm.ros._interface import copy_of

if TYPE_CHECKING:
    from hprm.ros.clock import Clock
    from hprm.ros.node import Node
    from hprm.ros.publisher import Publisher
    from hprm.ros.qos import QoSProfile

__all__ = ["ServiceIntrospectionState"]


class ServiceIntrospectionState(IntEnum):
    """How much is told: nothing, that something happens, or the messages, too."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class Introspection:
    """The events of one service or client of a node: nothing, until it is configured."""

    def __init__(self, node: Node, srv_type: type[Any], srv_name: str) -> None:
        """Tell nothing yet; ``srv_name`` is the full name of the service."""
        self._node = node
        self._type = srv_type
        self._topic = f"{srv_name}/_service_event"
        self._state = ServiceIntrospectionState.OFF
        self._clock: Clock | None = None
        self._publisher: Publisher[Any] | None = None

    def configure(
        self, clock: Clock, profile: QoSProfile, state: ServiceIntrospectionState
    ) -> None:
        """Tell so much from now on, with the times of that clock."""
        self._state = ServiceIntrospectionState(state)
        self._clock = clock
        self.end()
        if self._state is not ServiceIntrospectionState.OFF:
            self._publisher = self._node.create_publisher(self._type.Event, self._topic, profile)

    def tell(self, what: str, client: str, number: int, message: Any) -> None:
        """Tell of one message: ``REQUEST_SENT`` and so on, which client sent it, and its number."""
        if self._publisher is None or self._clock is None:
            return
        event = self._type.Event()
        info = event.info
        info.event_type = getattr(info, what)
        info.stamp = self._clock.now().to_msg()
        # A middleware of ROS makes such a number; this one is the same on every run.
        info.client_gid = list(hashlib.sha256(client.encode()).digest()[:16])
        info.sequence_number = number
        if self._state is ServiceIntrospectionState.CONTENTS:
            setattr(event, what.partition("_")[0].lower(), [copy_of(message)])
        self._publisher.publish(event)

    def end(self) -> None:
        """Have no topic any more."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
