"""Parameters of nodes that other programs read, set and follow."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish, hear

OWNER = """
import rclpy
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node


class Owner(Node):
    def __init__(self):
        super().__init__("owner", namespace="robot")
        fixed = ParameterDescriptor(description="never changes", read_only=True)
        self.declare_parameter("speed", 2)
        self.declare_parameter("frame", "base", fixed)
        limited = ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=9)])
        self.declare_parameter("limits.low", 1, limited)
        self.declare_parameter("limits.soft.high", 8)
        self.declare_parameter("anything", 1.5, ParameterDescriptor(dynamic_typing=True))
        self.add_on_set_parameters_callback(self.check)
        self.add_post_set_parameters_callback(self.tell)

    def check(self, parameters):
        if any(it.name == "speed" and it.value > 10 for it in parameters):
            return SetParametersResult(successful=False, reason="too fast")
        return SetParametersResult(successful=True)

    def tell(self, parameters):
        self.get_logger().info(" ".join(f"{it.name}={it.value}" for it in parameters))


rclpy.init()
rclpy.spin(Owner())
"""

CLIENT = """
import rclpy
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

rclpy.init()
node = rclpy.create_node("client")
client = AsyncParameterClient(node, "robot/owner")
print(client.wait_for_services(3.0), client.services_are_ready())


def get(future):
    rclpy.spin_until_future_complete(node, future)
    return future.result()


def show(results):
    for it in results:
        print(it.successful, it.reason)


def values(*names):
    found = get(client.get_parameters(list(names))).values
    print(*[parameter_value_to_python(it) for it in found])


listed = get(client.list_parameters()).result
print(*listed.names, "below", *listed.prefixes)
print(*get(client.list_parameters(["limits"])).result.names)
print(*get(client.list_parameters(["limits", "speed"], 1)).result.names)
print(*get(client.list_parameters(depth=1)).result.names)
values("speed", "frame", "limits.soft.high", "anything")
values("speed", "nothing")
print(get(client.get_parameter_types(["speed", "frame"])).types.tolist())
(described,) = get(client.describe_parameters(["frame"])).descriptors
print(described.name, described.type, described.description, described.read_only)
show(get(client.set_parameters([
    Parameter("speed", value=7),
    Parameter("speed", Parameter.Type.INTEGER, 11),
    Parameter("frame", value="map"),
    Parameter("limits.low", value=10),
    Parameter("speed", value="fast"),
    Parameter("nothing", value=1).to_parameter_msg(),
])).results)
both = [Parameter("speed", value=1), Parameter("limits.low", value=10)]
show([get(client.set_parameters_atomically(both)).result])
values("speed", "limits.low")
show([get(client.set_parameters_atomically([Parameter("speed", value=3)])).result])
show(get(client.delete_parameters(["anything", "speed"])).results)
print(*get(client.list_parameters(depth=1)).result.names)
with open("stated.yaml", "w") as file:
    file.write("robot/owner:\\n  ros__parameters:\\n    speed: 5\\n    limits: {low: 2}\\n")
show(get(client.load_parameter_file("stated.yaml")).results)
values("speed", "limits.low")
print("over", flush=True)
rclpy.spin_once(node, timeout_sec=5)
"""

PRINTED = """\
True True
use_sim_time speed frame limits.low limits.soft.high anything below limits limits.soft
limits.low limits.soft.high
speed limits.low
use_sim_time speed frame anything
2 base 8 1.5

[2, 4]
frame 4 never changes True
True\x20
False too fast
False Trying to set a read-only parameter: frame.
False Parameter limits.low out of range. Min: 0, Max: 9, value: 10
False Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'
False Invalid access to undeclared parameter(s): ['nothing']
False Parameter limits.low out of range. Min: 0, Max: 9, value: 10
7 1
True\x20
True\x20
False Static parameter cannot be undeclared
use_sim_time speed frame
True\x20
True\x20
5 2
over
"""


def run(bench: Bench, *words: str) -> Outcome:
    return finish(bench.call("ros", "run", *words))


def told(text: str, label: str) -> list[str]:
    """What was printed or logged under a label, without levels and times."""
    lines = [it.removeprefix(f"[{label}] ") for it in text.splitlines() if f"[{label}]" in it]
    return [re.sub(r"\[INFO\] \[[\d.]+\] ", "", it) for it in lines]


def test_another_program_reads_and_sets_parameters(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "owner.py").write_text(OWNER)
    (tmp_path / "client.py").write_text(CLIENT)
    process = bench.call("ros", "run", "owner.py", "+", "client.py")
    printed = hear(process.stdout, "over\n")
    process.terminate()
    outcome = finish(process)
    assert "\n".join(told(printed, "client-2")) + "\n" == PRINTED, outcome.err
    assert told(outcome.err, "owner-1")[:5] == [
        "[robot.owner]: speed=7",
        "[robot.owner]: speed=3",
        "[robot.owner]: anything=None",
        "[robot.owner]: speed=5",
        "[robot.owner]: limits.low=2",
    ]


FOLLOWED = """
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_event_handler import ParameterEventHandler

rclpy.init()
node = Node("followed", allow_undeclared_parameters=True)
node.declare_parameter("early", 1)
handler = ParameterEventHandler(node)


def show(parameter):
    print("mine:", parameter.name, parameter_value_to_python(parameter.value), flush=True)


kept = handler.add_parameter_callback("gain", "followed", show)
gone = handler.add_parameter_callback("gain", "/followed", lambda it: print("never"))
handler.remove_parameter_callback(gone)
try:
    handler.remove_parameter_callback(gone)
except RuntimeError as error:
    print(error)
node.declare_parameter("gain", 1.0)
count = 0


def change():
    global count
    count += 1
    if count == 1:
        node.set_parameters([Parameter("gain", value=2.0), Parameter("other", value=True)])
    elif count == 2:
        node.set_parameters_atomically([Parameter("gain", value=3.0), Parameter("other")])
    else:
        raise SystemExit


node.create_timer(0.1, change)
rclpy.spin(node)
"""

FOLLOWS = """
import rclpy
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient

rclpy.init()
node = Node("follows")
count = 0


def show(event):
    global count
    count += 1
    kinds = (event.new_parameters, event.changed_parameters, event.deleted_parameters)
    print(event.node, *["/".join(it.name for it in kind) or "-" for kind in kinds], flush=True)
    if count == 4:
        raise SystemExit


client = AsyncParameterClient(node, "followed")
client.on_parameter_event(show)
rclpy.spin(node)
"""


@pytest.mark.parametrize(
    "order", [("followed", "follows"), ("follows", "followed")], ids=["first", "last"]
)
def test_changes_of_parameters_are_told(
    bench: Bench, tmp_path: Path, order: tuple[str, str]
) -> None:
    (tmp_path / "followed.py").write_text(FOLLOWED)
    (tmp_path / "follows.py").write_text(FOLLOWS)
    outcome = run(bench, f"{order[0]}.py", "+", f"{order[1]}.py")
    assert outcome.code == 0, outcome.err
    assert told(outcome.out, f"followed-{1 + order.index('followed')}") == [
        "Callback doesn't exist",
        "mine: gain 1.0",
        "mine: gain 2.0",
        "mine: gain 3.0",
    ]
    # What was declared before there was a subscription is no event.
    assert told(outcome.out, f"follows-{1 + order.index('follows')}") == [
        "/followed gain - -",
        "/followed - gain -",
        "/followed other - -",
        "/followed - gain other",
    ]


ASKED = """
import rclpy
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient

rclpy.init()
node = Node("asked")
other = Node("other", start_parameter_services=False)
print(len(node._entities), len(dict(node.get_service_names_and_types())))
client = AsyncParameterClient(node, "asked")
print(client.services_are_ready(), AsyncParameterClient(node, "other").services_are_ready())
future = client.get_parameters(["use_sim_time"])
rclpy.spin_until_future_complete(node, future)
print(future.result().values[0].bool_value, len(list(node.services)))
node.destroy_node()
rclpy.shutdown()
"""


def test_a_node_that_nothing_asks_looks_at_no_services(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "asked.py").write_text(ASKED)
    outcome = run(bench, "asked.py")
    assert (outcome.code, outcome.out) == (0, "0 6\nTrue False\nFalse 1\n"), outcome.err


UNTYPED = """
import warnings
import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter


class Named(Node):
    def __init__(self):
        super().__init__("named")
        self.declare_parameter("alone")  # here


rclpy.init()
node = Named()
print(node.get_parameter("alone").value)
# Its type may change.
node.set_parameters([Parameter("alone", value=1)])
node.set_parameters([Parameter("alone", value="text")])
print(node.get_parameter("alone").value)
node.declare_parameters("group", [("one",)])  # and here
warnings.simplefilter("error")
node.declare_parameter("dynamic", descriptor=ParameterDescriptor(dynamic_typing=True))
print(node.get_parameter("dynamic").value)
node.declare_parameter("typed", Parameter.Type.INTEGER)
dynamic = ParameterDescriptor(dynamic_typing=True)
for stated in [
    ("none", None, ParameterDescriptor()),
    ("both", Parameter.Type.INTEGER, dynamic),
    ("unset", Parameter.Type.NOT_SET),
]:
    try:
        node.declare_parameter(*stated)
    except ValueError as error:
        print(error)
    print(node.has_parameter(stated[0]))
"""


def test_a_parameter_that_has_only_a_name_is_warned_of(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "untyped.py").write_text(UNTYPED)
    outcome = run(bench, "untyped.py")
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == [
        "None",
        "text",
        "None",
        "Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET",
        "False",
        "When declaring parameter {both} passing a descriptor with`dynamic_typing=True` is not"
        " allowed when the parameter type is provided",
        "False",
        "Cannot declare parameter {unset} as statically typed of type NOT_SET",
        "False",
    ]
    warned = [line for line in outcome.err.splitlines() if "UserWarning" in line]
    lines = UNTYPED.splitlines()
    for name, words, line in zip(
        ("alone", "group.one"), ("# here", "# and here"), warned, strict=True
    ):
        number = next(at for at, it in enumerate(lines, 1) if words in it)
        said = f"when declaring parameter named '{name}', declaring a parameter only providing its"
        assert re.search(rf"untyped\.py:{number}: UserWarning: {said}", line), outcome.err
