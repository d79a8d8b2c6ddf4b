"""Publishing where moving frames are, on the topic ``/tf``."""

from __future__ import annotations

from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros.qos import QoSProfile


def as_list(transform: Any) -> list[Any]:
    """Return one transform or several ones as a list."""
    return list(transform) if hasattr(transform, "__iter__") else [transform]


class TransformBroadcaster:
    """A publisher of transforms of frames that move.

    Parameters
    ----------
    node
        The node that publishes.
    qos
        A profile or a depth; it is reliable with a depth of 100 if it is not given.

    """

    def __init__(self, node: Any, qos: QoSProfile | int | None = None) -> None:
        """Make the publisher."""
        self._message = interface("tf2_msgs.msg", "TFMessage")
        profile = QoSProfile(depth=100) if qos is None else qos
        self.pub_tf = node.create_publisher(self._message, "/tf", profile)

    def sendTransform(self, transform: Any) -> None:
        """Publish a ``TransformStamped``, or several ones in one message."""
        self.pub_tf.publish(self._message(transforms=as_list(transform)))
