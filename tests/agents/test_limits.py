"""Limits of programs that agents start count for all of their processes, where there are cgroups.

The tests that need some are left out where a test can have none: in a container without the right
to make groups, say.
"""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from groups import Groups, open_groups
from machines import AGENT, HPRM, Machines, finish, until
from tcp_ports import free_ports
from test_programs import nothing_is_left

OPTIONS = ["--fleet-keys", "keys", "--allow-root"]
AT = ["--at", "there=robot2", "--fleet-key", "keys"]

TOGETHER = "limits count for all processes of a program together, by cgroups\n"
EACH = "limits count for each process of a program, as there are no cgroups: "

FEDERATION = """\
target Python
preamble {=
import os
import subprocess
import sys
import time
=}
reactor Says { reaction(startup) {=
  if self.name == "there":
BODY
=} }
federated reactor { here = new Says(name="here")
  there = new Says(name="there") }
"""


def program(body: str) -> str:
    """A program of which the federate `there` does something when it starts."""
    lines = "".join(f"    {line}\n" for line in body.strip().splitlines())
    return FEDERATION.replace("BODY\n", lines).replace("reactor Says {", 'reactor Says(name="") {')


@pytest.fixture
def groups(machines: Machines) -> Iterator[Groups]:
    """Groups, in which the agents of two machines have been started."""
    found = open_groups()
    if isinstance(found, str):
        pytest.skip(f"a test can have no cgroups here: {found}")
    try:
        yield found
    finally:
        machines.close()
        machines.started.clear()
        found.close()


def start(machines: Machines, groups: Groups, *options: str) -> None:
    """Starts two agents, each in a group of its own."""
    here, there = free_ports(2)
    start_agent(machines, groups, "robot1", "--listen", f"127.0.0.1:{here}", *options)
    connect = ["--listen", f"127.0.0.1:{there}", "--connect", f"127.0.0.1:{here}"]
    start_agent(machines, groups, "robot2", *connect, *options)
    machines.wait_for("robot1", ["robot1", "robot2"])
    machines.wait_for("robot2", ["robot2", "robot1"])


def start_agent(machines: Machines, groups: Groups, machine: str, *options: str) -> None:
    """Starts an agent in a group of its own, and waits until it listens."""
    words = groups.entered([AGENT, "--name", machine, *OPTIONS, *options])
    agent = machines.spawn(machine, *words)
    assert agent.stdout is not None
    assert agent.stdout.readline().startswith(f"the agent of {machine} listens at")
    assert agent.stdout.readline() == TOGETHER
    machines.agents[machine] = agent


def run(machines: Machines, text: str) -> subprocess.Popen[str]:
    """Runs a program with a federate on the second machine."""
    (machines.folder / "Fed.lf").write_text(text)
    return machines.spawn("robot1", HPRM, "run", *AT, "Fed.lf")


def programs(groups: Groups, machines: Machines) -> list[Path]:
    """The groups of programs of the second machine's agent."""
    own = groups.of(machines.agents["robot2"].pid)
    assert own.name == "agent"
    return sorted(own.parent.glob("program-*"))


def lives(pid: int) -> bool:
    """Whether a process is there that has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False


def test_an_agent_says_for_what_limits_count(machines: Machines) -> None:
    agent = machines.spawn("robot1", AGENT, "--name", "robot1", "--listen", "127.0.0.1:0", *OPTIONS)
    assert agent.stdout is not None
    agent.stdout.readline()
    said = agent.stdout.readline()
    assert said == TOGETHER or said.startswith(EACH)
    (told,) = machines.tell_machines("robot1")
    assert told["about"]["limits"] == ("program" if said == TOGETHER else "process")
    code, out, _ = finish(machines.spawn("robot1", HPRM, "machines"))
    assert code == 0
    assert out.split()[-1] == ("program" if said == TOGETHER else "process")


def test_an_agent_that_starts_no_programs_has_no_limits(machines: Machines) -> None:
    machines.start_agent("robot1", "--listen", "127.0.0.1:0")
    (told,) = machines.tell_machines("robot1")
    assert told["about"]["limits"] is None
    assert "limits" not in finish(machines.spawn("robot1", HPRM, "machines"))[1]


EATS = """
children = []
for number in range(6):
    child = [sys.executable, "-c", "import time; a = b'x' * (90 << 20); time.sleep(1000)"]
    children.append(subprocess.Popen(child))
time.sleep(1000)
"""


def test_processes_that_need_too_much_memory_together_are_ended_and_that_is_told(
    machines: Machines, groups: Groups
) -> None:
    start(machines, groups, "--program-memory", "256M")
    for one in machines.tell_machines("robot1"):
        assert one["about"]["limits"] == "program"
    code, _, err = finish(run(machines, program(EATS)))
    assert (code, err.count("error: ")) == (1, 1), err
    assert (
        "error: federate there was ended on robot2, as all of its processes together needed more"
        " than 256 MiB of memory\n"
        "  hint: let it have more, by --program-memory of the agent of robot2" in err
    )
    assert programs(groups, machines) == []
    nothing_is_left(machines)


FORKS = """
children = []
try:
    while len(children) < 200:
        children.append(subprocess.Popen(["sleep", "1000"]))
except OSError as error:
    print(error.strerror, len(children) < 60, flush=True)
for child in children:
    child.kill()
"""


def test_the_processes_of_a_program_are_counted_without_those_of_others(
    machines: Machines, groups: Groups
) -> None:
    if os.geteuid() != 0:
        pytest.skip("the limit of each process counts those of others, but not for root")
    start(machines, groups, "--program-processes", "60")
    for _ in range(70):
        machines.spawn("robot1", "sleep", "1000")
    code, out, err = finish(run(machines, program(FORKS)))
    assert (code, err) == (0, "")
    assert out == "[there] Resource temporarily unavailable True\n"
    assert programs(groups, machines) == []


LEAVES = """
child = subprocess.Popen(["sleep", "1000"], start_new_session=True)
print(child.pid, flush=True)
"""


def leaver(launcher: subprocess.Popen[str]) -> int:
    """The process that the program has started in another session."""
    assert launcher.stdout is not None
    return int(launcher.stdout.readline().removeprefix("[there] "))


def test_what_a_program_has_started_elsewhere_ends_with_it(
    machines: Machines, groups: Groups
) -> None:
    start(machines, groups)
    launcher = run(machines, program(LEAVES + "time.sleep(1)\n"))
    pid = leaver(launcher)
    assert lives(pid)
    code, _, err = finish(launcher)
    assert (code, err) == (0, "")
    assert not lives(pid)
    assert programs(groups, machines) == []


ENDLESS = program(LEAVES + "time.sleep(1000)\n")


def test_an_agent_ends_the_program_of_a_starter_that_was_killed(
    machines: Machines, groups: Groups
) -> None:
    start(machines, groups)
    launcher = run(machines, ENDLESS)
    pid = leaver(launcher)
    home = groups.of(machines.agents["robot2"].pid)
    starters = {int(pid) for pid in (home / "cgroup.procs").read_text().split()}
    (starter,) = starters - {machines.agents["robot2"].pid}
    assert lives(pid) and groups.of(pid) in programs(groups, machines)
    os.kill(starter, signal.SIGKILL)
    assert finish(launcher)[0] == 1
    until(lambda: not lives(pid) and programs(groups, machines) == [])


def test_the_next_agent_ends_and_removes_what_a_killed_one_has_left(
    machines: Machines, groups: Groups
) -> None:
    start(machines, groups)
    launcher = run(machines, ENDLESS)
    pid = leaver(launcher)
    group = groups.of(pid)
    agent = machines.agents["robot2"]
    agent.kill()
    agent.wait()
    assert finish(launcher)[0] == 1
    # Nothing else ends it.
    assert lives(pid) and groups.of(pid) == group
    start_agent(machines, groups, "robot2", "--listen", "127.0.0.1:0")
    assert not lives(pid) and not group.exists() and not group.parent.exists()
    # The other agent lives, and keeps what it has.
    assert groups.of(machines.agents["robot1"].pid).exists()


def test_an_agent_that_ends_leaves_no_groups(machines: Machines, groups: Groups) -> None:
    start(machines, groups)
    launcher = run(machines, ENDLESS)
    pid = leaver(launcher)
    agent = machines.agents["robot2"]
    own = groups.of(agent.pid).parent
    assert lives(pid)
    agent.send_signal(signal.SIGINT)
    assert agent.wait(30) == 0
    assert not lives(pid) and not own.exists()
    assert finish(launcher)[0] == 1


def test_other_processes_in_its_group_are_not_moved(machines: Machines, groups: Groups) -> None:
    both = 'sleep 1000 & exec "$@"'
    words = ["sh", "-c", both, "sh", AGENT, "--name", "robot1", "--listen", "127.0.0.1:0"]
    agent = machines.spawn("robot1", *groups.entered([*words, *OPTIONS]))
    assert agent.stdout is not None
    agent.stdout.readline()
    assert agent.stdout.readline().startswith(f"{EACH}other processes are in ")
    group = groups.of(agent.pid)
    assert len((group / "cgroup.procs").read_text().split()) == 2
    assert [path for path in group.iterdir() if path.is_dir()] == []
    agent.send_signal(signal.SIGINT)
    assert agent.wait(30) == 0
    (group / "cgroup.kill").write_text("1")
