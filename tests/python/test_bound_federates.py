"""Federates whose programs are Python files: as threads, and as processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from declaring import Script, environment, ok, runner


@pytest.fixture
def script(tmp_path: Path) -> Script:
    return runner(tmp_path)


FEDERATION = """
import threading
from stand_in import Declared, Reactor
import shared

seen = []

class Source(Reactor):
    ports = ("output x",)
    reactions = ({"name": "begin", "triggers": ["startup"], "effects": ["x"]},)
    def begin(self):
        seen.append("source")
        shared.passed.wait(60)
        self.x.set([1])

class Sink(Reactor):
    ports = ("input x",)
    timers = (("tick", 10_000_000, None),)
    reactions = (
        {"name": "tick_tock", "triggers": ["tick"]},
        {"name": "take", "triggers": ["x"]},
    )
    def tick_tock(self):
        shared.passed.set()
    def take(self):
        print("in time", self.x.value, seen)
    def take_tardy(self):
        print("tardy", self.x.value, seen, self.x.intended_tag.time == self.api.start())

class Main(Reactor):
    federated = True
    file = __file__
    options = {"source": {"maxwait": 0}, "sink": {"maxwait": 0}}
    connections = (("source.x", "sink.x"),)
    def __init__(self):
        self.source, self.sink = Source(), Sink()

DECLARED = Declared(Main(), coordination={"word": "decentralized"}, timeout={"time": 10**8})
"""

LOADING = """
import importlib.util, types
def load(path, properties):
    spec = importlib.util.spec_from_file_location("federation", path.partition(":")[0])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.DECLARED
stand_in = sys.modules["hprm._declared"] = types.ModuleType("hprm._declared")
stand_in.load = load
"""


def test_federates_as_threads_have_modules_of_their_own(script: Script) -> None:
    out = ok(
        script(
            LOADING + "sys.exit(_hprm.run_in_process('federation.py:Main'))",
            federation=FEDERATION,
            shared="import threading\npassed = threading.Event()\n",
        )
    )
    assert out == "[sink] tardy [1] [] True\n"


INTERPRETER = """#!{python}
import os, runpy, sys
arguments = sys.argv[1:]
if arguments[:2] != ["-m", "hprm"]:
    os.execv({python!r}, [{python!r}, *arguments])
{loading}
sys.argv = arguments[1:]
if "declare" not in arguments:
    runpy.run_module("hprm", run_name="__main__", alter_sys=True)
out = arguments[arguments.index("--out") + 1]
with open(out, "w") as file:
    file.write(load(arguments[-1], []).text)
"""


def test_federates_as_processes(tmp_path: Path) -> None:
    interpreter = tmp_path / "interpreter"
    interpreter.write_text(INTERPRETER.format(python=sys.executable, loading=LOADING))
    interpreter.chmod(0o755)
    (tmp_path / "federation.py").write_text(FEDERATION)
    (tmp_path / "shared.py").write_text(
        """
import os, pathlib, time
class passed:
    def set():
        pathlib.Path("passed").touch()
    def wait(limit):
        while not os.path.exists("passed"):
            time.sleep(0.01)
"""
    )
    done = subprocess.run(
        [
            Path(sys.executable).with_name("hprm"),
            *("run", "--federation-known", "--python", interpreter, "federation.py:Main"),
            *("--logical-trace", "trace"),
        ],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[sink] tardy [1] [] True\n"
    assert (tmp_path / "trace").exists()


def test_every_federate_must_declare_the_same(script: Script) -> None:
    outcome = script(
        LOADING + "sys.exit(_hprm.run_in_process('federation.py'))",
        federation=FEDERATION
        + "shared.loaded += 1\nDECLARED.text = DECLARED.text + ' ' * shared.loaded\n",
        shared="import threading\npassed = threading.Event()\nloaded = 0\n",
    )
    assert outcome.code == 1
    assert "federation.py declares another program each time it is loaded" in outcome.err


def test_a_file_that_cannot_be_loaded_is_told_of(script: Script) -> None:
    outcome = script(
        LOADING + "sys.exit(_hprm.run_program('federation.py'))",
        federation="from stand_in import *\nimport nothing_of_that_name\n",
    )
    assert outcome.code == 1
    assert "loading federation.py raised ModuleNotFoundError" in outcome.err
    assert "federation.py:2" in outcome.err
