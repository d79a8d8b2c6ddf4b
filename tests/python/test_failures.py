"""Programs that end badly: one clear message, an exit code, and nothing left behind."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench, finish, names_in_shared_memory, until

MAIN = """\
target Python
preamble {=
import os, pathlib, sys
=}
main reactor {
  timer t(0, 10 msec)
  state count = 0
  reaction(t) {=
    self.count += 1
    if self.count == 3:
        pathlib.Path("main.pid").write_text(f"{os.getpid()}\\n")
        BODY
  =}
  reaction(shutdown) {=
    print("main stops")
  =}
}
"""

FEDERATION = """\
target Python { coordination: COORDINATION }
preamble {=
import os, pathlib, sys
=}
reactor Ping {
  output out
  timer t(0, 10 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    out.set(self.count)
  =}
  reaction(shutdown) {=
    print("ping stops")
  =}
}
reactor Pong {
  input inp
  reaction(inp) {=
    if inp.value == 3:
        pathlib.Path("pong.pid").write_text(f"{os.getpid()}\\n")
        BODY
  =}
  reaction(shutdown) {=
    print("pong stops")
  =}
}
federated reactor {
  ping = new Ping()
  pong = new Pong()
  ping.out -> pong.inp
}
"""


PROCESSES_AND_THREADS = [
    ("centralized", []),
    ("decentralized", []),
    ("centralized", ["--in-process"]),
]


def program(coordination: str | None, body: str) -> str:
    """A program that does BODY on its third tick; a federation if it has a coordination."""
    text = MAIN if coordination is None else FEDERATION.replace("COORDINATION", coordination)
    return text.replace("BODY", body)


def line_of(text: str, part: str) -> int:
    """The line on which a part of a text stands, from 1."""
    return text[: text.index(part)].count("\n") + 1


# Programs that are wrong: nothing starts.

WRONG = {
    "a syntax error": ("main reactor {\n  reaction(startup {= pass =}\n}\n", 3, "expected"),
    "an unknown reactor": ("main reactor {\n  a = new Missing()\n}\n", 3, "Missing"),
    "a missing import": (
        'import Part from "gone.lf"\nmain reactor {\n  a = new Part()\n}\n',
        2,
        "gone.lf",
    ),
    "a port that does not exist": (
        "reactor A {\n  output out\n}\nmain reactor {\n  a = new A()\n  b = new A()\n"
        "  a.out -> b.inp\n}\n",
        8,
        "inp",
    ),
}


@pytest.mark.parametrize("verb", ["run", "check"])
@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_program_is_named_by_file_and_line(bench: Bench, verb: str, case: str) -> None:
    text, line, part = WRONG[case]
    (bench.folder / "Main.lf").write_text("target Python\n" + text)
    outcome = finish(bench.call(verb, "Main.lf"))
    assert outcome.code == 1
    outcome.assert_one_error(f"Main.lf:{line}:", part)
    assert "Traceback" not in outcome.err


@pytest.mark.parametrize("verb", ["run", "check"])
def test_a_missing_file_is_named(bench: Bench, verb: str) -> None:
    outcome = finish(bench.call(verb, "Gone.lf"))
    assert outcome.code == 1
    outcome.assert_one_error("error: cannot read Gone.lf: No such file or directory")


# Programs that fail while they run.


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
def test_an_exception_names_the_line(bench: Bench, coordination: str | None) -> None:
    text = program(coordination, 'raise ValueError("too hot")')
    outcome = bench.run(text)
    assert outcome.code == 1
    line = line_of(text, "raise ValueError")
    outcome.assert_one_error(
        "ValueError: too hot", f"Main.lf:{line}", 'raise ValueError("too hot")'
    )
    if coordination is not None:
        assert outcome.errors[0].startswith("error: federate pong: "), outcome.err


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
def test_a_mistake_in_a_body_names_the_line(bench: Bench, coordination: str | None) -> None:
    text = program(coordination, "if = 1")
    outcome = bench.run(text)
    assert outcome.code == 1
    outcome.assert_one_error(f"Main.lf:{line_of(text, 'if = 1')}", "invalid syntax")
    assert not (bench.folder / "pong.pid").exists()


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
def test_an_exit_code_is_that_of_the_command(bench: Bench, coordination: str | None) -> None:
    outcome = bench.run(program(coordination, "sys.exit(3)"))
    assert outcome.code == 3
    assert "Traceback" not in outcome.err
    if coordination is not None:
        outcome.assert_one_error("error: federate pong exited with code 3")


@pytest.mark.parametrize(("coordination", "options"), [(None, []), *PROCESSES_AND_THREADS])
@pytest.mark.parametrize(("chosen", "code"), [("-1", 255), ("256", 1), ("259", 3), ("10**30", 1)])
def test_an_exit_code_has_eight_bits_and_a_failure_is_no_zero(
    bench: Bench, coordination: str | None, options: list[str], chosen: str, code: int
) -> None:
    outcome = bench.run(program(coordination, f"sys.exit({chosen})"), *options)
    assert outcome.code == code, outcome.err
    if coordination is not None:
        outcome.assert_one_error(f"error: federate pong exited with code {code}")


@pytest.mark.parametrize(("coordination", "options"), [(None, []), *PROCESSES_AND_THREADS])
def test_a_text_that_no_encoding_has_is_told_with_escapes(
    bench: Bench, coordination: str | None, options: list[str]
) -> None:
    text = program(coordination, r"raise ValueError('no \udcff')")
    outcome = bench.run(text, *options)
    assert outcome.code == 1
    told = r"raised ValueError: no \udcff"
    outcome.assert_one_error(
        told, f"  --> Main.lf:{line_of(text, 'raise ValueError')}", "Traceback"
    )


def test_a_text_that_begins_with_an_empty_line_is_told(bench: Bench) -> None:
    outcome = bench.run(program(None, r"raise ValueError('\n  first\nsecond')"))
    outcome.assert_one_error("error: reaction Main.1 raised ValueError: first\n")


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_end_without_farewell_is_a_failure(bench: Bench, coordination: str) -> None:
    outcome = bench.run(program(coordination, "os._exit(4)"))
    assert outcome.code == 4
    outcome.assert_one_error("error: federate pong exited with code 4")


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize(
    ("body", "own", "rti", "words"),
    [
        ("sys.exit(3)", 3, 3, "error: federate pong exited with code 3"),
        ("os._exit(4)", 4, 1, "error: the process of federate pong ended before its last tag"),
        ("raise ValueError", 1, 1, "error: federate pong: reaction Main.pong.1 raised ValueError"),
    ],
)
def test_a_federate_started_by_hand_fails(
    bench: Bench, coordination: str, body: str, own: int, rti: int, words: str
) -> None:
    outcomes = bench.by_hand(program(coordination, body), "ping", "pong").finish()
    codes = {name: outcome.code for name, outcome in outcomes.items()}
    assert codes == {"rti": rti, "ping": 1, "pong": own}
    outcomes["rti"].assert_one_error(words)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_killed_federate_is_named(bench: Bench, coordination: str) -> None:
    process = bench.start(program(coordination, "pass"))
    os.kill(bench.pid("pong"), signal.SIGKILL)
    outcome = finish(process)
    assert outcome.code == 1
    outcome.assert_one_error("error: federate pong was killed by signal 9 (SIGKILL)")
    assert "Traceback" not in outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_federates_do_not_outlive_the_command(bench: Bench, coordination: str) -> None:
    process = bench.start(program(coordination, "pass"))
    bench.pid("pong")
    assert len(bench.left()) == 3
    process.kill()
    until(lambda: not bench.left(), "the federates have ended")
    assert finish(process).code == -signal.SIGKILL


def test_a_value_that_cannot_be_sent_names_the_reaction(bench: Bench) -> None:
    text = program("centralized", "pass").replace("out.set(self.count)", "out.set(lambda: 1)")
    outcome = bench.run(text)
    # Of a type that depends on the version of Python.
    reason = "Error: Can't "
    outcome.assert_one_error(f" --> Main.lf:{line_of(text, 'reaction(t) -> out')}\n", reason)
    assert outcome.err.count(reason) == 1 and "Traceback" not in outcome.err


def test_a_serializer_that_does_not_exist_names_the_connection(bench: Bench) -> None:
    text = program("centralized", "pass")
    text = text.replace("-> pong.inp", '-> pong.inp serializer "nowhere"')
    outcome = bench.run(text)
    place = f" --> Main.lf:{line_of(text, 'ping.out ->')}\n"
    outcome.assert_one_error("No module named 'nowhere'\n", place, "  hint: a serializer is")
    assert "Traceback" not in outcome.err and "importlib" not in outcome.err


# Being interrupted.


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
def test_an_interrupt_stops_in_order(bench: Bench, coordination: str | None) -> None:
    process = bench.start(program(coordination, "pass"))
    bench.pid("main" if coordination is None else "pong")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome.code == 130
    assert outcome.err == ""
    stopped = {"main stops"} if coordination is None else {"[ping] ping stops", "[pong] pong stops"}
    assert set(outcome.out.splitlines()) == stopped


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
def test_an_interrupt_lets_a_reaction_finish(bench: Bench, coordination: str | None) -> None:
    body = 'while not pathlib.Path("go").exists(): pass\n        print("finished")'
    process = bench.start(program(coordination, body))
    bench.pid("main" if coordination is None else "pong")
    process.send_signal(signal.SIGINT)
    (bench.folder / "go").touch()
    outcome = finish(process)
    assert outcome.code == 130
    assert outcome.err == ""
    prefix = "" if coordination is None else "[pong] "
    assert f"{prefix}finished" in outcome.out.splitlines()
    assert outcome.out.splitlines()[-1].endswith(" stops")


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_stop_in_order_too(
    bench: Bench, coordination: str | None, number: signal.Signals
) -> None:
    (bench.folder / "Main.lf").write_text(program(coordination, "pass"))
    process = bench.call("run", "--logical-trace", "trace", "Main.lf")
    bench.pid("main" if coordination is None else "pong")
    process.send_signal(number)
    outcome = finish(process)
    assert (outcome.code, outcome.err) == (128 + number, "")
    assert len(outcome.out.splitlines()) == (1 if coordination is None else 2)
    assert '"outcome":"interrupted"' in (bench.folder / "trace").read_text().splitlines()[-1]
    assert {file.name for file in bench.folder.iterdir()} <= {
        "Main.lf", "trace", "main.pid", "pong.pid",
    }  # fmt: skip


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_a_federate_by_hand_stops_all_in_order(
    bench: Bench, coordination: str, number: signal.Signals
) -> None:
    federation = bench.by_hand(program(coordination, "pass"), "ping", "pong")
    bench.pid("pong")
    federation.members["pong"].send_signal(number)
    outcomes = federation.finish()
    codes = {name: (outcome.code, outcome.err) for name, outcome in outcomes.items()}
    assert codes == {"rti": (0, ""), "ping": (0, ""), "pong": (128 + number, "")}
    assert outcomes["ping"].out == "ping stops\n"
    assert outcomes["pong"].out == "pong stops\n"


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
def test_a_signal_that_comes_twice_at_once_is_one(bench: Bench, coordination: str | None) -> None:
    body = 'while not pathlib.Path("go").exists(): pass\n        print("finished")'
    process = bench.start(program(coordination, body))
    bench.pid("main" if coordination is None else "pong")
    # To the process and to its group, as timeout(1) does.
    process.send_signal(signal.SIGTERM)
    os.killpg(process.pid, signal.SIGTERM)
    (bench.folder / "go").touch()
    outcome = finish(process)
    assert (outcome.code, outcome.err) == (143, "")
    assert "finished" in outcome.out and outcome.out.endswith(" stops\n")


def test_a_second_signal_interrupts_a_body(bench: Bench) -> None:
    process = bench.start(program(None, "while True: pass"))
    bench.pid("main")

    def gone() -> bool:
        process.send_signal(signal.SIGTERM)
        return process.poll() is not None

    until(gone, "the program has ended")
    # The third one may have come before the second one had its effect.
    assert finish(process).code in (128 + signal.SIGTERM, -signal.SIGTERM)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_interrupt_of_all_processes_is_one(bench: Bench, coordination: str) -> None:
    process = bench.start(program(coordination, "pass"))
    bench.pid("pong")
    for pid in bench.left():
        # Some may end before it is their turn.
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGINT)
    outcome = finish(process)
    assert (outcome.code, outcome.err) == (130, "")


# Processes that bodies fork.

FORK = """\
child = os.fork()
        if child == 0:
            CHILD
        else:
            print("waited", os.waitpid(child, 0)[1])
            lf.request_stop()"""


@pytest.mark.parametrize("coordination", [None, *COORDINATIONS])
@pytest.mark.parametrize(
    ("child", "status"),
    [
        ("pass", 0),
        ("sys.exit(3)", 3 << 8),
        ("raise ValueError", 1 << 8),
        ("signal.raise_signal(signal.SIGTERM); sys.exit(0)", signal.SIGTERM),
    ],
)
def test_a_forked_process_does_not_speak_for_the_federate(
    bench: Bench, coordination: str | None, child: str, status: int
) -> None:
    text = program(coordination, FORK.replace("CHILD", child))
    outcome = bench.run(text.replace("import os,", "import signal, os,"))
    prefix, ends = ("", 1) if coordination is None else ("[pong] ", 2)
    assert outcome.code == 0, outcome.err
    assert f"{prefix}waited {status}" in outcome.out.splitlines()
    assert outcome.out.count(" stops\n") == ends
    assert ("ValueError" in outcome.err) == ("ValueError" in child)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_second_interrupt_does_not_wait(bench: Bench, coordination: str) -> None:
    text = program(coordination, "while True: pass")
    process = bench.start(text)
    bench.pid("pong")
    begun = time.monotonic()

    # The reaction never returns, so nothing stops in order. Of two signals that come at once the
    # system may deliver one.
    def gone() -> bool:
        process.send_signal(signal.SIGINT)
        return process.poll() is not None

    until(gone, "the command has ended")
    outcome = finish(process)
    assert time.monotonic() - begun < 4, "an orderly stop takes five seconds to give up"
    assert outcome.code == 130
    assert outcome.errors == []


SEMAPHORE = """
import multiprocessing
semaphores = []
def make_semaphore():
    semaphores.append(multiprocessing.get_context("spawn").Semaphore())
    pathlib.Path("made").touch()
"""


def test_semaphores_do_not_outlive_a_federation(bench: Bench) -> None:
    text = program("centralized", "make_semaphore()")
    text = text.replace("import os,", f"{SEMAPHORE}\nimport os,")
    before = names_in_shared_memory()
    process = bench.start(text)
    until((bench.folder / "made").exists, "there is a semaphore")
    made = names_in_shared_memory() - before
    for pid in bench.left():
        if b"federate" in Path(f"/proc/{pid}/cmdline").read_bytes():
            os.kill(pid, signal.SIGTERM)
    assert finish(process).code == 1
    assert made and not made & names_in_shared_memory()


UNPRINTABLE = """
    class Weird(Exception):
        def __str__(self): raise RuntimeError("no")
    raise Weird("hm")"""


@pytest.mark.parametrize("options", [[], ["--in-process"]], ids=["processes", "threads"])
def test_an_exception_without_a_text_is_told(bench: Bench, options: list[str]) -> None:
    text = program("centralized", UNPRINTABLE)
    outcome = bench.run(text, *options)
    assert outcome.code == 1
    line = line_of(text, "raise Weird")
    told = "raised Weird: (no text, because __str__ raised RuntimeError)"
    outcome.assert_one_error("error: federate pong: ", told, f"Main.lf:{line}")
    assert "Exception ignored" not in outcome.err


# Federates that are threads of one process.

# The process that a person starts is the program itself, or waits for it to have written a trace.
THREADS = [
    pytest.param(["--in-process", f"--property=coordination={coordination}", *trace], id=name)
    for coordination in COORDINATIONS
    for name, trace in [
        (coordination, []),
        (f"{coordination}, traced", ["--logical-trace=Main.trace"]),
    ]
]


@pytest.mark.parametrize("options", THREADS)
def test_an_exception_in_a_thread_names_the_line(bench: Bench, options: list[str]) -> None:
    text = program("centralized", 'raise ValueError("too hot")')
    outcome = bench.run(text, *options)
    assert outcome.code == 1
    line = line_of(text, "raise ValueError")
    outcome.assert_one_error(
        "error: federate pong: ", f"Main.lf:{line}", 'raise ValueError("too hot")'
    )
    assert not list(bench.folder.glob("Main.trace.parts*"))


@pytest.mark.parametrize("options", THREADS)
def test_a_mistake_is_reported_once_for_all_threads(bench: Bench, options: list[str]) -> None:
    text = program("centralized", "if = 1")
    outcome = bench.run(text, *options)
    assert outcome.code == 1
    outcome.assert_one_error(f"Main.lf:{line_of(text, 'if = 1')}", "invalid syntax")
    assert not (bench.folder / "pong.pid").exists()


@pytest.mark.parametrize("options", THREADS)
@pytest.mark.parametrize(("leave", "code"), [("sys.exit(3)", 3), ("sys.exit(300)", 44)])
def test_an_exit_code_of_a_thread_is_that_of_the_command(
    bench: Bench, options: list[str], leave: str, code: int
) -> None:
    outcome = bench.run(program("centralized", leave), *options)
    assert outcome.code == code
    assert "Traceback" not in outcome.err
    outcome.assert_one_error(f"error: federate pong exited with code {code}")


@pytest.mark.parametrize("options", THREADS)
def test_an_interrupt_stops_threads_in_order(bench: Bench, options: list[str]) -> None:
    process = bench.start(program("centralized", "pass"), *options)
    bench.pid("pong")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert (outcome.code, outcome.err) == (130, "")
    assert set(outcome.out.splitlines()) == {"[ping] ping stops", "[pong] pong stops"}
    traced = bench.folder / "Main.trace"
    assert not traced.exists() or '"outcome":"interrupted"' in traced.read_text()


@pytest.mark.parametrize("options", THREADS)
def test_a_second_interrupt_ends_a_thread_that_does_not(bench: Bench, options: list[str]) -> None:
    process = bench.start(program("centralized", "while True: pass"), *options)
    bench.pid("pong")

    def gone() -> bool:
        process.send_signal(signal.SIGINT)
        return process.poll() is not None

    until(gone, "the command has ended")
    outcome = finish(process)
    assert (outcome.code, outcome.errors) == (130, [])


@pytest.mark.parametrize("options", THREADS)
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_threads_do_not_outlive_the_command(
    bench: Bench, options: list[str], how: signal.Signals
) -> None:
    process = bench.start(program("centralized", "pass"), *options)
    bench.pid("pong")
    process.send_signal(how)
    assert finish(process).code in {-how, 128 + how}
    until(lambda: not bench.left(), "nothing is left")


def test_a_thread_that_does_not_end_is_named_and_left_behind(bench: Bench) -> None:
    text = program("centralized", "while True: pass").replace(
        "self.count += 1", 'if pathlib.Path("pong.pid").exists(): 1 / 0\n    self.count += 1', 1
    )
    outcome = bench.run(text, "--in-process")
    assert outcome.code == 1
    assert "warning: ends federates that have not ended within 2 s: pong" in outcome.err
    outcome.assert_one_error("error: federate ping: ", "ZeroDivisionError")
