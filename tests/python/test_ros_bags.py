"""Bags of ROS 2 without ROS: what is in them, both formats, recording, damaged files."""

from __future__ import annotations

import array
import importlib
import json
import sqlite3
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import Bench, finish
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hprm.ros import _messages
from hprm.ros._bags import (
    BagError,
    BagInfo,
    BagReader,
    BagWriter,
    Recorded,
    Topic,
    convert,
    writing,
)
from hprm.ros._messages import class_of

_messages.install()

JAZZY = get_typestore(Stores.ROS2_JAZZY)
STORAGES = ["mcap", "sqlite3"]
START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


def other(path: Path, storage: str, store: Any = JAZZY, **definitions: Any) -> Path:
    """A bag that the package ``rosbags`` has written alone: 10 texts and 5 images."""
    plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}[storage]
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        texts = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        images = writer.add_connection("/image", "sensor_msgs/msg/Image", typestore=store)
        kind = store.types["std_msgs/msg/String"]
        for at in range(10):
            data = store.serialize_cdr(kind(f"text {at}"), "std_msgs/msg/String")
            writer.write(texts, START + at * SECOND, data)
            if at % 2 == 0:
                writer.write(images, START + at * SECOND + 1, image_bytes(at))
    return path


def image_bytes(at: int) -> memoryview:
    made = class_of("sensor_msgs/msg/Image")(height=at, data=bytes(range(at)))
    header = JAZZY.types["std_msgs/msg/Header"](
        JAZZY.types["builtin_interfaces/msg/Time"](0, 0), ""
    )
    pixels = np.frombuffer(bytes(made.data), "u1")
    theirs = JAZZY.types["sensor_msgs/msg/Image"](header, at, 0, "", 0, 0, pixels)
    return JAZZY.serialize_cdr(theirs, "sensor_msgs/msg/Image")


def content(path: Path) -> list[tuple[int, str, Any]]:
    with BagReader(path) as bag:
        return list(bag.messages())


def left(folder: Path) -> list[str]:
    return sorted(it.name for it in folder.iterdir())


def damage(bag: Path, storage: str, how: str) -> Path:
    """Cut the file of a bag off, or overwrite what is in the middle of it."""
    [file] = bag.glob("*.mcap" if storage == "mcap" else "*.db3")
    data = bytearray(file.read_bytes())
    if how == "cut off":
        data = data[: len(data) // 2]
    elif how == "empty":
        data = bytearray()
    else:
        data[200:20_000] = b"\xa5" * 19_800
    file.write_bytes(data)
    return bag


@pytest.mark.parametrize("storage", STORAGES)
def test_messages_are_read_in_order_from_an_offset_and_of_some_topics(
    tmp_path: Path, storage: str
) -> None:
    path = other(tmp_path / "bag", storage)
    read = content(path)
    assert [time for time, *_ in read] == sorted(time for time, *_ in read)
    assert [it.data for _, topic, it in read if topic == "/chatter"] == [
        f"text {at}" for at in range(10)
    ]
    images = [it for _, topic, it in read if topic == "/image"]
    assert [(it.height, bytes(it.data)) for it in images] == [
        (at, bytes(range(at))) for at in range(0, 10, 2)
    ]
    assert type(images[0]) is class_of("sensor_msgs/msg/Image")
    with BagReader(path) as bag:
        late = list(bag.messages(["/chatter"], start_offset=7.5))
        assert [it.data for _, _, it in late] == ["text 8", "text 9"]
        assert list(bag.messages(start_offset=100.0)) == []
        with pytest.raises(BagError, match="has no topic /none; it has /chatter, /image"):
            next(bag.messages(["/none"]))


@pytest.mark.parametrize("storage", STORAGES)
def test_info_is_what_is_in_the_bag(tmp_path: Path, storage: str) -> None:
    path = other(tmp_path / "bag", storage)
    [file] = [it for it in path.iterdir() if it.name != "metadata.yaml"]
    topics = [
        Topic("/chatter", "std_msgs/msg/String", 10),
        Topic("/image", "sensor_msgs/msg/Image", 5),
    ]
    expected = BagInfo(
        str(path), [file.name], file.stat().st_size, storage, 15, START, 9 * SECOND, topics
    )
    with BagReader(path) as bag:
        assert bag.info == expected
    with BagReader(file) as bag:
        assert (bag.info.count, bag.info.topics, bag.info.start) == (15, topics, START)
        assert len(list(bag.messages())) == 15


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed_bags_are_read(tmp_path: Path, mode: CompressionMode) -> None:
    writer = Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        texts = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=JAZZY)
        kind = JAZZY.types["std_msgs/msg/String"]
        writer.write(texts, 5, JAZZY.serialize_cdr(kind("x"), "std_msgs/msg/String"))
    [(time, topic, message)] = content(tmp_path / "bag")
    assert (time, topic, message.data) == (5, "/chatter", "x")
    with BagReader(tmp_path / "bag") as bag:
        assert bag.info.storage == "sqlite3"


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_is_converted_there_and_back(tmp_path: Path, storage: str) -> None:
    path = other(tmp_path / "bag", storage)
    there = convert(path, tmp_path / "there")
    back = convert(tmp_path / "there", tmp_path / "back")
    same = convert(path, tmp_path / "same", storage)
    assert {there.storage, back.storage} == set(STORAGES)
    assert back.storage == same.storage == storage
    assert content(path) == content(tmp_path / "there") == content(tmp_path / "back")
    assert left(tmp_path) == ["back", "bag", "same", "there"]
    # Read by other means: with the definitions that the copy has.
    with AnyReader([tmp_path / "there"]) as reader:
        read = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == "/chatter"
        ]
        assert [it.data for it in read] == [f"text {at}" for at in range(10)]  # type: ignore
        digests = {it.digest for it in reader.connections}
        assert digests == {JAZZY.hash_rihs01(it.msgtype) for it in reader.connections}


def test_a_type_that_only_the_bag_has_is_converted_and_is_one_error_for_a_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("int64 num\n", "bagged_msgs/msg/Num"))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        nums = writer.add_connection("/num", "bagged_msgs/msg/Num", typestore=store)
        num = store.types["bagged_msgs/msg/Num"](7)
        writer.write(nums, 1, store.serialize_cdr(num, "bagged_msgs/msg/Num"))
    convert(tmp_path / "bag", tmp_path / "copy")
    with pytest.raises(BagError) as unknown:
        content(tmp_path / "copy")
    assert "the type bagged_msgs/msg/Num is not known here" in str(unknown.value)
    assert "HPRM_ROS_PACKAGES" in str(unknown.value)
    definitions = tmp_path / "definitions" / "bagged_msgs" / "msg"
    definitions.mkdir(parents=True)
    (definitions / "Num.msg").write_text("int64 num\n")
    monkeypatch.setenv("HPRM_ROS_PACKAGES", str(tmp_path / "definitions"))
    importlib.invalidate_caches()
    [(_, _, message)] = content(tmp_path / "copy")
    assert message.num == 7


def test_a_type_with_other_fields_in_the_bag_is_one_error(tmp_path: Path) -> None:
    humble = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        ranges = writer.add_connection("/range", "sensor_msgs/msg/Range", typestore=humble)
        writer.write(ranges, 1, b"\0\1\0\0")
    with pytest.raises(BagError) as wrong:
        content(tmp_path / "bag")
    assert "/range" in str(wrong.value) and "variance is only here" in str(wrong.value)
    convert(tmp_path / "bag", tmp_path / "copy")


def test_an_old_bag_of_sqlite_without_definitions_is_read_and_converted(tmp_path: Path) -> None:
    file = tmp_path / "old.db3"
    text = JAZZY.types["std_msgs/msg/String"]("old")
    with sqlite3.connect(file) as old:
        old.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
            "serialization_format TEXT, offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
            "data BLOB);"
            "INSERT INTO topics VALUES(1, '/chatter', 'std_msgs/msg/String', 'cdr', '');"
        )
        data = JAZZY.serialize_cdr(text, "std_msgs/msg/String")
        old.execute("INSERT INTO messages VALUES(1, 1, 5, ?)", (bytes(data),))
    old.close()
    [(time, _, message)] = content(file)
    assert (time, message.data) == (5, "old")
    convert(file, tmp_path / "new")
    assert content(tmp_path / "new") == content(file)


def test_an_empty_bag_has_no_start(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag"):
        pass
    with BagReader(tmp_path / "bag") as bag:
        assert (bag.info.count, bag.info.start, bag.info.duration) == (0, None, 0)
        assert list(bag.messages()) == []
        assert "Start:             -" in bag.info.text()


DAMAGES = [(storage, how) for storage in STORAGES for how in ("cut off", "empty", "overwritten")]


@pytest.mark.parametrize(("storage", "how"), DAMAGES)
def test_a_damaged_bag_is_one_error_and_no_copy_of_it_is_left(
    tmp_path: Path, storage: str, how: str
) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag, storage=storage) as writer:
        image = class_of("sensor_msgs/msg/Image")
        for at in range(100):
            writer.put("/image", image, at, image(data=bytes([at]) * 1_000))
    damage(bag, storage, how)
    with pytest.raises(BagError, match=str(bag)):
        content(bag)
    with pytest.raises(BagError, match=str(bag)):
        convert(bag, tmp_path / "copy")
    assert left(tmp_path) == ["bag"]


def test_what_is_no_bag_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.txt").write_text("no bag")
    (tmp_path / "one.bag").write_text("#ROSBAG V2.0")
    other(tmp_path / "whole", "mcap")
    (tmp_path / "whole" / "metadata.yaml").unlink()
    wrong = {
        "none": "there is no bag",
        "folder": "it has no metadata.yaml",
        "text.txt": "a bag is a folder, or a file .mcap or .db3",
        "one.bag": "a bag of ROS 1",
        "whole": "has no metadata.yaml; name its file, as",
    }
    for name, words in wrong.items():
        with pytest.raises(BagError) as error:
            BagReader(tmp_path / name)
        assert words in str(error.value)
    (tmp_path / "whole" / "metadata.yaml").write_text("- nothing: [")
    with pytest.raises(BagError, match="is damaged"):
        BagReader(tmp_path / "whole")


def test_a_bag_is_not_overwritten_and_needs_its_folder(tmp_path: Path) -> None:
    bag = other(tmp_path / "bag", "mcap")
    before = content(bag)
    for make in (lambda: convert(bag, bag), lambda: BagWriter(bag)):
        with pytest.raises(BagError, match="exists already"):
            make()
    with pytest.raises(BagError, match="there is no folder"):
        convert(bag, tmp_path / "no" / "copy")
    with pytest.raises(BagError, match="'zip' is no format of bags"):
        convert(bag, tmp_path / "copy", "zip")
    assert (content(bag), left(tmp_path)) == (before, ["bag"])


# Recording.


@pytest.mark.parametrize("storage", STORAGES)
def test_what_is_recorded_is_read_again(tmp_path: Path, storage: str) -> None:
    image, imu = class_of("sensor_msgs/msg/Image"), class_of("sensor_msgs/msg/Imu")
    sent = []
    with BagWriter(tmp_path / "bag", storage=storage, mode="wait", capacity=2) as writer:
        for at in range(20):
            kind, topic = ((image, "/image"), (imu, "/imu"))[at % 2]
            message = kind(data=np.full(at, at, "u1")) if kind is image else imu()
            message.header.stamp.sec = at
            assert writer.put(topic, kind, START + at, message)
            sent.append((START + at, topic, message))
        assert left(tmp_path)[-1] != "bag"
    assert content(tmp_path / "bag") == sent
    assert left(tmp_path) == ["bag"]
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 20


def test_large_arrays_are_read_in_place(tmp_path: Path) -> None:
    image = class_of("sensor_msgs/msg/Image")
    with BagWriter(tmp_path / "bag", mode="wait") as writer:
        for size in (10, 1_000_000):
            writer.put("/image", image, size, image(data=np.full(size, 7, "u1")))
    [(_, _, small), (_, _, large)] = content(tmp_path / "bag")
    assert small.data == array.array("B", [7] * 10)
    assert isinstance(large.data, np.ndarray) and not large.data.flags.writeable
    assert not large.data.flags.owndata
    assert large == image(data=bytes([7]) * 1_000_000)


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """A disk that writes nothing before it is told."""
    goes_on, original = threading.Event(), writing.Draft.write

    def write(self: Any, *arguments: Any) -> None:
        assert goes_on.wait(30)
        original(self, *arguments)

    monkeypatch.setattr(writing.Draft, "write", write)
    return goes_on


def test_where_the_disk_does_not_keep_up_losses_are_counted_and_told(
    tmp_path: Path, slow: threading.Event
) -> None:
    text = class_of("std_msgs/msg/String")
    told: list[str] = []
    writer = BagWriter(tmp_path / "bag", capacity=3, warn=told.append)
    kept = [writer.put("/a", text, at, text(data=str(at))) for at in range(5)]
    kept += [writer.put("/b", text, at, text()) for at in range(2)]
    assert kept == [True] * 3 + [False] * 4
    assert writer.lost == {"/a": 2, "/b": 2}
    slow.set()
    assert writer.close() == Recorded({"/a": 3}, {"/a": 2, "/b": 2})
    assert len(told) == 2
    assert f"the bag {tmp_path / 'bag'} loses messages of /a" in told[0]
    assert [it.data for _, _, it in content(tmp_path / "bag")] == ["0", "1", "2"]
    with BagReader(tmp_path / "bag") as bag:
        assert bag.info.lost == {"/a": 2, "/b": 2}
        assert "Lost:              2 of /a\n                   2 of /b" in bag.info.text()
    assert convert(tmp_path / "bag", tmp_path / "copy").lost == {"/a": 2, "/b": 2}


def test_a_writer_that_waits_loses_nothing(tmp_path: Path, slow: threading.Event) -> None:
    text = class_of("std_msgs/msg/String")
    writer = BagWriter(tmp_path / "bag", mode="wait", capacity=3)
    put: list[int] = []
    has_put = threading.Semaphore(0)

    def produce() -> None:
        for at in range(10):
            writer.put("/a", text, at, text(data=str(at)))
            put.append(at)
            has_put.release()

    producer = threading.Thread(target=produce)
    producer.start()
    for _ in range(3):
        assert has_put.acquire(timeout=30)
    # The fourth is not put while nothing is written.
    producer.join(0.05)
    assert (producer.is_alive(), len(put)) == (True, 3)
    slow.set()
    producer.join()
    assert writer.close() == Recorded({"/a": 10}, {})
    assert [it.data for _, _, it in content(tmp_path / "bag")] == [str(at) for at in range(10)]


def test_large_messages_fill_the_queue_by_their_bytes(
    tmp_path: Path, slow: threading.Event
) -> None:
    image = class_of("sensor_msgs/msg/Image")
    with BagWriter(tmp_path / "bag", capacity_bytes=1_000, warn=lambda _: None) as writer:
        sizes = [5_000, 100, 1_000]
        kept = [writer.put("/i", image, 1, image(data=bytes(size))) for size in sizes]
        slow.set()
    # A message that is larger than the queue passes alone.
    assert kept == [True, False, False]


def test_an_exception_or_a_failure_leaves_no_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = class_of("std_msgs/msg/String")
    with pytest.raises(KeyError), BagWriter(tmp_path / "bag") as writer:
        writer.put("/a", text, 1, text())
        raise KeyError
    assert left(tmp_path) == []
    with pytest.raises(TypeError, match="the messages of /a are String"):
        BagWriter(tmp_path / "bag").put("/a", text, 1, class_of("std_msgs/msg/Int8")())

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing.Draft, "write", full)
    for mode in ("drop", "wait"):
        writer = BagWriter(tmp_path / mode, mode=mode, capacity=1)  # type: ignore[arg-type]
        with pytest.raises(BagError, match="No space left on device"):
            while True:
                writer.put("/a", text, 1, text())
        with pytest.raises(BagError, match="No space left on device"):
            writer.close()
    monkeypatch.undo()
    other(tmp_path / "whole", "mcap")
    monkeypatch.setattr(writing.Draft, "write", full)
    with pytest.raises(BagError, match="No space left on device"):
        convert(tmp_path / "whole", tmp_path / "copy")
    assert not (tmp_path / "copy").exists()


# The command.


def test_the_command_says_what_is_in_bags(bench: Bench) -> None:
    bag = other(bench.folder / "bag", "mcap")
    environment = {"TZ": "UTC"}
    shown = finish(bench.call("bag", "info", "bag", environment=environment))
    size = (bag / "bag.mcap").stat().st_size / 1024
    assert (shown.code, shown.err) == (0, "")
    assert shown.out.splitlines() == [
        "Files:             bag.mcap",
        f"Bag size:          {size:.1f} KiB",
        "Storage id:        mcap",
        "Duration:          9.000000000s",
        "Start:             Nov 14 2023 22:13:20.000000000 (1700000000.000000000)",
        "End:               Nov 14 2023 22:13:29.000000000 (1700000009.000000000)",
        "Messages:          15",
        "Topic information: Topic: /chatter | Type: std_msgs/msg/String | Count: 10 | "
        "Serialization Format: cdr",
        "                   Topic: /image | Type: sensor_msgs/msg/Image | Count: 5 | "
        "Serialization Format: cdr",
    ]
    told = finish(bench.call("bag", "info", "--json", "bag", "bag/bag.mcap"))
    assert [json.loads(it)["count"] for it in told.out.splitlines()] == [15, 15]


def test_the_command_converts(bench: Bench) -> None:
    other(bench.folder / "bag", "mcap")
    done = finish(bench.call("bag", "convert", "bag", "copy"))
    assert (done.code, done.out, done.err) == (0, "copy: 15 messages, sqlite3\n", "")
    assert content(bench.folder / "copy") == content(bench.folder / "bag")
    again = finish(bench.call("bag", "convert", "--storage", "mcap", "copy", "copy"))
    assert (again.code, again.out) == (1, "")
    again.assert_one_error("copy exists already, and is not overwritten")
    finish(bench.call("bag", "info", "none")).assert_one_error("there is no bag none")


def test_ctrl_c_leaves_no_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = other(tmp_path / "bag", "mcap")

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(writing.Draft, "write", interrupt)
    with pytest.raises(KeyboardInterrupt):
        convert(bag, tmp_path / "copy")
    assert left(tmp_path) == ["bag"]
