"""What nodes learn of others: events of publishers and subscriptions, and who is there."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

HEAD = """\
import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

rclpy.init()
"""

ALONE = """
class Alone(Node):
    def __init__(self):
        super().__init__("alone")
        self.publisher = self.create_publisher(
            String, "news", 10, event_callbacks=PublisherEventCallbacks(matched=self.told)
        )
        self.others = [self.create_subscription(String, "news", print, 10)]
        self.step = 0
        self.create_timer(0.1, self.tick)

    def told(self, it):
        print(it.current_count, it.current_count_change, it.total_count, it.total_count_change)

    def tick(self):
        self.step += 1
        if self.step == 1:
            self.others.append(self.create_subscription(String, "news", print, 10))
        elif self.step == 2:
            self.destroy_subscription(self.others.pop(0))
            print("has", self.publisher.get_subscription_count())
        else:
            raise SystemExit


rclpy.spin(Alone())
"""

DEADLINE = """
class Late(Node):
    def __init__(self):
        super().__init__("late")
        qos = QoSProfile(depth=10, deadline=Duration(seconds=0.25))
        self.publisher = self.create_publisher(
            String, "news", qos, event_callbacks=PublisherEventCallbacks(deadline=self.offered)
        )
        self.create_subscription(
            String, "news", lambda it: None, qos,
            event_callbacks=SubscriptionEventCallbacks(deadline=self.missed),
        )
        self.count = 0
        self.timer = self.create_timer(0.1, self.tick)

    def tick(self):
        self.count += 1
        if self.count == 1:
            self.begin = self.get_clock().now()
        self.publisher.publish(String(data="x"))
        if self.count == 3:
            self.timer.cancel()

    def offered(self, it):
        self.tell("offered", it)

    def missed(self, it):
        self.tell("requested", it)
        if it.total_count == 2:
            raise SystemExit

    def tell(self, what, it):
        passed = (self.get_clock().now() - self.begin).nanoseconds // 1_000_000
        print(what, it.total_count, it.total_count_change, "at", passed)


rclpy.spin(Late())
"""

LOST = """
node = Node("slow")
publisher = node.create_publisher(String, "news", 10)
node.create_subscription(
    String, "news", lambda it: print("heard", it.data), 2,
    event_callbacks=SubscriptionEventCallbacks(
        message_lost=lambda it: print("lost", it.total_count, it.total_count_change)
    ),
)


def tick():
    for it in range(5):
        publisher.publish(String(data=str(it)))


timer = node.create_timer(0.1, tick)
for _ in range(6):
    rclpy.spin_once(node)
    timer.cancel()
"""


@pytest.fixture
def run(bench: Bench, tmp_path: Path):
    """Run a script, and return the lines it prints."""

    def start(text: str, *options: str) -> list[str]:
        (tmp_path / "one.py").write_text(HEAD + text)
        outcome = finish(bench.call("ros", "run", *options, "one.py"))
        assert outcome.code == 0, outcome.err
        return outcome.out.splitlines()

    return start


def test_a_publisher_is_told_of_subscriptions_that_come_and_go(run) -> None:
    assert run(ALONE, "--fast", "true") == ["1 1 1 1", "2 1 2 1", "has 1", "1 -1 2 0"]


def test_deadlines_that_are_missed_are_told_at_logical_times(run) -> None:
    told = run(DEADLINE, "--fast", "true")
    # What was asked for at one tag is told in the order in which it was made.
    assert sorted(told) == sorted(
        f"{what} {number} 1 at {200 + 250 * number}"
        for number in (1, 2)
        for what in ("offered", "requested")
    )


def test_what_a_queue_drops_is_told(run) -> None:
    told = run(LOST, "--fast", "true")
    assert [it for it in told if "heard" in it] == ["heard 3", "heard 4"]
    assert [it for it in told if "lost" in it] == ["lost 1 1", "lost 2 1", "lost 3 1"]


WATCHED = """
import sys

node = Node("watched", namespace="robot")
node.create_subscription(String, "/news", print, QoSProfile(depth=3))
publisher = node.create_publisher(String, "other", 10)
count = 0


def tick():
    global count
    count += 1
    if count == 2:
        node.destroy_publisher(publisher)
    if count == 4:
        raise SystemExit


node.create_timer(0.1, tick)
rclpy.spin(node)
"""

WATCHES = """
class Watches(Node):
    def __init__(self):
        super().__init__("watches")
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        told = PublisherEventCallbacks(matched=lambda it: print("matched", it.current_count))
        self.create_publisher(String, "news", qos, event_callbacks=told)
        gone = SubscriptionEventCallbacks(matched=lambda it: print("publishers", it.current_count))
        self.create_subscription(String, "robot/other", print, 1, event_callbacks=gone)
        self.create_timer(0.05, self.look)
        self.looks = 0

    def look(self):
        self.looks += 1
        if self.looks == 1:
            (one,) = self.get_subscriptions_info_by_topic("news")
            print(one.node_name, one.node_namespace, one.topic_type, one.qos_profile.depth)
            (own,) = self.get_publishers_info_by_topic("news")
            print(own.endpoint_type.name, own.qos_profile.durability.name)
            print(str(own).splitlines()[0])
            print(self.get_subscriber_names_and_types_by_node("watched", "/robot"))
            try:
                self.get_publisher_names_and_types_by_node("nobody", "/")
            except rclpy.exceptions.NodeNameNonExistentError as error:
                print(error)
        if self.looks == 5:
            raise SystemExit


rclpy.spin(Watches())
"""


def test_nodes_of_other_processes_are_known_and_that_something_is_gone(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "watched.py").write_text(HEAD + WATCHED)
    (tmp_path / "watches.py").write_text(HEAD + WATCHES)
    outcome = finish(bench.call("ros", "run", "watched.py", "+", "watches.py"))
    assert outcome.code == 0, outcome.err
    told = [it.removeprefix("[watches-2] ") for it in outcome.out.splitlines()]
    assert told == [
        *("matched 1", "publishers 1"),
        "watched /robot std_msgs/msg/String 3",
        "PUBLISHER TRANSIENT_LOCAL",
        "Node name: watches",
        "[('/news', ['std_msgs/msg/String'])]",
        "cannot get the names of a node that is not there: /nobody",
        "publishers 0",
    ]


UNKNOWN = """
try:
    Node("one").create_publisher(
        String, "news", 1, event_callbacks=PublisherEventCallbacks(incompatible_qos=print)
    )
except rclpy.exceptions.UnsupportedEventTypeError as error:
    print(error)
try:
    Node("two").create_subscription(String, "news", print, 1, content_filter_options="data = 'x'")
except NotImplementedError as error:
    print(error)
for name in ("type_description_service", "experimental", "nothing"):
    try:
        __import__(f"rclpy.{name}")
    except ModuleNotFoundError as error:
        print(error)
"""


def test_what_is_left_out_says_so(run) -> None:
    first, second, *modules = run(
        UNKNOWN.replace("rclpy.exceptions.Uns", "rclpy.event_handler.Uns")
    )
    assert first.startswith("events of the kind 'incompatible_qos' are not supported by hprm.ros")
    assert second == "content filters are not supported by hprm.ros: filter in the callback"
    assert modules == [
        "hprm.ros has no rclpy.type_description_service: nodes do not serve the descriptions of"
        " their types",
        "  hint: the handbook page howto/rclpy says what there is not",
        "hprm.ros has no rclpy.experimental: there is one kind of loop for all executors",
        "  hint: the handbook page howto/rclpy says what there is not",
        "No module named 'rclpy.nothing'",
    ]
