"""ROS 2 by rclpy: a node for each process, `sensor_msgs/Image`, and queues of ten, its default.

The option `form` says what becomes of a message. Without it, `data` is assigned what pickle makes,
as in the paper: rclpy checks each byte of that. `array` assigns the same as an array, which it does
not check. `shm` pickles into shared memory, and sends the name of the segment.
"""

from __future__ import annotations

import array
import os
import pickle
import time
from collections import deque
from typing import Any

from session import Session, until

_QUEUE = 10


class End:
    """A node of ROS 2, which publishes and reads on topics that carry Python objects."""

    def __init__(self, session: Session, name: str) -> None:
        """Starts rclpy in a domain of the session's own, on this machine only."""
        os.environ["ROS_DOMAIN_ID"] = str(session.option("domain", 0))
        os.environ["ROS_LOCALHOST_ONLY"] = "1"
        # Only now: rclpy reads the environment.
        import rclpy
        from rclpy.node import Node as RosNode
        from sensor_msgs.msg import Image

        self._rclpy, self._image = rclpy, Image
        rclpy.init()
        self._node = RosNode(name)
        self._publishers: dict[str, Any] = {}
        self._came: dict[str, deque[Any]] = {}
        self._form = session.option("form", "")
        self._segments: dict[str, Any] = {}
        self._prefix = f"{session.name}-{name}"

    def publish_on(self, topic: str) -> None:
        """Has a publisher of a topic."""
        self._publishers[topic] = self._node.create_publisher(self._image, topic, _QUEUE)

    def read_from(self, topic: str) -> None:
        """Has a subscription to a topic."""
        came = self._came[topic] = deque()
        self._node.create_subscription(
            self._image, topic, lambda message: came.append(self._object(message)), _QUEUE
        )

    def wait_for_readers(self, topic: str, count: int) -> None:
        """Returns once there are as many subscriptions to a topic."""
        publisher = self._publishers[topic]
        until(f"readers of {topic}", lambda: publisher.get_subscription_count() >= count)

    def write(self, topic: str, value: Any) -> None:
        """Publishes an object."""
        message = self._image()
        if self._form == "shm":
            message.data = pickle.dumps(self._segment(topic).write(value))
        elif self._form == "array":
            message.data = array.array("B", pickle.dumps(value, protocol=5))
        else:
            message.data = pickle.dumps(value)
        self._publishers[topic].publish(message)

    def read(self, topic: str) -> Any:
        """The next object of a topic."""
        while not self._came[topic]:
            self._rclpy.spin_once(self._node)
        return self._came[topic].popleft()

    def close(self) -> None:
        """Lets the last messages go and ends."""
        time.sleep(0.2)
        for segment in self._segments.values():
            segment.clear()
        self._node.destroy_node()
        self._rclpy.shutdown()

    def _segment(self, topic: str) -> Any:
        from transports.shm_pickle import Writer

        return self._segments.setdefault(topic, Writer(f"{self._prefix}-{topic}"))

    def _object(self, message: Any) -> Any:
        if self._form != "shm":
            return pickle.loads(message.data)
        from transports.shm_pickle import read

        return read(pickle.loads(message.data))


class Hub:
    """Publishes to all nodes, reads from each."""

    def __init__(self, session: Session) -> None:
        """Waits until every node has said that it is there."""
        self._end = End(session, "hub")
        self._ways = [f"up{index}" for index in range(session.nodes)]
        for way in self._ways:
            self._end.read_from(way)
        self._end.publish_on("down")
        for way in self._ways:
            self._end.read(way)
        self._end.wait_for_readers("down", session.nodes)

    def send(self, message: Any) -> None:
        """To every node."""
        self._end.write("down", message)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [self._end.read(way) for way in self._ways]

    def close(self) -> None:
        """Ends."""
        self._end.close()


class Node:
    """Reads what the hub publishes, and publishes its replies."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        self._end = End(session, f"node{index}")
        self._way = f"up{index}"
        self._end.read_from("down")
        self._end.publish_on(self._way)
        self._end.wait_for_readers(self._way, 1)
        self._end.write(self._way, b"here")

    def receive(self) -> Any:
        """The next message."""
        return self._end.read("down")

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._end.write(self._way, message)

    def close(self) -> None:
        """Ends."""
        self._end.close()
