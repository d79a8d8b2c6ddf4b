"""The physical limit from Python: memory that is mapped once, one copy into it, one futex to wake.

There is no middleware here: no types, no discovery, no lifetimes, nothing that survives a crash. A
writer has one region for large messages, which it writes again and again, and a ring for small
ones. It enters the kernel only to wake a reader that sleeps. It relies on stores of aligned words
being seen in order, as on x86-64.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import platform
import time
from typing import Any

import numpy as np
from session import Session, until

if platform.machine() != "x86_64":
    raise ImportError("the limit relies on the order of stores of x86-64")

_SLOTS, _SLOT = 256, 2048
_CONTROL = 4096
_RING = _SLOTS * _SLOT
_LENGTH = 16
_FUTEX, _WAIT, _WAKE = 202, 0, 1
_PATIENCE_S = 0.05
"""A sleeper looks again after that time, in case that it was never woken."""

_libc = ctypes.CDLL(None, use_errno=True)
_libc.syscall.argtypes = [ctypes.c_long, *[ctypes.c_void_p] * 6]
_HARMLESS = (0, errno.EAGAIN, errno.EINTR, errno.ETIMEDOUT)


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


_TIME = _Timespec(0, round(_PATIENCE_S * 1e9))
_PATIENCE = ctypes.addressof(_TIME)


def _futex(address: int, operation: int, value: int, timeout: int | None) -> None:
    if _libc.syscall(_FUTEX, address, operation, value, timeout, None, None) < 0:
        number = ctypes.get_errno()
        if number not in _HARMLESS:
            raise OSError(number, "the futex failed")


class Channel:
    """One writer, some readers, one piece of memory, which is in place before anything is timed.

    The control words: 0 is the number of messages written; 16 * (1 + reader) the number that the
    reader has taken, and the next one whether it sleeps.
    """

    def __init__(self, path: str, readers: int, largest: int, create: bool) -> None:
        """Makes the file, or waits until its writer has made it."""
        size = _CONTROL + _RING + _LENGTH + largest
        if create:
            with open(path + ".new", "wb") as file:
                file.truncate(size)
            os.rename(path + ".new", path)
        until("the writer's memory", lambda: os.path.exists(path))
        with open(path, "r+b") as file:
            flags = mmap.MAP_SHARED | mmap.MAP_POPULATE
            self._map = mmap.mmap(file.fileno(), size, flags=flags)
        self._bytes = np.frombuffer(self._map, np.uint8)
        self._words = memoryview(self._map)[:_CONTROL].cast("I")
        self._lengths = memoryview(self._map)[_CONTROL:].cast("B")[: _RING + _LENGTH]
        self._base = self._bytes.ctypes.data
        self._readers = range(readers)
        self._count = 0

    def write(self, message: Any) -> None:
        """Copies the message and wakes who sleeps. A full ring makes the writer wait."""
        data = np.frombuffer(message, np.uint8)
        words = self._words
        if len(data) <= _SLOT - _LENGTH:
            for reader in self._readers:
                while self._count - words[16 * (1 + reader)] >= _SLOTS:
                    time.sleep(0)
            place = _CONTROL + self._count % _SLOTS * _SLOT
        else:
            place = _CONTROL + _RING
        where = _CONTROL + self._count % _SLOTS * _SLOT
        self._bytes[where : where + 8].view(np.int64)[0] = len(data)
        np.copyto(self._bytes[place + _LENGTH : place + _LENGTH + len(data)], data)
        self._count += 1
        words[0] = self._count
        for reader in self._readers:
            if words[16 * (1 + reader) + 1]:
                _futex(self._base, _WAKE, len(self._readers), None)
                return

    def read(self, reader: int, spin_s: float) -> Any:
        """The next message, which stays as it is until the writer writes again."""
        words, mine = self._words, 16 * (1 + reader)
        words[mine] = self._count  # the previous message is done with
        if words[0] == self._count and spin_s:
            give_up = time.perf_counter() + spin_s
            while words[0] == self._count and time.perf_counter() < give_up:
                pass
        while words[0] == self._count:
            words[mine + 1] = 1
            _futex(self._base, _WAIT, self._count, _PATIENCE)
            words[mine + 1] = 0
        where = _CONTROL + self._count % _SLOTS * _SLOT
        length = int(self._bytes[where : where + 8].view(np.int64)[0])
        place = where if length <= _SLOT - _LENGTH else _CONTROL + _RING
        self._count += 1
        return self._bytes[place + _LENGTH : place + _LENGTH + length]

    def finish(self) -> None:
        """Waits until every reader has taken all messages but the last, which ends it."""
        wanted = self._count - 1
        until(
            "the readers", lambda: all(self._words[16 * (1 + r)] >= wanted for r in self._readers)
        )


def _channel(session: Session, way: str, readers: int, create: bool) -> Channel:
    path = f"/dev/shm/{session.name}-{way}"
    return Channel(path, readers, session.largest, create)


class Hub:
    """One channel to all nodes, one from each."""

    def __init__(self, session: Session) -> None:
        """Waits for the nodes."""
        self._spin_s = float(session.option("spin_s", 0.0))
        self._down = _channel(session, "down", session.nodes, create=True)
        self._up = [
            _channel(session, f"up-{index}", 1, create=False) for index in range(session.nodes)
        ]

    def send(self, message: Any) -> None:
        """To every node."""
        self._down.write(message)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [channel.read(0, self._spin_s) for channel in self._up]

    def close(self) -> None:
        """Waits until the nodes have seen the end; the harness removes the files."""
        self._down.finish()


class Node:
    """A channel from the hub, and one to it."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        self._index = index
        self._spin_s = float(session.option("spin_s", 0.0))
        self._down = _channel(session, "down", session.nodes, create=False)
        self._up = _channel(session, f"up-{index}", 1, create=True)

    def receive(self) -> Any:
        """The next message."""
        return self._down.read(self._index, self._spin_s)

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._up.write(message)

    def close(self) -> None:
        """Nothing is left to do."""
