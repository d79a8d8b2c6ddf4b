"""The results as tables: cells of text, which a terminal and a page show in their own ways."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import contenders as who
import rich.box
import rich.table
from figures import UNITS, Figure, Measurements, Spread
from goals import Goal, Verdict
from plan import WORKLOADS

TITLES = {
    "W1": "broadcast and gather, 4 nodes, each sends a copy back: a round",
    "W1b": "broadcast, 4 nodes, each acknowledges with 16 bytes: a round",
    "W2": "one-way latency (half of a round trip)",
    "W3": "placing an array in shared memory",
    "W4": "serialization of 5 MB, without and with a dict of ten arrays around",
    "W5": "messages a second of 1 KB at the slowest receiver",
    "W6": "an array there, 16 bytes back: a whole round",
}
BASES = {"W3": "memcpy, recycled", "W6": "iceoryx2"}
"""What ratios are to; the limit elsewhere."""
PLACES = {
    who.GATHER: "",
    who.SAME: ", both processes on one core",
    who.APART: ", one core each",
    who.FAN: ", 1 to 4",
    who.PLACE: "",
    who.ENCODE: "",
}


@dataclass(frozen=True)
class Table:
    """Rows of text under a heading. The first column is for names."""

    title: str
    columns: list[str]
    rows: list[list[str]]


def all_tables(measurements: Measurements, workloads: Sequence[str]) -> list[Table]:
    """A table for each workload and group, and its ratios to the limit where there is one.

    Those of W6 have sizes as rows and ratios to iceoryx2.
    """
    tables: list[Table] = []
    for workload in workloads:
        for group in WORKLOADS[workload]:
            figures = measurements.figures(workload, group)
            if not figures:
                continue
            found = [_values(measurements, workload, group, figures)]
            base = BASES.get(workload, "limit")
            if any(base in measurements.contenders(figure) for figure in figures):
                found.append(_ratios(measurements, workload, group, figures, base))
            tables += map(_turned, found) if workload == "W6" else found
    return tables


def heading(workload: str, group: str) -> str:
    """What is in a table, with the unit."""
    place = ", 1 to 1, one core each" if (workload, group) == ("W5", who.APART) else PLACES[group]
    return f"{workload} {TITLES[workload]}{place}, {UNITS[workload]}"


def label(case: int | str) -> str:
    """A size for people; other cases as they are."""
    if isinstance(case, str):
        return case
    if case % 2**20 == 0:  # W6 has powers of two
        return f"{case >> 20} MB"
    for unit, size in (("MB", 1_000_000), ("KB", 1024)):
        if case >= size:
            return f"{case / size:g} {unit}"
    return f"{case} B"


def number(value: float) -> str:
    """Three digits, more only before the point."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def order(measurements: Measurements, figures: Sequence[Figure]) -> list[str]:
    """The contenders of a table, the best first, by the last figure; in W6 as they are listed."""
    names = {name: None for figure in figures for name in measurements.contenders(figure)}
    if figures[0].workload == "W6":
        listed = [contender.name for contender in who.CONTENDERS if contender.by_size]
        return sorted(names, key=lambda name: listed.index(name) if name in listed else len(listed))
    most = figures[0].workload == "W5"

    def key(name: str) -> tuple[bool, float]:
        spread = measurements.spread(figures[-1], name)
        if spread is None:
            return True, 0.0
        return False, -spread.median if most else spread.median

    return sorted(names, key=key)


def _values(
    measurements: Measurements, workload: str, group: str, figures: Sequence[Figure]
) -> Table:
    with_p99 = workload == "W2"
    rows = []
    for name in order(measurements, figures):
        row = [name]
        for figure in figures:
            text = _spread(measurements.spread(figure, name))
            if with_p99 and (p99 := measurements.p99(figure, name)) is not None:
                text += f" / {number(p99)}"
            if lost := measurements.lost(figure, name):
                text += f" lost {lost:.1%}"
            row.append(text)
        rows.append(row)
    means = "median (least–greatest)" + (" / p99" if with_p99 else "")
    title = f"{heading(workload, group)}: {means}"
    return Table(title, ["", *(label(figure.case) for figure in figures)], rows)


def _ratios(
    measurements: Measurements, workload: str, group: str, figures: Sequence[Figure], base: str
) -> Table:
    rows = [
        [name, *(_spread(measurements.ratio(figure, name, base)) for figure in figures)]
        for name in order(measurements, figures)
        if name != base
    ]
    title = f"{workload}{PLACES[group]}, as a multiple of “{base}” in the same repetition"
    return Table(title, ["", *(label(figure.case) for figure in figures)], rows)


def _spread(spread: Spread | None) -> str:
    if spread is None:
        return "-"
    return f"{number(spread.median)} ({number(spread.least)}–{number(spread.greatest)})"


def _turned(table: Table) -> Table:
    """The same with its rows as columns."""
    rows = [
        [case, *(row[place] for row in table.rows)]
        for place, case in enumerate(table.columns)
        if place > 0
    ]
    return Table(table.title, ["", *(row[0] for row in table.rows)], rows)


def of_verdicts(verdicts: Sequence[Verdict]) -> Table:
    """The goals, what was measured, and whether it is enough."""
    rows = []
    for verdict in verdicts:
        goal = verdict.goal
        what = f"{goal.workload}{PLACES[goal.group]}, {label(goal.case)}"
        measured = _spread(verdict.measured)
        if verdict.at is not None:
            measured += f" at {label(verdict.at)}"
        rows.append([what, goal.contender, _relation(goal), measured, verdict.word])
    return Table("Goals", ["figure", "contender", "goal", "measured", ""], rows)


def _relation(goal: Goal) -> str:
    word = "at least" if goal.at_least else "at most"
    unit = f" {UNITS[goal.workload]}" if not goal.rival else f" of {goal.rival}"
    return f"{word} {goal.bound:g}{unit}"


def shown(table: Table) -> rich.table.Table:
    """A table for a terminal."""
    lines = rich.table.Table(title=table.title, title_justify="left", box=rich.box.SIMPLE_HEAD)
    for column in table.columns:
        lines.add_column(column)
    for row in table.rows:
        lines.add_row(*row)
    return lines
