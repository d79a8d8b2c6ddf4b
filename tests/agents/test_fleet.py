"""A federation of a hundred federates on ten machines does what one process does."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from machines import HPRM, alone, reactions
from networks import HUB, Fleet
from test_programs import COORDINATIONS, nothing_is_left

#: Two subnets, and the hub between them; each machine runs as many federates.
SUBNETS = [[f"robot{number}" for number in range(1, 6)], [f"robot{n}" for n in range(6, 10)]]
MACHINES = [HUB, *(machine for subnet in SUBNETS for machine in subnet)]
EACH = 10

#: What a federate says that is late.
LATE = re.compile(r"warning: federate \w+ lags |  hint: (its reactions took|let it run less)")

NODE = """\
target Python { timeout: 200 msec }
reactor Node(first = False, bank_index = 0) {
  input inp
  output out
  timer t(0, 50 msec)
  state seen = 0
  reaction(t) -> out {= if self.first: out.set(self.bank_index) =}
  reaction(inp) -> out {= self.seen += inp.value; out.set(inp.value + 1) =}
  reaction(shutdown) {= if self.first: print(self.bank_index, self.seen) =}
}
"""


def ring() -> str:
    """A ring of banks, one for each machine; what is sent around comes back to its sender."""
    pairs = zip(MACHINES, [*MACHINES[1:], HUB], strict=True)
    lines = [
        f"{MACHINES[0]} = new[{EACH}] Node(first = True)",
        *(f"{machine} = new[{EACH}] Node()" for machine in MACHINES[1:]),
        *(f"{one}.out -> {other}.inp after 5 msec" for one, other in pairs),
    ]
    return "\n".join([NODE, "federated reactor {", *lines, "}", ""])


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[Fleet]:
    """Ten machines whose agents start programs; those of different subnets meet at the hub."""
    fleet = Fleet(tmp_path)
    fleet.lay_out(SUBNETS)
    fleet.make_authority(HUB, "--router")
    assert all(fleet.enroll(machine)[0] == 0 for machine in MACHINES[1:])
    for machine in MACHINES:
        fleet.start(machine, "--fleet-keys", "keys", "--allow-root")
    fleet.meet(*MACHINES)
    yield fleet
    fleet.close()


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_hundred_federates_on_ten_machines_do_what_one_process_does(
    fleet: Fleet, coordination: str
) -> None:
    program = ring()
    (fleet.folder / "Fed.lf").write_text(program)
    at = [f"--at={machine}={machine}" for machine in MACHINES]
    options = ["--property", f"coordination={coordination}", "--logical-trace", "trace"]
    # A hundred interpreters take their time to start.
    patient = ["--join-timeout", "120", "--fleet-key", "keys"]
    # From a machine that reaches half of the others through the router.
    launcher = fleet.spawn("robot1", HPRM, "run", *options, *patient, *at, "Fed.lf")
    out, err = launcher.communicate(timeout=240)
    # On a busy machine, many are late, and say so.
    wrong = [line for line in err.splitlines() if not LATE.search(line)]
    assert (launcher.returncode, wrong) == (0, []), out
    said = sorted(line.split("] ")[1] for line in out.splitlines())
    out, expected = alone(fleet.folder, program)
    assert said == sorted(out.splitlines())
    assert len(expected) > 300
    assert reactions([fleet.folder / "trace"]) == expected
    nothing_is_left(fleet)
