"""Broadcast and gather: arrays of 1 to 50 MB to four nodes, each of which sends a copy back."""

from __future__ import annotations

import contenders as who

from .experiment import Claim, Effort, Experiment, Section, Table
from .record import Record
from .texts import by_case, paragraphs, times
from .workloads import measure as measure_workload

NAME = "gather"
_TITLE = "Broadcast and gather, 4 nodes, each sends a copy back"
_OURS = ("hprm centralized", "hprm decentralized")
_QUICK = (*_OURS, "unix + pickle")
_ROS, _SHM, _DDS = "ros2", "ros2 + shm", "cyclonedds"

PAPER = Table(
    "The paper's bars, ms; in the text: 1,161 (ROS 2, 10 MB), 7,723 and 44.6 (ROS 2 and HPRM, "
    "50 MB); the rest is read off the picture",
    ["", "1 MB", "5 MB", "10 MB", "25 MB", "50 MB"],
    [
        ["ROS 2 Humble", "147", "580", "1,161", "3,800", "7,723"],
        ["ROS 2 Humble (shared memory)", "6.8", "19", "29", "72", "132"],
        ["HPRM centralized", "18", "22", "35", "40", "57"],
        ["HPRM decentralized", "4.8", "13", "15", "22", "44.6"],
    ],
)
DIFFERENCES = paragraphs("""
The paper's clients sleep for 0.5 s in each round, which is subtracted there; here they do not
sleep, so rounds follow one another and nothing has time to become idle.

The paper's clients of ROS 2 return the object that they have received; those of HPRM return a
copy of it. Here all return a copy.

A number of the paper is the mean of 10 rounds; here it is the median of the medians of up to 30
rounds.

“ros2” assigns bytes to the field of a message, as the paper's programs do. rclpy checks each
byte of that, which is most of the paper's figure for ROS 2; “ros2, array” assigns an array,
which is not checked.

“plasma” moves data as the paper's HPRM does, without its coordinator, and deletes each object
once the next is made; “plasma, never deleted” leaves them to the store, as the paper's programs
do.

“limit” has no middleware: one copy into shared memory that is mapped already, and a futex.
""")


def measure(effort: Effort) -> Record:
    """Measures all contenders in turn."""
    return measure_workload(NAME, "W1", who.GATHER, effort, _QUICK)


def section(record: Record) -> Section:
    """What the page says of it."""
    # What draws takes a second to import, also in processes that only measure.
    from . import charts

    picture = charts.lines(record, _TITLE, "ms a round")
    return Section(
        PAPER, by_case(record, f"{_TITLE}, ms", _OURS[1]), [picture], _claims(record), DIFFERENCES
    )


def _claims(record: Record) -> list[Claim]:
    claims = [
        Claim(
            f"gather, {case}: “{rival}” takes this many times as long as HPRM (decentralized)",
            paper,
            times(record.ratio(rival, _OURS[1], case)),
        )
        for case, rival, paper in (
            ("10 MB", _ROS, "77x"),
            ("50 MB", _ROS, "173x"),
            ("50 MB", _SHM, "3.0x"),
            ("50 MB", _DDS, "–"),
        )
    ]
    what = "gather, {}: centralized as a multiple of decentralized coordination"
    claims += [
        Claim(what.format(case), paper, times(record.ratio(*_OURS, case)))
        for case, paper in (("1 MB", "3.8x"), ("50 MB", "1.3x"))
    ]
    return claims


EXPERIMENT = Experiment(NAME, "Broadcast and gather", measure, section)
