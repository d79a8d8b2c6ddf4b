"""What several test modules need: running a program in an interpreter of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import interpreters
import pytest
from processes import Bench, names_in_shared_memory, stores, until

# Most processes of the tests import NumPy, and none needs the threads that its BLAS would start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

collect_ignore = interpreters.left_out()


def pytest_itemcollected(item: pytest.Item) -> None:
    """Leave out what cannot pass on this interpreter."""
    interpreters.skip(item)


@dataclass(frozen=True)
class Outcome:
    """How a program ended, and what it wrote."""

    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


def runner(command: list[str], tmp_path: Path) -> Run:
    """A function that runs the text of a program, with other files beside it."""

    def run(text: str, *arguments: str, **files: str) -> Outcome:
        path = tmp_path / "Program.lf"
        path.write_text(textwrap.dedent(text))
        for name, content in files.items():
            (tmp_path / name.replace("_dot_", ".")).write_text(textwrap.dedent(content))
        done = subprocess.run(
            [*command, path.name, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Runs a program in one process."""
    return runner([sys.executable, "-m", "hprm", "run"], tmp_path)


@pytest.fixture
def launch(tmp_path: Path) -> Run:
    """Runs a program by the command, which gives each federate a process."""
    return runner([str(Path(sys.executable).with_name("hprm")), "run"], tmp_path)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """A place to run programs in, which nothing may survive."""
    shared = names_in_shared_memory()
    held = stores()
    bench = Bench(tmp_path)
    yield bench
    try:
        until(lambda: not bench.left(), "no process is left")
        until(lambda: names_in_shared_memory() <= shared, "no shared memory is left")
        until(lambda: stores() <= held, "no object store is left")
    finally:
        for pid in bench.left():
            os.kill(pid, signal.SIGKILL)
        for process in bench.started:
            process.communicate()


Spawn = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def spawn(tmp_path: Path) -> Iterator[Spawn]:
    """Starts commands; whatever becomes of them, they do not outlive the test."""
    started = []

    def run(*command: str, **environment: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            command,
            cwd=tmp_path,
            env=os.environ | environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield run
    for process in started:
        process.kill()
        process.communicate()
