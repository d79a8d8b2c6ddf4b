"""What the package tells type checkers of its native half is true."""

from __future__ import annotations

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
