"""Timers that nothing spins for a while: they tick on at no cost, and stay on their periods."""

from __future__ import annotations

import pytest
from processes import Bench

HEAD = """\
import signal
import time
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.timer import TimerInfo

rclpy.init()
node = rclpy.create_node("one")
told = []


def note(info: TimerInfo):
    told.append(info)
"""


@pytest.fixture
def run(bench: Bench):
    """Run a script, and return the lines it prints."""
    return lambda text, *options: bench.ros_lines(HEAD + text, *options)


def test_the_end_waits_for_no_timer_that_nothing_spins(run) -> None:
    text = """
def interrupt(number, frame):
    raise KeyboardInterrupt


timer = node.create_timer(0.1, lambda: None)
signal.signal(signal.SIGALRM, interrupt)
signal.setitimer(signal.ITIMER_REAL, 0.25)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    # No thread holds a tag now, so logical time passes.
    timer.timer_period_ns = 1
while not timer.is_ready():
    time.sleep(0.01)
begun = time.monotonic()
rclpy.shutdown()
print(time.monotonic() - begun < 3)
"""
    assert run(text) == ["True"]


def test_a_call_that_waits_is_of_the_last_period_and_the_next_of_the_same_ones(run) -> None:
    text = """
period = 50_000_000
timer = node.create_timer(0.05, note)
while len(told) < 2:
    rclpy.spin_once(node)
time.sleep(0.28)
print(timer.is_ready(), 0 < timer.time_until_next_call() <= period)
while len(told) < 5:
    rclpy.spin_once(node)
    print(0 < timer.time_until_next_call() <= period)
due = [it.expected_call_time.nanoseconds for it in told]
print([(it - due[0]) % period for it in due])
print(due[1] - due[0] == period, due[2] - due[1] > period, due[3] > due[2])
actual = told[2].actual_call_time.nanoseconds
print(0 <= actual - due[2] < period)
"""
    assert run(text) == [
        "True True",
        *["True"] * 3,
        "[0, 0, 0, 0, 0]",
        "True True True",
        "True",
    ]


def test_a_timer_by_a_steady_clock_goes_on_after_a_pause(run) -> None:
    text = """
timer = node.create_timer(0.02, note, clock=Clock(clock_type=ClockType.STEADY_TIME))
rclpy.spin_once(node)
time.sleep(0.15)
print(timer.is_ready(), 0 < timer.time_until_next_call() <= 20_000_000)
while len(told) < 5:
    rclpy.spin_once(node)
print(all(it.expected_call_time <= it.actual_call_time for it in told))
"""
    assert run(text) == ["True True", "True"]


def test_a_timer_that_is_reset_while_a_call_waits_begins_a_period(run) -> None:
    text = """
timer = node.create_timer(0.02, note)
rclpy.spin_once(node)
time.sleep(0.15)
timer.reset()
print(timer.is_ready(), len(told))
timer.cancel()
rclpy.spin_once(node, timeout_sec=0.1)
print(timer.time_until_next_call(), len(told))
timer.timer_period_ns = 30_000_000
timer.reset()
while len(told) < 3:
    rclpy.spin_once(node)
print((told[2].expected_call_time - told[1].expected_call_time).nanoseconds)
"""
    assert run(text) == ["False 1", "None 1", "30000000"]


def test_a_fast_script_has_tags_at_each_period(run) -> None:
    text = """
other = rclpy.create_node("other")
node.create_timer(0.1, note)
seen = []
other.create_timer(1.0, lambda: seen.append(1))
while len(seen) < 3:
    rclpy.spin_once(other)
rclpy.spin_once(node)
late = told[0].actual_call_time - told[0].expected_call_time
print(0 <= late.nanoseconds < 100_000_000)
"""
    assert run(text, "--fast", "true") == ["True"]
