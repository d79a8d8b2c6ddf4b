"""The name of ``rclpy.event_handler`` before Iron."""

from hprm.ros.event_handler import *  # noqa: F403
