"""Transforms and message filters in running programs of rclpy, between processes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish

BROADCASTER = """
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tf2_ros import TransformBroadcaster
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.count = 0
        self.moving = TransformBroadcaster(self)
        StaticTransformBroadcaster(self).sendTransform(self.transform("robot", "camera", 0.5))
        self.create_timer(0.05, self.move)

    def transform(self, parent, child, x):
        result = TransformStamped()
        result.header.stamp = self.get_clock().now().to_msg()
        result.header.frame_id, result.child_frame_id = parent, child
        result.transform.translation.x, result.transform.rotation.w = x, 1.0
        return result

    def move(self):
        self.moving.sendTransform(self.transform("world", "robot", float(self.count)))
        self.count += 1
        if self.count == 12:
            raise SystemExit


rclpy.init()
rclpy.spin(Robot())
"""

LISTENER = """
import rclpy
from rclpy.node import Node
from tf2_ros import Buffer, TransformException, TransformListener


class Watcher(Node):
    def __init__(self):
        super().__init__("watcher")
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        first = self.buffer.wait_for_transform_async("world", "camera", rclpy.time.Time())
        first.add_done_callback(lambda done: self.tell("first", done.result()))
        self.count = 0
        self.create_timer(0.1, self.look)
        try:
            self.buffer.lookup_transform("world", "camera", rclpy.time.Time())
        except TransformException as error:
            self.get_logger().info(f"not yet: {type(error).__name__}")

    def tell(self, what, found):
        self.get_logger().info(f"{what}: {found.transform.translation.x}")

    def look(self):
        self.tell("at", self.buffer.lookup_transform("world", "camera", rclpy.time.Time()))
        self.count += 1
        if self.count == 4:
            raise SystemExit


rclpy.init()
rclpy.spin(Watcher())
"""

WAITER = """
import sys
import rclpy
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from tf2_ros import Buffer, TransformException, TransformListener


class Waiter(Node):
    def __init__(self):
        super().__init__("waiter")
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.create_timer(0.01, self.look)

    def look(self):
        begin = self.get_clock().now()
        try:
            found = self.buffer.lookup_transform(
                "world", "robot", rclpy.time.Time(), timeout=Duration(seconds=0.2)
            )
            told = found.transform.translation.x
        except TransformException as error:
            told = type(error).__name__
        waited = (self.get_clock().now() - begin).nanoseconds // 1000000
        self.get_logger().info(f"{told} after {waited} ms")
        raise SystemExit


rclpy.init()
executor = MultiThreadedExecutor() if sys.argv[1] == "many" else SingleThreadedExecutor()
executor.add_node(Waiter())
executor.spin()
"""

SENSOR = """
import random, sys
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import Imu


class Sensor(Node):
    def __init__(self, topic, milliseconds):
        super().__init__(topic)
        self.left = 1000 // milliseconds
        self.jitter = random.Random(milliseconds)
        self.publisher = self.create_publisher(Imu, topic, 10)
        self.create_timer(milliseconds / 1000, self.sample)

    def sample(self):
        self.left -= 1
        if self.left < 0:
            raise SystemExit
        late = Duration(nanoseconds=self.jitter.randrange(8_000_000))
        message = Imu()
        message.header.stamp = (self.get_clock().now() - late).to_msg()
        self.publisher.publish(message)


rclpy.init()
rclpy.spin(Sensor(sys.argv[1], int(sys.argv[2])))
"""

SYNCHRONIZER = """
import rclpy
from message_filters import ApproximateTimeSynchronizer, Subscriber
from rclpy.node import Node
from sensor_msgs.msg import Imu


class Fusion(Node):
    def __init__(self):
        super().__init__("fusion")
        inputs = [Subscriber(self, Imu, "fast"), Subscriber(self, Imu, "slow")]
        self.synchronizer = ApproximateTimeSynchronizer(inputs, 5, 0.02)
        self.synchronizer.registerCallback(self.both)
        self.create_timer(1.1, self.end)

    def both(self, fast, slow):
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in (fast, slow)]
        self.get_logger().info(f"apart: {stamps[1] - stamps[0]}")

    def end(self):
        raise SystemExit


rclpy.init()
rclpy.spin(Fusion())
"""


LAUNCH = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, LogInfo, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, PushRosNamespace


def generate_launch_description():
    x = LaunchConfiguration("x")
    words = ["--x", x, "--frame-id", "world", "--child-frame-id", "camera"]
    return LaunchDescription([
        DeclareLaunchArgument("x"),
        LogInfo(msg=["x is ", x]),
        Node(package="tf2_ros", executable="static_transform_publisher", arguments=words),
        GroupAction([
            PushRosNamespace("left"),
            Node(executable="listener.py", name="eye", on_exit=Shutdown()),
        ]),
    ])
"""


@pytest.fixture
def scripts(tmp_path: Path) -> None:
    texts = {
        "broadcaster": BROADCASTER,
        "listener": LISTENER,
        "sensor": SENSOR,
        "synchronizer": SYNCHRONIZER,
        "waiter": WAITER,
        "test.launch": LAUNCH,
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)


def run(bench: Bench, *words: str) -> Outcome:
    return finish(bench.call("ros", "run", *words))


def told(outcome: Outcome, script: str) -> list[str]:
    """What one script has logged, without levels, times and names."""
    lines = [line for line in outcome.err.splitlines() if f"[{script}" in line]
    return [re.sub(r"^.*\] \[\d+\.\d+\] \[[\w.]+\]: ", "", line) for line in lines]


@pytest.mark.usefixtures("scripts")
def test_transforms_reach_other_programs(bench: Bench) -> None:
    outcome = run(bench, "broadcaster.py", "+", "listener.py")
    # The robot moves every 50 ms, so the camera is where it was 50 ms ago.
    assert told(outcome, "listener") == [
        "not yet: LookupException",
        *("first: 0.5", "at: 0.5", "at: 2.5", "at: 4.5", "at: 6.5"),
    ], outcome


@pytest.mark.usefixtures("scripts")
@pytest.mark.parametrize(
    ("threads", "expected"),
    [("many", "0.0 after 40 ms"), ("one", "LookupException after 200 ms")],
)
def test_a_lookup_waits_in_logical_time(bench: Bench, threads: str, expected: str) -> None:
    outcome = run(bench, "broadcaster.py", "+", "waiter.py", threads)
    assert told(outcome, "waiter") == [expected], outcome


@pytest.mark.usefixtures("scripts")
def test_samples_of_two_sensors_are_matched_the_same_on_every_run(bench: Bench) -> None:
    words = ["sensor.py", "fast", "33", "+", "sensor.py", "slow", "100", "+", "synchronizer.py"]
    outcomes = [told(run(bench, *words), "synchronizer") for _ in range(2)]
    assert outcomes[0] == outcomes[1]
    *pairs, report = outcomes[0]
    apart = [int(pair.removeprefix("apart: ")) for pair in pairs]
    assert apart and all(abs(each) < 20_000_000 for each in apart)
    counts = re.fullmatch(
        r"messages without a match: (\d+) of (\d+) from fast, (\d+) of (\d+) from slow", report
    )
    assert counts is not None, report
    lost_fast, fast, lost_slow, slow = map(int, counts.groups())
    assert (fast - lost_fast, slow - lost_slow) == (len(pairs), len(pairs))
    assert (fast, slow) == (30, 10)


@pytest.mark.usefixtures("scripts")
def test_a_launch_file_starts_a_publisher_of_static_transforms(bench: Bench) -> None:
    outcome = finish(bench.call("launch", "test.launch.py", "x:=2.5"))
    assert outcome.code == 0, outcome
    assert "x is 2.5" in outcome.out
    assert told(outcome, "listener") == [
        "not yet: LookupException",
        *("first: 2.5", "at: 2.5", "at: 2.5", "at: 2.5", "at: 2.5"),
    ], outcome
    assert "[left.eye]" in outcome.err and "Traceback" not in outcome.err
