"""Ports of this machine at which nothing listens."""

from __future__ import annotations

import socket


def free_ports(count: int) -> list[int]:
    """Return so many, all different."""
    listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [int(it.getsockname()[1]) for it in listeners]
    for it in listeners:
        it.close()
    return ports
