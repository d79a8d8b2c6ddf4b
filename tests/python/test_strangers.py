"""Whoever connects and does not belong to the federation, with real processes.

Strangers keep no federation from starting, and end none that runs.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench, Federation, until

PROGRAM = """\
target Python { coordination: COORDINATION, timeout: 1 s }
preamble {=
import pathlib
=}
reactor Camera {
  output image
  timer t(0, 20 ms)
  reaction(t) -> image {= image.set(b"pixels" * 20_000) =}
}
reactor Planner {
  input image
  state count = 0
  reaction(image) {=
    self.count += 1
    if self.count == 3: pathlib.Path("runs").touch()
  =}
  reaction(shutdown) {= print("got", self.count) =}
}
federated reactor {
  camera = new Camera()
  planner = new Planner()
  camera.image -> planner.image
}
"""

OUTCOMES = {"rti": (0, ""), "camera": (0, ""), "planner": (0, "got 51\n")}
IDLE = 150


def prepare(bench: Bench, coordination: str) -> Federation:
    """A federation over TCP whose members are to be started by hand."""
    (bench.folder / "Main.lf").write_text(PROGRAM.replace("COORDINATION", coordination))
    return bench.federation("127.0.0.1:0")


def outcomes(federation: Federation) -> dict[str, tuple[int, str]]:
    """How all have ended, with what the program has printed."""
    ended = federation.finish()
    assert {name: outcome.err for name, outcome in ended.items()} == dict.fromkeys(ended, "")
    return {
        name: (outcome.code, "" if name == "rti" else outcome.out)
        for name, outcome in ended.items()
    }


def port(address: str) -> int:
    """The port of an address."""
    return int(address.rsplit(":", 1)[1])


@contextlib.contextmanager
def idle_strangers(ports: list[int], count: int) -> Iterator[None]:
    """So many connections for each port, which say nothing."""
    with contextlib.ExitStack() as stack:
        for number in ports * count:
            stack.enter_context(socket.create_connection(("127.0.0.1", number), timeout=30))
        yield


def listening_ports(pid: int) -> list[int]:
    """The TCP ports at which a process listens."""
    names = [os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir()]
    inodes = {name[8:-1] for name in names if name.startswith("socket:")}
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = [line for line in lines if line[3] == "0A" and line[9] in inodes]
    return [int(line[1].split(":")[1], 16) for line in listening]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_rti_with_few_descriptors_outlives_idle_strangers(
    bench: Bench, coordination: str
) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti", descriptors=40)
    with idle_strangers([port(federation.address)], IDLE):
        federation.start("camera")
        federation.start("planner")
        assert outcomes(federation) == OUTCOMES


def test_a_federate_with_few_descriptors_outlives_idle_strangers(bench: Bench) -> None:
    federation = prepare(bench, "decentralized")
    federation.start("rti")
    federation.start("camera", descriptors=40)
    federation.start("planner")
    until((bench.folder / "runs").exists, "the federation runs")
    with idle_strangers(listening_ports(federation.members["camera"].pid), IDLE):
        assert outcomes(federation) == OUTCOMES
