"""Running programs, several at a time, each with a limit to its time.

What a program writes is kept only to say why it failed; Lingua Franca compares exit codes alone.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from discover import PACKAGE, Program

LONGEST_REASON = 160

_PREFIX = r"(?:^|\n)(?:\[\S+\] )?"
_ERROR = re.compile(_PREFIX + r"((?:error|fatal)\b.*)", re.IGNORECASE)
_PLACE = re.compile(r"\n(?:\[\S+\])? *-->\s*(\S+)")
# A property that is known, of consequence, and not obeyed: what passes has passed without it.
_WITHOUT = re.compile(_PREFIX + r"warning\[LF0606\]: `([^`]+)`")
_CODE = re.compile(r"error\[(\w+)\]")


@dataclass(frozen=True)
class Job:
    """A program, and how it is to be run."""

    program: Program
    single_threaded: bool = False

    @property
    def label(self) -> str:
        """What to call it in a list."""
        return self.program.path + (" (single-threaded)" if self.single_threaded else "")


@dataclass(frozen=True)
class Result:
    """How a program ended; ``exit_code`` is None if its time was up.

    ``without`` are the target properties that the program states and that were not obeyed.
    """

    job: Job
    exit_code: int | None
    seconds: float
    reason: str = ""
    diagnostic: str = ""
    without: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether Lingua Franca would be content."""
        return self.exit_code == 0


class Runner:
    """Runs programs in a copy of their package, so that none writes into the checkout."""

    def __init__(self, checkout: Path, hprm: Path, timeout: float, options: list[str]) -> None:
        """Prepare to run programs of a checkout with a command ``hprm run`` and its options."""
        self._hprm = hprm
        self._options = options
        self._timeout = timeout
        self._scratch = tempfile.TemporaryDirectory(prefix="hprm-conformance-")
        self._root = Path(self._scratch.name, "Python")
        shutil.copytree(checkout / PACKAGE, self._root)
        self._lock = threading.Lock()
        self._running: set[int] = set()
        self._stopped = False

    def __enter__(self) -> Runner:
        """Do nothing more."""
        return self

    def __exit__(self, *_: object) -> None:
        """End what still runs, and remove the copy."""
        self._stop()
        self._scratch.cleanup()

    def run(self, jobs: Iterable[Job], workers: int, done: Callable[[Result], None]) -> None:
        """Run all jobs, and hand over each result as soon as there is one."""
        with ThreadPoolExecutor(workers) as pool:
            futures = [pool.submit(self.run_one, job) for job in jobs]
            try:
                for future in as_completed(futures):
                    done(future.result())
            except BaseException:
                # Those that wait find that there is nothing to do any more.
                self._stop()
                pool.shutdown(cancel_futures=True)
                raise

    def run_one(self, job: Job) -> Result:
        """Run one program to its end, or until its time is up."""
        command = [str(self._hprm), "run", *self._options]
        if job.single_threaded:
            command += ["--property", "single-threaded=true"]
        command.append(str(Path("src", job.program.path)))
        begin = time.monotonic()
        with tempfile.TemporaryFile() as output:
            code = self._wait(command, output.fileno())
            seconds = time.monotonic() - begin
            output.seek(0)
            text = output.read().decode(errors="replace")
        if code == 0:
            without = tuple(dict.fromkeys(_WITHOUT.findall(text)))
            return Result(job, 0, seconds, without=without)
        if code is None:
            return Result(job, None, seconds, f"still running after {self._timeout:g} s")
        reason, diagnostic = explain(text)
        return Result(job, code, seconds, reason or f"exit code {code}", diagnostic)

    def _wait(self, command: list[str], output: int) -> int | None:
        with self._lock:
            if self._stopped:
                return None
            process = subprocess.Popen(
                command,
                cwd=self._root,
                env=self._environment(),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            self._running.add(process.pid)
        try:
            return process.wait(self._timeout)
        except subprocess.TimeoutExpired:
            _kill(process.pid)
            process.wait()
            return None
        finally:
            with self._lock:
                self._running.discard(process.pid)

    def _environment(self) -> dict[str, str]:
        """The environment with ``hprm`` first, and with no way to change what is installed."""
        path = os.pathsep.join([str(self._hprm.parent), os.environ.get("PATH", os.defpath)])
        installed = str(Path(self._scratch.name, "installed"))
        return os.environ | {
            "PATH": path,
            "NO_COLOR": "1",
            # A preamble installs a package that lies beside it; `files` makes it importable.
            "PIP_NO_INDEX": "1",
            "PIP_TARGET": installed,
        }

    def _stop(self) -> None:
        with self._lock:
            self._stopped = True
            for leader in self._running:
                _kill(leader)


def explain(output: str) -> tuple[str, str]:
    """The first error line with its place, and the code of the diagnostic if it is one."""
    error = _ERROR.search(output)
    if error is None:
        lines = [line for line in output.splitlines() if line.strip()]
        return (_shortened(lines[-1]), "") if lines else ("", "")
    code = _CODE.match(error[1])
    place = _PLACE.match(output, error.end())
    where = f" ({Path(place[1]).name})" if place else ""
    return _shortened(error[1]) + where, code[1] if code else ""


def _shortened(line: str) -> str:
    line = line.strip()
    return line if len(line) <= LONGEST_REASON else line[: LONGEST_REASON - 1] + "…"


def _kill(leader: int) -> None:
    """End a process and all that it started; it has not been waited for, so the id is its own."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(leader, signal.SIGKILL)
