"""Runs the program, and compares what it prints: python -m pytest."""

import subprocess
import sys
from pathlib import Path

# Of the environment whose interpreter runs the tests.
HPRM = Path(sys.executable).with_name("hprm")
PROGRAM = Path(__file__).parents[1] / "src" / "NewProject.lf"


def hprm(*words):
    """Run the command, and return what it has printed."""
    run = subprocess.run([HPRM, *words], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    return run.stdout.splitlines()


def test_the_display_shows_the_mean_of_the_last_three_readings():
    printed = hprm("run", "--timeout", "300 ms", PROGRAM)
    assert printed == [
        "[display] 0 ms: 1.0",
        "[display] 100 ms: 1.5",
        "[display] 200 ms: 2.0",
        "[display] 300 ms: 3.0",
    ]


def test_two_runs_do_the_same():
    hprm("verify", "--runs", "2", "--timeout", "200 ms", PROGRAM)
