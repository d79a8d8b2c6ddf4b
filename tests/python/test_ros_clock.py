"""Nodes whose time a simulator tells, and the callbacks for its jumps."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

SIMULATOR = """
import rclpy
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

rclpy.init()
node = Node("simulator")
publisher = node.create_publisher(Clock, "/clock", 10)
# In tenths of seconds: it begins late, skips some, and is set back.
times = iter([20, 21, 22, 23, 24, 25, 30, 31, 32, 5, 6, 7, 8, 9, 10, 11, 12])


def tick():
    tenths = next(times, None)
    if tenths is None:
        raise SystemExit
    sec, rest = divmod(tenths, 10)
    publisher.publish(Clock(clock=Time(sec=sec, nanosec=rest * 100_000_000)))


node.create_timer(0.01, tick)
rclpy.spin(node)
"""

FOLLOWS = """
import rclpy
from rclpy.clock import Clock, ClockType, JumpThreshold, ROSClock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

rclpy.init()
node = Node("follows")
clock = node.get_clock()


def tenths():
    return clock.now().nanoseconds // 100_000_000


def tick():
    print("timer", tenths(), flush=True)


def jumped(jump):
    print("jump", jump.clock_change.name, jump.delta.nanoseconds // 100_000_000, tenths())


threshold = JumpThreshold(
    min_forward=Duration(seconds=0.3), min_backward=Duration(seconds=-0.1), on_clock_change=True
)
handle = clock.create_jump_callback(
    threshold, pre_callback=lambda: print("before", tenths()), post_callback=jumped
)
made = Clock(clock_type=ClockType.ROS_TIME)
print(clock.ros_time_is_active, tenths(), isinstance(made, ROSClock))
node.create_timer(0.2, tick)
node.create_timer(0.2, lambda: print("system"), clock=Clock()).cancel()
while rclpy.ok() and tenths() != 11:
    rclpy.spin_once(node)
handle.unregister()
rclpy.shutdown()
"""


SHOWN = [
    "True 0 True",
    "before 0",
    "jump ROS_TIME_NO_CHANGE 20 20",
    "timer 20",
    "timer 22",
    "timer 24",
    "before 25",
    "jump ROS_TIME_NO_CHANGE 5 30",
    # Once for two periods.
    "timer 30",
    "timer 32",
    "before 32",
    "jump ROS_TIME_NO_CHANGE -27 5",
    # A whole period after it was set back.
    "timer 7",
    "timer 9",
    "timer 11",
]


@pytest.mark.parametrize(
    "order", [("simulator", "follows"), ("follows", "simulator")], ids=["first", "last"]
)
def test_timers_and_jumps_follow_the_clock_of_a_simulator(
    bench: Bench, tmp_path: Path, order: tuple[str, str]
) -> None:
    (tmp_path / "simulator.py").write_text(SIMULATOR)
    (tmp_path / "follows.py").write_text(FOLLOWS)
    stated = {"follows": ["--ros-args", "-p", "use_sim_time:=true"], "simulator": []}
    words = [word for it in order for word in (f"{it}.py", *stated[it], "+")]
    outcome = finish(bench.call("ros", "run", *words[:-1]))
    assert outcome.code == 0, outcome.err
    label = f"[follows-{1 + order.index('follows')}] "
    assert outcome.out.replace(label, "").splitlines() == SHOWN


SLEEPS = """
import threading
import rclpy
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time

rclpy.init()
node = Node("sleeps", parameter_overrides=[Parameter("use_sim_time", value=True)])
clock = node.get_clock()
thread = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
thread.start()
rate = node.create_rate(5)


def tell(what):
    print(what, clock.now().nanoseconds // 100_000_000, flush=True)


tell(clock.sleep_until(Time(seconds=2.15, clock_type=clock.clock_type)))
tell(clock.sleep_for(Duration(seconds=0.1)))
rate.sleep()
tell("rate")
changes = JumpThreshold(min_forward=None, min_backward=None, on_clock_change=True)
clock.create_jump_callback(changes, post_callback=lambda it: print(it.clock_change.name))
node.create_timer(0.2, lambda: node.set_parameters([Parameter("use_sim_time", value=False)]))
print(clock.sleep_for(Duration(seconds=100)), clock.ros_time_is_active)
print(clock.now().nanoseconds > 1e18)
print(node.set_parameters([Parameter("use_sim_time", value=3)])[0].reason, flush=True)
rclpy.shutdown()
"""


def test_sleeps_and_rates_follow_the_clock_of_a_simulator(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "simulator.py").write_text(SIMULATOR)
    (tmp_path / "sleeps.py").write_text(SLEEPS)
    outcome = finish(bench.call("ros", "run", "sleeps.py", "+", "simulator.py"))
    assert outcome.code == 0, outcome.err
    assert outcome.out.replace("[sleeps-1] ", "").splitlines() == [
        "True 22",
        "True 23",
        "rate 24",
        "ROS_TIME_DEACTIVATED",
        "False False",
        "True",
        "Wrong parameter type, expected 'Type.BOOL' got 'Type.INTEGER'",
    ]


ALONE = """
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

rclpy.init()
node = Node("alone", parameter_overrides=[Parameter("use_sim_time", value=True)])
node.create_timer(0.01, lambda: print("never"))
rclpy.spin_once(node, timeout_sec=0.2)
print(node.get_clock().now().nanoseconds, flush=True)
rclpy.shutdown()
"""


def test_time_is_0_where_nothing_tells_it(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "alone.py").write_text(ALONE)
    outcome = finish(bench.call("ros", "run", "alone.py"))
    assert (outcome.code, outcome.out) == (0, "0\n"), outcome.err
    assert outcome.err == (
        "warning: the node /alone has use_sim_time, and no node publishes /clock yet, so its time"
        " is 0\n"
    )
