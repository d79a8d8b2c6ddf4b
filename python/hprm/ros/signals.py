"""Which signals shut contexts down, as ``rclpy.signals``."""

from __future__ import annotations

from enum import IntFlag


class SignalHandlerOptions(IntFlag):
    """Which signals shut contexts down."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3
