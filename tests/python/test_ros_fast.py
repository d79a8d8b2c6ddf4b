"""Scripts whose logical time does not wait for the physical one."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

SIMULATOR = """
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("simulator")
publisher = node.create_publisher(Int64, "state", 10)
steady = Clock(clock_type=ClockType.STEADY_TIME)
count = 0


def take(message):
    passed = (steady.now() - begin).nanoseconds // 1_000_000_000
    print(message.data, passed, flush=True)
    if message.data == 1200:
        raise SystemExit


def step():
    global count, begin
    count += 1
    if count == 1:
        begin = steady.now()
    publisher.publish(Int64(data=count))


node.create_subscription(Int64, "command", take, 10)
node.create_timer(1.0, step)
rclpy.spin(node)
"""

ROBOT = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.publisher = None
        self.create_subscription(Int64, "state", self.hear, 10)

    def hear(self, message):
        # It is made after the start: what it publishes goes over the hub.
        if self.publisher is None:
            self.publisher = self.create_publisher(Int64, "command", 10)
        if message.data % 200 == 0:
            self.publisher.publish(message)
        if message.data == 1200:
            raise SystemExit


rclpy.init()
rclpy.spin(Robot())
"""

PRINTED = "".join(f"{it} {it - 1}\n" for it in range(200, 1201, 200))

LAUNCH = """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([Node(executable="simulator.py"), Node(executable="robot.py")])
"""

# Longer than a test may take.
MINUTES = """
import threading
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node

rclpy.init()
node = Node("minutes")
begin = node.get_clock().now()


def minutes():
    return (node.get_clock().now() - begin).nanoseconds // 60_000_000_000
"""

SPINS = """
node.create_timer(3600.0, lambda: print("an hour"))
rclpy.spin_once(node)
node.get_clock().sleep_for(Duration(seconds=3600))
future = rclpy.Future()
rclpy.spin_until_future_complete(node, future, timeout_sec=3000)
print(minutes() >= 170)
rclpy.shutdown()
"""

POLLS = """
count = 0
while minutes() < 10:
    rclpy.spin_once(node, timeout_sec=0.5)
print("polled for", minutes(), "minutes")
for _ in range(10):
    rclpy.spin_once(node, timeout_sec=0)
rclpy.shutdown()
"""

THREADS = """
thread = threading.Thread(target=lambda: rclpy.spin(node), daemon=True)
thread.start()
rate = node.create_rate(1)
for _ in range(300):
    rate.sleep()
print(minutes())
rclpy.shutdown()
"""


@pytest.fixture
def simulation(tmp_path: Path) -> None:
    (tmp_path / "simulator.py").write_text(SIMULATOR)
    (tmp_path / "robot.py").write_text(ROBOT)
    (tmp_path / "a.launch.py").write_text(LAUNCH)


@pytest.mark.usefixtures("simulation")
@pytest.mark.parametrize(
    ("words", "label"),
    [
        (["ros", "run", "--fast", "true", "simulator.py", "+", "robot.py"], "[simulator-1] "),
        (["ros", "run", "-f", "true", "robot.py", "+", "simulator.py"], "[simulator-2] "),
        (["launch", "--fast", "true", "a.launch.py"], "[simulator.py-1] "),
    ],
    ids=["run", "the other order", "launch"],
)
def test_twenty_minutes_pass_in_seconds_and_the_same_each_time(
    bench: Bench, words: list[str], label: str
) -> None:
    outcome = finish(bench.call(*words))
    assert (outcome.code, outcome.out.replace(label, "")) == (0, PRINTED), outcome.err


@pytest.mark.usefixtures("simulation")
@pytest.mark.parametrize(
    "words", [["ros", "run", "--zenoh", "robot.py"], ["launch", "--zenoh", "a.launch.py"]]
)
def test_a_bridge_has_no_logical_time_of_its_own(bench: Bench, words: list[str]) -> None:
    words[-1:-1] = ["--fast", "true"]
    outcome = finish(bench.call(*words))
    assert (outcome.code, outcome.out) == (1, "")
    outcome.assert_one_error("--fast does not go together with --zenoh")


@pytest.mark.parametrize(
    ("script", "printed"),
    [
        (SPINS, "an hour\nan hour\nTrue\n"),
        (POLLS, "polled for 10 minutes\n"),
        (THREADS, "5\n"),
    ],
    ids=["spinning", "polling", "threads"],
)
def test_what_blocks_in_rclpy_does_not_wait(
    bench: Bench, tmp_path: Path, script: str, printed: str
) -> None:
    (tmp_path / "script.py").write_text(MINUTES + script)
    outcome = finish(bench.call("ros", "run", "--fast", "true", "script.py"))
    assert (outcome.code, outcome.out) == (0, printed), outcome.err


PHYSICAL = """
import time
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("physical")
publisher = node.create_publisher(Int64, "numbers", 10)
for number in range(3):
    publisher.publish(Int64(data=number))
    time.sleep(0.3)
"""

TAKES = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("takes")
ticks = 0


def tick():
    global ticks
    ticks += 1


def take(message):
    print(message.data, ticks < 200, flush=True)
    if message.data == 2:
        raise SystemExit


node.create_timer(0.01, tick)
node.create_subscription(Int64, "numbers", take, 10)
rclpy.spin(node)
"""


def test_time_is_not_quicker_while_a_script_runs_outside_of_rclpy(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "physical.py").write_text(PHYSICAL)
    (tmp_path / "takes.py").write_text(TAKES)
    outcome = finish(bench.call("ros", "run", "--fast", "true", "takes.py", "+", "physical.py"))
    assert outcome.code == 0, outcome.err
    assert outcome.out == "[takes-1] 0 True\n[takes-1] 1 True\n[takes-1] 2 True\n"


IDLE = """
import os
import signal
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("idle")
publisher = node.create_publisher(Int64, "numbers", 10)
# A Ctrl-C, when there has been nothing to do for a while.
signal.signal(signal.SIGALRM, lambda number, frame: os.kill(os.getpid(), signal.SIGINT))
signal.setitimer(signal.ITIMER_REAL, 0.5)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    publisher.publish(Int64(data=7))
"""

HEARS = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64


def take(message):
    print(message.data, flush=True)
    raise SystemExit


rclpy.init()
node = Node("hears")
node.create_subscription(Int64, "numbers", take, 10)
rclpy.spin(node)
"""


@pytest.mark.parametrize("count", [1, 2])
def test_scripts_in_which_nothing_happens_end_in_order(
    bench: Bench, tmp_path: Path, count: int
) -> None:
    (tmp_path / "idle.py").write_text(IDLE)
    words = " + ".join(["idle.py"] * count).split()
    outcome = finish(bench.call("ros", "run", "--fast", "true", *words))
    assert (outcome.code, outcome.err) == (0, "")


def test_what_a_script_publishes_when_it_is_interrupted_arrives(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "idle.py").write_text(IDLE)
    (tmp_path / "hears.py").write_text(HEARS)
    words = ["--fast", "true", "idle.py", "+", "hears.py"]
    outcome = finish(bench.call("ros", "run", *words))
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out == "[hears-2] 7\n"
