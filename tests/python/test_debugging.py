"""Debuggers and profilers: the terminal for one federate, and reports at the end of a program."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

HPRM = str(Path(sys.executable).with_name("hprm"))

PROGRAM = """\
target Python { timeout: 20 msec }
reactor Camera {
  output image
  timer t(0, 10 msec)
  reaction(t) -> image {= image.set(6) =}
}
reactor Detector {
  input image
  state seen = False
  reaction(image) {=
    found = image.value * 7
    if not self.seen:
        breakpoint()
    self.seen = True
    print("found", found)
  =}
}
federated reactor {
  camera = new Camera()
  detector = new Detector()
  camera.image -> detector.image
}
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "Main.lf"
    path.write_text(PROGRAM)
    return path


@pytest.mark.parametrize("words", [[], ["--in-process"]])
def test_a_breakpoint_without_a_terminal_says_what_to_do(program: Path, words: list[str]) -> None:
    argv = [HPRM, "run", *words, str(program)]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "RuntimeError: breakpoint() needs a terminal" in done.stderr
    name = "FEDERATE" if words else "detector"
    assert f"hprm run --debug {name}" in done.stderr
    assert "BdbQuit" not in done.stderr


def test_a_federate_may_have_the_input_of_the_command(program: Path) -> None:
    argv = [HPRM, "run", "--debug", "detector", str(program)]
    done = subprocess.run(
        argv, input="p found + 1\nc\n", capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "43" in done.stdout
    assert done.stdout.count("found 42") == 3


def test_a_federate_may_have_the_terminal(program: Path) -> None:
    child, terminal = pty.fork()
    if child == 0:
        os.execv(HPRM, [HPRM, "run", "--debug", "detector", str(program)])
    shown = ""

    def read_until(text: str) -> None:
        nonlocal shown
        give_up = time.monotonic() + 60
        while text not in shown:
            assert select.select([terminal], [], [], give_up - time.monotonic())[0], shown
            shown += os.read(terminal, 4096).decode()

    read_until("(Pdb) ")
    os.write(terminal, b"p found + 1\n")
    read_until("43\r\n")
    os.write(terminal, b"c\n")
    read_until("found 42\r\nfound 42\r\nfound 42\r\n")
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    os.close(terminal)


def test_only_a_federate_can_be_debugged(program: Path) -> None:
    argv = [HPRM, "run", "--debug", "planner", str(program)]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "has no federate planner" in done.stderr
    assert "camera, detector" in done.stderr


def test_a_profiler_reports(tmp_path: Path) -> None:
    path = tmp_path / "Main.lf"
    path.write_text(
        "target Python\nmain reactor {\n"
        "  method work() {= return sum(range(1000)) =}\n"
        "  reaction(startup) {= print(self.work()) =}\n}\n"
    )
    argv = [sys.executable, "-m", "cProfile", "-m", "hprm", "run", str(path)]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("499500\n")
    assert "(work)" in done.stdout
    assert "function calls" in done.stdout


def test_a_missing_module_is_missed_by_an_interpreter_with_a_name(run: Any) -> None:
    outcome = run(
        "target Python\npreamble {= import torchvision_of_nobody.models =}\nmain reactor { }\n"
    )
    assert outcome.code == 1
    assert f"hint: the program runs with {sys.executable}; install torchvision_of_nobody" in (
        outcome.err
    )


def test_another_interpreter_may_be_named(program: Path, tmp_path: Path) -> None:
    other = tmp_path / "python"
    other.write_text(f'#!/bin/sh\necho through-the-other\nexec {sys.executable} "$@"\n')
    other.chmod(0o755)
    program.write_text("target Python\nmain reactor { reaction(startup) {= print(1) =} }\n")
    for words, environment in [
        (["--python", str(other)], {}),
        ([], {"HPRM_PYTHON": str(other)}),
    ]:
        argv = [HPRM, "run", *words, str(program)]
        environment = os.environ | environment
        done = subprocess.run(
            argv, capture_output=True, text=True, timeout=60, check=False, env=environment
        )
        assert done.stdout == "through-the-other\n1\n", done.stderr
