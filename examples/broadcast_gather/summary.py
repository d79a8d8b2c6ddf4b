"""Numbers and text for people: what latencies amount to, and the table of them."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


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


def table(results: Mapping[str, Mapping[int, Summary]]) -> str:
    """One line per size, three columns per coordination, in milliseconds."""
    columns = ("min", "median", "p99")
    group_width = len(columns) * 10
    lines = [
        f"{'':>8}" + "".join(f"{name:>{group_width}}" for name in results),
        f"{'size':>8}" + "".join(f"{column:>10}" for _ in results for column in columns),
    ]
    sizes = next(iter(results.values())).keys()
    for size in sizes:
        row = [results[name][size] for name in results]
        cells = [f"{ms:10.2f}" for s in row for ms in (s.minimum, s.median, s.p99)]
        lines.append(f"{size:>5} MB" + "".join(cells))
    return "\n".join(lines)
