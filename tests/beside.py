"""Runs a command, and another one beside it that takes only what the processors have left.

    python tests/beside.py OTHER... -- COMMAND...

What the other one prints is shown when both are done. If one of them fails, the other one is
stopped, as both are by Ctrl-C, with all that they have started. The exit code is that of the
failure.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from typing import NoReturn

PATIENCE = 20.0
"""Seconds that a command has to end in order when it is interrupted."""


class Part:
    """A command with its process group."""

    def __init__(self, command: list[str], output: int | None = None, idle: bool = False) -> None:
        """Start it; what is written goes to a file, or where ours goes."""
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            preexec_fn=lambda: begin(idle),
        )

    def stop(self) -> None:
        """Interrupt it, as a terminal does, and kill what does not end."""
        for number, patience in (signal.SIGINT, PATIENCE), (signal.SIGKILL, None):
            # The group is there as long as one of its processes is.
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, number)
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(patience)


def begin(idle: bool) -> None:
    """Lead a group of processes; that of the idle part runs when no other process wants to."""
    if not idle:
        os.setpgid(0, 0)
        return
    # Where this file is there, Linux shares processors among sessions first. This one then takes
    # 15 parts where others take 1024.
    os.setsid()
    with suppress(OSError), open("/proc/self/autogroup", "w") as share:
        share.write("19")
    os.nice(19)
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def stopped(number: int, _frame: object) -> NoReturn:
    """Leave by way of all that has to be done before."""
    # A second one does not keep us from that.
    for it in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(it, signal.SIG_IGN)
    sys.exit(128 + number)


def run(command: list[str], other: list[str]) -> int:
    """Run both, and return the exit code of the first that fails, or zero."""
    with tempfile.TemporaryFile() as told:
        running: list[Part] = []
        try:
            running.append(Part(other, told.fileno(), idle=True))
            running.append(Part(command))
            while running:
                time.sleep(0.1)
                for part in [it for it in running if it.process.poll() is not None]:
                    running.remove(part)
                    if part.process.returncode != 0:
                        print(f"error: {' '.join(part.process.args)} has failed", file=sys.stderr)
                        # What a signal has ended has a negative code.
                        return abs(part.process.returncode)
            return 0
        finally:
            for part in running:
                part.stop()
            told.seek(0)
            sys.stdout.buffer.write(told.read())
            sys.stdout.flush()


def main(words: list[str]) -> int:
    """Do what the command line says."""
    if "--" not in words[1:-1]:
        print(__doc__, file=sys.stderr)
        return 2
    at = words.index("--")
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stopped)
    return run(words[at + 1 :], words[:at])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
