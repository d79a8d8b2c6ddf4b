"""Events of liveliness: publishers come and go, or do not assert in time that they are alive."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

HEAD = """\
import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile
from std_msgs.msg import Int64

MANUAL = QoSProfile(
    depth=1,
    liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    liveliness_lease_duration=Duration(seconds=0.2),
)
rclpy.init()

def at(node, seconds, act):
    def once():
        timer.cancel()
        act()
    timer = node.create_timer(seconds, once)

def elapsed(node):
    # The federation begins when the node spins.
    return round((node.get_clock().now() - node.begin).nanoseconds / 1e6)
"""

TALKER = """
node = Node("talker")

def lost(event):
    print("lost", event.total_count, event.total_count_change, "at", elapsed(node), flush=True)

def begin():
    node.begin = node.get_clock().now()
    publisher.publish(Int64(data=1))

publisher = node.create_publisher(
    Int64, "beat", MANUAL, event_callbacks=PublisherEventCallbacks(liveliness=lost)
)
node.create_publisher(Int64, "beat", 1)
at(node, 0.1, begin)
at(node, 0.2, publisher.assert_liveliness)
at(node, 0.6, publisher.assert_liveliness)
at(node, 0.7, lambda: node.destroy_publisher(publisher))
at(node, 1.1, rclpy.shutdown)
"""

EAR = """
node = Node("ear")

def changed(event):
    print(*vars(event).values(), flush=True)

node.create_subscription(
    Int64, "beat", lambda _: None, 1, event_callbacks=SubscriptionEventCallbacks(liveliness=changed)
)
at(node, 1.2, rclpy.shutdown)
"""

SPIN = """
while rclpy.ok():
    rclpy.spin_once(node)
"""

LOST = ["lost 1 1 at 300", "lost 2 1 at 700"]
CHANGES = ["2 0 2 0", "1 1 -1 1", "2 0 1 -1", "1 0 -1 0"]


def test_a_publisher_that_does_not_assert_in_time_is_not_alive(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "talker.py").write_text(HEAD + TALKER + SPIN)
    (tmp_path / "ear.py").write_text(HEAD + EAR + SPIN)
    outcome = finish(bench.call("ros", "run", "talker.py", "+", "ear.py"))
    assert (outcome.code, outcome.err) == (0, "")
    lines = outcome.out.splitlines()
    assert [it for it in lines if "talker" in it] == [f"[talker-1] {LOST[0]}"]
    assert [it for it in lines if "ear" in it] == [f"[ear-2] {it}" for it in CHANGES]


@pytest.mark.parametrize("is_fast", ["true", "false"])
def test_so_it_is_within_a_script(bench: Bench, tmp_path: Path, is_fast: str) -> None:
    both = TALKER.replace("at(node, 0.7", "at(node, 0.9") + EAR.replace("node", "other")
    spin = """
executor = rclpy.executors.SingleThreadedExecutor()
executor.add_node(node)
executor.add_node(other)
while rclpy.ok():
    executor.spin_once()
"""
    (tmp_path / "one.py").write_text(HEAD + both + spin)
    outcome = finish(bench.call("ros", "run", "--fast", is_fast, "one.py"))
    assert (outcome.code, outcome.err) == (0, "")
    lines = outcome.out.splitlines()
    assert [it for it in lines if "lost" in it] == LOST
    changes = [*CHANGES[:3], "1 1 -1 1", "1 0 0 -1"]
    assert [it for it in lines if "lost" not in it] == changes
