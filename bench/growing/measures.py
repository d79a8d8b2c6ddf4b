"""What is taken from a run of a federation: one number for each measure and repetition."""

from __future__ import annotations

import json
import statistics
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evaluation.record import Cell
from run_text import run_text

from . import programs

COORDINATIONS = ("centralized", "decentralized")


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    repetitions: int
    chains: Sequence[int]
    """Numbers of federates."""
    meshes: Sequence[int]
    sizes: Sequence[int]
    """Bytes of messages."""
    tags: int
    warm_up: int
    messages: int
    """Of small size; of large ones there are as many as have `bytes_sent` together."""
    bytes_sent: int


FULL = Effort(
    repetitions=5,
    chains=(2, 4, 8, 16, 32, 64),
    meshes=(2, 4, 8, 16, 32),
    sizes=tuple(64 << (2 * step) for step in range(11)),
    tags=200,
    warm_up=50,
    messages=100_000,
    bytes_sent=4 << 30,
)
QUICK = Effort(
    1, (2, 4), (2, 3), (64, 1 << 20), tags=5, warm_up=1, messages=200, bytes_sent=1 << 26
)

LATENCY, CPU, RATE, MEMORY, LINKS = "latency", "cpu", "rate", "memory", "links"
TITLES = {
    LATENCY: ("One hop of a chain, against the number of federates", "µs a hop"),
    CPU: ("CPU time of a federate for a tag, against the number of federates", "µs a tag"),
    MEMORY: ("Memory of a federate in a chain, which has two links", "MiB"),
    LINKS: ("Memory of a federate that is linked with all others", "MiB"),
    RATE: ("Messages through one connection, against their size", "thousand/s"),
}
"""Of each measure: a title, and its unit."""

Measured = dict[str, list[Cell]]


def take(effort: Effort, tell: Callable[[str], None]) -> Measured:
    """Run everything as often as is asked for, in turn; return the cells of each measure.

    Raises:
        FederationError: a federation has failed.

    """
    cells: dict[tuple[str, str, str], Cell] = {}
    for repetition in range(effort.repetitions):
        tell(f"repetition {repetition + 1} of {effort.repetitions}")
        for coordination in COORDINATIONS:
            for measure, case, value in _all(coordination, effort):
                key = (measure, f"hprm {coordination}", case)
                cell = cells.setdefault(key, Cell(*key[1:], TITLES[measure][1], {}))
                cell.values[repetition] = value
    return {it: [cell for key, cell in cells.items() if key[0] == it] for it in TITLES}


def _all(coordination: str, effort: Effort) -> Iterator[tuple[str, str, float]]:
    """Each measure of one repetition, with its case and value."""
    for federates in effort.chains:
        found = run(programs.chain(coordination, federates, effort.tags, effort.warm_up))
        case, each = f"{federates} federates", list(found.values())
        yield LATENCY, case, statistics.median(found["last"]["times"]) / (federates - 1) / 1e3
        yield CPU, case, statistics.fmean(it["cpu"] for it in each) / effort.tags / 1e3
        yield MEMORY, case, statistics.fmean(it["kib"] for it in each) / 1024
    for federates in effort.meshes:
        found = run(programs.mesh(coordination, federates))
        kib = statistics.fmean(it["kib"] for it in found.values())
        yield LINKS, f"{federates} federates", kib / 1024
    for size in effort.sizes:
        count = max(100, min(effort.messages, effort.bytes_sent // size))
        sink = run(programs.pair(coordination, size, count))["sink"]
        yield RATE, sized(size), sink["messages"] / sink["passed"] * 1e6


def run(text: str) -> dict[str, dict[str, Any]]:
    """Run a federation to its end; return what its federates have written, by their names."""
    with tempfile.TemporaryDirectory(prefix="growth-") as folder:
        out = Path(folder, "out")
        out.mkdir()
        run_text(text, Path(folder), "Growth")
        return {it.stem: json.loads(it.read_text()) for it in out.iterdir()}


def sized(size: int) -> str:
    """A number of bytes in the unit that suits it."""
    for unit, bytes_of in (("MiB", 1 << 20), ("KiB", 1 << 10)):
        if size >= bytes_of:
            return f"{size // bytes_of} {unit}"
    return f"{size} B"
