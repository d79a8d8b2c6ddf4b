"""Programs of rclpy that are run as they are: alone, and several as one federation."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest
from processes import ROOT, Bench, Outcome, finish, hear, until

SCRIPTS = ROOT / "tests" / "ros2"

HEAD = """\
import sys
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64, String
from example_interfaces.srv import AddTwoInts
"""


@pytest.fixture
def write(tmp_path: Path):
    """Write scripts, which all begin with the imports."""

    def put(**scripts: str) -> None:
        for name, text in scripts.items():
            (tmp_path / f"{name}.py").write_text(HEAD + text)

    return put


def run(bench: Bench, *words: str) -> Outcome:
    return finish(bench.call("ros", "run", *words))


def told(text: str) -> list[str]:
    """What was logged or printed, without levels, times and numbers of processes."""
    return [re.sub(r"\[INFO\] \[[\d.]+\] ", "", it) for it in text.splitlines()]


def test_a_talker_and_a_listener(bench: Bench) -> None:
    words = [str(SCRIPTS / "talker.py"), "--ros-args", "-p", "period:=0.05"]
    process = bench.call("ros", "run", *words, "+", str(SCRIPTS / "listener.py"))
    heard = hear(process.stderr, "heard: message 5\n")
    # The listener leaves, and the talker goes on.
    heard += hear(process.stderr, "sending: message 7\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome.code == 130
    lines = told(heard)
    assert [it for it in lines if "[listener-2]" in it] == [
        f"[listener-2] [listener]: heard: message {number}" for number in range(1, 6)
    ]


def test_a_script_starts_without_what_it_does_not_use(bench: Bench, write) -> None:
    # Each takes longer to import than all of hprm.ros.
    write(
        alone="""
rclpy.init()
node = Node("alone")
node.create_publisher(String, "news", 10).publish(String(data="first"))
def tick():
    print(sorted({"asyncio", "importlib.resources", "numpy"} & set(sys.modules)))
    raise SystemExit
node.create_timer(0.001, tick)
rclpy.spin(node)
"""
    )
    outcome = run(bench, "alone.py")
    assert (outcome.code, outcome.out, outcome.err) == (0, "[]\n", "")


def test_a_client_finds_its_service_whatever_starts_first(bench: Bench) -> None:
    server, client = (str(SCRIPTS / f"add_{it}.py") for it in ("server", "client"))
    for number, words in enumerate([(server, "+", client, "7"), (client, "7", "+", server)]):
        process = bench.call("ros", "run", *words)
        heard = hear(process.stderr, "7 + 2 is 9\n")
        process.send_signal(signal.SIGINT)
        finish(process)
        label = f"[add_client-{2 - number}] [add_client]: "
        shown = [it for it in told(heard) if it.startswith(label)]
        assert shown == [f"{label}7 + {it} is {7 + it}" for it in range(3)]


MANY = """
rclpy.init()
node = Node(sys.argv[1])
publisher = node.create_publisher(String, "news", 10)
count = 0
def talk():
    global count
    count += 1
    publisher.publish(String(data=f"{node.get_name()} {count}"))
    if count == 20:
        raise SystemExit
node.create_timer(float(sys.argv[2]), talk)
try:
    rclpy.spin(node)
finally:
    rclpy.shutdown()
"""

HEARS = """
rclpy.init()
node = Node("hears")
heard = []
def hear(message):
    heard.append(message.data)
    print(message.data, node.get_clock().now().nanoseconds // 1_000_000 % 10, flush=True)
    if len(heard) == 60:
        raise SystemExit
node.create_subscription(String, "news", hear, 100)
try:
    rclpy.spin(node)
finally:
    rclpy.shutdown()
"""


def test_callbacks_run_in_the_same_order_on_every_run(bench: Bench, write) -> None:
    write(many=MANY, hears=HEARS)
    words = []
    for name, period in [("a", "0.002"), ("b", "0.003"), ("c", "0.001")]:
        words += ["many.py", name, period, "+"]
    outcomes = [run(bench, *words, "hears.py") for _ in range(3)]
    assert [it.code for it in outcomes] == [0, 0, 0], outcomes[0].err
    orders = [[it.split()[1:3] for it in outcome.out.splitlines()] for outcome in outcomes]
    assert orders[0] == orders[1] == orders[2]
    assert len(orders[0]) == 60
    # At 6 ms, the messages of all three have one tag: in the order of the publishers.
    together = [
        orders[0].index([name, number]) for name, number in [("a", "3"), ("b", "2"), ("c", "6")]
    ]
    assert together == [together[0], together[0] + 1, together[0] + 2]


LATE = """
rclpy.init()
node = Node("late")
heard = []
def begin():
    if not node.publishers_made:
        node.publishers_made = node.create_publisher(String, "answers", 10)
        node.create_subscription(String, "news", hear, 100)
def hear(message):
    node.publishers_made.publish(String(data=f"late heard {message.data}"))
    raise SystemExit
node.publishers_made = None
node.create_timer(0.05, begin)
try:
    rclpy.spin(node)
finally:
    rclpy.shutdown()
"""

ASKS = """
rclpy.init()
node = Node("asks")
publisher = node.create_publisher(String, "news", 10)
def answer(message):
    print(message.data, flush=True)
    raise SystemExit
node.create_subscription(String, "answers", answer, 10)
node.create_timer(0.02, lambda: publisher.publish(String(data="this")))
try:
    rclpy.spin(node)
finally:
    rclpy.shutdown()
"""


def test_what_is_made_after_the_start_takes_part(bench: Bench, write) -> None:
    write(late=LATE, asks=ASKS)
    outcome = run(bench, "asks.py", "+", "late.py")
    assert (outcome.code, outcome.out) == (0, "[asks-1] late heard this\n"), outcome.err


ANSWERS = """
rclpy.init()
node = Node("answers")
def leave():
    raise SystemExit
def add(request, response):
    if request.a == 3:
        node.create_timer(0.05, leave)
    response.sum = request.a + request.b
    return response
for name in ("first", "second", "third"):
    node.create_service(AddTwoInts, name, add)
rclpy.spin(node)
"""

ASKS_AT_ONCE = """
rclpy.init()
node = Node("asks")
def tell(asked):
    print("third", asked.result().sum)
    rclpy.shutdown()
def ask():
    timer.cancel()
    client = node.create_client(AddTwoInts, "third")
    client.call_async(AddTwoInts.Request(a=3, b=0)).add_done_callback(tell)
for name in ("first", "second"):
    # The second one is made by a thread that holds a tag, and finds its service at once.
    client = node.create_client(AddTwoInts, name)
    assert client.wait_for_service(5.0)
    asked = client.call_async(AddTwoInts.Request(a=1, b=1))
    rclpy.spin_until_future_complete(node, asked, timeout_sec=5.0)
    print(name, asked.result().sum)
timer = node.create_timer(0.01, ask)
rclpy.spin(node)
"""


def test_a_client_that_is_made_after_the_start_and_asks_at_once_gets_its_response(
    bench: Bench, write
) -> None:
    write(answers=ANSWERS, asks=ASKS_AT_ONCE)
    outcome = run(bench, "asks.py", "+", "answers.py")
    assert outcome.out == "[asks-1] first 2\n[asks-1] second 2\n[asks-1] third 3\n", outcome.err


SPINNING = """
import threading
rclpy.init()
node = Node("spinning")
thread = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
thread.start()
rate = node.create_rate(100)
for number in range(3):
    rate.sleep()
    print("rate", number)
rclpy.shutdown()
"""

POLLING = """
rclpy.init()
node = Node("polling")
count = 0
def tick():
    global count
    count += 1
node.create_timer(0.01, tick)
before = node.get_clock().now()
rclpy.spin_once(node, timeout_sec=0)
assert count == 0
rclpy.spin_once(node, timeout_sec=0.005)
assert count == 0
while rclpy.ok() and count < 3:
    rclpy.spin_once(node, timeout_sec=0.1)
print("polled", count)
rclpy.shutdown()
"""

TASKS = """
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
rclpy.init()
node = Node("tasks")
group = ReentrantCallbackGroup()
def add(request, response):
    response.sum = request.a + request.b
    return response
async def twice(request, response):
    once = await client.call_async(AddTwoInts.Request(a=request.a, b=request.b))
    response.sum = 2 * once.sum
    return response
node.create_service(AddTwoInts, "add", add, callback_group=group)
node.create_service(AddTwoInts, "twice", twice, callback_group=group)
client = node.create_client(AddTwoInts, "add", callback_group=group)
other = node.create_client(AddTwoInts, "twice", callback_group=group)
def ask():
    timer.cancel()
    print("blocking", client.call(AddTwoInts.Request(a=1, b=2)).sum)
    print("awaiting", other.call(AddTwoInts.Request(a=1, b=2)).sum)
    rclpy.shutdown()
timer = node.create_timer(0.01, ask, callback_group=group)
executor = MultiThreadedExecutor()
executor.add_node(node)
try:
    executor.spin()
except rclpy.executors.ExternalShutdownException:
    pass
"""

STUCK = """
rclpy.init()
node = Node("stuck")
client = node.create_client(AddTwoInts, "add")
node.create_service(AddTwoInts, "add", lambda request, response: response)
node.create_timer(0.01, lambda: client.call(AddTwoInts.Request()))
rclpy.spin(node)
"""


@pytest.mark.parametrize(
    ("script", "printed"),
    [
        (SPINNING, "rate 0\nrate 1\nrate 2\n"),
        (POLLING, "polled 3\n"),
        (TASKS, "blocking 3\nawaiting 6\n"),
    ],
    ids=["a rate", "polling", "tasks"],
)
def test_threads_take_turns(bench: Bench, write, script: str, printed: str) -> None:
    write(script=script)
    outcome = run(bench, "script.py")
    assert (outcome.code, outcome.out) == (0, printed), outcome.err


def test_a_call_that_would_wait_for_ever_is_an_error(bench: Bench, write) -> None:
    write(script=STUCK)
    outcome = run(bench, "script.py")
    assert outcome.code == 1
    assert "would wait forever" in outcome.err and "MultiThreadedExecutor" in outcome.err


FAILS = """
rclpy.init()
node = Node("fails")
def fail():
    raise ValueError("on purpose")
node.create_timer(0.01, fail)
rclpy.spin(node)
"""


def test_what_a_callback_raises_ends_its_script_as_in_python(bench: Bench, write) -> None:
    write(script=FAILS)
    outcome = run(bench, "script.py")
    assert outcome.code == 1
    lines = outcome.err.splitlines()
    assert lines[:2] == [
        "Traceback (most recent call last):",
        '  File "script.py", line 12, in <module>',
    ]
    assert lines[-1] == "ValueError: on purpose"


def test_other_scripts_go_on_when_one_has_failed(bench: Bench, write) -> None:
    write(fails=FAILS, late=LATE, asks=ASKS)
    outcome = run(bench, "asks.py", "+", "late.py", "+", "fails.py")
    assert (outcome.code, outcome.out) == (1, "[asks-1] late heard this\n"), outcome.err
    assert "[fails-3] ValueError: on purpose" in outcome.err
    assert "[ERROR] [fails-3]: process has died" in outcome.err


def hears_and(ends: str) -> str:
    return HEARS.replace("def hear", "import os\ndef hear").replace(
        "    heard.append", f"    {ends}\n    heard.append"
    )


SHUTS_DOWN_IN_THE_END = """
rclpy.init()
node = Node("tidy")
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    print("not this")
finally:
    rclpy.shutdown()
"""


def test_a_killed_script_ends_the_federation_with_one_error(bench: Bench, write) -> None:
    killed = hears_and("os.kill(os.getpid(), 9)")
    write(many=MANY.replace("count == 20", "False"), killed=killed, tidy=SHUTS_DOWN_IN_THE_END)
    outcome = run(bench, "many.py", "a", "0.01", "+", "killed.py", "+", "tidy.py")
    assert outcome.code == 128 + signal.SIGKILL
    # The others end without a word of what follows from that.
    (said,) = outcome.err.splitlines()
    assert said.startswith("[ERROR] [killed-2]: process has died [pid "), outcome.err
    assert ", exit code -9, cmd '" in said
    assert bench.left() == set()


def test_a_script_that_ends_without_leaving_is_one_error(bench: Bench, write) -> None:
    write(many=MANY.replace("count == 20", "False"), gone=hears_and("os._exit(0)"))
    outcome = run(bench, "many.py", "a", "0.01", "+", "gone.py")
    assert outcome.code == 1
    error, hint = outcome.err.splitlines()
    assert error == (
        "error: gone-2 has ended without leaving its federation, so the other scripts end"
    )
    assert hint.startswith("  hint: ") and "os._exit()" in hint


TYPES = """
rclpy.init()
node = Node("other")
node.create_publisher(Int64, "news", 10)
rclpy.spin(node)
"""


def test_a_topic_with_two_types_is_one_error(bench: Bench, write) -> None:
    write(many=MANY, other=TYPES)
    outcome = run(bench, "many.py", "a", "0.01", "+", "other.py")
    assert outcome.code != 0
    errors = [it for it in outcome.err.splitlines() if it.startswith("error: ")]
    assert errors == [
        "error: the topic /news has several types: std_msgs/msg/String of the node /a,"
        " std_msgs/msg/Int64 of the node /other"
    ]
    assert bench.left() == set()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.py"], "there is no file none.py"),
        (["+", "none.py"], "there is no script before or behind a +"),
    ],
)
def test_a_script_that_is_not_there_is_one_error(bench: Bench, words: list[str], said: str) -> None:
    outcome = run(bench, *words)
    assert outcome.code == 1
    assert f"error: {said}" in outcome.err


DEPTH = """
import time
rclpy.init()
node = Node("depth")
heard = []
keeps = node.create_subscription(Int64, "numbers", lambda it: heard.append(it.data), 2)
publisher = node.create_publisher(Int64, "numbers", 10)
def talk():
    for number in range(5):
        publisher.publish(Int64(data=number))
timer = node.create_timer(0.01, talk)
rclpy.spin_once(node)
timer.cancel()
while len(heard) < 2:
    rclpy.spin_once(node, timeout_sec=1)
print(heard, keeps.dropped)
rclpy.shutdown()
"""


def test_what_a_queue_drops_is_counted(bench: Bench, write) -> None:
    write(script=DEPTH)
    outcome = run(bench, "script.py")
    assert (outcome.code, outcome.out) == (0, "[3, 4] 3\n"), outcome.err


CHANGED = """
rclpy.init()
node = Node("changed")
heard = []
node.create_subscription(String, "texts", lambda it: heard.append(it.data), 10)
publisher = node.create_publisher(String, "texts", 10)
message = String()
for number in range(3):
    message.data = str(number)
    publisher.publish(message)
while len(heard) < 3:
    rclpy.spin_once(node)
print(heard)
rclpy.shutdown()
"""


def test_a_message_may_be_changed_after_it_was_published(bench: Bench, write) -> None:
    write(script=CHANGED)
    outcome = run(bench, "script.py")
    assert (outcome.code, outcome.out) == (0, "['0', '1', '2']\n"), outcome.err


CAMERA = """
import numpy
from hprm._running import _api
from std_msgs.msg import UInt8MultiArray

class Camera(Node):
    def __init__(self):
        super().__init__("camera")
        self.publisher = self.create_publisher(UInt8MultiArray, "image", QUALITY)
        self.create_timer(0.01, self.take)
        self.count = 0

    def take(self):
        self.count += 1
        image = UInt8MultiArray()
        image.data = numpy.full(1_000_000, self.count, numpy.uint8)
        self.publisher.publish(image)
        if KEEPS:
            self.kept = image
        if self.count == 6:
            self._runtime.request(self.tell)

    def tell(self):
        print("copied", _api(self._runtime._process).store_stats()["bytes_copied"])

rclpy.init()
rclpy.spin(Camera())
"""

VIEWER = """
from std_msgs.msg import UInt8MultiArray

def show(image):
    assert len(image.data) == 1_000_000
    if image.data[-1] == 10:
        raise SystemExit

rclpy.init()
node = rclpy.create_node("viewer")
node.create_subscription(UInt8MultiArray, "image", show, 2)
rclpy.spin(node)
"""


@pytest.mark.parametrize(
    ("keeps", "quality"),
    [(False, "2"), (True, "2"), (False, "rclpy.qos.qos_profile_sensor_data")],
)
def test_an_array_that_only_a_message_has_is_not_copied(
    bench: Bench, write, keeps: bool, quality: str
) -> None:
    camera = CAMERA.replace("KEEPS", str(keeps)).replace("QUALITY", quality)
    write(camera=camera, viewer=VIEWER.replace(", show, 2)", f", show, {quality})"))
    process = bench.call("ros", "run", "camera.py", "+", "viewer.py")
    assert process.stdout is not None
    copied = int(process.stdout.readline().removeprefix("[camera-1] copied "))
    process.send_signal(signal.SIGINT)
    finish(process)
    assert copied >= 5_000_000 if keeps else copied == 0


ENDLESS = """
rclpy.init()
node = Node("endless")
print("begins", flush=True)
rclpy.spin(node)
"""


@pytest.mark.parametrize("scripts", [["script.py"], ["script.py", "+", "script.py"]])
def test_ctrl_c_ends_all(bench: Bench, write, scripts: list[str]) -> None:
    write(script=ENDLESS)
    process = bench.call("ros", "run", *scripts)
    hear(process.stdout, "begins\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome.code in (130, -signal.SIGINT)
    assert "KeyboardInterrupt" in outcome.err
    assert "/hprm/ros/" not in outcome.err, outcome.err
    until(lambda: not bench.left(), "all have ended")


def test_ctrl_c_in_generated_code_is_shown_where_the_script_is(bench: Bench, write) -> None:
    # As where the package is being imported, and a dataclass generates a method.
    write(script='exec("raise KeyboardInterrupt")\n')
    outcome = finish(bench.call("ros", "run", "script.py"))
    assert outcome.code in (130, -signal.SIGINT)
    assert 'File "script.py", line ' in outcome.err
    assert "<string>" not in outcome.err


LAUNCH = """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

def generate_launch_description():
    period = LaunchConfiguration("period")
    return LaunchDescription([
        DeclareLaunchArgument("period", default_value="0.5", description="seconds"),
        Node(package="chat", executable="talker", namespace="robot",
             parameters=[{"period": period}], remappings=[("chatter", "news")]),
        Node(package="chat", executable="hears", namespace="robot",
             remappings=[("chatter", "/robot/news")]),
    ])
"""


def launched(folder: Path) -> None:
    """Write a package with an entry point and a script, and a launch file."""
    package = folder / "chat"
    (package / "chat").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>chat</name></package>")
    (package / "setup.py").write_text(
        "entry_points={'console_scripts': ['talker = chat.talker:main']}\n"
    )
    (package / "chat" / "__init__.py").touch()
    (package / "chat" / "talker.py").write_text((SCRIPTS / "talker.py").read_text())
    (package / "chat" / "hears.py").write_text((SCRIPTS / "listener.py").read_text())
    (folder / "chat.launch.py").write_text(LAUNCH)


def test_a_launch_file_is_one_federation(bench: Bench, tmp_path: Path) -> None:
    launched(tmp_path)
    process = bench.call("launch", "chat.launch.py", "period:=0.05")
    heard = hear(process.stderr, "heard: message 5\n")
    process.send_signal(signal.SIGINT)
    assert finish(process).code == 130
    lines = told(heard)
    assert "[talker-1] [robot.talker]: sending: message 1" in lines
    assert "[hears-2] [robot.listener]: heard: message 1" in lines


def test_a_launch_file_shows_its_arguments(bench: Bench, tmp_path: Path) -> None:
    launched(tmp_path)
    outcome = finish(bench.call("launch", "--show-args", "chat.launch.py"))
    assert outcome.code == 0
    assert "'period':\n        seconds\n        (default: '0.5')" in outcome.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.launch.py"], "none.launch.py"),
        (["chat.launch.py", "period"], "'period' is no launch argument"),
    ],
)
def test_a_launch_that_is_wrong_is_one_error(
    bench: Bench, tmp_path: Path, words: list[str], said: str
) -> None:
    launched(tmp_path)
    outcome = finish(bench.call("launch", *words))
    assert outcome.code == 1
    assert outcome.err.startswith("error: ") and said in outcome.err, outcome.err


OVERRIDDEN = """
from rclpy.qos_overriding_options import QoSOverridingOptions
rclpy.init()
node = Node("overridden")
options = QoSOverridingOptions.with_default_policies()
publisher = node.create_publisher(String, "news", 10, qos_overriding_options=options)
takes = node.create_subscription(String, "news", print, 10, qos_overriding_options=options)
print(publisher.qos_profile.depth, takes.qos_profile.reliability.name)
"""


def test_parameters_change_the_quality_of_service_where_a_program_allows_it(
    bench: Bench, write
) -> None:
    write(script=OVERRIDDEN)
    stated = ["publisher.depth:=3", "subscription.reliability:=best_effort"]
    words = [word for it in stated for word in ("-p", f"qos_overrides./news.{it}")]
    outcome = run(bench, "script.py", "--ros-args", *words)
    assert (outcome.code, outcome.out) == (0, "3 BEST_EFFORT\n"), outcome.err


SLOW = """
import time
rclpy.init()
node = Node("slow")
time.sleep(float(sys.argv[1]))
print("begins", flush=True)
rclpy.spin_once(node, timeout_sec=0.01)
rclpy.shutdown()
"""


def test_a_script_that_others_wait_for_is_named(bench: Bench, write) -> None:
    write(slow=SLOW)
    process = bench.call("ros", "run", "slow.py", "60", "+", "slow.py", "0")
    said = hear(process.stderr, "\n")
    assert said.startswith("warning: scripts begin when all of them spin, and wait for: slow-1\n")
    process.send_signal(signal.SIGINT)
    finish(process)
