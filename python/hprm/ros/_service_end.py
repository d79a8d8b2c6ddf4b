"""What services and clients have in common: the service, its flows, and what they tell of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hprm.ros._entity import Entity
from hprm.ros._graph import Flow
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.service_introspection import Introspection, ServiceIntrospectionState

if TYPE_CHECKING:
    from hprm.ros.clock import Clock
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile


class ServiceEnd(Entity):
    """One end of a service: what answers requests, or what sends them."""

    def __init__(
        self,
        node: Node,
        srv_type: type[Any],
        srv_name: str,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup,
    ) -> None:
        """Make an end for a node; ``srv_name`` is the full name of the service."""
        super().__init__(node, callback_group)
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.service_name = srv_name
        self.qos_profile = qos_profile
        self._request = Flow("request", srv_name)
        self._response = Flow("response", srv_name)
        self._introspection = Introspection(node, srv_type, srv_name)

    def configure_introspection(
        self,
        clock: Clock,
        service_event_qos_profile: QoSProfile,
        introspection_state: ServiceIntrospectionState,
    ) -> None:
        """Tell of requests and responses that this end sends and receives, or no more of them."""
        self._introspection.configure(clock, service_event_qos_profile, introspection_state)

    def destroy(self) -> None:
        """Have no callbacks any more, and tell nothing."""
        super().destroy()
        self._introspection.end()
