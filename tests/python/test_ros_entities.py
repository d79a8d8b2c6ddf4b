"""Entities, executors and clocks where programs of rclpy go beyond one spin from start to end."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

HEAD = """\
import threading
import time
import rclpy
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import ClockType, ROSClock
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.task import Future
from rclpy.time import Time
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("node")
"""


@pytest.fixture
def run(bench: Bench):
    """Run a script, and return the lines it prints."""
    return lambda text, *options: bench.ros_lines(HEAD + text, *options)


DESTROYED = """
rclpy.spin_once(node, timeout_sec=0)
with node.create_publisher(String, "chatter", 10) as publisher:
    with node.create_subscription(String, "chatter", print, 10) as subscription:
        print(publisher.get_subscription_count(), subscription.get_publisher_count())
    print(publisher.get_subscription_count(), subscription.get_publisher_count())
with node.create_service(AddTwoInts, "add", lambda *_: None):
    with node.create_client(AddTwoInts, "add") as client:
        print(client.service_is_ready())
print(client.service_is_ready())
timer = node.create_timer(0.01, lambda: print("never"))
timer.destroy()
timer.destroy()
rclpy.spin_once(node, timeout_sec=0.1)
print(node.destroy_subscription(subscription), node.destroy_subscription(subscription))
node.destroy_node()
print("gone")
"""


def test_entities_are_destroyed_by_themselves_and_once_more_by_their_node(run) -> None:
    assert run(DESTROYED) == ["1 1", "0 0", "True", "False", "True False", "gone"]


ARITY = """
class Any:
    def one(self, message, other=1): print("one", message.data)
    def two(self, message, info): print("two", message.data, "source_timestamp" in info)

wrong = [lambda: 0, lambda a, b, c: 0]
for callback in (Any().one, Any().two, lambda *all: print("all", len(all)), *wrong):
    try:
        node.create_subscription(String, "chatter", callback, 10)
    except RuntimeError as error:
        print("error" if "/chatter" in str(error) else error)
node.create_publisher(String, "chatter", 10).publish(String(data="x"))
for _ in range(3):
    rclpy.spin_once(node, timeout_sec=1)
"""


def test_callbacks_of_subscriptions_take_a_message_or_a_message_with_what_is_known(run) -> None:
    assert run(ARITY) == ["error", "error", "one x", "two x True", "all 1"]


REMOVED = """
executor = SingleThreadedExecutor()
node.create_timer(0.05, lambda: print("never"))
print(executor.add_node(node), executor.add_node(node), len(executor.get_nodes()))
executor.remove_node(node)
executor.spin_once(timeout_sec=0.2)
done = Future()
done.set_result(1)
executor.spin_once_until_future_complete(done)
print(executor.shutdown(wait_for_threads=False))
"""


def test_a_node_that_is_removed_from_an_executor_is_spun_no_more(run) -> None:
    assert run(REMOVED) == ["True False 1", "True"]


AWAITED = """
executor = SingleThreadedExecutor()
async def first():
    return await second + 1
async def other():
    return 1
first = executor.create_task(first)
second = executor.create_task(other)
for _ in range(3):
    executor.spin_once(timeout_sec=0)
    print(first.done(), second.done())
print(first.result())
"""


def test_a_task_that_awaits_another_one_goes_on_as_soon_as_that_is_done(run) -> None:
    assert run(AWAITED) == ["False False", "False True", "True True", "2"]


CHANGED = """
def add(request, response):
    response.sum = request.a + request.b
    return response

node.create_service(AddTwoInts, "add", add)
client = node.create_client(AddTwoInts, "add")
ActionServer(node, Fibonacci, "count", lambda goal: (goal.succeed(), Fibonacci.Result())[1])
action = ActionClient(node, Fibonacci, "count")
rclpy.spin_once(node, timeout_sec=0)
client.call_async(AddTwoInts.Request(a=1)).add_done_callback(lambda it: print(it.result().sum))
sent = action.send_goal_async(Fibonacci.Goal())
sent.add_done_callback(lambda it: print(it.result().accepted))
executor = MultiThreadedExecutor()
for _ in range(2):
    rclpy.spin_until_future_complete(node, sent, executor)
while rclpy.ok() and not executor.spin_once(timeout_sec=0.1) and sent.done():
    break
"""


def test_futures_call_back_in_the_executor_that_a_node_has_when_they_are_done(run) -> None:
    assert sorted(run(CHANGED)) == ["1", "True"]


INFO = """
from rclpy.timer import TimerInfo

def tick(told: TimerInfo):
    time.sleep(0.05)
    last.append(told)

last = []
begin = node.get_clock().now()
timer = node.create_timer(0.1, tick)
while len(last) < 2:
    rclpy.spin_once(node)
for it in last:
    print((it.expected_call_time - it.actual_call_time).nanoseconds <= 0)
print((last[1].expected_call_time - last[0].expected_call_time).nanoseconds)
timer.callback = lambda: print("plain")
rclpy.spin_once(node)
print(TimerInfo(expected_call_time=1, clock_type=ClockType.STEADY_TIME).expected_call_time)
"""


def test_timers_tell_their_callbacks_when_they_were_due(run) -> None:
    shown = "Time(nanoseconds=1, clock_type=STEADY_TIME)"
    assert run(INFO) == ["True", "True", "100000000", "plain", shown]


WOKEN = """
clock = ROSClock()

def sleep(until):
    print(clock.sleep_until(until))

def after(act):
    begin = time.monotonic()
    thread = threading.Thread(target=sleep, args=(clock.now() + Duration(seconds=30),))
    thread.start()
    time.sleep(0.2)
    act()
    thread.join()
    print(time.monotonic() - begin < 8)

after(lambda: clock._set_ros_time_is_active(True))
after(lambda: clock.set_ros_time_override(Time(seconds=40, clock_type=ClockType.ROS_TIME)))
after(lambda: clock._set_ros_time_is_active(False))
"""


def test_threads_that_sleep_by_a_clock_wake_up_when_another_thread_sets_it(run) -> None:
    assert run(WOKEN) == ["False", "True", "True", "True", "False", "True"]


ACTIONS = """
from rclpy.action import get_action_client_names_and_types_by_node
from rclpy.action import get_action_names_and_types
from rclpy.action import get_action_server_names_and_types_by_node

other = rclpy.create_node("other", namespace="deep")
ActionServer(node, Fibonacci, "count", lambda goal: Fibonacci.Result())
ActionClient(other, Fibonacci, "/count")
ActionClient(other, Fibonacci, "more")
print(get_action_names_and_types(node))
print(get_action_server_names_and_types_by_node(node, "node", "/"))
print(get_action_server_names_and_types_by_node(node, "other", "/deep"))
print(get_action_client_names_and_types_by_node(node, "other", "/deep"))
"""


def test_nodes_know_the_actions_of_others(run) -> None:
    kind = "['example_interfaces/action/Fibonacci']"
    both = f"[('/count', {kind}), ('/deep/more', {kind})]"
    assert run(ACTIONS) == [both, f"[('/count', {kind})]", "[]", both]


SIGNALS = """
import os, signal
from rclpy import signals
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

print(signals.get_current_signal_handlers_options())
print(rclpy_implementation.RCLError.__name__)
print(node.get_node_names_and_namespaces_with_enclaves())
signals.install_signal_handlers(SignalHandlerOptions.SIGTERM)
print(signals.get_current_signal_handlers_options().name)
os.kill(os.getpid(), signal.SIGTERM)
while rclpy.ok():
    time.sleep(0.01)
rclpy.try_shutdown()
print(signals.get_current_signal_handlers_options().name, flush=True)
os.kill(os.getpid(), signal.SIGTERM)
print("never")
"""


def test_signals_end_a_program_again_after_the_shutdown(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text(HEAD + SIGNALS)
    outcome = finish(bench.call("ros", "run", "one.py"))
    assert outcome.code in (143, -15), outcome.err
    nodes = "[('node', '/', '/')]"
    assert outcome.out.splitlines() == [
        "SignalHandlerOptions.ALL",
        "RCLError",
        nodes,
        "SIGTERM",
        "NO",
    ]


NAMES = """
from rclpy.event_handler import IncompatibleTypeInfo
from rclpy.event_handler import QoSLivelinessChangedInfo, QoSLivelinessLostInfo
from rclpy.event_handler import QoSMessageLostInfo, QoSPublisherMatchedInfo
from rclpy.event_handler import QoSOfferedDeadlineMissedInfo, QoSOfferedIncompatibleQoSInfo
from rclpy.event_handler import QoSRequestedDeadlineMissedInfo, QoSRequestedIncompatibleQoSInfo
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import HIDDEN_NODE_PREFIX, NodeNameNonExistentError
from rclpy.parameter import PARAMETER_SEPARATOR_STRING
from rclpy.qos import QoSProfile
from rclpy.subscription import MessageInfo
from rclpy.utilities import get_available_rmw_implementations

server = ActionServer(node, Fibonacci, "count", lambda goal: Fibonacci.Result())
server.register_handle_accepted_callback(handle_accepted_callback=None)
print(node.get_fully_qualified_node_names(), get_available_rmw_implementations())
print(HIDDEN_NODE_PREFIX, PARAMETER_SEPARATOR_STRING)
told = []
def missed(event: QoSRequestedDeadlineMissedInfo):
    told.append(event)
qos = QoSProfile(depth=1, deadline=Duration(seconds=0.05))
def hear(message: String, info: MessageInfo):
    print(info["received_timestamp"] == node.get_clock().now().nanoseconds)
node.create_subscription(
    String, "chatter", hear, qos,
    event_callbacks=SubscriptionEventCallbacks(deadline=missed),
)
node.create_publisher(String, "chatter", qos).publish(String())
while not told:
    rclpy.spin_once(node)
print(type(told[0]) is QoSRequestedDeadlineMissedInfo)
try:
    node.get_publisher_names_and_types_by_node("nobody", "/")
except NodeNameNonExistentError:
    print("nobody")
"""


def test_programs_import_the_names_of_rclpy_for_annotations_and_errors(run) -> None:
    assert run(NAMES) == ["['/node'] {'hprm'}", "_ .", "True", "True", "nobody"]
