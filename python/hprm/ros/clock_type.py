"""The kinds of clocks, as in ``rclpy.clock.ClockType``."""

from enum import IntEnum


class ClockType(IntEnum):
    """What a clock measures; times of different kinds are not comparable."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3
