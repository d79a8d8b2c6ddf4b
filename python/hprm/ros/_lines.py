"""Lines that several threads write, each of which stays whole, and lines that processes write."""

from __future__ import annotations

import fcntl
import os
import select
import struct
import termios
from collections.abc import Iterator
from typing import TextIO

#: How much is read at once.
_MOST = 1 << 16


def write_line(text: str, out: TextIO) -> None:
    """Write a line; ``print`` writes its end later, and another thread may come between."""
    out.write(f"{text}\n")
    out.flush()


def lines_of(pipe: int, end: int) -> Iterator[bytes]:
    """Yield the lines that come from a pipe, with their ends, until no process can write any more.

    When ``end`` can be read, or is closed at its other end, what has been written by then is the
    rest: a process that goes on in the background may keep the pipe open for as long as it likes.
    """
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    poll.register(end, select.POLLIN)
    rest = bytearray()
    left: int | None = None
    while left is None or left > 0:
        ready = {descriptor for descriptor, _ in poll.poll()}
        if left is None and end in ready:
            left = _waiting(pipe)
            poll.unregister(end)
            continue
        came = os.read(pipe, _MOST if left is None else min(left, _MOST))
        if not came:
            break
        left = None if left is None else left - len(came)
        rest += came
        if b"\n" in came:
            *lines, last = bytes(rest).split(b"\n")
            rest = bytearray(last)
            for line in lines:
                yield line + b"\n"
    if rest:
        yield bytes(rest)


def _waiting(pipe: int) -> int:
    """Return how many bytes a pipe has."""
    (count,) = struct.unpack("i", fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)))
    return int(count)
