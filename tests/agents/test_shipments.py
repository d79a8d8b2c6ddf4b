"""Large values cross to another machine once, for all receivers there."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from machines import CUTS, Machines, alone, finish, reactions
from networks import HUB, Fleet
from test_agents import COORDINATIONS, running

#: The length of an array, in bytes, and how many there are.
LENGTH = 4_000_000
COUNT = 6

PROGRAM = f"""\
target Python {{ timeout: {(COUNT - 1) * 50} msec }}
preamble {{=
import numpy as np
=}}
reactor Source {{
  input[2] answers
  output out
  timer t(0, 50 msec)
  state count = 0
  state received = []
  reaction(t) -> out {{=
    self.count += 1
    out.set(np.full({LENGTH // 8}, self.count))
  =}}
  reaction(answers) {{=
    # Both links of this federate are open now, in both directions.
    if not self.received: print("running", flush=True)
    self.received += [answer.value for answer in answers if answer.is_present]
  =}}
  reaction(shutdown) {{= print(len(self.received), sum(self.received)) =}}
}}
reactor Sink(bank_index = 0) {{
  input inp
  output answer
  reaction(inp) -> answer {{=
    assert inp.value[0] == inp.value[-1] and len(inp.value) == {LENGTH // 8}
    answer.set(int(inp.value[-1]) * 10 + self.bank_index)
  =}}
}}
federated reactor {{
  source = new Source()
  sink = new[2] Sink()
  (source.out)+ -> sink.inp
  sink.answer -> source.answers after 30 msec
}}
"""

PLACES = {"source": "robot1", "sink__0": "robot2", "sink__1": "robot2"}
ENDLESS = PROGRAM.replace(f"timeout: {(COUNT - 1) * 50} msec", "timeout: 1000 sec")
#: Of this length, arrays are no more than agents that are not optimized encrypt in time.
LONG = PROGRAM.replace(f"timeout: {(COUNT - 1) * 50} msec", "timeout: 3 sec")
LONG = LONG.replace(str(LENGTH // 8), "50_000")


def check(
    machines: Machines,
    rti: subprocess.Popen[str],
    federates: list[subprocess.Popen[str]],
    program: str = PROGRAM,
    read: str = "",
    places: dict[str, str] = PLACES,
) -> None:
    """All have ended well, and have done what one process does."""
    out, expected = alone(machines.folder, program)
    outcomes = [finish(federates[0], read), *map(finish, federates[1:])]
    assert outcomes == [(0, out, "")] + [(0, "", "")] * (len(federates) - 1)
    assert finish(rti)[0::2] == (0, "")
    assert reactions(machines.folder / name for name in places) == expected
    assert all(agent.poll() is None for agent in machines.agents.values())


def at_best(crossed: Callable[[], int | None]) -> int | None:
    """How many bytes cross the network at least, of a few runs.

    Where processors have much to do, relayed links send again what only takes long.
    """
    counts = []
    for _ in range(4):
        count = crossed()
        if count is None or count < 1.2 * COUNT * LENGTH:
            return count
        counts.append(count)
    return min(counts)


def through_proxy(machines: Machines, program: str, places: dict[str, str], *options: str) -> int:
    """How many bytes cross when a federation runs, which must do what one process does."""
    assert machines.proxy is not None
    before = machines.proxy.carried
    check(machines, *machines.federation(program, places, *options))
    return machines.proxy.carried - before


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_value_crosses_once_for_all_receivers_of_a_machine(
    machines: Machines, coordination: str
) -> None:
    machines.start_agents(through=True)
    options = ["--property", f"coordination={coordination}"]
    crossed = at_best(lambda: through_proxy(machines, PROGRAM, PLACES, *options))
    assert crossed is not None
    assert COUNT * LENGTH < crossed < 1.2 * COUNT * LENGTH


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_compressed_value_takes_less_and_is_the_same(
    machines: Machines, coordination: str
) -> None:
    machines.start_agents(through=True)
    program = PROGRAM.replace("  (source.out)+ ->", "  @compress() (source.out)+ ->")
    assert program != PROGRAM
    options = ["--property", f"coordination={coordination}"]
    assert through_proxy(machines, program, PLACES, *options) < 0.2 * COUNT * LENGTH


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_value_for_the_own_machine_crosses_nothing_wherever_the_rti_is(
    machines: Machines, coordination: str
) -> None:
    machines.start_agents(through=True)
    options = ["--property", f"coordination={coordination}"]
    places = dict.fromkeys(PLACES, "robot2")
    assert through_proxy(machines, PROGRAM, places, *options) < 0.2 * COUNT * LENGTH


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_what_has_come_is_sent_on_to_federates_of_the_same_machine(
    machines: Machines, coordination: str
) -> None:
    machines.start_agents()
    program = PROGRAM.replace(
        "reactor Sink(bank_index = 0) {",
        """\
reactor Pass {
  input inp
  output out
  reaction(inp) -> out {= out.set(inp.value) =}
}
reactor Sink(bank_index = 0) {""",
    )
    program = program.replace(
        "(source.out)+ -> sink.inp",
        "passer = new Pass()\n  source.out -> passer.inp\n  (passer.out)+ -> sink.inp",
    )
    places = {**PLACES, "passer": "robot2"}
    options = ["--property", f"coordination={coordination}"]
    check(machines, *machines.federation(program, places, *options), program, places=places)


@pytest.mark.parametrize("connection", ["->", "~>"])
def test_a_value_may_be_sent_twice_to_a_receiver(machines: Machines, connection: str) -> None:
    machines.start_agents(through=True)
    program = """\
target Python { timeout: LONG }
preamble {=
import numpy as np
=}
reactor Source {
  output[2] out
  timer t(0, 20 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    value = np.full(100_000, self.count)
    if self.count > 11: return
    for port in out: port.set({"value": value, "again": [value]})
  =}
}
reactor Sink {
  input[2] inp
  state sum = 0
  reaction(inp) {=
    for port in inp:
        if port.is_present:
            self.sum += int(port.value["value"][0] + port.value["again"][0][-1])
  =}
  reaction(shutdown) {= print(self.sum, flush=True) =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
""".replace("source.out -> sink.inp", f"source.out {connection} sink.inp")
    # On physical connections, what comes after the end is not processed.
    program = program.replace("LONG", "200 msec" if connection == "->" else "5 sec")
    places = {"source": "robot1", "sink": "robot2"}
    rti, federates = machines.federation(program, places)
    code, out, err = finish(federates[1])
    assert (code, err) == (0, "")
    assert int(out) == 4 * sum(range(1, 12))
    assert [finish(process)[0] for process in [federates[0], rti]] == [0, 0]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_agent_that_stands_still_delays_values_and_loses_none(
    machines: Machines, coordination: str
) -> None:
    machines.start_agents()
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(LONG, PLACES, *options)
    read = running(federates[0])
    machines.stand_still("robot2", 4)
    check(machines, rti, federates, LONG, read)


@pytest.mark.parametrize("seed", range(CUTS))
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_connections_that_are_cut_lose_no_values(
    machines: Machines, coordination: str, seed: int
) -> None:
    machines.start_agents(through=True)
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(LONG, PLACES, *options)
    read = running(federates[0])
    machines.cut_until_ended(rti, seed)
    check(machines, rti, federates, LONG, read)


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("victim", ["robot1", "robot2"])
def test_a_killed_agent_ends_the_federation_while_values_are_on_their_way(
    machines: Machines, victim: str, coordination: str
) -> None:
    machines.start_agents()
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(ENDLESS, PLACES, *options)
    running(federates[0])
    killed = time.monotonic()
    machines.agents[victim].kill()
    for process in [rti, *federates]:
        code, _, err = finish(process)
        assert (code, err.count("error")) == (1, 1), err
    assert time.monotonic() - killed < 24 + 6


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("victim", ["source", "sink__0"])
def test_a_killed_federate_is_told_and_its_values_are_forgotten(
    machines: Machines, victim: str, coordination: str
) -> None:
    machines.start_agents()
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(ENDLESS, PLACES, *options)
    running(federates[0])
    dead = federates[list(PLACES).index(victim)]
    dead.kill()
    for process in [rti, *federates]:
        if process is not dead:
            code, _, err = finish(process)
            assert (code, err.count("error")) == (1, 1), err
            assert victim in err
    dead.communicate()
    # The memory that agents have for a federation goes with it.
    for agent in machines.agents.values():
        wait_until_nothing_is_held(agent)


def wait_until_nothing_is_held(agent: subprocess.Popen[str]) -> None:
    """The agent maps no memory for values any more."""
    deadline = time.monotonic() + 30
    while (held := segments(agent.pid)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert held == []


def segments(pid: int) -> list[str]:
    """The segments of stores that a process has mapped or could map."""
    mapped = Path(f"/proc/{pid}/maps").read_text().splitlines()
    links = [os.readlink(fd) for fd in Path(f"/proc/{pid}/fd").iterdir() if fd.is_symlink()]
    return [line for line in [*mapped, *links] if "memfd:hprm" in line]


def start(fleet: Fleet) -> None:
    """Starts a machine on one side of a router, and two on the other."""
    fleet.lay_out([["robot1"], ["robot2", "robot3"]])
    fleet.make_authority(HUB, "--router")
    names = ["robot1", "robot2", "robot3"]
    assert all(fleet.enroll(name)[0] == 0 for name in names)
    for machine in [HUB, *names]:
        fleet.start(machine)
    fleet.meet(HUB, *names)


BEHIND = {"source": "robot1", "sink__0": "robot2", "sink__1": "robot3"}


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_router_gets_a_value_once_for_all_machines_behind_it(
    fleet: Fleet, coordination: str
) -> None:
    start(fleet)
    options = ["--property", f"coordination={coordination}"]

    def crossed() -> int | None:
        before = sent(fleet, "robot1")
        check(fleet, *fleet.federation(PROGRAM, BEHIND, *options))
        after = sent(fleet, "robot1")
        return None if before is None or after is None else after - before

    count = at_best(crossed)
    # Encrypted, in packets of Ethernet.
    assert count is None or COUNT * LENGTH < count < 1.2 * COUNT * LENGTH


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_router_that_is_started_again_loses_no_values(fleet: Fleet, coordination: str) -> None:
    start(fleet)
    options = ["--property", f"coordination={coordination}"]
    rti, federates = fleet.federation(LONG, BEHIND, *options)
    read = running(federates[0])
    fleet.agents[HUB].kill()
    finish(fleet.agents[HUB])
    fleet.start(HUB)
    check(fleet, rti, federates, LONG, read)


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("victim", [HUB, "robot1", "robot2"])
def test_a_machine_that_vanishes_ends_all_that_wait_for_values_through_a_router(
    fleet: Fleet, victim: str, coordination: str
) -> None:
    start(fleet)
    options = ["--property", f"coordination={coordination}"]
    rti, federates = fleet.federation(ENDLESS, BEHIND, *options)
    running(federates[0])
    killed = time.monotonic()
    fleet.agents[victim].kill()
    for process in [rti, *federates]:
        code, _, err = finish(process)
        assert (code, err.count("error")) == (1, 1), err
    assert time.monotonic() - killed < 24 + 8


def sent(fleet: Fleet, machine: str) -> int | None:
    """How many bytes a machine has sent; none where all machines are on one device."""
    if fleet.network is None:
        return None
    command = fleet.network.command(machine, "cat", "/proc/net/dev")
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    (cable,) = (line.split() for line in lines if line.strip().startswith("cable:"))
    return int(cable[9])
