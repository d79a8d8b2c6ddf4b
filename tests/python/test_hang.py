"""What does not answer and what breaks: federates that hang, an RTI that does, a direct link.

A hang may be a long computation, so by default it is only reported; with ``--hang-timeout`` it is a
failure. The table in docs/concepts/failures.md names these tests.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time

import pytest
import test_stalls
from processes import COORDINATIONS, Bench, finish, hear, until
from snippets import TELL

# The source sends for ever, but stops when there is a file `stop`.
PROGRAM = (
    """\
target Python { coordination: COORDINATION }
preamble {=
import os, pathlib, socket, time
"""
    + TELL
    + """\
def cut(part):
    "Shut the link that has this in one of its addresses."
    for entry in pathlib.Path("/proc/self/fd").iterdir():
        try:
            link = socket.socket(fileno=os.dup(int(entry.name)))
            names = [link.getpeername(), link.getsockname()]
        except OSError:
            continue
        if any(part in name for name in names if isinstance(name, bytes)):
            link.shutdown(socket.SHUT_RDWR)
=}
reactor Source {
  output out
  timer t(0, 10 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    out.set(self.count)
    if self.count == 5:
        here("source")
        SOURCE
    if pathlib.Path("stop").exists(): request_stop()
  =}
}
reactor Sink {
  input inp
  reaction(inp) {=
    if inp.value == 5:
        here("sink")
        SINK
  =}
}
reactor Bystander {
  timer t(0, 10 msec)
  reaction(t) {= pass =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  bystander = new Bystander()
  source.out -> sink.inp
}
"""
)
FEDERATES = ["source", "sink", "bystander"]


def program(coordination: str, source: str = "pass", sink: str = "pass") -> str:
    """The text of the program."""
    text = PROGRAM.replace("COORDINATION", coordination)
    return text.replace("SOURCE", source).replace("SINK", sink)


@pytest.mark.parametrize(
    ("coordination", "by_hand"), [("centralized", True), ("decentralized", False)]
)
def test_a_federate_that_hangs_is_told(bench: Bench, coordination: str, by_hand: bool) -> None:
    text = program(coordination)
    if by_hand:
        federation = bench.by_hand(text, *FEDERATES)
        teller = federation.members["rti"]
    else:
        teller = bench.start(text)
    pid = bench.pid("sink")
    os.kill(pid, signal.SIGSTOP)
    stream = teller.stdout if by_hand else teller.stderr
    hear(stream, "federate sink has not answered for 5 s")
    os.kill(pid, signal.SIGCONT)
    hear(stream, "federate sink answers again, after")
    (bench.folder / "stop").touch()
    for process in bench.started:
        outcome = finish(process)
        assert outcome.code == 0
        assert outcome.errors == []


@pytest.mark.parametrize(
    ("coordination", "hang"), [("centralized", "stopped"), ("decentralized", "endless")]
)
def test_a_hang_may_be_a_failure(bench: Bench, coordination: str, hang: str) -> None:
    text = program(coordination, sink="while True: pass" if hang == "endless" else "pass")
    process = bench.start(text, "--hang-timeout", "1.5")
    pid = bench.pid("sink")
    if hang == "stopped":
        os.kill(pid, signal.SIGSTOP)
    outcome = finish(process)
    assert outcome.code == 1
    outcome.assert_one_error("error: federate sink has not answered for 1 s")
    if hang == "stopped":
        # It does not even hear that it is asked to end.
        assert "warning: killed federates that did not end by themselves: sink" in outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("hang", [test_stalls.ENDLESS, test_stalls.SLEEPING, test_stalls.NATIVE])
def test_a_thread_that_hangs_may_be_a_failure(bench: Bench, coordination: str, hang: str) -> None:
    # The others cannot answer either while one holds the interpreter.
    text = test_stalls.program("federated", hang).replace(
        "federated reactor {",
        "reactor Idle { timer t(0, 3 ms)\n reaction(t) {= pass =} }\n"
        "federated reactor { idle = new[3] Idle() ",
    )
    text = text.replace("target Python", f"target Python {{ coordination: {coordination} }}")
    outcome = bench.run(text, "--in-process", "--hang-timeout", "1.5")
    assert outcome.code == 1
    outcome.assert_one_error("error: federate worker has not answered for 1 s")
    assert "warning: ends federates that have not ended within 2 s: " in outcome.err
    test_stalls.assert_told(outcome.err, text, "federated", hang)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_hangs_by_hand_ends_when_it_wakes(bench: Bench, coordination: str) -> None:
    federation = bench.by_hand(program(coordination), *FEDERATES, options=["--hang-timeout", "1"])
    pid = bench.pid("sink")
    os.kill(pid, signal.SIGSTOP)
    outcomes = federation.finish("rti", "source", "bystander")
    assert {outcome.code for outcome in outcomes.values()} == {1}
    outcomes["rti"].assert_one_error("error: federate sink has not answered for 1 s")
    os.kill(pid, signal.SIGCONT)
    outcome = finish(federation.members["sink"])
    assert outcome.code == 1
    outcome.assert_one_error("error: federation Main: the link to the RTI is lost")


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_rti_that_hangs_is_waited_for(bench: Bench, coordination: str) -> None:
    # The RTI stands still for longer than federates may be silent, and must not blame them.
    options = ["--hang-timeout", "0.4"]
    federation = bench.by_hand(program(coordination), *FEDERATES, options=options)
    bench.pid("sink")
    rti = federation.members["rti"]
    rti.send_signal(signal.SIGSTOP)
    (bench.folder / "stop").touch()
    time.sleep(1)
    rti.send_signal(signal.SIGCONT)
    outcomes = federation.finish()
    assert {outcome.code for outcome in outcomes.values()} == {0}, outcomes


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_waits_for_an_rti_that_hangs_can_be_interrupted(
    bench: Bench, coordination: str
) -> None:
    federation = bench.by_hand(program(coordination), *FEDERATES)
    bench.pid("sink")
    rti = federation.members["rti"]
    rti.send_signal(signal.SIGSTOP)
    for name in FEDERATES:
        until(lambda name=name: interrupted(federation.members[name]), f"{name} has ended")
    outcomes = federation.finish(*FEDERATES)
    assert {outcome.code for outcome in outcomes.values()} == {130}, outcomes
    assert {outcome.err for outcome in outcomes.values()} == {""}
    rti.send_signal(signal.SIGCONT)
    assert finish(rti).code == 130


def interrupted(process: subprocess.Popen[str]) -> bool:
    """Whether a process has ended; if not, interrupt it once more."""
    process.send_signal(signal.SIGINT)
    return process.poll() is not None


@pytest.mark.parametrize("end", ["source", "sink"])
@pytest.mark.parametrize("by_hand", [False, True])
def test_a_direct_link_breaks(bench: Bench, end: str, by_hand: bool) -> None:
    # The address of a federate ends in its number and its process.
    text = program("decentralized", **{end: 'cut(b"-1-")'})
    if by_hand:
        federation = bench.by_hand(text, *FEDERATES)
        outcomes = federation.finish()
        assert {outcome.code for outcome in outcomes.values()} == {1}
        teller = outcomes["rti"]
    else:
        teller = finish(bench.start(text))
        assert teller.code == 1
    teller.assert_one_error("error: federate s", "the link to federate s", "is broken, although")
