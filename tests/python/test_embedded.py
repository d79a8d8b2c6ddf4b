"""Programs that Python declares run in a process that goes on, which is as it was before."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from declaring import Script, environment, ok, runner, write
from processes import until


@pytest.fixture
def script(tmp_path: Path) -> Script:
    return runner(tmp_path)


def test_mistakes_are_told_before_anything_runs(script: Script) -> None:
    outcome = script(
        """
        class Main(Reactor):
            ports = ("output x",)
            reactions = ({"name": "begin", "triggers": ["x"]},)
            def begin(self):
                print("never")

        can_run, text, _ = _hprm.check_declared(Declared(Main()))
        print(can_run, text.splitlines()[0])
        print(*_hprm.check_declared(Declared(Reactor()), ["timeout=x"])[1].splitlines()[:1])
        try:
            _hprm.check_declared(type("Other", (), {"text": '{"main": 0}'}))
        except RuntimeError as error:
            print(error)
        go(Main())
        """
    )
    assert outcome.code == 1
    lines = outcome.out.splitlines()
    assert lines[0].startswith("False error[LF")
    assert lines[1].startswith("error[LF")
    assert lines[2].startswith("the declaration of the program cannot be read: missing field")
    assert outcome.err.startswith(lines[0].removeprefix("False "))
    assert "app.py:" in outcome.err


def test_a_thread_that_dies_ends_the_program(script: Script) -> None:
    outcome = script(
        """
        import threading
        class Main(Reactor):
            actions = ({"name": "act", "physical": True},)
            reactions = ({"name": "begin", "triggers": ["startup"], "effects": ["act"]},
                         {"name": "later", "triggers": ["act"]})
            def begin(self):
                def work():
                    self.act.schedule("0 s", "from a thread")
                    try:
                        self.act.value
                    except RuntimeError as error:
                        print(error)
                    1 / 0
                self.thread = threading.Thread(target=work)
                self.thread.start()
                self.thread.join()
            def later(self):
                print(self.act.value)
        go(Main())
        """
    )
    assert outcome.code == 1
    assert "ZeroDivisionError" in outcome.err
    assert outcome.out.startswith("act can be used only inside a reaction")


def test_what_replaces_the_standard_error_is_told(script: Script) -> None:
    out = ok(
        script(
            """
            import contextlib, io
            class Main(Reactor):
                reactions = ({"name": "begin", "triggers": ["startup"]},)
                def begin(self):
                    1 / 0
            class Wrong(Reactor):
                ports = ("output x",)
            class Warned(Reactor):
                def __init__(self):
                    self.child = Child()
            class Child(Reactor):
                ports = ("input unused",)
                reactions = ({"name": "take", "triggers": ["unused"]},)
                def take(self):
                    pass
            for main in (Main(), Wrong(), Warned()):
                with contextlib.redirect_stderr(io.StringIO()) as told:
                    code = _hprm.run_declared(Declared(main))
                print(code, *told.getvalue().splitlines()[:1])
            can_run, text, _ = _hprm.check_declared(Declared(Warned()))
            print(can_run, text.splitlines()[0])
            """
        )
    )
    assert out.splitlines() == [
        "1 error: reaction Main.begin raised ZeroDivisionError: division by zero",
        "1 error[LF0207]: the main reactor cannot have ports: nothing contains it",
        "0",
        "True warning[LF0505]: nothing is connected to `child.unused`",
    ]


def test_bodies_have_event_loops_where_another_one_runs(script: Script) -> None:
    out = ok(
        script(
            """
            import asyncio
            class Main(Reactor):
                reactions = ({"name": "begin", "triggers": ["startup"]},)
                def begin(self):
                    asyncio.run(self.wait())
                async def wait(self):
                    await asyncio.sleep(0)
                    print("in a body", asyncio.current_task() is not None)
            async def main():
                task, loop = asyncio.current_task(), asyncio.get_running_loop()
                print(_hprm.run_declared(Declared(Main())))
                await asyncio.sleep(0)
                print(asyncio.current_task() is task, asyncio.get_running_loop() is loop)
            asyncio.run(main())
            """
        )
    )
    assert out == "in a body True\n0\nTrue True\n"


CHANGES = """
import json, os, pathlib, signal, threading
held = os.pipe()
for descriptor in held:
    os.set_blocking(descriptor, False)
signal.set_wakeup_fd(held[1], warn_on_full_buffer=False)

def state():
    names = sorted(it.name for it in threading.enumerate())
    wakeup = signal.set_wakeup_fd(-1)
    signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    hooks = threading.excepthook, sys.excepthook, sys.stdout, sys.stderr, sys.breakpointhook
    modules = {name for name in sys.modules if name.partition(".")[0] == "__main__"}
    return names, wakeup, [signal.getsignal(it) for it in numbers], hooks, modules, sys.path[:]

class Main(Reactor):
    actions = ({"name": "forever", "physical": True},)
    reactions = ({"name": "begin", "triggers": ["startup"]},
                 {"name": "end", "triggers": ["shutdown", "forever"]})
    def __init__(self, code):
        self.code = code
    def begin(self):
        pathlib.Path("ready").touch()
        if self.code is not None:
            sys.exit(self.code)
    def end(self):
        print("end", flush=True)
"""


def test_a_process_is_as_it_was_after_a_run(script: Script) -> None:
    out = ok(
        script(
            CHANGES
            + """
before = state()
declared = Declared(Main(3), timeout={"time": 0})
print(_hprm.run_declared(declared), _hprm.run_declared(declared))
assert state() == before
print(_hprm.run_declared(Declared(Main(None)), ["timeout=1 ms"]))
assert state() == before

codes = []
def run(declared):
    codes.append(_hprm.run_declared(declared, ["timeout=2 ms"]))
threads = [threading.Thread(target=run, args=(Declared(Main(code)),)) for code in (None, 4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(sorted(codes))
assert state() == before
"""
        )
    )
    assert out.splitlines() == ["3 3", "end", "0", "end", "[0, 4]"]


def test_a_forked_process_runs_programs_of_its_own(script: Script) -> None:
    out = ok(
        script(
            CHANGES
            + """
_hprm.run_declared(Declared(Main(1)))
for code in (5, 6):
    child = os.fork()
    if child == 0:
        os._exit(_hprm.run_declared(Declared(Main(code))))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))

class Forks(Reactor):
    reactions = ({"name": "begin", "triggers": ["startup"]},)
    def begin(self):
        self.child = os.fork()
forks = Forks()
_hprm.run_declared(Declared(forks))
print("once", os.waitstatus_to_exitcode(os.waitpid(forks.child, 0)[1]))
"""
        )
    )
    assert out.splitlines() == ["5", "6", "once 0"]


def test_signals_stop_a_run_and_not_the_process(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        CHANGES
        + """
before = state()
for _ in range(3):
    print(_hprm.run_declared(Declared(Main(None))), flush=True)
    assert state() == before
""",
    )
    with subprocess.Popen(
        [sys.executable, path.name],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
                until((tmp_path / "ready").exists, "the program runs")
                (tmp_path / "ready").unlink()
                process.send_signal(number)
            out, err = process.communicate(timeout=30)
        finally:
            process.kill()
    assert (out.splitlines(), err) == (["end", "130", "end", "143", "end", "130"], "")


def test_a_second_signal_interrupts_a_body(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        """
import pathlib, time
class Main(Reactor):
    reactions = ({"name": "begin", "triggers": ["startup"]},)
    def begin(self):
        pathlib.Path("ready").touch()
        while True:
            time.sleep(0.01)
print(_hprm.run_declared(Declared(Main())), flush=True)
""",
    )
    with subprocess.Popen(
        [sys.executable, path.name],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            until((tmp_path / "ready").exists, "the program runs")
            process.send_signal(signal.SIGINT)
            # Signals that are pending at once count once, and a third one might come after the run.
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(1)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=30)
        finally:
            process.kill()
    assert out == "130\n"
    assert "reaction Main.begin" in err
