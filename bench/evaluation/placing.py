"""The object store: how long it takes to write an array where other processes can read it."""

from __future__ import annotations

import contenders as who

from .experiment import Claim, Effort, Experiment, Section, Table
from .record import Record
from .texts import by_case, paragraphs, times
from .workloads import measure as measure_workload

NAME = "store"
_TITLE = "Writing an array to shared memory"
_SEGMENTS, _PLASMA, _COPY, _LOAN = "shared_memory", "plasma", "hprm copy", "hprm loan"
_QUICK = (_SEGMENTS, _COPY, _LOAN)

PAPER = Table(
    "The paper's lines, ms; in the text: more than 40 and just under 10 at 50 MB; the rest is "
    "read off the picture",
    ["", "1 MB", "5 MB", "10 MB", "25 MB", "50 MB"],
    [
        ["Python's shared memory", "0.6", "4.5", "8.7", "21", "43"],
        ["Plasma", "0.3", "0.9", "1.7", "4.8", "11"],
    ],
)
DIFFERENCES = paragraphs("""
“shared_memory” does what the paper's program does: a new segment of
multiprocessing.shared_memory for each array, into which bytes are written that were pickled
before; pages that nobody has touched are most of that time. “shm + pickle” has the pickling in
it.

“plasma” is pyarrow 11, the last one that has it, with NumPy 1.26, in an environment of its own:
create, one copy, seal; the object is deleted afterwards, as in the paper.

HPRM has no store in a process of its own: each sender has its own memory, which is recycled.
“hprm copy” is an array of the program's own; “hprm loan” one that was made in the store, so
nothing has to be copied.

“memcpy, recycled” is what the copy alone costs on this machine; no method that copies can be
quicker.
""")


def measure(effort: Effort) -> Record:
    """Measures all methods in turn."""
    return measure_workload(NAME, "W3", who.PLACE, effort, _QUICK)


def section(record: Record) -> Section:
    """What the page says of it."""
    # What draws takes a second to import, also in processes that only measure.
    from . import charts

    picture = charts.lines(record, _TITLE, "ms")
    tables = by_case(record, f"{_TITLE}, ms", "memcpy, recycled")
    return Section(PAPER, tables, [picture], _claims(record), DIFFERENCES)


def _claims(record: Record) -> list[Claim]:
    said = ((_SEGMENTS, _PLASMA, "4x"), (_SEGMENTS, _COPY, "–"), (_PLASMA, _COPY, "–"))
    claims = [
        Claim(
            f"store, 50 MB: “{slower}” takes this many times as long as “{quicker}”",
            paper,
            times(record.ratio(slower, quicker, "50 MB")),
        )
        for slower, quicker, paper in said
    ]
    loan = record.spread(_LOAN, "50 MB")
    if loan:
        claims.append(Claim("store, 50 MB: a loan of HPRM, ms", "–", f"{loan.median:.3g}"))
    return claims


EXPERIMENT = Experiment(NAME, "The object store", measure, section)
