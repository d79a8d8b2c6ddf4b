"""Federations whose processes reach one another through agents do what one process does."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest
from machines import (
    AGENT,
    CUTS,
    HPRM,
    PLACES,
    PROGRAM,
    Machines,
    alone,
    finish,
    reactions,
)
from tcp_ports import free_ports

COORDINATIONS = ["centralized", "decentralized"]
LONG = PROGRAM.replace("timeout: 200 msec", "timeout: 3 sec")
ENDLESS = PROGRAM.replace("timeout: 200 msec", "timeout: 1000 sec")


def check(
    machines: Machines,
    program: str,
    coordination: str,
    rti: subprocess.Popen[str],
    federates: list[subprocess.Popen[str]],
    read: str = "",
) -> None:
    """All have ended well, and have done what one process does."""
    out, expected = alone(machines.folder, program)
    outcomes = [finish(federates[0], read), *map(finish, federates[1:])]
    assert outcomes == [(0, out, ""), (0, "", ""), (0, "", "")], coordination
    assert finish(rti)[0::2] == (0, "")
    assert len(expected) > 40
    assert reactions(machines.folder / name for name in PLACES) == expected
    assert all(agent.poll() is None for agent in machines.agents.values())


def running(source: subprocess.Popen[str]) -> str:
    """Waits until the federation runs."""
    assert source.stdout is not None
    line = source.stdout.readline()
    assert line == "running\n"
    return line


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federation_through_agents_does_what_one_process_does(
    machines: Machines, coordination: str
) -> None:
    machines.start_agents()
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(PROGRAM, PLACES, *options)
    check(machines, PROGRAM, coordination, rti, federates)


@pytest.mark.parametrize("seconds", [3, 8, 15])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_agent_that_stands_still_loses_nothing(
    machines: Machines, coordination: str, seconds: int
) -> None:
    machines.start_agents()
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(LONG, PLACES, *options)
    read = running(federates[0])
    machines.stand_still("robot2", seconds)
    check(machines, LONG, coordination, rti, federates, read)


@pytest.mark.parametrize("seed", range(CUTS))
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_connections_that_are_cut_again_and_again_lose_nothing(
    machines: Machines, coordination: str, seed: int
) -> None:
    machines.start_agents(through=True)
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(LONG, PLACES, *options)
    read = running(federates[0])
    cuts = machines.cut_until_ended(rti, seed)
    check(machines, LONG, coordination, rti, federates, read)
    assert cuts > 0


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("victim", ["robot1", "robot2"])
def test_a_killed_agent_ends_the_federation_at_both_sides_with_one_error(
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
    # The bound of docs/concepts/failures.md, and a moment for what processes do when they know.
    assert time.monotonic() - killed < 24 + 6
    # The other agent goes on, and says which links have ended.
    (other,) = (agent for name, agent in machines.agents.items() if name != victim)
    assert other.poll() is None
    other.terminate()
    code, _, err = finish(other)
    assert code == 0
    assert "has ended: the other end has not answered for 20 s" in err


def test_a_killed_federate_is_told_on_the_other_machine(machines: Machines) -> None:
    machines.start_agents()
    rti, federates = machines.federation(ENDLESS, PLACES)
    running(federates[0])
    federates[1].kill()
    assert "sink__0" in finish(rti)[2]
    assert [finish(federates[at])[0] for at in (0, 2)] == [1, 1]


def test_a_large_value_crosses_agents(machines: Machines) -> None:
    machines.start_agents()
    program = PROGRAM.replace("timer t(0, 20 msec)", "timer t(0, 60 msec)")
    program = program.replace("np.full(20_000", "np.full(2_000_000")
    program = program.replace("== 5:", "== 2:")
    rti, federates = machines.federation(program, PLACES)
    out, expected = alone(machines.folder, program)
    assert [finish(federate) for federate in federates] == [(0, out, ""), (0, "", ""), (0, "", "")]
    assert finish(rti)[0] == 0
    assert reactions(machines.folder / name for name in PLACES) == expected


def test_federates_wait_for_agents_and_for_the_rti(machines: Machines) -> None:
    (machines.folder / "Fed.lf").write_text(PROGRAM)
    common = ["--federation-file", "secret", "--connect-timeout", "60"]
    create = [HPRM, "rti", "Fed.lf", "--federation-file", "secret", "--listen", "agent:robot1/rti"]
    code, _, err = finish(machines.spawn("robot1", *create))
    assert code == 1 and "no agent runs on this machine" in err
    join = ["--rti", "agent:robot1/rti", *common]
    federates = [
        machines.spawn(machine, HPRM, "federate", "Fed.lf", name, "--logical-trace", name, *join)
        for name, machine in PLACES.items()
    ]
    for federate in federates:
        assert federate.stderr is not None
        said = federate.stderr.readline()
        assert said.startswith("waiting for the RTI at agent:robot1/rti: no agent runs"), said
    machines.start_agents()
    rti = machines.spawn("robot1", *create)
    out, expected = alone(machines.folder, PROGRAM)
    outcomes = [finish(federate) for federate in federates]
    assert [(code, out) for code, out, _ in outcomes] == [(0, out), (0, ""), (0, "")]
    assert finish(rti)[0] == 0
    assert reactions(machines.folder / name for name in PLACES) == expected


def test_a_killed_rti_is_told_on_both_machines(machines: Machines) -> None:
    machines.start_agents()
    rti, federates = machines.federation(ENDLESS, PLACES)
    running(federates[0])
    rti.kill()
    for federate in federates:
        code, _, err = finish(federate)
        assert (code, err.count("error")) == (1, 1), err
    assert all(agent.poll() is None for agent in machines.agents.values())


def test_what_is_not_there_is_named(machines: Machines) -> None:
    (machines.folder / "Fed.lf").write_text(PROGRAM)
    (machines.folder / "secret").write_text("5" * 32)
    (machines.folder / "secret").chmod(0o600)
    common = ["--federation-file", "secret", "--connect-timeout", "1"]
    join = [HPRM, "federate", "Fed.lf", "sink__0", *common, "--rti"]
    code, _, err = finish(machines.spawn("robot2", *join, "agent:robot1/rti"))
    assert code != 0 and "no agent runs on this machine" in err
    machines.start_agents()
    for place, reason in {
        "robot9/rti": "no agent has the name robot9; there are: robot1, robot2",
        "robot1/rti": "no process listens at agent:robot1/rti",
        "robot2/rti": "no process listens at agent:robot2/rti",
    }.items():
        code, _, err = finish(machines.spawn("robot2", *join, f"agent:{place}"))
        assert code != 0 and reason in err, err
    for place, reason in {
        "robot2/rti": "this machine is robot1: listen at agent:robot1/rti",
        # What an agent has there itself takes large arrays of other machines.
        "robot1/shipments": "another process listens at agent:robot1/shipments already",
    }.items():
        rti = [HPRM, "rti", "Fed.lf", "--federation-file", "secret", "--listen", f"agent:{place}"]
        code, _, err = finish(machines.spawn("robot1", *rti))
        assert code != 0 and reason in err, err


def test_an_agent_refuses_what_would_let_other_machines_in(machines: Machines) -> None:
    for options in [
        ["--listen", "0.0.0.0:0"],
        ["--listen", "127.0.0.1:0", "--connect", "192.0.2.1:7"],
    ]:
        code, out, err = finish(machines.spawn("robot1", AGENT, "--name", "robot1", *options))
        assert (code, out, err.count("error")) == (1, "", 1)
        assert "without a certificate" in err and "--tls-cert" in err


def test_machines_are_listed_with_what_runs_there(machines: Machines) -> None:
    machines.start_agents()
    rti, federates = machines.federation(LONG, PLACES)
    read = running(federates[0])
    here, there = machines.tell_machines("robot2")
    assert here["clock"] is None
    # Both are this machine, in truth.
    clock = there["clock"]
    assert abs(clock["offset"]) <= clock["bound"] < 1_000_000_000
    version = subprocess.run([HPRM, "--version"], capture_output=True, text=True).stdout.split()[1]
    for one in (here, there):
        about = one["about"]
        assert about["version"] == version
        assert about["processors"] == len(os.sched_getaffinity(0))
        pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        assert about["memory"] == pytest.approx(pages, rel=0.01)
        assert "Fed" in about["federations"]
        (address,) = about["addresses"]
        assert address.startswith("127.0.0.1:")
    code, out, err = finish(machines.spawn("robot1", HPRM, "machines"))
    assert (code, err) == (0, "")
    title, *lines = out.splitlines()
    assert title.split()[:5] == ["machine", "version", "processors", "memory", "clock"]
    assert [line.split("  ")[0] for line in lines] == ["robot1 (this machine)", "robot2"]
    check(machines, LONG, "centralized", rti, federates, read)


def test_a_machine_that_does_not_answer_is_listed_as_such(machines: Machines) -> None:
    machines.start_agents()
    agent = machines.agents["robot2"]
    os.kill(agent.pid, signal.SIGSTOP)
    code, out, _ = finish(machines.spawn("robot1", HPRM, "machines"))
    os.kill(agent.pid, signal.SIGCONT)
    assert code == 0
    assert out.splitlines()[-1].split() == ["robot2", "(does", "not", "answer)", *"------"]


def test_without_an_agent_its_absence_is_told(machines: Machines) -> None:
    code, out, err = finish(machines.spawn("robot1", HPRM, "machines"))
    assert (code, out, err.count("error: no agent runs on this machine")) == (1, "", 1)
    code, out, _ = finish(machines.spawn("robot1", HPRM, "machines", "--json"))
    assert code == 1 and "no agent runs" in json.loads(out)["error"]["message"]


def test_the_word_agent_starts_the_agent_beside_the_command_or_on_the_path(
    machines: Machines, tmp_path: Path
) -> None:
    (port,) = free_ports(1)
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "hprm-agent").symlink_to(AGENT)
    hprm = folder / "hprm"
    shutil.copy(HPRM, hprm)
    agent = machines.spawn(
        "robot1", str(hprm), "agent", "--name", "robot1", "--listen", f"127.0.0.1:{port}"
    )
    assert agent.stdout is not None
    assert agent.stdout.readline() == f"the agent of robot1 listens at 127.0.0.1:{port}\n"
    assert machines.machines("robot1") == ["robot1"]
    agent.send_signal(signal.SIGINT)
    assert finish(agent)[::2] == (0, "")
    (folder / "hprm-agent").unlink()
    environment = os.environ | {"PATH": "/usr/bin:/bin"}
    done = subprocess.run(
        [hprm, "agent", "--help"], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 1
    assert done.stderr.startswith("error: hprm-agent is neither beside this command nor on")
    environment["PATH"] = str(Path(AGENT).parent)
    done = subprocess.run(
        [hprm, "agent", "--help"], capture_output=True, text=True, env=environment
    )
    assert (done.returncode, done.stderr) == (0, "") and "--tls-cert" in done.stdout


def test_names_and_sockets_belong_to_one_agent(machines: Machines) -> None:
    machines.start_agents()
    (port,) = free_ports(1)
    listen = ["--listen", f"127.0.0.1:{port}"]
    code, _, err = finish(machines.spawn("robot1", AGENT, "--name", "other", *listen))
    assert code == 1 and "an agent runs on this machine already" in err
    code, _, err = finish(machines.spawn("robot3", AGENT, "--name", "../x", *listen))
    assert code == 1 and "cannot be the name of a machine" in err
    first = machines.agents["robot1"].args
    assert isinstance(first, tuple)
    connect = ["--connect", first[-1]]
    code, _, err = finish(machines.spawn("robot3", AGENT, "--name", "robot2", *listen, *connect))
    assert code == 1 and "another agent has the name 'robot2' already" in err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_agent_that_ends_tells_the_other_one(machines: Machines, coordination: str) -> None:
    machines.start_agents()
    options = ["--property", f"coordination={coordination}"]
    rti, federates = machines.federation(ENDLESS, PLACES, *options)
    running(federates[0])
    machines.agents["robot2"].terminate()
    assert finish(machines.agents["robot2"])[0] == 0
    outcomes = [finish(process) for process in [rti, *federates]]
    assert [code for code, _, _ in outcomes] == [1, 1, 1, 1]
    # Two federates of that machine have links to the RTI, and direct ones to the third federate.
    links = 4
    agent = machines.agents["robot1"]
    assert agent.stderr is not None
    # The processes end with the first link; the agent may hear of the others later.
    for line in itertools.islice(agent.stderr, links):
        assert "the agent of robot2 has ended" in line
    agent.terminate()
    assert finish(agent)[::2] == (0, "")


def test_bytes_that_are_no_packets_and_idle_connections_disturb_nothing(machines: Machines) -> None:
    machines.start_agents()
    rti, federates = machines.federation(LONG, PLACES)
    read = running(federates[0])
    listens = machines.agents["robot1"].args
    assert isinstance(listens, tuple)
    host, _, port = listens[-1].partition(":")
    idle, noisy = [], random.Random(0)
    for _ in range(100):
        connection = socket.create_connection((host, int(port)))
        connection.setblocking(False)
        idle.append(connection)
        local = socket.socket(socket.AF_UNIX)
        local.connect("\0" + machines.address("robot1"))
        idle.append(local)
        for end in (connection, local):
            if noisy.random() < 0.5:
                with contextlib.suppress(OSError):
                    end.send(noisy.randbytes(10_000))
    check(machines, LONG, "centralized", rti, federates, read)
    for connection in idle:
        connection.close()
    assert machines.machines("robot1") == ["robot1", "robot2"]


def certify(folder: Path, *names: str) -> None:
    """Makes an authority, and a certificate of it for each machine."""

    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)

    new = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "9"]
    openssl("req", "-x509", *new, "-subj", "/CN=ca", "-keyout", "ca.key", "-out", "ca.pem")
    (folder / "names").write_text("subjectAltName=IP:127.0.0.1,DNS:localhost\n")
    for name in names or ("robot1", "robot2"):
        openssl(
            "req", *new, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.csr"
        )
        sign = ["-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-extfile", "names"]
        openssl("x509", "-req", "-in", f"{name}.csr", *sign, "-days", "9", "-out", f"{name}.pem")


def test_agents_with_certificates_know_one_another_and_no_others(
    machines: Machines, tmp_path_factory: pytest.TempPathFactory
) -> None:
    certify(machines.folder)
    foreign = tmp_path_factory.mktemp("foreign")
    certify(foreign)

    def files(folder: Path, name: str) -> list[str]:
        names = {"cert": f"{name}.pem", "key": f"{name}.key", "ca": "ca.pem"}
        return [
            word for what, file in names.items() for word in (f"--tls-{what}", str(folder / file))
        ]

    ports = free_ports(3)
    connect = ["--connect", f"127.0.0.1:{ports[0]}"]
    here = files(machines.folder, "robot1")
    # Reachable from other machines, which only a certificate allows.
    machines.start_agent("robot1", "--listen", f"0.0.0.0:{ports[0]}", *here)
    for at, name, folder in [(1, "robot3", foreign), (2, "robot2", machines.folder)]:
        mine = files(folder, name.replace("3", "1"))
        machines.start_agent(name, "--listen", f"127.0.0.1:{ports[at]}", *connect, *mine)
    while "robot2" not in machines.machines("robot1"):
        pass
    assert machines.machines("robot3") == ["robot3"]
    assert machines.machines("robot1") == ["robot1", "robot2"]
    rti, federates = machines.federation(PROGRAM, PLACES)
    check(machines, PROGRAM, "centralized", rti, federates)
