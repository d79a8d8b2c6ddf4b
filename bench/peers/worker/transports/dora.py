"""dora-rs: each process is a node of one dataflow, and messages are Arrow arrays of bytes.

`dora run` starts the processes from the description that `dataflow` writes.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Any

import numpy as np
import pyarrow as pa
from dora import Node as DoraNode
from session import Session


class End:
    """A node of the dataflow: the one that runs in this process."""

    def __init__(self) -> None:
        """Meets the daemon, which starts all nodes together."""
        self._node = DoraNode()
        self._waiting: dict[str, deque[Any]] = {}

    def write(self, message: Any, output: str = "data") -> None:
        """Sends bytes on one of its outputs."""
        data = pa.py_buffer(message)
        array = pa.Array.from_buffers(pa.uint8(), data.size, [None, data])
        self._node.send_output(output, array)

    def read(self, source: str) -> Any:
        """The next bytes of one of its inputs."""
        waiting = self._waiting.setdefault(source, deque())
        while not waiting:
            event = self._node.next(timeout=60.0)
            if event is None or event["type"] == "ERROR":
                raise ConnectionError(f"the dataflow has ended: {event}")
            if event["type"] == "INPUT":
                self._waiting.setdefault(event["id"], deque()).append(event["value"])
        return waiting.popleft().to_numpy(zero_copy_only=True)


class Hub:
    """One output to all nodes, an input from each."""

    def __init__(self, session: Session) -> None:
        """Waits until every node has said that it is there."""
        self._end = End()
        self._sources = [f"node{index}" for index in range(session.nodes)]
        for source in self._sources:
            self._end.read(source)

    def send(self, message: Any) -> None:
        """To every node."""
        self._end.write(message)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [self._end.read(source) for source in self._sources]

    def close(self) -> None:
        """Gives the nodes time to take the last message."""
        time.sleep(0.2)


class Node:
    """An input from the hub, and an output to it."""

    def __init__(self, session: Session, index: int) -> None:
        """Tells the hub that it is there; its inputs exist from the start."""
        self._end = End()
        self._end.write(np.zeros(16, np.uint8))

    def receive(self) -> Any:
        """The next message."""
        return self._end.read("hub")

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._end.write(message)

    def close(self) -> None:
        """Nothing is left to do."""
