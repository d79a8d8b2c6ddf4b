"""`multiprocessing.shared_memory`: pickled in band into a new segment for each message.

A Unix socket carries the segment's name. A writer unlinks a segment when it writes the next one, so
this cannot send messages one after the other that nobody answers.
"""

from __future__ import annotations

import pickle
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from typing import Any

from session import Session

from transports.unix_pickle import Link, accept, connect

# The tracker of every process would unlink at its exit what others use, and complain.
resource_tracker.register = lambda *_: None
resource_tracker.unregister = lambda *_: None


class Writer:
    """Makes a segment for each message."""

    def __init__(self, prefix: str) -> None:
        """Names its segments after the prefix."""
        self._prefix = prefix
        self._count = 0
        self._last: SharedMemory | None = None

    def write(self, message: Any) -> bytes:
        """What the readers are told."""
        pickled = pickle.dumps(message, protocol=5)
        self.clear()
        self._count += 1
        name = f"{self._prefix}-{self._count}"
        self._last = SharedMemory(name=name, create=True, size=len(pickled))
        self._last.buf[: len(pickled)] = pickled
        return f"{name} {len(pickled)}".encode()

    def clear(self) -> None:
        """Removes the segment of the last message."""
        if self._last is not None:
            self._last.close()
            self._last.unlink()
            self._last = None


def read(said: bytes) -> Any:
    """What a writer has written."""
    name, length = said.decode().split()
    segment = SharedMemory(name=name)
    try:
        return pickle.loads(bytes(segment.buf[: int(length)]))
    finally:
        segment.close()


class Hub:
    """Writes one segment for all nodes."""

    def __init__(self, session: Session) -> None:
        """Waits for the nodes."""
        self._links: list[Link] = accept(session)
        self._writer = Writer(f"{session.name}-hub")

    def send(self, message: Any) -> None:
        """To every node."""
        said = self._writer.write(message)
        for link in self._links:
            link.send(said)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [read(link.receive()) for link in self._links]

    def close(self) -> None:
        """Waits until every node has read the last message, and removes it."""
        for link in self._links:
            link.receive()
            link.close()
        self._writer.clear()


class Node:
    """Writes a segment for each reply."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        self._link = connect(session, index)
        self._writer = Writer(f"{session.name}-{index}")

    def receive(self) -> Any:
        """The next message."""
        return read(self._link.receive())

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._link.send(self._writer.write(message))

    def close(self) -> None:
        """Says that the last message is read, and removes the last reply."""
        self._link.send(b"done")
        self._link.close()
        self._writer.clear()
