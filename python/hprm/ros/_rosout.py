"""The topic ``/rosout``: what the loggers of nodes write, as messages.

A message belongs to the node whose logger, or whose logger's child, has written it. What is written
before the start is told at the start.
"""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any

from hprm.ros._interfaces import interface
from hprm.ros._log_console import LogRecord, output
from hprm.ros._log_levels import SEPARATOR
from hprm.ros._telling import Telling
from hprm.ros.qos import DurabilityPolicy, QoSProfile

if TYPE_CHECKING:
    from hprm.ros.node import Node

#: How many messages are kept before the start, as in ROS 2 for subscriptions that come late.
_DEPTH = 1_000


class _Rosout:
    """The nodes of this process whose loggers tell what they write."""

    def __init__(self) -> None:
        self._nodes: dict[str, Telling] = {}
        self._early: deque[tuple[Telling, LogRecord]] = deque(maxlen=_DEPTH)

    def add(self, node: Node) -> None:
        """Tell what the logger of a node writes."""
        qos = QoSProfile(depth=_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        telling = Telling(node, "rcl_interfaces/msg/Log", "/rosout", qos)
        self._nodes[node.get_logger().name] = telling
        if self.take not in output.listeners:
            output.listeners.append(self.take)

    def remove(self, node: Node) -> None:
        """Tell no more."""
        self._nodes.pop(node.get_logger().name, None)

    def take(self, record: LogRecord) -> None:
        """Take a message that is written."""
        telling = self._of(record.name)
        if telling is None:
            return
        if telling.has_begun:
            telling.tell(partial(_message, record))
            return
        if not self._early:
            telling.at_start(self._tell_early)
        self._early.append((telling, record))

    def _of(self, name: str) -> Telling | None:
        """Find the node of a logger: that with its name, or the nearest one above."""
        while name and name not in self._nodes:
            name = name.rpartition(SEPARATOR)[0]
        return self._nodes.get(name)

    def _tell_early(self) -> None:
        while self._early:
            telling, record = self._early.popleft()
            telling.tell(partial(_message, record))


def _message(record: LogRecord) -> Any:
    sec, nanosec = divmod(record.time, 1_000_000_000)
    return interface("rcl_interfaces.msg", "Log")(
        stamp=interface("builtin_interfaces.msg", "Time")(sec=sec, nanosec=nanosec),
        level=record.severity.value,
        name=record.name,
        msg=record.message,
        file=record.file,
        function=record.function,
        line=record.line,
    )


#: Those of this process.
rosout = _Rosout()
