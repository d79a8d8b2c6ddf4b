"""What is aimed at, as ratios in one run, and whether it was reached.

A goal that nobody has measured is stated all the same: silence would look like success.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import contenders as who
from figures import Figure, Measurements, Spread
from plan import POWERS

MB = 1_000_000
OURS = tuple(
    contender.name
    for contender in who.CONTENDERS
    if contender.ours and who.GATHER in contender.groups
)
"""The ways to run HPRM that all goals are for."""

NOT_PEERS = {"limit", "limit spinning"} | {
    contender.name for contender in who.CONTENDERS if contender.ours
}
"""HPRM itself, and what is nothing that a user could pick instead."""


EVERY_SIZE = "every size"
"""The case of a goal that has to be met at all sizes of W6."""


@dataclass(frozen=True)
class Goal:
    """A contender's figure as a multiple of a rival's is at most, or at least, a number."""

    workload: str
    group: str
    case: int | str
    contender: str
    rival: str
    """Nobody: then the figure itself is meant. ``best peer``: whoever is best in a repetition."""
    bound: float
    at_least: bool = False

    @property
    def figure(self) -> Figure:
        """What it is about."""
        return Figure(self.workload, self.group, self.case)


@dataclass(frozen=True)
class Verdict:
    """A goal, what was measured, if it was, and whether that is enough."""

    goal: Goal
    measured: Spread | None
    at: int | None = None
    """The size that `measured` is from: the worst one, if the goal is about every size."""

    @property
    def word(self) -> str:
        """For people."""
        if self.measured is None:
            return "not measured"
        reached = self.measured.median
        met = reached >= self.goal.bound if self.goal.at_least else reached <= self.goal.bound
        return "met" if met else "missed"


BEST_PEER = "best peer"


def goals() -> Iterator[Goal]:
    """All goals, by workload."""
    for ours in OURS:
        yield from _of_a_way(ours)
    cen, dec = "hprm centralized", "hprm decentralized"
    yield Goal("W2", who.APART, 64, "hprm spinning", "iceoryx2 polling", 0.8)
    yield Goal("W2", who.SAME, 64, cen, dec, 1.15)
    yield Goal("W2", who.APART, 64, cen, dec, 1.15)
    yield Goal("W2", who.APART, 64, "hprm spinning centralized", "hprm spinning", 1.15)
    for size in (1, 5, 10, 25, 50):
        yield Goal("W3", who.PLACE, size * MB, "hprm loan", "", 0.05)
    for size in (1, 5, 10, 25, 50):
        yield Goal("W3", who.PLACE, size * MB, "hprm copy", "memcpy, recycled", 1.15)
    for case in ("array, out", "array, in", "dict of ten, out", "dict of ten, in"):
        yield Goal("W4", who.ENCODE, case, "hprm", "pickle 5 out of band", 0.5)


def _of_a_way(ours: str) -> Iterator[Goal]:
    for size, bound in ((1, 0.95), (10, 0.5), (25, 0.5), (50, 0.5)):
        yield Goal("W1", who.GATHER, size * MB, ours, "iceoryx2", bound)
    for size in (1, 5, 10, 25, 50):
        yield Goal("W1b", who.GATHER, size * MB, ours, "iceoryx2", 1.0)
    yield Goal("W1", who.GATHER, 50 * MB, ours, "unix + pickle", 0.125)
    yield Goal("W2", who.SAME, 64, ours, "iceoryx2", 0.8)
    yield Goal("W2", who.APART, 64, ours, "iceoryx2", 1.0)
    for group in (who.SAME, who.APART):
        yield Goal("W6", group, EVERY_SIZE, ours, "iceoryx2", 1.0)
    for group in (who.APART, who.FAN):
        yield Goal("W5", group, 1024, ours, BEST_PEER, 1.0, at_least=True)


def judge(measurements: Measurements, workloads: Sequence[str]) -> list[Verdict]:
    """What became of the goals of these workloads."""
    return [_verdict(measurements, goal) for goal in goals() if goal.workload in workloads]


def _verdict(measurements: Measurements, goal: Goal) -> Verdict:
    if goal.case == EVERY_SIZE:
        return _at_the_worst(measurements, goal)
    return Verdict(goal, _measured(measurements, goal))


def _at_the_worst(measurements: Measurements, goal: Goal) -> Verdict:
    """One size can miss the goal; only all of them can meet it."""
    ratios = {}
    for size in POWERS:
        figure = Figure(goal.workload, goal.group, size)
        if (ratio := measurements.ratio(figure, goal.contender, goal.rival)) is not None:
            ratios[size] = ratio
    if not ratios:
        return Verdict(goal, None)
    at = max(ratios, key=lambda size: ratios[size].median)
    verdict = Verdict(goal, ratios[at], at)
    incomplete = len(ratios) < len(POWERS)
    return Verdict(goal, None) if incomplete and verdict.word == "met" else verdict


def _measured(measurements: Measurements, goal: Goal) -> Spread | None:
    if not goal.rival:
        return measurements.spread(goal.figure, goal.contender)
    if goal.rival != BEST_PEER:
        return measurements.ratio(goal.figure, goal.contender, goal.rival)
    peers = [name for name in measurements.contenders(goal.figure) if name not in NOT_PEERS]
    return measurements.ratio_to_best(goal.figure, goal.contender, peers, most=goal.at_least)
