"""A driver with a lifecycle, and its manager."""

from launch import LaunchDescription
from launch.actions import Shutdown
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription(
        [
            Node(package="ros2_port", executable="driver.py"),
            Node(package="ros2_port", executable="manager.py", on_exit=Shutdown()),
        ]
    )
