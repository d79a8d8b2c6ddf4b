"""What a hub sends and what a node answers, for every contender alike, and what is timed.

It knows neither transports nor clocks of their own: `messages` is a generator that says what to
send next and is told the replies, so that a loop around a socket can drive it as well as reactions
can. Every message begins with its number and with what the node is to do with it; every reply
repeats the number, and a wrong one ends the measurement. This file runs in the environment of each
peer and needs NumPy only.
"""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any, TextIO

import numpy as np

COPY, ACK, ECHO, COUNT, REPORT, STOP = range(1, 7)
"""What a node does: send a copy back, only a header, the same again, count; say the count; end."""

MODES = {"W1": COPY, "W1b": ACK, "W2": ECHO, "W5": COUNT, "W6": ACK}
_HEADER = struct.Struct("<qq")
_ENOUGH, _PATIENCE = 3, 3
"""A cell with fewer rounds than that may take so many times its budget to get them."""

_SEND_AHEAD = 100_000
"""No more messages than that are sent without waiting for anybody."""

Step = tuple[Any, bool]
"""A message and whether every node answers it."""


@dataclass(frozen=True)
class Cell:
    """One figure: a workload with messages of one size, and how long to try."""

    workload: str
    size: int
    rounds: int
    budget_s: float
    warm_up: int

    @property
    def mode(self) -> int:
        """What the nodes do with the messages."""
        return MODES[self.workload]


def cells_of(plan: Sequence[dict[str, Any]]) -> list[Cell]:
    """The cells of a plan that travelled as JSON."""
    return [Cell(**cell) for cell in plan]


class WrongReply(Exception):
    """A node answered something else than it should."""


def messages(cells: Sequence[Cell], out: TextIO) -> Generator[Step, Sequence[Any] | None, None]:
    """All messages of a session in order; writes each cell's result to ``out``, a line of JSON."""
    number = 0
    for cell in cells:
        run = _rate if cell.mode == COUNT else _rounds
        result, number = yield from run(cell, number)
        result |= {"workload": cell.workload, "size": cell.size}
        out.write(json.dumps(result) + "\n")
        out.flush()
    yield _HEADER.pack(number, STOP), False


def _rounds(cell: Cell, number: int) -> Generator[Step, Sequence[Any], tuple[dict[str, Any], int]]:
    """Rounds of one message and all its replies."""
    make = _large(cell) if cell.mode in (COPY, ACK) else _small(cell)
    times: list[int] = []
    began = 0.0
    warm = 0
    while True:
        number += 1
        message = make(number)
        started = time.perf_counter_ns()
        replies = yield message, True
        took = time.perf_counter_ns() - started
        if warm == 0 and cell.mode in (COPY, ECHO):
            _check_equal(cell, message, replies)
        _check_numbers(cell, number, replies)
        # What the replies occupy is free before the next round, as it would be in a program.
        del replies
        if warm == 0:
            began = time.monotonic()  # the first round may have to map memory, or more
        elapsed = time.monotonic() - began
        if warm < cell.warm_up and (warm == 0 or elapsed < cell.budget_s / 3):
            warm += 1
            continue
        times.append(took)
        patience_s = cell.budget_s if len(times) >= _ENOUGH else _PATIENCE * cell.budget_s
        if len(times) >= cell.rounds or elapsed >= patience_s:
            return {"times_ns": times}, number


def _rate(cell: Cell, number: int) -> Generator[Step, Any, tuple[dict[str, Any], int]]:
    """As many messages as possible in the time, until every node says how many it has."""
    rest = bytes(cell.size - _HEADER.size)
    sent = 0
    started = time.perf_counter_ns()
    until = started + round(cell.budget_s * 1e9)
    while sent < _SEND_AHEAD and (sent % 16 or time.perf_counter_ns() < until):
        number += 1
        sent += 1
        yield _HEADER.pack(number, COUNT) + rest, False
    number += 1
    replies = yield _HEADER.pack(number, REPORT) + rest, True
    seconds = (time.perf_counter_ns() - started) / 1e9
    received = [_HEADER.unpack_from(reply)[1] for reply in replies]
    _check_numbers(cell, number, replies)
    return {"sent": sent, "received": received, "seconds": seconds}, number


def _large(cell: Cell) -> Any:
    """Makes messages of one array, which its sender keeps: only the header changes."""
    array = np.random.default_rng(cell.size).random((cell.size // 16, 2))
    header = array.reshape(-1)[:2].view(np.int64)

    def make(number: int) -> np.ndarray:
        header[:] = number, cell.mode
        return array

    return make


def _small(cell: Cell) -> Any:
    """Makes messages of bytes, each before its round begins."""
    rest = (bytes(range(256)) * (cell.size // 256 + 1))[: cell.size - _HEADER.size]

    def make(number: int) -> bytes:
        return _HEADER.pack(number, cell.mode) + rest

    return make


def _check_equal(cell: Cell, message: Any, replies: Sequence[Any]) -> None:
    sent = _bytes_of(message)
    for node, reply in enumerate(replies):
        if not np.array_equal(_bytes_of(reply), sent):
            raise WrongReply(f"{cell.workload}, {cell.size} B: node {node} sent something else")


def _check_numbers(cell: Cell, number: int, replies: Sequence[Any]) -> None:
    for node, reply in enumerate(replies):
        got = _HEADER.unpack_from(reply)[0]
        if got != number:
            what = f"node {node} answered message {got} instead of {number}"
            raise WrongReply(f"{cell.workload}, {cell.size} B: {what}")


def _bytes_of(buffer: Any) -> np.ndarray:
    if isinstance(buffer, np.ndarray):
        return buffer.reshape(-1).view(np.uint8)
    return np.frombuffer(buffer, np.uint8)


class Answers:
    """What a node says to each message."""

    def __init__(self) -> None:
        """Has counted nothing yet."""
        self.stopped = False
        self._counted = 0

    def answer(self, received: Any) -> Any:
        """The reply, or none if the message wants none. Sets ``stopped`` at the last message."""
        number, mode = _HEADER.unpack_from(received)
        if mode == COUNT:
            self._counted += 1
            return None
        if mode == ECHO:
            return received
        if mode == COPY:
            if isinstance(received, np.ndarray):
                return received.copy()
            return np.frombuffer(received, np.float64).copy()
        if mode == ACK:
            return _HEADER.pack(number, ACK)
        if mode == REPORT:
            counted, self._counted = self._counted, 0
            return _HEADER.pack(number, counted)
        self.stopped = True
        return None
