r"""Writing messages of the log: one line each, on the standard error.

The environment configures it as in ROS 2: ``RCUTILS_CONSOLE_OUTPUT_FORMAT`` is the form of a line
(``{severity}``, ``{time}``, ``{name}``, ``{message}``, ``{function_name}``, ``{file_name}``,
``{line_number}``, ``{date_time_with_ms}``, ``{time_as_nanoseconds}``, and ``\n``, ``\t``, ``\x1b``
and others as in C), ``RCUTILS_COLORIZED_OUTPUT`` (``0`` or ``1``) overrides that only a terminal
gets colors, ``RCUTILS_LOGGING_USE_STDOUT=1`` asks for the standard output.

Which messages are written, loggers decide; what time it is, the function that the runtime sets.
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import NamedTuple, TextIO

from hprm.ros.impl.logging_severity import LoggingSeverity

_FORMAT = "[{severity}] [{time}] [{name}]: {message}"
_SECOND = 1_000_000_000
_NORMAL = "\033[0m"
_COLORS = {
    LoggingSeverity.DEBUG: "\033[32m",
    LoggingSeverity.INFO: _NORMAL,
    LoggingSeverity.WARN: "\033[33m",
    LoggingSeverity.ERROR: "\033[31m",
    LoggingSeverity.FATAL: "\033[31m",
}
_ESCAPES = {"a": "\a", "b": "\b", "n": "\n", "r": "\r", "t": "\t", "x1b": "\x1b"}


class LogRecord(NamedTuple):
    """A message of the log, and where it came from."""

    #: Nanoseconds since the epoch.
    time: int
    severity: LoggingSeverity
    #: The name of the logger.
    name: str
    message: str
    file: str
    function: str
    line: int


_TOKENS: dict[str, Callable[[LogRecord], str]] = {
    "severity": lambda record: record.severity.name,
    "name": lambda record: record.name,
    "message": lambda record: record.message,
    "function_name": lambda record: record.function,
    "file_name": lambda record: record.file,
    "line_number": lambda record: str(record.line),
    "time": lambda record: f"{record.time // _SECOND:010}.{record.time % _SECOND:09}",
    "time_as_nanoseconds": lambda record: f"{record.time:019}",
    "date_time_with_ms": lambda record: _date(record.time),
}
_PIECES = re.compile(r"\{(" + "|".join(_TOKENS) + r")\}")


def _date(nanoseconds: int) -> str:
    seconds, rest = divmod(nanoseconds, _SECOND)
    return f"{datetime.fromtimestamp(seconds):%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03}"


class Console:
    """The form of lines, and the stream that they are written to."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        """Read what the environment configures."""
        form = environment.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or _FORMAT
        form = re.sub(r"\\(x1b|[abnrt])", lambda found: _ESCAPES[found[1]], form)
        # Texts and names of tokens, alternating.
        self._pieces = _PIECES.split(form)
        self._color = _flag(environment, "RCUTILS_COLORIZED_OUTPUT")
        self._stdout = bool(_flag(environment, "RCUTILS_LOGGING_USE_STDOUT"))

    def line(self, record: LogRecord, *, colored: bool = False) -> str:
        """Return the line of a message, without its end."""
        line = "".join(
            _TOKENS[piece](record) if odd % 2 else piece for odd, piece in enumerate(self._pieces)
        )
        return f"{_COLORS.get(record.severity, '')}{line}{_NORMAL}" if colored else line

    def write(self, record: LogRecord) -> None:
        """Write a message. A stream that is closed or broken is no reason to end the program."""
        stream: TextIO | None = sys.stdout if self._stdout else sys.stderr
        if stream is None:
            return
        with contextlib.suppress(OSError, ValueError):
            colored = stream.isatty() if self._color is None else self._color
            # One call for the whole line: lines of several processes do not mix.
            stream.write(self.line(record, colored=colored) + "\n")
            stream.flush()


def _flag(environment: Mapping[str, str], name: str) -> bool | None:
    value = environment.get(name, "")
    if value in ("", "0", "1"):
        return value == "1" if value else None
    raise ValueError(f"{name} is {value!r}: it must be 0 or 1")


class Output:
    """Where the loggers of a process send their messages."""

    def __init__(self) -> None:
        """Begin with the console and the time of the system."""
        self._console: Console | None = None
        self._now: Callable[[], int] = time.time_ns
        #: Whether messages are written to the console.
        self.to_console = True
        #: Functions that get all messages, too.
        self.listeners: list[Callable[[LogRecord], None]] = []

    def set_time_source(self, now: Callable[[], int] | None) -> None:
        """Take the time of messages from a function; ``None`` is the time of the system."""
        self._now = time.time_ns if now is None else now

    def now(self) -> int:
        """Return the time that a message has now, in nanoseconds since the epoch."""
        return self._now()

    def reset(self) -> None:
        """Read the environment again at the next message."""
        self._console = None

    def emit(self, record: LogRecord) -> None:
        """Write a message, and tell the listeners."""
        if self.to_console:
            if self._console is None:
                self._console = Console(os.environ)
            self._console.write(record)
        for listener in self.listeners:
            listener(record)


#: The output of this process.
output = Output()
