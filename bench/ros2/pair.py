"""Talker or listener as a program of rclpy: images with the time at which they were published."""

import contextlib
import sys
import time

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image

#: Queues that lose nothing.
QOS = QoSProfile(depth=1000)


class Talker(Node):
    """Publishes with a period."""

    def __init__(self, size: int, count: int, period: float) -> None:
        """Begin when there is a listener."""
        super().__init__("talker")
        self.size, self.left = size, count
        self.publisher = self.create_publisher(Image, "image", QOS)
        self.create_timer(period, self.tick)

    def tick(self) -> None:
        """Publish one image."""
        if not self.left:
            raise ExternalShutdownException
        self.left -= 1
        image = Image()
        image.data = np.empty(self.size, np.uint8)
        image.data[:8].view(np.int64)[0] = time.monotonic_ns()
        self.publisher.publish(image)


class Listener(Node):
    """Prints how long each image has taken, in nanoseconds."""

    def __init__(self, count: int) -> None:
        """Listen."""
        super().__init__("listener")
        self.took: list[int] = []
        self.count = count
        self.create_subscription(Image, "image", self.hear, QOS)

    def hear(self, image: Image) -> None:
        """Take one image."""
        now = time.monotonic_ns()
        self.took.append(now - int(image.data[:8].view(np.int64)[0]))
        if len(self.took) == self.count:
            print(*self.took, flush=True)
            raise ExternalShutdownException


def main() -> None:
    """Be the one or the other: role, size, count, period."""
    role, size, count, period = sys.argv[1], *map(int, sys.argv[2:4]), float(sys.argv[4])
    rclpy.init()
    with contextlib.suppress(ExternalShutdownException):
        rclpy.spin(Talker(size, count, period) if role == "talker" else Listener(count))


main()
