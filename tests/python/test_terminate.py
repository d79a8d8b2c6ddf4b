"""SIGTERM ends a federation in whatever state it is, within seconds, and leaves nothing behind.

Orderly stops are in test_failures.py. Here one part of the federation never answers.
"""

from __future__ import annotations

import os
import signal

import pytest
from processes import COORDINATIONS, Bench, Federation, Outcome, finish, until
from test_hang import FEDERATES, program

TERMINATED = 128 + signal.SIGTERM
"""The exit code for SIGTERM; a process that code in C keeps busy dies of the signal instead."""


def terminate(federation: Federation, *names: str) -> dict[str, Outcome]:
    """Send SIGTERM to members, all at once, and say how they end."""
    for name in names:
        federation.members[name].send_signal(signal.SIGTERM)
    return federation.finish(*names)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_who_cannot_stop_in_order_ends_nevertheless(bench: Bench, coordination: str) -> None:
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
        ("import itertools; sum(itertools.repeat(0))", {-signal.SIGTERM, TERMINATED}),
    ],
)
def test_a_reaction_that_does_not_return_is_broken_into(
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
    assert "warning: killed what did not end by itself: sink" in outcome.err
    until(lambda: not bench.left(), "nothing is left")
