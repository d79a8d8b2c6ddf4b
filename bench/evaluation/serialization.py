"""Serialization: 5 MB as one array, and in a dict with ten arrays, there and back."""

from __future__ import annotations

import contenders as who

from .experiment import Claim, Effort, Experiment, Section, Table
from .record import Record
from .texts import OURS, best_first, by_case, paragraphs, times
from .workloads import measure as measure_workload

NAME = "serialization"
_TITLE = "Serialization of 5 MB"
_OUT_OF_BAND, _IN_BAND = "pickle 5 out of band", "pickle 5 in band"
_CHECKED = "ros2 message, bytes checked"
_ORDER = "array, out"
_MB = 5.0
_QUICK = (OURS, _OUT_OF_BAND, _IN_BAND)

PAPER = Table(
    "The paper's bars: MB/s for an array of 5 MB",
    ["", "serialize", "deserialize"],
    [
        ["ROS2 NumPy", "17.99", "138,884"],
        ["in band", "5,140", "20,321"],
        ["out of band (HPRM)", "252,669", "411,206"],
    ],
)
DIFFERENCES = paragraphs("""
Times are medians of many calls; the paper measured one call of each.

“hprm” and “pickle 5 out of band” describe a value and leave the bytes of its arrays where they
are; what it takes to put them where another process reads them is the experiment “store”.

The messages of ROS 2 are classes of rosbags, which need no ROS 2. “ros2 message” converts an
array to the bytes of an Image and back, as ros2_numpy does; “bytes checked” also checks each
byte, as rclpy's classes do when bytes are assigned, which is what the paper's figure for ROS2
NumPy consists of; “CDR” also makes the bytes that travel. “ros2_numpy” is the package itself,
where it can be imported. Without the CDR nothing has to be read back: an array is made over the
bytes of the message, here as in the paper.

Dividing 5 MB by a time gives a throughput even where no byte is touched; it is here because the
paper has it.
""")


def measure(effort: Effort) -> Record:
    """Measures all methods in turn."""
    return measure_workload(NAME, "W4", who.ENCODE, effort, _QUICK)


def section(record: Record) -> Section:
    """What the page says of it."""
    # What draws takes a second to import, also in processes that only measure.
    import picture

    cases, names = record.cases(), best_first(record, _ORDER)
    rows = [
        picture.Row(name, name.startswith(OURS), [record.spread(name, case) for case in cases])
        for name in names
    ]
    drawn = picture.svg(f"{_TITLE}, there (out) and back (in)", "µs", cases, rows)
    rates = [[name, *(_rate(record, name, case) for case in cases)] for name in names]
    tables = by_case(record, f"{_TITLE}, µs", OURS, _ORDER)
    tables.append(Table("the same as MB/s", ["", *cases], rates))
    return Section(PAPER, tables, [drawn], _claims(record), DIFFERENCES)


def _rate(record: Record, name: str, case: str) -> str:
    spread = record.spread(name, case)
    return f"{_MB / spread.median * 1e6:,.0f}" if spread else "–"


def _claims(record: Record) -> list[Claim]:
    said = (
        (_CHECKED, "array, out", "serialize", "14,045x"),
        (_IN_BAND, "array, out", "serialize", "49.2x"),
        (_CHECKED, "array, in", "deserialize", "2.96x"),
        (_IN_BAND, "array, in", "deserialize", "20.2x"),
    )
    claims = [
        Claim(
            f"{verb} 5 MB: “{rival}” takes this many times as long as “{base}”",
            paper if base == _OUT_OF_BAND else "–",
            times(record.ratio(rival, base, case)),
        )
        for rival, case, verb, paper in said
        for base in (_OUT_OF_BAND, OURS)
    ]
    ratio = record.ratio("protobuf", OURS, "dict of ten, out")
    what = "serialize a dict of ten arrays: “protobuf” takes this many times as long as HPRM"
    return [*claims, Claim(what, "–", times(ratio))]


EXPERIMENT = Experiment(NAME, "Adaptive serialization", measure, section)
