"""Two cameras and a lidar with periods of their own, and their fusion."""

from launch import LaunchDescription
from launch.actions import Shutdown
from launch_ros.actions import Node


def sensor(name, period, count):
    return Node(
        package="ros2_port",
        executable="sensor.py",
        name=name,
        parameters=[{"period": period, "count": count}],
        remappings=[("measured", name)],
    )


def generate_launch_description():
    fusion = Node(package="ros2_port", executable="fusion.py", on_exit=Shutdown())
    cameras = [sensor(name, 0.033, 18) for name in ("left", "right")]
    return LaunchDescription([*cameras, sensor("lidar", 0.1, 6), fusion])
