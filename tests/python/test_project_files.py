"""Files that other tools read: the tools accept them, and the words of make in them exist."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
FORMS = [ROOT / ".github" / "ISSUE_TEMPLATE" / name for name in ("bug.yml", "feature.yml")]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize(
    "words",
    [
        ["check-jsonschema", "--builtin-schema", "vendor.github-workflows", *WORKFLOWS],
        ["check-jsonschema", "--builtin-schema", "vendor.github-issue-forms", *FORMS],
        ["check-jsonschema", "--builtin-schema", "vendor.compose-spec", "containers/compose.yml"],
        ["hadolint", "containers/Dockerfile"],
        ["pre-commit", "validate-config", ".pre-commit-config.yaml"],
    ],
    ids=["workflows", "forms", "compose", "Dockerfile", "pre-commit"],
)
def test_its_tool_accepts_the_file(words: list[str | Path]) -> None:
    run = subprocess.run(
        [BIN / words[0], *words[1:]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_words_of_make_that_files_call_exist() -> None:
    known = set(re.findall(r"^([a-z0-9-]+):.*## ", (ROOT / "Makefile").read_text(), re.MULTILINE))
    files = [*WORKFLOWS, ROOT / "README.md", ROOT / "SECURITY.md", ROOT / "CONTRIBUTING.md"]
    calls = re.compile(r"(?:`|run: |^)make ([a-z0-9-]+)", re.MULTILINE)
    called = {word for path in files for word in calls.findall(path.read_text())}
    assert {"wheel", "deny", "test"} <= called
    assert called - known == set()
