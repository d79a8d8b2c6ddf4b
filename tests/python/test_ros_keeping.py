"""Publishers that are TRANSIENT_LOCAL keep messages for subscriptions that come later."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from processes import Bench, finish, hear

HEAD = """\
import sys
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import Int64

def kept(depth=3, **more):
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL, **more)

rclpy.init()
node = Node(sys.argv[1] if len(sys.argv) > 1 else "node")
begin = node.get_clock().now()

def at(seconds, act):
    def once():
        timer.cancel()
        act()
    timer = node.create_timer(seconds, once)

def end():
    raise SystemExit
"""

ONE = """
numbers = node.create_publisher(Int64, "numbers", kept())
volatile = node.create_publisher(Int64, "numbers", 3)
short = node.create_publisher(Int64, "numbers", kept(lifespan=Duration(seconds=0.2)))
gone = node.create_publisher(Int64, "numbers", kept())
count = 0

def tick():
    global count
    count += 1
    for publisher, sign in [(numbers, 1), (volatile, 10), (short, 100)]:
        publisher.publish(Int64(data=count * sign))

def hear(name):
    return lambda message: print(name, message.data)

def come():
    # What is published at this tag comes once, with what follows.
    numbers.publish(Int64(data=7))
    node.create_subscription(Int64, "numbers", hear("durable"), kept(10))
    node.create_subscription(Int64, "numbers", hear("two"), kept(2))
    node.create_subscription(Int64, "numbers", hear("volatile"), 10)

gone.publish(Int64(data=1000))
gone.destroy()
node.create_timer(0.1, tick)
at(0.45, come)
at(0.55, end)
try:
    rclpy.spin(node)
except SystemExit:
    pass
"""


@pytest.mark.parametrize("is_fast", [True, False])
def test_a_later_subscription_of_the_same_script_gets_what_is_kept(
    bench: Bench, tmp_path: Path, is_fast: bool
) -> None:
    (tmp_path / "one.py").write_text(HEAD + ONE)
    outcome = finish(bench.call("ros", "run", "--fast", str(is_fast).lower(), "one.py"))
    assert outcome.code == 0
    # The volatile publisher is not for the durable ones.
    assert outcome.err.count("incompatible QoS") == len(outcome.err.splitlines()) == 3
    lines = outcome.out.splitlines()
    heard = {
        name: [it.split()[1] for it in lines if it.startswith(name + " ")]
        for name in ("durable", "two", "volatile")
    }
    assert heard["durable"] == ["3", "300", "4", "400", "7", "5", "500"]
    assert heard["volatile"] == ["5", "50", "500"]
    assert heard["two"] == ["400", "7", "5", "500"]


TALKER = """
count = 0
publisher = None

def make():
    global publisher
    publisher = node.create_publisher(Int64, "numbers", kept(50))

def tick():
    global count
    if publisher is not None:
        count += 1
        publisher.publish(Int64(data=count))

make() if "late" not in sys.argv else at(0.01, make)
node.create_timer(0.02, tick)
at(30, end)
rclpy.spin(node)
"""

LISTENER = """
heard = []

def hear(message):
    heard.append(message.data)
    if len(heard) == 30:
        print(*heard, flush=True)
        raise SystemExit

def come():
    node.create_subscription(Int64, "numbers", hear, kept(100))

if "linked" in sys.argv:
    node.create_subscription(Int64, "numbers", lambda _: None, 10)
come() if "first" in sys.argv else at(0.3, come)
rclpy.spin(node)
"""


@pytest.mark.parametrize("how", ["linked", "apart", "late"])
def test_a_later_subscription_gets_what_another_script_has_kept_in_order_and_once(
    bench: Bench, tmp_path: Path, how: str
) -> None:
    (tmp_path / "talker.py").write_text(HEAD + TALKER)
    (tmp_path / "listener.py").write_text(HEAD + LISTENER)
    process = bench.call("ros", "run", "talker.py", "talker", how, "+", "listener.py", "ear", how)
    heard = hear(process.stdout, " 30\n")
    process.send_signal(signal.SIGINT)
    finish(process)
    assert heard == "[listener-2] " + " ".join(map(str, range(1, 31))) + "\n"


LAUNCH = """\
from launch import LaunchDescription
from launch.actions import TimerAction
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        Node(executable="talker.py", arguments=["talker", WORDS]),
        TimerAction(period=0.31, actions=[Node(executable="ear.py", arguments=["ear", "first"])]),
    ])
"""


@pytest.mark.parametrize("how", ["", "late"])
def test_a_node_that_is_started_later_gets_what_is_kept(
    bench: Bench, tmp_path: Path, how: str
) -> None:
    (tmp_path / "talker.py").write_text(HEAD + TALKER)
    (tmp_path / "ear.py").write_text(HEAD + LISTENER)
    (tmp_path / "a.launch.py").write_text(LAUNCH.replace("WORDS", repr(how)))
    process = bench.call("launch", "a.launch.py")
    heard = hear(process.stdout, " 30\n")
    process.send_signal(signal.SIGINT)
    finish(process)
    assert heard.splitlines()[-1].endswith("] " + " ".join(map(str, range(1, 31))))


BACK = """
from pathlib import Path
lives = Path("lives")
lives.write_text(lives.read_text() + "1" if lives.exists() else "1")

def hear(message):
    print("heard", message.data, "in life", len(lives.read_text()), flush=True)
    if len(lives.read_text()) == 1:
        raise SystemExit(1)

node.create_subscription(Int64, "numbers", hear, kept(1))
rclpy.spin(node)
"""

ONCE = """
publisher = node.create_publisher(Int64, "numbers", kept(1))
publisher.publish(Int64(data=42))
at(30, end)
rclpy.spin(node)
"""


def test_a_node_that_comes_back_gets_what_is_kept(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "once.py").write_text(HEAD + ONCE)
    (tmp_path / "back.py").write_text(HEAD + BACK)
    (tmp_path / "a.launch.py").write_text(
        "from launch import LaunchDescription\n"
        "from launch_ros.actions import Node\n"
        "def generate_launch_description():\n"
        "    return LaunchDescription([Node(executable='once.py'),\n"
        "        Node(executable='back.py', respawn=True)])\n"
    )
    process = bench.call("launch", "a.launch.py")
    heard = hear(process.stdout, "heard 42 in life 2\n")
    process.send_signal(signal.SIGINT)
    finish(process)
    assert heard.count("heard 42") == 2


MEETS = """
publisher = node.create_publisher(Int64, "map", kept(1))
publisher.publish(Int64(data=5))
rclpy.spin_once(node, timeout_sec=0.1)
print(wait_for_message(Int64, node, "map", qos_profile=kept(1), time_to_wait=1.0))
print(wait_for_message(Int64, node, "map", qos_profile=1, time_to_wait=0.1))
"""


def test_what_is_kept_is_there_for_one_that_waits_for_a_message(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "one.py").write_text(HEAD + MEETS)
    outcome = finish(bench.call("ros", "run", "one.py"))
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines() == ["(True, std_msgs.msg.Int64(data=5))", "(False, None)"]


ENDED = """
node.create_publisher(Int64, "numbers", kept())
at(0.1, end)
rclpy.spin(node)
"""

WAITS = """
publisher = node.create_publisher(Int64, "numbers", kept())


def make():
    global made
    made = node.get_clock().now()
    node.create_subscription(Int64, "numbers", take, kept(5))


def take(message):
    waited = node.get_clock().now() - made
    print(message.data, "after", waited.nanoseconds // 1_000_000, "ms", flush=True)


at(0.2, lambda: publisher.publish(Int64(data=1)))
at(0.3, make)
at(0.5, lambda: publisher.publish(Int64(data=2)))
at(0.9, lambda: publisher.publish(Int64(data=3)))
at(1.0, end)
rclpy.spin(node)
"""


def test_a_later_subscription_waits_half_a_second_for_a_script_that_does_not_answer(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "ended.py").write_text(HEAD + ENDED)
    (tmp_path / "waits.py").write_text(HEAD + WAITS)
    outcome = finish(bench.call("ros", "run", "--fast", "true", "ended.py", "+", "waits.py"))
    assert (outcome.code, outcome.err) == (0, "")
    # In logical time, so that is the same on every run.
    assert outcome.out.splitlines() == [
        "[waits-2] 1 after 500 ms",
        "[waits-2] 2 after 500 ms",
        "[waits-2] 3 after 600 ms",
    ]
