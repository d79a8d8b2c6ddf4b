"""The messages for a wrong name in a body, before and while the program runs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest
from conftest import Outcome, runner

PROGRAM = """\
target Python {{ timeout: 1 s, fast: true }}
preamble {{= {preamble} =}}
reactor Child {{
  input inp
  output out
  reaction(inp) -> out {{= out.set(inp.value) =}}
}}
reactor Robot(period = 1 s) {{
  preamble {{= def tool(self): return 3 =}}
  input image
  mutable input frame
  output box
  output print
  state count = 0
  logical action go
  timer t(0, period)
  child = new Child()
  other = new Child()
  method twice(x) {{= return 2 * x =}}
  reaction(startup) -> child.inp, other.inp, print {{=
    if False: print.set(1)
  =}}
  reaction(t) image, child.out -> box {{=
    box.set(self.count)
    {body}
  =}}
}}
main reactor {{
  robot = new Robot()
  reaction(startup) -> robot.image, robot.frame {{= pass =}}
}}
"""


def check(tmp_path: Path, body: str, preamble: str = "pass") -> list[dict[str, Any]]:
    """What ``hprm check`` finds in that body of a reaction."""
    text = PROGRAM.format(body=body, preamble=preamble)
    (tmp_path / "Program.lf").write_text(text)
    command = [str(Path(sys.executable).with_name("hprm")), "check", "--json", "Program.lf"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stderr == "", done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == any(one["severity"] == "error" for one in found)
    return found


def run(tmp_path: Path, body: str, preamble: str = "pass") -> Outcome:
    command = [sys.executable, "-m", "hprm", "run"]
    return runner(command, tmp_path)(PROGRAM.format(body=body, preamble=preamble))


# What is wrong, and what both the check and the run answer.
UNNAMED = [
    ("go.schedule(0)", "`go` is an action of this reactor; add `-> go` to the reaction"),
    ("if go.is_present: pass", "or `go` to the triggers"),
    ("frame.value", "`frame` is an input of this reactor; add it to the triggers"),
    ("other.inp.set(1)", "`other.inp` is an input of a contained reactor; add `-> other.inp`"),
    ("[other.out.value for _ in range(2)]", "add it to the triggers, `reaction(other.out)`"),
    ("other.outt", "did you mean `out`?"),
    ("t", "`t` is a timer of this reactor; it triggers reactions, and a body cannot use it"),
    ("box.set(period)", "`period` is a parameter of this reactor: write `self.period`"),
    ("count == 1", "`count` is a state variable of this reactor: write `self.count`"),
    ("twice(2)", "`twice` is a method of this reactor: write `self.twice`"),
    ("(lambda: tool())()", "`tool` is defined in a preamble of this reactor: write `self.tool`"),
]


@pytest.mark.parametrize(("body", "hint"), UNNAMED)
def test_what_the_reactor_has_and_the_body_does_not_get(
    tmp_path: Path, body: str, hint: str
) -> None:
    [found] = check(tmp_path, body)
    assert (found["code"], found["severity"]) == ("LF1003", "error")
    assert hint in found["hint"] and "is not defined in this body" in found["message"]
    assert found["at"]["line"] == 25
    outcome = run(tmp_path, body)
    assert (outcome.code, outcome.out) == (1, ""), "it has not started"
    assert f"--> Program.lf:25:{found['at']['column']}\n" in outcome.err
    assert "  hint: " in outcome.err and hint in outcome.err


def test_names_that_something_else_has_are_let_alone(tmp_path: Path) -> None:
    body = "go = 1; go += 1; [frame for frame in ()]; (lambda t: t)(1); period"
    assert check(tmp_path, body, preamble="period = 1") == []
    assert run(tmp_path, body, preamble="period = 1").code == 0
    assert check(tmp_path, "t", preamble="def f():\n    global t\n    t = 1\n") == []


def test_with_names_that_no_text_shows_an_error_is_a_warning(tmp_path: Path) -> None:
    preamble = "globals()['period'] = 1"
    [found] = check(tmp_path, "period", preamble=preamble)
    assert found["severity"] == "warning"
    assert run(tmp_path, "period", preamble=preamble).code == 0


OTHERS = [
    ("LF1004", "warning", "np.zeros(3)", "`np` is not defined", "import numpy as np"),
    ("LF1004", "warning", "time.sleep(1)", "`time` is not defined", "add `import time`"),
    ("LF1004", "warning", "lf_set(box, 1)", "`lf_set` is not defined", "`port.set(value)`"),
    ("LF1004", "warning", "pritn(1)", "`pritn` is not defined", "did you mean `print`?"),
    ("LF1005", "error", "image.shape", "a port has no `shape`", "its value is `image.value`"),
    ("LF1005", "error", "image.is_presnt", "no `is_presnt`", "did you mean `is_present`?"),
    ("LF1005", "error", "lf.reqest_stop()", "no `reqest_stop`", "did you mean `request_stop`?"),
    ("LF1005", "error", "lf.time_start()", "no `time_start`", "did you mean `lf.time.start`?"),
    ("LF1005", "error", "lf.time.logicl()", "no `logicl`", "did you mean `logical`?"),
    ("LF1005", "error", "self.go", "`self` has no `go`", "add `-> go`"),
    ("LF1005", "error", "child.outt", "`Child` has no port `outt`", "did you mean `out`?"),
    ("LF1003", "error", "child.inp.set(1)", "does not name `child.inp`", "add `-> child.inp`"),
    ("LF1003", "error", "count += 1", "`count` has no value yet", "write `self.count`"),
    ("LF1003", "error", "print.set(1)", "`print` is Python's own", "add `-> print`"),
    ("LF1006", "warning", "box = 1", "sets no port", "write `box.set(value)`"),
    ("LF1006", "warning", "print = 1", "sets no port", "and add `-> print` to the reaction"),
    ("LF1006", "warning", "count = 1", "nothing reads", "write `self.count`"),
    ("LF1007", "error", "self.period = 1", "cannot be assigned", "in a state variable"),
    ("LF1007", "error", "image.value = 1", "by an assignment", "only its sender sets it"),
    ("LF1007", "error", "child_out.set(1)", "cannot be set here", "sets the outputs"),
]


@pytest.mark.parametrize(("code", "severity", "body", "message", "hint"), OTHERS)
def test_the_check_finds_what_cannot_be_right(
    tmp_path: Path, code: str, severity: str, body: str, message: str, hint: str
) -> None:
    [found] = check(tmp_path, body)
    assert (found["code"], found["severity"]) == (code, severity)
    assert message in found["message"] and hint in found["hint"], found


@pytest.mark.parametrize(
    "body",
    [
        "image = image.value; image.shape",
        "box = box[0]",
        "image.set(1); print(image.width, image.value, image.intended_tag)",
        "self.anything = 1; self.anything",
        "setattr(self, 'anything', 1); self.anything",
        "self.count += 1; self.tool(); self.bank_index; lf.time.logical()",
        "print(__file__, __name__)",
    ],
)
def test_the_check_is_content(tmp_path: Path, body: str) -> None:
    assert check(tmp_path, body) == []


RAISED = [
    ("image.value + 1", "`image` is absent at this tag, so `image.value` is None"),
    ("frame = image.value\n    frame.shape", "ask first: `if image.is_present:`"),
    ("child.out.value.shape", "`child.out` is absent at this tag"),
    ("image.shape", "`image` is the port, and its value is `image.value`"),
    ("getattr(image, 'shap')", "`image` is the port, and its value is `image.value`"),
    ("lf.reqest_stop()", "did you mean `request_stop`?"),
    ("self.period = 1", "the parameter period cannot be assigned"),
    ("self.coutn", "did you mean `count`?"),
    ("self.go", "`go` is an action of this reactor; add `-> go` to the reaction"),
    ("child.inp.set(1)", "`child.inp` is an input of a contained reactor; add `-> child.inp`"),
    ("count += 1", "`count` is a state variable of this reactor: write `self.count`"),
    ("eval('go')", "`go` is an action of this reactor; add `-> go` to the reaction"),
    ("np.zeros(3)", "add `import numpy as np` to a `preamble"),
    ("pritn(1)", "did you mean `print`?"),
    ("''.joi([])", "did you mean `join`?"),
    (
        "import numpy; a = numpy.zeros(3); a.flags.writeable = False; a[0] = 1",
        "write to a copy, `value.copy()`",
    ),
]


@pytest.mark.parametrize(("body", "hint"), RAISED)
def test_an_exception_has_a_hint_behind_its_traceback(tmp_path: Path, body: str, hint: str) -> None:
    outcome = run(tmp_path, body)
    assert outcome.code == 1
    assert "Traceback" in outcome.err
    last = outcome.err.rstrip().splitlines()[-1]
    # Newer versions of Python say the same in their own words.
    last = re.sub(r"Did you mean: '(\w+)'\?", r"did you mean `\1`?", last)
    assert hint in last, outcome.err


def test_no_hint_is_better_than_a_wrong_one(tmp_path: Path) -> None:
    for body in ("None + 1", "x = None; x.shape", "raise ValueError('wrong')", "[][0]"):
        outcome = run(tmp_path, body)
        assert outcome.code == 1 and "hint:" not in outcome.err


DEEP = [
    ("x = " + "-" * 100_000 + "1", "nested too deeply"),
    ("x = " + "(" * 5_000 + ")" * 5_000, "too many nested parentheses"),
    ("x = " + "a." * 50_000 + "b", "nested too deeply"),
    ("x = " + "9" * 10_000, "Exceeds the limit"),
    ("x = '\0'", "null byte"),
]


@pytest.mark.parametrize(("body", "message"), DEEP)
def test_what_the_compiler_cannot_take_has_a_message(
    tmp_path: Path, body: str, message: str
) -> None:
    [found] = check(tmp_path, body)
    assert found["code"] == "LF1001" and message in found["message"], found["message"]
    assert found["at"]["line"] in (24, 25)
    outcome = run(tmp_path, body)
    assert outcome.code == 1 and message in outcome.err and "Traceback" not in outcome.err


def test_the_check_knows_the_names_that_bodies_have(tmp_path: Path) -> None:
    """The lists in the package are those of the module ``lf`` and of the main module."""
    program = """
    target Python
    main reactor {
      reaction(startup) {=
        from hprm import _lf, _main
        own = {name for name in vars(lf) if not name.startswith("__")}
        assert own == _lf.NAMES, own ^ _lf.NAMES
        times = {name for name in vars(lf.time) if not name.startswith("__")}
        assert times == _lf.TIMES, times ^ _lf.TIMES
        main = {name for name in globals() if not name.startswith("__")}
        assert main - {"_Program"} == _main.NAMES, main ^ _main.NAMES
      =}
    }
    """
    outcome = runner([sys.executable, "-m", "hprm", "run"], tmp_path)(textwrap.dedent(program))
    assert outcome.code == 0, outcome.err


def test_a_program_without_mistakes_pays_for_no_hint(tmp_path: Path) -> None:
    modules = {"hprm._lint", "hprm._hints", "hprm._names", "symtable", "difflib"}
    body = f"assert not {modules} & set(sys.modules)"
    assert run(tmp_path, body).code == 0
