"""Programs that reactions and constructors start: one error each, and nothing that goes on."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from processes import call

import hprm
import hprm.testing

PROGRAM = """
import asyncio
import hprm
import hprm.testing

class Source(hprm.Reactor):
    out = hprm.Output(int)

    @hprm.reaction(hprm.startup, effects=[out]{options})
    {word}def send(self):
        {body}

    {handler}

class Sink(hprm.Reactor):
    inp = hprm.Input(int)

    @hprm.reaction(inp)
    def show(self):
        print(self.inp.value)

class Main(hprm.{base}, timeout="30 ms"):
    def __init__(self):
        self.source, self.sink = Source(), Sink()
        self.source.out >> self.sink.inp

if __name__ == "__main__":
    {script}
"""

RUN = "hprm.run(Main())"
HINT = "hint: put the reactor into this program, or start another process with `subprocess`"


def outcome(tmp_path: Path, **parts: str) -> tuple[int, str, int]:
    """Run a program with these parts; return its exit code, what it tells, and the marked line."""
    given = {"options": "", "word": "", "body": "pass", "handler": "", "base": "Reactor"} | parts
    text = PROGRAM.format(**({"script": RUN} | given))
    (tmp_path / "nested.py").write_text(text)
    done = subprocess.run(
        [sys.executable, "nested.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    lines = text.splitlines()
    marked = [number for number, line in enumerate(lines, 1) if line.endswith("# here")]
    return done.returncode, done.stdout + done.stderr, marked[0] if marked else 0


@pytest.mark.parametrize("base", ["Reactor", "Federation"])
@pytest.mark.parametrize(
    ("call", "called"),
    [
        (RUN, "hprm.run"),
        ("hprm.run(Main(), processes=False)", "hprm.run"),
        ("hprm.run(Main)", "hprm.run"),
        ("hprm.testing.run(Main())", "hprm.testing.run"),
    ],
)
def test_a_reaction_runs_no_program(tmp_path: Path, base: str, call: str, called: str) -> None:
    code, told, line = outcome(tmp_path, base=base, body=f"{call}  # here")
    assert code == 1
    assert f"{called} was called in a reaction, and a reaction cannot run a program" in told
    assert f"--> nested.py:{line}:9" in told
    assert told.count("error") == told.count(HINT) == 1
    assert "Traceback" not in told


@pytest.mark.parametrize(
    "parts",
    [
        {
            "options": ', deadline="1 ns", late="miss"',
            "handler": f"def miss(self): {RUN}  # here",
        },
        {"word": "async ", "body": "await self.work()", "handler": f"async def work(self): {RUN}"},
        {"body": "self.work()", "handler": f"def work(self): {RUN}"},
    ],
)
def test_what_a_reaction_calls_and_what_runs_instead_run_no_program(
    tmp_path: Path, parts: dict[str, str]
) -> None:
    code, told, _ = outcome(tmp_path, **parts)
    assert code == 1
    assert "hprm.run was called in a reaction" in told
    assert told.count(HINT) == 1


def test_federates_that_share_a_process_run_no_program(tmp_path: Path) -> None:
    outcome(tmp_path, base="Federation", body=f"{RUN}  # here", script="pass")
    command = [str(Path(sys.executable).with_name("hprm")), "run", "--in-process", "nested.py"]
    done = call(*command, cwd=tmp_path, code=1, timeout=60)
    assert "federate source: hprm.run was called in a reaction" in done.stderr


@pytest.mark.parametrize("run", [hprm.run, hprm.testing.run])
def test_a_constructor_runs_no_program(run: object) -> None:
    class Inner(hprm.Reactor):
        """What would run."""

    class Outer(hprm.Reactor):
        def __init__(self) -> None:
            run(Inner())  # type: ignore[operator]

    with pytest.raises(hprm.ProgramError, match="in the constructor of a reactor") as raised:
        Outer()
    assert Path(__file__).name in raised.value.place
    # The constructor is over, so the script can run programs.
    hprm.run(Inner())


@pytest.mark.parametrize("command", [[sys.executable], ["hprm", "run"]])
def test_a_federate_is_made_by_no_constructor_that_runs_a_program(
    tmp_path: Path, command: list[str]
) -> None:
    given = {"handler": "def __init__(self): hprm.run(Sink)  # here", "base": "Federation"}
    _, _, line = outcome(tmp_path, **given, script="pass")
    if command[0] == "hprm":
        command = [str(Path(sys.executable).with_name("hprm")), *command[1:]]
    else:
        (tmp_path / "script.py").write_text("import nested, hprm\nhprm.run(nested.Main)\n")
    file = "script.py" if command[0] == sys.executable else "nested.py"
    done = call(*command, file, cwd=tmp_path, code=1, timeout=60)
    assert "hprm.run was called in the constructor of a reactor" in done.stderr
    assert f"--> nested.py:{line}:" in done.stderr
    assert done.stderr.count("error") == 1


def test_scripts_run_programs_one_after_the_other_and_in_threads(tmp_path: Path) -> None:
    script = textwrap.dedent(
        """
        import concurrent.futures
        for _ in range(2):
            hprm.run(Main())
            hprm.run(Main(), processes=False)
            hprm.testing.run(Main())
        try:
            hprm.run(Fails())
        except hprm.ProgramFailed:
            hprm.run(Main())
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            for done in [pool.submit(hprm.run, Main(), processes=False) for _ in range(6)]:
                done.result()
        async def call():
            await asyncio.to_thread(hprm.run, Main())
            hprm.run(Main())
        asyncio.run(call())
        """
    )
    fails = "class Fails(hprm.Reactor):\n    go = hprm.reaction(hprm.startup)(lambda self: 1 / 0)\n"
    code, told, _ = outcome(
        tmp_path,
        body="self.out.set(7777)",
        script=textwrap.indent(fails + script, "    ").strip(),
    )
    assert code == 0, told
    # Threads may print on one line.
    assert told.count("7777") == 2 * 3 + 1 + 6 + 2
    assert told.count("error") == 1


def test_a_reaction_may_start_a_process_that_runs_a_program(tmp_path: Path) -> None:
    (tmp_path / "other.py").write_text(
        "import hprm\n"
        "class Other(hprm.Reactor):\n"
        "    @hprm.reaction(hprm.startup)\n"
        "    def begin(self): print('the other program')\n"
        "if __name__ == '__main__': hprm.run(Other())\n"
    )
    body = "import subprocess, sys; subprocess.run([sys.executable, 'other.py'], check=True)"
    code, told, _ = outcome(tmp_path, base="Federation", body=body)
    assert code == 0
    assert "the other program" in told
