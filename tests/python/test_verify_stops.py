"""``hprm verify`` that is asked to stop, or killed: nothing of it is left."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest
from processes import Bench, finish, until

SAYS_SO = """\
  reaction(startup) {=
    import os
    with open("program.pid", "w") as file:
        print(os.getpid(), file=file)
  =}
"""

ALONE = f"""\
target Python
main reactor {{
  timer t(0, 10 ms)
  reaction(t) {{= pass =}}
{SAYS_SO}}}
"""

FEDERATION = f"""\
target Python
reactor A {{
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {{= out.set(1) =}}
}}
reactor B {{
  input inp
  reaction(inp) {{= pass =}}
{SAYS_SO}}}
federated reactor {{
  a = new A()
  b = new B()
  a.out -> b.inp
}}
"""


def begun(bench: Bench, text: str, temporary: Path) -> subprocess.Popen[str]:
    """``hprm verify``, once the program that it verifies runs."""
    temporary.mkdir(exist_ok=True)
    (bench.folder / "Main.lf").write_text(text)
    (bench.folder / "program.pid").unlink(missing_ok=True)
    process = bench.call("verify", "Main.lf", environment={"TMPDIR": str(temporary)})
    bench.pid("program")
    return process


@pytest.mark.parametrize("text", [ALONE, FEDERATION], ids=["alone", "federation"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_what_it_runs(
    bench: Bench, tmp_path: Path, text: str, number: signal.Signals
) -> None:
    process = begun(bench, text, tmp_path / "tmp")
    process.send_signal(number)
    outcome = finish(process)
    assert (outcome.code, outcome.out) == (128 + number, ""), outcome.err
    assert not bench.left()
    assert not list((tmp_path / "tmp").iterdir())


@pytest.mark.parametrize("text", [ALONE, FEDERATION], ids=["alone", "federation"])
def test_a_kill_ends_what_it_runs_and_the_next_one_tidies_up(
    bench: Bench, tmp_path: Path, text: str
) -> None:
    process = begun(bench, text, tmp_path / "tmp")
    process.kill()
    process.wait()
    until(lambda: not bench.left(), "nothing runs any more")
    (left,) = (tmp_path / "tmp").glob("hprm-verify-*")
    process = begun(bench, text, tmp_path / "tmp")
    assert not left.exists()
    process.send_signal(signal.SIGINT)
    assert finish(process).code == 130
    assert not list((tmp_path / "tmp").glob("hprm-verify-*"))
