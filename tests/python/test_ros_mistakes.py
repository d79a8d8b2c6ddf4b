"""Programs of rclpy with mistakes, or that do what is rare: each ends, and says what is wrong."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish, hear, until

HEAD = """\
import sys, threading
import rclpy
from message_filters import Subscriber
from rclpy.action import ActionClient, ActionServer
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from std_msgs.msg import String
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("node")
"""


@pytest.fixture
def run(bench: Bench, tmp_path: Path):
    """Run a script that has a node."""

    def start(text: str, *options: str) -> Outcome:
        (tmp_path / "script.py").write_text(HEAD + text)
        return finish(bench.call("ros", "run", *options, "script.py"))

    return start


ENDLESS = """
calls = []
def tick():
    calls.append(node.get_clock().now().nanoseconds)
    if len(calls) == 100:
        raise SystemExit("later" if calls[-1] > calls[0] else "at one time")
node.create_timer(0, tick)
rclpy.spin(node)
"""


@pytest.mark.parametrize("options", [(), ("--fast", "true")])
def test_a_timer_without_a_period_lets_time_pass(run, options: tuple[str, ...]) -> None:
    outcome = run(ENDLESS, *options)
    assert (outcome.code, outcome.err) == (1, "later\n")


def test_a_timer_has_no_negative_period(run) -> None:
    outcome = run("node.create_timer(-1.0, print)")
    assert outcome.err.endswith(
        "RCLError: failed to create timer: timer period must be non-negative\n"
    )


BLOCKED = """
def block():
    print("blocks", flush=True)
    threading.Event().wait()
node.create_timer(0.01, block)
try:
    rclpy.spin(node, executor=MultiThreadedExecutor())
except KeyboardInterrupt:
    print("ends", flush=True)
"""


def test_a_callback_that_never_returns_in_another_thread_does_not_keep_the_script(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "script.py").write_text(HEAD + BLOCKED)
    # If logical time does not wait for the clock, a script waits for its callbacks when it ends.
    process = bench.call("ros", "run", "--fast", "true", "script.py")
    hear(process.stdout, "blocks\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert (outcome.code, outcome.out) == (0, "ends\n"), outcome.err


def test_a_second_signal_ends_a_script_that_does_not_end(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(HEAD + BLOCKED)
    process = bench.call("ros", "run", "script.py")
    hear(process.stdout, "blocks\n")
    process.send_signal(signal.SIGINT)
    until(lambda: ends_by_signals(process.pid), "Python is at its end")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome == Outcome(-signal.SIGINT, "ends\n", "")
    assert bench.left() == set()


def ends_by_signals(pid: int) -> bool:
    """Whether Ctrl-C ends a process, and Python does not see it."""
    status = Path(f"/proc/{pid}/status").read_text()
    (caught,) = [line.split()[1] for line in status.splitlines() if line.startswith("SigCgt:")]
    return not int(caught, 16) & 1 << signal.SIGINT - 1


RAISES = """
def fail(future):
    raise ValueError(f"on purpose: {future.result().message}")
node.create_service(Trigger, "asked", lambda request, response: response)
client = node.create_client(Trigger, "asked")
node.create_timer(0.01, lambda: client.call_async(Trigger.Request()).add_done_callback(fail))
rclpy.spin(node, executor=EXECUTOR())
"""


@pytest.mark.parametrize("executor", ["SingleThreadedExecutor", "MultiThreadedExecutor"])
def test_what_a_callback_of_a_future_raises_ends_the_script(run, executor: str) -> None:
    outcome = run(RAISES.replace("EXECUTOR", executor))
    assert outcome.code == 1
    assert outcome.err.endswith("ValueError: on purpose: \n"), outcome.err


SHUTS_DOWN = """
node.create_timer(0.01, rclpy.shutdown)
executor = EXECUTOR()
executor.add_node(node)
executor.spin()
print("goes on")
"""


@pytest.mark.parametrize("executor", ["SingleThreadedExecutor", "MultiThreadedExecutor"])
def test_a_callback_may_shut_down_what_spins(run, executor: str) -> None:
    outcome = run(SHUTS_DOWN.replace("EXECUTOR", executor))
    assert (outcome.code, outcome.out) == (0, "goes on\n"), outcome.err


AGAIN = """
def spun(name):
    heard = []
    node = rclpy.create_node(name)
    node.create_subscription(String, "news", lambda it: heard.append(it.data), 10)
    node.create_timer(0.01, lambda: publisher.publish(String(data=name)))
    publisher = node.create_publisher(String, "news", 10)
    while not heard:
        rclpy.spin_once(node)
    print(heard[0], node.get_node_names(), flush=True)
    node.destroy_node()
    rclpy.shutdown()

spun("first")
rclpy.init()
spun("second")
"""


@pytest.mark.parametrize("options", [(), ("--fast", "true")])
def test_a_script_that_runs_alone_may_begin_again(run, options: tuple[str, ...]) -> None:
    outcome = run(AGAIN, *options)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out == "first ['node', 'first']\nsecond ['second']\n"


def test_a_script_that_has_left_others_does_not_come_back(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "again.py").write_text(HEAD + AGAIN)
    (tmp_path / "other.py").write_text(HEAD + "rclpy.spin_once(node, timeout_sec=0.01)")
    outcome = finish(bench.call("ros", "run", "again.py", "+", "other.py"))
    assert outcome.code == 1
    assert "[again-1] first " in outcome.out and "second" not in outcome.out
    assert "RCLError: failed to initialize: this script has left its federation" in outcome.err
    assert "  hint: shut down once, at the end" in outcome.err


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("node.create_service(String, 'a', print)", "String'> is no class of a service"),
        ("node.create_client(String, 'a')", "String'> is no class of a service"),
        ("node.create_publisher(Trigger, 'a', 10)", "Trigger'> is no class of a message"),
        ("node.create_publisher(String(), 'a', 10)", "String'> is no class of a message"),
        ("node.create_subscription('A', 'a', print, 10)", "<class 'str'> is no class of a message"),
        ("Subscriber(node, Trigger, 'a')", "Trigger'> is no class of a message"),
        ("ActionClient(node, Trigger, 'a')", "Trigger'> is no class of an action"),
        ("ActionServer(node, None, 'a', print)", "None is no class of an action"),
        ("node.create_subscription(String, 'a', None, 10)", "callable, and None is not"),
        ("node.create_service(Trigger, 'a', 'b')", "callable, and 'b' is not"),
        (
            "node.create_timer(0.01, lambda: node.create_rate(10).sleep()); rclpy.spin(node)",
            "hint: use the clock's sleep_for(), or a MultiThreadedExecutor",
        ),
    ],
)
def test_what_is_wrong_is_said_where_it_is(run, wrong: str, said: str) -> None:
    outcome = run(wrong)
    assert outcome.code == 1
    assert outcome.err.splitlines()[-1].endswith(said), outcome.err
    assert f"    {wrong}\n" in outcome.err, "the line of the script is shown"


PRINTS = "import sys\nprint(sys.argv[1:], flush=True)\n"


@pytest.mark.parametrize(
    ("words", "command"),
    [
        (["b.py"], "a.py + b.py"),
        (["5", "b.py", "--ros-args", "-r", "x:=y"], "a.py 5 + b.py --ros-args -r x:=y"),
        (["b.py", "c d.py"], "a.py + b.py + 'c d.py'"),
        (["other.py", "--file", "b.py", "none.py"], None),
        (["--ros-args", "b.py"], None),
    ],
)
def test_a_script_that_is_taken_as_an_argument_is_a_warning(
    bench: Bench, tmp_path: Path, words: list[str], command: str | None
) -> None:
    for name in ("a", "b", "c d"):
        (tmp_path / f"{name}.py").write_text("import rclpy\n" + PRINTS)
    (tmp_path / "other.py").write_text(PRINTS)
    outcome = finish(bench.call("ros", "run", "a.py", *words))
    assert (outcome.code, outcome.out) == (0, f"{words}\n")
    if command is None:
        assert outcome.err == ""
        return
    warning, hint = outcome.err.splitlines()
    assert warning.startswith("warning: no script of its own, but an argument of a.py: b.py")
    assert hint == f"  hint: put a + between scripts: hprm ros run {command}"


def test_of_several_scripts_the_warning_comes_once(bench: Bench, tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}.py").write_text("import rclpy\n" + PRINTS)
    outcome = finish(bench.call("ros", "run", "a.py", "b.py", "+", "c.py"))
    assert outcome.code == 0
    assert outcome.err.count("argument of a.py: b.py\n") == 1, outcome.err


UNSERVED = """
from example_interfaces.srv import AddTwoInts
client = node.create_client(AddTwoInts, "add")
print(client.wait_for_service(timeout_sec=0.05), flush=True)
for _ in range(2):
    future = client.call_async(AddTwoInts.Request(a=1))
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.05)
    print(future.done())
"""


@pytest.mark.parametrize("fast", ["true", "false"])
def test_a_service_that_no_node_serves_is_named_once(run, fast: str) -> None:
    outcome = run(UNSERVED, "--fast", fast)
    assert (outcome.code, outcome.out) == (0, "False\nFalse\nFalse\n"), outcome.err
    assert outcome.err == (
        "warning: no node serves /add, so a request is lost, and its response will not come\n"
        "  hint: call wait_for_service() of the client before, and look what it returns\n"
    )


def test_a_type_that_is_not_there_is_one_error(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text("from robot_msgs.msg import Wheel\n")
    outcome = finish(bench.call("ros", "run", "script.py"))
    assert outcome.code == 1
    assert outcome.err.splitlines()[-1] == "ModuleNotFoundError: No module named 'robot_msgs'"
    (tmp_path / "script.py").write_text("from std_msgs.msg import Wheel\n")
    outcome = finish(bench.call("ros", "run", "script.py"))
    assert "ImportError: cannot import name 'Wheel' from 'std_msgs.msg'" in outcome.err
