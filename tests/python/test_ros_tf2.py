"""Transforms of `hprm.ros`: trees, times, interpolation, exceptions, topics and messages."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from hprm.ros import _messages, _tf2_py, _tf2_ros
from hprm.ros._log_console import LogRecord, output
from hprm.ros._tf2_ros import (
    Buffer,
    BufferCore,
    BufferInterface,
    ConnectivityException,
    ConvertRegistration,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformException,
    TransformListener,
    TransformRegistration,
    TypeException,
    convert,
    static_transform_publisher,
)
from hprm.ros._tf2_ros._geometry import (
    Quaternion,
    Rigid,
    apply,
    compose,
    interpolate,
    inverse,
    normalized,
    rotate,
    slerp,
)
from hprm.ros._tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC
from hprm.ros.duration import Duration
from hprm.ros.qos import DurabilityPolicy
from hprm.ros.time import Time

_messages.install()

SECOND = 1_000_000_000
LATEST = Time()
Matrix = npt.NDArray[np.float64]

numbers = st.floats(-5, 5, allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)
quaternions = (
    st.tuples(numbers, numbers, numbers, numbers)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(normalized)
)
rigids = st.builds(Rigid, vectors, quaternions)


def matrix_of_rotation(rotation: Quaternion) -> Matrix:
    """The rotation matrix of a quaternion: the textbook's form, by other means than the code."""
    x, y, z, w = rotation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def matrix(transform: Rigid) -> Matrix:
    result = np.eye(4)
    result[:3, :3] = matrix_of_rotation(transform.rotation)
    result[:3, 3] = transform.translation
    return result


def about_z(angle: float) -> Quaternion:
    return 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)


@given(rigids, rigids, vectors)
def test_transforms_are_the_matrices_of_the_textbook(a: Rigid, b: Rigid, v: Any) -> None:
    point = np.array([*v, 1.0])
    assert np.allclose(apply(a, v), (matrix(a) @ point)[:3])
    assert np.allclose(rotate(a.rotation, v), matrix_of_rotation(a.rotation) @ v)
    assert np.allclose(matrix(compose(a, b)), matrix(a) @ matrix(b))
    assert np.allclose(matrix(inverse(a)), np.linalg.inv(matrix(a)))


@given(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1), st.floats(0, 1))
def test_slerp_turns_evenly_on_the_shorter_way(begin: float, end: float, ratio: float) -> None:
    step = (end - begin + math.pi) % (2 * math.pi) - math.pi
    found = matrix_of_rotation(slerp(about_z(begin), about_z(end), ratio))
    assert np.allclose(found, matrix_of_rotation(about_z(begin + ratio * step)), atol=1e-6)


@given(quaternions, st.floats(0, 1))
def test_slerp_between_equal_rotations_stays(rotation: Quaternion, ratio: float) -> None:
    negative = tuple(-part for part in rotation)
    for other in (rotation, negative):
        found = slerp(rotation, other, ratio)  # type: ignore[arg-type]
        assert np.allclose(matrix_of_rotation(found), matrix_of_rotation(rotation))


def stamped(
    parent: str,
    child: str,
    seconds: float = 0,
    translation: Any = (0.0, 0.0, 0.0),
    rotation: Any = (0.0, 0.0, 0.0, 1.0),
) -> Any:
    from geometry_msgs.msg import TransformStamped  # type: ignore[import-not-found]

    message = TransformStamped()
    message.header.frame_id = parent
    message.child_frame_id = child
    message.header.stamp = Time(seconds=seconds).to_msg()
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y, moved.z = map(float, translation)
    turned.x, turned.y, turned.z, turned.w = map(float, rotation)
    return message


def buffer_with(*transforms: Any, static: tuple[Any, ...] = ()) -> Buffer:
    buffer = Buffer()
    for transform in transforms:
        buffer.set_transform(transform, "test")
    for transform in static:
        buffer.set_transform_static(transform, "test")
    return buffer


def at(seconds: float) -> Time:
    return Time(seconds=seconds)


def rigid(message: Any) -> Rigid:
    moved, turned = message.transform.translation, message.transform.rotation
    return Rigid((moved.x, moved.y, moved.z), (turned.x, turned.y, turned.z, turned.w))


@pytest.fixture
def log() -> Iterator[list[str]]:
    lines: list[str] = []

    def listen(record: LogRecord) -> None:
        lines.append(f"{record.severity.name} {record.message}")

    output.listeners.append(listen)
    yield lines
    output.listeners.remove(listen)


def test_a_lookup_takes_points_of_the_source_into_the_target() -> None:
    buffer = buffer_with(stamped("world", "robot", 1, (1, 2, 3), about_z(math.pi / 2)))
    found = buffer.lookup_transform("world", "robot", at(1))
    assert found.header.frame_id == "world" and found.child_frame_id == "robot"
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (1, 0)
    assert np.allclose(apply(rigid(found), (1, 0, 0)), (1, 3, 3))
    back = buffer.lookup_transform("robot", "world", at(1))
    assert np.allclose(apply(rigid(back), (1, 3, 3)), (1, 0, 0))


@settings(max_examples=50)
@given(st.data())
def test_lookups_in_random_trees_agree_with_matrices(data: st.DataObject) -> None:
    parents = [data.draw(st.integers(0, child)) for child in range(7)]
    poses = [data.draw(rigids) for _ in parents]
    buffer, world = BufferCore(), {0: np.eye(4)}
    for child, (parent, pose) in enumerate(zip(parents, poses, strict=True), start=1):
        buffer.set_transform(stamped(f"f{parent}", f"f{child}", 5, *pose), "test")
        world[child] = world[parent] @ matrix(pose)
    target = data.draw(st.integers(0, len(parents)))
    source = data.draw(st.integers(0, len(parents)))
    found = rigid(buffer.lookup_transform_core(f"f{target}", f"f{source}", at(5)))
    assert np.allclose(matrix(found), np.linalg.inv(world[target]) @ world[source], atol=1e-7)


def test_a_lookup_between_two_times_interpolates() -> None:
    buffer = buffer_with(
        stamped("world", "robot", 10, (0, 0, 0), about_z(0)),
        stamped("world", "robot", 12, (4, 0, 2), about_z(1.0)),
    )
    found = rigid(buffer.lookup_transform("world", "robot", at(10.5)))
    assert np.allclose(found.translation, (1, 0, 0.5))
    assert np.allclose(found.rotation, about_z(0.25))
    one, two = Rigid((0, 0, 0), about_z(0)), Rigid((4, 0, 2), about_z(1.0))
    assert interpolate(one, two, 0.25) == found


def test_time_zero_is_the_latest_common_time() -> None:
    buffer = buffer_with(
        stamped("world", "robot", 1),
        stamped("world", "robot", 5, (4, 0, 0)),
        stamped("robot", "arm", 2),
        stamped("robot", "arm", 3, (0, 1, 0)),
        static=(stamped("arm", "hand", 0, (0, 0, 1)),),
    )
    found = buffer.lookup_transform("world", "hand", LATEST)
    assert found.header.stamp.sec == 3
    assert np.allclose(rigid(found).translation, (2, 1, 1))
    assert buffer.get_latest_common_time("world", "hand") == at(3)
    assert buffer.lookup_transform("arm", "hand", LATEST).header.stamp.sec == 0
    assert buffer.lookup_transform("robot", "robot", LATEST).header.stamp.sec == 5


def test_static_transforms_are_true_for_all_times() -> None:
    buffer = buffer_with(static=(stamped("robot", "camera", 100, (1, 0, 0)),))
    for seconds in (0, 1, 1e6):
        found = buffer.lookup_transform("robot", "camera", at(seconds))
        assert found.transform.translation.x == 1.0
    buffer.set_transform_static(stamped("robot", "camera", 1, (2, 0, 0)), "test")
    assert buffer.lookup_transform("robot", "camera", at(7)).transform.translation.x == 2.0
    buffer.clear()
    assert buffer.can_transform("robot", "camera", at(7))


def test_a_frame_may_begin_to_move() -> None:
    buffer = buffer_with(static=(stamped("robot", "camera"),))
    buffer.set_transform(stamped("robot", "camera", 5, (1, 0, 0)), "test")
    with pytest.raises(ExtrapolationException):
        buffer.lookup_transform("robot", "camera", at(4))


@pytest.mark.parametrize(
    ("seconds", "message"),
    [
        (
            9,
            "Lookup would require extrapolation into the past.  Requested time 9.000000 but the "
            "earliest data is at time 10.000000, when looking up transform from frame [arm] "
            "to frame [world]",
        ),
        (
            13.25,
            "Lookup would require extrapolation into the future.  Requested time 13.250000 but the "
            "latest data is at time 12.000000, when looking up transform from frame [arm] "
            "to frame [world]",
        ),
    ],
)
def test_nothing_is_extrapolated(seconds: float, message: str) -> None:
    buffer = buffer_with(
        stamped("world", "robot", 10),
        stamped("world", "robot", 12),
        static=(stamped("robot", "arm"),),
    )
    with pytest.raises(ExtrapolationException) as raised:
        buffer.lookup_transform("world", "arm", at(seconds))
    assert str(raised.value) == message
    turned = message.replace("[arm] to frame [world]", "[world] to frame [arm]")
    assert buffer.can_transform("arm", "world", at(seconds), return_debug_tuple=True) == (
        False,
        turned,
    )


def test_one_known_time_is_not_enough_for_another_one() -> None:
    buffer = buffer_with(stamped("world", "robot", 10))
    with pytest.raises(
        ExtrapolationException, match="at time 11.000000, but only time 10.000000 is in the buffer"
    ):
        buffer.lookup_transform("world", "robot", at(11))


def test_a_way_below_what_is_unknown_is_found() -> None:
    # Where the robot was at 5 s is unknown, but not where its arm and its camera were.
    buffer = buffer_with(
        stamped("world", "robot", 9),
        stamped("robot", "arm", 5, (1, 0, 0)),
        stamped("robot", "camera", 5, (0, 1, 0)),
    )
    found = buffer.lookup_transform("camera", "arm", at(5))
    assert np.allclose(rigid(found).translation, (1, -1, 0))


def test_trees_that_are_not_connected_are_named() -> None:
    buffer = buffer_with(stamped("world", "robot", 1), stamped("map", "tree", 1))
    with pytest.raises(ConnectivityException) as raised:
        buffer.lookup_transform("robot", "tree", at(1))
    assert str(raised.value).startswith("Could not find a connection between 'robot' and 'tree'")
    for time in (at(1), LATEST):
        assert not buffer.can_transform("robot", "tree", time)


def test_frames_that_do_not_exist_are_named() -> None:
    buffer = buffer_with(stamped("world", "robot", 1))
    with pytest.raises(LookupException) as raised:
        buffer.lookup_transform("world", "arm", LATEST)
    assert str(raised.value) == (
        '"arm" passed to lookupTransform argument source_frame does not exist. '
    )
    with pytest.raises(InvalidArgumentException, match="frame_ids cannot be empty"):
        buffer.lookup_transform("", "robot", LATEST)
    with pytest.raises(InvalidArgumentException, match="cannot start with a '/'"):
        buffer.lookup_transform("world", "/robot", LATEST)
    with pytest.raises(LookupException, match="argument fixed_frame does not exist"):
        buffer.lookup_transform_full("world", at(1), "robot", at(1), "map")
    with pytest.raises(TypeError, match="time must have sec and nanosec, or nanoseconds"):
        buffer.lookup_transform("world", "robot", 1.0)
    possible, why = buffer.can_transform_core("world", "arm", LATEST)
    assert not possible and '"arm" passed to canTransform argument source_frame' in why
    assert issubclass(LookupException, TransformException)
    assert _tf2_py.LookupException is LookupException


def test_a_loop_is_one_clear_error() -> None:
    buffer = buffer_with(
        stamped("b", "a", 1),
        stamped("c", "b", 1),
        stamped("a", "c", 1),
        stamped("world", "other", 1),
    )
    for time in (at(1), LATEST):
        with pytest.raises(LookupException) as raised:
            buffer.lookup_transform("other", "a", time)
        first, *frames = str(raised.value).splitlines()
        assert first == "The tf tree is invalid because it contains a loop: a -> b -> c -> a"
        assert "Frame a exists with parent b." in frames


def test_a_frame_may_change_its_parent() -> None:
    buffer = buffer_with(
        stamped("table", "cup", 1, (1, 0, 0)),
        stamped("hand", "cup", 2, (0, 0, 0)),
        static=(stamped("world", "table"), stamped("world", "hand", 0, (5, 0, 0))),
    )
    assert np.allclose(rigid(buffer.lookup_transform("world", "cup", at(1))).translation, (1, 0, 0))
    assert np.allclose(rigid(buffer.lookup_transform("world", "cup", at(2))).translation, (5, 0, 0))
    # Between them, it is where it was: nothing is interpolated between two parents.
    between = buffer.lookup_transform("world", "cup", at(1.5))
    assert np.allclose(rigid(between).translation, (1, 0, 0))


def test_transforms_are_kept_for_ten_seconds(log: list[str]) -> None:
    buffer = buffer_with(*(stamped("world", "robot", seconds) for seconds in range(1, 21)))
    assert buffer.can_transform("world", "robot", at(10))
    assert not buffer.can_transform("world", "robot", at(9.5))
    buffer.set_transform(stamped("world", "robot", 9), "late")
    assert log == [
        "WARN TF_OLD_DATA ignoring data from the past for frame robot at time 9.000000 "
        "according to authority late"
    ]
    short = Buffer(Duration(seconds=1))
    for seconds in (1, 2, 3):
        short.set_transform(stamped("world", "robot", seconds), "test")
    assert short.can_transform("world", "robot", at(2))
    assert not short.can_transform("world", "robot", at(1.5))


@given(st.permutations(range(1, 8)))
def test_the_order_of_arrival_does_not_matter(order: list[int]) -> None:
    buffer = BufferCore()
    for seconds in order:
        buffer.set_transform(stamped("world", "robot", seconds, (seconds, 0, 0)), "test")
    for seconds in (1, 2.5, 6.75, 7):
        found = buffer.lookup_transform_core("world", "robot", at(seconds))
        assert math.isclose(found.transform.translation.x, seconds)


@pytest.mark.parametrize(
    ("transform", "what"),
    [
        (("a", "a"), "TF_SELF_TRANSFORM"),
        (("a", ""), "TF_NO_CHILD_FRAME_ID"),
        (("", "a"), "TF_NO_FRAME_ID"),
        (("a", "b", 1, (math.nan, 0, 0)), "TF_NAN_INPUT"),
        (("a", "b", 1, (0, 0, 0), (0, 0, 0, 2)), "TF_DENORMALIZED_QUATERNION"),
        (("a", "b", 1, (0, 0, 0), (0, 0, 0, 0)), "TF_DENORMALIZED_QUATERNION"),
    ],
)
def test_what_is_no_transform_is_left_out(transform: Any, what: str, log: list[str]) -> None:
    buffer = buffer_with(stamped(*transform))
    assert len(log) == 1 and log[0].startswith(f"ERROR {what}: Ignoring transform for child_frame")
    assert buffer.all_frames_as_string() == ""


def test_slashes_in_front_of_frames_are_left_out() -> None:
    buffer = buffer_with(stamped("/world", "/robot", 1))
    assert buffer.can_transform("world", "robot", at(1))


def test_a_transform_between_two_times_goes_by_a_fixed_frame() -> None:
    buffer = buffer_with(*(stamped("world", "robot", s, (s, 0, 0)) for s in (1, 3)))
    found = buffer.lookup_transform_full("robot", at(3), "robot", at(1), "world")
    # Where the robot was at 1 s, seen from where it is at 3 s.
    assert np.allclose(rigid(found).translation, (-2, 0, 0))
    assert found.header.stamp.sec == 3
    assert buffer.can_transform_full("robot", at(3), "robot", at(1), "world")
    assert not buffer.can_transform_full("robot", at(4), "robot", at(1), "world")


def test_all_frames_are_listed() -> None:
    buffer = buffer_with(
        stamped("world", "robot", 1),
        stamped("world", "robot", 3),
        static=(stamped("robot", "camera"),),
    )
    assert buffer.all_frames_as_string() == (
        "Frame robot exists with parent world.\nFrame camera exists with parent robot.\n"
    )
    frames = yaml.safe_load(buffer.all_frames_as_yaml(at(4)))
    assert frames["robot"] == {
        "parent": "world",
        "broadcaster": "test",
        "rate": 1.0,
        "most_recent_transform": 3.0,
        "oldest_transform": 1.0,
        "transform_delay": 1.0,
        "buffer_length": 2.0,
    }
    assert "transform_delay" not in yaml.safe_load(buffer.all_frames_as_yaml())["camera"]
    assert Buffer().all_frames_as_yaml() == "[]"
    buffer.clear()
    assert "Frame robot exists with parent NO_PARENT." in buffer.all_frames_as_string()


def test_a_lookup_waits_for_another_thread() -> None:
    buffer = Buffer()
    asked = threading.Event()
    check = buffer.can_transform_core

    def watched(*args: Any) -> Any:
        asked.set()
        return check(*args)

    buffer.can_transform_core = watched  # type: ignore[method-assign]

    def publish() -> None:
        asked.wait()
        buffer.set_transform(stamped("world", "robot", 1), "test")

    thread = threading.Thread(target=publish)
    thread.start()
    found = buffer.lookup_transform("world", "robot", at(1), timeout=Duration(seconds=60))
    thread.join()
    assert found.child_frame_id == "robot"


def test_a_wait_that_is_over_raises_what_is_missing() -> None:
    buffer = Buffer()
    with pytest.raises(LookupException):
        buffer.lookup_transform("world", "robot", at(1), timeout=Duration(nanoseconds=1))
    assert buffer.can_transform("a", "b", at(1), Duration(nanoseconds=1)) is False


def test_a_future_is_done_when_the_transform_is_known() -> None:
    buffer = Buffer()
    future = buffer.wait_for_transform_async("world", "robot", at(1))
    full = buffer.wait_for_transform_full_async("robot", at(1), "robot", at(1), "world")
    buffer.set_transform(stamped("world", "other", 1), "test")
    assert not future.done() and not full.done()
    buffer.set_transform(stamped("world", "robot", 1, (7, 0, 0)), "test")
    assert future.result().transform.translation.x == 7.0
    assert full.result().transform.translation.x == 0.0
    assert buffer._listeners == []
    assert buffer.wait_for_transform_async("world", "robot", at(1)).done()


def test_coroutines_may_wait_for_transforms() -> None:
    buffer = Buffer()
    one = buffer.lookup_transform_async("world", "robot", at(1))
    full = buffer.lookup_transform_full_async("robot", at(1), "robot", at(1), "world")
    for waiting in (one, full):
        assert not waiting.send(None).done()
    buffer.set_transform(stamped("world", "robot", 1), "test")
    frames = []
    for waiting in (one, full):
        with pytest.raises(StopIteration) as returned:
            waiting.send(None)
        frames.append(returned.value.value.header.frame_id)
    assert frames == ["world", "robot"]


def test_a_future_that_is_cancelled_waits_no_longer() -> None:
    buffer = Buffer()
    future = buffer.wait_for_transform_async("world", "robot", at(1))
    future.cancel()
    assert buffer._listeners == []
    buffer.set_transform(stamped("world", "robot", 1), "test")
    assert future.cancelled()


class Node:
    """A node that connects its publishers with its subscriptions."""

    def __init__(self) -> None:
        self.made: list[tuple[str, Any, Any]] = []
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.services: dict[str, Callable[[Any, Any], Any]] = {}
        self.destroyed: list[str] = []

    def create_publisher(self, kind: Any, topic: str, qos: Any) -> Any:
        self.made.append((topic, kind, qos))
        node = self

        class Publisher:
            def publish(self, message: Any) -> None:
                assert type(message) is kind
                node.callbacks[topic](message)

        return Publisher()

    def create_subscription(
        self, kind: Any, topic: str, callback: Any, qos: Any, *, callback_group: Any
    ) -> str:
        self.made.append((topic, kind, qos))
        self.callbacks[topic] = callback
        return topic

    def destroy_subscription(self, subscription: str) -> None:
        self.destroyed.append(subscription)

    def create_service(self, kind: Any, name: str, callback: Any) -> Any:
        self.services[name] = (kind, callback)  # type: ignore[assignment]


def test_broadcasters_and_listeners_share_two_topics() -> None:
    node, buffer = Node(), Buffer()
    listener = TransformListener(buffer, node)
    TransformBroadcaster(node).sendTransform(stamped("world", "robot", 1))
    TransformBroadcaster(node).sendTransform([stamped("robot", "arm", 1), stamped("arm", "x", 1)])
    static = StaticTransformBroadcaster(node)
    static.sendTransform(stamped("robot", "camera", 0, (1, 0, 0)))
    static.sendTransform((stamped("x", "tip"), stamped("robot", "camera", 0, (2, 0, 0))))
    found = buffer.lookup_transform("camera", "tip", at(1))
    assert found.transform.translation.x == -2.0
    assert [len(static._transforms), *node.destroyed] == [2]
    durable = {
        topic for topic, _, qos in node.made if qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
    }
    assert durable == {"/tf_static"}
    assert {topic: qos.depth for topic, _, qos in node.made[:2]} == {"/tf": 100, "/tf_static": 100}
    listener.unregister()
    assert node.destroyed == ["/tf", "/tf_static"]
    topics = {
        "tf_topic": "/a" + DEFAULT_TF_TOPIC,
        "tf_static_topic": "/a" + DEFAULT_STATIC_TF_TOPIC,
    }
    TransformListener(buffer, node, **topics)
    assert [topic for topic, _, _ in node.made[-2:]] == ["/a/tf", "/a/tf_static"]


def test_a_static_broadcaster_repeats_what_it_sent() -> None:
    node = Node()
    sent: list[list[str]] = []
    node.callbacks["/tf_static"] = lambda message: sent.append(
        [transform.child_frame_id for transform in message.transforms]
    )
    broadcaster = StaticTransformBroadcaster(node, qos=3)
    broadcaster.sendTransform(stamped("a", "b"))
    broadcaster.sendTransform(stamped("a", "c"))
    assert sent == [["b"], ["b", "c"]]
    assert node.made[0][2] == 3


def test_a_buffer_with_a_node_offers_its_frames() -> None:
    node = Node()
    buffer = Buffer(node=node)
    buffer.set_transform(stamped("world", "robot", 1), "test")
    kind, callback = node.services["tf2_frames"]  # type: ignore[misc]
    answer = callback(kind.Request(), kind.Response())
    assert yaml.safe_load(answer.frame_yaml)["robot"]["parent"] == "world"


def test_what_is_left_out_says_so() -> None:
    with pytest.raises(ImportError, match="a Buffer with a TransformListener does the same"):
        from hprm.ros._tf2_ros import BufferClient  # noqa: F401
    with pytest.raises(AttributeError, match="module 'tf2_ros' has no attribute 'Colour'"):
        _ = _tf2_ros.Colour


def test_programs_import_messages_from_tf2_ros() -> None:
    from geometry_msgs.msg import TransformStamped

    assert _tf2_ros.TransformStamped is TransformStamped


@pytest.mark.parametrize(
    "words",
    [
        "--x 1 --y -2 --yaw 0.5 --frame-id robot --child-frame-id camera",
        "1 -2 0 0.5 0 0 robot camera",
        f"1 -2 0 0 0 {2 * math.sin(0.25)} {2 * math.cos(0.25)} robot camera",
        f"--x 1 --y -2 --qz {math.sin(0.25)} --qw {math.cos(0.25)} "
        "--frame-id robot --child-frame-id camera",
    ],
)
def test_the_publisher_of_static_transforms_reads_old_and_new_forms(words: str) -> None:
    placement = static_transform_publisher.parse(words.split())
    assert (placement.frame, placement.child) == ("robot", "camera")
    assert placement.transform.translation == (1.0, -2.0, 0.0)
    assert np.allclose(placement.transform.rotation, about_z(0.5))
    message = static_transform_publisher.message_of(placement, at(3).to_msg())
    assert (message.header.frame_id, message.header.stamp.sec) == ("robot", 3)
    assert rigid(message) == placement.transform


def test_roll_pitch_and_yaw_are_about_fixed_axes() -> None:
    turns = (0.3, -0.7, 1.9)
    axes = np.eye(3)
    expected = np.eye(3)
    for axis, angle in zip(axes, turns, strict=True):
        half = (*(axis * math.sin(angle / 2)), math.cos(angle / 2))
        expected = matrix_of_rotation(half) @ expected
    found = static_transform_publisher.rotation_of(*turns)
    assert np.allclose(matrix_of_rotation(found), expected)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("--frame-id a", "--frame-id and --child-frame-id are needed"),
        ("--yaw 1 --qz 1 --frame-id a --child-frame-id b", "either a quaternion or roll, pitch"),
        ("--x one --frame-id a --child-frame-id b", "argument --x: invalid float value: 'one'"),
    ],
)
def test_a_wrong_command_line_of_the_publisher_is_refused(
    words: str, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        static_transform_publisher.parse(words.split())
    assert what in capsys.readouterr().err


def quarter_turn() -> Any:
    """One metre along x, and a quarter turn about z."""
    return stamped("world", "robot", 1, (1, 0, 0), about_z(math.pi / 2))


def test_messages_are_transformed() -> None:
    from geometry_msgs.msg import (
        Point32,
        PointStamped,
        PolygonStamped,
        PoseStamped,
        PoseWithCovarianceStamped,
        Vector3Stamped,
    )

    import hprm.ros._tf2_geometry_msgs  # noqa: F401

    buffer = buffer_with(quarter_turn())

    def moved(message: Any) -> Any:
        message.header.frame_id = "robot"
        message.header.stamp = at(1).to_msg()
        result = buffer.transform(message, "world")
        assert result.header.frame_id == "world" and type(result) is type(message)
        return result

    point = PointStamped()
    point.point.x = 2.0
    assert np.allclose([moved(point).point.x, moved(point).point.y], [1, 2])
    vector = Vector3Stamped()
    vector.vector.x = 2.0
    assert np.allclose([moved(vector).vector.x, moved(vector).vector.y], [0, 2])
    pose = PoseStamped()
    pose.pose.position.y = 1.0
    turned = moved(pose).pose
    assert np.allclose([turned.position.x, turned.position.y], [0, 0])
    assert np.allclose([turned.orientation.z, turned.orientation.w], about_z(math.pi / 2)[2:])
    polygon = PolygonStamped()
    polygon.polygon.points = [Point32(x=1.0), Point32(y=1.0)]
    corners = [(corner.x, corner.y) for corner in moved(polygon).polygon.points]
    assert np.allclose(corners, [(1, 1), (0, 0)], atol=1e-6)
    covariance = PoseWithCovarianceStamped()
    covariance.pose.covariance = np.diag([1.0, 2, 3, 4, 5, 6]).reshape(36)
    found = np.array(moved(covariance).pose.covariance).reshape(6, 6)
    assert np.allclose(found, np.diag([2.0, 1, 3, 5, 4, 6]))


def test_a_message_may_be_transformed_between_times() -> None:
    from geometry_msgs.msg import PointStamped

    import hprm.ros._tf2_geometry_msgs  # noqa: F401

    buffer = buffer_with(*(stamped("world", "robot", s, (s, 0, 0)) for s in (1, 3)))
    point = PointStamped()
    point.header.frame_id = "robot"
    point.header.stamp = at(1).to_msg()
    assert buffer.transform_full(point, "robot", at(3), "world").point.x == -2.0


def test_types_are_registered_and_converted() -> None:
    class Mine:
        header = stamped("world", "robot").header

    class Other:
        def __init__(self, of: Any) -> None:
            self.of = of

    buffer = buffer_with(stamped("world", "robot", 1))
    Mine.header.stamp = at(1).to_msg()
    with pytest.raises(TypeException, match="Mine'> is not loaded or supported"):
        buffer.transform(Mine(), "robot")
    TransformRegistration().add(Mine, lambda data, transform: data)
    ConvertRegistration().add_convert((Mine, Other), Other)
    result = buffer.transform(Mine(), "robot", new_type=Other)
    assert isinstance(result.of, Mine)
    assert convert(result, Other) is not result
    with pytest.raises(TypeException):
        convert(result, Mine)
    ConvertRegistration().add_to_msg(Other, lambda other: "message")
    ConvertRegistration().add_from_msg(Mine, lambda message: [message])
    assert convert(result, Mine) == ["message"]
    with pytest.raises(_tf2_ros.NotImplementedException):
        BufferInterface().transform(Mine(), "robot")
