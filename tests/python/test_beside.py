"""Two commands at a time: `make test` does so with the mutants and all other tests."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import until

BESIDE = Path(__file__).resolve().parents[1] / "beside.py"

# Says that it is there, and goes on until it is stopped, with a child.
ENDLESS = "touch NAME; sleep 1000 & wait"


def start(folder: Path, other: str, command: str) -> subprocess.Popen[str]:
    words = [sys.executable, str(BESIDE), "bash", "-c", other, "--", "bash", "-c", command]
    environment = os.environ | {"HPRM_TEST_MARK": str(folder)}
    return subprocess.Popen(
        words,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def is_over(folder: Path) -> bool:
    """Whether nothing is left of what was started in a folder."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"HPRM_TEST_MARK={folder}".encode() in (process / "environ").read_bytes():
                return False
        except OSError:
            continue
    return True


def test_both_are_shown_one_after_the_other_and_the_other_one_is_idle(tmp_path: Path) -> None:
    policy = f"{sys.executable} -c 'import os; print(os.sched_getscheduler(0) == os.SCHED_IDLE)'"
    command = "until test -e done; do sleep 0.01; done; echo command"
    done = start(tmp_path, f"{policy}; touch done", f"{command}; {policy}")
    assert done.communicate(timeout=300) == ("command\nFalse\nTrue\n", "")
    assert done.returncode == 0


def test_the_other_one_has_the_least_share_that_a_session_can_have(tmp_path: Path) -> None:
    share = Path("/proc/self/autogroup")
    done = start(tmp_path, f"test ! -e {share} || cat {share}", "true")
    out, _ = done.communicate(timeout=300)
    assert out.endswith(" nice 19\n") or not share.exists()


@pytest.mark.parametrize("fails", ["other", "command"])
def test_a_failure_stops_both(tmp_path: Path, fails: str) -> None:
    failing = "until test -e begun; do sleep 0.01; done; echo why; exit 3"
    both = {"other": ENDLESS, "command": ENDLESS} | {fails: failing}
    ways = {name: text.replace("NAME", "begun") for name, text in both.items()}
    done = start(tmp_path, ways["other"], ways["command"])
    out, err = done.communicate(timeout=300)
    assert (done.returncode, out) == (3, "why\n")
    assert "has failed" in err
    until(lambda: is_over(tmp_path), "nothing is left")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_stops_both(tmp_path: Path, number: signal.Signals) -> None:
    both = start(tmp_path, *(ENDLESS.replace("NAME", name) for name in ("first", "second")))
    for name in ("first", "second"):
        until((tmp_path / name).exists, f"the {name} command runs")
    both.send_signal(number)
    both.communicate(timeout=300)
    assert both.returncode == 128 + number
    until(lambda: is_over(tmp_path), "nothing is left")


def test_words_without_two_commands_are_an_error() -> None:
    words = [sys.executable, str(BESIDE), "true"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stdout) == (2, "")
