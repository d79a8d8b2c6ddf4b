"""What the file of a program may be called, what lies beside it, and what it leaves open."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = str(Path(sys.executable).with_name("hprm"))

#: A federation of which a class of its own, and one of a file beside it, go through a port.
PROGRAM = """
import dataclasses

import hprm
from {parts} import Found


@dataclasses.dataclass
class Seen:
    count: int


class Source(hprm.Reactor):
    out = hprm.Output()

    @hprm.reaction(hprm.startup, effects=[out])
    def send(self) -> None:
        self.out.set((Seen(1), Found(2)))


class Sink(hprm.Reactor):
    inp = hprm.Input()

    @hprm.reaction(inp)
    def show(self) -> None:
        seen, found = self.inp.value
        print(isinstance(seen, Seen), isinstance(found, Found), seen.count, found.count)


class Main(hprm.Federation, timeout="30 ms"):
    def __init__(self, found: object = None) -> None:
        self.source, self.sink = Source(), Sink()
        self.source.out >> self.sink.inp


if __name__ == "__main__":
    hprm.run(Main(Found(3)))
"""
PARTS = """
import dataclasses


@dataclasses.dataclass
class Found:
    count: int
"""
SHOWN = (0, "[sink] True True 1 2\n", "")

#: One that calls a function of its own in another process.
POOL = """
import multiprocessing

import hprm


def double(number: int) -> int:
    return 2 * number


class Main(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def go(self) -> None:
        with multiprocessing.get_context("{method}").Pool(1) as pool:
            print(pool.map_async(double, [1, 2]).get(timeout=20))
"""

#: One that leaves it to HPRM to use modules of the library.
FEDERATION = """
import hprm


class Lamp(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def show(self) -> None:
        print("on")


class Main(hprm.Federation):
    def __init__(self) -> None:
        self.left, self.right = Lamp(), Lamp()


if __name__ == "__main__":
    hprm.run(Main())
"""

ARGUMENT = """
import hprm


class Lamp(hprm.Reactor):
    def __init__(self, rate: int, gain: float = 1.0) -> None:
        self.rate = rate

    @hprm.reaction(hprm.startup)
    def show(self) -> None:
        print(self.rate + 1)
"""


def outcome(folder: Path, *words: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    "words", [[sys.executable], [COMMAND, "run"], [COMMAND, "run", "--in-process"]]
)
def test_the_name_of_a_file_may_have_dots(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "robot_parts.py").write_text(PARTS)
    # It is not what the program is imported as.
    (tmp_path / "robot.py").write_text("raise RuntimeError('this is not the program')\n")
    for name in ("robot.v2.py", "my-robot.first.try.py"):
        (tmp_path / name).write_text(PROGRAM.format(parts="robot_parts"))
        assert outcome(tmp_path, *words, name) == SHOWN


def test_so_may_that_of_a_file_in_a_package_and_that_of_its_folder(tmp_path: Path) -> None:
    for folder, parts in (("robot", ".parts"), ("robot.v2", "parts")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("")
        (tmp_path / folder / "parts.py").write_text(PARTS)
        (tmp_path / folder / "main.v2.py").write_text(PROGRAM.format(parts=parts))
        assert outcome(tmp_path, COMMAND, "run", f"{folder}/main.v2.py") == SHOWN


@pytest.mark.parametrize("name", ["robot.v2.py", "robot-v2.py"])
def test_a_class_may_be_called_like_its_file(tmp_path: Path, name: str) -> None:
    other = "\n\nclass Other(hprm.Reactor):\n    pass\n"
    (tmp_path / name).write_text(ARGUMENT.replace("Lamp", "RobotV2") + other)
    assert outcome(tmp_path, COMMAND, "run", name, "--rate", "3") == (0, "4\n", "")


# The library has a package `test`.
@pytest.mark.parametrize("folder", ["robot", "robot.v2", "test"])
def test_a_folder_with_a_main_module_needs_no_init(tmp_path: Path, folder: str) -> None:
    (tmp_path / folder).mkdir()
    (tmp_path / folder / "parts.py").write_text(PARTS)
    (tmp_path / folder / "__main__.py").write_text(PROGRAM.format(parts="parts"))
    main = f"{folder}/__main__.py"
    for words in ([sys.executable, folder], [COMMAND, "run", main]):
        assert outcome(tmp_path, *words) == SHOWN
    inside = tmp_path / folder
    assert outcome(inside, sys.executable, ".") == SHOWN
    assert outcome(inside, COMMAND, "run", "--in-process", "__main__.py") == SHOWN


@pytest.mark.parametrize("parts", [".parts", "robot.parts"])
def test_such_a_folder_is_a_package_for_python_m(tmp_path: Path, parts: str) -> None:
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "parts.py").write_text(PARTS)
    (tmp_path / "robot" / "__main__.py").write_text(PROGRAM.format(parts=parts))
    assert outcome(tmp_path, sys.executable, "-m", "robot") == SHOWN
    assert outcome(tmp_path, COMMAND, "run", "robot/__main__.py") == SHOWN


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
@pytest.mark.parametrize("file", ["robot.v2.py", "robot/__main__.py", "robot.v2/__main__.py"])
def test_processes_that_multiprocessing_starts_find_the_file(
    tmp_path: Path, method: str, file: str
) -> None:
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text(POOL.format(method=method))
    assert outcome(tmp_path, COMMAND, "run", file) == (0, "[2, 4]\n", "")


@pytest.mark.parametrize("command", ["run", "check", "verify"])
def test_a_parameter_without_a_value_is_an_error_at_the_constructor(
    tmp_path: Path, command: str
) -> None:
    (tmp_path / "app.py").write_text(ARGUMENT)
    code, _, err = outcome(tmp_path, COMMAND, command, "app.py")
    assert code == 1
    assert err.startswith(
        "error: Lamp needs a value for its parameter rate\n"
        " --> app.py:6:5\n"
        "  |\n"
        "6 |     def __init__(self, rate: int, gain: float = 1.0) -> None:\n"
        "  |     ^\n"
        "  hint: state it on the command line, --rate VALUE, or give it a default value\n"
    )
    assert outcome(tmp_path, COMMAND, "run", "app.py", "--rate", "3") == (0, "4\n", "")


def test_json_has_the_place_and_the_hint_of_it(tmp_path: Path) -> None:
    text = "import hprm\n\n\nclass Main(hprm.Federation):\n    def __init__(self, a, *, b_c):\n"
    (tmp_path / "app.py").write_text(text + "        pass\n")
    code, out, err = outcome(tmp_path, COMMAND, "run", "--json", "app.py")
    told = [json.loads(line) for line in (out + err).splitlines()]
    assert code == 1
    assert [(it["message"], it["file"], it["line"], it["hint"]) for it in told] == [
        (
            "Main needs a value for its parameters a and b_c",
            "app.py",
            5,
            "state them on the command line, --a VALUE --b-c VALUE, or give them default values",
        )
    ]


def test_a_function_that_makes_the_program_may_need_a_value_too(tmp_path: Path) -> None:
    text = ARGUMENT + "\n\ndef make(rate, /):\n    return Lamp(rate)\n"
    (tmp_path / "app.py").write_text(text)
    code, _, err = outcome(tmp_path, COMMAND, "run", "app.py:make")
    assert code == 1
    assert err.startswith("error: make needs a value for its parameter rate\n  --> app.py:14:1\n")
    assert err.endswith("  hint: a command line states values by name: give it a default value\n")


@pytest.mark.parametrize("module", ["json", "signal", "inspect", "threading", "argparse"])
def test_a_file_that_hides_a_module_of_python_is_named(tmp_path: Path, module: str) -> None:
    (tmp_path / "robot.py").write_text(FEDERATION)
    (tmp_path / f"{module}.py").write_text("x = 1\n")
    for words in ([sys.executable, "-B"], [COMMAND, "run"]):
        code, out, err = outcome(tmp_path, *words, "robot.py")
        # Where Python itself lacks a module, it says so at the very end.
        err = re.sub(r"^(Exception ignored|AttributeError).*\n", "", err, flags=re.MULTILINE)
        err = err.replace(f"  --> {module}.py\n", "")
        assert (code, out) == (1, "")
        assert err == (
            f"error: {module}.py beside the program hides Python's module {module}\n"
            f"  hint: rename {module}.py\n"
        )


@pytest.mark.parametrize("module", ["types", "functools"])
def test_so_is_one_that_the_package_itself_cannot_be_imported_without(
    tmp_path: Path, module: str
) -> None:
    (tmp_path / "robot.py").write_text("import hprm\n")
    (tmp_path / f"{module}.py").write_text("x = 1\n")
    assert outcome(tmp_path, sys.executable, "robot.py") == (
        1,
        "",
        f"error: {module}.py beside the program hides Python's module {module}\n"
        f"  hint: rename {module}.py\n",
    )


def test_a_program_that_hides_a_module_itself_is_named(tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS)
    (tmp_path / "signal.py").write_text(PROGRAM.format(parts="parts"))
    assert outcome(tmp_path, sys.executable, "signal.py") == (
        1,
        "",
        "error: signal.py hides Python's module signal\n  hint: rename signal.py\n",
    )


def test_a_program_that_uses_the_hidden_module_gets_a_hint(tmp_path: Path) -> None:
    (tmp_path / "random.py").write_text("x = 1\n")
    text = "import random\n\n" + ARGUMENT.replace("self.rate + 1", "random.randint(1, 1)")
    (tmp_path / "app.py").write_text(text)
    code, _, err = outcome(tmp_path, COMMAND, "run", "app.py", "--rate", "1")
    assert code == 1
    assert "reaction Lamp.show raised AttributeError: module 'random' has no" in err
    assert (
        "  hint: random.py beside the program hides Python's module random: rename random.py\n"
        in err
    )


def test_a_file_that_is_called_like_a_module_does_no_harm_of_itself(tmp_path: Path) -> None:
    (tmp_path / "random.py").write_text(PARTS)
    (tmp_path / "app.py").write_text(PROGRAM.format(parts="random"))
    for words in ([sys.executable], [COMMAND, "run"]):
        assert outcome(tmp_path, *words, "app.py") == SHOWN


def test_a_file_that_imports_its_program_says_from_where(tmp_path: Path) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "parts.py").write_text(PARTS)
    (tmp_path / "lib" / "robot.py").write_text(PROGRAM.format(parts="parts"))
    imports = "import sys\nsys.path.insert(0, 'lib')\nimport hprm\nfrom robot import Main, Sink\n"
    text = f"{imports}if __name__ == '__main__':\n    hprm.run(Main())\n"
    (tmp_path / "runner.py").write_text(text)
    code, _, err = outcome(tmp_path, COMMAND, "run", "runner.py")
    assert code == 1
    assert err.startswith(
        "error[LF0206]: runner.py defines no reactor: Main comes from lib/robot.py\n"
        "  hint: run that: lib/robot.py; or name it: runner.py:Main\n"
    )
    for program in ("lib/robot.py", "runner.py:Main"):
        assert outcome(tmp_path, COMMAND, "run", program) == SHOWN


def test_a_file_that_imports_several_programs_says_how_to_name_them(tmp_path: Path) -> None:
    text = (
        "import hprm\nclass Left(hprm.Reactor):\n    pass\nclass Right(hprm.Reactor):\n    pass\n"
    )
    (tmp_path / "robot.py").write_text(text)
    (tmp_path / "runner.py").write_text("from robot import Left, Right\n")
    _, _, err = outcome(tmp_path, COMMAND, "run", "runner.py")
    assert "runner.py defines no reactor\n" in err
    assert "  hint: name what it imports: runner.py:Left or runner.py:Right\n" in err
