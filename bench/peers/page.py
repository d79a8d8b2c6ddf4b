"""One page of results: tables and pictures in an HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import picture
import picture_by_size
from figures import UNITS, Figure, Measurements
from goals import OURS
from plan import WORKLOADS
from tables import BASES, PLACES, TITLES, Table, heading, label, order

_STYLE = """
body { font-family: Helvetica, Arial, sans-serif; margin: 2em auto; max-width: 72em; color: #222 }
table { border-collapse: collapse; margin: 0.5em 0 2em; font-size: 85% }
th, td { padding: 0.25em 0.8em; text-align: right; border-bottom: 1px solid #e2e2e2 }
th:first-child, td:first-child { text-align: left }
tr.ours { background: #f3f7ea; font-weight: bold }
td.met { color: #00734f } td.missed { color: #c04000 }
figure { margin: 1em 0 }
"""


def html(
    measurements: Measurements,
    workloads: Sequence[str],
    tables: Sequence[Table],
    about: Mapping[str, Any],
    notes: Sequence[str],
) -> str:
    """The whole page."""
    machine = ", ".join(f"{key}: {value}" for key, value in about.items())
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8"><title>HPRM and its peers</title>',
        f"<style>{_STYLE}</style></head><body>",
        "<h1>HPRM and its peers</h1>",
        f"<p>{escape(machine)}</p>",
        *(f"<p>{escape(note)}</p>" for note in notes),
        *(f"<figure>\n{svg}</figure>" for svg in pictures(measurements, workloads)),
        *(_table(table) for table in tables),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def pictures(measurements: Measurements, workloads: Sequence[str]) -> list[str]:
    """A picture for each workload and group that has been measured; one for all groups of W6."""
    drawn = []
    for workload in workloads:
        if workload == "W6":
            drawn += _by_size(measurements)
            continue
        for group in WORKLOADS[workload]:
            figures = measurements.figures(workload, group)
            if not figures:
                continue
            rows = [
                picture.Row(
                    name,
                    _ours(name),
                    [measurements.spread(figure, name) for figure in figures],
                )
                for name in order(measurements, figures)
            ]
            columns = [label(figure.case) for figure in figures]
            title = heading(workload, group)
            drawn.append(picture.svg(title, UNITS[workload], columns, rows))
    return drawn


def _by_size(measurements: Measurements) -> list[str]:
    """One picture of W6, with a panel for each group that has been measured."""
    panels = [
        picture_by_size.Panel(
            PLACES[group].removeprefix(", "),
            [_line(measurements, figures, name) for name in order(measurements, figures)],
        )
        for group in WORKLOADS["W6"]
        if (figures := measurements.figures("W6", group))
    ]
    title = f"W6 {TITLES['W6']}, by size"
    return [picture_by_size.svg(title, UNITS["W6"], BASES["W6"], panels)] if panels else []


def _line(measurements: Measurements, figures: Sequence[Figure], name: str) -> picture_by_size.Line:
    rival = BASES["W6"]
    times, ratios = {}, {}
    for figure in figures:
        size = int(figure.case)
        if (time := measurements.spread(figure, name)) is not None:
            times[size] = time
        if name != rival and (ratio := measurements.ratio(figure, name, rival)) is not None:
            ratios[size] = ratio
    return picture_by_size.Line(name, _ours(name), times, ratios)


def _ours(name: str) -> bool:
    return name in OURS or name.startswith("hprm")


def _table(table: Table) -> str:
    lines = [f"<h2>{escape(table.title)}</h2>", "<table>"]
    lines.append("<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in table.columns) + "</tr>")
    for row in table.rows:
        mark = ' class="ours"' if _ours(row[0]) else ""
        cells = "".join(_cell(text) for text in row)
        lines.append(f"<tr{mark}>{cells}</tr>")
    return "\n".join([*lines, "</table>"])


def _cell(text: str) -> str:
    mark = f' class="{text}"' if text in ("met", "missed") else ""
    return f"<td{mark}>{escape(text)}</td>"
