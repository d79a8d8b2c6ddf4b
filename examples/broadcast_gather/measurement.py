"""What the broadcast and gather programs measure: which rounds, how long they took, what they cost.

Both programs run this inside their federates. The environment says what to do:

- ``BROADCAST_GATHER_SIZES``: sizes in MB, as in ``1,5,10``;
- ``BROADCAST_GATHER_ROUNDS``: measured rounds per size, the same for every size;
- ``BROADCAST_GATHER_OUT``: the JSON file to write; the clients write theirs beside it;
- ``BROADCAST_GATHER_PROGRESS``: ``1`` to print a line that counts rounds, ten times a second.

It does not start federations (`federation.py`) and does not show results (`demo.py`).
"""

from __future__ import annotations

import json
import os
import statistics
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

SIZES_MB = (1, 5, 10, 25, 50)
WARM_UP_ROUNDS = 5
"""Rounds of each size that are not measured. The copies of the first one are compared."""

PROGRESS_PREFIX = "progress "
_PROGRESS_INTERVAL_NS = 100_000_000
_ROWS_PER_MB = 62_500
_SEED = 20_240


def rounds_for(size_mb: int) -> int:
    """How many rounds of a size are measured: small arrays are quick, and noisier."""
    return max(30, min(200, 600 // size_mb))


class Rounds:
    """The rounds of one run, in order: each size in turn, its warm-up rounds first."""

    def __init__(self, rounds: Mapping[int, int], out: Path | None, progress: bool) -> None:
        """Plans ``rounds[size_mb]`` measured rounds per size and remembers where to save them."""
        self._plan = dict(rounds)
        self._out = out
        self._progress = progress
        self._sizes = list(self._plan)
        self._round = 0
        self._array: np.ndarray | None = None
        self._latencies_ns: dict[int, list[int]] = {size: [] for size in self._plan}
        self._equal: dict[int, bool] = {}
        self._sends = 0
        self._sent_bytes = 0
        self._last_progress_ns = 0

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> Rounds:
        """Reads the plan from the environment; a malformed variable is an error that names it."""
        sizes = _positive_numbers(environment, "BROADCAST_GATHER_SIZES") or SIZES_MB
        count = _positive_numbers(environment, "BROADCAST_GATHER_ROUNDS")
        out = environment.get("BROADCAST_GATHER_OUT")
        return cls(
            rounds={size: count[0] if count else rounds_for(size) for size in sizes},
            out=Path(out) if out else None,
            progress=environment.get("BROADCAST_GATHER_PROGRESS") == "1",
        )

    @property
    def finished(self) -> bool:
        """Whether every round of every size is done."""
        return not self._sizes

    def array(self) -> np.ndarray:
        """The array to broadcast next. All rounds of a size broadcast the same one."""
        if self._array is None:
            size_mb = self._sizes[0]
            generator = np.random.default_rng(_SEED + size_mb)
            self._array = generator.random((_ROWS_PER_MB * size_mb, 2))
        self._sends += 1
        self._sent_bytes += self._array.nbytes
        return self._array

    def record(self, latency_ns: int, copies: Sequence[np.ndarray | None]) -> None:
        """Takes note of a round that ended; every client must have answered."""
        missing = [index for index, copy in enumerate(copies) if copy is None]
        if missing:
            raise RuntimeError(f"no array from client {missing}: the round is not complete")
        size_mb = self._sizes[0]
        if self._round == 0:
            self._equal[size_mb] = all(np.array_equal(copy, self._array) for copy in copies)
        if self._round >= WARM_UP_ROUNDS:
            self._latencies_ns[size_mb].append(latency_ns)
        self._round += 1
        if self._round == WARM_UP_ROUNDS + self._plan[size_mb]:
            self._next_size()
        self._show_progress()

    def save(self, store: Mapping[str, Any]) -> None:
        """Writes the raw results, and what the server's object store counted, as JSON."""
        if self._out is None:
            return
        results = {
            "complete": self.finished,
            "warm_up_rounds": WARM_UP_ROUNDS,
            "latencies_ns": self._latencies_ns,
            "equal": self._equal,
            "sends": self._sends,
            "sent_bytes": self._sent_bytes,
            "store": dict(store),
        }
        self._out.write_text(json.dumps(results))

    def _next_size(self) -> None:
        size_mb = self._sizes.pop(0)
        self._array = None
        self._round = 0
        latencies = self._latencies_ns[size_mb]
        median_ms = statistics.median(latencies) / 1e6
        print(f"{size_mb} MB: median {median_ms:.2f} ms in {len(latencies)} rounds", flush=True)

    def _show_progress(self) -> None:
        now_ns = time.perf_counter_ns()
        due = now_ns - self._last_progress_ns >= _PROGRESS_INTERVAL_NS or self.finished
        if not (self._progress and due):
            return
        self._last_progress_ns = now_ns
        total = sum(self._plan.values()) + WARM_UP_ROUNDS * len(self._plan)
        print(f"{PROGRESS_PREFIX}{self._sends} {total}", flush=True)


def save_client(index: int, sends: int, sent_bytes: int, store: Mapping[str, Any]) -> None:
    """Writes what a client sent and what its object store counted, beside the server's results."""
    out = os.environ.get("BROADCAST_GATHER_OUT")
    if out:
        results = {"sends": sends, "sent_bytes": sent_bytes, "store": dict(store)}
        client_file(Path(out), index).write_text(json.dumps(results))


def client_file(out: Path, index: int) -> Path:
    """Where the client with this index in the bank writes when the server writes to ``out``."""
    return out.with_suffix(f".client-{index}.json")


def _positive_numbers(environment: Mapping[str, str], name: str) -> tuple[int, ...]:
    """The comma-separated numbers in a variable; none if it is unset or empty."""
    text = environment.get(name, "")
    try:
        numbers = tuple(int(part) for part in text.split(",")) if text else ()
    except ValueError:
        numbers = (0,)
    if any(number < 1 for number in numbers):
        raise ValueError(f"{name} must be whole numbers above 0 with commas, as in 1,5: {text!r}")
    return numbers
