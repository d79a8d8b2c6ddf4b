"""The report of a reaction that does not return: its name, tag, duration and line."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from interpreters import FREE_THREADED
from processes import Bench, finish, hear, until
from snippets import TELL

PROGRAM = (
    "target Python\npreamble {=\nimport itertools, os, pathlib, re, time\n"
    + TELL
    + """\
def work():
    LOOP
=}
reactor Worker {
  logical action again
  reaction(startup) -> again {= again.schedule(MSEC(2)) =}
  reaction(again) {=
    here("worker")
    work()
  =}
}
KIND reactor { worker = new Worker() }
"""
)

ENDLESS = "while True: pass"
SLEEPING = "time.sleep(1000)"
NATIVE = "sum(itertools.repeat(0))"

WAYS = [
    ("main", []),
    ("main", ["--workers", "2"]),
    ("federated", []),
    ("federated", ["--property", "coordination=decentralized"]),
    ("federated", ["--in-process"]),
]


def program(kind: str, loop: str) -> str:
    """The text of a program that gets stuck in that."""
    return PROGRAM.replace("KIND", kind).replace("LOOP", loop)


def line_of(text: str, part: str) -> int:
    """The line that contains this, counted from one."""
    return next(at for at, line in enumerate(text.splitlines(), 1) if part in line)


def assert_told(said: str, text: str, kind: str, loop: str) -> None:
    """It says what there is to know of the stuck reaction."""
    of = "" if kind == "main" else " of federate worker"
    written = line_of(text, "reaction(again)")
    title = rf"warning: reaction Main.worker.2{of} \(Main.lf:{written}\) has been running for "
    assert re.search(title + r"(\d+ s|less than a second) at tag \(2 ms, 0\)", said), said
    for part in ("    work()", loop):
        line = line_of(text, part)
        assert re.search(rf'File "\S*Main.lf", line {line},? in \w+\n', said), said
    assert "_program.py" not in said and "__main__" not in said


def assert_named(said: str) -> None:
    """Each line of the report tells which federate it is of."""
    assert all(line.startswith("[worker] ") for line in said.splitlines() if line), said


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let a reaction be long that takes a tenth of a second."""
    monkeypatch.setenv("HPRM_LONG_REACTION", "0.1")
    return


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("loop", [ENDLESS, SLEEPING, NATIVE])
@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_a_reaction_that_does_not_return_is_told(
    bench: Bench, kind: str, options: list[str], loop: str
) -> None:
    text = program(kind, loop)
    process = bench.start(text, *options)
    bench.pid("worker")
    said = hear(process.stderr, " in work\n")
    process.kill()
    said += finish(process).err
    assert_told(said, text, kind, loop)
    if kind == "federated":
        assert_named(said)
    assert said.count("has been running for") == 1
    native = "holds the interpreter inside of code that is not Python's"
    assert (native in said) == (loop == NATIVE and not FREE_THREADED)


SCRIPT = """\
import asyncio, itertools, time
import hprm

class Worker(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    ASYNC def get_stuck(self):
        work()

class Main(hprm.Reactor):
    def __init__(self):
        self.worker = Worker()

def work():
    LOOP

def started():
    hprm.run(Main())

if __name__ == "__main__":
    started()
"""


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("loop", [ENDLESS, NATIVE])
@pytest.mark.parametrize("kind", ["", "async"])
@pytest.mark.parametrize("command", [[], ["-m", "hprm", "run"]])
def test_the_stack_of_a_script_begins_with_the_body(
    tmp_path: Path, loop: str, kind: str, command: list[str]
) -> None:
    text = SCRIPT.replace("ASYNC", kind).replace("LOOP", loop).replace(" " * 5 + "def", "    def")
    (tmp_path / "app.py").write_text(text)
    words = [sys.executable, *command, "app.py"]
    process = subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    said = hear(process.stderr, " in work\n")
    process.kill()
    said += finish(process).err
    title = rf"reaction Main\.worker\.get_stuck \(\S*app.py:{line_of(text, '@hprm')}\) has been"
    assert re.search(title, said), said
    frames = re.findall(r'File ".*?([\w.]+)", line (\d+),? in (\w+)', said)
    assert frames == [
        ("app.py", str(line_of(text, "        work()")), "get_stuck"),
        ("app.py", str(line_of(text, loop)), "work"),
    ]


@pytest.mark.parametrize("loop", [ENDLESS, SLEEPING])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("kind", "options"), [WAYS[0], WAYS[2], WAYS[4]])
def test_a_reaction_that_delays_the_end_is_reported(
    bench: Bench,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    options: list[str],
    number: signal.Signals,
    loop: str,
) -> None:
    monkeypatch.setenv("HPRM_LONG_REACTION", "off")
    text = program(kind, loop)
    process = bench.start(text, *options)
    bench.pid("worker")
    process.send_signal(number)
    said = hear(process.stderr, " in work\n")
    assert_told(said, text, kind, loop)
    assert "and the end waits for it" in said
    process.send_signal(number)
    outcome = finish(process)
    assert outcome.code in (128 + number, 1)
    assert "has been running" not in outcome.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_interrupts_a_reaction_says_which(
    bench: Bench, number: signal.Signals
) -> None:
    text = program("main", ENDLESS)
    process = bench.start(text)
    bench.pid("worker")

    def gone() -> bool:
        process.send_signal(number)
        return process.poll() is not None

    until(gone, "the program has ended")
    outcome = finish(process)
    assert_told(outcome.err, text, "main", ENDLESS)
    assert outcome.err.count("has been running") == 1


def test_a_federate_by_hand_says_what_keeps_it(bench: Bench) -> None:
    text = program("federated", ENDLESS)
    federation = bench.by_hand(text, "worker")
    bench.pid("worker")
    member = federation.members["worker"]
    member.send_signal(signal.SIGTERM)
    assert_told(hear(member.stderr, " in work\n"), text, "federated", ENDLESS)
    member.kill()
    federation.members["rti"].kill()


@pytest.mark.usefixtures("soon")
def test_a_long_reaction_is_no_failure_and_told_once(bench: Bench) -> None:
    text = program("main", "[time.sleep(0.01) for _ in range(40)]").replace(
        "    work()\n", "    work()\n    if lf.tag().microstep < 2: again.schedule(0)\n"
    )
    text = text.replace("reaction(again) {=", "reaction(again) -> again {=")
    outcome = bench.run(text)
    assert outcome.code == 0
    assert outcome.err.count("has been running for") == 1
    assert outcome.errors == []


def test_a_limit_that_means_nothing_is_an_error(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HPRM_LONG_REACTION", "soon")
    outcome = bench.run(program("main", "pass"))
    assert outcome.code == 2
    outcome.assert_one_error("HPRM_LONG_REACTION=soon is wrong: not a positive number of seconds")
