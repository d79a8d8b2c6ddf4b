"""Stream sockets of Unix, one for each edge; messages pickled in band, with protocol 5."""

from __future__ import annotations

import pickle
import socket
from pathlib import Path
from typing import Any

from session import Session, until
from transports.unix_pickle import Link

from edges import arriving, leaving


class Ends:
    """Listens for the edges that arrive, connects those that leave."""

    def __init__(self, session: Session, role: str) -> None:
        """Waits for the neighbours."""
        listeners = {}
        for edge in arriving(role):
            listeners[edge] = socket.socket(socket.AF_UNIX)
            listeners[edge].bind(session.path(edge))
            listeners[edge].listen(1)
        self._links = {edge: Link(_connected(session.path(edge))) for edge in leaving(role)}
        for edge, listener in listeners.items():
            with listener:
                self._links[edge] = Link(listener.accept()[0])

    def send(self, edge: str, message: Any) -> None:
        """Pickles and writes."""
        self._links[edge].send(pickle.dumps(message, protocol=5))

    def receive(self, edge: str) -> Any:
        """Reads and unpickles."""
        return pickle.loads(self._links[edge].receive())

    def close(self) -> None:
        """Ends the links."""
        for link in self._links.values():
            link.close()


def _connected(path: str) -> socket.socket:
    def attempt() -> socket.socket | None:
        sock = socket.socket(socket.AF_UNIX)
        try:
            sock.connect(path)
        except (FileNotFoundError, ConnectionRefusedError):
            sock.close()
            return None
        return sock

    return until(f"the socket {Path(path).name}", attempt)
