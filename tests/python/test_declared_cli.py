"""The command ``hprm`` with a program in Python: what it asks an interpreter for, and what follows.

A script stands in for the interpreter: it writes down how it was called, and answers with a file.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from processes import until

from hprm._hprm import ONE_SIGNAL_S

COMMAND = str(Path(sys.executable).with_name("hprm"))

INTERPRETER = """\
#!{python}
import json, os, pathlib, sys, time

arguments = sys.argv[1:]
if arguments[0] == "-c":
    print("an interpreter with hprm")
    raise SystemExit
here = pathlib.Path({here!r})
with open(here / "calls", "a") as calls:
    calls.write(json.dumps(arguments) + "\\n")
if arguments[2] != "declare":
    raise SystemExit
script = here / "script"
exec(script.read_text() if script.exists() else "")
answer = here / "answer"
if answer.exists():
    out = pathlib.Path(arguments[arguments.index("--out") + 1])
    out.write_text(answer.read_text())
"""

TEXT = """\
import hprm

class Source(hprm.Reactor):
    out = hprm.Output()
    def emit(self): ...

class Sink(hprm.Reactor):
    inp = hprm.Input()
    def take(self): ...

class Vision(hprm.Federation):
    source, sink = Source(), Sink()
"""


def declaration(*, federated: bool = False, period: int = 10_000_000) -> dict[str, Any]:
    """A source and a sink, as JSON."""

    def at(word: str) -> list[int]:
        start = TEXT.index(word)
        column = start - (TEXT.rfind("\n", 0, start) + 1)
        return [0, TEXT.count("\n", 0, start) + 1, column, column + len(word)]

    def of(child: str, name: str) -> dict[str, Any]:
        return {"at": at("source, sink"), "child": child, "name": name}

    def own(name: str, word: str) -> dict[str, Any]:
        return {"at": at(word), "name": name}

    def child(name: str, member: int) -> dict[str, Any]:
        return {"name": name, "at": at("source, sink"), "members": [member], "bank": False}

    source = {
        "name": "Source",
        "at": at("class Source"),
        "ports": [{"name": "out", "at": at("out"), "kind": "output"}],
        "timers": [{"name": "tick", "at": at("out"), "offset": 0, "period": period}],
        "reactions": [
            {
                "name": "emit",
                "at": at("def emit"),
                "triggers": [own("tick", "emit")],
                "effects": [own("out", "out")],
            }
        ],
    }
    sink = {
        "name": "Sink",
        "at": at("class Sink"),
        "ports": [{"name": "inp", "at": at("inp"), "kind": "input"}],
        "reactions": [{"name": "take", "at": at("def take"), "triggers": [own("inp", "inp")]}],
    }
    vision = {
        "name": "Vision",
        "at": at("class Vision"),
        "federated": federated,
        "children": [child("source", 0), child("sink", 1)],
        "connections": [
            {"at": at("Source()"), "from": [of("source", "out")], "to": [of("sink", "inp")]}
        ],
    }
    return {
        "files": [{"path": "app.py", "text": TEXT}],
        "main": 2,
        "reactors": [source, sink, vision],
    }


@dataclass
class Stage:
    """A folder with a program, and a stand-in for the interpreter."""

    folder: Path

    @property
    def calls(self) -> list[list[str]]:
        """How the interpreter was called, but for where its answer goes."""
        path = self.folder / "calls"
        lines = path.read_text().splitlines() if path.exists() else []
        calls = [json.loads(line) for line in lines]
        for call in calls:
            if "--out" in call:
                at = call.index("--out")
                del call[at : at + 2]
        return calls

    @property
    def left(self) -> list[str]:
        """What is left in the folder for temporary files."""
        return os.listdir(self.folder / "tmp")

    def answer(self, text: str | dict[str, Any]) -> None:
        (self.folder / "answer").write_text(text if isinstance(text, str) else json.dumps(text))

    def script(self, text: str) -> None:
        (self.folder / "script").write_text(text)

    def start(self, *words: str) -> subprocess.Popen[str]:
        environment = {
            **os.environ,
            "TMPDIR": str(self.folder / "tmp"),
            "HPRM_PYTHON": str(self.folder / "python"),
        }
        return subprocess.Popen(
            [COMMAND, *words],
            cwd=self.folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def hprm(self, *words: str) -> tuple[int, str, str]:
        """Exit code, standard output and standard error of the command."""
        process = self.start(*words)
        out, err = process.communicate(timeout=60)
        assert self.left == []
        return process.returncode, out, err


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    (tmp_path / "tmp").mkdir()
    (tmp_path / "app.py").write_text(TEXT)
    python = tmp_path / "python"
    python.write_text(INTERPRETER.format(python=sys.executable, here=str(tmp_path)))
    python.chmod(0o755)
    stage = Stage(tmp_path)
    stage.answer(declaration())
    return stage


def test_a_program_is_declared_and_then_run(stage: Stage) -> None:
    assert stage.hprm("run", "app.py", "x", "--", "-y") == (0, "", "")
    assert stage.calls == [
        ["-m", "hprm", "declare", "--", "app.py", "x", "-y"],
        ["-m", "hprm", "run", "--", "app.py", "x", "-y"],
    ]


def test_a_program_without_federates_is_run_at_once(stage: Stage) -> None:
    text = TEXT.replace("Federation", "Reactor")
    (stage.folder / "app.py").write_text(text)
    words = ["run", "app.py", "--rate", "3", "--logical-trace", "a", "--json", "x"]
    assert stage.hprm(*words) == (0, "", "")
    stated = ["--launcher", COMMAND, "--property=main.rate=3", "--", "app.py", "x"]
    assert stage.calls == [["-m", "hprm", "run", "--json", "--logical-trace", "a", *stated]]
    # What only federations need is stated, or it is known that it is one.
    for option in ("--in-process", "--join-timeout=9", "--hang-timeout=9", "--federation-known"):
        (stage.folder / "calls").unlink()
        assert stage.hprm("run", option, "app.py") == (0, "", "")
        assert [call[2] for call in stage.calls] == ["declare", "run"]
        assert "--launcher" not in stage.calls[1]


def test_parameters_and_properties_reach_the_declaration(stage: Stage) -> None:
    words = ["run", "app.py:Vision", "--rate", "20", "--timeout", "1 s", "--property", "fast=true"]
    code, _, err = stage.hprm(*words)
    assert (code, err) == (0, "")
    stated = ["--property=fast=true", "--property=main.rate=20", "--property=timeout=1 s"]
    assert [(call[2], sorted(call[3:-2]), call[-2:]) for call in stage.calls] == [
        ("declare", stated, ["--", "app.py:Vision"]),
        ("run", stated, ["--", "app.py:Vision"]),
    ]


def test_what_is_wrong_with_the_graph_is_shown_at_its_place(stage: Stage) -> None:
    stage.answer(declaration(period=-1))
    code, out, err = stage.hprm("run", "app.py")
    assert (code, out, len(stage.calls)) == (1, "", 1)
    assert err.startswith("error[LF0407]: this time is negative\n --> app.py:4:5\n")


def test_python_says_itself_what_is_wrong_with_it(stage: Stage) -> None:
    stage.script("print('loading'); print('error: no reactor', file=sys.stderr); sys.exit(3)")
    for words in (["run"], ["verify"], ["rti", "--listen", "unix:@x"]):
        code, out, err = stage.hprm(words[0], "app.py", *words[1:])
        assert (code, out) == (3, "")
        assert sorted(err.splitlines()) == ["error: no reactor", "loading"]
    code, out, err = stage.hprm("check", "app.py")
    assert (code, out) == (1, "1 program checked: 1 error, no warnings\n")
    assert sorted(err.splitlines()) == ["error: no reactor", "loading"]


def test_check_shows_what_it_finds_and_asks_no_more(stage: Stage) -> None:
    document = declaration()
    document["reactors"][2]["connections"] = []
    stage.answer(document)
    code, out, err = stage.hprm("check", "app.py")
    assert (code, out) == (0, "1 program checked: no errors, 1 warning\n")
    assert "warning[LF0505]: nothing is connected to `sink.inp`" in err
    assert "connect an output to it: `hprm.connect(..., self.sink.inp)`" in err
    code, out, _ = stage.hprm("check", "--json", "app.py:Vision")
    assert (code, json.loads(out)["code"]) == (0, "LF0505")
    assert [call[2:] for call in stage.calls] == [
        ["declare", "--", "app.py"],
        ["declare", "--", "app.py:Vision"],
    ]


def test_a_program_that_is_not_declared_is_one_error(stage: Stage) -> None:
    stage.answer("{}")
    code, _, err = stage.hprm("run", "app.py")
    assert code == 1
    assert err == (
        "error: app.py: the declaration of the program cannot be read: missing field `files` at "
        "line 1 column 2\n"
        "  hint: the package hprm of the interpreter may have another version than this command: "
        "hprm doctor tells\n"
    )
    (stage.folder / "answer").unlink()
    code, _, err = stage.hprm("run", "app.py")
    assert (code, err) == (
        1,
        "error: app.py has not declared a program\n  hint: does it end the interpreter when it is "
        "imported?\n",
    )


def test_a_wrong_path_or_interpreter_is_one_error(stage: Stage) -> None:
    code, _, err = stage.hprm("run", "nowhere.py:Vision")
    assert (code, err) == (
        1,
        "error: cannot read nowhere.py: No such file or directory\n"
        "  hint: is the path right? It is relative to the current directory\n",
    )
    code, _, err = stage.hprm("run", "--python", "./app.py", "app.py")
    assert (code, stage.calls) == (1, [])
    assert err.startswith("error: ./app.py is no Python interpreter\n")
    (stage.folder / "app.txt").touch()
    code, _, err = stage.hprm("run", "app.txt")
    assert err == (
        "error: app.txt is not a program\n"
        "  hint: programs are files whose name ends in .lf or .py, and executables\n"
    )


def test_federates_get_the_path_as_it_was_typed(stage: Stage) -> None:
    stage.answer(declaration(federated=True))
    code, _, err = stage.hprm(
        "federate", "app.py:Vision", "sink", "--rti", "unix:@x", "-i", "0" * 31 + "1"
    )
    assert (code, err) == (0, "")
    # Which checks the program itself, so nothing is declared before.
    assert [call[2] for call in stage.calls] == ["federate"]
    assert stage.calls[0][-3:] == ["--", "app.py:Vision", "sink"]
    code, _, err = stage.hprm("federate", "a.py", "sink", "--rti", "unix:@x", "-i", "0" * 31 + "1")
    assert (code, len(stage.calls)) == (1, 1)
    assert err.startswith("error: cannot read a.py: No such file or directory\n")
    code, _, err = stage.hprm("run", "--debug", "nobody", "app.py")
    assert err == "error: app.py has no federate nobody\n  hint: its federates: source, sink\n"


def test_a_federation_in_one_process_is_run_by_one_interpreter(stage: Stage) -> None:
    stage.answer(declaration(federated=True))
    code, _, err = stage.hprm("run", "--in-process", "app.py")
    assert (code, err) == (0, "")
    assert [call[2] for call in stage.calls] == ["declare", "run"]
    assert "--in-process" in stage.calls[1] and stage.calls[1][-2:] == ["--", "app.py"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_is_interrupted_while_it_is_declared_leaves_nothing(
    stage: Stage, number: signal.Signals
) -> None:
    # The signal ends the interpreter, as it does others.
    stage.script(
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.SIG_DFL)\n"
        "signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])\n"
        "(here / 'pid').write_text(str(os.getpid()))\n"
        "time.sleep(60)\n"
    )
    process = stage.start("run", "app.py")
    pid = stage.folder / "pid"
    until(lambda: pid.exists() and pid.read_text() != "", "the declaration begins")
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err, stage.left) == (128 + number, "", [])
    until(lambda: not Path(f"/proc/{pid.read_text()}").exists(), "the interpreter has ended")


def test_a_second_signal_kills(stage: Stage) -> None:
    stage.script(
        "import signal\n"
        "signal.signal(signal.SIGTERM, lambda *_: (here / 'first').write_text('x'))\n"
        "(here / 'pid').write_text(str(os.getpid()))\n"
        "while True: time.sleep(60)\n"
    )
    process = stage.start("check", "app.py")
    until((stage.folder / "pid").exists, "the declaration begins")
    process.terminate()
    until((stage.folder / "first").exists, "the interpreter gets the signal")
    time.sleep(2 * ONE_SIGNAL_S)
    process.terminate()
    _, err = process.communicate(timeout=60)
    assert stage.left == []
    assert "app.py was killed by signal 9" in err
