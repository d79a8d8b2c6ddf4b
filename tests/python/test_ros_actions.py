"""Actions of rclpy: goals with feedback and results, which are rejected, cancelled and aborted."""

from __future__ import annotations

import signal

import pytest
from processes import ROOT, Bench, finish, hear

SCRIPTS = ROOT / "tests" / "ros2"


def ask(bench: Bench, *words: str) -> tuple[list[str], str]:
    """Run server and client; return what the client prints, and what is logged."""
    server, client = (str(SCRIPTS / f"fibonacci_{it}.py") for it in ("server", "client"))
    process = bench.call("ros", "run", server, "+", client, *words)
    last = "rejected\n" if words == ("-1",) else "result ["
    printed = hear(process.stdout, last)
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    lines = (printed + outcome.out).splitlines()
    return [it.removeprefix("[fibonacci_client-2] ") for it in lines], outcome.err


def test_a_goal_has_feedback_and_a_result(bench: Bench) -> None:
    printed, _ = ask(bench, "5")
    assert printed == [
        "feedback [0, 1, 1]",
        "feedback [0, 1, 1, 2]",
        "feedback [0, 1, 1, 2, 3]",
        "status 4 result [0, 1, 1, 2, 3]",
    ]


def test_a_goal_may_be_rejected(bench: Bench) -> None:
    assert ask(bench, "-1")[0] == ["rejected"]


def test_a_goal_may_be_cancelled(bench: Bench) -> None:
    printed, logged = ask(bench, "50", "4")
    # The server notices at its next step.
    assert printed == [
        "feedback [0, 1, 1]",
        "feedback [0, 1, 1, 2]",
        "status 5 result [0, 1, 1, 2]",
    ]
    assert "[fibonacci_server]: cancelled" in logged


def test_a_goal_whose_callback_raises_is_aborted(bench: Bench) -> None:
    printed, logged = ask(bench, "13")
    assert printed == ["status 6 result []"]
    assert "[fibonacci_server]: Error raised in execute callback: 13 is refused" in logged


@pytest.mark.parametrize("run", range(3))
def test_every_run_is_the_same(bench: Bench, run: int) -> None:
    printed, _ = ask(bench, "20", "7")
    assert len(printed) == 6 and printed[-1].startswith("status 5")
