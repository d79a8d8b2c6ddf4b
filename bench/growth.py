"""What HPRM costs as federations and messages grow: pictures and tables on one page.

Run by `make bench-growth`. Chains of up to 64 federates show what a hop takes and how much CPU time
each federate needs for a tag; their memory, and that of federates that are linked with all others,
shows what a link adds; a pair shows how many messages of each size go through a connection. It
states figures, and is no test. What 1,000 federates cost, `make bench-grants` simulates.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path

import growing
import machine
from evaluation import charts
from evaluation.page import STYLE, table_of
from evaluation.record import Record
from evaluation.texts import by_case
from federation import FederationError, command
from growing.measures import COORDINATIONS, FULL, QUICK, TITLES, take
from options import positive
from shown import show

OUT = growing.ROOT / "out" / "growth"
_NOTE = (
    "Federates are processes in Python, started by hprm run. In a chain, each forwards what it has"
    " read, every 20 ms; one hop is the time from the first to the last, divided by their number."
    " Memory is that which a process has for itself and its part of what several share, without the"
    " pages of files, which are the interpreter and libraries."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, and write the page; return the exit code."""
    options = parse(argv)
    effort = QUICK if options.quick else FULL
    if options.repetitions:
        effort = replace(effort, repetitions=options.repetitions)
    begun = time.monotonic()
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        about = machine.describe(command())
        measured = take(effort, lambda text: print(text, flush=True))
        form, passed = "quick" if options.quick else "full", time.monotonic() - begun
        records = {it: Record(it, form, about, passed, cells) for it, cells in measured.items()}
        for record in records.values():
            record.save(options.out)
        page = options.out / "index.html"
        page.write_text(html(records))
    except (FederationError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    for name, record in records.items():
        print_table(name, record)
    print(f"wrote {page}")
    return 0


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="growth.py", description="what growth costs")
    parser.add_argument("--quick", action="store_true", help="a little of all: does it work?")
    parser.add_argument("--repetitions", type=positive, metavar="N", help="of all, in turn")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="for all files")
    return parser.parse_args(argv)


def print_table(name: str, record: Record) -> None:
    """Print the medians of one measure: a row for each case."""
    title, unit = TITLES[name]
    rows = [[case, *(_median(record, it, case) for it in COORDINATIONS)] for case in record.cases()]
    show(f"{title}, {unit}", ["", *COORDINATIONS], rows)


def _median(record: Record, coordination: str, case: str) -> str:
    spread = record.spread(f"hprm {coordination}", case)
    return f"{spread.median:.3g}" if spread else "–"


def html(records: Mapping[str, Record]) -> str:
    """Return the page."""
    about = next(iter(records.values())).machine
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8"><title>What growth costs</title>',
        f"<style>{STYLE}</style></head><body>",
        "<h1>What growth costs</h1>",
        f"<p>{escape(', '.join(f'{key}: {value}' for key, value in about.items()))}</p>",
        f"<p>{escape(_NOTE)}</p>",
    ]
    for name, record in records.items():
        title, unit = TITLES[name]
        parts.append(f"<h2>{escape(title)}</h2>")
        parts.append(f"<figure>\n{charts.lines(record, title, unit)}</figure>")
        parts += [table_of(it) for it in by_case(record, f"{title}, {unit}")]
    return "\n".join([*parts, "</body></html>"]) + "\n"


if __name__ == "__main__":
    sys.exit(main())
