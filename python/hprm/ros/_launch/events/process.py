"""Events of processes, as in ``launch.events.process``: what functions of handlers are told."""

from __future__ import annotations

from typing import Any

from hprm.ros._launch.events import Event


class RunningProcessEvent(Event):
    """Something that happens with a process.

    Parameters
    ----------
    action
        The action that has started it.
    name
        The name before the lines that it prints, such as ``talker-1``.
    cmd
        The words of its command.
    cwd
        The folder in which it runs; none if that is the one of the launch.
    env
        What its environment has beyond that of the launch.
    pid
        Its number.

    """

    name = "launch.events.process.RunningProcessEvent"

    def __init__(
        self,
        *,
        action: Any,
        name: str,
        cmd: list[str],
        cwd: str | None,
        env: dict[str, str] | None,
        pid: int,
    ) -> None:
        """Take what is known of the process."""
        self.action = self.execute_process_action = action
        self.process_name = name
        self.cmd, self.cwd, self.env, self.pid = cmd, cwd, env, pid


class ProcessStarted(RunningProcessEvent):
    """It has started."""

    name = "launch.events.process.ProcessStarted"


class ProcessExited(RunningProcessEvent):
    """It has ended, with an exit code, or by a signal, whose number is negative then."""

    name = "launch.events.process.ProcessExited"

    def __init__(self, *, returncode: int, **facts: Any) -> None:
        """Take how it has ended."""
        super().__init__(**facts)
        self.returncode = returncode


class ProcessIO(RunningProcessEvent):
    """It has printed a line, which ends with its line break."""

    name = "launch.events.process.ProcessIO"

    def __init__(self, *, text: bytes, fd: int, **facts: Any) -> None:
        """Take the line; ``fd`` is 1 for the standard output and 2 for the standard error."""
        super().__init__(**facts)
        self.text = text
        self.from_stdin, self.from_stdout, self.from_stderr = fd == 0, fd == 1, fd == 2
