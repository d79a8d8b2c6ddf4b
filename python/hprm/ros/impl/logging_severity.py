"""How serious a message of the log is."""

from enum import IntEnum


class LoggingSeverity(IntEnum):
    """How serious a message is; a logger writes those from its own level on."""

    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50
