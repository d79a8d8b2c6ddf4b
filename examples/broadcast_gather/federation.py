"""Runs one of the two federations with `hprm run` and hands back what it measured.

It knows the command, the environment and the files of `measurement.py`; it prints nothing.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from measurement import PROGRESS_PREFIX, client_file

HERE = Path(__file__).resolve().parent
PROGRAMS = {
    "centralized": HERE / "BroadcastGatherCentralized.lf",
    "decentralized": HERE / "BroadcastGatherDecentralized.lf",
}
CLIENTS = 4

_OUTPUT_KEPT = 40
_GRACE_S = 10


class FederationError(Exception):
    """The federation did not end well; the message says how, with its last lines of output."""


def command() -> Path:
    """The `hprm` that belongs to the running Python."""
    hprm = Path(sys.executable).parent / "hprm"
    if not hprm.exists():
        raise FederationError(f"{hprm} does not exist\n  hint: run `make build`")
    return hprm


def run(
    coordination: str,
    sizes_mb: Sequence[int] = (),
    rounds: int | None = None,
    on_progress: Callable[[float], None] = lambda fraction: None,
    timeout_s: float = 120,
    in_process: bool = False,
) -> dict[str, Any]:
    """Runs the program of this coordination to its end and returns its results.

    Federates are processes, or threads of one. Without sizes or rounds the program's own apply. The
    results are those of the server, with those of the clients in a list under ``clients``.
    ``on_progress`` is told the fraction done.
    """
    with tempfile.TemporaryDirectory(prefix="broadcast-gather-") as directory:
        out = Path(directory) / "server.json"
        environment = os.environ | {
            "BROADCAST_GATHER_OUT": str(out),
            "BROADCAST_GATHER_PROGRESS": "1",
            "BROADCAST_GATHER_SIZES": ",".join(str(size) for size in sizes_mb),
            "BROADCAST_GATHER_ROUNDS": str(rounds) if rounds else "",
        }
        words = [*(["--in-process"] if in_process else []), str(PROGRAMS[coordination])]
        _run_program(words, environment, on_progress, timeout_s)
        return _read_results(coordination, out)


def _run_program(
    words: list[str],
    environment: dict[str, str],
    on_progress: Callable[[float], None],
    timeout_s: float,
) -> None:
    process = subprocess.Popen(
        [str(command()), "run", *words],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    timed_out = threading.Event()

    def give_up() -> None:
        timed_out.set()
        _stop(process)

    timer = threading.Timer(timeout_s, give_up)
    timer.start()
    try:
        last_lines = _follow(process, on_progress)
        code = process.wait()
    finally:
        timer.cancel()
        _stop(process)
    if timed_out.is_set():
        raise _failure(words, f"did not end within {timeout_s:.0f} s", last_lines)
    if code != 0:
        raise _failure(words, f"ended with exit code {code}", last_lines)


def _follow(process: subprocess.Popen[str], on_progress: Callable[[float], None]) -> list[str]:
    """Reads the output to its end, reports progress, and returns the last of the other lines."""
    assert process.stdout is not None, "the output is a pipe"
    last_lines: deque[str] = deque(maxlen=_OUTPUT_KEPT)
    with process.stdout as output:
        for line in output:
            text = line.rstrip().removeprefix("[server] ")
            if not text.startswith(PROGRESS_PREFIX):
                last_lines.append(line.rstrip())
                continue
            done, total = text.removeprefix(PROGRESS_PREFIX).split()
            on_progress(int(done) / int(total))
    return list(last_lines)


def _stop(process: subprocess.Popen[str]) -> None:
    """Ends a process that still runs: first as Ctrl-C would, then by force."""
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(_GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _failure(words: list[str], what: str, last_lines: list[str]) -> FederationError:
    return FederationError("\n".join([f"hprm run {' '.join(words)} {what}", *last_lines]))


def _read_results(coordination: str, out: Path) -> dict[str, Any]:
    try:
        results = json.loads(out.read_text())
        results["clients"] = [
            json.loads(client_file(out, index).read_text()) for index in range(CLIENTS)
        ]
    except FileNotFoundError as missing:
        raise FederationError(
            f"the {coordination} federation ended well but left no {missing.filename}"
        ) from missing
    if not results["complete"]:
        raise FederationError(f"the {coordination} federation stopped before its last round")
    return results
