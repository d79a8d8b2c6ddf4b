"""The round of the broadcast and gather example as Python's own means do it: pickle over sockets.

Four child processes, one Unix stream socket each. The server pickles an array once (protocol 5,
in band) and sends the bytes to every child; a child unpickles, copies, pickles and sends back.
A message is received into a buffer of its own, as `multiprocessing.connection` does it; or, when
asked, into one that is reused, which spares pickle the page faults of fresh memory.
Nothing of HPRM is in here.
"""

from __future__ import annotations

import pickle
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

CLIENTS = 4
_HEADER = struct.Struct("<Q")
_STOP = _HEADER.pack(0)
_ROWS_PER_MB = 62_500


class _Pipe:
    """One end of a stream socket that carries pickled objects, each after its length."""

    def __init__(self, sock: socket.socket, reuse: bool) -> None:
        self._sock = sock
        self._reuse = reuse
        self._buffer = bytearray()
        self._header = bytearray(_HEADER.size)

    def send(self, pickled: bytes) -> None:
        self._sock.sendall(_HEADER.pack(len(pickled)))
        self._sock.sendall(pickled)

    def receive(self) -> np.ndarray | None:
        """The next object, or none if the other side says that there are no more."""
        self._fill(memoryview(self._header))
        (length,) = _HEADER.unpack(self._header)
        if length == 0:
            return None
        pickled = memoryview(self._room(length))[:length]
        self._fill(pickled)
        return pickle.loads(pickled)

    def stop(self) -> None:
        """Tells the other side that there are no more objects."""
        self._sock.sendall(_STOP)

    def _room(self, length: int) -> bytearray:
        if not self._reuse:
            return bytearray(length)
        if len(self._buffer) < length:
            self._buffer = bytearray(length)
        return self._buffer

    def _fill(self, view: memoryview) -> None:
        received = 0
        while received < len(view):
            count = self._sock.recv_into(view[received:])
            if count == 0:
                raise ConnectionError("the other side closed in the middle of a round")
            received += count


def latencies_ns(size_mb: int, warm_up_rounds: int, rounds: int, reuse: bool) -> list[int]:
    """The latency of each measured round, from before the pickling to all four arrays held.

    With ``reuse``, every process keeps one receive buffer per socket for all messages.
    """
    array = np.random.default_rng(size_mb).random((_ROWS_PER_MB * size_mb, 2))
    latencies = []
    with _clients(reuse) as pipes:
        for index in range(warm_up_rounds + rounds):
            started = time.perf_counter_ns()
            pickled = pickle.dumps(array, protocol=5)
            for pipe in pipes:
                pipe.send(pickled)
            copies = [pipe.receive() for pipe in pipes]
            latencies.append(time.perf_counter_ns() - started)
            if index == 0 and not all(np.array_equal(copy, array) for copy in copies):
                raise ValueError("a gathered array is not the one sent")
    return latencies[warm_up_rounds:]


@contextmanager
def _clients(reuse: bool) -> Iterator[list[_Pipe]]:
    """Four running children; they have ended when the block is left."""
    ours: list[socket.socket] = []
    children: list[subprocess.Popen[bytes]] = []
    try:
        for _ in range(CLIENTS):
            mine, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
            ours.append(mine)
            with theirs:
                argv = [sys.executable, __file__, str(theirs.fileno()), str(int(reuse))]
                children.append(subprocess.Popen(argv, pass_fds=[theirs.fileno()]))
        pipes = [_Pipe(sock, reuse) for sock in ours]
        yield pipes
        for pipe in pipes:
            pipe.stop()
    finally:
        for sock in ours:
            sock.close()
        for child in children:
            child.wait()


def _serve(descriptor: int, reuse: bool) -> None:
    """A child: sends a fresh copy of every array back until it is told to stop."""
    with socket.socket(fileno=descriptor) as sock:
        pipe = _Pipe(sock, reuse)
        while (val := pipe.receive()) is not None:
            pipe.send(pickle.dumps(val.copy(), protocol=5))


if __name__ == "__main__":
    _serve(int(sys.argv[1]), reuse=sys.argv[2] == "1")
