"""A lamp, and a program that sets its parameters."""

from launch import LaunchDescription
from launch.actions import Shutdown
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription(
        [
            Node(package="ros2_port", executable="dimmer.py", on_exit=Shutdown()),
            Node(package="ros2_port", executable="dims.py"),
        ]
    )
