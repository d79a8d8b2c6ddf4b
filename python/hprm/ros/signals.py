"""Which signals shut contexts down, as ``rclpy.signals``."""

from __future__ import annotations

import signal
from enum import IntFlag

from hprm.ros import _process


class SignalHandlerOptions(IntFlag):
    """Which signals shut contexts down."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3

    def __str__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


_NUMBERS = {
    SignalHandlerOptions.SIGINT: signal.SIGINT,
    SignalHandlerOptions.SIGTERM: signal.SIGTERM,
}


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Let these signals shut contexts down, and others not."""
    _process.handle_signals(*(number for flag, number in _NUMBERS.items() if flag in options))


def uninstall_signal_handlers() -> None:
    """Let no signal shut contexts down."""
    install_signal_handlers(SignalHandlerOptions.NO)


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """Return which signals shut contexts down."""
    handled, found = _process.handled_signals(), SignalHandlerOptions.NO
    for flag, number in _NUMBERS.items():
        if number in handled:
            found |= flag
    return found
