"""What a launch file starts later, what it shows, and what it hands to a shell."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish, hear

EARLY = """
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node
from std_msgs.msg import Int64


class Early(Node):
    def __init__(self):
        super().__init__("early")
        self.count = 0
        self.publisher = self.create_publisher(Int64, "count", 10)
        self.client = self.create_client(AddTwoInts, "add")
        print("serves", self.client.wait_for_service(), flush=True)
        self.create_timer(0.1, self.tick)

    def tick(self):
        self.count += 1
        self.publisher.publish(Int64(data=self.count))
        if self.count == 1:
            self.asked = self.get_clock().now()
            future = self.client.call_async(AddTwoInts.Request(a=1, b=2))
            future.add_done_callback(self.tell)

    def tell(self, future):
        waited = self.get_clock().now() - self.asked
        print("sum", future.result().sum, "after", waited.nanoseconds // 1000000, "ms", flush=True)


rclpy.init()
rclpy.spin(Early())
"""

LATER = """
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node
from std_msgs.msg import Int64


class Later(Node):
    def __init__(self):
        super().__init__("later")
        self.create_subscription(Int64, "count", self.hear, 10)
        self.create_service(AddTwoInts, "add", self.add)
        self.create_timer(0.1, lambda: print("timer", flush=True))

    def add(self, request, response):
        response.sum = request.a + request.b
        return response

    def hear(self, message):
        print("count", message.data, flush=True)
        if message.data == 8:
            raise SystemExit


rclpy.init()
rclpy.spin(Later())
"""

LAUNCH = """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, TimerAction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

def generate_launch_description():
    robot = LaunchConfiguration("robot")
    return LaunchDescription([
        DeclareLaunchArgument("robot", description="its name"),
        DeclareLaunchArgument("camera", default_value=[robot, "/camera"]),
        Node(executable="early.py"),
        TimerAction(period=0.55, actions=[
            Node(executable="later.py"),
            ExecuteProcess(cmd=["echo", "$((40", "+", "2))"], shell=True, name="shell"),
        ]),
        Node(package="nowhere", executable="x", condition=IfCondition(robot)),
    ])
"""


@pytest.fixture
def launch(tmp_path: Path) -> str:
    (tmp_path / "early.py").write_text(EARLY)
    (tmp_path / "later.py").write_text(LATER)
    (tmp_path / "a.launch.py").write_text(LAUNCH)
    return "a.launch.py"


def test_a_timer_of_a_launch_counts_in_logical_time(bench: Bench, launch: str) -> None:
    process = bench.call("launch", launch, "robot:=false")
    heard = hear(process.stdout, "count 8\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome.code == 130, outcome.err
    lines = [it for it in (heard + outcome.out).splitlines() if "[shell" not in it]
    assert [it for it in lines if "[later" in it] == [
        # What was told before is not for it; its time begins when it does.
        *("[later.py-2] count 6", "[later.py-2] timer", "[later.py-2] count 7"),
        *("[later.py-2] timer", "[later.py-2] count 8"),
    ]
    assert [it for it in lines if "[early" in it] == [
        "[early.py-1] serves True",
        "[early.py-1] sum 3 after 450 ms",
    ]


def test_a_shell_gets_the_whole_command(bench: Bench, launch: str) -> None:
    process = bench.call("launch", launch, "robot:=false")
    hear(process.stdout, "[shell-3] 42\n")
    process.send_signal(signal.SIGINT)
    assert finish(process).code == 130


def test_arguments_are_shown_also_if_one_is_missing(bench: Bench, launch: str) -> None:
    outcome = finish(bench.call("launch", "--show-args", launch))
    assert outcome.code == 0, outcome.err
    assert "'robot':\n        its name\n" in outcome.out


HEAD = """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo
from launch.substitutions import LaunchConfiguration

def generate_launch_description():
"""


@pytest.fixture
def launched(bench: Bench, tmp_path: Path):
    """Start a launch file with one function, by the words behind it."""

    def start(body: str, *words: str) -> Outcome:
        (tmp_path / "one.launch.py").write_text(f"{HEAD}    {body}\n")
        return finish(bench.call("launch", "one.launch.py", *words))

    return start


def test_a_command_that_is_not_there_is_one_error_and_nothing_starts(launched) -> None:
    starts = "ExecuteProcess(cmd=['touch', 'made'])"
    for wrong in ("nosuchcommand", "./nosuchcommand"):
        outcome = launched(f"return LaunchDescription([{starts}, ExecuteProcess(cmd=['{wrong}'])])")
        assert outcome.code == 1
        outcome.assert_one_error(f"there is no command '{wrong}' that can be executed")


@pytest.mark.parametrize(
    ("body", "frames", "last"),
    [
        ("raise ValueError('on purpose')", 1, "ValueError: on purpose"),
        ("ExecuteProcess(cmd=[], comand=[])", 1, "ExecuteProcess has no argument comand"),
        ("return (", 1, "SyntaxError: '(' was never closed"),
    ],
)
def test_what_the_code_of_a_launch_file_raises_is_shown_without_ours(
    launched, body: str, frames: int, last: str
) -> None:
    outcome = launched(body)
    assert outcome.code == 1
    lines = outcome.err.splitlines()
    assert lines[-1].endswith(last)
    assert len([it for it in lines if it.startswith("  File ")]) == frames, outcome.err
    assert "one.launch.py" in outcome.err


def test_an_argument_that_nothing_takes_is_a_warning(launched) -> None:
    body = (
        "return LaunchDescription([DeclareLaunchArgument('a', default_value='1'),"
        " LogInfo(msg=LaunchConfiguration('b', default='2')), ExecuteProcess(cmd=['true'])])"
    )
    outcome = launched(body, "a:=3", "b:=4", "c:=5")
    assert (outcome.code, outcome.out) == (0, "4\n")
    assert outcome.err == "warning: nothing takes the launch argument 'c'\n"


def test_a_launch_file_may_be_named_by_its_package(bench: Bench, tmp_path: Path) -> None:
    folder = tmp_path / "src" / "robot_bringup" / "launch"
    folder.mkdir(parents=True)
    (folder.parent / "package.xml").write_text("<package><name>robot_bringup</name></package>")
    (folder / "robot.launch.xml").write_text(
        "<launch><arg name='says'/><executable cmd='echo $(var says)' on_exit='shutdown'/>"
        "<executable cmd='sleep 100'/></launch>"
    )
    outcome = finish(bench.call("launch", "robot_bringup", "robot.launch.xml", "says:=hello"))
    assert (outcome.code, outcome.out) == (0, "[echo-1] hello\n"), outcome.err
    outcome = finish(bench.call("launch", "robot_bringup", "none.launch.xml"))
    outcome.assert_one_error("has no launch file 'none.launch.xml'")
    (folder / "robot.launch.xml").write_text(
        "<launch><executable cmd='true' on_exit='stay'/></launch>"
    )
    outcome = finish(bench.call("launch", "robot_bringup", "robot.launch.xml"))
    outcome.assert_one_error("on_exit is 'stay': it may be shutdown")


COUNTS = """
import os
import sys
import rclpy
from pathlib import Path
from rclpy.node import Node
from std_msgs.msg import String

LIVES = Path("lives")


class Counts(Node):
    def __init__(self):
        super().__init__("counts")
        self.life = len(LIVES.read_text()) if LIVES.exists() else 0
        LIVES.write_text("x" * (self.life + 1))
        self.publisher = self.create_publisher(String, "count", 10)
        self.count = 0
        self.create_timer(0.05, self.tick)

    def tick(self):
        self.count += 1
        self.publisher.publish(String(data=f"life {self.life} count {self.count}"))
        if self.count == 3:
            if self.life == 0:
                os._exit(3)
            raise SystemExit(self.life % 2)


rclpy.init()
rclpy.spin(Counts())
"""

HEARS = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Hears(Node):
    def __init__(self):
        super().__init__("hears")
        self.heard = []
        self.create_subscription(String, "count", self.hear, 10)
        self.create_timer(0.05, lambda: None)

    def hear(self, message):
        print(message.data, flush=True)
        if message.data == LAST:
            raise SystemExit


rclpy.init()
rclpy.spin(Hears())
"""

RESPAWN = """\
from launch import LaunchDescription
from launch.actions import LogInfo, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessExit
from launch_ros.actions import Node

def generate_launch_description():
    counts = Node(executable="counts.py", respawn=True, respawn_delay=0.1, MORE)
    hears = Node(executable="hears.py", on_exit=Shutdown())
    said = LogInfo(msg="counts has ended")
    return LaunchDescription([
        counts, hears, RegisterEventHandler(OnProcessExit(target_action=counts, on_exit=said)),
    ])
"""


def _respawn(bench: Bench, tmp_path: Path, last: str, more: str = "") -> Outcome:
    (tmp_path / "counts.py").write_text(COUNTS)
    (tmp_path / "hears.py").write_text(HEARS.replace("LAST", repr(last)))
    (tmp_path / "respawn.launch.py").write_text(RESPAWN.replace("MORE", more))
    return finish(bench.call("launch", "--logical-trace", "a.trace", "respawn.launch.py"))


def test_a_node_that_has_ended_comes_back_as_often_as_is_stated(
    bench: Bench, tmp_path: Path
) -> None:
    # It is killed, then fails, then ends well, and the other one hears it each time.
    outcome = _respawn(bench, tmp_path, "life 2 count 3")
    assert outcome.code == 0, outcome.err
    heard = [it for it in outcome.out.splitlines() if "hears.py" in it]
    assert heard == [
        f"[hears.py-2] life {life} count {count}"
        for life in range(3)
        for count in range(1, 4)
        # What it publishes at the tag at which it is killed is lost with it.
        if (life, count) != (0, 3)
    ]
    assert outcome.err.count("process has died") == 2, outcome.err
    # The trace has what all of its processes did.
    lines = [json.loads(it) for it in (tmp_path / "a.trace").read_text().splitlines()]
    sets = [it["port"] for line in lines for it in line.get("sets", ())]
    assert sets.count("Scripts.counts_py.count") >= len(heard)
    # Before the last one, the launch is asked to end.
    assert outcome.out.count("counts has ended\n") in (2, 3)


def test_a_node_comes_back_no_more_often_than_is_stated(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "counts.py").write_text(COUNTS)
    (tmp_path / "one.launch.py").write_text(
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        Node(executable="counts.py", respawn=True, respawn_max_retries=1)
    ])
"""
    )
    outcome = finish(bench.call("launch", "one.launch.py"))
    assert (tmp_path / "lives").read_text() == "xx"
    # That of its last life.
    assert outcome.code == 1, outcome.err


def test_another_program_comes_back(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "other.launch.xml").write_text(
        """\
<launch>
  <executable cmd="sh -c 'echo again; exit 4'" name="other" respawn="true" respawn_delay="0.05"
    respawn_max_retries="2"/>
</launch>
"""
    )
    outcome = finish(bench.call("launch", "other.launch.xml"))
    assert outcome.out.splitlines() == ["[other-1] again"] * 3, outcome.err
    assert outcome.code == 4


def test_a_signal_ends_what_waits_to_come_back(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "other.launch.xml").write_text(
        """<launch><executable cmd="echo once" respawn="true" respawn_delay="1000"/></launch>"""
    )
    process = bench.call("launch", "other.launch.xml")
    hear(process.stdout, "once\n")
    process.send_signal(signal.SIGINT)
    assert finish(process).code == 130


def test_what_a_shell_leaves_running_holds_up_no_end(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "left.launch.xml").write_text(
        """\
<launch>
  <executable cmd="seq 20000; sleep 30 &amp; printf rest" name="left" shell="true"/>
</launch>
"""
    )
    begun = time.monotonic()
    outcome = finish(bench.call("launch", "left.launch.xml"))
    assert time.monotonic() - begun < 25
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines() == [
        *(f"[left-1] {it}" for it in range(1, 20_001)),
        "[left-1] rest",
    ]
