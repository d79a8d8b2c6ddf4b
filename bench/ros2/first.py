"""A node that says when its first callback runs, and ends."""

import contextlib
import time

import rclpy
from rclpy.executors import ExternalShutdownException


def first() -> None:
    """Say that it runs."""
    print(time.monotonic_ns(), flush=True)
    raise ExternalShutdownException


rclpy.init()
node = rclpy.create_node("first")
node.create_timer(0.001, first)
with contextlib.suppress(ExternalShutdownException):
    rclpy.spin(node)
