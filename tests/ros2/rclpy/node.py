"""Nodes: a subscription is a folder, and a message in its queue is a file."""

from __future__ import annotations

import itertools
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

_DEPTH = 10


class _Publisher:
    def __init__(self, topic: Path, name: str) -> None:
        self._topic, self._name, self._numbers = topic, name, itertools.count()

    def get_subscription_count(self) -> int:
        return len(list(self._topic.glob("*"))) if self._topic.exists() else 0

    def publish(self, message: Any) -> None:
        number = next(self._numbers)
        for queue in self._topic.glob("*"):
            unready = queue / f".{self._name}"
            unready.write_bytes(pickle.dumps(message))
            unready.rename(queue / f"{number:09}-{self._name}")


class Node:
    """A node with its publishers and subscriptions."""

    def __init__(self, name: str) -> None:
        """Has none yet."""
        domain = os.environ["ROS_DOMAIN_ID"]
        assert os.environ["ROS_LOCALHOST_ONLY"] == "1"
        self._folder = Path(os.environ["ROS_STAND_IN"], domain)
        self._name = name
        self._callbacks: dict[Path, Callable[[Any], None]] = {}

    def create_publisher(self, kind: type, topic: str, depth: int) -> _Publisher:
        """A publisher, which reaches all subscriptions of its topic."""
        assert depth == _DEPTH
        return _Publisher(self._folder / topic, self._name)

    def create_subscription(
        self, kind: type, topic: str, callback: Callable[[Any], None], depth: int
    ) -> None:
        """A subscription; `rclpy.spin_once` calls its callback."""
        assert depth == _DEPTH
        queue = self._folder / topic / self._name
        queue.mkdir(parents=True)
        self._callbacks[queue] = callback

    def take(self) -> bool:
        """Hands the first message of a queue on; whether there was one."""
        for queue, callback in self._callbacks.items():
            for file in sorted(it for it in queue.iterdir() if not it.name.startswith(".")):
                message = pickle.loads(file.read_bytes())
                file.unlink()
                callback(message)
                return True
        return False

    def destroy_node(self) -> None:
        """Nothing is to be done."""
