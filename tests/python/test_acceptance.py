"""What users of other middleware complain about, as tests with real processes.

Each test is about one class of complaints: a process that is paused, a loaded machine, a simulator
that is slower or faster than the clock, processes that are started in any order, a call that waits
for itself. ``make test`` runs a small dose; ``make acceptance`` sets HPRM_ACCEPTANCE and runs the
full one.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from processes import COORDINATIONS, Bench, Outcome, finish
from snippets import TELL

FULL = bool(os.environ.get("HPRM_ACCEPTANCE"))


@contextmanager
def load(processes: int = 2) -> Iterator[None]:
    """Keep the machine busy meanwhile."""
    command = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(command) for _ in range(processes)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def report(outcome: Outcome, federate: str) -> dict[str, object]:
    """The JSON object that a federate has printed."""
    assert outcome.code == 0, outcome.err
    start = f"[{federate}] "
    lines = [line for line in outcome.out.splitlines() if line.startswith(start)]
    return json.loads(lines[-1].removeprefix(start))


# A process that is paused.

PAUSED = (
    """\
target Python { coordination: COORDINATION }
preamble {=
import json, os, pathlib
TICKS, PERIOD = 120, 10_000_000
"""
    + TELL
    + """\
=}
reactor Source {
  output out
  logical action next
  state tick = 0
  reaction(startup, next) -> out, next {=
    out.set(self.tick)
    self.tick += 1
    if self.tick == 10: here("source")
    if self.tick < TICKS: next.schedule(PERIOD)
  =}
}
reactor Relay {
  input inp
  output out
  reaction(inp) -> out {=
    if inp.value == 10: here("relay")
    out.set(inp.value)
  =}
}
reactor Sink {
  input direct
  input relayed
  logical action step
  state counts = {= {"in time": 0, "tardy": 0, "wrong": 0} =}
  reaction(startup, step) -> step {=
    # Its own events must wait for messages that are on their way, or make those tardy.
    if lf.time.logical_elapsed() < TICKS * PERIOD: step.schedule(PERIOD // 2)
  =}
  reaction(direct, relayed) {=
    if direct.is_present and direct.value == 10: here("sink")
    self.count((direct, relayed), "in time")
  =} tardy {=
    self.count((direct, relayed), "tardy")
  =}
  reaction(shutdown) {= print(json.dumps(self.counts)) =}
  method count(ways, kind) {=
    for port in ways:
        if port.is_present:
            meant = port.intended_tag
            late = meant != lf.tag()
            right = (meant.time - lf.time.start(), meant.microstep) == (port.value * PERIOD, 0)
            wrong = not right or (late and kind == "in time")
            self.counts["wrong" if wrong else "tardy" if late else "in time"] += 1
  =}
}
federated reactor {
  source = new Source()
  relay = new Relay()
  MAXWAIT
  sink = new Sink()
  source.out -> sink.direct
  source.out -> relay.inp
  relay.out -> sink.relayed
}
"""
)


WAITS = {
    "centralized": ("centralized", ""),
    "decentralized": ("decentralized", ""),
    "limited": ("decentralized", "@maxwait(20 ms)"),
}
SMALL_DOSE = [("source", 3, "limited"), ("relay", 3, "centralized"), ("sink", 3, "decentralized")]
FULL_DOSE = list(itertools.product(["source", "relay", "sink"], [3, 8, 14], WAITS))


@pytest.mark.parametrize(("paused", "seconds", "wait"), FULL_DOSE if FULL else SMALL_DOSE)
def test_a_pause_loses_and_misplaces_no_message(
    bench: Bench, paused: str, seconds: int, wait: str
) -> None:
    coordination, maxwait = WAITS[wait]
    text = PAUSED.replace("COORDINATION", coordination).replace("MAXWAIT", maxwait)
    with load():
        process = bench.start(text)
        pid = bench.pid(paused)
        os.kill(pid, signal.SIGSTOP)
        # The pause is what is tested: nothing else tells that it has been long enough.
        time.sleep(seconds)
        os.kill(pid, signal.SIGCONT)
        counts = report(finish(process), "sink")
    assert counts["wrong"] == 0
    assert counts["in time"] + counts["tardy"] == 240, counts
    if wait != "limited":
        assert counts["tardy"] == 0
    elif paused != "sink":
        assert counts["tardy"] > 0, "a federate that does not wait must notice"


# The same program, however it is run.

PROGRAM = """\
target Python { timeout: 40 ms }
preamble {=
import os, pathlib, time
SECONDS = float(os.environ.get("STEP_SECONDS", "0"))
GATE = os.environ.get("STEP_GATE")
=}
reactor Simulator {
  output frame
  input command
  timer t(0, 1 ms)
  state position = 0
  state seen = {= set() =}
  state gate
  reaction(startup) {=
    pathlib.Path("simulator.pid").write_text(f"{os.getpid()}\\n")
    if GATE: self.gate = open(GATE, "rb", buffering=0)
  =}
  reaction(t) -> frame {=
    # The program must not depend on how long a step takes, or on what permits it.
    if GATE: self.gate.read(1)
    time.sleep(SECONDS)
    self.seen |= {f"object {self.position % 7}", "car", "lane"}
    frame.set({"position": self.position, "seen": sorted(self.seen), "any": set(self.seen)})
  =}
  reaction(command) {= self.position += command.value =}
}
reactor Detector(index = 0) {
  input frame
  output found
  reaction(frame) -> found {= found.set((self.index, frame.value["position"] * (self.index + 1))) =}
}
reactor Planner(width = 3) {
  input[width] found
  output command
  logical action think
  state log = []
  reaction(found) -> think {=
    self.log.append([port.value for port in found if port.is_present])
    think.schedule(USEC(300), sum(value for _, value in self.log[-1]))
  =}
  reaction(think) -> command {= command.set(1 + think.value % 3) =}
}
KIND reactor {
  simulator = new Simulator()
  detectors = new[3] Detector(index = {= bank_index =})
  planner = new Planner()
  (simulator.frame)+ -> detectors.frame
  detectors.found -> planner.found
  planner.command -> simulator.command after 500 us
}
"""


ONE_PROCESS = "one process"
HOW = ["--property=coordination=centralized", "--property=coordination=decentralized", ONE_PROCESS]
STEPS = 41
"""Of the simulator, from 0 to 40 ms."""


def start_traced(bench: Bench, how: str, *options: str, **variables: str) -> subprocess.Popen[str]:
    """Start the program, and have it write down what it does."""
    command = ["run", "--logical-trace", "trace", *options]
    if how == ONE_PROCESS:
        return bench.python("-m", "hprm", *command, "--", "Main.lf", environment=variables)
    return bench.call(*command, how, "Main.lf", environment=variables)


def finish_trace(bench: Bench, process: subprocess.Popen[str]) -> str:
    """The hash of what a program has done; its first line tells what kind of program it is."""
    outcome = finish(process)
    assert outcome.code == 0, outcome.err
    trace = bench.folder / "trace"
    lines = trace.read_text().splitlines()[1:]
    trace.unlink()
    assert len(lines) > 200, "the trace is that of a run"
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


WAYS = list(
    itertools.product(
        ["1", "2", "8"],
        HOW,
        ["0", "1"],
        [False, True],
    )
)
RUNS = 100 if FULL else 6


def test_every_run_does_the_same(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text(PROGRAM.replace("KIND", "federated"))
    hashes = set()
    # A stride that has no divisor in common with the number of ways visits all of them.
    for index in range(RUNS):
        workers, how, seed, busy = WAYS[index * 13 % len(WAYS)]
        with load(2 if busy else 0):
            options = [f"--property=workers={workers}"]
            process = start_traced(bench, how, *options, PYTHONHASHSEED=seed)
            hashes.add(finish_trace(bench, process))
    assert len(hashes) == 1, f"{len(hashes)} behaviours in {RUNS} runs"


@pytest.mark.parametrize("how", HOW)
def test_the_speed_of_a_simulator_does_not_show(bench: Bench, how: str) -> None:
    (bench.folder / "Main.lf").write_text(PROGRAM.replace("KIND", "federated"))
    hashes = {}
    for seconds in ("0", "0.001", "0.01") if FULL else ("0", "0.005"):
        process = start_traced(bench, how, STEP_SECONDS=seconds)
        hashes[f"{seconds} s a step"] = finish_trace(bench, process)
    (bench.folder / "simulator.pid").unlink()
    process = start_traced(bench, how, STEP_SECONDS="0.01")
    pid = bench.pid("simulator")
    os.kill(pid, signal.SIGSTOP)
    # Another clock than the program's own goes on meanwhile.
    time.sleep(0.5)
    os.kill(pid, signal.SIGCONT)
    hashes["paused"] = finish_trace(bench, process)
    hashes["single steps"] = single_steps(bench, how)
    assert len(set(hashes.values())) == 1, hashes


def test_a_simulator_may_be_faster_than_the_clock(bench: Bench) -> None:
    hashes = set()
    for kind, fast in [("federated", "false"), ("main", "false"), ("main", "true")]:
        (bench.folder / "Main.lf").write_text(PROGRAM.replace("KIND", kind))
        hashes.add(finish_trace(bench, start_traced(bench, ONE_PROCESS, f"--property=fast={fast}")))
    assert len(hashes) == 1


def single_steps(bench: Bench, how: str) -> str:
    """Run the program with a driver that permits one step after the other, when it likes."""
    gate = bench.folder / "gate"
    os.mkfifo(gate)
    process = start_traced(bench, how, STEP_GATE=str(gate))
    chance = random.Random(8)
    with gate.open("wb", buffering=0) as driver:
        for _ in range(STEPS):
            time.sleep(chance.choice([0, 0.001, 0.02]))
            driver.write(b".")
        return finish_trace(bench, process)


# Processes that are started in any order.

ORDER = """\
target Python { coordination: COORDINATION, timeout: 30 ms }
reactor Talker {
  output once
  output out
  timer t(0, 5 ms)
  state count = 0
  reaction(startup) -> once {= once.set("first") =}
  reaction(t) -> out {=
    out.set(self.count)
    self.count += 1
  =}
  reaction(shutdown) {= print(lf.time.start(), "talker") =}
}
reactor Listener {
  input once
  input inp
  state heard = []
  reaction(once) {= self.heard.append(once.value) =}
  reaction(inp) {= self.heard.append(inp.value) =}
  reaction(shutdown) {= print(lf.time.start(), *self.heard) =}
}
federated reactor {
  talker = new Talker()
  one = new Listener()
  two = new Listener()
  (talker.once)+ -> one.once, two.once
  (talker.out)+ -> one.inp, two.inp
}
"""
FEDERATES = ["talker", "one", "two"]
ROUNDS = 20 if FULL else 6


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_the_order_of_starting_does_not_matter(bench: Bench, coordination: str) -> None:
    text = ORDER.replace("COORDINATION", coordination)
    chance = random.Random(coordination)
    for _, order in zip(range(ROUNDS), itertools.cycle(itertools.permutations(FEDERATES))):
        federation = bench.by_hand(text)
        for name in order:
            # Some come at once, and some when the others have been there for long.
            time.sleep(chance.choice([0, 0, 0.05, 0.3]))
            federation.start(name)
        outcomes = federation.finish()
        assert all(outcome.code == 0 for outcome in outcomes.values()), (order, outcomes)
        said = {name: outcomes[name].out.split(maxsplit=1) for name in FEDERATES}
        assert len({start for start, _ in said.values()}) == 1, (order, said)
        for name in ("one", "two"):
            assert said[name][1] == "first 0 1 2 3 4 5 6\n", (order, said)


# A call that waits for itself.

ASKING = """\
target Python { coordination: COORDINATION, timeout: 1 s }
reactor Client {
  output request
  input answer
  timer t(0)
  CLIENT
}
reactor Server {
  input request
  output answer
  reaction(request) -> answer {= answer.set(request.value * 2) =}
}
KIND reactor {
  client = new Client()
  server = new Server()
  client.request -> server.request
  server.answer -> client.answer
}
"""
WAITS_FOR_ITSELF = """
  reaction(t) answer -> request {=
    request.set(21)
    print(answer.value)
  =}
"""
IN_TWO_STEPS = """
  reaction(t) -> request {= request.set(21) =}
  reaction(answer) {= print(answer.value, lf.time.logical_elapsed(), lf.tag().microstep) =}
"""


@pytest.mark.parametrize("kind", ["main", "federated"])
@pytest.mark.parametrize("verb", ["check", "run"])
def test_a_reaction_that_waits_for_its_own_answer_is_an_error(
    bench: Bench, kind: str, verb: str
) -> None:
    text = asking("centralized", kind, WAITS_FOR_ITSELF)
    (bench.folder / "Main.lf").write_text(text)
    outcome = finish(bench.call(verb, "Main.lf"))
    assert outcome.code == 1
    outcome.assert_one_error("LF0503", "in a cycle: Main.client.1 -> Main.server.1")


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("kind", ["main", "federated"])
def test_an_answer_comes_at_the_tag_of_the_question(
    bench: Bench, kind: str, coordination: str
) -> None:
    outcome = bench.run(asking(coordination, kind, IN_TWO_STEPS))
    assert outcome.code == 0, outcome.err
    assert outcome.out.removeprefix("[client] ") == "42 0 0\n"


def asking(coordination: str, kind: str, client: str) -> str:
    """A program with such a client."""
    text = ASKING.replace("COORDINATION", coordination).replace("KIND", kind)
    if kind == "main":
        text = text.replace(f"coordination: {coordination}, ", "")
    return text.replace("CLIENT", client)
