"""The programs of ``tests/lf`` check themselves: each must end with exit code 0."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CORPUS = Path(__file__).parents[1] / "lf"
PROGRAMS = sorted(
    str(path.relative_to(CORPUS)) for path in CORPUS.rglob("*.lf") if path.parent.name != "lib"
)


def test_there_is_a_corpus() -> None:
    assert PROGRAMS


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_program_is_content_with_what_it_sees(program: str) -> None:
    done = subprocess.run(
        [Path(sys.executable).with_name("hprm"), "run", program],
        cwd=CORPUS,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
