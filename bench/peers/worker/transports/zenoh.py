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


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def open_session(session: Session, listen: list[int], connect: list[int]) -> zenoh.Session:
    """A peer that listens at these ports of this machine, and connects to those."""
    config = zenoh.Config()
    settings = {
        "mode": "peer",
        "listen/endpoints": [f"tcp/127.0.0.1:{port}" for port in listen],
        "connect/endpoints": [f"tcp/127.0.0.1:{port}" for port in connect],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": bool(session.option("shm")),
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class Writer:
    """A publisher, which writes into shared memory if the session asks for that."""

    def __init__(self, session: Session, link: zenoh.Session, key: str) -> None:
        """Declares it."""
        self._publisher = link.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._provider = None
        if session.option("shm"):
            self._provider = zenoh.shm.ShmProvider.default_backend(_POOL)

    def wait_for_reader(self) -> None:
        """Returns once a subscriber matches."""
        until("a reader of zenoh", lambda: self._publisher.matching_status.matching)

    def write(self, message: Any) -> None:
        """Publishes bytes."""
        data = bytes(memoryview(message).cast("B"))
        if self._provider is None or len(data) < _SMALL:
            self._publisher.put(data)
            return
        buffer = self._provider.alloc(
            len(data), policy=zenoh.shm.BlockOn(zenoh.shm.GarbageCollect())
        )
        buffer[:] = data
        self._publisher.put(buffer)


def reader(link: zenoh.Session, key: str) -> Any:
    """A subscriber with a long queue."""
    return link.declare_subscriber(key, zenoh.handlers.FifoChannel(200_000))


class Hub:
    """One publisher for all nodes, a subscriber for each."""

    def __init__(self, session: Session) -> None:
        """Waits until every node has said that it is there, after it subscribed."""
        port = free_port()
        files.publish(session.path("port"), str(port))
        self._link = open_session(session, listen=[port], connect=[])
        indices = range(session.nodes)
        self._readers = [reader(self._link, f"bench/up/{index}") for index in indices]
        self._writer = Writer(session, self._link, "bench/down")
        for each in self._readers:
            until("a node of zenoh", each.try_recv)
        self._writer.wait_for_reader()

    def send(self, message: Any) -> None:
        """To every node."""
        self._writer.write(message)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [each.recv().payload.to_bytes() for each in self._readers]

    def close(self) -> None:
        """Lets the last message go and ends."""
        time.sleep(0.2)
        self._link.close()


class Node:
    """A subscriber, and a publisher of replies."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        port = int(files.wait(session.path("port")))
        self._link = open_session(session, listen=[], connect=[port])
        self._reader = reader(self._link, "bench/down")
        self._writer = Writer(session, self._link, f"bench/up/{index}")
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
