"""The end of a program: as Python ends a process, and a program that cannot end says why."""

from __future__ import annotations

import gzip
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
from processes import Bench, finish, hear

# The ways to run a program: in one process, a process for each federate, a thread for each.
WAYS = [
    pytest.param("main", [], id="main"),
    pytest.param("federated", [], id="processes"),
    pytest.param("federated", ["--in-process"], id="threads"),
]

WAITS = """
target Python {{ timeout: 0 ms }}
preamble {{=
  import pathlib, threading, time
  def save():
      while not pathlib.Path("go").exists():
          time.sleep(0.01)
      pathlib.Path("saved").write_text("all")
=}}
reactor Saver {{
  reaction(startup) {{= threading.Thread(target=save, name="saver").start() =}}
  reaction(shutdown) {{= {at_the_end} =}}
}}
{kind} reactor {{ a = new Saver() }}
"""

NOTICE = "the program has ended, but not its threads: saver"


@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_threads_are_waited_for(bench: Bench, kind: str, options: list[str]) -> None:
    process = bench.start(WAITS.format(kind=kind, at_the_end="pass"), *options)
    hear(process.stderr, NOTICE)
    (bench.folder / "go").touch()
    assert finish(process).code == 0
    assert (bench.folder / "saved").read_text() == "all"


@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_an_interrupt_ends_the_waiting(bench: Bench, kind: str, options: list[str]) -> None:
    process = bench.start(WAITS.format(kind=kind, at_the_end="pass"), *options)
    hear(process.stderr, NOTICE)
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert (outcome.code, outcome.errors, outcome.out) == (130, [], "")
    assert "Traceback" not in outcome.err
    assert not (bench.folder / "saved").exists()


def test_threads_of_workers_are_waited_for(bench: Bench) -> None:
    text = WAITS.format(kind="main", at_the_end="pass").replace(
        "a = new Saver()", "a = new[2] Saver()"
    )
    process = bench.start(text, "--property=workers=2")
    hear(process.stderr, f"{NOTICE}, saver")
    (bench.folder / "go").touch()
    assert finish(process).code == 0


def test_a_request_to_end_ends_the_waiting(bench: Bench) -> None:
    process = bench.start(WAITS.format(kind="main", at_the_end="pass"))
    hear(process.stderr, NOTICE)
    process.send_signal(signal.SIGTERM)
    assert finish(process).code == 128 + signal.SIGTERM


@pytest.mark.parametrize(("kind", "options"), WAYS[1:])
def test_a_program_that_has_failed_waits_only_briefly_for_its_threads(
    bench: Bench, kind: str, options: list[str]
) -> None:
    outcome = bench.run(WAITS.format(kind=kind, at_the_end="1 / 0"), *options)
    assert outcome.code == 1
    outcome.assert_one_error("ZeroDivisionError")
    assert "warning: did not wait longer than 2 s for threads: saver" in outcome.err


@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_executors_end_what_they_have_been_given(
    bench: Bench, kind: str, options: list[str]
) -> None:
    text = f"""
target Python {{ timeout: 0 ms }}
preamble {{=
  import time
  from concurrent.futures import ThreadPoolExecutor
  def save(number):
      time.sleep(0.01)
      with open("saved", "a") as file:
          print(number, file=file)
=}}
reactor Saver {{
  state pool = {{= ThreadPoolExecutor(1) =}}
  reaction(startup) {{=
    for number in range(20):
        self.pool.submit(save, number)
  =}}
}}
{kind} reactor {{ a = new Saver() }}
"""
    outcome = bench.run(text, *options)
    assert (outcome.code, outcome.err) == (0, "")
    saved = (bench.folder / "saved").read_text()
    assert [int(line) for line in saved.splitlines()] == list(range(20))


FILES = """
target Python {{ timeout: 0 ms }}
preamble {{=
  import gc, gzip, threading, zipfile
  import beside
  class Archive(zipfile.ZipFile):
      def __init__(self, name):
          # The archive is in an older generation than its file.
          gc.collect(0)
          super().__init__(name, "w")
  rows = open("rows", "w")
  packed = gzip.open("packed", "wt")
  archive = Archive("archive")
  class Last:
      def __del__(self): print("last", beside.name, rows.name)
  last = Last()
=}}
reactor Writer {{
  state own = {{= open("own", "w") =}}
  reaction(startup) {{=
    for file in (rows, packed, self.own, beside.rows):
        file.write("row")
    archive.writestr("member", "row")
    {also}
  =}}
}}
{kind} reactor {{ a = new Writer() }}
"""


@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_what_modules_hold_is_closed(bench: Bench, kind: str, options: list[str]) -> None:
    (bench.folder / "beside.py").write_text('name = "beside"\nrows = open("module", "w")\n')
    outcome = bench.run(FILES.format(kind=kind, also="pass"), *options)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.endswith("last beside rows\n")
    for name in ("rows", "own", "module"):
        assert (bench.folder / name).read_text() == "row", name
    with gzip.open(bench.folder / "packed", "rt") as packed:
        assert packed.read() == "row"
    with zipfile.ZipFile(bench.folder / "archive") as archive:
        assert archive.read("member") == b"row"


@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_files_are_written_while_a_daemon_runs(bench: Bench, kind: str, options: list[str]) -> None:
    (bench.folder / "beside.py").write_text('name = "beside"\nrows = open("module", "w")\n')
    daemon = "threading.Thread(target=threading.Event().wait, daemon=True).start()"
    outcome = bench.run(FILES.format(kind=kind, also=daemon), *options)
    assert (outcome.code, outcome.err) == (0, "")
    for name in ("rows", "own", "module"):
        assert (bench.folder / name).read_text() == "row", name


# Of what Python has opened itself, each a reference that leads past `sys.stdout`.
KEPT = ["sys.stdout.detach()", "sys.stdout.buffer", "sys.stdout"]


@pytest.mark.parametrize("kept", KEPT)
@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_the_standard_output_is_written_by_whatever_name(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, kind: str, options: list[str], kept: str
) -> None:
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    written = r'b"kept\n"' if kept != "sys.stdout" else r'"kept\n"'
    text = f"""
target Python {{ timeout: 0 ms }}
preamble {{=
  import io
  kept = {kept}
  sys.stdout = io.StringIO()
=}}
reactor Writer {{
  reaction(startup) {{= kept.write({written}) =}}
}}
{kind} reactor {{ a = new Writer() }}
"""
    outcome = bench.run(text, *options)
    assert (outcome.code, outcome.err) == (0, "")
    assert "kept" in outcome.out


def test_arrays_outlive_the_store_that_they_lie_in(launch: Any) -> None:
    outcome = launch(
        """
        target Python { timeout: 0 ms }
        preamble {=
          import numpy as np
          kept = []
          class Last:
              def __del__(self): print(sum(int(array.sum()) for array in kept))
          last = Last()
        =}
        reactor Camera { output out
          reaction(startup) -> out {=
            kept.append(np.full(100_000, 2))
            out.set(kept[0])
          =}
        }
        reactor Viewer { input inp  reaction(inp) {= kept.append(inp.value) =} }
        federated reactor { a = new Camera()  b = new Viewer()  a.out -> b.inp }
        """
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert sorted(outcome.out.splitlines()) == ["[a] 200000", "[b] 200000"]


PRINTS = """
target Python {{ timeout: 2 s }}
reactor Printer {{
  timer t(0, 1 ms)
  reaction(t) {{= {write} =}}
}}
{kind} reactor {{ a = new Printer() }}
"""

WRITES = ["print('here', flush=True)", "print('here' * 1000)"]


def to_output(bench: Bench, text: str, options: list[str], where: str) -> tuple[str, str]:
    """Run a program with its standard output led elsewhere; its exit code and its errors."""
    (bench.folder / "Main.lf").write_text(text)
    hprm = Path(sys.executable).with_name("hprm")
    command = f"{hprm} run {' '.join(options)} Main.lf {where}; echo ${{PIPESTATUS[0]}}"
    shell = ["bash", "-c", command]
    done = subprocess.run(
        shell, cwd=bench.folder, capture_output=True, text=True, timeout=60, check=False
    )
    return done.stdout.splitlines()[-1], done.stderr


@pytest.mark.parametrize("write", WRITES)
@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_a_reader_that_goes_ends_the_program_without_a_word(
    bench: Bench, kind: str, options: list[str], write: str
) -> None:
    text = PRINTS.format(kind=kind, write=write)
    assert to_output(bench, text, options, "| head -c 1 >/dev/null") == ("141", "")


@pytest.mark.parametrize("write", [*WRITES, "print('here')"])
@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_an_output_that_cannot_be_written_is_one_error(
    bench: Bench, kind: str, options: list[str], write: str
) -> None:
    text = PRINTS.format(kind=kind, write=write).replace("2 s", "0 ms")
    code, err = to_output(bench, text, options, ">/dev/full")
    assert (code, err.count("error:")) == ("1", 1), err
    assert "No space left on device" in err


@pytest.mark.parametrize(("kind", "options"), WAYS[1:])
def test_a_federation_whose_output_cannot_be_written_stops_in_order(
    bench: Bench, kind: str, options: list[str]
) -> None:
    """Not by force, however long it would have run, and its shutdown reactions run."""
    text = PRINTS.format(kind=kind, write="print('here', flush=True)")
    shutdown = "reaction(shutdown) {= open('stopped', 'w').close() =}\n}"
    text = text.replace("timeout: 2 s", "timeout: 1 min").replace("\n}", f"\n  {shutdown}", 1)
    code, err = to_output(bench, text, options, ">/dev/full")
    assert (code, err) == (
        "1",
        "error: cannot write to the standard output: No space left on device\n",
    )
    assert (bench.folder / "stopped").exists()


@pytest.mark.parametrize(("kind", "options"), WAYS)
def test_a_closed_output_is_no_failure(bench: Bench, kind: str, options: list[str]) -> None:
    text = PRINTS.format(kind=kind, write="print('here', flush=True)").replace("2 s", "10 ms")
    assert to_output(bench, text, options, ">&-") == ("0", "")


def test_a_help_that_cannot_be_written_is_an_error() -> None:
    hprm = Path(sys.executable).with_name("hprm")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [hprm, "--help"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 1
    assert done.stderr == "error: cannot write to the standard output: No space left on device\n"
