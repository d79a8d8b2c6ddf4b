"""Runs a program of rclpy after the start of its federation, so that its messages have no tags.

    hprm ros run ros2_late.py talker.py + ros2_late.py listener.py

What a thread declares that holds no tag, when the federation has begun, goes over physical
connections, and its timers begin when the clock says: as in ROS 2, the order of messages is that in
which they come.
"""

import contextlib
import runpy
import sys
import threading

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor


def run_program() -> None:
    """Run the script that the command line names."""
    sys.argv.pop(0)
    runpy.run_path(sys.argv[0], run_name="__main__")


rclpy.init()
early = SingleThreadedExecutor()
early.add_node(rclpy.create_node("early"))
early.spin_once(timeout_sec=0.01)
# The program initializes `rclpy` itself.
rclpy.init = lambda *_, **__: None
program = threading.Thread(target=run_program)
program.start()
# This thread holds the first tag until it blocks in `rclpy`.
with contextlib.suppress(ExternalShutdownException):
    early.spin()
program.join()
