"""Scripts that are connected with nodes of ROS 2 elsewhere, over the protocol of rmw_zenoh.

The other side is written out by hand, in ``zenoh_peer.py``.
"""

from __future__ import annotations

import re
import signal
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh.ext
from processes import ROOT, Bench, finish, hear
from tcp_ports import free_ports
from zenoh_peer import (
    ADD,
    GID,
    IMAGE,
    STRING,
    TEN,
    WAIT_S,
    Peer,
    beside,
    beside_named,
    numbers,
    text,
)

SCRIPTS = ROOT / "tests" / "ros2"
CHATTER = f"0/chatter/{STRING}"
ADDS = f"0/add_two_ints/{ADD}"

HEAD = """\
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import String
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
rclpy.init()
"""


@pytest.fixture
def peer() -> Iterator[Peer]:
    """The router, which is a node, too."""
    made = Peer()
    yield made
    made.close()


@pytest.fixture
def write(tmp_path: Path):
    """Write scripts, which all begin with the imports."""

    def put(**scripts: str) -> None:
        for name, program in scripts.items():
            (tmp_path / f"{name}.py").write_text(HEAD + program)

    return put


def script(name: str) -> str:
    return str(SCRIPTS / f"{name}.py")


def told(logged: str, word: str) -> list[str]:
    return re.findall(rf"{word}: (.*)", logged)


def interrupt(process, after: str = "") -> str:
    """End a run in order; return what it has written on the standard error."""
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome.code == 130, outcome.err
    return after + outcome.err


def test_messages_reach_a_subscription_elsewhere(bench: Bench, peer: Peer) -> None:
    samples = peer.subscribe(CHATTER)
    peer.token(f"0/5/MS/%/%/echo/%chatter/{STRING}/{TEN}")
    words = [script("talker"), "--ros-args", "-p", "period:=0.05"]
    process = bench.call("ros", "run", peer.option, *words)
    got = [samples.get(timeout=WAIT_S) for _ in range(5)]
    first = numbers(got[0])[1]
    assert [numbers(it) for it in got] == [(number, first) for number in range(1, 6)]
    payloads = [it.payload.to_bytes() for it in got]
    begin = int(re.search(rb"message (\d+)", payloads[0])[1])
    assert payloads == [text(f"message {begin + it}") for it in range(5)]
    interrupt(process)


def test_messages_from_elsewhere_have_either_attachment(bench: Bench, peer: Peer) -> None:
    peer.watch()
    process = bench.call("ros", "run", peer.option, script("listener"))
    peer.await_token("/listener/%chatter/")
    for number, attached in enumerate([beside, beside_named, beside, beside_named], start=1):
        peer.put(CHATTER, text(f"number {number}"), attached(number))
    # A gap is told, and what comes after it arrives.
    peer.put(CHATTER, text("number 9"), beside(9))
    outcome = finish(process)
    assert outcome.code == 0
    assert told(outcome.err, "heard") == [f"number {it}" for it in (1, 2, 3, 4, 9)]
    lost = "warning: 4 messages of /chatter from elsewhere are lost: number 9 came after number 4"
    assert lost in outcome.err.splitlines()
    assert "warning: 4 messages of /chatter from elsewhere have not arrived" in outcome.err


def test_bytes_that_are_no_message_are_told_once(bench: Bench, peer: Peer) -> None:
    peer.watch()
    process = bench.call("ros", "run", peer.option, script("listener"))
    peer.await_token("/listener/%chatter/")
    for number in range(1, 4):
        peer.put(CHATTER, b"\0\x01\0\0\xff\xff\xff\x7f", beside(number))
    for number in range(4, 9):
        peer.put(CHATTER, text(str(number)), beside(number))
    outcome = finish(process)
    assert told(outcome.err, "heard") == ["4", "5", "6", "7", "8"]
    assert outcome.err.count("a message of /chatter has not passed the bridge") == 1


def test_scripts_are_seen_elsewhere(bench: Bench, peer: Peer) -> None:
    peer.watch()
    words = [script("talker"), "+", script("add_server")]
    process = bench.call("ros", "run", peer.option, *words)
    begin = r"@ros2_lv/0/([0-9a-f]+)/(\d+)/(\d+)/"
    for part, rest in [
        ("/NN/%/%/talker", "NN/%/%/talker"),
        ("/MP/%/%/talker/%chatter/", f"MP/%/%/talker/%chatter/{STRING}/{TEN}"),
        ("/SS/%/%/add_server/%add_two_ints/", f"SS/%/%/add_server/%add_two_ints/{ADD}/{TEN}"),
    ]:
        token = peer.await_token(part)
        assert re.sub(begin, "", token) == rest
        assert token.split("/")[2] != str(peer.session.zid())
    interrupt(process)
    # They are gone with the run.
    peer.await_token("/NN/%/%/talker", is_there=False)
    peer.await_token("/SS/%/%/add_server/", is_there=False)


def test_a_script_that_ends_is_seen_no_more(bench: Bench, peer: Peer, write) -> None:
    write(short="node = Node('short')\nnode.create_timer(0.01, rclpy.shutdown)\nrclpy.spin(node)\n")
    peer.watch()
    process = bench.call("ros", "run", peer.option, "short.py", "+", script("talker"))
    peer.await_token("/NN/%/%/short")
    peer.await_token("/NN/%/%/short", is_there=False)
    assert (False, "/NN/%/%/talker") not in [(there, it[-14:]) for there, it in peer.seen]
    interrupt(process)


SEES = """
node = Node("sees")
node.create_subscription(String, "chatter", print, 10)
while node.count_publishers("/chatter") == 0:
    rclpy.spin_once(node, timeout_sec=0.05)
print(node.get_node_names(), dict(node.get_topic_names_and_types())["/chatter"], flush=True)
while node.count_publishers("/chatter") > 0:
    rclpy.spin_once(node, timeout_sec=0.05)
print(node.get_node_names(), flush=True)
"""


def test_nodes_elsewhere_are_seen_by_scripts(bench: Bench, peer: Peer, write) -> None:
    write(sees=SEES)
    node = peer.token("0/0/NN/%/%/camera")
    publisher = peer.token(f"0/1/MP/%/%/camera/%chatter/{STRING}/{TEN}")
    process = bench.call("ros", "run", peer.option, "sees.py")
    assert "['sees', 'camera'] ['std_msgs/msg/String']\n" in hear(process.stdout, "]\n")
    node.undeclare()
    publisher.undeclare()
    outcome = finish(process)
    assert outcome.out.splitlines()[-1].endswith("['sees']")
    gone = "warning: the node /camera elsewhere publishes /chatter no more"
    assert outcome.err.splitlines().count(gone) == 1


def test_a_client_calls_a_server_elsewhere(bench: Bench, peer: Peer) -> None:
    asked = []

    def answer(query: zenoh.Query) -> None:
        data, attached = query.payload.to_bytes(), query.attachment.to_bytes()
        asked.append((data[:4], attached[:8], attached[16:17]))
        total = sum(struct.unpack("<qq", data[4:]))
        query.reply(ADDS, b"\0\x01\0\0" + struct.pack("<q", total), attachment=attached)
        query.drop()

    peer.keep(peer.session.declare_queryable(ADDS, answer, complete=True))
    peer.token(f"0/3/SS/%/%/adder/%add_two_ints/{ADD}/{TEN}")
    outcome = finish(bench.call("ros", "run", peer.option, script("add_client"), "7"))
    assert outcome.code == 0
    assert told(outcome.err, r"\[add_client\]")[-3:] == ["7 + 0 is 7", "7 + 1 is 8", "7 + 2 is 9"]
    header = b"\0\x01\0\0"
    assert asked == [(header, struct.pack("<q", it), b"\x10") for it in range(1, 4)]


def test_a_server_is_called_from_elsewhere(bench: Bench, peer: Peer) -> None:
    peer.watch()
    process = bench.call("ros", "run", peer.option, script("add_server"))
    peer.await_token("/SS/%/%/add_server/%add_two_ints/")
    for number, attached in enumerate([beside(1), beside_named(2)], start=1):
        request = b"\0\x01\0\0" + struct.pack("<qq", 40, number)
        response, echoed = peer.ask(ADDS, request, attached)
        assert response == b"\0\x01\0\0" + struct.pack("<q", 40 + number)
        assert (echoed[:8], echoed[16:]) == (struct.pack("<q", number), b"\x10" + GID)
    logged = interrupt(process)
    assert told(logged, r"\[add_server\]") == ["40 + 1 = 41", "40 + 2 = 42"]


def test_a_topic_with_two_types_is_not_connected(bench: Bench, peer: Peer) -> None:
    peer.watch()
    other = f"std_msgs::msg::dds_::Int64_/RIHS01_{'0' * 64}"
    peer.token(f"0/1/MP/%/%/counter/%chatter/{other}/{TEN}")
    peer.token(f"0/2/MP/%/%/counter/%chatter/{other}/{TEN}")
    process = bench.call("ros", "run", peer.option, script("listener"))
    peer.await_token("/listener/%chatter/")
    for number in range(1, 6):
        peer.put(CHATTER, text("a"), beside(number))
    outcome = finish(process)
    warned = [it for it in outcome.err.splitlines() if it.startswith("warning")]
    assert warned == [
        "warning: the topic /chatter has two types, so they are not connected: std_msgs/msg/String"
        " of the node /listener, and std_msgs/msg/Int64 of the node /counter elsewhere"
    ]


IMAGES = """
node = Node("images")
publisher = node.create_publisher(Image, "out", 10)
node.create_subscription(Image, "in", publisher.publish, 10)
rclpy.spin(node)
"""


def test_a_large_image_passes_both_ways(bench: Bench, peer: Peer, write) -> None:
    write(images=IMAGES)
    peer.watch()
    samples = peer.subscribe(f"0/out/{IMAGE}")
    peer.token(f"0/5/MS/%/%/view/%out/{IMAGE}/{TEN}")
    process = bench.call("ros", "run", peer.option, "images.py")
    peer.await_token("/images/%in/")
    pixels = bytes(range(256)) * 40_000
    # The stamp, the frame "map", 1600 rows of 6400 bytes, "rgba8", and the pixels.
    image = b"\0\x01\0\0" + struct.pack("<iII4sII", 5, 6, 4, b"map\0", 1600, 1600)
    image += struct.pack("<I6sBxII", 6, b"rgba8\0", 0, 6400, len(pixels)) + pixels
    peer.put(f"0/in/{IMAGE}", image, beside(1))
    assert samples.get(timeout=WAIT_S).payload.to_bytes() == image
    interrupt(process)


ALIGNED = """
node = Node("aligned")
count = 0


def hear(name, message):
    global count
    stamp = message.header.stamp
    after = node.get_clock().now().nanoseconds - stamp.sec * 10**9 - stamp.nanosec
    print(name, message.header.frame_id, after if after < 10**10 else "late", flush=True)
    count += 1
    if count == 4:
        raise SystemExit


for name in ("left", "right"):
    node.create_subscription(Image, name, lambda it, name=name: hear(name, it), 10)
rclpy.spin(node)
"""


def stamped(stamp_ns: int, frame: bytes) -> bytes:
    """An empty image of a frame with one letter."""
    stamp = divmod(stamp_ns, 10**9)
    head = b"\0\x01\0\0" + struct.pack("<iII2sxxII", *stamp, 2, frame + b"\0", 0, 0)
    return head + struct.pack("<I6sBxII", 6, b"rgba8\0", 0, 0, 0)


def test_stamps_of_messages_from_elsewhere_may_be_their_tags(
    bench: Bench, peer: Peer, write
) -> None:
    write(aligned=ALIGNED)
    peer.watch()
    options = (peer.option, "--zenoh-align-stamp", "4")
    process = bench.call("ros", "run", *options, "aligned.py")
    for name in ("left", "right"):
        peer.await_token(f"/aligned/%{name}/")
    now, ms = time.time_ns(), 10**6
    for number, (name, stamp, frame) in enumerate(
        [
            ("right", now + 60 * ms, b"c"),
            ("left", now + 20 * ms, b"b"),
            ("right", now - 40 * ms, b"a"),
            ("left", 5 * 10**9, b"z"),
        ]
    ):
        peer.put(f"0/{name}/{IMAGE}", stamped(stamp, frame), beside(number + 1))
    outcome = finish(process)
    assert outcome.code == 0, outcome.err
    # Whatever came first, and in whichever time: exactly the wait after the stamp.
    assert outcome.out.splitlines() == [
        "[aligned-1] left z late",
        *(f"[aligned-1] {it} 4000000000" for it in ("right a", "left b", "right c")),
    ]
    (told,) = [it for it in outcome.err.splitlines() if "later than its stamp" in it]
    assert told.startswith("warning: a message of /left has arrived ")
    assert told.endswith("and the wait of 4000 ms, so its tag is the time of its arrival")


def test_messages_that_are_kept_come_to_those_that_are_later(
    bench: Bench, peer: Peer, write
) -> None:
    write(
        keeps="""
node = Node("keeps")
node.create_publisher(String, "map", LATCHED).publish(String(data="once"))
rclpy.spin(node)
""",
        later="""
node = Node("later")
def take(message):
    print(message.data, flush=True)
    raise SystemExit
node.create_subscription(String, "plan", take, LATCHED)
rclpy.spin(node)
""",
    )
    peer.watch()
    process = bench.call("ros", "run", peer.option, "keeps.py")
    key = f"0/map/{STRING}"
    token = peer.await_token("/keeps/%map/")
    assert token.endswith("/:1:,1:,:,:,,")
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
    samples = peer.subscribe(key, zenoh.ext.declare_advanced_subscriber, history=history)
    assert samples.get(timeout=WAIT_S).payload.to_bytes() == text("once")
    interrupt(process)

    cache = zenoh.ext.CacheConfig(1)
    plan = zenoh.ext.declare_advanced_publisher(
        peer.session, f"0/plan/{STRING}", cache=cache, publisher_detection=True
    )
    peer.keep(plan).put(text("kept"), attachment=beside(1))
    outcome = finish(bench.call("ros", "run", peer.option, "later.py"))
    assert (outcome.code, outcome.out) == (0, "[later-1] kept\n"), outcome.err


def test_two_runs_find_one_another_without_a_router(bench: Bench) -> None:
    option = f"--zenoh=tcp/localhost:{free_ports(1)[0]}"
    talker = bench.call("ros", "run", option, script("talker"), "--ros-args", "-p", "period:=0.05")
    heard = hear(talker.stderr, "sending: message 1\n")
    endpoint = option.partition("=")[2]
    alone = f"no router of Zenoh listens at {endpoint}, so this run is one as long as it lasts"
    assert heard.splitlines()[0] == alone
    listener = finish(bench.call("ros", "run", option, script("listener")))
    assert listener.code == 0 and alone not in listener.err
    received = [int(it.split()[1]) for it in told(listener.err, "heard")]
    assert received == list(range(received[0], received[0] + 5))
    interrupt(talker)


def test_actions_pass_between_two_runs(bench: Bench) -> None:
    option = f"--zenoh=tcp/localhost:{free_ports(1)[0]}"
    server = bench.call("ros", "run", option, script("fibonacci_server"))
    hear(server.stderr, "this run is one as long as it lasts\n")
    client = finish(bench.call("ros", "run", option, script("fibonacci_client"), "5"))
    assert client.out.splitlines()[-1] == "[fibonacci_client-1] status 4 result [0, 1, 1, 2, 3]"
    interrupt(server)


@pytest.mark.parametrize("by", ["option", "variable"])
def test_a_domain_is_seen_by_itself(bench: Bench, peer: Peer, by: str) -> None:
    peer.watch()
    peer.watch(domain=7)
    words = [peer.option, *(["--domain-id=7"] if by == "option" else []), script("talker")]
    environment = {"ROS_DOMAIN_ID": "7"} if by == "variable" else {}
    process = bench.call("ros", "run", *words, environment=environment)
    assert peer.await_token("/talker/%chatter/").startswith("@ros2_lv/7/")
    assert not [it for _, it in peer.seen if it.startswith("@ros2_lv/0/")]
    interrupt(process)


def test_some_topics_may_be_bridged_and_no_others(bench: Bench, peer: Peer) -> None:
    peer.watch()
    words = ["--zenoh-only", "add_two_ints", script("talker"), "+", script("add_server")]
    process = bench.call("ros", "run", peer.option, *words)
    peer.await_token("/SS/%/%/add_server/%add_two_ints/")
    endpoints = [it for _, it in peer.seen if "/NN/" not in it]
    assert len(endpoints) == 1, endpoints
    interrupt(process)


def test_a_run_may_listen_where_the_user_says(bench: Bench) -> None:
    first, second = free_ports(2)
    override = f'listen/endpoints=["tcp/127.0.0.1:{first}","tcp/127.0.0.1:{second}"]'
    process = bench.call(
        "ros",
        "run",
        f"--zenoh=tcp/localhost:{first}",
        script("talker"),
        environment={"ZENOH_CONFIG_OVERRIDE": override},
    )
    hear(process.stderr, "sending")
    peer = Peer(second)
    peer.watch()
    peer.await_token("/talker/%chatter/")
    peer.close()
    interrupt(process)


def test_a_router_of_another_machine_is_joined_as_a_client(bench: Bench, peer: Peer) -> None:
    peer.watch()
    # To the machine itself, as it is to others.
    option = f"--zenoh=tcp/0.0.0.0:{peer.port}"
    process = bench.call("ros", "run", option, script("listener"))
    peer.await_token("/listener/%chatter/")
    for number in range(1, 6):
        peer.put(CHATTER, text("there"), beside(number))
    assert told(finish(process).err, "heard") == ["there"] * 5


def test_wrong_settings_are_one_error(bench: Bench, tmp_path: Path) -> None:
    port = free_ports(1)[0]
    for words, variables, parts in [
        (
            [f"--zenoh=tcp/0.0.0.0:{port}"],
            {},
            ["there is no session of Zenoh", "Unable to connect"],
        ),
        (["--zenoh=7447"], {}, ["'7447' is no endpoint of Zenoh", "hint: one is tcp/localhost"]),
        (["--zenoh", "--domain-id=233"], {}, ["'233' is no domain", "0 to 232"]),
        (["--zenoh"], {"ROS_DOMAIN_ID": "robot"}, ["'robot' is no domain", "ROS_DOMAIN_ID"]),
        ([f"--zenoh=tcp/localhost:{port}"], {"ZENOH_CONFIG_OVERRIDE": "mode"}, ["has no ="]),
    ]:
        process = bench.call("ros", "run", *words, script("talker"), environment=variables)
        outcome = finish(process)
        assert outcome.code == 1 and outcome.out == ""
        outcome.assert_one_error(*parts)


def test_a_missing_package_is_named(bench: Bench, tmp_path: Path) -> None:
    missing = "raise ModuleNotFoundError(\"No module named 'zenoh'\", name='zenoh')\n"
    (tmp_path / "zenoh.py").write_text(missing)
    environment = {"PYTHONPATH": str(tmp_path)}
    outcome = finish(bench.call("ros", "run", "--zenoh", script("talker"), environment=environment))
    assert outcome.code == 1
    outcome.assert_one_error("eclipse-zenoh is not installed", "pip install 'hprm[zenoh]'")
