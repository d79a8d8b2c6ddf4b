"""A program that falls behind its clock for good says so once, and which reaction costs most."""

from __future__ import annotations

import re

import pytest
from conftest import Run
from processes import COORDINATIONS, Bench, finish

SLOW = """\
reactor Slow {
  timer t(0, 20 ms)
  reaction(t) {= pass =}
  reaction(t) {=
    # Longer than the period.
    time.sleep(0.3)
  =}
}
"""
MAIN = "main reactor { slow = new Slow() }\n"
PREAMBLE = "preamble {= import time =}\n"
# Of its second reaction, below the line of the target.
LINE = 1 + (PREAMBLE + SLOW).splitlines().index("  reaction(t) {=") + 1
TOLD = re.compile(
    r"lags (\d+\.\d+) s behind its clock, since tag \((\d+ ms|\d+ s), 0\); reaction (\S+) "
    r"\((\S+)\) took longest: it ran (\d+) times, (\d+\.\d+) s in all, 0\.\d+ s at most\n"
)


@pytest.mark.parametrize("options", [[], ["--workers", "2"], ["--logical-trace", "trace.jsonl"]])
def test_a_program_that_cannot_keep_up_says_so_once(run: Run, options: list[str]) -> None:
    outcome = run(f"target Python {{ timeout: 220 ms }}\n{PREAMBLE}{SLOW}{MAIN}", *options)
    assert outcome.code == 0
    told = TOLD.search(outcome.err)
    assert told is not None, outcome.err
    assert outcome.err.startswith("warning: the program lags ")
    assert outcome.err.count("warning") == 1
    assert told[3] == "Program.slow.2"
    assert told[4] == f"Program.lf:{LINE}"
    assert float(told[1]) > 1
    assert float(told[6]) >= 0.3 * int(told[5])
    assert "hint: let it run less often" in outcome.err


@pytest.mark.parametrize("options", [[], ["--in-process"]])
def test_a_federate_that_cannot_keep_up_is_named(bench: Bench, options: list[str]) -> None:
    text = (
        f"target Python {{ coordination: decentralized, timeout: 220 ms }}\n{PREAMBLE}{SLOW}"
        "reactor Quick { timer t(0, 20 ms)  reaction(t) {= pass =} }\n"
        "federated reactor { slow = new Slow()  quick = new Quick() }\n"
    )
    outcome = finish(bench.start(text, *options))
    assert outcome.code == 0
    assert outcome.err.startswith("[slow] warning: federate slow lags "), outcome.err
    told = TOLD.search(outcome.err)
    assert told is not None, outcome.err
    assert told[3].endswith("slow.2")
    assert outcome.err.count("warning") == 1


def test_a_program_that_follows_no_clock_lags_behind_none(run: Run) -> None:
    outcome = run(f"target Python {{ fast: true, timeout: 220 ms }}\n{PREAMBLE}{SLOW}{MAIN}")
    assert (outcome.code, outcome.err) == (0, "")


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_long_reaction_before_the_end_is_no_time_that_stands_still(
    bench: Bench, coordination: str
) -> None:
    text = (
        f"target Python {{ coordination: {coordination} }}\n{PREAMBLE}"
        "reactor A { output o  reaction(startup) -> o {= time.sleep(1.5); o.set(1) =} }\n"
        "reactor B { input i  reaction(i) {= time.sleep(1.5) =} }\n"
        "federated reactor { a = new A()  b = new B()  a.o -> b.i }\n"
    )
    outcome = finish(bench.start(text))
    assert outcome.code == 0
    assert "stood still" not in outcome.err and "microstep" not in outcome.err, outcome.err
    assert "[b] warning: federate b lags " in outcome.err, "it is late nevertheless"


# 25 steps of a tenth of a second, all at time zero.
STEPS = """\
reactor Step {{
  {parts}
  state steps = 0
  reaction(startup) -> {effect} {{= {set} =}}
  reaction({trigger}) -> {effect} {{=
    time.sleep(0.1)
    self.steps += 1
    if self.steps < 25:
        {set}
  =}}
}}
main reactor {{ step = new Step()  {connection} }}
"""


def test_steps_that_a_connection_asks_for_are_no_lag(run: Run) -> None:
    steps = STEPS.format(
        parts="input number  output next",
        effect="next",
        trigger="number",
        set="next.set(1)",
        connection="step.next -> step.number after 0",
    )
    outcome = run(f"target Python\n{PREAMBLE}{steps}")
    assert (outcome.code, outcome.err) == (0, "")


def test_an_action_without_a_delay_that_comes_again_and_again_keeps_time_still(run: Run) -> None:
    steps = STEPS.format(
        parts="logical action again",
        effect="again",
        trigger="again",
        set="again.schedule(0)",
        connection="",
    )
    outcome = run(f"target Python\n{PREAMBLE}{steps}")
    assert outcome.code == 0
    told = "warning: the logical time of the program has stood still for 2."
    assert outcome.err.startswith(told), outcome.err
    assert "with a larger delay, time goes on" in outcome.err
    assert outcome.err.count("warning") == 1
