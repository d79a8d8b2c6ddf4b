"""Stubs of rclpy and of messages: what type checkers find in programs with them."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import rclpy
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from my_robot.msg import Wheel
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.timer import Timers  # error
from sensor_msgs.msg import BatteryState, Image
from std_msgs.msg import Strings  # error
from std_msgs.msg import String
from tf2_ros import Buffer, TransformListener


class Robot(Node):
    def __init__(self) -> None:
        super().__init__("robot")
        self.publisher = self.create_publisher(String, "names", QoSProfile(depth=1))
        self.create_subscription(Image, "image", self.hear, 10)
        self.create_subscription(Image, "image", self.hear)  # error
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.server = ActionServer(self, Fibonacci, "fibonacci", self.execute)

    def hear(self, image: Image) -> None:
        seconds: int = image.header.stamp.sec
        print(seconds, image.data, BatteryState.POWER_SUPPLY_STATUS_FULL)
        self.publisher.publish(String(data=image.header.frame_id))
        self.publisher.publish(String(dat="x"))  # error
        moved = TransformStamped()
        moved.transform.translation.x = 1.0
        moved.transform.translation.x = "far"  # error
        moved.transform.translation.u = 1.0  # error
        asked = AddTwoInts.Request(a=1)
        print(asked.b, Wheel(speed=1.0).parts[0].header.frame_id)
        print(asked.sum)  # error
        told = AddTwoInts.Event(request=[asked])
        print(told.info.sequence_number, told.request[0].a, told.response[0].sum)
        print(told.response[0].a)  # error

    def execute(self, goal: ServerGoalHandle) -> Fibonacci.Result:
        goal.publish_feedback(Fibonacci.Feedback())
        return Fibonacci.Result(order=3)  # error


rclpy.init()
rclpy.spin(Robot())
rclpy.spun(Robot())  # error
"""


def test_checkers_find_mistakes_in_programs_of_rclpy(tmp_path: Path) -> None:
    (tmp_path / "robot.py").write_text(PROGRAM)
    definitions = tmp_path / "my_robot" / "msg"
    definitions.mkdir(parents=True)
    (definitions / "Wheel.msg").write_text("float64 speed\nsensor_msgs/Image[] parts\n")
    (tmp_path / "pyrightconfig.json").write_text(
        json.dumps({"typeCheckingMode": "strict", "include": ["robot.py"]})
    )
    words = [sys.executable, "-m", "hprm.ros", "stubs", "typings", "robot.py"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == f"{len(list(tmp_path.rglob('*.pyi')))} stubs in typings\n"
    pyright = shutil.which("pyright", path=str(Path(sys.executable).parent))
    assert pyright is not None, "requirements-dev.txt has it"
    checked = subprocess.run(
        [pyright, "--pythonpath", sys.executable, "--outputjson"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    found = json.loads(checked.stdout)["generalDiagnostics"]
    wrong = {it["range"]["start"]["line"] for it in found if it["severity"] == "error"}
    lines = PROGRAM.splitlines()
    assert wrong == {it for it, line in enumerate(lines) if line.endswith("# error")}, found
