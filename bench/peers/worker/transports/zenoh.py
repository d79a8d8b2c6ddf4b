"""zenoh between peers over TCP on loopback, with or without its shared memory; nothing is dropped.

With shared memory a message is written into a buffer of the provider, which takes only `bytes`;
a reader gets `bytes` too, since the binding has no view of what arrived.
"""

from __future__ import annotations

import json
import socket
import time
from typing import Any

import zenoh
from session import Session, until

from transports import files

_SMALL = 4_096
_POOL = 400_000_000


def _port(session: Session) -> int:
    """A free port, which the hub finds and writes down."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    files.publish(session.path("port"), str(port))
    return port


def _open(session: Session, listen: int | None, connect: int | None) -> zenoh.Session:
    config = zenoh.Config()
    endpoint = [f"tcp/127.0.0.1:{listen or connect}"]
    settings = {
        "mode": "peer",
        "listen/endpoints": endpoint if listen else [],
        "connect/endpoints": endpoint if connect else [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": bool(session.option("shm")),
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class _Writer:
    def __init__(self, session: Session, link: zenoh.Session, key: str) -> None:
        self._publisher = link.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._provider = None
        if session.option("shm"):
            self._provider = zenoh.shm.ShmProvider.default_backend(_POOL)

    def wait_for_reader(self) -> None:
        until("a reader of zenoh", lambda: self._publisher.matching_status.matching)

    def write(self, message: Any) -> None:
        data = bytes(memoryview(message).cast("B"))
        if self._provider is None or len(data) < _SMALL:
            self._publisher.put(data)
            return
        buffer = self._provider.alloc(
            len(data), policy=zenoh.shm.BlockOn(zenoh.shm.GarbageCollect())
        )
        buffer[:] = data
        self._publisher.put(buffer)


def _reader(link: zenoh.Session, key: str) -> Any:
    return link.declare_subscriber(key, zenoh.handlers.FifoChannel(200_000))


class Hub:
    """One publisher for all nodes, a subscriber for each."""

    def __init__(self, session: Session) -> None:
        """Waits until every node has said that it is there, after it subscribed."""
        self._link = _open(session, listen=_port(session), connect=None)
        indices = range(session.nodes)
        self._readers = [_reader(self._link, f"bench/up/{index}") for index in indices]
        self._writer = _Writer(session, self._link, "bench/down")
        for reader in self._readers:
            until("a node of zenoh", reader.try_recv)
        self._writer.wait_for_reader()

    def send(self, message: Any) -> None:
        """To every node."""
        self._writer.write(message)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [reader.recv().payload.to_bytes() for reader in self._readers]

    def close(self) -> None:
        """Lets the last message go and ends."""
        time.sleep(0.2)
        self._link.close()


class Node:
    """A subscriber, and a publisher of replies."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        self._link = _open(session, listen=None, connect=int(files.wait(session.path("port"))))
        self._reader = _reader(self._link, "bench/down")
        self._writer = _Writer(session, self._link, f"bench/up/{index}")
        self._writer.wait_for_reader()
        self._writer.write(b"here")

    def receive(self) -> Any:
        """The next message."""
        return self._reader.recv().payload.to_bytes()

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._writer.write(message)

    def close(self) -> None:
        """Lets the last reply go and ends."""
        self._link.close()
