"""The programs in the documents do what the documents say."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "python.md"
BLOCK = re.compile(r"```python\n(.*?)```\n(?:\n```text\n(.*?)```)?", re.DOTALL)
PROGRAMS = [match.groups(default="") for match in BLOCK.finditer(PAGE.read_text())]


@pytest.mark.parametrize(("text", "expected"), PROGRAMS)
def test_a_program_prints_what_the_document_says(text: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(text)
    done = subprocess.run(
        [sys.executable, "program.py"], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    if "ProgramError" in expected:
        assert done.returncode == 1
        assert done.stderr.endswith(expected)
    else:
        assert done.stdout == expected, done.stderr
        assert done.returncode == 0


def test_there_are_programs() -> None:
    assert len(PROGRAMS) >= 7
