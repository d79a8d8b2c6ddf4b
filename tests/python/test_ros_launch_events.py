"""What starts in a launch when something happens in it."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish, hear

from hprm.ros._functions import Functions, Late

HEAD = """
import sys
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Int64, String

KEPT = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)
rclpy.init()
"""

# Begins with the launch, and serves.
BASE = """
node = Node("base")
count = 0


def tick():
    global count
    count += 1
    publisher.publish(Int64(data=count))


def add(request, response):
    response.sum = request.a + request.b
    return response


publisher = node.create_publisher(Int64, "count", 10)
node.create_timer(0.02, tick)
node.create_service(AddTwoInts, "add", add)
node.create_subscription(String, "words", lambda it: print("got", it.data, flush=True), 10)
print("base is there", flush=True)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""

# Begins later, under the name that is stated, tells the others, and ends.
LATE = """
node = Node(sys.argv[1])
words = node.create_publisher(String, "words", 10)
client = node.create_client(AddTwoInts, "add")


def take(message):
    node.destroy_subscription(taken)
    assert "base" in node.get_node_names()
    future = client.call_async(AddTwoInts.Request(a=message.data, b=-message.data))
    future.add_done_callback(tell)


def tell(future):
    words.publish(String(data=f"{sys.argv[1]} {future.result().sum}"))
    node.create_timer(0.05, end)


def end():
    raise SystemExit


taken = node.create_subscription(Int64, "count", take, 10)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
finally:
    print(sys.argv[1], "ends", flush=True)
"""

LAUNCH = """
import launch
from launch import LaunchDescription
from launch.actions import *
from launch.event_handlers import *
from launch_ros.actions import Node


def late(name, **options):
    return Node(executable="late.py", arguments=[name], **options)


def sh(command, **options):
    return ExecuteProcess(cmd=["sh", "-c", command], **options)


def generate_launch_description():
    base = Node(executable="base.py")
    short = sh("true", name="short")
"""


@pytest.fixture
def launch(bench: Bench, tmp_path: Path):
    """Run a launch of some actions, and return how it has ended."""

    def start(actions: str, *options: str, end: str | None = None) -> Outcome:
        (tmp_path / "base.py").write_text(HEAD + BASE)
        (tmp_path / "late.py").write_text(HEAD + LATE)
        text = LAUNCH + "".join(f"    {line}\n" for line in actions.strip().splitlines())
        (tmp_path / "a.launch.py").write_text(text)
        process = bench.call("launch", *options, "a.launch.py")
        if end is None:
            return finish(process)
        heard = hear(process.stdout, end)
        process.send_signal(signal.SIGINT)
        outcome = finish(process)
        return Outcome(outcome.code, heard + outcome.out, outcome.err)

    return start


CHAIN = """
first, second = late("first"), late("second")
return LaunchDescription([
    base,
    short,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=[
        LogInfo(msg="short has ended"), TimerAction(period=0.05, actions=[first]),
    ])),
    RegisterEventHandler(OnExecutionComplete(target_action=first, on_completion=[second])),
    RegisterEventHandler(OnProcessStart(target_action=second, on_start=[sh("echo beside")])),
    RegisterEventHandler(OnProcessExit(target_action=second, on_exit=[
        LogInfo(msg="all is done"), Shutdown(),
    ])),
    RegisterEventHandler(OnShutdown(on_shutdown=[LogInfo(msg="the end")])),
])
"""


def test_nodes_start_when_others_have_ended(launch) -> None:
    outcome = launch(CHAIN)
    assert (outcome.code, outcome.err) == (0, "")
    lines = outcome.out.splitlines()
    assert [it for it in lines if "[base.py-1] got" in it] == [
        "[base.py-1] got first 0",
        "[base.py-1] got second 0",
    ]
    told = [it for it in lines if "base" not in it]
    assert told[:2] == ["short has ended", "[late.py-3] first ends"]
    assert sorted(told[2:-2]) == ["[late.py-4] second ends", "[sh-5] beside"]
    assert told[-2:] == ["all is done", "the end"]


# The same for functions, which get what has happened.
FUNCTIONS = """
import sys


def say(*words):
    # A whole line at once: other lines come from another thread.
    sys.stdout.write(" ".join(map(str, words)) + "\\n")


def started(event, context):
    say("started", event.process_name, event.cmd[-1], event.pid > 0)


def ended(event, context):
    say("ended", event.process_name, event.returncode)
    return [late("called"), sh("echo beside")]


def printed(event):
    if b"base is there" in event.text:
        return short


def warned(event):
    return LogInfo(msg=["it says ", event.text.decode().strip()])


def shut(event, context):
    say("shut", event.reason, event.due_to_sigint)
    return LogInfo(msg="bye")


short = sh("echo alas >&2; exit 3", name="short")
return LaunchDescription([
    base,
    RegisterEventHandler(OnProcessStart(target_action=short, on_start=started)),
    RegisterEventHandler(
        OnProcessIO(target_action=base, on_stdout=printed, handle_once=False)
    ),
    RegisterEventHandler(OnProcessIO(target_action=lambda it: it is short, on_stderr=warned)),
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=ended, handle_once=True)),
    RegisterEventHandler(OnShutdown(on_shutdown=shut)),
])
"""


def test_functions_of_handlers_say_what_starts(launch) -> None:
    outcome = launch(FUNCTIONS, end="[base.py-1] got called 0\n")
    assert outcome.code == 130
    assert "[ERROR] [short-2]: process has died" in outcome.err
    lines = outcome.out.splitlines()
    assert "[sh-4] beside" in lines
    said = [it for it in lines if not it.startswith(("[base", "[late", "[sh-4"))]
    assert said == [
        "started short-2 echo alas >&2; exit 3 True",
        "it says alas",
        "ended short-2 3",
        "shut signal SIGINT True",
        "bye",
    ]


EXITS = """
return LaunchDescription([
    sh("exit 0", name="first", on_exit=[base, late("late", on_exit=Shutdown())]),
])
"""


def test_a_federation_may_begin_when_another_program_has_ended(launch) -> None:
    outcome = launch(EXITS, "--logical-trace", "a.trace")
    assert (outcome.code, outcome.err) == (0, "")
    assert "[base.py-2] got late 0" in outcome.out.splitlines()


def test_what_starts_later_is_in_the_logical_trace(launch, bench: Bench) -> None:
    outcome = launch(CHAIN, "--logical-trace", "a.trace")
    assert (outcome.code, outcome.err) == (0, "")
    shown = finish(bench.call("diff", "a.trace", "a.trace"))
    assert shown.code == 0, shown.err


# A node keeps a message for one that begins still later, and a third one goes wrong.
KEEPS = """
node = Node("keeps")
kept = node.create_publisher(String, "kept", KEPT)
kept.publish(String(data="one"))
kept.publish(String(data="two"))
print("keeps", flush=True)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""

GETS = """
import os
import signal

node = Node("gets")


def take(it):
    print("kept", it.data, node.count_publishers("kept"), flush=True)
    if it.data == "two":
        os.kill(os.getpid(), signal.SIGKILL)


node.create_subscription(String, "kept", take, KEPT)
rclpy.spin(node)
"""

WORKS = """
keeps, gets = Node(executable="keeps.py"), Node(executable="gets.py")
return LaunchDescription([
    base,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=keeps)),
    short,
    RegisterEventHandler(OnProcessIO(
        target_action=keeps, on_stdout=lambda event: gets, handle_once=True
    )),
    RegisterEventHandler(OnProcessExit(target_action=gets, on_exit=late("goes_on"))),
])
"""


def test_nodes_that_begin_later_know_one_another_and_the_others_go_on_without_them(
    launch, tmp_path: Path
) -> None:
    (tmp_path / "keeps.py").write_text(HEAD + KEEPS)
    (tmp_path / "gets.py").write_text(HEAD + GETS)
    outcome = launch(WORKS, end="[base.py-1] got goes_on 0\n")
    assert outcome.code == 130
    lines = outcome.out.splitlines()
    assert [it for it in lines if "gets.py" in it] == [
        "[gets.py-4] kept one 1",
        "[gets.py-4] kept two 1",
    ]
    (error,) = outcome.err.splitlines()
    assert "[gets.py-4]: process has died" in error and "exit code -9" in error


DIES = """
import os
import signal

node = Node("dies")
node.create_timer(0.1, lambda: os.kill(os.getpid(), signal.SIGKILL))
rclpy.spin(node)
"""


def test_nothing_joins_a_federation_that_has_failed(launch, tmp_path: Path) -> None:
    (tmp_path / "dies.py").write_text(HEAD + DIES)
    outcome = launch(
        """
dies = Node(executable="dies.py")
exits = RegisterEventHandler(OnProcessExit(target_action=dies, on_exit=late("late")))
return LaunchDescription([base, dies, exits])
"""
    )
    assert outcome.code == 137
    assert (
        "error: late.py-3 cannot take part: its federation has ended, as a script has died that was"
        " there from the start\n"
    ) in outcome.err


SECOND = (
    "RegisterEventHandler(OnProcessExit(target_action=lambda it: it is not base, on_exit=[it]))"
)
# In the launch file itself, so that nothing starts: what is registered, and the error.
NO_HANDLERS = {
    "RegisterEventHandler(base)": "RegisterEventHandler takes a handler such as OnProcessExit, not"
    " <launch_ros.actions.Node>",
    "RegisterEventHandler(OnProcessStart(on_start=[3]))": "3 is no action and no launch"
    " description",
    "RegisterEventHandler(OnShutdown(on_shutdown=launch.events.Shutdown()))": "<launch.events"
    ".Shutdown> is no action and no launch description",
    "RegisterEventHandler(OnShutdown(on_shutdown='text'))": "'text' is no action and no launch"
    " description",
    "RegisterEventHandler(OnProcessIO(on_stdout=[3]))": "OnProcessIO calls functions, not [3]",
    "RegisterEventHandler(OnShutdown(on_shutdown=[GroupAction([object()])]))": "<object object> is"
    " no action and no launch description",
    "sh('true', on_exit=[launch.events.Shutdown()])": "<launch.events.Shutdown> is no action and no"
    " launch description",
    "EmitEvent(event=object())": "EmitEvent of <object object> is not supported: only of"
    " Shutdown()",
}


@pytest.mark.parametrize("action", NO_HANDLERS)
def test_what_is_no_handler_or_no_action_is_an_error_with_its_line(launch, action: str) -> None:
    line = 14 if action.startswith("sh(") else 20
    outcome = launch(f"return LaunchDescription([base, {action}])")
    assert (outcome.code, outcome.out) == (1, "")
    (error,) = outcome.err.splitlines()
    assert error.endswith(f"/a.launch.py:{line}: {NO_HANDLERS[action]}")


def test_what_is_no_handler_is_an_error_in_a_description(launch) -> None:
    actions = "return LaunchDescription([base, RegisterEventHandler(base)])"
    outcome = launch(actions, "--print-description")
    assert (outcome.code, outcome.out) == (1, "")
    assert "a.launch.py:20: RegisterEventHandler takes a handler" in outcome.err


WRONG = {
    "once more": (
        f"""
it = late("late")
return LaunchDescription([
    base, short, sh("sleep 0.05", name="second"),
    {SECOND},
])
""",
        "a.launch.py:23: the process 'late.py' was started before: an action starts one once",
    ),
    "from the beginning": (
        f"""
it = short
return LaunchDescription([
    base, short,
    {SECOND},
])
""",
        "a.launch.py:23: the process 'short' was started before: an action starts one once",
    ),
    "raises": (
        """
return LaunchDescription([
    base, short,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=lambda event, context: 1 / 0)),
])
""",
        "a.launch.py:22: ZeroDivisionError: division by zero",
    ),
    "raises in a library": (
        """
import json
return LaunchDescription([
    base, short,
    RegisterEventHandler(
        OnProcessExit(target_action=short, on_exit=lambda event, context: int.from_bytes([256])),
    ),
])
""",
        "a.launch.py:24: ValueError: bytes must be in range(0, 256)",
    ),
    "ends the interpreter": (
        """
def ended(event, context):
    raise SystemExit(7)


return LaunchDescription([
    base, short, RegisterEventHandler(OnProcessExit(target_action=short, on_exit=ended)),
])
""",
        "a.launch.py:21: SystemExit: 7",
    ),
    "no entity": (
        """
return LaunchDescription([
    base, short,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=lambda event, context: [3])),
])
""",
        "a.launch.py:22: 3 is no action and no launch description",
    ),
    "a text": (
        """
return LaunchDescription([
    base, short,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=lambda event, context: "it")),
])
""",
        "a.launch.py:22: 'it' is no action and no launch description",
    ),
    "a coroutine": (
        """
async def ended(event, context):
    return []


return LaunchDescription([
    base, short,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=ended)),
])
""",
        "a.launch.py:26: its function is a coroutine, which is not supported",
    ),
    "without an end": (
        """
def started(event, context):
    return [sh("exec sleep 60", name="more")]


return LaunchDescription([short, RegisterEventHandler(OnProcessStart(on_start=started))])
""",
        "a.launch.py:24: more is not started: functions of handlers start at most 64 processes that"
        " run at once",
    ),
    "matches nothing": (
        """
return LaunchDescription([
    base, short,
    RegisterEventHandler(OnProcessExit(target_action=lambda action: action.no, on_exit=[])),
])
""",
        "a.launch.py:22: AttributeError: 'ExecuteProcess' object has no attribute 'no'",
    ),
    "too many": (
        """
return LaunchDescription([
    base, short,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=late("first"))),
    RegisterEventHandler(OnProcessIO(target_action=base, on_stdout=lambda it: [
        late(f"late{n}") for n in range(9) if b"got first" in it.text
    ])),
])
""",
        "a.launch.py:23: late.py is not started: functions of handlers start at most 8 nodes once"
        " the others run",
    ),
    "shutdown": (
        """
return LaunchDescription([
    short, RegisterEventHandler(OnShutdown(on_shutdown=lambda event, context: sh("true"))),
])
""",
        "a.launch.py:21: nothing starts in OnShutdown, as in ROS 2: the launch ends",
    ),
    "shutdown, known": (
        """
return LaunchDescription([
    short, RegisterEventHandler(OnShutdown(on_shutdown=[sh("true")])),
])
""",
        "a.launch.py:21: OnShutdown starts no processes, as in ROS 2: the launch ends",
    ),
    "input": (
        """
return LaunchDescription([
    short, RegisterEventHandler(OnProcessIO(target_action=short, on_stdin=print)),
])
""",
        "a.launch.py:21: OnProcessIO with on_stdin is not supported: nothing writes to processes of"
        " a launch",
    ),
    "no target": (
        """
return LaunchDescription([
    short, RegisterEventHandler(OnProcessExit(target_action="short", on_exit=[])),
])
""",
        "a.launch.py:21: 'short' is neither an action that starts a process nor a function",
    ),
    "--fast": (
        """
return LaunchDescription([
    base, sh("true", name="first", on_exit=late("late")),
])
""",
        "a.launch.py:14: with --fast, a handler starts no nodes: they would join at a time of the"
        " clock",
    ),
    "--fast, called": (
        """
return LaunchDescription([
    base,
    RegisterEventHandler(OnProcessIO(target_action=base, on_stdout=lambda event: late("late"))),
])
""",
        "late.py is not started: with --fast, a handler starts no nodes: they would join at a time"
        " of the clock",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_goes_wrong_in_a_handler_is_one_error_and_ends_the_launch(launch, what: str) -> None:
    actions, said = WRONG[what]
    outcome = launch(actions, *(["--fast", "true"] if "--fast" in what else []))
    assert outcome.code == 1
    errors = [it for it in outcome.err.splitlines() if it.startswith("error: ")]
    assert len(errors) == 1 and errors[0].endswith(said), outcome.err
    assert "hprm/ros/" not in outcome.err


# A signal comes in the middle of the start of a process: neither before nor when it runs.
STARTS = """
import os
import signal
import subprocess


class Popen(subprocess.Popen):
    def __init__(self, *args, **kwargs):
        os.kill(os.getpid(), signal.{name})
        super().__init__(*args, **kwargs)


def ended(event, context):
    subprocess.Popen = Popen
    return [sh("true")]


return LaunchDescription([
    sh("exec sleep 60", name="stays"), base, short,
    RegisterEventHandler(OnProcessExit(target_action=short, on_exit=ended)),
])
"""


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_while_a_handler_starts_a_process_ends_the_launch(launch, name: str) -> None:
    outcome = launch(STARTS.format(name=name))
    assert outcome.code == 128 + getattr(signal, name)
    assert "hprm/ros/" not in outcome.err


WAITS = """
import threading


def ended(event, context):
    print("waits", flush=True)
    threading.Event().wait()


return LaunchDescription([
    base, short, RegisterEventHandler(OnProcessExit(target_action=short, on_exit=ended)),
    RegisterEventHandler(OnShutdown(on_shutdown=[LogInfo(msg="bye")])),
])
"""


def test_a_signal_interrupts_a_function_of_a_handler(launch) -> None:
    outcome = launch(WAITS, end="waits\n")
    assert (outcome.code, outcome.err) == (130, "")
    assert "bye" in outcome.out.splitlines()


def test_a_function_of_a_handler_ends_when_the_launch_has_to() -> None:
    functions = Functions()

    def signalled(number: int, frame: object) -> None:
        assert not functions.note(number)
        functions.interrupt()

    before = signal.signal(signal.SIGINT, signalled)
    try:
        functions.until = time.monotonic()
        with pytest.raises(Late):
            functions.call(threading.Event().wait)
        functions.until = time.monotonic() + 60
        assert functions.call(lambda it: it, 1) == 1
    finally:
        signal.signal(signal.SIGINT, before)


# The function returns when all lines are printed, which are more than the pipe and the coordinator
# keep.
PRINTS = """
import os

os.mkfifo("done")


def printed(event):
    if event.text == b"1\\n":
        open("done").read()


prints = sh("seq 20000 && echo > done", name="prints")
return LaunchDescription([
    prints, RegisterEventHandler(OnProcessIO(target_action=prints, on_stdout=printed)),
])
"""


def test_what_processes_print_goes_on_while_a_function_runs(launch) -> None:
    outcome = launch(PRINTS)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines()[-1] == "[prints-1] 20000"


ENDS = """
return LaunchDescription([
    short, RegisterEventHandler(OnProcessStart(
        target_action=lambda it: it is short, on_start=lambda event, context: Shutdown()
    )),
    sh("echo starts", name="last"),
])
"""


def test_nothing_starts_when_the_first_process_has_ended_the_launch(launch) -> None:
    outcome = launch(ENDS)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")


NO_FOLDER = """
lost = ExecuteProcess(cmd=["true"], cwd="nowhere")
return LaunchDescription([sh("exec sleep 60", name="stays"), {}])
"""


@pytest.mark.parametrize("action", ["lost", "sh('true', on_exit=lost)"])
def test_a_process_that_cannot_be_started_is_an_error_and_ends_the_launch(
    launch, action: str
) -> None:
    outcome = launch(NO_FOLDER.format(action))
    assert (outcome.code, outcome.out) == (1, "")
    (error,) = outcome.err.splitlines()
    assert "cannot be started: [Errno 2] No such file or directory: " in error
    assert "nowhere" in error
