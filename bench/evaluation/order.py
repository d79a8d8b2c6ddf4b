"""The order of messages: how many are handled out of order, with tags and without."""

from __future__ import annotations

import argparse
import time

import federation
import machine
import ordering
from busy import busy

from .experiment import Claim, Effort, Experiment, ExperimentError, Section, Table
from .record import Cell, Record
from .texts import paragraphs
from .workloads import hprm

NAME = "ordering"
_MESSAGES, _QUICK_MESSAGES, _QUICK_PERIODS = 300_000, 2_000, [1.0]

PAPER = Table(
    "The paper's text, from a study that it cites: messages out of order of 300,000",
    ["", "out of order", "noticed"],
    [
        ["ROS 2, with little load", "600 (0.2 %)", "none"],
        ["ROS 2, with much load", "a hundred times as many", "none"],
        ["centralized", "0", "–"],
        ["decentralized, from 1 ms", "0", "–"],
        ["decentralized, below 1 ms", "some", "all"],
    ],
)
DIFFERENCES = paragraphs("""
The program is that of `bench/Ordering.lf`: numbers on three ways of different length that meet
again, in two subscribers, while as many busy loops run as there are processors. Tagged runs
share the 300,000 messages; each untagged one has as many as one tagged one.

Without tags there is no order among ways that a program could refer to; what is counted is
messages of an earlier step than one that was handled already, as in the study.

A decentralized federate that waits for ever gives up no order; with a limit of 1 or 5 ms it
gives up waiting, and its handler runs for what comes later (“noticed”).
""")


def measure(effort: Effort) -> Record:
    """Runs the program with tags in each way, and its peers without."""
    began = time.monotonic()
    there = ordering.contenders(with_untagged=True)
    names = effort.contenders or [""]
    chosen = {it: run for it, run in there.items() if any(name in it for name in names)}
    if not chosen:
        raise ExperimentError(f"{NAME}: no contender has one of these names: {names}")
    options = argparse.Namespace(
        messages=_QUICK_MESSAGES if effort.quick else _MESSAGES,
        periods=_QUICK_PERIODS if effort.quick else list(ordering.SHARES),
    )
    loops = 0 if effort.quick else machine.describe(hprm())["cpus"]
    try:
        with busy(loops):
            rows = ordering.measure(options, chosen)
    except federation.FederationError as error:
        raise ExperimentError(f"{NAME}: {error}") from None
    absent = {} if "pyzmq PUB/SUB" in there else {"pyzmq PUB/SUB": "pyzmq is not installed"}
    return Record(
        NAME,
        effort.form,
        machine.describe(hprm()),
        time.monotonic() - began,
        [_cell(row) for row in rows],
        absent,
        [f"Beside {loops} busy loops."],
    )


def _cell(row: dict[str, float]) -> Cell:
    counts = {
        "messages": row["messages"],
        "unnoticed": row.get("undetected", row.get("out_of_order", 0)),
        "seconds": row["seconds"],
    }
    if "tardy" in row:
        counts["noticed"] = row["tardy"]
    case, contender = f"{row['period_ms']:g} ms", str(row["contender"])
    return Cell(contender, case, "messages", {0: counts["unnoticed"]}, counts=counts)


def section(record: Record) -> Section:
    """What the page says of it."""
    rows = [[name, *_sums(record, name)] for name in record.contenders()]
    columns = ["", "messages", "unnoticed", "share", "noticed", "messages/s"]
    details = [
        [name, *(_of(record, name, case) for case in record.cases())]
        for name in record.contenders()
    ]
    title = "by the time between two steps: unnoticed + noticed of all messages"
    tables = [
        Table("Messages out of order", columns, rows),
        Table(title, ["", *record.cases()], details),
    ]
    return Section(PAPER, tables, [], _claims(record), DIFFERENCES)


def _total(record: Record, name: str, count: str) -> float | None:
    counts = [cell.counts for cell in record.cells if cell.contender == name]
    if not any(count in it for it in counts):
        return None
    return sum(it.get(count, 0) for it in counts)


def _sums(record: Record, name: str) -> list[str]:
    messages, unnoticed, seconds, noticed = (
        _total(record, name, count) for count in ("messages", "unnoticed", "seconds", "noticed")
    )
    if not messages or unnoticed is None or not seconds:
        raise ExperimentError(f"{NAME}: {name} has handled no message")
    told = "–" if noticed is None else f"{noticed:,.0f}"
    share = f"{100 * unnoticed / messages:.3g} %"
    return [f"{messages:,.0f}", f"{unnoticed:,.0f}", share, told, f"{messages / seconds:,.0f}"]


def _of(record: Record, name: str, case: str) -> str:
    cell = record.cell(name, case)
    if cell is None:
        return "–"
    counts = cell.counts
    noticed = f" + {counts['noticed']:.0f}" if "noticed" in counts else ""
    return f"{counts['unnoticed']:.0f}{noticed} of {counts['messages']:.0f}"


def _claims(record: Record) -> list[Claim]:
    tagged = [name for name in record.contenders() if name.startswith("hprm")]
    claims = []
    for what, names, paper in (
        ("with tags", tagged, "0 of 300,000"),
        ("without tags", [it for it in record.contenders() if it not in tagged], "0.2 % to 20 %"),
    ):
        messages = sum(_total(record, name, "messages") or 0 for name in names)
        unnoticed = sum(_total(record, name, "unnoticed") or 0 for name in names)
        share = f" ({100 * unnoticed / messages:.3g} %)" if unnoticed and messages else ""
        here = f"{unnoticed:,.0f} of {messages:,.0f}{share}"
        claims.append(Claim(f"ordering {what}: messages out of order, unnoticed", paper, here))
    return claims


EXPERIMENT = Experiment(NAME, "The order of messages", measure, section)
