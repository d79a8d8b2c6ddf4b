"""dora-rs: each program is a node of one dataflow.

Pixels are an Arrow array, which its reader sees without a copy; the rest of a message is pickled
into an array of its own, on an output of its own.
"""

from __future__ import annotations

import pickle
import time
from typing import Any

from autopilot.simulator import BIRDVIEW, PICTURE
from session import Session
from transports.dora import End

from edges import joined, parted

_PIXELS = {"picture": PICTURE, "birdview": BIRDVIEW}


class Ends:
    """The node of this process. Its inputs exist from the start."""

    def __init__(self, session: Session, role: str) -> None:
        """Meets the daemon, which starts all nodes together."""
        self._end = End()

    def send(self, edge: str, message: Any) -> None:
        """Sends the pixels, if there are any, and the rest."""
        pixels, rest = parted(message)
        if pixels is not None:
            self._end.write(pixels, f"{edge}_pixels")
        self._end.write(pickle.dumps(rest, protocol=5), edge)

    def receive(self, edge: str) -> Any:
        """The next message: its rest has come after its pixels."""
        rest = pickle.loads(self._end.read(edge).tobytes())
        if rest is None or edge not in _PIXELS:
            return rest
        return joined(self._end.read(f"{edge}_pixels").reshape(_PIXELS[edge]), rest)

    def close(self) -> None:
        """Gives the neighbours time to take the last messages."""
        time.sleep(0.3)
