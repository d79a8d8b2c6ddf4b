"""Slips that Python takes without complaint: lost values, sleeps, numbers without a unit."""

from __future__ import annotations

import linecache
import subprocess
import sys
import warnings
from itertools import count
from pathlib import Path

import pytest

import hprm
from hprm._declared import load

COMMAND = str(Path(sys.executable).with_name("hprm"))

_numbers = count()

REACTOR = """import asyncio
import functools
import time
from time import sleep

import hprm

def wrapped(body):
    @functools.wraps(body)
    def run(self):
        result = body(self)
        return result
    return run

def bare(body):
    def run(self):
        result = body(self)
        return result
    return run

class Main(hprm.Reactor):
    out = hprm.Output(int)

    def helper(self):
        return 1

"""


def check(tmp_path: Path, text: str) -> str:
    """Declare a program with this text in its class; return its path."""
    path = tmp_path / f"slip_{next(_numbers)}.py"
    path.write_text(REACTOR + "".join(f"    {line}\n" for line in text.splitlines()))
    linecache.checkcache()
    assert load(str(path), []).text
    return str(path)


def line_of(path: str) -> int:
    lines = Path(path).read_text().splitlines()
    return next(number for number, line in enumerate(lines, 1) if line.endswith("# here"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "@hprm.reaction(hprm.startup, effects=[out])\ndef go(self):\n    return 1  # here",
            "reaction go returns a value, which goes nowhere\n  hint: set an output:"
            " self.out.set(...); `return` alone ends the reaction",
        ),
        (
            "@hprm.reaction(hprm.startup, effects=[out])\nasync def go(self):\n"
            "    if self.helper():\n        return None if self.helper() else 2  # here",
            "reaction go returns a value",
        ),
        (
            "@hprm.reaction(hprm.startup, deadline='1 s', late='fail', effects=[out])\n"
            "def go(self):\n    self.out.set(1)\n"
            "def fail(self):\n    return False  # here",
            "handler fail returns a value, which goes nowhere",
        ),
    ],
)
def test_a_value_that_a_reaction_returns_is_an_error(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(hprm.ProgramError) as raised:
        check(tmp_path, text)
    assert raised.value.location is not None
    path = raised.value.location.path
    assert f"{path}:{line_of(path)}: [LF1008] {message}" in str(raised.value)


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        (
            "@hprm.reaction(hprm.startup)\ndef go(self):  # here\n    return self.work()\n"
            "async def work(self):\n    pass",
            "go has returned a coroutine, work, which nothing awaits",
            "write async def go, and await self.work(...) in it",
        ),
        (
            "@hprm.reaction(hprm.startup)\nasync def go(self):  # here\n"
            "    await asyncio.sleep(0)\n    return self.helper()",
            "go has returned 1, which goes nowhere",
            "set an output: self.NAME.set(...); `return` alone ends the body",
        ),
        (
            "@hprm.reaction(hprm.startup, deadline=0, late='fail')\ndef go(self):\n    pass\n"
            "def fail(self):  # here\n    return self.helper()",
            "fail has returned 1, which goes nowhere",
            "set an output: self.NAME.set(...); `return` alone ends the body",
        ),
    ],
)
def test_what_a_body_has_returned_is_an_error_when_it_has_run(
    tmp_path: Path, text: str, message: str, hint: str
) -> None:
    lines = [line for line in REACTOR.splitlines() if "out = " not in line]
    path = tmp_path / "program.py"
    path.write_text("\n".join([*lines, *(f"    {line}" for line in text.splitlines()), ""]))
    outcome = subprocess.run(
        [COMMAND, "run", path.name], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert outcome.returncode == 1
    place = f"--> program.py:{line_of(str(path))}:5"
    assert f"error[LF1008]: {message}\n" in outcome.stderr, outcome.stderr
    assert place in outcome.stderr
    assert f"hint: {hint}\n" in outcome.stderr
    assert "never awaited" not in outcome.stderr


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            "self.think, self.answer",
            "reaction Main.go raised TypeError: hprm.background takes a coroutine, and this is a"
            " method: call it, hprm.background(self.think(...))",
        ),
        (
            "self.think(), self.answer",
            "thread hprm background raised TypeError: what Main.think has returned: action answer"
            " accepts int, and this is a value of type str",
        ),
    ],
)
def test_slips_with_background_are_told(tmp_path: Path, call: str, message: str) -> None:
    path = tmp_path / "program.py"
    path.write_text(
        "import hprm\n\nclass Main(hprm.Reactor, timeout='20 s'):\n"
        "    answer = hprm.PhysicalAction(int)\n"
        "    @hprm.reaction(hprm.startup, effects=[answer])\n"
        f"    def go(self):\n        hprm.background({call})\n"
        "    async def think(self):\n        return 'much'\n"
    )
    outcome = subprocess.run(
        [COMMAND, "run", path.name], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert outcome.returncode == 1
    assert f"error: {message}\n" in outcome.stderr


@pytest.mark.parametrize(
    "text",
    [
        "@hprm.reaction(hprm.startup)\ndef go(self):\n    return None",
        "@hprm.reaction(hprm.startup)\ndef go(self):\n    return",
        "@hprm.reaction(hprm.startup)\ndef go(self):\n    return self.request_stop()",
        "@hprm.reaction(hprm.startup)\ndef go(self):\n    def inner():\n        return 1\n"
        "    sorted([], key=lambda it: 1)\n    inner()",
        "@hprm.reaction(hprm.startup)\n@wrapped\ndef go(self):\n    return 1",
        "@hprm.reaction(hprm.startup)\n@bare\ndef go(self):\n    return 1",
    ],
)
def test_what_may_return_none_is_no_error(tmp_path: Path, text: str) -> None:
    check(tmp_path, text)


@pytest.mark.parametrize("call", ["time.sleep(1)", "sleep(1)"])
def test_a_coroutine_that_sleeps_without_awaiting_is_warned_of(tmp_path: Path, call: str) -> None:
    text = f"@hprm.reaction(hprm.startup)\nasync def go(self):\n    {call}  # here"
    with pytest.warns(hprm.ProgramWarning) as said:
        path = check(tmp_path, text)
    [warning] = said
    assert (warning.filename, warning.lineno) == (path, line_of(path))
    assert str(warning.message) == (
        "time.sleep stops all coroutines of the federate until go goes on\n"
        "  hint: write await asyncio.sleep(...)"
    )


def test_other_sleeps_are_not_warned_of(tmp_path: Path) -> None:
    check(
        tmp_path,
        "@hprm.reaction(hprm.startup)\nasync def go(self):\n    await asyncio.sleep(0)\n"
        "    await asyncio.to_thread(lambda: time.sleep(0))\n"
        "@hprm.reaction(hprm.startup)\ndef other(self):\n    time.sleep(0)",
    )


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("tick = hprm.Timer(10)  # here", "period"),
        ("again = hprm.Action(min_delay=10)  # here", "min_delay"),
        ("tick = hprm.Timer(lambda self: 10)  # here", "period"),
        (
            "@hprm.reaction(hprm.startup, deadline=10, late='helper')  # here\ndef go(self): ...",
            "deadline",
        ),
    ],
)
def test_a_number_without_a_unit_is_warned_of(tmp_path: Path, text: str, name: str) -> None:
    text = text.replace("'helper'", "'give'") + "\ndef give(self): ..."
    with pytest.warns(hprm.ProgramWarning) as said:
        path = check(tmp_path, text)
    [warning] = said
    assert (warning.filename, warning.lineno) == (path, line_of(path))
    assert str(warning.message) == (
        f"`{name}` is 10 ns: a number without a unit counts nanoseconds\n"
        '  hint: write "10 ms", or "10 ns" if that is meant'
    )


def test_times_that_are_meant_are_not_warned_of(tmp_path: Path) -> None:
    check(
        tmp_path,
        "tick = hprm.Timer('10 ns', offset=0)\nagain = hprm.Action(min_delay=1_000)\n"
        "late = hprm.Timer(lambda self: '5 ns')",
    )


def test_a_warning_can_be_an_error(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(hprm.ProgramWarning):
            check(tmp_path, "tick = hprm.Timer(10)")


FEDERATION = """import hprm

class Clock(hprm.Reactor):
    tick = hprm.Timer(offset=10)

    @hprm.reaction(tick)
    def go(self):
        pass

class Main(hprm.{kind}):
    def __init__(self):
        self.left, self.right = Clock(), Clock()

if __name__ == "__main__":
    hprm.run(Main())
"""


@pytest.mark.parametrize("kind", ["Reactor", "Federation"])
@pytest.mark.parametrize(
    "command",
    [
        [COMMAND, "run", "app.py"],
        [COMMAND, "run", "--in-process", "app.py"],
        [COMMAND, "check", "app.py"],
        [sys.executable, "app.py"],
    ],
)
def test_a_user_is_warned_once(tmp_path: Path, kind: str, command: list[str]) -> None:
    (tmp_path / "app.py").write_text(FEDERATION.format(kind=kind))
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("ProgramWarning") == 1, done.stderr
    assert "app.py:4: ProgramWarning: `offset` is 10 ns" in done.stderr
