"""A stand-in that lies: it speaks as `crates/hprm-cli/src/remote/protocol.rs` says.

What it says is what a test likes.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import socket
from dataclasses import dataclass, field

PROOF, PROGRAM, BYTES = 0, 1, 2
CHALLENGE, PROVED, MISSING, STARTED, FAILED = 0, 1, 2, 3, 7


@dataclass
class Listed:
    """A file, as it is announced: its digest need not be true."""

    path: str
    text: bytes = b""
    digest: bytes = b""
    length: int | None = None

    def written(self) -> bytes:
        """As it travels."""
        digest = self.digest or hashlib.sha256(self.text).digest()
        length = len(self.text) if self.length is None else self.length
        return text(self.path) + number(length) + digest + b"\0"


@dataclass
class StandIn:
    """A link to a starter."""

    link: socket.socket
    machine: str
    said: list[bytes] = field(default_factory=list)

    @classmethod
    def connect(cls, agent: str, machine: str) -> StandIn:
        """Asks an agent, at the abstract Unix socket of that name, for a link to a starter."""
        link = socket.socket(socket.AF_UNIX)
        link.settimeout(30)
        link.connect("\0" + agent)
        link.sendall(f"hprm-agent-1 connect {machine}/starters\n".encode())
        answer = b""
        while not answer.endswith(b"\n"):
            more = link.recv(1)
            assert more, answer
            answer += more
        assert answer.startswith(b"done "), answer
        return cls(link, machine)

    def say(self, kind: int, body: bytes) -> None:
        """Sends a message."""
        message = number(kind) + body
        self.said.append(message)
        self.link.sendall(len(message).to_bytes(4, "little") + message)

    def hear(self) -> tuple[int, bytes]:
        """The next message; of kind -1 if there is none."""
        frame = self._receive(4)
        if not frame:
            return -1, b""
        message = self._receive(int.from_bytes(frame, "little"))
        return message[0], message[1:]

    def _receive(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.link.recv(count - len(data))
            if not more:
                return b""
            data += more
        return data

    def prove(self, key: str) -> None:
        """Proves that it has a key, and has the starter prove the same."""
        kind, body = self.hear()
        assert kind == CHALLENGE
        theirs, mine = body[-32:], os.urandom(32)

        def proof(side: bytes) -> bytes:
            said = side + theirs + mine + self.machine.encode()
            return hmac.digest(bytes.fromhex(key), said, "sha256")

        self.say(PROOF, mine + proof(b"hprm fleet 1 stand-in\0"))
        assert self.hear() == (PROVED, proof(b"hprm fleet 1 starter\0\0"))

    def program(self, main: str, files: list[Listed], federate: str = "sink") -> None:
        """Says what is to be started."""
        manifest = text(main) + b"\0" + text(federate) + text("agent:robot1/rti") + text("0" * 32)
        manifest += number(0) + number(0) + b"\0\0" + number(len(files))
        self.say(PROGRAM, manifest + b"".join(file.written() for file in files))

    def why(self) -> str:
        """Why the starter does not go on."""
        kind, body = self.hear()
        assert kind == FAILED, (kind, body)
        length, rest = read_number(body)
        return rest[:length].decode()


def number(value: int) -> bytes:
    """A number of any size, seven bits in a byte."""
    out = b""
    while value > 127:
        out += bytes([value & 127 | 128])
        value >>= 7
    return out + bytes([value])


def read_number(data: bytes) -> tuple[int, bytes]:
    """The number at the beginning, and what follows."""
    value = shift = 0
    for place, byte in enumerate(data):
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value, data[place + 1 :]
    raise AssertionError("a number does not end")


def text(value: str) -> bytes:
    """A text, with its length before it."""
    data = value.encode()
    return number(len(data)) + data
