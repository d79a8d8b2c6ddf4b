"""ROS 2 by rclpy: a node for each program and a topic for each edge, with queues of ten."""

from __future__ import annotations

from typing import Any

from session import Session
from transports.ros2 import End

from edges import arriving, leaving


class Ends:
    """A publisher for each edge that leaves, a subscription for each that arrives."""

    def __init__(self, session: Session, role: str) -> None:
        """Waits until all that it publishes is read."""
        self._end = End(session, role)
        for edge in arriving(role):
            self._end.read_from(edge)
        for edge in leaving(role):
            self._end.publish_on(edge)
        for edge in leaving(role):
            self._end.wait_for_readers(edge, 1)

    def send(self, edge: str, message: Any) -> None:
        """Publishes."""
        self._end.write(edge, message)

    def receive(self, edge: str) -> Any:
        """Spins until there is a message."""
        return self._end.read(edge)

    def close(self) -> None:
        """Ends."""
        self._end.close()
