"""dora-rs: each program is a node of one dataflow.

Pixels are an Arrow array, which its reader sees without a copy; the rest of a message is pickled
into an array of its own, on an output of its own.
"""

from __future__ import annotations

import pickle
import time
from collections import deque
from typing import Any

import numpy as np
import pyarrow as pa
from autopilot.simulator import BIRDVIEW, PICTURE
from dora import Node
from session import Session

from edges import joined, parted

_PIXELS = {"picture": PICTURE, "birdview": BIRDVIEW}


class Ends:
    """The node of this process. Its inputs exist from the start."""

    def __init__(self, session: Session, role: str) -> None:
        """Meets the daemon, which starts all nodes together."""
        self._node = Node()
        self._came: dict[str, deque[Any]] = {}

    def send(self, edge: str, message: Any) -> None:
        """Sends the pixels, if there are any, and the rest."""
        pixels, rest = parted(message)
        if pixels is not None:
            self._send(f"{edge}_pixels", pixels)
        self._send(edge, pickle.dumps(rest, protocol=5))

    def receive(self, edge: str) -> Any:
        """The next message: its rest has come after its pixels."""
        rest = pickle.loads(self._next(edge).tobytes())
        if rest is None or edge not in _PIXELS:
            return rest
        return joined(self._next(f"{edge}_pixels").reshape(_PIXELS[edge]), rest)

    def close(self) -> None:
        """Gives the neighbours time to take the last messages."""
        time.sleep(0.3)

    def _send(self, output: str, data: Any) -> None:
        buffer = pa.py_buffer(data)
        array = pa.Array.from_buffers(pa.uint8(), buffer.size, [None, buffer])
        self._node.send_output(output, array)

    def _next(self, name: str) -> np.ndarray:
        waiting = self._came.setdefault(name, deque())
        while not waiting:
            event = self._node.next(timeout=60.0)
            if event is None or event["type"] == "ERROR":
                raise ConnectionError(f"the dataflow has ended: {event}")
            if event["type"] == "INPUT":
                self._came.setdefault(event["id"], deque()).append(event["value"])
        return waiting.popleft().to_numpy(zero_copy_only=True)
