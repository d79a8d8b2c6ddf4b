"""Numbers as texts, and the tables that all experiments have."""

from __future__ import annotations

from figures import Spread
from tables import number

from .experiment import Table
from .record import Record

OURS = "hprm"
"""What the names of our contenders begin with."""


def paragraphs(text: str) -> list[str]:
    """The paragraphs of a text that is broken into lines, each as one line."""
    return [" ".join(it.split()) for it in text.strip().split("\n\n")]


def shown(spread: Spread | None) -> str:
    """A median with its extremes, if there is one."""
    if spread is None:
        return "–"
    if spread.least == spread.greatest:
        return number(spread.median)
    return f"{number(spread.median)} ({number(spread.least)}–{number(spread.greatest)})"


def times(ratio: float | None) -> str:
    """How many times as much, for people."""
    return "not measured" if ratio is None else f"{number(ratio)}x"


def less(ratio: float | None) -> str:
    """How much less than all a part is."""
    return "not measured" if ratio is None else f"{100 * (1 - ratio):.1f} %"


def by_case(
    record: Record, title: str, base: str | None = None, order: str | None = None
) -> list[Table]:
    """A row for each contender, a column for each case; then as multiples of a contender."""
    cases, names = record.cases(), best_first(record, order)
    rows = [[name, *(shown(record.spread(name, case)) for case in cases)] for name in names]
    tables = [Table(f"{title}: median (least–greatest) of the repetitions", ["", *cases], rows)]
    if base in names and len(names) > 1:
        ratios = [
            [name, *(_ratio(record, name, base, case) for case in cases)]
            for name in names
            if name != base
        ]
        tables.append(
            Table(f"as a multiple of “{base}” in the same repetition", ["", *cases], ratios)
        )
    return tables


def best_first(record: Record, case: str | None = None) -> list[str]:
    """All contenders by what they have in a case: the last one, if none is named."""
    case = case or record.cases()[-1]

    def key(name: str) -> tuple[bool, float]:
        spread = record.spread(name, case)
        return spread is None, spread.median if spread else 0.0

    return sorted(record.contenders(), key=key)


def _ratio(record: Record, name: str, base: str | None, case: str) -> str:
    ratio = record.ratio(name, base, case) if base else None
    return "–" if ratio is None else number(ratio)
