"""``hprm run app.py``: how often the program is imported, and what ends that early."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hprm import _parameters

COMMAND = str(Path(sys.executable).with_name("hprm"))

HELLO = """
import sys

import hprm

print("imported", __name__, sys.argv[1:])


class Hello(hprm.Reactor):
    def __init__(self, rate: int = 1) -> None:
        self.rate = rate

    @hprm.reaction(hprm.startup)
    def greet(self) -> None:
        print("hello", self.rate)
"""

VISION = """
import hprm


class Hello(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def greet(self) -> None:
        print("hello")


class Vision(hprm.Federation):
    def __init__(self) -> None:
        self.left, self.right = Hello(), Hello()
"""


def hprm(folder: Path, *words: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of the command."""
    done = subprocess.run(
        [COMMAND, *words], cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stdout, done.stderr


def test_a_program_without_federates_is_imported_once(tmp_path: Path) -> None:
    (tmp_path / "app.py").write_text(HELLO)
    words = ["run", "app.py", "--rate", "3", "--", "-x"]
    assert hprm(tmp_path, *words) == (0, "imported app ['-x']\nhello 3\n", "")


def test_a_program_is_what_its_file_says_however_soon_that_has_changed(tmp_path: Path) -> None:
    path = tmp_path / "app.py"
    for word in ("hello", "howdy"):
        path.write_text(HELLO.replace("hello", word))
        # As if it had been written at the same time: what Python keeps of a module would count.
        os.utime(path, (1_700_000_000, 1_700_000_000))
        assert hprm(tmp_path, "run", "app.py") == (0, f"imported app []\n{word} 1\n", "")


def test_a_program_may_turn_out_to_be_a_federation(tmp_path: Path) -> None:
    (tmp_path / "vision.py").write_text(VISION)
    (tmp_path / "app.py").write_text(
        "import sys, vision\nclass App(vision.Vision):\n    pass\n"
        "print(sys.argv[1:], file=sys.stderr)\n"
    )
    code, out, err = hprm(tmp_path, "run", "app.py", "--logical-trace", "trace", "a", "--", "-x")
    assert (code, sorted(out.splitlines())) == (0, ["[left] hello", "[right] hello"])
    assert {re.sub(r"^\[\w+\] ", "", line) for line in err.splitlines()} == {"['a', '-x']"}
    assert (tmp_path / "trace").exists()


@pytest.mark.parametrize("command", ["run", "check", "verify"])
@pytest.mark.parametrize("kind", ["Reactor", "Federation"])
def test_what_ends_the_interpreter_is_one_error(tmp_path: Path, command: str, kind: str) -> None:
    (tmp_path / "app.py").write_text(f"import hprm, sys\n# a hprm.{kind}\nsys.exit(3)\n")
    code, _, err = hprm(tmp_path, command, "app.py")
    assert (code, err) == (
        1,
        "error[LF1009]: app.py ends the interpreter while it is loaded: sys.exit(3)\n"
        " --> app.py:3:1\n"
        "  |\n3 | sys.exit(3)\n  | ^\n"
        '  hint: put what only a script does below `if __name__ == "__main__":`; a reaction may'
        " end the program\n\n`hprm explain LF1009` says more\n",
    )


def test_a_constructor_that_ends_the_interpreter_is_an_error(tmp_path: Path) -> None:
    text = "import hprm, sys\nclass Main(hprm.Reactor):\n    def __init__(self):\n        "
    (tmp_path / "app.py").write_text(text + "sys.exit('no device')\n")
    code, _, err = hprm(tmp_path, "run", "app.py")
    assert code == 1
    assert "app.py ends the interpreter while it is loaded: sys.exit('no device')" in err
    assert "\n --> app.py:4:9\n" in err
    (tmp_path / "app.py").write_text(text + "quit()\n")
    code, _, err = hprm(tmp_path, "run", "app.py")
    assert (code, err.count("\n --> app.py:4:9\n")) == (1, 1)


@pytest.mark.parametrize("kind", ["Reactor", "Federation"])
def test_a_parser_of_the_command_line_says_itself_what_is_wrong(tmp_path: Path, kind: str) -> None:
    (tmp_path / "app.py").write_text(f"""
import argparse
import hprm

class Main(hprm.{kind}):
    def __init__(self):
        parser = argparse.ArgumentParser(prog="app")
        parser.add_argument("--rate", type=int)
        parser.parse_args()
""")
    code, out, err = hprm(tmp_path, "run", "app.py", "--", "--rate", "x")
    usage = "usage: app [-h] [--rate RATE]\n"
    assert (code, out, err) == (
        2,
        "",
        f"{usage}app: error: argument --rate: invalid int value: 'x'\n",
    )
    code, out, err = hprm(tmp_path, "run", "app.py", "--", "--help")
    assert code == 0
    assert (out + err).startswith(usage) and "error" not in out + err


@pytest.mark.parametrize(
    ("option", "hint"),
    [
        ("--workrs", "did you mean --workers?"),
        ("--rates", "did you mean --rate?"),
        ("--timeuot", "did you mean --timeout?"),
        ("--x", "the program has --rate; `hprm run --help` shows the options"),
    ],
)
@pytest.mark.parametrize("command", ["run", "verify"])
def test_an_unknown_option_is_neither_an_option_nor_a_parameter(
    tmp_path: Path, option: str, hint: str, command: str
) -> None:
    (tmp_path / "app.py").write_text(HELLO.replace('print("imported", __name__, sys.argv[1:])', ""))
    code, out, err = hprm(tmp_path, command, "app.py", option, "3")
    assert (code, out) == (1, "")
    said = f"{option} 3 is neither an option of `hprm run` nor a parameter of the program"
    assert err == f"error: {said}\n  hint: {hint}\n"


def test_the_options_of_the_command_are_known() -> None:
    code, out, _ = hprm(Path(), "run", "--help")
    assert code == 0
    options = set(re.findall(r"^ +(?:-\w, )?--([a-z-]+)", out, re.MULTILINE))
    assert options == set(_parameters.OPTIONS)
