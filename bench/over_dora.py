"""A source and a sink of dora on two machines, for `agents.py`.

A coordinator runs on the sink's machine and a daemon on each of the two. Daemons know one another
by address: there is no multicast between the networks of `agents.py`. Nodes run in dora's own
environment (`peers/environments.py`), where this file is their program. Nothing is encrypted.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from subprocess import Popen
from typing import Any

Spawn = Callable[..., "Popen[str]"]

#: Where the coordinator, and each daemon, listens.
COORDINATOR, DAEMON = 6013, 5456


@dataclass
class Dora:
    """A coordinator and two daemons, which their owner ends."""

    spawn: Spawn
    python: Path
    folder: Path
    #: The machine of each node, and its address as the other one sees it.
    source: tuple[str, str]
    sink: tuple[str, str]

    def start(self) -> None:
        """Starts all three, and waits until both daemons are known."""
        (source, near), (sink, far) = self.source, self.sink
        self._run(sink, "coordinator", "--interface", "0.0.0.0", "--store", "memory", "--quiet")
        time.sleep(1)
        connect = ["--zenoh-connect", f"tcp/{far}:{DAEMON}"]
        self._run(sink, *self._daemon(sink, far))
        time.sleep(1)
        self._run(source, *self._daemon(source, near), *connect)
        time.sleep(2)

    def _daemon(self, machine: str, address: str) -> list[str]:
        place = ["--coordinator-addr", self.sink[1], "--zenoh-listen", f"{address}:{DAEMON}"]
        return ["daemon", "--machine-id", machine, "--zenoh-no-multicast", *place]

    def _run(self, machine: str, *words: str) -> Popen[str]:
        return self.spawn(machine, str(self.python.with_name("dora")), *words)

    def measure(self, length: int, period: int, messages: int) -> list[float]:
        """What messages took from the source to the sink, in microseconds.

        Large ones of which dora has dropped a part are not among them.
        """
        took = self.folder / "took.json"
        took.unlink(missing_ok=True)
        words = [str(word) for word in (length, period, messages)]
        nodes = [
            self._node(self.source, "source", words) | {"outputs": ["data"]},
            self._node(self.sink, "sink", [str(messages), str(took)])
            | {"inputs": {"data": {"source": "source/data", "queue_size": messages}}},
        ]
        flow = self.folder / "flow.yml"
        flow.write_text(json.dumps({"nodes": nodes}))  # JSON is YAML
        start = ["start", str(flow), "--attach", "--coordinator-addr", self.sink[1]]
        out, err = self._run(self.sink[0], *start).communicate(timeout=120)
        assert took.exists(), (out, err)
        read: list[float] = json.loads(took.read_text())
        return read

    def _node(self, place: tuple[str, str], role: str, words: list[str]) -> dict[str, object]:
        arguments = " ".join([str(Path(__file__).resolve()), role, *words])
        deploy = {"machine": place[0]}
        return {"id": role, "path": str(self.python), "args": arguments, "deploy": deploy}


def timed(length: int, period: int, messages: int) -> Iterator[Any]:
    """Arrays of so many bytes, one every so many milliseconds, whose first number is the time."""
    import numpy as np

    due = time.monotonic()
    for _ in range(messages):
        value = np.empty(length // 8)
        value[:] = 1
        value[0] = time.monotonic()
        yield value
        due += period / 1000
        time.sleep(max(0.0, due - time.monotonic()))


def send(length: int, period: int, messages: int) -> None:
    """The source: values whose first number is the time."""
    import pyarrow as pa
    from dora import Node

    node = Node()
    # What is sent before the sink listens is lost.
    time.sleep(2)
    for value in timed(length, period, messages):
        node.send_output("data", pa.array(value))
    time.sleep(1)


def take(messages: int, path: str) -> None:
    """The sink: writes what each message took."""
    from dora import Node

    took: list[float] = []
    node = Node()
    while len(took) < messages:
        event = node.next(timeout=60.0)
        if event is None or event["type"] in ("INPUT_CLOSED", "STOP", "ERROR"):
            break
        if event["type"] == "INPUT":
            at = event["value"][0].as_py()
            took.append((time.monotonic() - at) * 1e6)
    Path(path).write_text(json.dumps(took))


if __name__ == "__main__":
    if sys.argv[1] == "source":
        send(*map(int, sys.argv[2:]))
    else:
        take(int(sys.argv[2]), sys.argv[3])
