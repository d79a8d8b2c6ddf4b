"""pyzmq over ipc: XPUB to all nodes, PUSH and PULL back, no limit on what waits."""

from __future__ import annotations

from typing import Any

import zmq
from session import Session


def _bind(context: zmq.Context, kind: int, path: str) -> zmq.Socket:
    socket = context.socket(kind)
    socket.set_hwm(0)
    socket.bind(f"ipc://{path}")
    return socket


def _connect(context: zmq.Context, kind: int, path: str) -> zmq.Socket:
    socket = context.socket(kind)
    socket.set_hwm(0)
    if kind == zmq.SUB:
        socket.subscribe(b"")
    socket.connect(f"ipc://{path}")
    return socket


class Hub:
    """Publishes, and pulls the replies of each node from a socket of its own."""

    def __init__(self, session: Session) -> None:
        """Waits until all nodes have subscribed."""
        self._context = zmq.Context()
        self._pulls = [
            _bind(self._context, zmq.PULL, session.path(f"up-{index}"))
            for index in range(session.nodes)
        ]
        self._publisher = self._context.socket(zmq.XPUB)
        self._publisher.setsockopt(zmq.XPUB_VERBOSE, 1)
        self._publisher.set_hwm(0)
        self._publisher.bind(f"ipc://{session.path('down')}")
        for _ in range(session.nodes):
            self._publisher.recv()

    def send(self, message: Any) -> None:
        """To every node."""
        self._publisher.send(message, copy=len(memoryview(message).cast("B")) < 65_536)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [pull.recv(copy=False).buffer for pull in self._pulls]

    def close(self) -> None:
        """Lets the last message go and ends."""
        self._context.destroy(linger=500)


class Node:
    """Subscribes, and pushes its replies."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        self._context = zmq.Context()
        self._push = _connect(self._context, zmq.PUSH, session.path(f"up-{index}"))
        self._subscriber = _connect(self._context, zmq.SUB, session.path("down"))

    def receive(self) -> Any:
        """The next message."""
        return self._subscriber.recv(copy=False).buffer

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._push.send(message, copy=len(memoryview(message).cast("B")) < 65_536)

    def close(self) -> None:
        """Lets the last reply go and ends."""
        self._context.destroy(linger=500)
