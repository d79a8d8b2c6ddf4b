"""One page for all experiments, in HTML that needs nothing else; it names missing records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

from .experiment import Claim, Experiment, Section, Table
from .record import Record
from .texts import OURS

STYLE = """
body { font-family: Helvetica, Arial, sans-serif; margin: 2em auto; max-width: 66em; color: #222;
  padding: 0 1em; line-height: 1.4 }
table { border-collapse: collapse; margin: 0.5em 0 1.5em; font-size: 85% }
p.title { color: #666; font-size: 85%; margin: 0 }
th, td { padding: 0.25em 0.8em; text-align: right; border-bottom: 1px solid #e2e2e2 }
th:first-child, td:first-child { text-align: left }
tr.ours { background: #f3f7ea; font-weight: bold }
figure { margin: 1em 0 } figure svg { max-width: 100%; height: auto }
h2 { border-top: 2px solid #222; padding-top: 0.6em; margin-top: 2em }
p.quick { background: #fff3cd; padding: 0.5em 1em }
code { background: #f4f4f4; padding: 0.1em 0.3em }
li { margin-bottom: 0.4em }
"""
_INTRODUCTION = (
    "The experiments of the paper “HPRM: High-Performance Robotic Middleware for Intelligent "
    "Autonomous Systems”, made again on this machine. The paper's machine was a workstation "
    "with 10 cores and a GPU, so numbers of the two columns do not compare; ratios between "
    "contenders that were measured side by side do, as far as the sections say."
)
_QUICK = (
    "The quick form was run: one repetition of a few rounds, with the contenders that need "
    "nothing installed. It shows that everything works; its numbers say little."
)


def html(
    records: Mapping[str, Record], missing: Mapping[str, str], experiments: Sequence[Experiment]
) -> str:
    """The whole page, from the records by experiment and the reasons why there are none."""
    made = [it for it in experiments if it.name in records]
    sections = {it.name: it.section(records[it.name]) for it in made}
    quick = any(record.form == "quick" for record in records.values())
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8"><title>The evaluation of HPRM</title>',
        f"<style>{STYLE}</style></head><body>",
        "<h1>The evaluation of HPRM</h1>",
        f"<p>{escape(_INTRODUCTION)}</p>",
        *([f'<p class="quick">{escape(_QUICK)}</p>'] if quick else []),
        *_machines(records),
        _claims([claim for section in sections.values() for claim in section.claims]),
        *(_section(it, records[it.name], sections[it.name]) for it in made),
        *_missing(missing, experiments),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _machines(records: Mapping[str, Record]) -> list[str]:
    """The machine of each experiment; once, if all have the same but for the time."""
    told: dict[str, list[str]] = {}
    for name, record in records.items():
        about = {key: value for key, value in record.machine.items() if key != "date"}
        told.setdefault(", ".join(f"{key}: {it}" for key, it in about.items()), []).append(name)
    if len(told) == 1:
        return [f"<p>Measured on: {escape(next(iter(told)))}.</p>"]
    return [
        f"<p>Measured on ({escape(', '.join(names))}): {escape(text)}.</p>"
        for text, names in told.items()
    ]


def _claims(claims: Sequence[Claim]) -> str:
    rows = [[claim.what, claim.paper, claim.here] for claim in claims]
    title = "What the paper says in numbers, and what was measured here"
    return table_of(Table(title, ["", "paper", "here"], rows))


def _section(experiment: Experiment, record: Record, section: Section) -> str:
    minutes, seconds = divmod(round(record.seconds), 60)
    about = f"{record.machine.get('date', '')}, {minutes} min {seconds} s. {' '.join(record.notes)}"
    parts = [
        f'<h2 id="{experiment.name}">{escape(experiment.title)}</h2>',
        "<h3>In the paper</h3>",
        table_of(section.paper),
        "<h3>Here</h3>",
        f"<p><code>{escape(record.command)}</code> {escape(about)}</p>",
        *(f"<figure>\n{svg}</figure>" for svg in section.pictures),
        *(table_of(table) for table in section.tables),
        "<h3>What differs, and why</h3>",
        _list(section.differences),
    ]
    if record.absent:
        parts.append("<h3>Not measured</h3>")
        parts.append(_list(f"{name}: {reason}" for name, reason in record.absent.items()))
    return "\n".join(parts)


def _missing(missing: Mapping[str, str], experiments: Sequence[Experiment]) -> list[str]:
    if not missing:
        return []
    titles = {it.name: it.title for it in experiments}
    texts = [f"{titles[name]} ({name}): {reason}" for name, reason in missing.items()]
    return ["<h2>Experiments without results</h2>", _list(texts)]


def _list(texts: Iterable[str]) -> str:
    items = "\n".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>\n{items}\n</ul>"


def table_of(table: Table) -> str:
    """A table in HTML, below its title."""
    lines = [f'<p class="title">{escape(table.title)}</p>', "<table>"]
    lines.append("<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in table.columns) + "</tr>")
    for row in table.rows:
        mark = ' class="ours"' if row[0].startswith(OURS) else ""
        lines.append(f"<tr{mark}>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>")
    return "\n".join([*lines, "</table>"])
