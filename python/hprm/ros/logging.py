"""Loggers by name and their levels, as in ``rclpy.logging``."""

from __future__ import annotations

import os
from pathlib import Path

from hprm.ros._log_console import output
from hprm.ros._log_levels import levels
from hprm.ros.impl.logging_severity import LoggingSeverity as LoggingSeverity
from hprm.ros.impl.rcutils_logger import RcutilsLogger

_root_logger = RcutilsLogger()


def get_logger(name: str) -> RcutilsLogger:
    """Return a logger with a name, in which dots separate levels of a tree."""
    if not name:
        raise ValueError("Logger name must not be empty.")
    return _root_logger.get_child(name)


def initialize() -> None:
    """Read the configuration from the environment again."""
    output.reset()


def shutdown() -> None:
    """Forget the levels of all loggers."""
    levels.clear()


def clear_config() -> None:
    """Forget the levels of all loggers, and read the environment again."""
    shutdown()
    initialize()


def set_logger_level(name: str, level: LoggingSeverity | int, detailed_error: bool = False) -> None:
    """Have a logger, and those below it, write messages from a level on.

    ``UNSET`` makes it inherit its level again. An invalid level raises ``ValueError`` in any case;
    ``detailed_error`` is there for programs that state it.
    """
    levels.set(name, level)


def get_logger_effective_level(name: str) -> LoggingSeverity:
    """Return the level from which on a logger writes messages."""
    return levels.effective(name)


def get_logger_level(name: str) -> LoggingSeverity:
    """Return the level that was set for this logger, ``UNSET`` if there is none."""
    return levels.own(name)


def get_logging_severity_from_string(log_severity: str) -> LoggingSeverity:
    """Return the severity with a name, in upper or lower case.

    Raises ``RuntimeError`` if there is none.
    """
    try:
        return LoggingSeverity[log_severity.upper()]
    except KeyError:
        names = ", ".join(LoggingSeverity.__members__)
        raise RuntimeError(f"{log_severity!r} is no severity: there are {names}") from None


def get_logging_directory() -> Path:
    """Return where logs are kept: ``ROS_LOG_DIR``, or ``log`` in ``ROS_HOME`` or ``~/.ros``."""
    if directory := os.environ.get("ROS_LOG_DIR"):
        return Path(directory).expanduser()
    home = os.environ.get("ROS_HOME") or "~/.ros"
    return Path(home).expanduser() / "log"
