"""Clients and services whose quality of service does not fit do not find one another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from processes import Bench, finish

from hprm.ros import _messages, _offers
from hprm.ros._graph import Endpoint
from hprm.ros.duration import Duration
from hprm.ros.qos import (
    DurabilityPolicy,
    LivelinessPolicy,
    QoSPolicyKind,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_best_available,
)

_messages.install()

PLAIN = QoSProfile(depth=1)
WEAK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ALIVE = QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC)


def endpoint(kind: Any, profile: QoSProfile) -> Endpoint:
    """Describe an end of the one service that there is."""
    return Endpoint(kind, "/node", "/add", "a/srv/B", _offers.described(kind, profile, 1))


@pytest.mark.parametrize(
    ("one", "other", "policy"),
    [
        (PLAIN, PLAIN, None),
        (WEAK, WEAK, None),
        (KEPT, KEPT, None),
        # Both directions count, so it does not matter which of the two offers more.
        (PLAIN, WEAK, QoSPolicyKind.RELIABILITY),
        (PLAIN, KEPT, QoSPolicyKind.DURABILITY),
        (PLAIN, ALIVE, QoSPolicyKind.LIVELINESS),
        (PLAIN, QoSProfile(depth=1, deadline=Duration(seconds=1)), QoSPolicyKind.DEADLINE),
        (PLAIN, QoSProfile(depth=9), None),
        (PLAIN, qos_profile_best_available, None),
        (PLAIN, QoSPresetProfiles.SERVICES_DEFAULT.value, None),
        (PLAIN, QoSPresetProfiles.PARAMETERS.value, None),
        (PLAIN, QoSPresetProfiles.SYSTEM_DEFAULT.value, None),
    ],
)
def test_both_ends_must_offer_what_the_other_one_requests(
    one: QoSProfile, other: QoSProfile, policy: QoSPolicyKind | None
) -> None:
    for of_client, of_service in ((one, other), (other, one)):
        client, service = endpoint("client", of_client), endpoint("service", of_service)
        assert _offers.mismatch(client, service) is _offers.mismatch(service, client) is policy
        found = policy is None
        assert bool(_offers.matched(client, [client, service])) == found
        assert bool(_offers.matched(service, [client, service])) == found
        takes = [
            _offers.Request(taker).takes_call(_offers.Offer(sender).of_call("client", 1, "ask"))
            for sender, taker in ((client, service), (service, client))
        ]
        assert all(takes) == found
        elsewhere = _offers.call_from_elsewhere("client", 1, "ask")
        assert _offers.Request(service).takes_call(elsewhere)


HEAD = """\
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def add(request, response):
    print("asked", request.a, flush=True)
    response.sum = request.a + request.b
    return response


rclpy.init()
"""

#: Neither of two clients that do not fit finds its service, until there is another one.
BOTH = """
node = Node("both")
node.create_service(AddTwoInts, "plain", add)
node.create_service(AddTwoInts, "weak", add, qos_profile=weak)
plain = node.create_client(AddTwoInts, "weak")
other = node.create_client(AddTwoInts, "plain", qos_profile=weak)
print(plain.wait_for_service(0.1), other.wait_for_service(0.1))
lost = [it.call_async(AddTwoInts.Request(a=1)) for it in (plain, other)]
rclpy.spin_once(node, timeout_sec=0.1)
rclpy.spin_once(node, timeout_sec=0.1)
print([it.done() for it in lost], plain.service_is_ready(), other.service_is_ready())
node.create_service(AddTwoInts, "weak", add)
print(plain.wait_for_service(1.0), other.service_is_ready())
future = plain.call_async(AddTwoInts.Request(a=2, b=3))
rclpy.spin_until_future_complete(node, future)
print(future.result().sum)
"""

CLIENT = "[both]: New service discovered on '/{}', with incompatible QoS. No responses"
SERVICE = "[both]: New client discovered on service '/{}', with incompatible QoS. No responses"


def test_a_client_does_not_find_a_service_that_does_not_fit(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "both.py").write_text(HEAD + BOTH)
    outcome = finish(bench.call("ros", "run", "--fast", "true", "both.py"))
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == [
        "False False",
        # A request that is sent all the same arrives if only the response does not fit.
        "asked 1",
        "[False, False] False False",
        "True False",
        # Two services have the name, and the response counts of the one that fits.
        "asked 2",
        "asked 2",
        "5",
    ]
    warned = [it for it in outcome.err.splitlines() if "incompatible QoS" in it]
    assert len(warned) == 4, outcome.err
    for text in (CLIENT, SERVICE):
        for name in ("plain", "weak"):
            assert sum(text.format(name) in it for it in warned) == 1, outcome.err
    assert all(it.endswith("Last incompatible policy: RELIABILITY") for it in warned)


SERVES = """
asked = []


def once(request, response):
    asked.append(request)
    return add(request, response)


def tick():
    if asked:
        raise SystemExit


node = Node("serves")
node.create_service(AddTwoInts, "add", once, qos_profile=weak)
node.create_timer(1.0, tick)
rclpy.spin(node)
"""

ASKS = """
node = Node("asks")
client = node.create_client(AddTwoInts, "add")
print("found", client.wait_for_service(0.2), flush=True)
fits = node.create_client(AddTwoInts, "add", qos_profile=weak)
print("found", fits.wait_for_service(5.0), flush=True)
future = fits.call_async(AddTwoInts.Request(a=4, b=5))
rclpy.spin_until_future_complete(node, future)
print("sum", future.result().sum, flush=True)
"""


def test_so_it_is_of_services_of_other_scripts(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "serves.py").write_text(HEAD + SERVES)
    (tmp_path / "asks.py").write_text(HEAD + ASKS)
    scripts = ["serves.py", "+", "asks.py"]
    outcome = finish(bench.call("ros", "run", "--fast", "true", *scripts))
    assert outcome.code == 0, outcome.err
    lines = outcome.out.splitlines()
    assert [it for it in lines if "asks" in it] == [
        "[asks-2] found False",
        "[asks-2] found True",
        "[asks-2] sum 9",
    ], outcome.err
    assert [it for it in lines if "serves" in it] == ["[serves-1] asked 4"]
    assert outcome.err.count("New service discovered on '/add'") == 1, outcome.err
    assert outcome.err.count("New client discovered on service '/add'") == 1, outcome.err
