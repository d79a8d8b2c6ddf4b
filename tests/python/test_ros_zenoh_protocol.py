"""The protocol of rmw_zenoh, as data: keys, hashes, tokens, attachments, and what follows."""

from __future__ import annotations

from dataclasses import asdict

import pytest

import hprm.ros  # noqa: F401
from hprm.ros._graph import BRIDGE, Endpoint
from hprm.ros._messages.hashes import digest, interface
from hprm.ros._offers import elsewhere
from hprm.ros._zenoh import arrivals, attachment, keys, session, tokens
from hprm.ros._zenoh.graph import Outside
from hprm.ros._zenoh.numbers import Numbers
from hprm.ros._zenoh.session import BridgeError, Settings

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING = f"std_msgs::msg::dds_::String_/{HASH}"


def test_keys_have_the_domain_the_name_the_type_and_its_hash() -> None:
    assert keys.key(0, "/chatter", "std_msgs/msg/String", HASH) == f"0/chatter/{STRING}"
    of_robot = keys.key(2, "/robot1/chatter", "std_msgs/msg/String", HASH)
    assert of_robot == f"2/robot1/chatter/{STRING}"
    assert keys.ros_name("std_msgs::msg::dds_::String_") == "std_msgs/msg/String"
    assert keys.ros_name("EMPTY_TOPIC_TYPE") == "EMPTY_TOPIC_TYPE"


@pytest.mark.parametrize("text", ["233", "-1", "", "one", "¹"])
def test_domains_are_numbers_that_ros_has(text: str) -> None:
    assert [keys.domain(it) for it in ("0", "232")] == [0, 232]
    with pytest.raises(ValueError, match="no domain"):
        keys.domain(text)


def test_an_action_is_wanted_with_all_that_carries_it() -> None:
    wanted = ("/fibonacci",)
    assert keys.is_wanted("/fibonacci/_action/send_goal", wanted)
    assert not keys.is_wanted("/fibonacci2", wanted)
    assert keys.is_wanted("/anything", ())


@pytest.mark.parametrize(
    ("name", "hashed"),
    [
        ("std_msgs/msg/String", HASH),
        (
            "sensor_msgs/msg/Image",
            "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
        ),
        (
            "example_interfaces/srv/AddTwoInts",
            "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a",
        ),
    ],
)
def test_hashes_are_those_of_ros(name: str, hashed: str) -> None:
    assert digest(interface(name)) == hashed


def test_what_carries_an_action_has_a_hash() -> None:
    names = [
        "example_interfaces/action/Fibonacci_SendGoal",
        "example_interfaces/action/Fibonacci_GetResult",
        "example_interfaces/action/Fibonacci_FeedbackMessage",
    ]
    assert len({digest(interface(it)) for it in names}) == 3


NODE = "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
SUBSCRIPTION = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MS/%/%/listener/%chatter/"
    f"{STRING}/::,7:,:,:,,"
)
SERVICE = (
    "@ros2_lv/2/f9980ee0495eaafb3e38f0d19e2eae12/0/10/SS/%/%robots%one/add/%robots%one%add/"
    "example_interfaces::srv::dds_::AddTwoInts_/RIHS01_e118/::,10:,:,:,,"
)


@pytest.mark.parametrize("text", [NODE, SUBSCRIPTION, SERVICE])
def test_tokens_are_read_as_they_are_written(text: str) -> None:
    token = tokens.read(text)
    assert token is not None and token.text() == text


def test_a_token_says_what_an_endpoint_is() -> None:
    token = tokens.read(SERVICE)
    assert token is not None
    assert (token.kind, token.node, token.name) == ("service", "/robots/one/add", "/robots/one/add")
    assert (token.session.domain, token.numbers) == (2, (0, 10))
    assert (token.type, token.digest) == ("example_interfaces/srv/AddTwoInts", "RIHS01_e118")


def test_what_newer_distributions_add_to_a_token_is_not_read() -> None:
    assert tokens.read(f"{SUBSCRIPTION}/backends:cpu:") == tokens.read(SUBSCRIPTION)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "@ros2_lv",
        "other/0/z/0/0/NN/%/%/talker",
        "@ros2_lv/0/z/0/0/XX/%/%/talker",
        "@ros2_lv/0/z/0/0/MP/%/%/talker",
        "@ros2_lv/zero/z/0/0/NN/%/%/talker",
        f"{NODE}/%chatter/{STRING}/::,7:,:,:,,",
    ],
)
def test_what_is_no_token_is_none(text: str) -> None:
    assert tokens.read(text) is None


@pytest.mark.parametrize(
    ("text", "quality"),
    [
        ("::,10:,:,:,,", ("RELIABLE", "VOLATILE", 10)),
        ("2::,5:,:,:,,", ("BEST_EFFORT", "VOLATILE", 5)),
        (":1:,1:,:,:,,", ("RELIABLE", "TRANSIENT_LOCAL", 1)),
        ("::,:,:,:,,", ("RELIABLE", "VOLATILE", 42)),
        ("::2,:,:,:,,", ("RELIABLE", "VOLATILE", None)),
    ],
)
def test_qualities_are_written_and_read(text: str, quality: tuple[str, str, int | None]) -> None:
    described = dict(zip(("reliability", "durability", "depth"), quality, strict=True))
    assert tokens.quality_text(described) == text
    assert tokens.quality_of(text) == described


def test_qualities_that_others_write_in_full_are_read() -> None:
    full = "1:2:1,3:9223372036,854775807:9223372036,854775807:1,9223372036,854775807"
    assert tokens.quality_of(full)["depth"] == 3
    assert tokens.quality_of("nonsense")["reliability"] == "RELIABLE"


GID = bytes(range(16))
PLAIN = b"\x05\0\0\0\0\0\0\0" + b"\x01\x02\0\0\0\0\0\0" + b"\x10" + GID
NAMED = (
    b"\x0fsequence_number\x05\0\0\0\0\0\0\0\x10source_timestamp\x01\x02\0\0\0\0\0\0"
    b"\x0asource_gid\x10" + GID
)


def test_attachments_of_both_formats_are_read_and_today_s_is_written() -> None:
    read = attachment.read(PLAIN)
    assert read == (5, 513, GID) == attachment.read(NAMED)
    assert read is not None and read.pack() == PLAIN


@pytest.mark.parametrize("data", [b"", PLAIN[:-1], NAMED[:-1], NAMED + b"\0", b"\x0fother" * 9])
def test_other_attachments_are_none(data: bytes) -> None:
    assert attachment.read(data) is None


def test_missing_numbers_are_counted_for_each_publisher() -> None:
    numbers = Numbers()
    came = [(b"a", 5), (b"a", 6), (b"b", 1), (b"a", 9), (b"a", 7), (b"b", 2), (b"a", 10)]
    assert [numbers.note(*it) for it in came] == [0, 0, 0, 2, 0, 0, 0]
    assert numbers.lost == 2


def outside(wanted: tuple[str, ...] = ()) -> tuple[Outside, list[str]]:
    told: list[str] = []
    return Outside("own", wanted, told.append), told


def test_flows_are_open_while_an_endpoint_elsewhere_takes_them() -> None:
    graph, told = outside()
    second = SUBSCRIPTION.replace("/0/10/", "/0/11/")
    endpoint = Endpoint(
        "subscription",
        "/listener",
        "/chatter",
        "std_msgs/msg/String",
        elsewhere({"reliability": "RELIABLE", "durability": "VOLATILE", "depth": 7}),
    )
    there = ("endpoint", BRIDGE, asdict(endpoint))
    gone = ("endpoint gone", BRIDGE, asdict(endpoint))
    assert graph.add(SUBSCRIPTION) == [there, ("open", "topic", "/chatter")]
    assert graph.add(SUBSCRIPTION) == []
    assert graph.add(second) == [there]
    assert graph.known() == [there, there, ("open", "topic", "/chatter")]
    assert graph.remove(SUBSCRIPTION) == [gone]
    assert graph.remove(second) == [gone, ("close", "topic", "/chatter")]
    assert graph.remove(second) == []
    assert graph.known() == []
    assert graph.add(NODE) == [("node", BRIDGE, "/listener")] == graph.known()
    assert graph.remove(NODE) == [("node gone", BRIDGE, "/listener")]
    assert told == []


def test_own_tokens_and_names_that_are_not_wanted_do_not_count() -> None:
    graph, _ = outside(wanted=("/scan",))
    assert graph.add(NODE.replace("aac3178e146ba6f1fc6e6a4085e77f21", "own")) == []
    assert graph.add(SUBSCRIPTION) == []


@pytest.mark.parametrize(
    ("type_", "why"),
    [
        (f"std_msgs::msg::dds_::Char_/{HASH}", "and std_msgs/msg/Char of the node /listener"),
        (
            "std_msgs::msg::dds_::String_/RIHS01_00",
            "and another definition of std_msgs/msg/String of the node /listener",
        ),
        ("std_msgs::msg::dds_::String_/TypeHashNotSupported", "which runs on ROS 2 Humble"),
    ],
)
def test_other_types_are_told_once_whatever_is_there_first(type_: str, why: str) -> None:
    here = Endpoint("publisher", "/talker", "/chatter", "std_msgs/msg/String")
    token = SUBSCRIPTION.replace(STRING, type_)
    graph, told = outside()
    graph.declare(here, HASH)
    assert graph.add(token) == []
    assert graph.remove(token) == []
    assert graph.add(token) == []
    assert len(told) == 1 and "the topic /chatter has two types" in told[0] and why in told[0]
    later, told = outside()
    later.add(token)
    later.declare(here, HASH)
    assert len(told) == 1 and why in told[0]
    # It was announced, so its end is, too.
    assert [it[0] for it in later.remove(token)] == ["endpoint gone", "close"]


def test_arrivals_have_a_bound_and_count_what_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrivals, "MESSAGES", 2)
    told: list[str] = []
    woken: list[int] = []
    queue = arrivals.Arrivals(told.append)
    for number in range(4):
        queue.message("/scan", bytes([number]), b"")
    queue.put("token", "key", True)
    queue.begin(lambda: woken.append(1))
    assert [it[0] for it in queue.take()] == ["message", "message", "token"]
    assert (queue.dropped["/scan"], len(told), woken) == (2, 1, [1])
    queue.message("/scan", b"", b"")
    queue.message("/scan", b"", b"")
    assert (len(queue.take()), woken) == (2, [1, 1])


def test_a_message_larger_than_the_bound_passes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrivals, "BYTES", 4)
    queue = arrivals.Arrivals(lambda _: None)
    queue.message("/image", b"12345", b"")
    queue.message("/image", b"12345", b"")
    assert (len(queue.take()), queue.dropped["/image"]) == (1, 1)


def test_settings_come_from_options_and_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    assert Settings.of("tcp/robot:7447", None, []) == Settings("tcp/robot:7447", 0)
    monkeypatch.setenv("ROS_DOMAIN_ID", "5")
    assert Settings.of("tcp/robot:7447", None, ["tf", "/scan"]).wanted == ("/tf", "/scan")
    assert Settings.of("tcp/robot:7447", None, []).domain == 5
    assert Settings.of("tcp/robot:7447", "6", []).domain == 6


@pytest.mark.parametrize(
    ("endpoint", "is_local"),
    [
        ("tcp/localhost:7447", True),
        ("tcp/127.0.0.2:7447", True),
        ("tcp/[::1]:7447", True),
        ("tcp/10.0.0.5:7447", False),
        ("tcp/robot.local:7447", False),
    ],
)
def test_only_endpoints_of_this_machine_are_listened_at(endpoint: str, is_local: bool) -> None:
    assert session.is_local(endpoint) == is_local


def test_overrides_are_read_as_programs_of_ros_read_them() -> None:
    text = 'listen/endpoints=["tcp/[::]:0"];mode="client";'
    assert session.overrides(text) == {"listen/endpoints": '["tcp/[::]:0"]', "mode": '"client"'}
    assert session.overrides("") == {}
    with pytest.raises(BridgeError, match="'mode' has no ="):
        session.overrides("mode")
