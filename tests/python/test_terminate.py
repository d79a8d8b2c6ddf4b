"""SIGTERM ends a program in whatever state it is, within seconds, and leaves nothing behind.

Orderly stops are in test_failures.py. Here one part of the program never answers.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time

import pytest
import test_stalls
from processes import ANOTHER_SIGNAL_S, COORDINATIONS, Bench, Federation, Outcome, finish, until
from test_hang import FEDERATES, program
from test_reports import reports

TERMINATED = 128 + signal.SIGTERM
"""The exit code for SIGTERM."""

# Code that holds the interpreter.
NATIVE = [test_stalls.NATIVE, "re.match('(a+)+$', 'a' * 40 + 'b')"]

ONE_PROCESS = [("main", []), ("main", ["--workers", "2"]), ("federated", ["--in-process"])]


def terminate(federation: Federation, *names: str) -> dict[str, Outcome]:
    """Send SIGTERM to members, all at once, and say how they end."""
    for name in names:
        federation.members[name].send_signal(signal.SIGTERM)
    return federation.finish(*names)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federation_that_cannot_stop_in_order_ends_nevertheless(
    bench: Bench, coordination: str
) -> None:
    federation = bench.by_hand(program(coordination), *FEDERATES)
    os.kill(bench.pid("sink"), signal.SIGSTOP)
    outcomes = terminate(federation, "rti", "source", "bystander")
    assert {name: outcome.code for name, outcome in outcomes.items()} == {
        "rti": TERMINATED,
        "source": TERMINATED,
        "bystander": TERMINATED,
    }
    told = [outcome.err for outcome in outcomes.values()]
    assert any("has not stopped in order within" in text for text in told), told
    # The one that stood still hears of the end when it wakes.
    federation.members["sink"].send_signal(signal.SIGCONT)
    assert finish(federation.members["sink"]).code != 0
    assert not bench.left()


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_rti_that_hangs_keeps_no_federate(bench: Bench, coordination: str) -> None:
    federation = bench.by_hand(program(coordination), *FEDERATES)
    bench.pid("sink")
    rti = federation.members["rti"]
    rti.send_signal(signal.SIGSTOP)
    for outcome in terminate(federation, *FEDERATES).values():
        assert outcome.code == TERMINATED
        outcome.assert_one_error(
            "has not stopped in order within 5 s: it ends now\n",
            "hint: the RTI, another federate or a reaction takes too long",
        )
    rti.send_signal(signal.SIGCONT)
    assert finish(rti).code == TERMINATED
    assert not bench.left()


@pytest.mark.parametrize(
    ("body", "codes"),
    [
        ("while True: time.sleep(60)", {TERMINATED}),
        # Code that never looks for signals.
        ("import itertools; sum(itertools.repeat(0))", {TERMINATED}),
    ],
)
def test_a_reaction_that_does_not_return_is_interrupted(
    bench: Bench, body: str, codes: set[int]
) -> None:
    federation = bench.by_hand(program("centralized", sink=body), *FEDERATES)
    bench.pid("sink")
    outcomes = terminate(federation, "sink") | federation.finish()
    assert outcomes["sink"].code in codes
    outcomes["sink"].assert_one_error(
        "error: federate sink has not stopped in order within 5 s: it ends now",
        "hint: a reaction does not return",
    )
    for name in ("rti", "source", "bystander"):
        assert outcomes[name].code != 0
    assert not bench.left()


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_the_command_ends_what_does_not_answer(bench: Bench, coordination: str) -> None:
    process = bench.start(program(coordination))
    os.kill(bench.pid("sink"), signal.SIGSTOP)
    process.send_signal(signal.SIGTERM)
    outcome = finish(process)
    assert outcome.code == TERMINATED
    assert "warning: killed federates that did not end by themselves: sink" in outcome.err
    until(lambda: not bench.left(), "nothing is left")


def ask(process: subprocess.Popen[str], number: signal.Signals, times: int) -> Outcome:
    """Ask a process to stop, by as many signals, and say how it ends."""
    process.send_signal(number)
    if times == 2:
        time.sleep(ANOTHER_SIGNAL_S)
        process.send_signal(number)
    return finish(process)


@pytest.mark.parametrize("loop", NATIVE)
@pytest.mark.parametrize(("number", "times"), [(signal.SIGTERM, 1), (signal.SIGINT, 2)])
@pytest.mark.parametrize(("kind", "options"), ONE_PROCESS)
def test_code_that_holds_the_interpreter_is_ended(
    bench: Bench, kind: str, options: list[str], number: signal.Signals, times: int, loop: str
) -> None:
    text = test_stalls.program(kind, loop)
    process = bench.start(text, *options)
    bench.pid("worker")
    outcome = ask(process, number, times)
    assert outcome.code == 128 + number, outcome.err
    test_stalls.assert_told(outcome.err, text, kind, loop)
    assert outcome.err.count("has been running for") == 1
    if kind == "main":
        first = "the program has not stopped in order within 5 s: it ends now"
        second = "the program has not ended within 1 s after a second signal: it ends now"
        if times == 1:
            outcome.assert_one_error(first, "hint: a reaction does not return")
        elif loop == test_stalls.NATIVE:
            outcome.assert_one_error(second, "hint: a reaction does not return")
        else:
            # A regular expression looks for signals, on the main thread.
            assert outcome.errors == []
    else:
        first = "warning: ends federates that have not stopped in order within 5 s: worker"
        second = "warning: killed federates that had not ended at the second signal: worker"
        assert (first if times == 1 else second) in outcome.err
        assert outcome.errors == []


@pytest.mark.parametrize("loop", [test_stalls.ENDLESS, test_stalls.SLEEPING])
def test_one_signal_is_enough_for_a_reaction_in_python(bench: Bench, loop: str) -> None:
    process = bench.start(test_stalls.program("main", loop), "--json")
    bench.pid("worker")
    outcome = ask(process, signal.SIGTERM, 1)
    assert outcome.code == TERMINATED
    (report,) = reports(outcome.err)
    assert report["kind"] == "unfinished"
    assert report["message"] == "the program has not stopped in order within 5 s: it ends now"


SCRIPT = """\
import hprm


class Main(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def go(self):
        print("runs", flush=True)
        while True:
            pass


try:
    hprm.run(Main())
except hprm.ProgramFailed:
    print("goes on", flush=True)
    raise
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_signal_interrupts_a_reaction_of_a_script(bench: Bench, number: signal.Signals) -> None:
    (bench.folder / "script.py").write_text(SCRIPT)
    process = bench.python("script.py")
    assert process.stdout is not None
    assert process.stdout.readline() == "runs\n"
    outcome = ask(process, number, 1)
    assert outcome.code == 128 + number
    assert "goes on" in outcome.out
    assert "error: the program has not stopped in order within 5 s: it ends now" in outcome.err
    assert "while True:" in outcome.err


FEDERATION = """\
import hprm


class Motor(hprm.Reactor):
    tick = hprm.Timer("20 ms")

    @hprm.reaction(tick)
    def turn(self):
        print("turns", flush=True)

    @hprm.reaction(hprm.shutdown)
    def stop(self):
        print("is off", flush=True)


class Robot(hprm.Federation, timeout="30 s"):
    def __init__(self):
        self.left, self.right = Motor(), Motor()


if __name__ == "__main__":
    hprm.run(Robot())
"""


def test_a_terminal_that_closes_stops_the_federation_of_a_script_in_order(bench: Bench) -> None:
    (bench.folder / "robot.py").write_text(FEDERATION)
    process = bench.python("robot.py")
    assert process.stdout is not None
    assert "turns" in process.stdout.readline()
    os.killpg(process.pid, signal.SIGHUP)
    outcome = finish(process)
    assert outcome.code == 128 + signal.SIGHUP
    assert "[left] is off" in outcome.out
    assert "[right] is off" in outcome.out
    until(lambda: not bench.left(), "nothing is left")


@pytest.mark.parametrize(("kind", "options"), ONE_PROCESS)
def test_a_trace_is_cut_when_a_program_is_ended(
    bench: Bench, kind: str, options: list[str]
) -> None:
    text = test_stalls.program(kind, test_stalls.NATIVE)
    process = bench.start(text, "--logical-trace", "trace", *options)
    bench.pid("worker")
    outcome = ask(process, signal.SIGTERM, 2)
    assert outcome.code == TERMINATED
    lines = [json.loads(line) for line in (bench.folder / "trace").read_text().splitlines()]
    # That of a thread is merged from what its federate had written, as if that had been killed.
    assert lines[-1]["outcome"] == ("interrupted" if kind == "main" else "failed")
    assert {path.name for path in bench.folder.iterdir()} == {"Main.lf", "worker.pid", "trace"}


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (1, "warning: ends federates that have not stopped in order within 5 s: worker\n"),
        (2, "warning: killed federates that had not ended at the second signal: worker\n"),
    ],
)
def test_the_command_says_what_it_ends(bench: Bench, times: int, said: str) -> None:
    text = test_stalls.program("federated", test_stalls.NATIVE)
    process = bench.start(text)
    bench.pid("worker")
    outcome = ask(process, signal.SIGTERM, times)
    assert outcome.code == TERMINATED
    assert said in outcome.err
    if times == 1:
        test_stalls.assert_told(outcome.err, text, "federated", test_stalls.NATIVE)
    until(lambda: not bench.left(), "nothing is left")


@pytest.mark.parametrize(("kind", "options"), ONE_PROCESS)
@pytest.mark.parametrize("moment", ["sitecustomize", "argparse", "beside"])
def test_ctrl_c_while_the_process_starts_is_quiet(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, kind: str, options: list[str], moment: str
) -> None:
    # A module that is imported by the interpreter, by HPRM or by the program.
    text = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    (bench.folder / f"{moment}.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(bench.folder))
    program = test_stalls.program(kind, "pass").replace(
        "import itertools", "import beside, itertools"
    )
    process = bench.start(program, *options)
    outcome = finish(process)
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "")
