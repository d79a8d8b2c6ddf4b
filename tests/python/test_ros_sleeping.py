"""Callbacks that call ``time.sleep``: logical time passes, for others and for them."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, Outcome, finish

SLEEPS = """
from time import monotonic, sleep
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64


class Sleeps(Node):
    def __init__(self):
        super().__init__("sleeps")
        self.publisher = self.create_publisher(Int64, "count", 10)
        self.create_timer(0.1, self.tick)

    def tick(self):
        begun = monotonic()
        self.publisher.publish(Int64(data=1))
        sleep(SECONDS)
        self.publisher.publish(Int64(data=2))
        print(self.get_clock().now().nanoseconds, monotonic() - begun >= SECONDS, flush=True)
        raise SystemExit


rclpy.init()
rclpy.spin(Sleeps())
"""

HEARS = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64


class Hears(Node):
    def __init__(self):
        super().__init__("hears")
        self.create_subscription(Int64, "count", self.hear, 10)

    def hear(self, message):
        print(message.data, "at", self.get_clock().now().nanoseconds, flush=True)
        if message.data == 2:
            raise SystemExit


rclpy.init()
rclpy.spin(Hears())
"""


@pytest.fixture
def run(bench: Bench, tmp_path: Path):
    """Run scripts as one federation whose clocks begin with 0."""

    def start(*options: str, **scripts: str) -> Outcome:
        for name, text in scripts.items():
            (tmp_path / f"{name}.py").write_text(text)
        words = " + ".join(f"{it}.py" for it in scripts).split()
        return finish(bench.call("ros", "run", "--start-time", "0", *options, *words))

    return start


@pytest.mark.parametrize("is_fast", [False, True])
def test_a_callback_that_sleeps_goes_on_at_a_later_tag(run, is_fast: bool) -> None:
    seconds, options = (1000, ("--fast", "true")) if is_fast else (0.2, ())
    sleeps = SLEEPS.replace("SECONDS", str(seconds))
    outcome = run(*options, sleeps=sleeps, hears=HEARS)
    assert outcome.code == 0, outcome.err
    later = 100_000_000 + round(seconds * 1e9)
    # In physical time it sleeps for as long, unless logical time does not wait for that.
    assert sorted(outcome.out.splitlines()) == [
        "[hears-2] 1 at 100000000",
        f"[hears-2] 2 at {later}",
        f"[sleeps-1] {later} {not is_fast}",
    ]


BOTH = """
import time
import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node


class Server(Node):
    def __init__(self):
        super().__init__("server")
        self.server = ActionServer(
            self, Fibonacci, "fibonacci", self.execute,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )

    def execute(self, goal):
        feedback = Fibonacci.Feedback(sequence=[0, 1])
        for _ in range(goal.request.order):
            if goal.is_cancel_requested:
                goal.canceled()
                return Fibonacci.Result(sequence=feedback.sequence)
            feedback.sequence.append(sum(feedback.sequence[-2:]))
            goal.publish_feedback(feedback)
            time.sleep(1.0)
        goal.succeed()
        return Fibonacci.Result(sequence=feedback.sequence)


class Client(Node):
    def __init__(self):
        super().__init__("client")
        self.client = ActionClient(self, Fibonacci, "fibonacci")
        future = self.client.send_goal_async(Fibonacci.Goal(order=5), feedback_callback=self.hear)
        future.add_done_callback(self.accepted)

    def seconds(self):
        return self.get_clock().now().nanoseconds // 1_000_000_000

    def hear(self, message):
        print(self.seconds(), list(message.feedback.sequence), flush=True)

    def accepted(self, future):
        future.result().get_result_async().add_done_callback(self.ended)
        self.timer = self.create_timer(2.5, self.cancel)
        self.goal = future.result()

    def cancel(self):
        self.timer.cancel()
        self.goal.cancel_goal_async()

    def ended(self, future):
        print(self.seconds(), "status", future.result().status, flush=True)
        rclpy.shutdown()


rclpy.init()
executor = MultiThreadedExecutor()
for node in (Server(), Client()):
    executor.add_node(node)
executor.spin()
"""


def test_feedback_and_cancelling_reach_a_goal_whose_callback_sleeps(run) -> None:
    outcome = run("--fast", "true", both=BOTH)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines() == [
        "0 [0, 1, 1]",
        "1 [0, 1, 1, 2]",
        "2 [0, 1, 1, 2, 3]",
        "3 status 5",
    ]


LOCKED = """
import threading, time
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

rclpy.init()
node = Node("locked")
lock, group = threading.Lock(), ReentrantCallbackGroup()


def sleeps():
    first.cancel()
    with lock:
        time.sleep(1.0)
        print("slept", flush=True)


def waits():
    second.cancel()
    with lock:
        print("has the lock", flush=True)
    raise SystemExit


first = node.create_timer(0.1, sleeps, group)
second = node.create_timer(0.5, waits, group)
rclpy.spin(node, executor=MultiThreadedExecutor())
"""


def test_a_callback_that_waits_for_the_lock_of_one_that_sleeps_gets_it(run) -> None:
    outcome = run(locked=LOCKED)
    assert (outcome.code, outcome.out) == (0, "slept\nhas the lock\n"), outcome.err
    said = "callback of this script has not come back to rclpy for 2 s, so logical time goes on"
    assert f"warning: {said}" in outcome.err
    # Where it waits.
    assert ", in waits\n    with lock:\n" in outcome.err
