"""What is known of an endpoint of a topic, as ``rclpy.topic_endpoint_info``."""

from __future__ import annotations

import hashlib
from enum import IntEnum
from typing import Any

from hprm.ros._graph import Endpoint
from hprm.ros.duration import Duration
from hprm.ros.qos import (
    _UNSPECIFIED,
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)


class TopicEndpointTypeEnum(IntEnum):
    """Whether an endpoint publishes or subscribes."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2


class TopicEndpointInfo:
    """A publisher or a subscription of any node."""

    def __init__(self, **facts: Any) -> None:
        """Take what is known."""
        self.node_name: str = facts.get("node_name", "")
        self.node_namespace: str = facts.get("node_namespace", "")
        self.topic_type: str = facts.get("topic_type", "")
        self.endpoint_type: TopicEndpointTypeEnum = facts.get(
            "endpoint_type", TopicEndpointTypeEnum.INVALID
        )
        self.endpoint_gid: list[int] = facts.get("endpoint_gid", [])
        self.qos_profile: QoSProfile = facts.get("qos_profile", QoSProfile(depth=10))

    @classmethod
    def of(cls, endpoint: Endpoint, number: int) -> TopicEndpointInfo:
        """Tell of an endpoint, the ``number``-th one of its topic."""
        namespace, _, name = endpoint.node.rpartition("/")
        is_publisher = endpoint.kind == "publisher"
        told = f"{endpoint.kind} {number} {endpoint.node} {endpoint.name}"
        return cls(
            node_name=name,
            node_namespace=namespace or "/",
            topic_type=endpoint.type,
            endpoint_type=TopicEndpointTypeEnum(1 if is_publisher else 2),
            endpoint_gid=list(hashlib.sha256(told.encode()).digest()[:16]),
            qos_profile=_profile(endpoint.qos),
        )

    def __str__(self) -> str:
        """Return what ``ros2 topic info --verbose`` shows."""
        gid = ".".join(f"{it:02x}" for it in self.endpoint_gid)
        qos = self.qos_profile
        return "\n".join(
            (
                f"Node name: {self.node_name}",
                f"Node namespace: {self.node_namespace}",
                f"Topic type: {self.topic_type}",
                f"Endpoint type: {self.endpoint_type.name}",
                f"GID: {gid}",
                "QoS profile:",
                f"  Reliability: {qos.reliability.name}",
                f"  History (Depth): {qos.history.name} ({qos.depth})",
                f"  Durability: {qos.durability.name}",
                f"  Lifespan: {_shown(qos.lifespan)}",
                f"  Deadline: {_shown(qos.deadline)}",
                f"  Liveliness: {qos.liveliness.name}",
                f"  Liveliness lease duration: {_shown(qos.liveliness_lease_duration)}",
            )
        )


def _profile(known: dict[str, Any]) -> QoSProfile:
    depth = known.get("depth")
    keeps = {"history": HistoryPolicy.KEEP_ALL} if depth is None else {"depth": depth}
    profile = QoSProfile(
        reliability=ReliabilityPolicy[known.get("reliability", "UNKNOWN")],
        durability=DurabilityPolicy[known.get("durability", "UNKNOWN")],
        liveliness=LivelinessPolicy[known.get("liveliness", "SYSTEM_DEFAULT")],
        **keeps,
    )
    for policy in ("deadline", "lifespan", "liveliness_lease_duration"):
        setattr(profile, policy, Duration(nanoseconds=known.get(policy, 0)))
    return profile


def _shown(duration: Any) -> str:
    return "Infinite" if duration == _UNSPECIFIED else f"{duration.nanoseconds} nanoseconds"
