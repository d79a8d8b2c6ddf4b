"""From raw results to figures: what a repetition amounts to, medians over them, and ratios.

A repetition counts with one value for each figure. What is stated is the median over the
repetitions, with the least and the greatest. Ratios are taken within a repetition, so that what the
machine did at the time meets both sides. No processes and no text are in here.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

UNITS = {
    "W1": "ms",
    "W1b": "ms",
    "W2": "µs",
    "W3": "ms",
    "W4": "µs",
    "W5": "thousand/s",
    "W6": "µs",
}
_NS_PER = {"ms": 1e6, "µs": 1e3}


class Figure(NamedTuple):
    """What is compared: a workload in a group, for one size or case."""

    workload: str
    group: str
    case: int | str


@dataclass(frozen=True)
class Value:
    """What one repetition of one contender says of a figure, in the workload's unit."""

    value: float
    p99: float
    rounds: int
    lost: int = 0
    """Messages that were sent and did not arrive."""


class Spread(NamedTuple):
    """A median, the least and the greatest."""

    median: float
    least: float
    greatest: float


def value_of(result: Mapping[str, Any]) -> Value:
    """Sums up one cell of one repetition."""
    workload = result["workload"]
    if workload == "W5":
        slowest = min(result["received"])
        rate = slowest / result["seconds"] / 1e3
        return Value(rate, rate, result["sent"], result["sent"] - slowest)
    times = sorted(result["times_ns"])
    # A round trip of W2 is two messages of one size; W6 counts whole rounds.
    scale = _NS_PER[UNITS[workload]] * (2 if workload == "W2" else 1)
    rank = math.ceil(0.99 * len(times)) - 1
    return Value(statistics.median(times) / scale, times[rank] / scale, len(times))


def spread(values: Sequence[float]) -> Spread:
    """The median of some values, and how far they reach."""
    return Spread(statistics.median(values), min(values), max(values))


class Measurements:
    """The values of all figures, by contender and repetition."""

    def __init__(self) -> None:
        """Has none yet."""
        self._values: dict[Figure, dict[str, dict[int, Value]]] = {}

    def add(self, group: str, contender: str, repetition: int, result: Mapping[str, Any]) -> None:
        """Takes the result of one cell."""
        figure = Figure(result["workload"], group, result["size"])
        by_contender = self._values.setdefault(figure, {})
        by_contender.setdefault(contender, {})[repetition] = value_of(result)

    def figures(self, workload: str, group: str) -> list[Figure]:
        """The figures of a workload in a group, in the order in which they were measured."""
        return [figure for figure in self._values if figure[:2] == (workload, group)]

    def contenders(self, figure: Figure) -> list[str]:
        """Who has a value for it."""
        return list(self._values.get(figure, {}))

    def spread(self, figure: Figure, contender: str) -> Spread | None:
        """The median over the repetitions, if there are any."""
        values = self._values.get(figure, {}).get(contender)
        return spread([value.value for value in values.values()]) if values else None

    def p99(self, figure: Figure, contender: str) -> float | None:
        """The median of the repetitions' 99th percentiles, if there are any."""
        values = self._values.get(figure, {}).get(contender)
        return statistics.median(value.p99 for value in values.values()) if values else None

    def lost(self, figure: Figure, contender: str) -> float:
        """Which part of all messages was lost."""
        values = self._values.get(figure, {}).get(contender, {}).values()
        sent = sum(value.rounds for value in values)
        return sum(value.lost for value in values) / sent if sent else 0.0

    def ratio(self, figure: Figure, contender: str, rival: str) -> Spread | None:
        """The contender's value as a multiple of the rival's in the same repetition."""
        by_contender = self._values.get(figure, {})
        ours, theirs = by_contender.get(contender, {}), by_contender.get(rival, {})
        ratios = [ours[at].value / theirs[at].value for at in ours if at in theirs]
        return spread(ratios) if ratios else None

    def ratio_to_best(
        self, figure: Figure, contender: str, rivals: Sequence[str], most: bool
    ) -> Spread | None:
        """As `ratio`, with the rival that was best in each repetition."""
        by_contender = self._values.get(figure, {})
        ratios = []
        for repetition, value in by_contender.get(contender, {}).items():
            theirs = [
                by_contender[rival][repetition].value
                for rival in rivals
                if repetition in by_contender.get(rival, {})
            ]
            if theirs:
                ratios.append(value.value / (max(theirs) if most else min(theirs)))
        return spread(ratios) if ratios else None

    def as_json(self) -> list[dict[str, Any]]:
        """All values, for a file."""
        return [
            {
                "workload": figure.workload,
                "group": figure.group,
                "case": figure.case,
                "unit": UNITS[figure.workload],
                "contender": contender,
                "repetitions": [
                    {"repetition": at, **value.__dict__} for at, value in sorted(values.items())
                ],
            }
            for figure, by_contender in self._values.items()
            for contender, values in by_contender.items()
        ]
