"""Wrong options: the error and its kind, as text and as JSON, and the exit code."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import pytest

HPRM = Path(sys.executable).with_name("hprm")

MAIN = """\
target Python { timeout: 10 ms }
main reactor(rate = 3, period = 10 ms) {
  timer t(0, period)
  reaction(t) {= pass =}
}
"""
FEDERATION = """\
target Python { timeout: 10 ms }
reactor Node { reaction(startup) {= pass =} }
federated reactor { a = new Node()  b = new Node() }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "Main.lf").write_text(MAIN)
    (tmp_path / "Fed.lf").write_text(FEDERATION)
    return tmp_path


def hprm(folder: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [HPRM, *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=folder,
        env=os.environ | environment,
    )


def report(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """The one object of the standard error, perhaps behind an empty line."""
    (line,) = filter(None, done.stderr.splitlines())
    found: dict[str, Any] = json.loads(line)
    return found


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--timeout", "5"], "'5' for '--timeout <TIME>': it must be a time, such as '10 s'"),
        (["-m", "2"], "invalid value '2' for '-m <TIME>': it must be a time, such as '10 s'"),
        (["--timeout", "-1 s"], "for '--timeout <TIME>': it must be a time that is not negative"),
        (["-o", "-1", "s"], "'-1 s' for '-o <TIME>': it must be a time that is not negative"),
        (["--spin", "zz"], "it must be 'auto', 'off', or a time up to a second, such as '100 us'"),
        (["--cpus", "x"], "not the number of a processor, as in --cpus 2,3"),
        (["--join-timeout", "-1"], "'-1' for '--join-timeout <SECONDS>': not a positive number"),
        (["--fast", "soon"], "invalid value 'soon' for '--fast <true|false>'"),
        (["--nonsense"], "unexpected argument '--nonsense' found"),
    ],
)
def test_words_that_are_wrong_end_with_two(folder: Path, words: list[str], message: str) -> None:
    done = hprm(folder, "run", *words, "Main.lf")
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert "tip" not in done.stderr or words == ["--nonsense"]
    for command in ("run", "rti", "federate"):
        answer = hprm(folder, command, "--json", "--nonsense")
        found = report(answer)
        assert (answer.returncode, found["kind"], found["code"]) == (2, "option", 2)
    found = report(hprm(folder, "run", "--json", *words, "Main.lf"))
    assert (found["kind"], found["code"], found["file"]) == ("option", 2, None)
    assert message in found["message"]


@pytest.mark.parametrize("command", ["verify", "diff"])
def test_commands_with_a_result_have_the_error_in_its_place(folder: Path, command: str) -> None:
    done = hprm(folder, command, "--json", "--nonsense")
    assert (done.returncode, done.stderr) == (2, "")
    assert json.loads(done.stdout)["error"]["kind"] == "option"


def test_arguments_of_the_program_ask_for_no_json(folder: Path) -> None:
    done = hprm(folder, "run", "--nonsense", "Main.lf", "--", "--json")
    assert done.returncode == 2
    assert done.stderr.startswith("error: unexpected argument")


@pytest.mark.parametrize(
    ("words", "shown", "message"),
    [
        (["--property", "fast=soon"], "--property fast=soon", "`fast` must be `true` or `false`"),
        (["--property", "timeout=5 x"], "--property 'timeout=5 x'", "`x` is not a unit of time"),
        (["--property", "fast"], "--property fast", "`fast` is no target property with a value"),
        (["--period", "3"], "--period 3", "the parameter `period` must be a time, such as `10 ms`"),
        (["--property", "main.rat=3"], "--rat 3", "the main reactor has no parameter `rat`"),
    ],
)
def test_what_does_not_fit_the_program_is_shown_as_an_option(
    folder: Path, words: list[str], shown: str, message: str
) -> None:
    done = hprm(folder, "run", "Main.lf", *words)
    assert (done.returncode, done.stdout) == (1, "")
    assert message in done.stderr
    assert f"--> {shown}\n" in done.stderr
    assert "target Python {" not in done.stderr
    found = report(hprm(folder, "run", "--json", "Main.lf", *words))
    assert (found["kind"], found["code"]) == ("option", 1)
    assert found["message"] == f"{shown}: {message}"
    assert (found["file"], found["line"], found["column"]) == (None, None, None)
    assert found["diagnostic"].startswith("LF")


@pytest.mark.parametrize(
    ("words", "message", "hint"),
    [
        (["run", "--debug", "c", "Fed.lf"], "Fed.lf has no federate c", "its federates: a, b"),
        (["run", "--debug", "a", "Main.lf"], "Main.lf has no federate a", "it has no federates"),
        (["run", "--python", "/bin/ls", "Main.lf"], "/bin/ls is no Python interpreter", "python3"),
        (["run", "--python", "Main.lf", "Main.lf"], "Main.lf is no Python interpreter", "python3"),
        (
            ["rti", "Fed.lf", "--listen", "unix:@x", "--federation-file", "."],
            "--federation-file .: that is a directory",
            "name a file",
        ),
        (
            ["rti", "Fed.lf", "--listen", "unix:@x", "--federation-file", "/dev/null"],
            "--federation-file /dev/null: that is not a file",
            "name a file",
        ),
        (["rti", "Fed.lf", "--listen", "0.0.0.0:0"], "open to other machines", "--federation-file"),
    ],
)
def test_an_option_that_cannot_be_obeyed(
    folder: Path, words: list[str], message: str, hint: str
) -> None:
    done = hprm(folder, *words, "--json")
    found = report(done)
    assert (done.returncode, done.stdout, found["kind"], found["code"]) == (1, "", "option", 1)
    assert message in found["message"]
    assert hint in found["hint"]


@pytest.mark.parametrize("words", [["Main.lf"], ["Fed.lf"], ["--in-process", "Fed.lf"]])
def test_an_interpreter_without_hprm_is_one_error(folder: Path, words: list[str]) -> None:
    # A folder that is only called so is no package.
    (folder / "hprm").mkdir()
    venv.create(folder / "bare", symlinks=True)
    python = str(folder / "bare" / "bin" / "python3")
    done = hprm(folder, "run", "--python", python, *words, "--json")
    found = report(done)
    assert (done.returncode, done.stdout, found["kind"], found["code"]) == (1, "", "option", 1)
    assert found["message"] == f"HPRM is not installed for the interpreter {python}"
    assert "-m pip install" in found["hint"] and "--python" in found["hint"]
    done = hprm(folder, "run", "--python", python, *words)
    assert (done.returncode, done.stderr.count("error: ")) == (1, 1)
    assert "No module named" not in done.stderr
    # One that is found on the PATH only is asked, too.
    (folder / "alone").mkdir()
    shutil.copy(HPRM, folder / "alone" / "hprm")
    environment = {"PATH": str(folder / "bare" / "bin"), "HOME": str(folder)}
    alone = [str(folder / "alone" / "hprm"), "run", *words]
    done = subprocess.run(alone, cwd=folder, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("error: ")) == (1, 1)
    assert f"HPRM is not installed for the interpreter {python}" in done.stderr
    doctor = hprm(folder, "doctor", "--python", python)
    assert "python module" in doctor.stdout and "not found" not in doctor.stdout


def test_a_file_that_is_no_secret(folder: Path) -> None:
    secret = folder / "secret"
    secret.write_text("swordfish\n")
    secret.chmod(0o600)
    words = ["rti", "Fed.lf", "--listen", "unix:@x", "--federation-file", "secret", "--json"]
    found = report(hprm(folder, *words))
    assert found["kind"] == "option"
    assert "32 hexadecimal digits" in found["hint"]


VARIABLES = [
    "HPRM_STORE_LIMIT",
    "HPRM_STORE_FULL",
    "HPRM_LOG",
    "HPRM_LONG_REACTION",
    "HPRM_PICKLE",
    "HPRM_EVENT_LIMIT",
]


@pytest.mark.parametrize("name", VARIABLES)
@pytest.mark.parametrize(
    "words", [["run", "Main.lf"], ["run", "Fed.lf"], ["federate", "Fed.lf", "a"]], ids=" ".join
)
def test_a_wrong_environment_variable_is_one_error_before_anything_starts(
    folder: Path, words: list[str], name: str
) -> None:
    # Whatever starts would say so.
    environment = {name: "foo", "HPRM_PYTHON": "/bin/false"}
    done = hprm(folder, *words, **environment)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: the environment variable {name}=foo is wrong: ")
    assert "Usage" not in done.stderr and len(done.stderr.splitlines()) <= 2
    done = hprm(folder, *words, "--json", **environment)
    found = report(done)
    assert (done.returncode, found["kind"], found["code"]) == (2, "option", 2)
    assert f"{name}=foo is wrong" in found["message"]
    answer = hprm(folder, "verify", "--json", "Main.lf", **environment)
    assert (answer.returncode, answer.stderr) == (2, "")
    assert name in json.loads(answer.stdout)["error"]["message"]


@pytest.mark.parametrize("name", ["Main.lf", "Fed.lf"])
def test_a_mistake_in_a_body_is_one_of_the_program(folder: Path, name: str) -> None:
    path = folder / name
    path.write_text(path.read_text().replace("{= pass =}", "{= if: =}"))
    found = report(hprm(folder, "run", "--json", name))
    assert (found["kind"], found["diagnostic"], found["code"]) == ("program", "LF1001", 1)
    assert found["file"] == name and found["line"]
    done = hprm(folder, "run", name)
    assert done.stderr.startswith("error[LF1001]: ")
    checked = hprm(folder, "check", "--json", name)
    assert json.loads(checked.stdout.splitlines()[0])["code"] == "LF1001"


def test_a_mistake_in_a_module_is_an_exception_while_the_program_loads(folder: Path) -> None:
    (folder / "eye.py").write_text("def see(:\n")
    text = MAIN.replace("main reactor", "preamble {= import eye =}\nmain reactor")
    (folder / "Main.lf").write_text(text)
    found = report(hprm(folder, "run", "--json", "Main.lf"))
    assert (found["kind"], found["diagnostic"]) == ("code", None)
    assert found["file"].endswith("eye.py")


@pytest.mark.parametrize("options", [[], ["--in-process"]])
def test_the_time_to_join_includes_loading(folder: Path, options: list[str]) -> None:
    text = FEDERATION.replace(
        "reactor Node {", "reactor Node {\n  preamble {= import time; time.sleep(50) =}\n"
    )
    text = text.replace("b = new Node()", "b = new Quick()") + "reactor Quick { }\n"
    (folder / "Fed.lf").write_text(text)
    words = ["run", "--json", "--join-timeout", "1.5", *options, "Fed.lf"]
    done = hprm(folder, *words)
    found = json.loads(done.stderr.strip().splitlines()[0])
    assert (done.returncode, found["kind"]) == (1, "absent")
    assert found["message"] == "federate a did not load its program within 1.5 s"
    assert "--join-timeout" in found["hint"]


APP = """
import hprm


class Part(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        pass


class Main(hprm.Federation):
    def __init__(self) -> None:
        self.a, self.b = Part(), Part()
"""


@pytest.mark.parametrize("secret", [[], ["--rti", "unix:@x", "--federation-file", "missing"]])
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["Fed.lf", "c"], "Fed.lf has no federate c"),
        (["Main.lf", "a"], "Main.lf is not a federation"),
        (["app.py", "c"], "app.py has no federate c"),
        (["app.py:Part", "a"], "app.py:Part is not a federation"),
    ],
)
def test_a_federate_that_does_not_exist_is_refused_before_the_rti_is_waited_for(
    folder: Path, words: list[str], secret: list[str], message: str
) -> None:
    (folder / "app.py").write_text(APP)
    done = hprm(folder, "federate", *words, *secret)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(f"error: {message}\n  hint: "), done.stderr
