"""What the package tells type checkers of its native half is true."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_stubs_are_those_of_the_native_half() -> None:
    # `__all__` of the native half names everything in it; no program imports by it.
    allowed = ROOT / "tests" / "python" / "stubtest_allowed.txt"
    command = [sys.executable, "-m", "mypy.stubtest", "hprm._hprm", "--allowlist", allowed]
    command += ["--mypy-config-file", ROOT / "pyproject.toml"]
    checked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert checked.returncode == 0, checked.stdout + checked.stderr


MISTAKES = ROOT / "tests" / "typing" / "mistakes.py"


def lines_with_errors(command: list[str]) -> set[int]:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1, done.stdout + done.stderr
    return {int(line) for line in re.findall(r"mistakes\.py:(\d+):.*error", done.stdout)}


def marked(*marks: str) -> set[int]:
    lines = enumerate(MISTAKES.read_text().splitlines(), start=1)
    return {number for number, line in lines if line.endswith(marks)}


def test_mypy_finds_each_wrong_use_of_a_port() -> None:
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", str(MISTAKES)]
    assert lines_with_errors(command) == marked("# error")


def test_pyright_finds_each_wrong_use_of_a_port() -> None:
    command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, str(MISTAKES)]
    assert lines_with_errors(command) == marked("# error", "# error for pyright")
