"""What others send that mean no good: to agents, and to those that start programs."""

from __future__ import annotations

import contextlib
import json
import random
import re
import socket
import ssl
import subprocess
from pathlib import Path

import pytest
from machines import HPRM, PLACES, PROGRAM, Machines, alone, finish, listens_at, reactions, until
from stand_in import BYTES, CHALLENGE, FAILED, MISSING, PROOF, STARTED, Listed, StandIn, text
from test_enrolment import enrolled, memory, start

LONG = PROGRAM.replace("timeout: 200 msec", "timeout: 3 sec")
MAIN = Listed("Main.lf", b"target Python\nmain reactor {}\n")


def stranger(machines: Machines) -> StandIn:
    """A link from the first machine to a starter of the second one."""
    one = StandIn.connect(machines.address("robot1"), "robot2")
    machines.sockets.append(one.link)
    return one


def stand_in(machines: Machines) -> StandIn:
    """The same, with a proof of the key."""
    one = stranger(machines)
    one.prove((machines.folder / "keys").read_text().split()[0])
    return one


def kept(machines: Machines) -> list[str]:
    """What the second machine keeps of programs, below its cache and anywhere near."""
    cache = machines.folder / "cache-robot2"
    return sorted(str(path.relative_to(cache)) for path in cache.rglob("*") if path.is_file())


PATHS = [
    "../escaped",
    "lib/../../escaped",
    "/tmp/hprm-escaped",
    "..",
    ".",
    "",
    "lib/",
    "./lib",
    "a\0b",
    "a\x1b[2Jb.lf",
    "a\nb.lf",
    "a\u202eb.lf",
    "a/" * 65 + "a",
    "a" * 1025,
    "Main.lf",
]


@pytest.mark.parametrize("path", PATHS, ids=range(len(PATHS)))
def test_names_of_files_do_not_lead_out_of_the_folder_of_the_program(
    machines: Machines, path: str
) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    one = stand_in(machines)
    one.program("Main.lf", [MAIN, Listed(path, b"escaped")])
    assert "is no path of a file of a program" in one.why()
    assert one.hear() == (-1, b"")
    assert kept(machines) == []
    assert not Path("/tmp/hprm-escaped").exists()


def test_names_in_what_an_agent_writes_have_no_effect_on_a_terminal(machines: Machines) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    one = stand_in(machines)
    one.program("Main.lf", [MAIN], federate="a\x1b[2J\nerror: b")
    assert one.hear()[0] == MISSING
    one.say(BYTES, bytes([len(MAIN.text)]) + MAIN.text)
    assert one.hear()[0] == STARTED
    stderr = machines.agents["robot2"].stderr
    assert stderr is not None
    written = (
        "federate a\\u{1b}[2J\\nerror: b of Main.lf has been started for a key without a name\n"
    )
    assert stderr.readline() == written


EVIL = "\x1b[2J\x1b]0;a\x07\u202e\u009b31m"
SHOWN = r"\u{1b}[2J\u{1b}]0;a\u{7}\u{202e}\u{9b}31m"


def test_what_other_machines_say_has_no_effect_on_a_terminal(machines: Machines) -> None:
    about = {
        "version": EVIL,
        "addresses": [EVIL],
        "processors": 1,
        "memory": 1,
        "federations": ["Vision", EVIL],
    }
    known = [
        {"name": name, "is_here": name == "robot1", "about": about, "clock": None}
        for name in ("robot1", "robot2")
    ]
    (machines.folder / "keys").touch(mode=0o600)
    (machines.folder / "keys").write_text("0" * 31 + "1")
    (machines.folder / "Fed.lf").write_text(PROGRAM)
    challenge = bytes([CHALLENGE, 3]) + bytes(32)
    failed = bytes([FAILED]) + text(f"{EVIL}\n{EVIL}") + b"\1" + text(EVIL)
    answers = b"".join(len(one).to_bytes(4, "little") + one for one in (challenge, failed))
    told = b"done robot1\n" + json.dumps(known).encode()
    run = ("run", "--at", "sink=robot2", "--fleet-key", "keys", "Fed.lf")
    with socket.socket(socket.AF_UNIX) as agent:
        agent.bind("\0" + machines.address("robot1"))
        agent.listen()
        for words, said, expected in [
            (("machines",), [told], SHOWN),
            (("machines", "--json"), [told], SHOWN.replace("\\", "\\\\")),
            (run, [told, f"refused {EVIL}\n".encode()], SHOWN),
            (run, [told, b"done robot2\n" + answers], f"{SHOWN}\n{SHOWN}\n  hint: {SHOWN}\n"),
        ]:
            command = machines.spawn("robot1", HPRM, *words)
            for answer in said:
                link, _ = agent.accept()
                machines.sockets.append(link)
                link.makefile().readline()
                link.sendall(answer)
                link.shutdown(socket.SHUT_WR)
            _, out, err = finish(command)
            assert expected in out + err, (out, err)
            assert all(c.isprintable() or c == "\n" for c in out + err), (out, err)


@pytest.mark.parametrize("path", ["a" * 300, "Main.lf/inside"], ids=["long", "below a file"])
def test_a_file_that_cannot_be_written_is_one_error_and_leaves_nothing(
    machines: Machines, path: str
) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    one = stand_in(machines)
    one.program("Main.lf", [MAIN, Listed(path, b"x")])
    assert one.hear()[0] == MISSING
    for file in (MAIN.text, b"x"):
        one.say(BYTES, bytes([len(file)]) + file)
    assert "robot2 cannot lay out the files of the program" in one.why()
    assert one.hear() == (-1, b"")
    until(lambda: not list((machines.folder / "cache-robot2/hprm/programs/runs").iterdir()))


@pytest.mark.parametrize(
    "sent", [b"target Python\nmain reactor {*}", b"x", b"x" * 100], ids=["other", "short", "long"]
)
def test_who_lies_about_a_digest_has_nothing_started_and_nothing_kept(
    machines: Machines, sent: bytes
) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    one = stand_in(machines)
    one.program("Main.lf", [MAIN])
    assert one.hear()[0] == MISSING
    one.say(BYTES, bytes([len(sent)]) + sent)
    if len(sent) < len(MAIN.text):
        one.link.shutdown(socket.SHUT_WR)
    assert "robot2 cannot take the files of the program" in one.why()
    assert kept(machines) == []
    # The true file is asked for as before.
    other = stand_in(machines)
    other.program("Main.lf", [MAIN])
    assert other.hear() == (MISSING, b"\1\0")


def test_a_kept_file_that_has_changed_is_not_run(machines: Machines) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    one = stand_in(machines)
    one.program("Main.lf", [MAIN])
    assert one.hear()[0] == MISSING
    one.say(BYTES, bytes([len(MAIN.text)]) + MAIN.text)
    # Until all of it is there, it has another name.
    until(lambda: any("." not in Path(it).name for it in kept(machines)))
    # It looks at the file once more when it lays out the program.
    one.link.shutdown(socket.SHUT_WR)
    until(lambda: one.hear() == (-1, b""))
    (file,) = (machines.folder / "cache-robot2/hprm/programs/files").iterdir()
    file.write_bytes(MAIN.text.replace(b"{}", b"{ }")[: len(MAIN.text)])
    other = stand_in(machines)
    other.program("Main.lf", [MAIN])
    assert other.hear() == (MISSING, b"\0")
    assert "has changed in the cache; it is removed" in other.why()
    assert not file.exists()


def test_a_recorded_proof_of_a_key_is_worth_nothing(machines: Machines) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    one = stand_in(machines)
    kind, proof = one.said[0][0], one.said[0][1:]
    assert kind == PROOF
    again = stranger(machines)
    assert again.hear()[0] == CHALLENGE
    again.say(PROOF, proof)
    assert "robot2 does not know the fleet key" in again.why()
    assert again.hear() == (-1, b"")


def test_without_a_key_nothing_that_is_sent_is_looked_at(machines: Machines) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    for sent in [b"\xff" * 64, b"\xff\xff\xff\xff", b"\0\0\0\0", b"\1\0\0\0\1", b""]:
        one = stranger(machines)
        assert one.hear()[0] == CHALLENGE
        one.link.sendall(sent)
        one.link.shutdown(socket.SHUT_WR)
        assert "robot2 does not know the fleet key" in one.why()
    # With a key, a frame that announces too much ends the link as well.
    one = stand_in(machines)
    one.link.sendall(b"\xff\xff\xff\x7f" + bytes(1 << 20))
    assert "does not say what is to be started" in one.why()
    assert kept(machines) == []
    assert all(agent.poll() is None for agent in machines.agents.values())


def test_more_files_than_a_program_may_have_are_refused_before_they_come(
    machines: Machines,
) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root")
    for files in [
        [MAIN, *(Listed(f"f{number}") for number in range(5000))],
        [MAIN, Listed("huge", length=2 << 30)],
        [MAIN, Listed("huge", length=(1 << 64) - 1), Listed("too", length=1)],
    ]:
        one = stand_in(machines)
        one.program("Main.lf", files)
        assert "a program has at most" in one.why()
    one = stand_in(machines)
    one.program("Other.lf", [MAIN])
    assert "the program is not listed" in one.why()


LIMITED = """\
target Python
preamble {=
import resource
=}
reactor Says { reaction(startup) {=
  for what in ("DATA", "NOFILE", "NPROC"):
      print(what, *resource.getrlimit(getattr(resource, f"RLIMIT_{what}")), flush=True)
  try:
      bytearray(600 << 20)
  except MemoryError:
      print("no more memory", flush=True)
  files = []
  try:
      while len(files) < 1000: files.append(open("/dev/null"))
  except OSError as error:
      print(error.strerror, flush=True)
=} }
federated reactor { here = new Says()
  there = new Says() }
"""


def test_a_program_has_limits_that_it_cannot_raise(machines: Machines) -> None:
    limits = ["--program-memory", "512M", "--program-files", "200", "--program-processes", "300"]
    machines.start_agents("--fleet-keys", "keys", "--allow-root", *limits)
    (machines.folder / "Fed.lf").write_text(LIMITED)
    at = ["--at", "there=robot2", "--fleet-key", "keys"]
    code, out, err = finish(machines.spawn("robot1", HPRM, "run", *at, "Fed.lf"))
    assert (code, err) == (0, "")
    said = [line.split("] ")[1] for line in out.splitlines() if line.startswith("[there]")]
    assert said == [
        f"DATA {512 << 20} {512 << 20}",
        "NOFILE 200 200",
        "NPROC 300 300",
        "no more memory",
        "Too many open files",
    ]
    # What a user starts has those of the user.
    assert "[here] no more memory" not in out


def test_garbage_idle_connections_and_half_open_handshakes_disturb_nothing(
    machines: Machines,
) -> None:
    enrolled(machines, "robot2")
    start(machines, "robot1", "robot2")
    rti, federates = machines.federation(LONG, PLACES)
    assert federates[0].stdout is not None
    read = federates[0].stdout.readline()
    host, _, port = listens_at(machines.agents["robot1"]).partition(":")
    noisy = random.Random(0)
    open_ones: list[socket.socket] = []
    for number in range(1000):
        connection = socket.create_connection((host, int(port)))
        connection.setblocking(False)
        with contextlib.suppress(OSError):
            if number % 3 == 1:
                connection.send(noisy.randbytes(20_000))
            elif number % 3 == 2:
                connection.send(client_hello())
        open_ones.append(connection)
        machines.sockets.append(connection)
    out, expected = alone(machines.folder, LONG)
    assert finish(federates[0], read) == (0, out, "")
    assert [finish(process)[0] for process in [rti, *federates[1:]]] == [0] * 3
    assert reactions(machines.folder / name for name in PLACES) == expected
    assert all(memory(agent) < 200 << 20 for agent in machines.agents.values())
    for connection in open_ones:
        connection.close()
    # A machine still gets in.
    assert machines.enroll("robot3")[0] == 0
    machines.start_agent(
        "robot3", "--listen", "127.0.0.1:0", "--connect", listens_at(machines.agents["robot1"])
    )
    machines.wait_for("robot1", ["robot1", "robot2", "robot3"])


def client_hello() -> bytes:
    """The first message of TLS, after which nothing more comes."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    connection = context.wrap_bio(incoming, outgoing)
    with contextlib.suppress(ssl.SSLWantReadError):
        connection.do_handshake()
    return outgoing.read()


def test_without_a_certificate_nothing_is_said(machines: Machines) -> None:
    enrolled(machines, "robot2")
    start(machines, "robot1", "robot2")
    host, _, port = listens_at(machines.agents["robot1"]).partition(":")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    with (
        socket.create_connection((host, int(port)), timeout=30) as connection,
        # With TLS 1.3, the refusal comes with the first answer.
        pytest.raises(ssl.SSLError, match=re.compile("certificate required", re.IGNORECASE)),
        context.wrap_socket(connection) as encrypted,
    ):
        encrypted.sendall(b"\x09\x00")
        encrypted.recv(1)
    # An agent without one connects to nobody, and nobody connects to it.
    foreign = Machines(machines.folder / "foreign")
    foreign.folder.mkdir()
    try:
        connect = ["--connect", f"{host}:{port}"]
        foreign.start_agent("robot3", "--listen", "127.0.0.1:0", *connect)
        rti, federates = machines.federation(PROGRAM, PLACES)
        assert [finish(process)[0] for process in [rti, *federates]] == [0] * 4
        assert foreign.machines("robot3") == ["robot3"]
        assert machines.machines("robot1") == ["robot1", "robot2"]
    finally:
        foreign.close()


def test_a_machine_of_the_roster_that_sends_what_is_too_large_disturbs_no_other(
    machines: Machines,
) -> None:
    enrolled(machines, "robot2", "robot3")
    start(machines, "robot1", "robot2")
    rti, federates = machines.federation(LONG, PLACES)
    assert federates[0].stdout is not None
    read = federates[0].stdout.readline()
    root = "hprm/agents/2"
    with machines.spy("robot3", listens_at(machines.agents["robot1"])) as spy:
        token = spy.liveliness().declare_token(f"{root}/machines/robot3/{7:016x}")
        until(lambda: "robot3" in machines.machines("robot1"))
        (here,) = (
            str(reply.ok.key_expr).removeprefix(f"{root}/machines/")
            for reply in spy.liveliness().get(f"{root}/machines/robot1/*")
            if reply.ok is not None
        )
        link = f"{root}/links/{here}/robot3/{7:016x}"
        for size in (0, 1, 7, 8, 9, 1 << 16, 1 << 20, 64 << 20, 64 << 20):
            spy.put(link, bytes(size))
        for text in (b"", b"{", bytes(1 << 20), b"[" * 100_000):
            list(spy.get(f"{root}/open/{here}/robot3/{7:016x}", payload=text, timeout=1))
            list(spy.get(f"{root}/roster?{2**64 - 1}", timeout=1))
        del token
    out, expected = alone(machines.folder, LONG)
    assert finish(federates[0], read) == (0, out, "")
    assert [finish(process)[0] for process in [rti, *federates[1:]]] == [0] * 3
    assert reactions(machines.folder / name for name in PLACES) == expected
    assert memory(machines.agents["robot1"]) < 400 << 20
    quiet(machines.agents["robot1"])


def quiet(agent: subprocess.Popen[str]) -> None:
    """An agent ends in order, and has said nothing of an error."""
    agent.terminate()
    code, _, err = finish(agent)
    assert code == 0 and "panicked" not in err and "error" not in err, err
