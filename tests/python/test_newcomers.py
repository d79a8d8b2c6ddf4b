"""Mistakes that are typical of new users, in both languages, each with its messages.

``tests/newcomers`` has a program for each mistake, and beside it what ``hprm check`` says, and
``hprm run`` if the check finds no error. With ``HPRM_WRITE_SNAPSHOTS=1`` the answers are written
anew, to be read before they are committed.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "newcomers"
PROGRAMS = sorted(path.name for kind in ("lf", "py") for path in FOLDER.glob(f"*.{kind}"))


def answer(verb: str, name: str) -> tuple[int, str]:
    done = subprocess.run(
        [str(Path(sys.executable).with_name("hprm")), verb, name],
        cwd=FOLDER,
        env=os.environ | {"TERM": "dumb"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
        check=False,
    )
    return done.returncode, done.stdout


def neutral(text: str) -> str:
    """Without what depends on the machine or on Python's version: folders and markers."""
    text = text.replace(f"{FOLDER}/", "")
    return re.sub(r"(?m)^ +[~^]+\n", "", text) if "Traceback" in text else text


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_answer_to_a_mistake(name: str) -> None:
    code, said = answer("check", name)
    text = f"$ hprm check {name}\n{neutral(said)}"
    if code == 0:
        code, said = answer("run", name)
        text += f"\n$ hprm run {name}\n{neutral(said)}[exit code {code}]\n"
    snapshot = (FOLDER / name).with_suffix(".txt")
    if os.environ.get("HPRM_WRITE_SNAPSHOTS"):
        snapshot.write_text(text)
    assert text == snapshot.read_text()


@pytest.mark.parametrize("name", [name for name in PROGRAMS if name.endswith(".py")])
def test_programs_are_told_the_same_of_a_mistake_in_python(name: str) -> None:
    _, told = answer("check", name)
    done = subprocess.run(
        [str(Path(sys.executable).with_name("hprm")), "check", "--json", name],
        cwd=FOLDER,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stderr == ""
    found = [json.loads(line) for line in done.stdout.splitlines()]
    shown = [f"{it['severity']}[{it['code']}]: {it['message'].splitlines()[0]}" for it in found]
    assert shown == re.findall(r"(?m)^(?:error|warning)\[.*", told)
    for it in found:
        assert it["at"]["file"].endswith(".py"), it
        assert f"{it['at']['file']}:{it['at']['line']}" in told, it
        assert it["hint"] is None or it["hint"].splitlines()[0] in told, it


def test_no_answer_is_left_of_a_program_that_is_gone() -> None:
    assert {path.stem for path in FOLDER.glob("*.txt")} == {Path(name).stem for name in PROGRAMS}
    assert len({Path(name).stem for name in PROGRAMS}) == len(PROGRAMS)
