"""Plasma of pyarrow 11: objects created, written, sealed; their ids travel through Unix sockets.

This is the way of the data in the paper's implementation without its coordinator and its pickle.
What is below 32 KB goes through the socket itself. A writer deletes its previous object when it
makes the next, since otherwise the store would hand out untouched memory until it is full: with the
option `keeps` it does not, as in the paper.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from pyarrow import plasma
from session import Session, until

from transports.unix_pickle import Link, accept, connect

_INLINE = 32_768


class _Store:
    """A connection to the store."""

    def __init__(self, session: Session) -> None:
        path = session.path("plasma")
        until("the store's socket", lambda: os.path.exists(path))
        self._client = plasma.connect(path)
        self._keeps = bool(session.option("keeps"))
        self._last: list[plasma.ObjectID] = []

    def write(self, message: Any) -> bytes:
        """What the readers are told."""
        data = np.frombuffer(message, np.uint8)
        if len(data) < _INLINE:
            return b"i" + data.tobytes()
        if self._last and not self._keeps:
            self._client.delete(self._last)
        ident = plasma.ObjectID.from_random()
        buffer = self._client.create(ident, len(data))
        np.copyto(np.frombuffer(buffer, np.uint8), data)
        self._client.seal(ident)
        self._last = [ident]
        return b"o" + ident.binary()

    def read(self, said: bytearray) -> Any:
        """What a writer has written."""
        if said[:1] == b"i":
            return memoryview(said)[1:]
        return self._client.get_buffers([plasma.ObjectID(bytes(said[1:]))])[0]


class Hub:
    """Writes one object for all nodes."""

    def __init__(self, session: Session) -> None:
        """Waits for the nodes."""
        self._links: list[Link] = accept(session)
        self._store = _Store(session)

    def send(self, message: Any) -> None:
        """To every node."""
        said = self._store.write(message)
        for link in self._links:
            link.send(said)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [self._store.read(link.receive()) for link in self._links]

    def close(self) -> None:
        """Ends the links."""
        for link in self._links:
            link.close()


class Node:
    """Writes an object for each reply."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        self._link = connect(session, index)
        self._store = _Store(session)

    def receive(self) -> Any:
        """The next message."""
        return self._store.read(self._link.receive())

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._link.send(self._store.write(message))

    def close(self) -> None:
        """Ends the link."""
        self._link.close()
