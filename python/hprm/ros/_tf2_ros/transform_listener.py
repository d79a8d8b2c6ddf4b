"""Filling a buffer with the transforms of the topics ``/tf`` and ``/tf_static``."""

from __future__ import annotations

import threading
from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros.callback_groups import ReentrantCallbackGroup
from hprm.ros.executors import SingleThreadedExecutor
from hprm.ros.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

#: Where transforms of frames that move are published.
DEFAULT_TF_TOPIC = "/tf"
#: Where transforms of frames that do not move are published.
DEFAULT_STATIC_TF_TOPIC = "/tf_static"

_AUTHORITY = "default_authority"


class TransformListener:
    """The subscriptions that fill a buffer.

    Parameters
    ----------
    buffer
        The buffer that is filled.
    node
        The node that subscribes.
    spin_thread
        Whether a thread of its own runs the node.
    qos
        A profile or a depth for ``/tf``.
    static_qos
        A profile or a depth for ``/tf_static``.
    tf_topic
        The topic of frames that move, instead of ``/tf``.
    tf_static_topic
        The topic of frames that do not, instead of ``/tf_static``.

    """

    def __init__(
        self,
        buffer: Any,
        node: Any,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int | None = None,
        static_qos: QoSProfile | int | None = None,
        tf_topic: str = DEFAULT_TF_TOPIC,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
    ) -> None:
        """Subscribe."""
        self.buffer = buffer
        self.node = node
        # A callback that waits for a transform does not hold up these.
        self.group = ReentrantCallbackGroup()
        kind = interface("tf2_msgs.msg", "TFMessage")
        self.tf_sub = node.create_subscription(
            kind,
            tf_topic,
            self.callback,
            _profile(DurabilityPolicy.VOLATILE) if qos is None else qos,
            callback_group=self.group,
        )
        self.tf_static_sub = node.create_subscription(
            kind,
            tf_static_topic,
            self.static_callback,
            _profile(DurabilityPolicy.TRANSIENT_LOCAL) if static_qos is None else static_qos,
            callback_group=self.group,
        )
        self.executor: Any = None
        if spin_thread:
            self._spin()

    def _spin(self) -> None:
        self.executor = SingleThreadedExecutor()

        def run() -> None:
            self.executor.add_node(self.node)
            self.executor.spin()
            self.executor.remove_node(self.node)

        self.dedicated_listener_thread = threading.Thread(target=run, daemon=True)
        self.dedicated_listener_thread.start()

    def unregister(self) -> None:
        """End the subscriptions, and the thread if there is one."""
        if self.executor is not None:
            self.executor.shutdown()
            self.dedicated_listener_thread.join()
            self.executor = None
        self.node.destroy_subscription(self.tf_sub)
        self.node.destroy_subscription(self.tf_static_sub)

    def callback(self, data: Any) -> None:
        """Add the transforms of a message of ``/tf``."""
        for transform in data.transforms:
            self.buffer.set_transform(transform, _AUTHORITY)

    def static_callback(self, data: Any) -> None:
        """Add the transforms of a message of ``/tf_static``."""
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, _AUTHORITY)


def _profile(durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(depth=100, durability=durability, history=HistoryPolicy.KEEP_LAST)
