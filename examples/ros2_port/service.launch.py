"""A service and a client of it."""

from launch import LaunchDescription
from launch.actions import Shutdown
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription(
        [
            Node(package="ros2_port", executable="add_server.py"),
            Node(package="ros2_port", executable="add_client.py", on_exit=Shutdown()),
        ]
    )
