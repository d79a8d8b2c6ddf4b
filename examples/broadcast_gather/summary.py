"""Numbers for people: what latencies amount to, and the table of them."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.table import Table


@dataclass(frozen=True)
class Summary:
    """The latencies of one size under one coordination, in milliseconds."""

    minimum: float
    median: float
    p99: float
    rounds: int


def summarize(latencies_ns: Sequence[int]) -> Summary:
    """Sums up raw latencies. The 99th percentile is a round that was measured (nearest rank)."""
    ordered = sorted(latencies_ns)
    rank = math.ceil(0.99 * len(ordered)) - 1
    return Summary(
        minimum=ordered[0] / 1e6,
        median=statistics.median(ordered) / 1e6,
        p99=ordered[rank] / 1e6,
        rounds=len(ordered),
    )


def table(results: Mapping[str, Mapping[int, Summary]]) -> Table:
    """One line per size, three columns per coordination, in milliseconds."""
    shown = Table(box=box.SIMPLE_HEAD)
    shown.add_column("size")
    for name in results:
        for column in ("\nmin", f"{name}\nmedian", "\np99"):
            shown.add_column(column, justify="right")
    for size in next(iter(results.values())):
        row = [results[name][size] for name in results]
        cells = [f"{ms:.2f}" for it in row for ms in (it.minimum, it.median, it.p99)]
        shown.add_row(f"{size} MB", *cells)
    return shown
