"""A federate that waits for less than clocks may differ is told, and no other one."""

from __future__ import annotations

import re

import pytest
from machines import HPRM, PROGRAM, Machines, finish
from test_programs import AT, run, start

DECENTRALIZED = ["--property", "coordination=decentralized"]


def warnings(machines: Machines, program: str, *options: str) -> list[str]:
    """What `hprm run` says of clocks, line by line."""
    _, _, err = finish(run(machines, program, *AT, *options))
    return [line for line in err.splitlines() if "the maxwait of federate" in line]


def waits(maxwait: str, federate: str = "sink = new[2] Sink()") -> str:
    """The program, with a federate that waits for so long."""
    assert federate in PROGRAM
    return PROGRAM.replace(federate, f"@maxwait({maxwait})\n  {federate}")


def test_a_maxwait_below_the_bound_of_the_clocks_is_one_warning_for_each_federate(
    machines: Machines,
) -> None:
    start(machines)
    told = warnings(machines, waits("1 usec"), *DECENTRALIZED)
    assert [line.split()[5] for line in told] == ["sink__0", "sink__1"]
    for line in told:
        assert line.startswith("warning: the maxwait of federate sink__")
        assert " on robot2 is 1 us, but the clocks of robot2 and robot1 may differ by " in line
        assert re.search(
            r"differ by [\d.]+ [um]?s: what federate source sends from robot1 may be tardy$", line
        )


@pytest.mark.parametrize(
    "program, options",
    [
        (PROGRAM, DECENTRALIZED),
        (waits("5 sec"), DECENTRALIZED),
        # What it gets comes 30 ms before its tag.
        (waits("1 usec", "source = new Source()"), DECENTRALIZED),
        (waits("1 usec"), ["--property", "coordination=centralized"]),
    ],
    ids=["for ever", "long", "after", "centralized"],
)
def test_a_federate_that_waits_long_enough_is_not_warned_of(
    machines: Machines, program: str, options: list[str]
) -> None:
    start(machines)
    assert warnings(machines, program, *options) == []


def test_federates_of_one_machine_are_not_warned_of(machines: Machines) -> None:
    start(machines)
    (machines.folder / "Fed.lf").write_text(waits("1 usec"))
    everywhere = ["--at", "sink=robot2", "--at", "source=robot2", "--fleet-key", "keys"]
    process = machines.spawn("robot1", HPRM, "run", *everywhere, *DECENTRALIZED, "Fed.lf")
    assert "the maxwait of federate" not in finish(process)[2]
