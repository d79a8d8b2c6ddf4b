"""Nodes with a lifecycle, alone and driven by another program."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish

TALKER = """
import rclpy
from rclpy.lifecycle import Node, SimpleManagedEntity, State, TransitionCallbackReturn
from std_msgs.msg import String


class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.count = 0
        self.talking = self.create_lifecycle_publisher(String, "chatter", 10)

    def on_configure(self, state: State) -> TransitionCallbackReturn:
        self.get_logger().info(f"configures from {state.label} ({state.state_id})")
        self.timer = self.create_timer(0.1, self.talk)
        return super().on_configure(state)

    def on_activate(self, state):
        self.get_logger().info("activates")
        return super().on_activate(state)

    def on_cleanup(self, state):
        self.destroy_timer(self.timer)
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state):
        self.get_logger().info(f"shuts down from {state.label}")
        return TransitionCallbackReturn.SUCCESS

    def talk(self):
        self.count += 1
        self.talking.publish(String(data=f"{self.count}"))


with rclpy.init():
    rclpy.spin(Talker())
"""

MANAGER = """
import rclpy
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.node import Node
from std_msgs.msg import String

rclpy.init()
node = Node("manager")
node.create_subscription(String, "chatter", lambda it: print("heard", it.data), 10)


def tell(event):
    print(f"{event.start_state.label} -> {event.goal_state.label} ({event.goal_state.id})")


node.create_subscription(TransitionEvent, "talker/transition_event", tell, 10)


def call(type_, name, **stated):
    client = node.create_client(type_, f"/talker/{name}")
    client.wait_for_service()
    future = client.call_async(type_.Request(**stated))
    rclpy.spin_until_future_complete(node, future)
    return future.result()


def change(number=0, label=""):
    transition = Transition(id=number, label=label)
    changed = call(ChangeState, "change_state", transition=transition).success
    print(number or label, changed, call(GetState, "get_state").current_state.label)


def listed(name):
    found = call(GetAvailableTransitions, name).available_transitions
    return " ".join(f"{it.transition.label}:{it.start_state.label}" for it in found)


def sleep(seconds):
    until = node.get_clock().now() + rclpy.duration.Duration(seconds=seconds)
    while node.get_clock().now() < until:
        rclpy.spin_once(node, timeout_sec=0.05)


clients = {
    name: node.create_client(type_, f"talker/{name}")
    for name, type_ in [
        ("change_state", ChangeState),
        ("get_state", GetState),
        ("get_available_states", GetAvailableStates),
        ("get_available_transitions", GetAvailableTransitions),
        ("get_transition_graph", GetAvailableTransitions),
    ]
}
change(Transition.TRANSITION_ACTIVATE)
change(Transition.TRANSITION_CONFIGURE)
print(listed("get_available_transitions"))
sleep(0.25)
change(label="activate")
sleep(0.2)
change(Transition.TRANSITION_DEACTIVATE)
change(Transition.TRANSITION_CLEANUP)
change(label="shutdown")
states = call(GetAvailableStates, "get_available_states").available_states
print(" ".join(f"{it.label}:{it.id}" for it in states))
print(listed("get_transition_graph"))
rclpy.shutdown()
"""

PRINTED = """\
3 False unconfigured
unconfigured -> configuring (10)
configuring -> inactive (2)
1 True inactive
cleanup:inactive activate:inactive shutdown:inactive
inactive -> activating (13)
activating -> active (3)
activate True active
heard 3
heard 4
active -> deactivating (14)
deactivating -> inactive (2)
4 True inactive
inactive -> cleaningup (11)
cleaningup -> unconfigured (1)
2 True unconfigured
unconfigured -> shuttingdown (12)
shuttingdown -> finalized (4)
shutdown True finalized
unknown:0 unconfigured:1 inactive:2 active:3 finalized:4 configuring:10 cleaningup:11 \
shuttingdown:12 activating:13 deactivating:14 errorprocessing:15
configure:unconfigured transition_success:configuring transition_failure:configuring \
transition_error:configuring cleanup:inactive transition_success:cleaningup \
transition_failure:cleaningup transition_error:cleaningup activate:inactive \
transition_success:activating transition_failure:activating transition_error:activating \
deactivate:active transition_success:deactivating transition_failure:deactivating \
transition_error:deactivating shutdown:unconfigured shutdown:inactive shutdown:active \
transition_success:shuttingdown transition_failure:shuttingdown transition_error:shuttingdown \
transition_success:errorprocessing transition_failure:errorprocessing \
transition_error:errorprocessing
"""


def run(bench: Bench, *words: str) -> Outcome:
    return finish(bench.call("ros", "run", *words))


def logged(text: str) -> list[str]:
    return [re.sub(r"\[[\d.]+\] ", "", it) for it in text.splitlines()]


def test_another_program_drives_a_lifecycle(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "talker.py").write_text(TALKER)
    (tmp_path / "manager.py").write_text(MANAGER)
    process = bench.call("ros", "run", "manager.py", "+", "talker.py")
    lines: list[str] = []
    assert process.stdout is not None
    while not lines or not lines[-1].startswith("configure:"):
        lines.append(process.stdout.readline().removeprefix("[manager-1] "))
    process.terminate()
    outcome = finish(process)
    assert "".join(lines) == PRINTED, outcome.err
    assert [it for it in logged(outcome.err) if it.startswith("[talker-2]")][:5] == [
        "[talker-2] [WARN] [rcl_lifecycle]: No transition matching 3 found for current state"
        " unconfigured",
        "[talker-2] [ERROR] [talker]: Unable to start transition 3 from current state"
        " (1, 'unconfigured')",
        "[talker-2] [INFO] [talker]: configures from unconfigured (1)",
        "[talker-2] [INFO] [talker]: activates",
        "[talker-2] [INFO] [talker]: shuts down from unconfigured",
    ]


ERRORS = """
import rclpy
from rclpy.lifecycle import LifecycleNode, ManagedEntity, SimpleManagedEntity, State
from rclpy.lifecycle import TransitionCallbackReturn

rclpy.init()


class Fails(LifecycleNode):
    answer = TransitionCallbackReturn.FAILURE
    recovered = TransitionCallbackReturn.SUCCESS

    def on_configure(self, state):
        if self.answer is None:
            raise ValueError("on purpose")
        return self.answer

    def on_error(self, state):
        print("error, before:", state)
        return self.recovered


def show(node, answer):
    print(answer.name, node._state_machine.current_state)


node = Fails("fails", enable_communication_interface=False)
show(node, node.trigger_configure())
node.answer = TransitionCallbackReturn.ERROR
show(node, node.trigger_configure())
node.answer = None
show(node, node.trigger_configure())
node.recovered = TransitionCallbackReturn.ERROR
show(node, node.trigger_configure())
try:
    node.trigger_shutdown()
except RuntimeError as error:
    print(error)


class Light(SimpleManagedEntity):
    @SimpleManagedEntity.when_enabled
    def shine(self, colour):
        print("shines", colour)

    @SimpleManagedEntity.when_enabled(when_not_enabled=lambda: print("is off"))
    def blink(self):
        print("blinks")


class Refuses(ManagedEntity):
    def on_activate(self, state):
        return TransitionCallbackReturn.FAILURE


node = LifecycleNode("lights")
light = Light()
node.add_managed_entity(light)
light.shine("red")
light.blink()
node.trigger_configure()
node.trigger_activate()
light.shine("red")
light.blink()
print(light.is_activated)
node.trigger_deactivate()
node.add_managed_entity(Refuses())
show(node, node.trigger_activate())
try:
    node.add_managed_entity(object())
except TypeError as error:
    print(error)
"""

ERRORS_PRINTED = """\
FAILURE (1, 'unconfigured')
error, before: LifecycleState(label='unconfigured', state_id=1)
ERROR (1, 'unconfigured')
error, before: LifecycleState(label='unconfigured', state_id=1)
ERROR (1, 'unconfigured')
error, before: LifecycleState(label='unconfigured', state_id=1)
ERROR (4, 'finalized')
Shutdown transtion not possible
is off
shines red
blinks
True
FAILURE (2, 'inactive')
Expected a rclpy.lifecycle.ManagedEntity instance.
"""


def test_callbacks_decide_where_a_transition_leads(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "errors.py").write_text(ERRORS)
    outcome = run(bench, "errors.py")
    assert (outcome.code, outcome.out) == (0, ERRORS_PRINTED), outcome.err
    expected = "[ERROR] [fails]: on_configure() has failed: ValueError: on purpose"
    assert logged(outcome.err) == [expected, expected]


EARLY = """
import rclpy
from rclpy.lifecycle import LifecycleNode
from std_msgs.msg import Int64

rclpy.init()
node = LifecycleNode("early")
publisher = node.create_lifecycle_publisher(Int64, "numbers", 10)
node.trigger_configure()
node.trigger_activate()
count = 0


def tick():
    global count
    count += 1
    publisher.publish(Int64(data=count))
    if count == 3:
        raise SystemExit


node.create_timer(0.01, tick)
rclpy.spin(node)
"""

HEARS = """
import rclpy
from lifecycle_msgs.msg import TransitionEvent
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("hears")
heard = []


def hear(what):
    heard.append(what)
    if len(heard) == 7:
        print(*heard, flush=True)
        raise SystemExit


node.create_subscription(Int64, "numbers", lambda it: hear(it.data), 10)
node.create_subscription(
    TransitionEvent, "early/transition_event", lambda it: hear(it.goal_state.label), 10
)
rclpy.spin(node)
"""


@pytest.mark.parametrize("order", [("early.py", "hears.py"), ("hears.py", "early.py")])
def test_a_node_may_activate_itself_before_the_start(
    bench: Bench, tmp_path: Path, order: tuple[str, str]
) -> None:
    (tmp_path / "early.py").write_text(EARLY)
    (tmp_path / "hears.py").write_text(HEARS)
    outcome = run(bench, order[0], "+", order[1])
    assert outcome.code == 0, outcome.err
    label = f"[hears-{order.index('hears.py') + 1}]"
    assert outcome.out == f"{label} configuring inactive activating active 1 2 3\n"
