"""Processes that a coordinator runs: what is to run, and what each has told by now."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hprm import _hprm
from hprm.ros._graph import Endpoint
from hprm.ros._launch._plans import Respawn
from hprm.ros._meeting import COORDINATOR

#: Why no handler of a launch file starts a node with ``--fast``.
NO_NODES_IF_FAST = "with --fast, a handler starts no nodes: they would join at a time of the clock"


@dataclass(frozen=True)
class Plan:
    """A script that is to run."""

    name: str
    command: tuple[str, ...]
    environment: dict[str, str] = field(default_factory=dict)
    #: Whether it is a script of the federation, rather than another program beside it.
    is_member: bool = True
    #: Whether all others are asked to end when it has ended.
    is_required: bool = False
    folder: Path | None = None
    #: At which logical time after the start of the federation the script begins.
    delay_ns: int = 0
    #: Beside which file packages of messages are looked for.
    script: str | None = None
    #: How it is started again when it has ended.
    respawn: Respawn | None = None
    #: What is said when it has ended.
    farewell: tuple[str, ...] = ()
    #: Whether it reads what is typed: one process can.
    has_input: bool = False

    @classmethod
    def of_script(cls, path: str, arguments: Sequence[str], name: str | None = None) -> Plan:
        """Run a Python file, which may import ``rclpy``."""
        command = (sys.executable, "-m", "hprm.ros", "run", path, *arguments)
        return cls(name or Path(path).stem, command, script=path)


class Member:
    """A script that runs, or may run later."""

    def __init__(self, name: str, plan: Plan) -> None:
        """Start nothing yet."""
        self.name = name
        self.plan = plan
        #: As ``ros2 launch`` names it.
        self.label = plan.name
        self.is_started = False
        #: Whether the others go on without it: it comes back, or has started after them.
        self.is_transient = plan.respawn is not None
        #: How often it was started again.
        self.lives = 0
        #: How its process has ended, as ``subprocess`` has it, and the exit code that follows.
        self.ending: int | None = None
        self.code: int | None = 0
        self._tell_nothing()

    @property
    def is_member(self) -> bool:
        """Whether it is a script of the federation."""
        return self.plan.is_member

    @property
    def is_required(self) -> bool:
        """Whether all others are asked to end when it has ended."""
        return self.plan.is_required

    @property
    def delay_ns(self) -> int:
        """At which logical time the script begins."""
        return self.plan.delay_ns

    def begin(self, number: int) -> None:
        """Start its process for the first time, as the one with that number."""
        self.label = f"{self.plan.name}-{number}"
        self.start()
        self.is_started = True

    def _tell_nothing(self) -> None:
        self.nodes: list[str] = []
        self.endpoints: list[Endpoint] = []
        self.is_ready = False
        self.is_answered = False
        self.looks_for: Endpoint | None = None
        self.has_left = False
        #: Whether its federation has ended under it, because of another process.
        self.is_stranded = False

    def start(self) -> None:
        """Start its process, perhaps again."""
        plan = self.plan
        self._tell_nothing()
        self.connection, theirs = socket.socketpair()
        environment = os.environ | plan.environment | {COORDINATOR: str(theirs.fileno())}
        parent = os.getpid()
        with theirs:
            self.process = subprocess.Popen(
                plan.command,
                cwd=plan.folder,
                env=environment | {"PYTHONUNBUFFERED": "1"},
                stdin=None if plan.has_input else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                preexec_fn=lambda: _prepare(plan, parent),
            )
        self.ending = self.code = None
        self._rest = b""

    def may_respawn(self) -> bool:
        """Whether its process is started again when it has ended."""
        respawn = self.plan.respawn
        return respawn is not None and (respawn.retries < 0 or self.lives < respawn.retries)

    def read(self) -> bool:
        """Note what the script has told; return whether it may tell more."""
        try:
            came = self.connection.recv(1 << 16, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return True
        except OSError:
            came = b""
        *lines, self._rest = (self._rest + came).split(b"\n")
        for line in lines:
            self._note(json.loads(line))
        return bool(came)

    def _note(self, told: dict[str, Any]) -> None:
        if "node" in told:
            self.nodes.append(told["node"])
        if "endpoint" in told:
            self.endpoints.append(Endpoint(**told["endpoint"]))
        if "find" in told:
            self.looks_for = Endpoint(**told["find"])
        self.is_ready = self.is_ready or "ready" in told
        self.has_left = self.has_left or "leave" in told
        self.is_stranded = self.is_stranded or "stranded" in told

    def answer(self, answer: dict[str, Any]) -> None:
        """Tell the script something."""
        try:
            self.connection.sendall(json.dumps(answer).encode() + b"\n")
        except OSError:
            # It has ended, which is noticed elsewhere.
            return


def _prepare(plan: Plan, parent: int) -> None:
    """Prepare the process of a plan, in which this runs."""
    if plan.is_member:
        # It permits Ctrl-C when it can end of it without a traceback (`hprm._startup`).
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    # The coordinator forwards them, also where what has started it ignores them.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    # However the coordinator ends, none is left behind.
    _hprm.die_with_parent(parent)
