"""The commands with programs in plain Python, by the interpreter that runs them."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish, until

PROGRAM = """\
import sys

import hprm

print("loaded by", sys.argv)


class Source(hprm.Reactor):
    out = hprm.Output(int)
    tick = hprm.Timer(lambda self: self.period)

    def __init__(self, rate: int) -> None:
        self.period = f"{1000 // rate} ms"
        self.count = 0

    @hprm.reaction(tick, effects=[out])
    def emit(self) -> None:
        self.count += 1
        self.out.set(self.count)


class Sink(hprm.Reactor):
    inp = hprm.Input(int)

    @hprm.reaction(inp)
    def take(self) -> None:
        print("got", self.inp.value, *sys.argv[1:], flush=True)


class Whole(hprm.Reactor, timeout="20 ms"):
    def __init__(self, rate: int = 100) -> None:
        self.source, self.sink = Source(rate), Sink()
        hprm.connect(self.source.out, self.sink.inp)


class Parts(hprm.Federation, timeout="20 ms"):
    def __init__(self, rate: int = 100) -> None:
        self.source, self.sink = Source(rate), Sink()
        hprm.connect(self.source.out, self.sink.inp)


class Open(hprm.Reactor):
    def __init__(self) -> None:
        self.sink = Sink()


class Twice(hprm.Reactor):
    def __init__(self) -> None:
        self.sources, self.sink = [Source(1) for _ in range(2)], Sink()
        for source in self.sources:
            hprm.connect(source.out, self.sink.inp)
"""

LOADED = "loaded by ["


@pytest.fixture
def program(bench: Bench) -> Bench:
    (bench.folder / "app.py").write_text(PROGRAM)
    return bench


def call(bench: Bench, *words: str) -> Outcome:
    return finish(bench.call(*words))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["app.py:Whole"], ["got 1", "got 2", "got 3"]),
        (["app.py:Whole", "--rate", "50", "x", "--", "-y"], ["got 1 x -y", "got 2 x -y"]),
        (["app.py:Parts", "--rate=50"], ["[sink] got 1", "[sink] got 2"]),
        (["app.py", "--rate", "50"], ["[sink] got 1", "[sink] got 2"]),
        (["--in-process", "--rate", "50", "app.py:Parts"], ["[sink] got 1", "[sink] got 2"]),
    ],
)
def test_a_program_runs_with_its_parameters(
    program: Bench, words: list[str], expected: list[str]
) -> None:
    outcome = call(program, "run", *words)
    assert outcome.code == 0, outcome.err
    assert [line for line in outcome.out.splitlines() if LOADED not in line] == expected
    # Said while it was declared.
    assert [line for line in outcome.err.splitlines() if LOADED not in line] == []


def test_the_graph_is_checked_before_anything_runs(program: Bench) -> None:
    outcome = call(program, "run", "app.py:Twice")
    assert (outcome.code, outcome.out) == (1, "")
    outcome.assert_one_error("error[LF0502]: the port `Twice.sink.inp` has two sources")
    assert "app.py:51:13" in outcome.err
    assert "it is connected 2 times here" in outcome.err


def test_check_says_it_in_the_words_of_python(program: Bench) -> None:
    outcome = call(program, "check", "app.py:Open", "app.py:Parts")
    assert (outcome.code, outcome.out) == (0, "2 programs checked: no errors, 1 warning\n")
    assert "warning[LF0505]: nothing is connected to `sink.inp`" in outcome.err
    assert "connect an output to it: `hprm.connect(..., self.sink.inp)`" in outcome.err
    outcome = call(program, "check", "--json", "app.py:Open")
    [warning] = map(json.loads, outcome.out.splitlines())
    assert (warning["code"], warning["at"]["file"]) == ("LF0505", "app.py")


@pytest.mark.parametrize("name", ["Whole", "Parts"])
def test_verify_compares_all_its_runs(program: Bench, name: str) -> None:
    outcome = call(program, "verify", "--runs", "3", f"app.py:{name}")
    assert outcome.code == 0, outcome.err
    assert "3 runs did the same: 6 reactions compared" in outcome.out


def test_federates_are_started_by_hand(program: Bench) -> None:
    environment = {"HPRM_FEDERATION_ID": "0" * 31 + "1"}
    federation = program.federation()
    words = ["app.py:Parts", "--rate", "50"]

    def start(*command: str) -> None:
        member = program.call(*command, environment=environment)
        federation.members[command[0] if command[0] == "rti" else command[2]] = member

    start("rti", *words, "--listen", federation.address)
    for name in ("source", "sink"):
        start("federate", "app.py:Parts", name, "--rate", "50", "--rti", federation.address)
    outcomes = federation.finish()
    assert [it.code for it in outcomes.values()] == [0, 0, 0], outcomes
    got = [line for line in outcomes["sink"].out.splitlines() if LOADED not in line]
    assert got == ["got 1", "got 2"]


def test_the_help_of_a_program_shows_its_parameters(program: Bench) -> None:
    outcome = call(program, "run", "app.py:Whole", "--help")
    assert outcome.code == 0
    assert (
        "Parameters of the program:\n      --rate <VALUE>\n          [default: 100]" in outcome.out
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["app.py:Nobody"], "app.py has no Nobody"),
        (
            ["app.py:Whole", "--pace", "3"],
            "--pace 3 is neither an option of `hprm run` nor a parameter",
        ),
        (["app.py:Whole", "--timeot", "3 s"], "did you mean --timeout?"),
    ],
)
def test_what_python_refuses_is_one_error(program: Bench, words: list[str], message: str) -> None:
    outcome = call(program, "run", *words)
    assert (outcome.code, outcome.out) == (1, "")
    outcome.assert_one_error(message)


def test_ctrl_c_while_a_program_is_declared_ends_it(bench: Bench, tmp_path: Path) -> None:
    text = "import os, pathlib, time\npathlib.Path('begun').write_text('x')\ntime.sleep(60)\n"
    (bench.folder / "app.py").write_text(text)
    (tmp_path / "temporary").mkdir()
    environment = {"TMPDIR": str(tmp_path / "temporary")}
    process = bench.call("run", "app.py", environment=environment)
    until((bench.folder / "begun").exists, "the program is loaded")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert (outcome.code, outcome.out) == (130, "")
    assert list((tmp_path / "temporary").iterdir()) == []
    until(lambda: not bench.left(), "no process is left")
