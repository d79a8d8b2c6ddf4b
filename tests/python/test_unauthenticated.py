"""Clients that connect and do not belong to the federation, with real processes.

Such clients keep no federation from starting, and end none that runs.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench, Federation, finish, hear, until

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
def idle_connections(ports: list[int], count: int) -> Iterator[None]:
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
def test_an_rti_with_few_descriptors_outlives_idle_clients(bench: Bench, coordination: str) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti", limit="-n 40")
    with idle_connections([port(federation.address)], IDLE):
        federation.start("camera")
        federation.start("planner")
        assert outcomes(federation) == OUTCOMES


def test_a_federate_with_few_descriptors_outlives_idle_clients(bench: Bench) -> None:
    federation = prepare(bench, "decentralized")
    federation.start("rti")
    federation.start("camera", limit="-n 40")
    federation.start("planner")
    until((bench.folder / "runs").exists, "the federation runs")
    with idle_connections(listening_ports(federation.members["camera"].pid), IDLE):
        assert outcomes(federation) == OUTCOMES


# Opens and closes connections as fast as it can, and keeps some of them.
FLOOD = """
import socket, sys
kept = []
while True:
    connection = socket.socket()
    connection.setblocking(False)
    try: connection.connect(("127.0.0.1", int(sys.argv[1])))
    except OSError: pass
    kept.append(connection)
    if len(kept) == 100: print(flush=True)
    if len(kept) > 300: kept.pop(0).close()
"""


@contextlib.contextmanager
def flood(number: int, processes: int) -> Iterator[None]:
    """Processes that flood a port."""
    command = [sys.executable, "-c", FLOOD, str(number)]
    floods = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(processes)]
    try:
        for process in floods:
            assert process.stdout is not None
            process.stdout.readline()
        yield
    finally:
        for process in floods:
            process.kill()
            process.communicate()


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_federates_join_beside_a_flood(bench: Bench, coordination: str) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti")
    with flood(port(federation.address), 2):
        federation.start("camera")
        federation.start("planner")
        hear(federation.members["rti"].stdout, "the federation starts")
    ended = federation.finish()
    assert [outcome.code for outcome in ended.values()] == [0, 0, 0], ended
    assert ended["planner"].out == "got 51\n"


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_is_killed_before_all_have_joined_may_join_again(
    bench: Bench, coordination: str
) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti")
    federation.start("camera")
    federation.await_joined("camera")
    federation.members["camera"].kill()
    finish(federation.members["camera"])
    left = "federate camera has left before the start; it may join again\n"
    hear(federation.members["rti"].stdout, left)
    federation.start("camera")
    federation.start("planner")
    assert outcomes(federation) == OUTCOMES


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federation_that_is_not_complete_in_time_is_called_off(
    bench: Bench, coordination: str
) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti", "--join-timeout", "5")
    federation.start("camera")
    federation.await_joined("camera")
    ended = federation.finish()
    missing = "federate planner did not join within 5 s"
    assert (ended["rti"].code, ended["camera"].code) == (1, 1)
    ended["rti"].assert_one_error(f"error: {missing}\n", "hint: start them with `hprm federate`")
    ended["camera"].assert_one_error(f"the federation has not started: {missing}\n")


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_has_left_before_the_start_is_named(
    bench: Bench, coordination: str
) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti", "--join-timeout", "5")
    federation.start("camera")
    federation.await_joined("camera")
    federation.members["camera"].kill()
    finish(federation.members["camera"])
    federation.start("planner")
    federation.await_joined("planner")
    ended = federation.finish("rti", "planner")
    missing = "federate camera left before the start and did not join again within 5 s"
    assert (ended["rti"].code, ended["planner"].code) == (1, 1)
    ended["rti"].assert_one_error(f"error: {missing}\n")
    ended["planner"].assert_one_error(f"the federation has not started: {missing}\n")


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_rti_that_is_stopped_before_the_start_sends_its_federates_home(
    bench: Bench, coordination: str, number: signal.Signals
) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti")
    federation.start("camera")
    federation.await_joined("camera")
    federation.members["rti"].send_signal(number)
    ended = federation.finish()
    assert (ended["rti"].code, ended["rti"].err) == (128 + number, "")
    assert ended["camera"].code == 1
    ended["camera"].assert_one_error("the RTI has been stopped before the federation started")
