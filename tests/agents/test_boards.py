"""Federations that are on several machines coordinate themselves by boards.

What a federate shows travels to those that do not share its memory.
"""

from __future__ import annotations

import os
import re
import signal
import time
from collections import Counter

from machines import PLACES, PROGRAM, Machines, alone, finish, reactions
from test_agents import running
from test_programs import AT, run, start

#: What a federate needs to hear of the RTI in each tag, without boards.
GRANTS = {"TagAdvanceGrant", "ProvisionalTagAdvanceGrant"}

#: Two federates of one machine, and one of another that hears of the second.
PAIR = """\
target Python { timeout: 5 sec }
reactor Tick {
  output out
  timer t(0, 20 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    out.set(self.count)
  =}
}
reactor Work {
  input inp
  output out
  state late = 0
  state count = 0
  reaction(inp) -> out {=
    self.count += 1
    self.late = max(self.late, lf.time.physical_elapsed() - lf.time.logical_elapsed())
    if self.count == 20: print("running", flush=True)
    if self.count % 100 == 0: out.set(self.count)
  =}
  reaction(shutdown) {= print(self.count, self.late // 1_000_000) =}
}
reactor Log {
  input inp
  state values = []
  reaction(inp) {= self.values.append(inp.value) =}
  reaction(shutdown) {= print(self.values) =}
}
federated reactor {
  tick = new Tick()
  work = new Work()
  log = new Log()
  tick.out -> work.inp
  work.out -> log.inp
}
"""


def frames(said: str) -> Counter[str]:
    """How many frames of each kind processes have sent, as they say."""
    return Counter(re.findall(r"^\S+ +\S+ to \S+  (\w+)", said, re.MULTILINE))


def test_what_federates_show_travels_to_other_machines(machines: Machines) -> None:
    machines.start_agents()
    counts = {}
    out, expected = alone(machines.folder, PROGRAM)
    for boards in ["on", "off"]:
        machines.environment["HPRM_BOARDS"] = boards
        rti, federates = machines.federation(PROGRAM, PLACES, "--log-frames=all")
        outcomes = [finish(process) for process in [*federates, rti]]
        assert [code for code, _, _ in outcomes] == [0, 0, 0, 0]
        assert outcomes[0][1] == out
        assert reactions(machines.folder / name for name in PLACES) == expected
        counts[boards] = frames("".join(err for _, _, err in outcomes))
    assert counts["on"]["Posting"] > 20 and not GRANTS & counts["on"].keys()
    assert counts["off"]["Posting"] == 0 and GRANTS & counts["off"].keys()


def test_federates_of_the_machine_of_the_rti_share_memory_beside_one_elsewhere(
    machines: Machines,
) -> None:
    start(machines)
    program = PAIR.replace("5 sec", "1 sec").replace('print("running", flush=True)', "pass")
    options = [
        "--log-frames=Board,Posting",
        "--log-frames-to",
        "frames",
        "--logical-trace",
        "trace",
    ]
    at = ["--at", "log=robot2", *AT[2:]]
    code, said, err = finish(run(machines, program, *options, *at))
    assert (code, err) == (0, "")
    assert "[log] []" in said and "[work] 51 " in said
    _, expected = alone(machines.folder, program)
    assert reactions([machines.folder / "trace"]) == expected
    assert frames((machines.folder / "frames").read_text())["Board"] >= 1


def test_federates_of_one_machine_do_not_wait_for_the_rti_on_another(machines: Machines) -> None:
    seconds = 2
    machines.start_agents()
    places = {"tick": "robot2", "work": "robot2", "log": "robot1"}
    rti, federates = machines.federation(PAIR, places)
    read = running(federates[1])
    agent = machines.agents["robot1"]
    os.kill(agent.pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(agent.pid, signal.SIGCONT)
    outcomes = [finish(federates[0]), finish(federates[1], read), finish(federates[2]), finish(rti)]
    assert [(code, err) for code, _, err in outcomes] == [(0, "")] * 4
    assert outcomes[2][1] == "[100, 200]\n"
    count, late = outcomes[1][1].split()[1:]
    assert int(count) == 251
    assert int(late) < seconds * 1000 / 2, "it has waited for the other machine"
