"""Playing bags to scripts, and recording what they publish: `hprm bag play`, `hprm bag record`."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from processes import Bench, Outcome, finish, hear

from hprm.ros import _messages
from hprm.ros._bags import BagReader, BagWriter
from hprm.ros._messages import class_of

_messages.install()

SECOND = 1_000_000_000

TALKER = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.count = 0
        self.create_timer(0.05, self.tick)

    def tick(self):
        self.count += 1
        self.publisher.publish(String(data=f"text {self.count}"))
        if self.count == 10:
            print("all is said", flush=True)


rclpy.init()
rclpy.spin(Talker())
"""

# Says what it has heard, and how many nanoseconds after the first message.
LISTENER = """
import sys
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

TOPIC, WANTED = sys.argv[1], int(sys.argv[2])


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        self.first, self.count = None, 0
        self.create_subscription(String, TOPIC, self.hear, 10)

    def hear(self, message):
        now = self.get_clock().now().nanoseconds
        self.first = now if self.first is None else self.first
        print(message.data, now - self.first, flush=True)
        self.count += 1


rclpy.init()
listener = Listener()
while listener.count < WANTED:
    rclpy.spin_once(listener)
"""


def called(bench: Bench, *words: str) -> subprocess.Popen[str]:
    (bench.folder / "talker.py").write_text(TALKER)
    (bench.folder / "listener.py").write_text(LISTENER)
    return bench.call("bag", *words)


def texts(bag: Path) -> list[tuple[int, str, str]]:
    with BagReader(bag) as reader:
        return [(time, topic, it.data) for time, topic, it in reader.messages()]


@pytest.fixture
def drive(bench: Bench) -> Path:
    """A bag with texts at 0, 100, 100 and 250 ms, and an image."""
    text, image = class_of("std_msgs/msg/String"), class_of("sensor_msgs/msg/Image")
    with BagWriter(bench.folder / "drive", mode="wait") as writer:
        writer.put("/image", image, SECOND, image())
        for milliseconds, data in [(0, "a"), (100, "b"), (100, "c"), (250, "d")]:
            writer.put("/chatter", text, SECOND + milliseconds * 1_000_000, text(data=data))
    return bench.folder / "drive"


def heard(outcome: Outcome) -> list[tuple[str, int]]:
    """What the listener says: texts, and milliseconds of logical time."""
    assert outcome.code == 0, outcome.err
    lines = [it.removeprefix("[listener-2] ").split() for it in outcome.out.splitlines()]
    return [(data, round(int(time) / 1e6)) for data, time in lines]


def play(bench: Bench, *words: str, topic: str = "/chatter", wanted: int = 4) -> Any:
    process = called(bench, "play", *words, "+", "listener.py", topic, str(wanted))
    return heard(finish(process))


def test_messages_are_played_at_the_tags_of_their_times(bench: Bench, drive: Path) -> None:
    assert play(bench, "drive") == [("a", 0), ("b", 100), ("c", 100), ("d", 250)]


def test_a_rate_an_offset_a_choice_and_other_names(bench: Bench, drive: Path) -> None:
    faster = play(bench, "--rate", "2.5", "drive")
    assert faster == [("a", 0), ("b", 40), ("c", 40), ("d", 100)]
    late = play(bench, "drive", "--start-offset", "0.1", wanted=3)
    assert late == [("b", 0), ("c", 0), ("d", 150)]
    options = ["--topic", "/chatter", "--remap", "/chatter:=/news"]
    assert [it for it, _ in play(bench, "drive", *options, topic="/news")] == list("abcd")


def test_a_loop_begins_again_after_the_last_message(bench: Bench, drive: Path) -> None:
    process = called(bench, "play", "--loop", "drive", "+", "listener.py", "/chatter", "10")
    lines = "".join(hear(process.stdout, f"{it} ") for it in ("b", "d", "b", "d"))
    process.send_signal(signal.SIGINT)
    finish(process)
    assert [it.split()[1] for it in lines.splitlines() if it][:7] == list("abcdabc")


def test_a_topic_of_an_unknown_type_is_not_played_and_the_others_are(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    definitions = bench.folder / "elsewhere" / "coded_msgs" / "msg"
    definitions.mkdir(parents=True)
    (definitions / "Code.msg").write_text("int64 code\n")
    monkeypatch.setenv("HPRM_ROS_PACKAGES", str(bench.folder / "elsewhere"))
    text, code = class_of("std_msgs/msg/String"), class_of("coded_msgs/msg/Code")
    with BagWriter(bench.folder / "drive", mode="wait") as writer:
        writer.put("/code", code, 1, code())
        writer.put("/chatter", text, 2, text(data="a"))
    monkeypatch.undo()
    outcome = finish(called(bench, "play", "drive", "+", "listener.py", "/chatter", "1"))
    assert heard(outcome) == [("a", 0)]
    assert "warning: /code is not played" in outcome.err
    assert "the type coded_msgs/msg/Code is not known here" in outcome.err


def test_what_cannot_be_played_is_one_error(bench: Bench) -> None:
    for words, error in [
        (["play", "none"], "there is no bag none"),
        (["record", "--output", "no/bag"], "there is no folder"),
    ]:
        for scripts in ([], ["+", "listener.py", "/chatter", "1"]):
            outcome = finish(called(bench, *words, *scripts))
            assert outcome.code == 1
            outcome.assert_one_error(error)
            assert len(outcome.err.splitlines()) == 1, outcome.err
    with BagWriter(bench.folder / "point", mode="wait") as writer:
        text = class_of("std_msgs/msg/String")
        writer.put("/chatter", text, 1, text())
    finish(called(bench, "play", "--loop", "point")).assert_one_error("takes no time")
    late = called(bench, "play", "--start-offset", "1.5", "point")
    finish(late).assert_one_error("point takes 0 s, and --start-offset 1.5 is after that")
    assert finish(called(bench, "play", "--rate", "0", "point")).code == 2


@pytest.mark.parametrize("words", [["/chatter=std_msgs/msg/String"], ["--wait", "/chatter"], []])
def test_what_a_script_publishes_is_recorded_until_ctrl_c(bench: Bench, words: list[str]) -> None:
    process = called(bench, "record", "--output", "bag", *words, "+", "talker.py")
    told = hear(process.stdout, "all is said\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    recorded = texts(bench.folder / "bag")
    assert {topic for _, topic, _ in recorded} == {"/chatter"}
    assert f"bag: {len(recorded)} messages of 1 topics" in told + outcome.out
    # From some message on, each.
    first = int(recorded[0][2].removeprefix("text "))
    expected = range(first, first + len(recorded))
    assert [data for *_, data in recorded] == [f"text {it}" for it in expected]
    if words and "=" in words[-1]:
        # A connection from the start: no message is missed, and times are those of tags.
        assert first == 1
        assert [it[0] - recorded[0][0] for it in recorded] == [
            it * 50_000_000 for it in range(len(recorded))
        ]


@pytest.mark.parametrize(
    "words", [["play", "point"], ["record", "-o", "bag"], ["record", "-o", "bag", "+", "talker.py"]]
)
def test_ctrl_c_while_a_bag_is_about_to_be_played_or_recorded_is_quiet(
    bench: Bench, words: list[str]
) -> None:
    with BagWriter(bench.folder / "point") as writer:
        kind = class_of("std_msgs/msg/String")
        writer.put("/chatter", kind, 1, kind(data="text"))
    # Python runs this first: the signal comes while the program imports what only it needs.
    (bench.folder / "sitecustomize.py").write_text("""
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "hprm.ros._bags.qualities":
            os.killpg(0, signal.SIGINT)
sys.meta_path.insert(0, Finder())
""")
    process = bench.call("bag", *words, environment={"PYTHONPATH": str(bench.folder)})
    outcome = finish(process)
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "")
    assert not [path.name for path in bench.folder.iterdir() if "bag" in path.name]


def test_two_signals_one_right_after_the_other_are_one(bench: Bench) -> None:
    kind = "/chatter=std_msgs/msg/String"
    process = called(bench, "record", "--output", "bag", kind, "+", "talker.py")
    hear(process.stdout, "all is said\n")
    # As the command `timeout` does, which sends the same one twice: of two kinds, both arrive.
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    assert "messages of 1 topics" in finish(process).out
    assert texts(bench.folder / "bag")


KEEPS = """
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

KEPT = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL)
WEAK = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
rclpy.init()
node = Node("keeps")
"""

OFFERS = """
publishers = [
    node.create_publisher(String, "/kept", KEPT), node.create_publisher(String, "/kept", 10),
    node.create_publisher(String, "/weak", WEAK), node.create_publisher(String, "/quiet", WEAK),
]
count = 0


def tick():
    global count
    count += 1
    for each in publishers[:3]:
        each.publish(String(data=str(count)))
    if count == 10:
        print("all is said", flush=True)


node.create_timer(0.05, tick)
rclpy.spin(node)
"""

TAKES = """
node.create_subscription(String, "/kept", lambda it: print("kept", it.data, flush=True), KEPT)
node.create_subscription(String, "/weak", lambda it: print("weak", it.data, flush=True), WEAK)
node.create_subscription(String, "/weak", print, 10)
node.create_subscription(String, "/a/tf_static", lambda it: print("old", it.data, flush=True), KEPT)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""


def test_a_bag_has_the_quality_of_service_of_publishers_with_which_it_is_played(
    bench: Bench,
) -> None:
    (bench.folder / "offers.py").write_text(KEEPS + OFFERS)
    (bench.folder / "takes.py").write_text(KEEPS + TAKES)
    kinds = [f"/{it}=std_msgs/msg/String" for it in ("kept", "weak", "quiet")]
    process = called(bench, "record", "--output", "bag", *kinds, "+", "offers.py")
    hear(process.stdout, "all is said\n")
    process.send_signal(signal.SIGINT)
    finish(process)
    with BagReader(bench.folder / "bag") as bag:
        found = {
            it.topic: [(each.durability.name, each.depth) for each in it.ext.offered_qos_profiles]
            for it in bag.connections()
        }
    assert found == {
        "/kept": [("TRANSIENT_LOCAL", 3), ("VOLATILE", 10)],
        "/weak": [("VOLATILE", 2)],
        "/quiet": [("VOLATILE", 2)],
    }
    process = called(bench, "play", "bag", "+", "takes.py")
    heard = hear(process.stdout, "weak 3\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    told = [it.removeprefix("[takes-2] ") for it in (heard + outcome.out).splitlines()]
    assert [it for it in told if "kept" in it][:2] == ["kept 1", "kept 1"]
    assert [it for it in told if "weak" in it][:3] == ["weak 1", "weak 2", "weak 3"]
    assert len(told) == len([it for it in told if it.startswith(("kept", "weak"))])
    assert "Last incompatible policy: RELIABILITY" in outcome.err


def test_static_transforms_of_a_bag_without_policies_are_kept(bench: Bench) -> None:
    (bench.folder / "takes.py").write_text(KEEPS + TAKES)
    with BagWriter(bench.folder / "bag", mode="wait") as writer:
        text = class_of("std_msgs/msg/String")
        writer.put("/a/tf_static", text, 1, text(data="one"))
    process = called(bench, "play", "bag", "+", "takes.py")
    hear(process.stdout, "[takes-2] old one\n")
    process.send_signal(signal.SIGINT)
    assert finish(process).err == ""


def test_a_topic_that_is_never_there_is_told(bench: Bench) -> None:
    process = called(bench, "record", "--output", "bag", "/none", "+", "talker.py")
    hear(process.stdout, "all is said\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert "warning: there was no topic /none" in outcome.err
    assert texts(bench.folder / "bag") == []


@pytest.mark.parametrize("words", [["info", "drive"], ["play", "drive"], ["record"]])
def test_without_the_package_that_reads_bags_an_error_says_what_to_install(
    bench: Bench, words: list[str]
) -> None:
    hides = "import sys\nsys.modules['rosbags'] = None\n"
    (bench.folder / "sitecustomize.py").write_text(hides)
    outcome = finish(bench.call("bag", *words, environment={"PYTHONPATH": str(bench.folder)}))
    assert outcome.code == 1
    outcome.assert_one_error("-m pip install 'hprm[ros]'")
    assert len(outcome.err.splitlines()) == 1, outcome.err
