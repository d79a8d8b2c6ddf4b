"""What programs of ROS 2 do with bags and names of types: `rosbag2_py`, `rosidl_runtime_py`."""

from __future__ import annotations

import subprocess
import sys
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
from processes import Bench, finish
from rosbags.highlevel import AnyReader

from hprm.ros import _messages, _rosbag2_py, _rosidl_runtime_py
from hprm.ros._messages import class_of
from hprm.ros._rosbag2_py import ConverterOptions, StorageOptions, TopicMetadata
from hprm.ros._rosidl_runtime_py import utilities
from hprm.ros.serialization import deserialize_message, serialize_message

_messages.install()

TEXT = class_of("std_msgs/msg/String")
START = 1_700_000_000_000_000_000


def write(path: Path, storage: str = "mcap") -> None:
    writer = _rosbag2_py.SequentialWriter()
    writer.open(StorageOptions(uri=str(path), storage_id=storage), ConverterOptions("", ""))
    for name in ("/a", "/b", "/empty"):
        writer.create_topic(
            TopicMetadata(name=name, type="std_msgs/msg/String", serialization_format="cdr")
        )
    for at in range(6):
        data = serialize_message(TEXT(data=str(at)))
        writer.write("/a" if at % 2 else "/b", data, START + at * 1_000_000_000)
    writer.close()


def opened(path: Path, storage: str = "") -> _rosbag2_py.SequentialReader:
    reader = _rosbag2_py.SequentialReader()
    reader.open(StorageOptions(str(path), storage), ConverterOptions("", ""))
    return reader


def rest(reader: _rosbag2_py.SequentialReader) -> list[tuple[str, str]]:
    read = []
    while reader.has_next():
        topic, data, time = reader.read_next()
        message = deserialize_message(data, utilities.get_message("std_msgs/msg/String"))
        assert time == START + int(message.data) * 1_000_000_000
        read.append((topic, message.data))
    return read


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_is_written_and_read_message_by_message(tmp_path: Path, storage: str) -> None:
    write(tmp_path / "bag", storage)
    reader = opened(tmp_path / "bag", storage)
    assert [(it.name, it.type) for it in reader.get_all_topics_and_types()] == [
        (name, "std_msgs/msg/String") for name in ("/a", "/b", "/empty")
    ]
    assert rest(reader) == [("/a" if at % 2 else "/b", str(at)) for at in range(6)]
    with pytest.raises(RuntimeError, match="no other message"):
        reader.read_next()
    reader.seek(START + 3_500_000_000)
    assert [text for _, text in rest(reader)] == ["4", "5"]
    reader.seek(0)
    reader.set_filter(_rosbag2_py.StorageFilter(topics=["/a"]))
    assert [text for _, text in rest(reader)] == ["1", "3", "5"]
    reader.seek(0)
    reader.set_filter(_rosbag2_py.StorageFilter(topics_regex="/[bc]"))
    assert reader.read_next()[0] == "/b"
    reader.reset_filter()
    assert [text for _, text in rest(reader)] == ["1", "2", "3", "4", "5"]
    with AnyReader([tmp_path / "bag"]) as other:
        assert [it.topic for it in other.connections] == ["/a", "/b", "/empty"]


def test_metadata_are_those_of_the_bag(tmp_path: Path) -> None:
    write(tmp_path / "bag")
    found = _rosbag2_py.Info().read_metadata(str(tmp_path / "bag"), "mcap")
    assert (found.storage_identifier, found.message_count) == ("mcap", 6)
    assert found.duration == timedelta(seconds=5)
    assert found.starting_time.timestamp() == 1_700_000_000
    assert found.relative_file_paths == ["bag.mcap"]
    counts = {it.topic_metadata.name: it.message_count for it in found.topics_with_message_count}
    assert counts == {"/a": 3, "/b": 3, "/empty": 0}


def test_mistakes_are_runtime_errors(tmp_path: Path) -> None:
    write(tmp_path / "bag")
    path = str(tmp_path / "bag")
    reader, writer = _rosbag2_py.SequentialReader(), _rosbag2_py.SequentialWriter()
    new = StorageOptions(str(tmp_path / "new"))
    wrong: list[tuple[Any, str]] = [
        (lambda: reader.has_next(), "call open first"),
        (lambda: writer.write("/a", b"", 0), "call open first"),
        (lambda: reader.open_uri("none"), "there is no bag none"),
        (lambda: reader.open(StorageOptions(path, "sqlite3")), "has the format mcap, not sqlite3"),
        (lambda: writer.open(StorageOptions(path)), "exists already"),
        (lambda: writer.open(StorageOptions("x", snapshot_mode=True)), "no StorageOptions.snap"),
        (lambda: writer.open(new, ConverterOptions("json", "")), "is cdr, not 'json'"),
    ]
    for call, words in wrong:
        with pytest.raises(RuntimeError, match=words):
            call()
    writer.open(new)
    for topic in (
        TopicMetadata(name="/x", type="std_msgs/msg/Strin"),
        TopicMetadata(name="/x", type="std_msgs/msg/String", serialization_format="json"),
    ):
        with pytest.raises(RuntimeError):
            writer.create_topic(topic)
    with pytest.raises(RuntimeError, match="the topic /x is not in the bag; call create_topic"):
        writer.write("/x", b"", 0)
    writer.close()


def test_a_bag_that_the_program_does_not_close_is_whole_when_it_ends(tmp_path: Path) -> None:
    program = (
        "from hprm.ros import _messages; _messages.install()\n"
        "from hprm.ros import _rosbag2_py as rosbag2_py\n"
        "from hprm.ros.serialization import serialize_message\n"
        "from std_msgs.msg import String\n"
        "writer = rosbag2_py.SequentialWriter()\n"
        "writer.open(rosbag2_py.StorageOptions(uri='bag'), rosbag2_py.ConverterOptions('', ''))\n"
        "topic = rosbag2_py.TopicMetadata(0, 'chatter', 'std_msgs/msg/String', 'cdr')\n"
        "writer.create_topic(topic)\n"
        "writer.write('chatter', serialize_message(String(data='x')), 5)\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
    reader = opened(tmp_path / "bag")
    topic, data, time = reader.read_next()
    assert (topic, deserialize_message(data, TEXT).data, time) == ("chatter", "x", 5)


def test_classes_are_found_by_name() -> None:
    assert utilities.get_message("std_msgs/msg/String") is TEXT
    trigger = utilities.get_service("std_srvs/srv/Trigger")
    assert trigger is utilities.get_interface("std_srvs/srv/Trigger")
    assert utilities.get_action("turtlesim/action/RotateAbsolute").Goal().theta == 0.0
    for name, error in [
        ("String", ValueError),
        ("std_msgs/String", ValueError),
        ("std_srvs/srv/Trigger", ValueError),
        ("no_msgs/msg/A", ModuleNotFoundError),
        ("std_msgs/msg/Strin", AttributeError),
    ]:
        with pytest.raises(error):
            utilities.get_message(name)


def test_messages_become_dicts_and_yaml_and_are_filled_from_them() -> None:
    pose = class_of("geometry_msgs/msg/PoseStamped")()
    values = {"header": {"frame_id": "map"}, "pose": {"position": {"x": 1, "z": 2.5}}}
    _rosidl_runtime_py.set_message_fields(pose, values)
    assert (pose.header.frame_id, pose.pose.position.x) == ("map", 1.0)
    assert pose.pose.orientation.w == 1.0
    shown = _rosidl_runtime_py.message_to_ordereddict(pose)
    assert list(shown) == ["header", "pose"] and shown["pose"]["position"]["z"] == 2.5
    again = type(pose)()
    _rosidl_runtime_py.set_message_fields(
        again, yaml.safe_load(_rosidl_runtime_py.message_to_yaml(pose))
    )
    assert again == pose
    path = class_of("nav_msgs/msg/Path")()
    _rosidl_runtime_py.set_message_fields(path, {"poses": [values, pose]})
    assert path.poses == [pose, pose]
    imu = class_of("sensor_msgs/msg/Imu")()
    _rosidl_runtime_py.set_message_fields(imu, {"orientation_covariance": range(9)})
    shown = _rosidl_runtime_py.message_to_ordereddict(imu)
    assert shown["orientation_covariance"] == [float(it) for it in range(9)]
    status = class_of("diagnostic_msgs/msg/DiagnosticStatus")()
    _rosidl_runtime_py.set_message_fields(status, {"level": 2})
    assert (status.level, _rosidl_runtime_py.message_to_ordereddict(status)["level"]) == (b"\2", 2)
    for fields, error in [({"x": 1}, AttributeError), ({"pose": 3}, TypeError), (3, TypeError)]:
        with pytest.raises(error):
            _rosidl_runtime_py.set_message_fields(pose, fields)  # type: ignore[arg-type]
    with pytest.raises(ValueError):
        _rosidl_runtime_py.set_message_fields(pose, {"pose": {"position": {"x": "far"}}})


PROGRAM = """
import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
import rosbag2_py
from rosidl_runtime_py.utilities import get_message
from std_msgs.msg import Int32


class Generator(Node):
    def __init__(self):
        super().__init__("generator")
        self.data = Int32()
        self.writer = rosbag2_py.SequentialWriter()
        storage_options = rosbag2_py.StorageOptions(uri="numbers", storage_id="mcap")
        converter_options = rosbag2_py.ConverterOptions("", "")
        self.writer.open(storage_options, converter_options)
        topic = rosbag2_py.TopicMetadata(
            id=0, name="synthetic", type="std_msgs/msg/Int32", serialization_format="cdr"
        )
        self.writer.create_topic(topic)
        self.timer = self.create_timer(0.01, self.tick)

    def tick(self):
        time = self.get_clock().now().nanoseconds
        self.writer.write("synthetic", serialize_message(self.data), time)
        self.data.data += 1
        if self.data.data == 5:
            raise SystemExit


rclpy.init()
try:
    rclpy.spin(Generator())
finally:
    rclpy.shutdown()
"""


def test_a_node_writes_a_bag_with_the_packages_of_ros(bench: Bench) -> None:
    (bench.folder / "generator.py").write_text(PROGRAM)
    done = finish(bench.call("ros", "run", "generator.py"))
    assert (done.code, done.err) == (0, "")
    reader = opened(bench.folder / "numbers")
    times, values = [], []
    while reader.has_next():
        _, data, time = reader.read_next()
        times.append(time)
        values.append(deserialize_message(data, class_of("std_msgs/msg/Int32")).data)
    assert values == [0, 1, 2, 3, 4]
    assert {b - a for a, b in zip(times, times[1:], strict=False)} == {10_000_000}


def test_the_modules_of_rosbag2_have_what_programs_take_from_them(tmp_path: Path) -> None:
    storage = _rosbag2_py._storage
    write(tmp_path / "bag", storage.get_default_storage_id())
    reader = _rosbag2_py._reader.SequentialReader()
    reader.open(storage.StorageOptions(str(tmp_path / "bag")), storage.ConverterOptions("", ""))
    assert isinstance(reader.get_all_topics_and_types()[0], storage.TopicMetadata)
    assert _rosbag2_py._info.Info is _rosbag2_py.Info
    assert _rosbag2_py._writer.SequentialWriter is _rosbag2_py.SequentialWriter
    with pytest.raises(ImportError, match="hprm bag play"):
        _rosbag2_py.Player  # noqa: B018


@pytest.mark.parametrize(
    ("wanted", "left"),
    [
        ({"regex": "/[ab]", "exclude_topics": ["/b"]}, {"/a"}),
        ({"regex_to_exclude": "/a"}, {"/b"}),
        ({"topics": ["/a", "/b"], "regex_to_exclude": "/.*"}, set()),
        ({"topics_regex": "/b"}, {"/b"}),
    ],
)
def test_topics_are_left_out_by_names_and_expressions(
    tmp_path: Path, wanted: dict[str, Any], left: set[str]
) -> None:
    write(tmp_path / "bag")
    reader = opened(tmp_path / "bag")
    reader.set_filter(_rosbag2_py.StorageFilter(**wanted))
    assert {topic for topic, _ in rest(reader)} == left
