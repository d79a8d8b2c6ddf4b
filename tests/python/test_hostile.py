"""Connections that are hostile rather than idle: scanners, foreign TLS, copies of a member.

The federation refuses what each sends, and is not affected. Idle and flooding clients are in
`test_unauthenticated.py`; single malformed frames are the business of the tests of the crates.
"""

from __future__ import annotations

import contextlib
import shutil
import socket
import ssl
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench, Federation, finish, until
from test_network import CERTIFICATES
from test_unauthenticated import OUTCOMES, flood, listening_ports, outcomes, port, prepare

GREETINGS = [
    b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
    b"SSH-2.0-scanner\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(64),
    b"\xff" * 64,
    b"\x00" * 4096,
    struct.pack("<Q", 2**63) + b"HPRM",
    struct.pack(">I", 2**31) + b"\x01",
]
ABORT = struct.pack("ii", 1, 0)


def scan(number: int, rounds: int) -> None:
    """Connect as scanners do: half of the connections end by a reset, after garbage or nothing."""
    for greeting in [b"", *GREETINGS] * rounds:
        for linger in [None, ABORT]:
            with contextlib.suppress(ConnectionError), socket.socket() as scanner:
                scanner.settimeout(30)
                scanner.connect(("127.0.0.1", number))
                scanner.sendall(greeting)
                if linger:
                    scanner.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_scanners_end_no_federation(bench: Bench, coordination: str) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti")
    scan(port(federation.address), 5)
    federation.start("camera")
    federation.await_joined("camera")
    scan(port(federation.address), 5)
    federation.start("planner")
    until((bench.folder / "runs").exists, "the federation runs")
    for member in federation.members.values():
        for number in listening_ports(member.pid):
            scan(number, 5)
    assert outcomes(federation) == OUTCOMES


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_copies_of_a_member_are_refused(bench: Bench, coordination: str) -> None:
    federation = prepare(bench, coordination)
    federation.start("rti")
    federation.start("camera")
    federation.await_joined("camera")
    original = federation.members.pop("camera")
    copies = []
    for _ in range(12):
        federation.start("camera")
        copies.append(federation.members.pop("camera"))
    for copy in copies:
        outcome = finish(copy)
        assert outcome.code == 1
        outcome.assert_one_error("this federate has already joined: is it running twice?")
    federation.members["camera"] = original
    federation.start("planner")
    ended = federation.finish()
    assert [outcome.code for outcome in ended.values()] == [0, 0, 0], ended
    assert ended["planner"].out == "got 51\n"


MANY = 20
FAN_OUT = """\
target Python {{ coordination: {coordination}, timeout: 100 ms }}
reactor Source {{
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {{= out.set(1) =}}
}}
reactor Sink {{
  input inp
  state count = 0
  reaction(inp) {{= self.count += 1 =}}
  reaction(shutdown) {{= print(self.count) =}}
}}
federated reactor {{
  source = new Source()
  sink = new[{sinks}] Sink()
  (source.out)+ -> sink.inp
}}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_twenty_federates_join_beside_a_thousand_connections(
    bench: Bench, coordination: str
) -> None:
    (bench.folder / "Main.lf").write_text(FAN_OUT.format(coordination=coordination, sinks=MANY - 1))
    federation = bench.federation("127.0.0.1:0")
    federation.start("rti")
    sinks = [f"sink__{index}" for index in range(MANY - 1)]
    # Each of them keeps 300 connections open, and replaces the oldest as fast as it can.
    with flood(port(federation.address), 4):
        for name in ["source", *sinks]:
            federation.start(name)
        ended = federation.finish("source", *sinks)
    # One that was hung up on beside the flood tells so, and comes again.
    assert [outcome.code for outcome in ended.values()] == [0] * MANY, ended
    assert [ended[name].out for name in sinks] == ["11\n"] * len(sinks)
    assert federation.finish("rti")["rti"].code == 0


@contextlib.contextmanager
def foreign_tls(number: int, count: int, folder: Path | None) -> Iterator[None]:
    """Connections that speak TLS with a certificate of another authority, or without one."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    if folder:
        context.load_cert_chain(folder / "robot.pem", folder / "robot.key")
    with contextlib.ExitStack() as stack:
        for _ in range(count):
            plain = socket.create_connection(("127.0.0.1", number), timeout=30)
            with contextlib.suppress(OSError):
                stack.enter_context(context.wrap_socket(plain))
            # A socket that is wrapped is detached; one that failed still has to be closed.
            plain.close()
        yield


def certify(folder: Path) -> None:
    """Make an authority and a certificate in a folder."""
    folder.mkdir(exist_ok=True)
    for line in CERTIFICATES:
        subprocess.run(["openssl", *line.split()], cwd=folder, check=True, capture_output=True)


@pytest.mark.skipif(not shutil.which("openssl"), reason="openssl makes the certificates")
@pytest.mark.parametrize("certified", [True, False], ids=["of another authority", "without"])
def test_foreign_certificates_open_nothing(bench: Bench, certified: bool) -> None:
    federation = encrypted(bench)
    other = bench.folder / "other"
    certify(other)
    federation_port = port(federation.address)
    with foreign_tls(federation_port, 40, other if certified else None):
        start_encrypted(federation, "camera")
        federation.await_joined("camera")
        with foreign_tls(federation_port, 40, other if certified else None):
            start_encrypted(federation, "planner")
            assert outcomes(federation) == OUTCOMES


def encrypted(bench: Bench) -> Federation:
    """A federation with TLS, of which the RTI has been started."""
    federation = prepare(bench, "centralized")
    certify(bench.folder)
    start_encrypted(federation, "rti")
    return federation


def start_encrypted(federation: Federation, name: str) -> None:
    files = ["--tls-cert", "robot.pem", "--tls-key", "robot.key", "--tls-ca", "ca.pem"]
    federation.start(name, *files)
