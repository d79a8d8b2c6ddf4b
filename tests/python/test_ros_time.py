"""Durations, times and kinds of clocks of `hprm.ros`: the values and exceptions of rclpy."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hprm.ros._interfaces import interface
from hprm.ros.clock_type import ClockType
from hprm.ros.duration import Duration, Infinite
from hprm.ros.time import Time

LARGEST = 2**63 - 1


@dataclass
class Stamp:
    """A stand-in for the messages of `builtin_interfaces`."""

    sec: int = 0
    nanosec: int = 0


@pytest.fixture
def messages(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    module = ModuleType("builtin_interfaces.msg")
    module.Time = type("Time", (Stamp,), {})  # type: ignore[attr-defined]
    module.Duration = type("Duration", (Stamp,), {})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "builtin_interfaces", ModuleType("builtin_interfaces"))
    monkeypatch.setitem(sys.modules, "builtin_interfaces.msg", module)
    interface.cache_clear()
    yield module
    interface.cache_clear()


def test_a_duration_adds_up_seconds_and_nanoseconds() -> None:
    assert Duration(seconds=1.5, nanoseconds=2).nanoseconds == 1_500_000_002
    assert Duration(nanoseconds=2.9).nanoseconds == 2  # type: ignore[arg-type]
    assert Duration(seconds=-0.5).nanoseconds == -500_000_000
    assert repr(Duration(seconds=1)) == "Duration(nanoseconds=1000000000)"
    assert str(Duration(nanoseconds=5)) == "5 nanoseconds"
    assert str(Infinite) == "Infinite"


def test_a_duration_fits_into_64_bits() -> None:
    assert Duration(nanoseconds=LARGEST) == Infinite
    assert Duration(nanoseconds=-(2**63)) < Duration()
    for nanoseconds in (2**63, -(2**63) - 1):
        with pytest.raises(OverflowError, match="too large to store in C duration"):
            Duration(nanoseconds=nanoseconds)


def test_durations_are_compared_and_calculated() -> None:
    one, two = Duration(seconds=1), Duration(seconds=2)
    assert one < two <= two and two > one >= one and one != two
    assert one + one == two and two - one == one and one * 2 == two and two * 0.5 == one
    assert one * float("inf") == Infinite
    assert one != 1_000_000_000
    with pytest.raises(ValueError, match="Can't multiply duration with nan"):
        one * float("nan")
    with pytest.raises(TypeError):
        assert one < 2
    with pytest.raises(TypeError):
        one + 1  # type: ignore[operator]
    with pytest.raises(TypeError):
        one * "2"  # type: ignore[operator]
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)


@given(st.integers(-(2**31) * 10**9, (2**31 - 1) * 10**9))
def test_a_duration_survives_its_message(nanoseconds: int) -> None:
    sec, nanosec = divmod(Duration(nanoseconds=nanoseconds).nanoseconds, 10**9)
    assert 0 <= nanosec < 10**9
    assert Duration(seconds=sec, nanoseconds=nanosec).nanoseconds == nanoseconds


def test_a_duration_becomes_a_message_and_a_message_a_duration(messages: ModuleType) -> None:
    message = Duration(nanoseconds=-1).to_msg()
    assert isinstance(message, messages.Duration)
    assert (message.sec, message.nanosec) == (-1, 999_999_999)
    assert Duration.from_msg(message) == Duration(nanoseconds=-1)
    with pytest.raises(TypeError, match="Must pass a builtin_interfaces.msg.Duration object"):
        Duration.from_msg(messages.Time())


def test_a_time_has_nanoseconds_and_a_kind_of_clock() -> None:
    time = Time(seconds=3, nanoseconds=4)
    assert time.nanoseconds == 3_000_000_004
    assert time.seconds_nanoseconds() == (3, 4)
    assert time.clock_type == ClockType.SYSTEM_TIME
    assert repr(time) == "Time(nanoseconds=3000000004, clock_type=SYSTEM_TIME)"
    assert Time().nanoseconds == 0


def test_a_time_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="Seconds value must not be negative"):
        Time(seconds=-1)
    with pytest.raises(ValueError, match="Nanoseconds value must not be negative"):
        Time(nanoseconds=-1)
    with pytest.raises(TypeError, match="Clock type must be a ClockType enum"):
        Time(clock_type="ROS_TIME")  # type: ignore[arg-type]
    with pytest.raises(OverflowError, match="too large to store in C time point"):
        Time(nanoseconds=2**63)


def test_times_and_durations_are_calculated() -> None:
    ros = ClockType.ROS_TIME
    early, late = Time(seconds=1, clock_type=ros), Time(seconds=3, clock_type=ros)
    step = Duration(seconds=2)
    assert early + step == late and step + early == late
    assert (early + step).clock_type == ros
    assert late - step == early
    assert late - early == step and early - late == Duration(seconds=-2)
    with pytest.raises(ValueError, match="Subtraction leads to negative time"):
        early - step
    with pytest.raises(OverflowError, match="Addition leads to overflow in C storage"):
        early + Infinite
    with pytest.raises(TypeError):
        early + early  # type: ignore[operator]
    with pytest.raises(TypeError):
        early - 1  # type: ignore[operator]
    with pytest.raises(TypeError, match="unhashable"):
        hash(early)


def test_times_of_one_kind_of_clock_are_compared() -> None:
    one, two = Time(seconds=1), Time(seconds=2)
    assert one < two <= two and two > one >= one and one != two
    assert one != "one"
    with pytest.raises(TypeError):
        assert one < 2
    other = Time(seconds=1, clock_type=ClockType.STEADY_TIME)
    for compare in ("__eq__", "__lt__", "__le__", "__gt__", "__ge__"):
        with pytest.raises(TypeError, match="Can't compare times with different clock types"):
            getattr(one, compare)(other)
    with pytest.raises(TypeError, match="Can't compare times with different clock types"):
        assert one != other
    with pytest.raises(TypeError, match="Can't subtract times with different clock types"):
        one - other


def test_a_time_becomes_a_message_and_a_message_a_time(messages: ModuleType) -> None:
    message = Time(seconds=5, nanoseconds=6).to_msg()
    assert isinstance(message, messages.Time)
    assert (message.sec, message.nanosec) == (5, 6)
    assert Time.from_msg(message) == Time(seconds=5, nanoseconds=6, clock_type=ClockType.ROS_TIME)
    steady = Time.from_msg(message, clock_type=ClockType.STEADY_TIME)
    assert steady.clock_type == ClockType.STEADY_TIME
    with pytest.raises(TypeError, match="Must pass a builtin_interfaces.msg.Time object"):
        Time.from_msg(messages.Duration())


def test_the_kinds_of_clocks_have_the_numbers_of_ros() -> None:
    assert {kind.name: kind.value for kind in ClockType} == {
        "UNINITIALIZED": 0,
        "ROS_TIME": 1,
        "SYSTEM_TIME": 2,
        "STEADY_TIME": 3,
    }
