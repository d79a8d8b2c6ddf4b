"""Scripts that declare programs in Python with ``stand_in``, for the tests that run them."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

from conftest import Outcome

HERE = str(Path(__file__).parent)

PREAMBLE = """\
import sys
from datetime import timedelta
from hprm import _hprm
from stand_in import Declared, Reactor

MS = 1_000_000

def go(main, *arguments, **properties):
    "Run a program, and end with its exit code."
    sys.exit(_hprm.run_declared(Declared(main, **properties), *arguments))
"""

Script = Callable[..., Outcome]


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": HERE}


def write(tmp_path: Path, text: str) -> Path:
    """Write a script, which knows what its programs need."""
    path = tmp_path / "app.py"
    path.write_text(PREAMBLE + textwrap.dedent(text))
    return path


def runner(tmp_path: Path) -> Script:
    """A function that runs a script to its end, with modules beside it."""

    def run(text: str, *arguments: str, **files: str) -> Outcome:
        path = write(tmp_path, text)
        for name, content in files.items():
            (tmp_path / f"{name}.py").write_text(textwrap.dedent(content))
        done = subprocess.run(
            [sys.executable, path.name, *arguments],
            cwd=tmp_path,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run


def ok(outcome: Outcome) -> str:
    assert outcome.code == 0, outcome.err
    return outcome.out


def line_of(marker: str, text: str) -> int:
    """The line with a marker, in a script of that text."""
    lines = (PREAMBLE + textwrap.dedent(text)).splitlines()
    return next(number for number, line in enumerate(lines, 1) if marker in line)
