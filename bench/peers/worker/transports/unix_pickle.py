"""Stream sockets of Unix, with objects pickled in band (protocol 5): what Python brings along."""

from __future__ import annotations

import pickle
import socket
import struct
from typing import Any

from session import Session, until

_LENGTH = struct.Struct("<Q")


class Link:
    """One end of a socket that carries byte strings after their lengths."""

    def __init__(self, sock: socket.socket) -> None:
        """Takes over a connected socket."""
        self._sock = sock
        self._length = bytearray(_LENGTH.size)

    def send(self, data: Any) -> None:
        """Sends one byte string."""
        length = _LENGTH.pack(len(data))
        if len(data) <= 65_536:
            self._sock.sendall(length + data)
        else:
            self._sock.sendall(length)
            self._sock.sendall(data)

    def receive(self) -> bytearray:
        """The next byte string."""
        self._fill(memoryview(self._length))
        data = bytearray(_LENGTH.unpack(self._length)[0])
        self._fill(memoryview(data))
        return data

    def close(self) -> None:
        """Closes the socket."""
        self._sock.close()

    def _fill(self, view: memoryview) -> None:
        received = 0
        while received < len(view):
            count = self._sock.recv_into(view[received:])
            if count == 0:
                raise ConnectionError("the other side closed in the middle of a session")
            received += count


def accept(session: Session) -> list[Link]:
    """The hub's links to all nodes, in their order."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(session.path("hub"))
        listener.listen(session.nodes)
        links: dict[int, Link] = {}
        for _ in range(session.nodes):
            link = Link(listener.accept()[0])
            links[link.receive()[0]] = link
    return [links[index] for index in range(session.nodes)]


def connect(session: Session, index: int) -> Link:
    """A node's link to the hub."""

    def attempt() -> socket.socket | None:
        sock = socket.socket(socket.AF_UNIX)
        try:
            sock.connect(session.path("hub"))
        except (FileNotFoundError, ConnectionRefusedError):
            sock.close()
            return None
        return sock

    link = Link(until("the hub's socket", attempt))
    link.send(bytes([index]))
    return link


class Hub:
    """Pickles once and sends to every node."""

    def __init__(self, session: Session) -> None:
        """Waits for the nodes."""
        self._links = accept(session)

    def send(self, message: Any) -> None:
        """To every node."""
        pickled = pickle.dumps(message, protocol=5)
        for link in self._links:
            link.send(pickled)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [pickle.loads(link.receive()) for link in self._links]

    def close(self) -> None:
        """Ends the links."""
        for link in self._links:
            link.close()


class Node:
    """Unpickles, and pickles its reply."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        self._link = connect(session, index)

    def receive(self) -> Any:
        """The next message."""
        return pickle.loads(self._link.receive())

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._link.send(pickle.dumps(message, protocol=5))

    def close(self) -> None:
        """Ends the link."""
        self._link.close()
