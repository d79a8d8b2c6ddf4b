"""Waiting for one message, as ``rclpy.wait_for_message``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.qos import QoSProfile

if TYPE_CHECKING:
    from hprm.ros.node import Node


class _Untouched(CallbackGroup):
    """No executor takes the message: the thread that waits for it does."""

    def can_execute(self, entity: Any) -> bool:
        """Return that no callback may begin."""
        return False


def wait_for_message(
    msg_type: type[Any],
    node: Node,
    topic: str,
    *,
    qos_profile: QoSProfile | int = 1,
    time_to_wait: float = -1,
) -> tuple[bool, Any]:
    """Wait for the next message of a topic, no longer than so many seconds if that is positive.

    Returns
    -------
    tuple
        Whether one has come, and the message.

    """
    subscription = node.create_subscription(
        msg_type, topic, lambda _: None, qos_profile, callback_group=_Untouched()
    )
    try:
        timeout_ns = round(time_to_wait * 1e9) if time_to_wait >= 0 else None
        context = node.context
        node._runtime.block(lambda: subscription.has_work() or not context.ok(), timeout_ns)
        return (True, subscription._taken()) if subscription.has_work() else (False, None)
    finally:
        node.destroy_subscription(subscription)
