"""What is measured: the cells of each group, how often, and for how long at most."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import contenders as who

SIZES_MB = (1, 5, 10, 25, 50)
SMALL = (64, 1024, 65_536)
RATE_SIZE = 1024
POWERS = tuple(2**power for power in range(6, 27))
"""The sizes of W6: 64 B to 64 MB."""
_LARGE = 2**20
"""From that size on, W6 has a tenth of the rounds."""
WORKLOADS = {
    "W1": (who.GATHER,),
    "W1b": (who.GATHER,),
    "W2": (who.SAME, who.APART),
    "W3": (who.PLACE,),
    "W4": (who.ENCODE,),
    "W5": (who.APART, who.FAN),
    "W6": (who.SAME, who.APART),
}
"""The groups in which each workload is run."""

NODES = {who.GATHER: 4, who.SAME: 1, who.APART: 1, who.FAN: 4}
CPUS = {who.SAME: (0, 0), who.APART: (0, 1)}
"""On which of the processors that may be used hub and node stay; elsewhere they are free."""


@dataclass(frozen=True)
class Effort:
    """How much is done for each figure."""

    repetitions: int
    rounds: int
    """Of large messages, and of placing; of small ones there are fifty times as many."""
    budget_s: float
    """A cell ends after that time, however many rounds it has had."""
    session_limit_s: float
    """A contender that needs longer for a group is ended; what it has measured counts."""
    total_limit_s: float
    """No repetition begins that would not end within that time."""
    sizes_mb: tuple[int, ...] = SIZES_MB
    """Of large messages, and of what is placed."""


FULL = Effort(5, rounds=30, budget_s=0.35, session_limit_s=60, total_limit_s=28 * 60)
QUICK = Effort(1, rounds=5, budget_s=0.1, session_limit_s=30, total_limit_s=4.5 * 60)


def groups_of(workloads: list[str]) -> list[str]:
    """The groups that have to be run for these workloads, in a fixed order."""
    wanted = {group for workload in workloads for group in WORKLOADS[workload]}
    return [group for group in who.GROUPS if group in wanted]


def possible(group: str, processors: int) -> bool:
    """Whether there are as many processors as the group wants to tell apart."""
    return max(CPUS.get(group, (0,))) < processors


def cells(group: str, workloads: Collection[str], effort: Effort) -> list[dict[str, Any]]:
    """What the hub of a session of this group measures; `worker/script.py` says how."""
    planned: list[dict[str, Any]] = []

    def add(workload: str, size: int, rounds: int, warm_up: int) -> None:
        if workload in workloads:
            cell = {"workload": workload, "size": size, "rounds": rounds, "warm_up": warm_up}
            planned.append(cell | {"budget_s": effort.budget_s})

    if group == who.GATHER:
        for megabytes in effort.sizes_mb:
            add("W1", megabytes * 1_000_000, effort.rounds, 3)
            add("W1b", megabytes * 1_000_000, effort.rounds, 3)
    if group in (who.SAME, who.APART):
        for size in SMALL:
            add("W2", size, effort.rounds * 50, effort.rounds * 5)
    if group in (who.APART, who.FAN):
        add("W5", RATE_SIZE, 0, 0)
    if group in (who.SAME, who.APART):
        for size in POWERS:
            often, warm_up = (10, effort.rounds) if size < _LARGE else (1, 3)
            add("W6", size, effort.rounds * often, warm_up)
    if group == who.PLACE:
        for megabytes in effort.sizes_mb:
            add("W3", megabytes * 1_000_000, effort.rounds, 3)
    if group == who.ENCODE:
        add("W4", 5_000_000, effort.rounds * 10, effort.rounds)
    return planned
