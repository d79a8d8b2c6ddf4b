"""Stands for rclpy: nodes publish to subscriptions of other processes through files of a folder.

It has what the benchmarks call, and queues without end. The folder is named by `ROS_STAND_IN`.
"""

from __future__ import annotations

import time
from typing import Any

from rclpy.node import Node

_LOOK_EVERY_S = 0.001


def init() -> None:
    """Nothing is to be done."""


def shutdown() -> None:
    """Nothing is to be done."""


def spin_once(node: Node) -> None:
    """Hands one message to its callback, once there is one."""
    while not node.take():
        time.sleep(_LOOK_EVERY_S)


__all__: list[Any] = ["init", "shutdown", "spin_once"]
