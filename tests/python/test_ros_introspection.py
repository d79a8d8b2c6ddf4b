"""What services and clients tell of requests and responses: ``rclpy.service_introspection``."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

SERVER = """\
import rclpy
from example_interfaces.srv import AddTwoInts
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_system_default
from rclpy.service_introspection import ServiceIntrospectionState
from std_msgs.msg import Empty


class Server(Node):
    def __init__(self):
        super().__init__("server")
        self.service = self.create_service(AddTwoInts, "add", self.answer)
        self.create_subscription(Empty, "over", self.end, 1)
        self.declare_parameter("tells", "is OFF")
        self.add_on_set_parameters_callback(lambda _: SetParametersResult(successful=True))
        state = ServiceIntrospectionState[self.get_parameter("tells").value.split()[-1]]
        self.service.configure_introspection(
            self.get_clock(), qos_profile_system_default, state
        )

    def answer(self, request, response):
        response.sum = request.a + request.b
        return response

    def end(self, _):
        raise ExternalShutdownException


rclpy.init()
try:
    rclpy.spin(Server())
except ExternalShutdownException:
    pass
"""

CLIENT = """\
import sys
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node
from rclpy.qos import qos_profile_system_default
from rclpy.service_introspection import ServiceIntrospectionState
from std_msgs.msg import Empty

NAMES = ["REQUEST_SENT", "REQUEST_RECEIVED", "RESPONSE_SENT", "RESPONSE_RECEIVED"]


def show(event):
    info = event.info
    assert getattr(info, NAMES[info.event_type]) == info.event_type
    ids.add(tuple(info.client_gid))
    contents = [(it.a, it.b) for it in event.request] + [it.sum for it in event.response]
    print(NAMES[info.event_type], info.sequence_number, contents, flush=True)


ids = set()
rclpy.init()
node = Node("client")
client = node.create_client(AddTwoInts, "add")
client.configure_introspection(
    node.get_clock(), qos_profile_system_default, ServiceIntrospectionState[sys.argv[1]]
)
node.create_subscription(AddTwoInts.Event, "add/_service_event", show, 10)
over = node.create_publisher(Empty, "over", 1)
client.wait_for_service()
for number in (1, 2):
    if number == 2 and len(sys.argv) > 2:
        client.configure_introspection(
            node.get_clock(), qos_profile_system_default, ServiceIntrospectionState[sys.argv[2]]
        )
    future = client.call_async(AddTwoInts.Request(a=number, b=10))
    rclpy.spin_until_future_complete(node, future)
    print("sum", future.result().sum, flush=True)
    for _ in range(10):
        rclpy.spin_once(node, timeout_sec=0.01)
assert all(len(it) == 16 for it in ids) and len(ids) <= 1
over.publish(Empty())
rclpy.shutdown()
"""


@pytest.fixture
def run(bench: Bench, tmp_path: Path):
    """Run both scripts; return what the client prints."""

    def start(server: str, *client: str) -> list[str]:
        (tmp_path / "server.py").write_text(SERVER)
        (tmp_path / "client.py").write_text(CLIENT)
        words = ["server.py", "--ros-args", "-p", f"tells:=is {server}", "+", "client.py", *client]
        outcome = finish(bench.call("ros", "run", *words))
        assert outcome.code == 0, outcome.err
        return [line.partition("] ")[2] for line in outcome.out.splitlines()]

    return start


def told(lines: list[str], *ends: str) -> list[str]:
    return [line for line in lines if line.startswith(ends)]


def test_both_ends_tell_of_messages_with_their_contents(run) -> None:
    lines = run("CONTENTS", "CONTENTS")
    for number in (1, 2):
        request, response = f"[({number}, 10)]", f"[{number + 10}]"
        assert told(lines, f"REQUEST_SENT {number}") == [f"REQUEST_SENT {number} {request}"]
        assert told(lines, f"REQUEST_RECEIVED {number}") == [f"REQUEST_RECEIVED {number} {request}"]
        assert told(lines, f"RESPONSE_SENT {number}") == [f"RESPONSE_SENT {number} {response}"]
        received = told(lines, f"RESPONSE_RECEIVED {number}")
        assert received == [f"RESPONSE_RECEIVED {number} {response}"]
    assert told(lines, "sum") == ["sum 11", "sum 12"]


def test_metadata_has_no_contents_and_each_end_decides_for_itself(run) -> None:
    lines = run("METADATA", "OFF")
    assert told(lines, "REQ", "RESP") == [
        f"{what} {number} []" for number in (1, 2) for what in ("REQUEST_RECEIVED", "RESPONSE_SENT")
    ]


def test_nothing_is_told_unless_it_is_configured(run) -> None:
    assert run("OFF", "OFF") == ["sum 11", "sum 12"]


def test_it_can_be_configured_while_nodes_run(run) -> None:
    lines = run("OFF", "OFF", "CONTENTS")
    assert told(lines, "REQ", "RESP") == ["REQUEST_SENT 2 [(2, 10)]", "RESPONSE_RECEIVED 2 [12]"]
    lines = run("OFF", "METADATA", "OFF")
    assert told(lines, "REQ", "RESP") == ["REQUEST_SENT 1 []", "RESPONSE_RECEIVED 1 []"]


def test_the_class_of_events_is_found_where_those_of_rclpy_are() -> None:
    from hprm.ros import _messages
    from hprm.ros._messages.cdr import SERIALIZER

    _messages.install()
    whole = _messages.class_of("example_interfaces/srv/AddTwoInts")
    event = _messages.class_of("example_interfaces/srv/AddTwoInts_Event")
    assert event is whole.Event and event.__name__ == "AddTwoInts_Event"
    assert event.get_fields_and_field_types() == {
        "info": "service_msgs/ServiceEventInfo",
        "request": "sequence<example_interfaces/AddTwoInts_Request, 1>",
        "response": "sequence<example_interfaces/AddTwoInts_Response, 1>",
    }
    made = event(request=[whole.Request(a=1, b=2)])
    assert SERIALIZER.deserialize(SERIALIZER.serialize(made), event) == made
    with pytest.raises(AssertionError):
        made.request = [whole.Request(), whole.Request()]
    with pytest.raises(LookupError):
        _messages.class_of("std_msgs/msg/String_Event")
    with pytest.raises(LookupError):
        _messages.class_of("example_interfaces/srv/Nothing_Event")
