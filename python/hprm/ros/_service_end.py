"""What services and clients have in common: the service, its flows, and what they tell of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hprm.ros._entity import Entity
from hprm.ros._graph import Endpoint, Flow
from hprm.ros._offers import Offer, Request, misfits
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.qos import qos_policy_name_from_kind
from hprm.ros.service_introspection import Introspection, ServiceIntrospectionState

if TYPE_CHECKING:
    from hprm.ros.clock import Clock
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile

# In the words of those for topics: ROS 2 has none for services.
_WRONG_QOS = {
    "client": "New service discovered on '{}', with incompatible QoS. "
    "No responses will be received from it. Last incompatible policy: {}",
    "service": "New client discovered on service '{}', with incompatible QoS. "
    "No responses will be sent to it. Last incompatible policy: {}",
}


class ServiceEnd(Entity):
    """One end of a service: what answers requests, or what sends them."""

    def __init__(
        self,
        node: Node,
        srv_type: type[Any],
        endpoint: Endpoint,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup,
    ) -> None:
        """Make an end for a node, which is an endpoint of the service."""
        super().__init__(node, callback_group)
        self._endpoint = endpoint
        self._offer, self._wants = Offer(endpoint), Request(endpoint)
        #: How many ends there are on the other side with which it exchanges nothing.
        self._misfits = 0
        srv_name = endpoint.name
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

    def watch(self) -> None:
        """Warn whenever there is a new end on the other side that does not fit."""
        self._node._runtime.on_graph(self._look)

    def _look(self) -> None:
        if self._destroyed:
            return
        policies = misfits(self._endpoint, self._node._runtime.endpoints())
        if len(policies) > self._misfits:
            # The last one is the newest one.
            policy = qos_policy_name_from_kind(policies[-1])
            warning = _WRONG_QOS[self._endpoint.kind].format(self.srv_name, policy)
            self._node.get_logger().warning(warning)
        self._misfits = len(policies)

    def destroy(self) -> None:
        """Have no callbacks any more, and tell nothing."""
        super().destroy()
        self._node._runtime.off_graph(self._look)
        self._introspection.end()
