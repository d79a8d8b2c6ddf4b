"""Message filters of `hprm.ros`: subscriptions, caches, synchronizers, and what is unmatched."""

from __future__ import annotations

import random
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hprm.ros._log_console import LogRecord, output
from hprm.ros._message_filters import (
    ApproximateTimeSynchronizer,
    Cache,
    SimpleFilter,
    Subscriber,
    TimeSynchronizer,
)
from hprm.ros._message_filters._matching import ApproximateMatching, ExactMatching
from hprm.ros.clock_type import ClockType
from hprm.ros.time import Time

MILLISECOND = 1_000_000


@dataclass
class Stamp:
    sec: int
    nanosec: int


@dataclass
class Header:
    stamp: Stamp


@dataclass
class Sample:
    """A message with a header; the name tells it from others."""

    header: Header
    name: str = ""


def sample(milliseconds: int, name: str = "") -> Sample:
    sec, rest = divmod(milliseconds, 1000)
    return Sample(Header(Stamp(sec, rest * MILLISECOND)), name or str(milliseconds))


def at(milliseconds: int) -> Time:
    return Time(nanoseconds=milliseconds * MILLISECOND, clock_type=ClockType.ROS_TIME)


@dataclass
class Node:
    """A node whose subscriptions are only on record."""

    subscriptions: list[tuple[Any, ...]] = field(default_factory=list)

    def create_subscription(
        self, kind: type, topic: str, callback: Callable[[Any], None], **kwargs: Any
    ) -> Any:
        self.subscriptions.append((kind, topic, callback, kwargs))
        return Subscription()


class Subscription:
    topic_name = "/full/name"


@pytest.fixture
def log() -> Iterator[list[str]]:
    """What is written to the log; its time stands at 5 s."""
    lines: list[str] = []

    def listen(record: LogRecord) -> None:
        lines.append(f"{record.severity.name} {record.name}: {record.message}")

    output.listeners.append(listen)
    output.set_time_source(lambda: 5_000 * MILLISECOND)
    yield lines
    output.set_time_source(None)
    output.listeners.remove(listen)


def connected(filters: SimpleFilter) -> list[Any]:
    """All outputs of a filter, as tuples of names."""
    outputs: list[Any] = []
    filters.registerCallback(lambda *messages: outputs.append(tuple(m.name for m in messages)))
    return outputs


def test_callbacks_get_messages_and_their_own_arguments() -> None:
    source = SimpleFilter()
    calls: list[tuple[Any, ...]] = []
    assert source.registerCallback(lambda *args: calls.append(args), "a", 1) == 0
    assert source.registerCallback(lambda *args: calls.append(args)) == 1
    source.signalMessage("x", "y")
    assert calls == [("x", "y", "a", 1), ("x", "y")]


def test_a_subscriber_subscribes_and_forwards() -> None:
    node = Node()
    subscriber = Subscriber(node, Sample, "image", callback_group="g")
    assert subscriber.getTopic() == "image"
    ((kind, topic, callback, kwargs),) = node.subscriptions
    assert (kind, topic, kwargs) == (Sample, "image", {"qos_profile": 10, "callback_group": "g"})
    Subscriber(node, Sample, "image", qos_profile=3)
    assert node.subscriptions[1][3] == {"qos_profile": 3}
    outputs = connected(subscriber)
    callback(sample(1))
    assert outputs == [("1",)]
    assert subscriber.topic_name == "/full/name"
    with pytest.raises(AttributeError, match="colour"):
        _ = subscriber.colour


def test_a_cache_has_the_latest_messages() -> None:
    source = SimpleFilter()
    cache = Cache(source, cache_size=3)
    outputs = connected(cache)
    assert (
        cache.getLast()
        is cache.getLastestTime()
        is cache.getLatestTime()
        is cache.getOldestTime()
        is None
    )
    for milliseconds in (10, 40, 20, 30):
        source.signalMessage(sample(milliseconds))
    assert outputs == [("10",), ("40",), ("20",), ("30",)]
    assert [message.name for message in cache.cache_msgs] == ["20", "30", "40"]
    assert cache.getOldestTime() == at(20) and cache.getLastestTime() == at(40)
    assert cache.getLast().name == "40"
    assert [m.name for m in cache.getInterval(at(20), at(30))] == ["20", "30"]
    assert cache.getInterval(at(31), at(39)) == []
    assert cache.getElemAfterTime(at(21)).name == "30"
    assert cache.getElemAfterTime(at(30)).name == "30"
    assert cache.getElemAfterTime(at(41)) is None
    assert cache.getElemBeforeTime(at(29)).name == "20"
    assert cache.getElemBeforeTime(at(19)) is None
    with pytest.raises(AssertionError, match="the interval ends before it begins"):
        cache.getInterval(at(2), at(1))


@dataclass
class Headerless:
    name: str = "bare"


def test_a_cache_may_take_messages_without_a_header(log: list[str]) -> None:
    source = SimpleFilter()
    strict, lenient = Cache(source), Cache(source, allow_headerless=True)
    source.signalMessage(Headerless())
    assert strict.getLast() is None
    assert lenient.getLastestTime() == at(5000)
    assert len(log) == 1 and log[0].startswith(
        "WARN message_filters_cache: can not use message filters messages without timestamp"
    )


def test_a_time_synchronizer_matches_equal_stamps() -> None:
    left, right = SimpleFilter(), SimpleFilter()
    synchronizer = TimeSynchronizer([left, right], 2)
    outputs = connected(synchronizer)
    for milliseconds in (1, 2, 3):
        left.signalMessage(sample(milliseconds, f"l{milliseconds}"))
    for milliseconds in (1, 2, 3):
        right.signalMessage(sample(milliseconds, f"r{milliseconds}"))
    # The queue of the left input had no room for its first message.
    assert outputs == [("l2", "r2"), ("l3", "r3")]
    counts = [(c.received, c.matched, c.unmatched, c.waiting) for c in synchronizer.counts]
    assert counts == [(3, 2, 1, 0), (3, 2, 0, 1)]


def test_an_approximate_synchronizer_matches_near_stamps() -> None:
    left, right = SimpleFilter(), SimpleFilter()
    outputs = connected(ApproximateTimeSynchronizer([left, right], 10, slop=0.010))
    left.signalMessage(sample(100, "l100"))
    left.signalMessage(sample(107, "l107"))
    right.signalMessage(sample(105, "r105"))
    right.signalMessage(sample(109, "r109"))
    right.signalMessage(sample(110, "r110"))
    assert outputs == [("l107", "r105"), ("l100", "r109")]


def test_stamps_that_are_the_whole_slop_apart_do_not_match() -> None:
    matching = ApproximateMatching(2, 10, slop=10)
    assert matching.add(0, 0, "a") == []
    assert matching.add(1, 10, "b") == []
    assert matching.add(1, 9, "c") == [("a", "c")]


def test_all_stamps_of_a_set_are_near_one_another() -> None:
    matching = ApproximateMatching(3, 10, slop=10)
    assert matching.add(0, 0, "a") == []
    assert matching.add(2, 12, "c") == []
    # Both others are near the new one, but not near one another.
    assert matching.add(1, 6, "b") == []
    assert matching.add(2, 9, "d") == [("a", "b", "d")]


def test_messages_without_a_header_take_part_if_they_may(log: list[str]) -> None:
    left, right = SimpleFilter(), SimpleFilter()
    lenient = ApproximateTimeSynchronizer([left, right], 1, 0.1, allow_headerless=True)
    strict = ApproximateTimeSynchronizer([left, right], 1, 0.1)
    matched, unmatched = connected(lenient), connected(strict)
    left.signalMessage(Headerless())
    right.signalMessage(sample(5050, "r"))
    assert matched == [("bare", "r")]
    assert unmatched == []
    assert strict.counts[0].unmatched == 1
    assert len(log) == 1 and "message_filters_approx" in log[0]


def test_the_time_of_arrival_may_count_instead_of_stamps(log: list[str]) -> None:
    left, right = SimpleFilter(), SimpleFilter()
    both = ApproximateTimeSynchronizer([left, right], 1, 0.1, sync_arrival_time=True)
    outputs = connected(both)
    left.signalMessage(sample(1, "l"))
    right.signalMessage(sample(99_000, "r"))
    assert outputs == [("l", "r")]


def test_callbacks_may_send_to_the_inputs_again() -> None:
    left, right = SimpleFilter(), SimpleFilter()
    synchronizer = TimeSynchronizer([left, right], 2)
    outputs = connected(synchronizer)
    synchronizer.registerCallback(
        lambda *messages: left.signalMessage(sample(2)) if messages[0].name == "1" else None
    )
    left.signalMessage(sample(1))
    right.signalMessage(sample(1))
    right.signalMessage(sample(2))
    assert outputs == [("1", "1"), ("2", "2")]


def sensors(seed: int) -> list[tuple[int, int, int]]:
    """Arrivals of two sensors, of 30 Hz and 10 Hz, with jitter: time, input and stamp."""
    draw = random.Random(seed)
    arrivals = []
    for index, period in ((0, 33_333_333), (1, 100_000_000)):
        for number in range(2_000_000_000 // period):
            stamp = number * period + draw.randrange(0, 8 * MILLISECOND)
            arrivals.append((stamp + draw.randrange(0, 40 * MILLISECOND), index, stamp))
    return sorted(arrivals)


@pytest.mark.parametrize("seed", range(20))
def test_every_sample_of_two_sensors_is_matched_or_counted(seed: int) -> None:
    slop = 20 * MILLISECOND
    matching = ApproximateMatching(2, 5, slop)
    sets = []
    for _, index, stamp in sensors(seed):
        sets += matching.add(index, stamp, (index, stamp))
    # Of each set, the first comes from the first sensor, and both are near; no sample is in two.
    assert all((a, b) == (0, 1) for ((a, _), (b, _)) in sets)
    assert all(abs(one - two) < slop for ((_, one), (_, two)) in sets)
    matched = [message for pair in sets for message in pair]
    assert len(matched) == len(set(matched))
    waiting = [message for queue in matching.queues for message in queue.values()]
    assert not set(waiting) & set(matched)
    for index, counts in enumerate(matching.counts):
        received = sum(1 for _, of, _ in sensors(seed) if of == index)
        assert counts.received == received
        assert counts.matched == len(sets)
        assert counts.waiting == len(matching.queues[index])
        assert counts.matched + counts.unmatched + counts.waiting == received
    # The slow sensor finds a partner nearly always, the fast one in one of three cases.
    assert matching.counts[1].matched >= 16
    assert matching.counts[0].unmatched >= 30


@given(
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 30)), max_size=40),
    st.integers(1, 4),
    st.integers(0, 6),
)
def test_no_message_is_lost_from_the_counts(
    stream: list[tuple[int, int]], queue_size: int, slop: int
) -> None:
    for matching in (ExactMatching(3, queue_size), ApproximateMatching(3, queue_size, slop)):
        sets: list[tuple[int, ...]] = []
        for number, (index, stamp) in enumerate(stream):
            sets += matching.add(index, stamp, number)
            assert all(len(queue) <= queue_size for queue in matching.queues)
        for index, counts in enumerate(matching.counts):
            assert counts.received == sum(1 for of, _ in stream if of == index)
            assert counts.matched == len(sets)
            assert counts.waiting == len(matching.queues[index])
        numbers = [number for found in sets for number in found]
        assert len(numbers) == len(set(numbers))
        for found in sets:
            assert [stream[number][0] for number in found] == [0, 1, 2]
            stamps = [stream[number][1] for number in found]
            spread = max(stamps) - min(stamps)
            assert spread < slop or (isinstance(matching, ExactMatching) and spread == 0)


def test_unmatched_messages_are_reported(log: list[str]) -> None:
    node = Node()
    camera, lidar = Subscriber(node, Sample, "camera"), Subscriber(node, Sample, "lidar")
    synchronizer = ApproximateTimeSynchronizer([camera, lidar], 2, 0.01)
    synchronizer.report()
    assert log == []
    for milliseconds in (0, 33, 66, 100):
        camera.callback(sample(milliseconds))
    lidar.callback(sample(101))
    synchronizer.report()
    synchronizer.report()
    assert log == [
        "WARN message_filters: messages without a match: 3 of 4 from camera, 0 of 1 from lidar"
    ]


def test_the_end_of_the_process_reports_unmatched_messages() -> None:
    program = """
        from hprm.ros._message_filters import SimpleFilter, TimeSynchronizer

        class Stamp:
            sec, nanosec = 1, 0

        class Message:
            class header:
                stamp = Stamp

        one, two = SimpleFilter(), SimpleFilter()
        synchronizer = TimeSynchronizer([one, two], 3)
        one.signalMessage(Message())
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stderr.endswith(
        "[message_filters]: messages without a match: 1 of 1 from input 0, 0 of 0 from input 1\n"
    )
