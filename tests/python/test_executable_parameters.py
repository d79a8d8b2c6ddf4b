"""Parameters of executables: the examples `camera` and `scanner` of the crate `hprm`."""

from __future__ import annotations

import json
import os
import re
import subprocess
import uuid
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench, rust_examples

MAIN = """\
target Python { timeout: 10 ms }

@executable("bin/scanner")
reactor Scanner(
  period = 10 ms,
  name = "front",
  gains = [0.1, 2],
  corner = (3, -4),
  bank_index = 0,
  is_fine = true
) {
  output scan
}

reactor Printer {
  input[3] scan
  reaction(scan) {= print([it.value for it in scan if it.is_present], flush=True) =}
}

federated reactor(period = 10 ms, label = "rear") {
  one = new Scanner(period = period)
  many = new[2] Scanner(period = 5 ms, name = label, is_fine = false)
  printer = new Printer()
  one.scan, many.scan -> printer.scan
}
"""

APP = """\
from datetime import timedelta

import hprm


class Scanner(hprm.Reactor, executable="bin/scanner"):
    scan = hprm.Output()

    def __init__(
        self,
        period=timedelta(milliseconds=10),
        name="front",
        gains=(0.1, 2),
        corner=(3, -4),
        bank_index=0,
        is_fine=True,
    ): ...


class Printer(hprm.Reactor):
    scan = hprm.Input(width=3)

    @hprm.reaction(scan)
    def show(self):
        print([it.value for it in self.scan if it.is_present], flush=True)


class Main(hprm.Federation, timeout="10 ms"):
    def __init__(self, label="rear"):
        self.one = Scanner()
        self.many = [
            Scanner(timedelta(milliseconds=5), label, bank_index=index, is_fine=False)
            for index in range(2)
        ]
        self.printer = Printer()
        hprm.connect([self.one.scan, *(it.scan for it in self.many)], self.printer.scan)
"""

PROGRAMS = pytest.mark.parametrize("program", ["Main.lf", "app.py"])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a program in both languages, and the executables that they name."""
    (tmp_path / "bin").symlink_to(rust_examples())
    (tmp_path / "Main.lf").write_text(MAIN)
    (tmp_path / "app.py").write_text(APP)
    return tmp_path


def scan(name: str, member: int, count: int, is_fine: bool) -> str:
    """Return what a scanner sends."""
    fine = str(is_fine).lower()
    return f"{name} {member} {count} [0.1, 2.0] Some((3, -4)) {{}} {fine}"


def scans(label: str) -> list[str]:
    """Return what the printer prints: the periods differ, too."""
    rows = [
        [scan("front", 0, 1, True), scan(label, 0, 1, False), scan(label, 1, 1, False)],
        [scan(label, 0, 2, False), scan(label, 1, 2, False)],
        [scan("front", 0, 2, True), scan(label, 0, 3, False), scan(label, 1, 3, False)],
    ]
    return [str(row) for row in rows]


@pytest.mark.parametrize("coordination", COORDINATIONS)
@PROGRAMS
def test_values_of_all_types_arrive(
    folder: Path, bench: Bench, program: str, coordination: str
) -> None:
    process = bench.call("run", "--property", f"coordination={coordination}", program)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert out.splitlines() == [f"[printer] {row}" for row in scans("rear")]


@PROGRAMS
def test_parameters_of_the_command_line_are_handed_down(
    folder: Path, bench: Bench, program: str
) -> None:
    process = bench.call("run", program, "--label", "left")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert out.splitlines() == [f"[printer] {row}" for row in scans("left")]


@PROGRAMS
def test_federates_that_are_started_by_hand_have_them_too(
    folder: Path, bench: Bench, program: str
) -> None:
    address, secret = f"unix:@hprm-test-{uuid.uuid4().hex}", uuid.uuid4().hex
    common = ["--federation", secret]
    stated = ["--label", "left"]
    rti = bench.call("rti", "--listen", address, *common, program, *stated)
    names = ["one", "many__0", "many__1", "printer"]
    federates = [
        bench.call("federate", *common, "--rti", address, program, it, *stated) for it in names
    ]
    outs = [process.communicate(timeout=60) for process in federates]
    assert [process.returncode for process in federates] == [0] * 4, outs
    assert outs[-1][0].splitlines() == scans("left")
    rti.communicate(timeout=60)
    assert rti.returncode == 0


@PROGRAMS
def test_a_federate_with_other_values_is_refused_by_name(
    folder: Path, bench: Bench, program: str
) -> None:
    address, secret = f"unix:@hprm-test-{uuid.uuid4().hex}", uuid.uuid4().hex
    common = ["--federation", secret]
    rti = bench.call("rti", "--listen", address, *common, program)
    process = bench.call("federate", *common, "--rti", address, program, "one", "--label", "left")
    _, err = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "left" in err and "rear" in err, err
    rti.terminate()
    rti.communicate(timeout=60)


MISTAKES = {
    # An unknown one, with the names of those that there are.
    ('name = "front"', 'nam = "front"'): (
        "LF1105",
        "has no parameter `nam`, and Scanner in Main.lf:4 has one",
        "did you mean `name`?",
    ),
    # A missing one, with its type.
    ('  name = "front",\n', ""): (
        "LF1105",
        "needs the parameter `name: String`, and Scanner in Main.lf:4 has none of that name",
        "`period: Duration`",
    ),
    ("corner = (3, -4)", "corner = (3, 0.5)"): (
        "LF1106",
        "does not take `corner` of Scanner in Main.lf:4: `value[1]`: expected i32, found the float"
        " 0.5",
        "a tuple or None",
    ),
    ("new Scanner(period = period)", "new Scanner(period = 10)"): (
        "LF1106",
        "does not take `period` of Scanner in Main.lf:4: `value`: expected struct Duration, found"
        " the int 10",
        "Main.lf:21:30",
    ),
    # What the executable does not want.
    ("new Scanner(period = period)", "new Scanner(period = 0 s)"): (
        "LF1106",
        "a period is not zero",
        "Main.lf:21:30",
    ),
    ("new Scanner(period = period)", "new Scanner(name = 20 ms)"): (
        "LF1106",
        "(a time is a `std::time::Duration`)",
        "Main.lf:21:28",
    ),
}


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_error_that_names_both_ends(
    folder: Path, bench: Bench, mistake: tuple[str, str], command: str
) -> None:
    text = MAIN.replace(*mistake)
    text = text.replace(", name = label", "") if "label)" not in text else text
    (folder / "Main.lf").write_text(text)
    process = bench.call(command, "Main.lf")
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1, err
    code, *said = MISTAKES[mistake]
    assert re.findall(r"^error.*?:", err, re.MULTILINE) == [f"error[{code}]:"], err
    for words in [str(folder / "bin" / "scanner"), *said]:
        assert words in err, err


PYTHON_MISTAKES = {
    ("name=", "nam="): ("LF1105", "has no parameter `nam`, and Scanner in app.py:6 has one"),
    ("gains=(0.1, 2)", "gains='much'"): (
        "LF1106",
        "does not take `gains` of Scanner in app.py:6: `value`: expected a sequence, found the str"
        " 'much'",
    ),
    ("gains=(0.1, 2)", "gains=object()"): ("LF1107", "cannot be of the type object"),
    ("gains=(0.1, 2)", "gains=2**64"): ("LF1107", "has more than 64 bits: 18446744073709551616"),
}


@pytest.mark.parametrize("mistake", PYTHON_MISTAKES)
def test_a_mistake_in_python_is_one_error(
    folder: Path, bench: Bench, mistake: tuple[str, str]
) -> None:
    (folder / "app.py").write_text(APP.replace(*mistake))
    process = bench.call("check", "app.py")
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1, err
    code, said = PYTHON_MISTAKES[mistake]
    assert re.findall(r"^error.*?:", err, re.MULTILINE) == [f"error[{code}]:"], err
    assert said in err
    assert "app.py:" in err


def test_dictionaries_none_and_members_of_enumerations_arrive_from_python(
    folder: Path, bench: Bench
) -> None:
    app = APP.replace("is_fine=True", "is_fine=True, labels=None")
    app = app.replace("self.one = Scanner()", "self.one = Scanner(corner=None, labels={'a': 1})")
    app = app.replace("is_fine=False)", "is_fine=False, labels={})")
    label = "import enum\n\nclass Label(str, enum.Enum):\n    FRONT = 'front'\n\nclass Scanner"
    app = app.replace("class Scanner", label).replace('name="front"', "name=Label.FRONT")
    (folder / "app.py").write_text(app)
    process = bench.call("run", "app.py")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert 'front 0 1 [0.1, 2.0] None {"a": 1} true' in out


def test_an_executable_describes_itself_without_a_program(folder: Path) -> None:
    answer = folder / "answer.json"
    environment = {**os.environ, "HPRM_DESCRIBE": str(answer)}
    scanner = folder / "bin" / "scanner"
    subprocess.run([scanner], env=environment, check=True, timeout=60)
    declared = json.loads(answer.read_text())
    assert declared["parameters"][:3] == [
        ["period", "Duration"],
        ["name", "String"],
        ["bank_index", "u64"],
    ]
    assert declared["refused"] == {"missing": "period"}


def test_an_executable_without_parameters_is_given_none(folder: Path, bench: Bench) -> None:
    text = MAIN.replace("bin/scanner", "bin/brighten")
    (folder / "Main.lf").write_text(text)
    process = bench.call("check", "Main.lf")
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "bin/brighten has no parameter `period`, and Scanner in Main.lf:4 has one" in err
    assert "its parameters: there are none" in err
