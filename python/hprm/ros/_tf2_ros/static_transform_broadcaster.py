"""Publishing where frames are that never move, on the topic ``/tf_static``."""

from __future__ import annotations

from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros._tf2_ros.transform_broadcaster import as_list
from hprm.ros.qos import DurabilityPolicy, HistoryPolicy, QoSProfile


class StaticTransformBroadcaster:
    """A publisher of transforms of frames that never move.

    Each message has all transforms that were sent so far, the latest one of each frame, so a
    listener that comes later needs only the last message, which it gets (transient local).

    Parameters
    ----------
    node
        The node that publishes.
    qos
        A profile or a depth.

    """

    def __init__(self, node: Any, qos: QoSProfile | int | None = None) -> None:
        """Make the publisher."""
        self._message = interface("tf2_msgs.msg", "TFMessage")
        if qos is None:
            qos = QoSProfile(
                depth=1,
                durability=DurabilityPolicy.TRANSIENT_LOCAL,
                history=HistoryPolicy.KEEP_LAST,
            )
        self.pub_tf = node.create_publisher(self._message, "/tf_static", qos)
        self._transforms: dict[str, Any] = {}

    def sendTransform(self, transform: Any) -> None:
        """Publish a ``TransformStamped``, or several ones, with those that were sent before."""
        for one in as_list(transform):
            self._transforms[one.child_frame_id] = one
        self.pub_tf.publish(self._message(transforms=list(self._transforms.values())))
