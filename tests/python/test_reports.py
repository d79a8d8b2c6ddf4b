"""Failures as programs read them: with --json, one object for each on the standard error."""

from __future__ import annotations

import json
import signal
from typing import Any

import pytest
from processes import COORDINATIONS, Bench, finish
from test_failures import MAIN, line_of, program
from test_store_limit import WITHOUT_MEMORY

FIELDS = {
    *("kind", "message", "code", "diagnostic", "federate", "reaction", "tag", "file", "line"),
    *("column", "excerpt", "details", "hint"),
}

#: In one process, as processes, as threads: the coordination and the options.
WAYS = [
    (None, ()),
    ("centralized", ()),
    ("decentralized", ()),
    ("centralized", ("--in-process",)),
]


def reports(err: str) -> list[dict[str, Any]]:
    """What is told of failures, among other lines."""
    found = [json.loads(line) for line in err.splitlines() if line.startswith('{"kind":')]
    assert all(set(report) == FIELDS for report in found)
    return found


def told(bench: Bench, text: str, *options: str, code: int = 1) -> dict[str, Any]:
    """The one failure that ends a program."""
    outcome = bench.run(text, "--json", *options)
    assert outcome.code == code, outcome.err
    (report,) = reports(outcome.err)
    assert outcome.errors == [], "nothing is told as text"
    return report


@pytest.mark.parametrize(("coordination", "options"), WAYS)
def test_an_exception_has_a_reaction_a_tag_and_a_place(
    bench: Bench, coordination: str | None, options: tuple[str, ...]
) -> None:
    text = program(coordination, "raise ValueError('no')")
    report = told(bench, text, *options)
    reaction, federate = ("Main.1", None) if coordination is None else ("Main.pong.1", "pong")
    assert report["message"].endswith(f"reaction {reaction} raised ValueError: no")
    expected = {
        "kind": "reaction",
        "code": 1,
        "federate": federate,
        "reaction": reaction,
        "tag": [20_000_000, 0],
        "file": "Main.lf",
        "line": line_of(text, "raise ValueError"),
    }
    assert expected == {key: report[key] for key in expected}
    assert report["details"].startswith("Traceback")


@pytest.mark.parametrize(("coordination", "options"), WAYS[1:])
@pytest.mark.parametrize(
    ("body", "kind", "message", "code"),
    [
        ("sys.exit(3)", "exit", "federate pong exited with code 3", 3),
        ("sys.exit('enough')", "quit", "federate pong: enough", 1),
        ("raise KeyboardInterrupt", "interrupted", "federate pong exited with code 130", 130),
    ],
)
def test_an_end_that_is_chosen_is_told_by_its_code(
    bench: Bench,
    coordination: str,
    options: tuple[str, ...],
    body: str,
    kind: str,
    message: str,
    code: int,
) -> None:
    report = told(bench, program(coordination, body), *options, code=code)
    assert (report["kind"], report["message"], report["code"]) == (kind, message, code)
    assert (report["federate"], report["details"]) == ("pong", None)


def test_a_program_without_federates_that_chooses_its_end_has_not_failed(bench: Bench) -> None:
    outcome = bench.run(program(None, "sys.exit(3)"), "--json")
    assert (outcome.code, outcome.err) == (3, "")


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_process_that_is_killed(bench: Bench, coordination: str) -> None:
    report = told(bench, program(coordination, "os.kill(os.getpid(), 9)"))
    assert (report["kind"], report["federate"]) == ("killed", "pong")
    assert report["message"] == "federate pong was killed by signal 9 (SIGKILL)"
    assert "dmesg" in report["hint"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_process_that_a_signal_has_stopped(bench: Bench, coordination: str) -> None:
    text = program(coordination, f"os.kill(os.getpid(), {signal.SIGINT.value})")
    report = told(bench, text, code=130)
    assert (report["kind"], report["federate"]) == ("interrupted", "pong")
    assert report["message"] == "federate pong exited with code 130"


@pytest.mark.parametrize("coordination", [None, "centralized"])
def test_a_thread_of_the_program(bench: Bench, coordination: str | None) -> None:
    body = "import threading; threading.Thread(target=lambda: 1 / 0, name='eye').start()"
    report = told(bench, program(coordination, body))
    assert report["kind"] == "thread" and report["reaction"] is None
    assert "thread eye raised ZeroDivisionError" in report["message"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_value_that_cannot_be_sent(bench: Bench, coordination: str) -> None:
    text = program(coordination, "pass").replace("out.set(self.count)", "out.set(open(os.devnull))")
    report = told(bench, text)
    assert (report["kind"], report["federate"]) == ("connection", "ping")
    assert report["message"].startswith("federate ping: sending a value on connection")
    assert report["line"] == line_of(text, "reaction(t) ->")


def test_code_that_runs_while_the_program_loads(bench: Bench) -> None:
    text = MAIN.replace("import os,", "raise OSError('no camera')\nimport os,")
    report = told(bench, text)
    assert report["kind"] == "code"
    assert report["message"] == "loading Main raised OSError: no camera"
    assert report["line"] == line_of(text, "raise OSError")


def test_each_mistake_of_a_program_is_a_failure_of_its_own(bench: Bench) -> None:
    text = "target Python\nmain reactor {\n  x = new Nowhere()\n  y = new Neither()\n}\n"
    outcome = bench.run(text, "--json")
    assert outcome.code == 1
    found = reports(outcome.err)
    assert [report["kind"] for report in found] == ["program"] * 2
    assert [report["line"] for report in found] == [3, 4]
    assert all(report["diagnostic"].startswith("LF") for report in found)


def test_a_trace_that_cannot_be_written(bench: Bench) -> None:
    report = told(bench, program(None, "pass"), "--logical-trace", ".")
    assert (report["kind"], report["message"]) == (
        "trace",
        "cannot write the trace .: is a directory",
    )


def test_what_the_command_cannot_do(bench: Bench) -> None:
    outcome = finish(bench.call("run", "--json", "Nowhere.lf"))
    (report,) = reports(outcome.err)
    assert (outcome.code, report["kind"]) == (1, "command")
    assert report["message"] == "cannot read Nowhere.lf: No such file or directory"
    assert report["hint"].startswith("is the path right?")


def test_by_hand_each_process_tells_what_it_knows(bench: Bench) -> None:
    text = program("centralized", "raise ValueError('no')")
    (bench.folder / "Main.lf").write_text(text)
    federation = bench.federation()
    for name in ("rti", "ping", "pong"):
        federation.start(name, "--json")
    outcomes = federation.finish()
    found = {name: reports(outcome.err) for name, outcome in outcomes.items()}
    assert [len(told) for told in found.values()] == [1, 1, 1], found
    for name in ("rti", "ping"):
        (report,) = found[name]
        assert (report["kind"], report["federate"]) == ("reaction", "pong")
        assert "reaction Main.pong.1 raised ValueError: no" in report["message"]
    assert found["pong"][0]["line"] == found["rti"][0]["line"] == line_of(text, "raise ValueError")


def test_a_federate_that_ends_without_a_word_is_lost(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text(program("centralized", "os._exit(4)"))
    federation = bench.federation()
    for name in ("rti", "ping", "pong"):
        federation.start(name, "--json")
    outcomes = federation.finish()
    for name in ("rti", "ping"):
        (report,) = reports(outcomes[name].err)
        assert (report["kind"], report["federate"]) == ("lost", "pong")
    assert outcomes["pong"].err == ""


def test_without_an_rti(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text(program("centralized", "pass"))
    federation = bench.federation()
    federation.start("ping", "--json", "--connect-timeout", "0.1")
    outcome = federation.finish()["ping"]
    (report,) = reports(outcome.err)
    assert (outcome.code, report["kind"]) == (1, "rti")
    assert "hprm rti" in report["hint"]


def test_a_federate_that_has_already_joined_is_refused(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text(program("centralized", "pass"))
    federation = bench.federation()
    federation.start("rti")
    federation.start("ping")
    federation.await_joined("ping")
    second = bench.federation(federation.address)
    second.id = federation.id
    second.start("ping", "--json")
    (report,) = reports(second.finish()["ping"].err)
    assert report["kind"] == "refused"
    assert "already joined" in report["message"]
    for member in federation.members.values():
        member.terminate()
    federation.finish()


def test_commands_with_one_result_have_the_failure_in_it(bench: Bench) -> None:
    outcome = finish(bench.call("diff", "--json", "a.trace", "b.trace"))
    report = json.loads(outcome.out)["error"]
    assert (outcome.code, outcome.err, set(report)) == (1, "", FIELDS)
    assert report["kind"] == "command" and "a.trace" in report["message"]
    (bench.folder / "Main.lf").write_text(program(None, "raise ValueError('no')"))
    outcome = finish(bench.call("verify", "--json", "--runs", "2", "Main.lf"))
    report = json.loads(outcome.out)["error"]
    assert (outcome.code, set(report)) == (1, FIELDS)
    assert "raised ValueError: no" in report["message"]


@pytest.mark.parametrize(("coordination", "options"), WAYS)
@pytest.mark.parametrize(
    "write", ["sys.stderr.write('x'); sys.stderr.flush()", "os.write(2, b'x')"]
)
def test_an_object_begins_on_a_line_of_its_own(
    bench: Bench, coordination: str | None, options: tuple[str, ...], write: str
) -> None:
    report = told(bench, program(coordination, f"{write}; raise ValueError('no')"), *options)
    assert report["message"].endswith("raised ValueError: no")


#: What a body does to the connection with the RTI, or with a peer.
NOISE = """\
import socket
for entry in os.listdir('/proc/self/fd'):
    try:
        sock = socket.socket(fileno=os.dup(int(entry)))
        if sock.family == socket.AF_INET and sock.getpeername():
            sock.sendall(b'\\xff' * 100)
    except OSError:
        pass
"""


def test_a_federate_whose_bytes_are_no_frames_breaks_the_protocol(bench: Bench) -> None:
    body = "exec(" + repr(NOISE) + ")"
    (bench.folder / "Main.lf").write_text(program("centralized", body))
    federation = bench.federation("127.0.0.1:0")
    for name in ("rti", "ping", "pong"):
        federation.start(name, "--json")
    outcomes = federation.finish()
    for name in ("rti", "ping"):
        (report,) = reports(outcomes[name].err)
        assert (report["kind"], report["federate"], report["code"]) == ("protocol", "pong", 1)
        assert report["message"].startswith("federate pong")
        assert "the federation's protocol: the bytes are not a frame" in report["message"]
    assert "run the same version everywhere" in reports(outcomes["rti"].err)[0]["hint"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_receiver_without_memory_for_a_message(bench: Bench, coordination: str) -> None:
    text = WITHOUT_MEMORY.format(coordination=coordination, room=10_000_000)
    report = told(bench, text)
    assert (report["kind"], report["federate"]) == ("memory", "receiver")
    assert "no memory is left for" in report["message"]
    assert report["hint"].startswith("drop values sooner")


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_receiver_that_cannot_map_the_memory_of_an_object(
    bench: Bench, coordination: str
) -> None:
    text = WITHOUT_MEMORY.replace('"1 MB"', '"1 GB"').replace(
        "bytes(20_000_000)", "__import__('numpy').ones(40_000_000)"
    )
    report = told(bench, text.format(coordination=coordination, room=30_000_000))
    assert (report["kind"], report["federate"]) == ("store", "receiver")
    assert "the object store: " in report["message"]
