"""A camera, a filter of its images, and a program that looks at them."""

from launch import LaunchDescription
from launch.actions import Shutdown
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription(
        [
            Node(package="ros2_port", executable="camera.py"),
            Node(package="ros2_port", executable="brighten.py"),
            Node(package="ros2_port", executable="spot.py", on_exit=Shutdown()),
        ]
    )
