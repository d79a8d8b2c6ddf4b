"""A node with a timer and nothing else: prints which part of a processor it has taken."""

import contextlib
import sys
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class Idle(Node):
    """Calls back a number of times, after as many as warm it up."""

    def __init__(self, rate: float, count: int) -> None:
        """Begin."""
        super().__init__("idle")
        self.count, self.calls = count, 0
        self.create_timer(1 / rate, self.tick)

    def tick(self) -> None:
        """Do nothing, but in the middle and at the end."""
        self.calls += 1
        if self.calls == self.count:
            self.begun = time.process_time(), time.monotonic()
        if self.calls == 2 * self.count:
            used, passed = time.process_time() - self.begun[0], time.monotonic() - self.begun[1]
            print(used / passed, flush=True)
            raise ExternalShutdownException


rclpy.init()
with contextlib.suppress(ExternalShutdownException):
    rclpy.spin(Idle(float(sys.argv[1]), int(sys.argv[2])))
