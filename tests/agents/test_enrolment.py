"""Machines come to belong together by an authority, one-time codes and a roster; and cease to."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import struct
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh
from machines import (
    AGENT,
    HPRM,
    PLACES,
    PROGRAM,
    Machines,
    alone,
    finish,
    listens_at,
    reactions,
    until,
)
from tcp_ports import free_ports

LONG = PROGRAM.replace("timeout: 200 msec", "timeout: 3 sec")
ENDLESS = PROGRAM.replace("timeout: 200 msec", "timeout: 1000 sec")


def test_enrolled_machines_need_no_options(machines: Machines) -> None:
    machines.make_authority("robot1")
    assert machines.enroll("robot2") == (0, "", machines.enrolled_text("robot2"))
    for machine in ("robot1", "robot2"):
        folder = machines.credentials(machine)
        names = {"authority.pem", "machine.key", "machine.pem", "roster.json"}
        assert {path.name for path in folder.iterdir()} == names
        assert all(path.stat().st_mode & 0o777 == 0o600 for path in folder.iterdir())
        assert folder.stat().st_mode & 0o777 == 0o700
    here, there = free_ports(2)
    # Where other machines reach it, and without a name.
    agent = machines.spawn("robot1", AGENT, "--listen", f"0.0.0.0:{here}")
    assert agent.stdout is not None
    assert agent.stdout.readline() == f"the agent of robot1 listens at 0.0.0.0:{here}\n"
    machines.agents["robot1"] = agent
    connect = ["--connect", f"127.0.0.1:{here}"]
    machines.start_agent("robot2", "--listen", f"127.0.0.1:{there}", *connect)
    machines.wait_for("robot1", ["robot1", "robot2"])
    machines.wait_for("robot2", ["robot2", "robot1"])
    rti, federates = machines.federation(PROGRAM, PLACES)
    out, expected = alone(machines.folder, PROGRAM)
    outcomes = [finish(federate) for federate in federates]
    assert outcomes == [(0, out, ""), (0, "", ""), (0, "", "")]
    assert finish(rti)[0::2] == (0, "")
    assert reactions(machines.folder / name for name in PLACES) == expected


def test_a_machine_has_the_name_with_which_it_was_enrolled(machines: Machines) -> None:
    machines.make_authority("robot1")
    code, out, err = finish(machines.spawn("robot1", AGENT, "--name", "robot2"))
    assert (code, out, err.count("error: ")) == (1, "", 1)
    assert "this machine was enrolled as robot1, and not as robot2" in err
    code, _, err = finish(machines.spawn("robot1", AGENT, "authority"))
    assert code == 1 and "this user has an authority already" in err
    code, _, err = finish(machines.spawn("robot2", AGENT, "invite", "robot3"))
    assert code == 1 and "this user has no authority" in err
    key = machines.credentials("robot1") / "machine.key"
    key.chmod(0o644)
    code, _, err = finish(machines.spawn("robot1", AGENT))
    assert code == 1 and "others can read the key" in err


def test_a_program_starts_while_machines_are_enrolled(machines: Machines) -> None:
    """Agents connect again whenever the roster changes, and programs start all the same."""
    machines.make_authority("robot1")
    assert machines.enroll("robot2")[0] == 0
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    out, expected = alone(machines.folder, PROGRAM)
    said = "".join(f"[source] {line}\n" for line in out.splitlines())
    options = ["--at", "sink=robot2", "--fleet-key", "keys", "--logical-trace", "trace"]
    (machines.folder / "Fed.lf").write_text(PROGRAM)
    for coordination in ("centralized", "decentralized"):
        stated = ["--property", f"coordination={coordination}"]
        launcher = machines.spawn("robot1", HPRM, "run", *options, *stated, "Fed.lf")
        for number in range(3):
            assert machines.enroll(f"{coordination[:3]}{number}")[0] == 0
        assert finish(launcher) == (0, said, "")
        assert reactions([machines.folder / "trace"]) == expected


def test_a_wrong_code_is_refused_and_after_five_no_code_is_right(machines: Machines) -> None:
    machines.make_authority("robot1")
    host, place, code = machines.invite("robot2")
    wrong = "0000-0000-0000-0000"
    for _ in range(5):
        assert machines.join("robot2", place, wrong)[0::2] == (
            1,
            "error: the authority refuses robot2: the code is wrong\n"
            "  hint: `hprm agent invite robot2` on its machine makes a new code\n",
        )
    status, _, err = finish(host)
    assert status == 1 and "5 wrong codes have come: this one is void" in err
    status, _, err = machines.join("robot2", place, code)
    assert status == 1 and f"no authority listens at {place}" in err
    assert not machines.credentials("robot2").exists()


def test_a_code_is_for_one_name_and_works_once(machines: Machines) -> None:
    machines.make_authority("robot1")
    host, place, code = machines.invite("robot2")
    status, _, err = machines.join("robot3", place, code)
    assert status == 1 and "the code is for a machine of another name" in err
    status, _, err = machines.join("robot2", place, code.lower().replace("-", " "))
    assert (status, err) == (0, "")
    assert finish(host) == (0, "robot2 is enrolled\n", "")
    status, _, err = machines.join("robot2", place, code)
    assert status == 1 and f"no authority listens at {place}" in err
    # The next invitation has another code.
    _, place, other = machines.invite("robot3")
    assert other != code
    status, _, err = machines.join("robot3", place, code)
    assert status == 1 and "the code is wrong" in err
    assert not machines.credentials("robot3").exists()


def test_a_code_expires(machines: Machines) -> None:
    machines.make_authority("robot1")
    host, place, code = machines.invite("robot2", "--valid", "0.02")
    status, _, err = finish(host)
    assert status == 1 and "the code has expired, and nobody has used it" in err
    status, _, err = machines.join("robot2", place, code)
    assert status == 1 and f"no authority listens at {place}" in err


def test_what_is_no_code_is_refused_before_anything_is_sent(machines: Machines) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        place = f"127.0.0.1:{listener.getsockname()[1]}"
        for text in ["", "7K2Q", "7K2Q-X3M2-P9RT-BWZ4-7K2Q", "7K2Q-X3M2-P9RT-BWZ!"]:
            status, _, err = machines.join("robot2", place, text)
            assert status == 1 and "that is no code" in err
        listener.setblocking(False)
        with pytest.raises(BlockingIOError):
            listener.accept()


def record(place: str, said: list[bytes], answers: bool) -> str:
    """Stands between both, and records what the machine says. Returns where it listens."""
    listener = socket.create_server(("127.0.0.1", 0))
    host, _, port = place.partition(":")

    def lead() -> None:
        machine, _ = listener.accept()
        with listener, machine, socket.create_connection((host, int(port))) as authority:
            machine.sendall(receive(authority, 40))
            said.append(machine.recv(1 << 16))
            if answers:
                authority.sendall(said[0])
                while data := authority.recv(1 << 16):
                    machine.sendall(data)

    threading.Thread(target=lead, daemon=True).start()
    return f"127.0.0.1:{listener.getsockname()[1]}"


def receive(connection: socket.socket, count: int) -> bytes:
    """So many bytes."""
    data = b""
    while len(data) < count:
        more = connection.recv(count - len(data))
        assert more
        data += more
    return data


def test_a_recorded_handshake_is_worth_nothing(machines: Machines) -> None:
    machines.make_authority("robot1")
    host, place, code = machines.invite("robot2")
    said: list[bytes] = []
    status, _, err = machines.join("robot2", record(place, said, answers=False), code)
    assert status == 1 and "the link to" in err and "has ended" in err
    assert b"BEGIN CERTIFICATE REQUEST" in said[0] and b"PRIVATE KEY" not in said[0]
    address, _, port = place.partition(":")
    with socket.create_connection((address, int(port))) as replay:
        receive(replay, 40)
        replay.sendall(said[0])
        # The first refusal: the code is wrong.
        assert receive(replay, 1) == b"\x01"
        assert replay.recv(1) == b""
    assert machines.join("robot2", place, code)[0] == 0
    assert finish(host)[0] == 0


def test_who_stands_between_both_changes_nothing(machines: Machines) -> None:
    machines.make_authority("robot1")
    _, place, code = machines.invite("robot2")
    status, out, _ = machines.join("robot2", record(place, [], answers=True), code)
    assert status == 0, out
    # Whoever does not know the code is not believed.
    for answer in [
        b"\0" + struct.pack(">I", 2) + b"{}" + bytes(32),
        b"\0" + struct.pack(">I", 0xFFFFFFFF),
        b"\x63",
        b"",
    ]:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            place = f"127.0.0.1:{listener.getsockname()[1]}"
            joining = machines.begin_to_join("robot3", place, code)
            connection, _ = listener.accept()
            with connection:
                connection.sendall(b"HPRM-E01" + bytes(32))
                connection.recv(1 << 16)
                connection.sendall(answer)
            status, _, err = finish(joining)
        assert (status, err.count("error: ")) == (1, 1), err
    assert not machines.credentials("robot3").exists()


def test_garbage_and_idle_connections_do_not_keep_a_machine_out(machines: Machines) -> None:
    machines.make_authority("robot1")
    host, place, code = machines.invite("robot2")
    address, _, port = place.partition(":")
    noise = [b"", b"GET / HTTP/1.1\r\n\r\n", bytes(36), b"\xff" * 100_000, bytes(32) + b"\0\0\x1f"]
    for number in range(1000):
        connection = socket.create_connection((address, int(port)))
        connection.setblocking(False)
        with contextlib.suppress(OSError):
            connection.send(noise[number % len(noise)])
        machines.sockets.append(connection)
    assert memory(host) < 64 << 20
    status, _, err = machines.join("robot2", place, code)
    assert (status, err) == (0, "")
    assert finish(host) == (0, "robot2 is enrolled\n", "")


def memory(process: subprocess.Popen[str]) -> int:
    """The bytes of memory that a process has had at most."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    (kilobytes,) = re.findall(r"VmHWM:\s+(\d+) kB", status)
    return int(kilobytes) << 10


def start(machines: Machines, *names: str) -> None:
    """Starts the agents of enrolled machines, each connected to the first."""
    ports = free_ports(len(names))
    connect: list[str] = []
    for name, port in zip(names, ports, strict=True):
        machines.start_agent(name, "--listen", f"127.0.0.1:{port}", *connect)
        connect = ["--connect", f"127.0.0.1:{ports[0]}"]
    for name in names:
        machines.wait_for(name, [name, *sorted(set(names) - {name})])


def enrolled(machines: Machines, *others: str) -> None:
    """Makes an authority, and enrols other machines."""
    machines.make_authority("robot1")
    for name in others:
        assert machines.enroll(name)[0] == 0


def test_a_machine_of_another_authority_is_not_seen(
    machines: Machines, tmp_path_factory: pytest.TempPathFactory
) -> None:
    enrolled(machines, "robot2")
    start(machines, "robot1", "robot2")
    foreign = Machines(tmp_path_factory.mktemp("foreign"))
    try:
        foreign.make_authority("robot3")
        (port,) = free_ports(1)
        connect = ["--connect", listens_at(machines.agents["robot1"])]
        foreign.start_agent("robot3", "--listen", f"127.0.0.1:{port}", *connect)
        rti, federates = machines.federation(PROGRAM, PLACES)
        assert [finish(process)[0] for process in [rti, *federates]] == [0] * 4
        assert foreign.machines("robot3") == ["robot3"]
        assert machines.machines("robot1") == ["robot1", "robot2"]
    finally:
        foreign.close()


def connections(agent: subprocess.Popen[str]) -> set[str]:
    """The addresses that are connected to the port of an agent."""
    port = int(listens_at(agent).rpartition(":")[2])
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    established = "01"
    return {
        line[1] for line in lines if line[2].endswith(f":{port:04X}") and line[3] == established
    }


def test_a_connection_that_carries_much_both_ways_is_still_there(machines: Machines) -> None:
    enrolled(machines, "robot2")
    start(machines, "robot1", "robot2")
    before = connections(machines.agents["robot1"])
    assert len(before) == 1
    # It comes back from the other machine as it was sent.
    program = LONG.replace("answer.set(int(inp.value[-1]) * 10", "answer.set(inp.value * 10")
    program = program.replace("append(answer.value)", "append(int(answer.value[-1]))")
    rti, federates = machines.federation(program, PLACES)
    out, expected = alone(machines.folder, program)
    assert finish(federates[0]) == (0, out, "")
    assert [finish(process)[0] for process in [rti, *federates[1:]]] == [0] * 3
    assert reactions(machines.folder / name for name in PLACES) == expected
    assert connections(machines.agents["robot1"]) == before


def test_a_machine_is_enrolled_while_a_federation_of_others_runs(machines: Machines) -> None:
    enrolled(machines, "robot2")
    start(machines, "robot1", "robot2")
    rti, federates = machines.federation(LONG, PLACES)
    assert federates[0].stdout is not None
    read = federates[0].stdout.readline()
    assert machines.enroll("robot3")[0] == 0
    (port,) = free_ports(1)
    connect = ["--connect", listens_at(machines.agents["robot2"])]
    machines.start_agent("robot3", "--listen", f"127.0.0.1:{port}", *connect)
    machines.wait_for("robot1", ["robot1", "robot2", "robot3"])
    machines.wait_for("robot2", ["robot2", "robot1", "robot3"])
    out, expected = alone(machines.folder, LONG)
    assert finish(federates[0], read) == (0, out, "")
    assert [finish(process)[0] for process in [rti, *federates[1:]]] == [0] * 3
    assert reactions(machines.folder / name for name in PLACES) == expected


def test_a_revoked_machine_is_refused_by_all_from_then_on(machines: Machines) -> None:
    enrolled(machines, "robot2", "robot3")
    start(machines, "robot1", "robot2", "robot3")
    rti, federates = machines.federation(ENDLESS, PLACES)
    assert federates[0].stdout is not None
    federates[0].stdout.readline()
    code, out, err = finish(machines.spawn("robot1", AGENT, "revoke", "robot2"))
    assert (code, err) == (0, "") and out.startswith("robot2 is revoked")
    # Its agent ends, its processes too, and the others that had links to it.
    code, _, err = finish(machines.agents.pop("robot2"))
    assert code == 1 and "error: the authority has taken robot2 out of its machines" in err
    assert all(finish(process)[0] == 1 for process in [rti, *federates])
    machines.wait_for("robot1", ["robot1", "robot3"])
    machines.wait_for("robot3", ["robot3", "robot1"])
    code, _, err = finish(machines.spawn("robot2", AGENT))
    assert code == 1 and "the authority has taken robot2 out" in err
    machines.agents["robot1"].terminate()
    _, _, err = finish(machines.agents.pop("robot1"))
    assert "has ended: the authority has taken robot2 out of its machines" in err
    code, _, err = finish(machines.spawn("robot1", AGENT, "revoke", "robot2"))
    assert code == 1 and "no machine has the name robot2; there are: robot1, robot3" in err
    # It may be enrolled again.
    assert machines.enroll("robot2")[0] == 0


def test_a_machine_that_keeps_its_old_roster_is_refused_as_well(machines: Machines) -> None:
    enrolled(machines, "robot2", "robot3")
    start(machines, "robot1", "robot2", "robot3")
    # What an attacker would do with a stolen machine: the new roster is never taken.
    thief = machines.agents["robot2"]
    os.kill(thief.pid, signal.SIGSTOP)
    roster = machines.credentials("robot2") / "roster.json"
    old = roster.read_text()
    assert finish(machines.spawn("robot1", AGENT, "revoke", "robot2"))[0] == 0
    machines.wait_for("robot1", ["robot1", "robot3"])
    machines.wait_for("robot3", ["robot3", "robot1"])
    connect = listens_at(machines.agents["robot1"])
    thief.kill()
    finish(machines.agents.pop("robot2"))
    assert roster.read_text() == old
    with machines.spy("robot2", connect) as spy:
        token = spy.liveliness().declare_token(f"hprm/agents/2/machines/robot2/{1:016x}")
        rti, federates = machines.federation(PROGRAM, PLACES | dict.fromkeys(PLACES, "robot3"))
        assert [finish(process)[0] for process in [rti, *federates]] == [0] * 4
        assert machines.machines("robot1") == ["robot1", "robot3"]
        assert machines.machines("robot3") == ["robot3", "robot1"]
        del token


def test_an_agent_that_was_away_learns_of_a_new_roster_from_any_other(machines: Machines) -> None:
    enrolled(machines, "robot2", "robot3")
    assert finish(machines.spawn("robot1", AGENT, "revoke", "robot3"))[0] == 0
    assert machines.enroll("robot4")[0] == 0
    # Neither knows of the other: robot2 has the roster with robot3, and robot4 the newest.
    start(machines, "robot2", "robot4")
    (port,) = free_ports(1)
    connect = ["--connect", listens_at(machines.agents["robot2"])]
    agent = machines.spawn("robot3", AGENT, "--listen", f"127.0.0.1:{port}", *connect)
    code, _, err = finish(agent)
    assert code == 1 and "the authority has taken robot3 out of its machines" in err
    newest = (machines.credentials("robot4") / "roster.json").read_text()
    assert (machines.credentials("robot2") / "roster.json").read_text() == newest


def test_what_is_put_in_the_place_of_a_roster_changes_nothing(machines: Machines) -> None:
    enrolled(machines, "robot2")
    start(machines, "robot1", "robot2")
    path = machines.credentials("robot2") / "roster.json"
    text = path.read_text()
    draft = path.with_name("draft")
    draft.write_text(text.replace("robot1", "robot9"))
    draft.rename(path)
    agent = machines.agents["robot2"]
    assert agent.stderr is not None
    assert "the authority has not signed it" in agent.stderr.readline()
    assert machines.machines("robot2") == ["robot2", "robot1"]


def test_a_machine_takes_no_name_and_reads_no_link_of_another(machines: Machines) -> None:
    enrolled(machines, "robot2", "robot3")
    start(machines, "robot1", "robot2")
    root = "hprm/agents/2"
    heard: list[str] = []
    with machines.spy("robot3", listens_at(machines.agents["robot1"])) as spy:
        # With its certificate it is a machine of its own.
        mine = spy.liveliness().declare_token(f"{root}/machines/robot3/{7:016x}")
        machines.wait_for("robot1", ["robot1", "robot2", "robot3"])
        # It is not another one, nor two.
        others = [
            spy.liveliness().declare_token(f"{root}/machines/{name}/{1:016x}")
            for name in ("robot2", "robot4", "robot1")
        ]
        subscribers = [
            spy.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
            for key in (f"{root}/links/**", f"{root}/**", "**", f"{root}/links/robot1/*/*/*")
        ]
        asked: list[str] = []
        queryables = [
            spy.declare_queryable(key, lambda query: asked.append(str(query.key_expr)))
            for key in (f"{root}/open/**", f"{root}/open/robot1/**", "**", f"{root}/open/robot3/**")
        ]
        rti, federates = machines.federation(PROGRAM, PLACES)
        told = spy.liveliness().get(f"{root}/machines/robot1/*")
        tokens = [str(reply.ok.key_expr) for reply in told if reply.ok is not None]
        # One of them is its own.
        (agent,) = (token for token in tokens if not token.endswith(f"/{1:016x}"))
        here = agent.removeprefix(f"{root}/machines/")
        payload = b'{"number": 5, "name": "nobody"}'
        answers = {
            name: [
                reply.ok.payload.to_string()
                for reply in spy.get(
                    f"{root}/open/{here}/{name}/{7:016x}",
                    payload=payload,
                    timeout=5,
                    target=zenoh.QueryTarget.ALL,
                )
                if reply.ok is not None
            ]
            for name in ("robot3", "robot2")
        }
        # In the name of another machine, it opens nothing.
        assert answers["robot2"] == []
        assert answers["robot3"] == ["absent no process listens at agent:robot1/nobody\n"]
        out, expected = alone(machines.folder, PROGRAM)
        outcomes = [finish(federate) for federate in federates]
        assert outcomes == [(0, out, ""), (0, "", ""), (0, "", "")]
        assert finish(rti)[0] == 0
        assert reactions(machines.folder / name for name in PLACES) == expected
        assert machines.machines("robot1") == ["robot1", "robot2", "robot3"]
        assert machines.machines("robot2")[:2] == ["robot2", "robot1"]
        assert all(agent.poll() is None for agent in machines.agents.values())
        # What it asks itself, its own session answers, too.
        foreign = [key for key in asked if not key.endswith(f"/{7:016x}")]
        assert (heard, foreign) == ([], [])
        # It knows that it is heard itself, and need not know whom else others hear.
        pairs = [f"{root}/links/{here}/{name}/*" for name in ("robot2", "robot3")]
        remote = zenoh.Locality.REMOTE
        publishers = [spy.declare_publisher(key, allowed_destination=remote) for key in pairs]
        # Its stub calls this object a bool.
        statuses: list[Any] = [publisher.matching_status for publisher in publishers]
        assert [status.matching for status in statuses] == [False, True]
        # What is meant for it, it gets.
        joining = ["--federation-file", "secret", "--rti", "agent:robot3/rti"]
        words = ["federate", "Fed.lf", "source", "--connect-timeout", "1", *joining]
        assert finish(machines.spawn("robot1", HPRM, *words))[0] != 0
        assert any(key.startswith(f"{root}/open/robot3/") for key in asked)
        del mine, others, subscribers, queryables


def test_with_certificates_of_one_s_own_a_machine_takes_any_name(machines: Machines) -> None:
    enrolled(machines, "robot3")
    files = machines.credentials("robot1")
    names = {"cert": "machine.pem", "key": "machine.key", "ca": "authority.pem"}
    tls = [word for what, name in names.items() for word in (f"--tls-{what}", str(files / name))]
    (port,) = free_ports(1)
    machines.start_agent("robot1", "--listen", f"127.0.0.1:{port}", *tls)
    with machines.spy("robot3", f"127.0.0.1:{port}") as spy:
        token = spy.liveliness().declare_token(f"hprm/agents/2/machines/robot4/{1:016x}")
        machines.wait_for("robot1", ["robot1", "robot4"])
        del token


def test_until_gives_up() -> None:
    """The conditions of these tests have a deadline."""
    begun = time.monotonic()
    with pytest.raises(AssertionError):
        until(lambda: False, within=0.1)
    assert time.monotonic() - begun < 5
