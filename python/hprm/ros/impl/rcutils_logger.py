"""Loggers: which messages are written, and how often, as in ``rclpy.impl.rcutils_logger``."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from types import CodeType, FrameType
from typing import Any

from hprm.ros._log_console import LogRecord, output
from hprm.ros._log_levels import SEPARATOR, levels
from hprm.ros.impl.logging_severity import LoggingSeverity

# The filters in the order in which they are asked, with their parameters; the first one of each is
# required.
_FILTERS = {
    "throttle": ("throttle_duration_sec", "throttle_time_source_type"),
    "skip_first": ("skip_first",),
    "once": ("once",),
}
_PARAMETERS = [parameter for parameters in _FILTERS.values() for parameter in parameters]


@dataclass
class _CallSite:
    """One place in a program that logs: what it asked for at first, and what has happened since."""

    name: str
    severity: LoggingSeverity
    filters: list[str]
    parameters: dict[str, Any]
    #: When a message was last written, for ``throttle``.
    last: int = 0
    first_skipped: bool = False
    written_once: bool = False

    def may_write(self) -> bool:
        """Ask the filters, in order, until one refuses."""
        return all(getattr(self, f"_{name}")() for name in self.filters)

    def _throttle(self) -> bool:
        clock = self.parameters["throttle_time_source_type"]
        now = output.now() if clock is None else clock.now().nanoseconds
        if now < self.last + self.parameters["throttle_duration_sec"] * 1e9:
            return False
        self.last = now
        return True

    def _skip_first(self) -> bool:
        skipped, self.first_skipped = self.first_skipped, True
        return skipped

    def _once(self) -> bool:
        written, self.written_once = self.written_once, True
        return not written

    def compare(self, name: str, severity: LoggingSeverity, filters: list[str]) -> None:
        """Raise ``ValueError`` if a later call from the same place asks for something else."""
        if severity != self.severity:
            raise ValueError("Logger severity cannot be changed between calls.")
        if name != self.name:
            raise ValueError("Logger name cannot be changed between calls.")
        if filters != self.filters:
            raise ValueError("Requested logging filters cannot be changed between calls.")


def _requested(options: dict[str, Any]) -> list[str]:
    """Return the filters that a call asks for; raise ``TypeError`` for options that are none."""
    for option in options:
        if option not in _PARAMETERS:
            raise TypeError(
                f'parameter "{option}" is not one of the recognized logging options "{_PARAMETERS}"'
            )
    requested = [
        name
        for name, parameters in _FILTERS.items()
        if any(options.get(parameter) for parameter in parameters)
    ]
    for name in requested:
        required = _FILTERS[name][0]
        if required not in options:
            raise TypeError(
                f'required parameter "{required}" not specified '
                f'but is required for the the logging filter "{name}"'
            )
    return requested


def _parameters(filters: list[str], options: dict[str, Any]) -> dict[str, Any]:
    parameters = {name: options.get(name) for kind in filters for name in _FILTERS[kind]}
    clock = parameters.get("throttle_time_source_type")
    if clock is not None and not callable(getattr(clock, "now", None)):
        raise ValueError(f'Received throttle_time_source_type of "{clock}" is not a clock instance')
    return parameters


def _caller() -> FrameType:
    """Return the first frame outside of this module."""
    frame = sys._getframe(1)
    while frame.f_code.co_filename == __file__ and frame.f_back is not None:
        frame = frame.f_back
    return frame


class RcutilsLogger:
    """A logger with a name; dots in names make a tree, by which levels are inherited."""

    def __init__(self, name: str = "") -> None:
        """Name the logger; the empty name is the root."""
        self.name = name
        # A place in the program is a position in its code: two calls in one line are two places.
        self._sites: dict[tuple[CodeType, int], _CallSite] = {}

    def get_child(self, name: str) -> RcutilsLogger:
        """Return the logger with a name below this one."""
        if not name:
            raise ValueError("Child logger name must not be empty.")
        return RcutilsLogger(f"{self.name}{SEPARATOR}{name}" if self.name else name)

    def set_level(self, level: LoggingSeverity | int) -> None:
        """Write messages from this level on."""
        levels.set(self.name, level)

    def get_effective_level(self) -> LoggingSeverity:
        """Return the level from which on messages are written."""
        return levels.effective(self.name)

    def is_enabled_for(self, severity: LoggingSeverity | int) -> bool:
        """Return whether messages of this severity are written."""
        return LoggingSeverity(severity) >= levels.effective(self.name)

    def log(
        self,
        message: str,
        severity: LoggingSeverity | int,
        name: str | None = None,
        **kwargs: Any,
    ) -> bool:
        """Write a message, unless the level or a filter keeps it back.

        Parameters
        ----------
        message
            What is written.
        severity
            How serious it is.
        name
            The name of another logger to write it under.
        **kwargs
            Filters, each of which counts the calls from one place of the program: ``once=True``
            writes only the first message, ``skip_first=True`` all but that,
            ``throttle_duration_sec`` at most one in so many seconds, by the clock
            ``throttle_time_source_type``, or else by the time that messages have.

        Returns
        -------
        bool
            Whether the message was written.

        Raises
        ------
        TypeError
            If ``message`` is no text, or ``kwargs`` has options that do not exist.
        ValueError
            If a call from the same place has asked for something else before.

        """
        if not self.is_enabled_for(severity):
            return False
        if not isinstance(message, str):
            raise TypeError(f"a message of the log must be a str, not {type(message).__name__}")
        severity = LoggingSeverity(severity)
        frame = _caller()
        name = self.name if name is None else name
        if not self._site(frame, name, severity, kwargs).may_write():
            return False
        code = frame.f_code
        record = LogRecord(
            time=output.now(),
            severity=severity,
            name=name,
            message=message,
            file=code.co_filename,
            function=code.co_name,
            line=frame.f_lineno,
        )
        output.emit(record)
        return True

    def _site(
        self, frame: FrameType, name: str, severity: LoggingSeverity, options: dict[str, Any]
    ) -> _CallSite:
        filters = _requested(options) if options else []
        site = self._sites.get((frame.f_code, frame.f_lasti))
        if site is None:
            site = _CallSite(name, severity, filters, _parameters(filters, options))
            self._sites[frame.f_code, frame.f_lasti] = site
            return site
        site.compare(name, severity, filters)
        if filters and _parameters(filters, options) != site.parameters:
            raise ValueError("Logging filter parameters cannot be changed between calls.")
        return site

    def debug(self, message: str, **kwargs: Any) -> bool:
        """Write a message of severity ``DEBUG``; see ``log``."""
        return self.log(message, LoggingSeverity.DEBUG, **kwargs)

    def info(self, message: str, **kwargs: Any) -> bool:
        """Write a message of severity ``INFO``; see ``log``."""
        return self.log(message, LoggingSeverity.INFO, **kwargs)

    def warning(self, message: str, **kwargs: Any) -> bool:
        """Write a message of severity ``WARN``; see ``log``."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def warn(self, message: str, **kwargs: Any) -> bool:
        """Write a message of severity ``WARN``; see ``log``."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def error(self, message: str, **kwargs: Any) -> bool:
        """Write a message of severity ``ERROR``; see ``log``."""
        return self.log(message, LoggingSeverity.ERROR, **kwargs)

    def fatal(self, message: str, **kwargs: Any) -> bool:
        """Write a message of severity ``FATAL``; see ``log``."""
        return self.log(message, LoggingSeverity.FATAL, **kwargs)
