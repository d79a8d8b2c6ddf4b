"""TCP ports for what tests start, which no test that runs at the same time has."""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import socket
from collections.abc import Iterator

#: Each process of tests has so many ports of its own, below those that the kernel chooses: a port
#: that was only free for a moment, it may give to any other process before the one that is meant.
PORTS = 1000
FIRST = 10_000
PROCESSES = 20


def _own() -> Iterator[int]:
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    number = int(worker.removeprefix("gw")) if worker else random.randrange(PROCESSES)
    own = range(FIRST + number % PROCESSES * PORTS, FIRST + (number % PROCESSES + 1) * PORTS)
    # Not the ports of the tests before, which may still be in use.
    start = random.randrange(PORTS)
    return itertools.cycle((*own[start:], *own[:start]))


_ports = _own()


def free_ports(count: int) -> list[int]:
    """Ports that no process uses, and that the kernel gives to none."""
    found: list[int] = []
    for port in itertools.islice(_ports, PORTS):
        if len(found) == count:
            break
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", port)):
            found.append(port)
    assert len(found) == count, "too few ports are free"
    return found
