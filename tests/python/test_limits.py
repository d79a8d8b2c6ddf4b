"""Limits of the process (`ulimit`): programs run within them, or one error says which is low."""

from __future__ import annotations

import os
import subprocess
import sys
from bisect import bisect_left
from functools import cache
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench

PROGRAM = """\
target Python { timeout: 20 ms }
preamble {=
import numpy as np
=}
reactor Source {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(np.ones(20_000)) =}
}
reactor Sink { input inp  reaction(inp) {= print(inp.value.sum()) =} }
federated reactor { source = new Source()  sink = new Sink()  source.out -> sink.inp }
"""

ALL = "[sink] 20000.0\n" * 3

RING = """\
target Python { timeout: 20 ms }
reactor Node {
  input inp  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(1) =}
  reaction(inp) {= pass =}
}
federated reactor { first = new Node()  other = new[15] Node()
  first.out, other.out -> other.inp, first.inp after 10 ms }
"""

MESH = """\
target Python { timeout: 20 ms }
reactor Node {
  preamble {= import resource =}
  input[4] inp  output[4] out
  reaction(startup) {= print(self.resource.getrlimit(self.resource.RLIMIT_NOFILE)[0]) =}
}
federated reactor { nodes = new[4] Node()  nodes.out -> interleaved(nodes.inp) after 10 ms }
"""


def run(
    folder: Path, limit: str, coordination: str, *options: str, program: str = PROGRAM
) -> subprocess.CompletedProcess[str]:
    """Run the program within a limit, as a shell sets it."""
    (folder / "Main.lf").write_text(program)
    hprm = Path(sys.executable).with_name("hprm")
    options = (f"--property coordination={coordination}", *options)
    command = f"ulimit {limit} && exec {hprm} run {' '.join(options)} Main.lf"
    shell = ["bash", "-c", command]
    return subprocess.run(
        shell, cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_without_files_of_that_length_messages_take_sockets(
    tmp_path: Path, coordination: str
) -> None:
    done = run(tmp_path, "-f 100", coordination)
    assert (done.returncode, done.stdout) == (0, ALL), done.stderr
    assert done.stderr.count("warning") == 1
    assert "bytes of shared memory (ftruncate: File too large" in done.stderr
    assert "ulimit -f limits how long a file may be" in done.stderr
    assert "free memory" not in done.stderr


def test_a_stack_that_is_too_small_is_said(tmp_path: Path) -> None:
    done = run(tmp_path, "-s 64", "centralized")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        "error: the stack may have only 64 KiB, and needs 128 at least\n"
        "  hint: raise the limit: ulimit -s 8192\n"
    )


def test_a_low_limit_of_the_stack_is_raised_where_that_is_allowed(tmp_path: Path) -> None:
    done = run(tmp_path, "-S -s 64", "centralized")
    assert (done.returncode, done.stdout) == (0, ALL), done.stderr


def test_a_low_limit_of_open_files_is_raised_where_that_is_allowed(tmp_path: Path) -> None:
    done = run(tmp_path, "-S -n 12", "centralized")
    assert (done.returncode, done.stdout, done.stderr) == (0, ALL, "")


@pytest.mark.parametrize("files", [8, 12, 16, 18, 20, 25, 26])
@pytest.mark.parametrize(
    ("coordination", "options"),
    [*((it, []) for it in COORDINATIONS), ("centralized", ["--in-process"])],
)
def test_too_few_descriptors_are_said_once_or_suffice(
    tmp_path: Path, coordination: str, options: list[str], files: int
) -> None:
    done = run(tmp_path, f"-n {files}", coordination, *options)
    if done.returncode == 0:
        assert (done.stdout, done.stderr) == (ALL, "")
        return
    assert done.stderr.count("error:") == 1, done.stderr
    assert "too many open files" in done.stderr
    assert "ulimit -n" in done.stderr


@pytest.mark.parametrize("limit", ["-S -n 256", "-n 256"])
def test_federates_that_all_read_the_boards_of_all_need_no_more_descriptors_than_there_may_be(
    tmp_path: Path, limit: str
) -> None:
    done = run(tmp_path, limit, "centralized", program=RING)
    assert (done.returncode, done.stderr) == (0, "")


def test_federates_that_are_started_by_hand_raise_the_limit_of_open_files(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text(MESH)
    federation = bench.federation()
    federation.start("rti")
    for node in range(4):
        federation.start(f"nodes__{node}", limit="-S -n 20")
    outcomes = federation.finish().items()
    files = {name: outcome.out for name, outcome in outcomes if name != "rti"}
    assert {name: outcome.err for name, outcome in outcomes if outcome.code} == {}
    assert set(files.values()) == {"38\n"}


@cache
def least_memory() -> int:
    """How many KiB of addresses the command needs to begin at all: it is larger with assertions."""
    hprm = Path(sys.executable).with_name("hprm")

    def begins(memory: int) -> bool:
        shell = ["bash", "-c", f"ulimit -v {memory} && exec {hprm} --version"]
        return subprocess.run(shell, capture_output=True, check=False).returncode == 0

    enough = range(0, 1_000_000, 1_000)
    return enough[bisect_left(enough, True, key=begins)]


@pytest.mark.parametrize(
    ("options", "more"),
    [
        *((["--in-process"], more) for more in (5_000, 20_000, 40_000, 80_000)),
        *(([], more) for more in (20_000, 40_000, 80_000)),
    ],
)
def test_too_little_memory_shows_no_code_of_hprm(
    tmp_path: Path, options: list[str], more: int
) -> None:
    done = run(tmp_path, f"-v {least_memory() + more}", "centralized", *options)
    # Rust and the C library abort in a thread that finds no memory for some bytes.
    aborts = "memory allocation of", "out of memory", "cannot allocate memory"
    told = aborts if done.returncode != 1 else ("error: ",)
    assert done.returncode != 0 and any(it in done.stderr for it in told), done.stderr
    assert "/hprm/_" not in done.stderr.replace("/hprm/_hprm.", ""), done.stderr


NO_THREADS = os.environ | {"RUST_MIN_STACK": str(1 << 47)}
"""No memory is large enough for the stack of a thread, so the system refuses threads."""


@pytest.mark.parametrize(
    "command", ["check", "run", "run --in-process", "verify", "rti --listen @"]
)
def test_threads_that_the_system_refuses_are_one_error(tmp_path: Path, command: str) -> None:
    (tmp_path / "Main.lf").write_text(PROGRAM)
    hprm = Path(sys.executable).with_name("hprm")
    listen = command.replace("@", f"unix:{tmp_path}/rti")
    done = subprocess.run(
        [hprm, *listen.split(), "Main.lf"],
        cwd=tmp_path,
        env=NO_THREADS,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if command == "check":
        assert (done.returncode, done.stderr) == (0, "")
        return
    assert done.returncode == 1, done.stderr
    assert done.stderr.startswith("error: "), done.stderr
    assert "Resource temporarily unavailable" in done.stderr
    assert "panicked" not in done.stderr and "Traceback" not in done.stderr


def test_seeds_need_no_threads() -> None:
    hprm = Path(sys.executable).with_name("hprm")
    outputs = [
        subprocess.run(
            [hprm, "sim", "--seeds", "1200"],
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        ).stdout
        for environment in (NO_THREADS, None)
    ]
    assert outputs[0] == outputs[1]
