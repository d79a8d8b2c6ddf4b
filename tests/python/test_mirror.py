"""`hprm mirror`, seen by a plain program of Zenoh, and by a node of ROS 2."""

from __future__ import annotations

import json
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from processes import Bench, finish, hear
from test_echo import start, stop
from zenoh_peer import STRING, TEN, WAIT_S, Peer, numbers, text

from hprm._payloads import Unsendable, as_json, raw
from hprm.ros._filling import message_of
from hprm.ros._messages import class_of

PROGRAM = """\
target Python { keepalive: true }
preamble {=
import dataclasses
import numpy as np
@dataclasses.dataclass
class Pose:
    x: int
    trace: np.ndarray
=}
reactor Source {
  output[4] outs
  output later
  state n = 0
  timer t(0, 10 ms)
  reaction(t) -> outs, later {=
    self.n += 1
    values = [
        np.full((4, 6, 3), self.n % 256, dtype=np.uint8),
        f"value {self.n}",
        Pose(self.n, np.zeros(2)),
        self.n,
    ]
    for out, value in zip(outs, values):
        out.set(value)
    later.set("late")
  =}
}
reactor Sink {
  input[4] inputs
  input later
  reaction(inputs, later) {= pass =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.outs -> sink.inputs
  source.later ~> sink.later
}
"""


@pytest.fixture
def peer() -> Iterator[Peer]:
    """The router, and a program that uses Zenoh."""
    made = Peer()
    yield made
    made.close()


def mirror(bench: Bench, run: Any, peer: Peer, *words: str) -> Any:
    """Start a mirror of the federation of a run, and wait until it sends."""
    process = bench.call("mirror", *words, peer.option, "--wait", "30", "--of", str(run.pid))
    assert "; Ctrl-C ends\n" in hear(process.stdout, "\n")
    return process


def end(process: Any) -> str:
    """End a mirror; return what it has written on the standard error."""
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome.code == 0, outcome.err
    return outcome.err


def test_arrays_texts_and_objects_arrive_with_their_tags(bench: Bench, peer: Peer) -> None:
    run = start(bench, PROGRAM)
    forms = {
        "source.outs[0]": ("raw", "zenoh/bytes;|u1[4,6,3]"),
        "sink.inputs[1]": ("raw", "zenoh/string"),
        "source.outs[2]": ("json", "application/json"),
    }
    seen = {}
    for port, (form, encoding) in forms.items():
        samples = peer.subscribe(f"robot/{form}/{port[-2]}")
        process = mirror(bench, run, peer, port, f"--key=robot/{form}/{port[-2]}", f"--as={form}")
        got = [samples.get(timeout=WAIT_S) for _ in range(3)]
        assert "warning" not in end(process)
        assert {str(it.encoding) for it in got} == {encoding}
        about = [json.loads(it.attachment.to_bytes()) for it in got]
        assert {it["port"] for it in about} == {port}
        times = [it["tag"][0] for it in about]
        assert [later - first for first, later in zip(times, times[1:], strict=False)] == [
            10_000_000,
            10_000_000,
        ]
        seen[port] = [it.payload.to_bytes() for it in got]
    first = seen["source.outs[0]"][0][0]
    assert seen["source.outs[0]"] == [bytes([(first + it) % 256]) * 72 for it in range(3)]
    first = int(seen["sink.inputs[1]"][0].split()[1])
    assert seen["sink.inputs[1]"] == [f"value {first + it}".encode() for it in range(3)]
    poses = [json.loads(it) for it in seen["source.outs[2]"]]
    first = poses[0]["x"]
    assert poses == [{"x": first + it, "trace": [0.0, 0.0]} for it in range(3)]
    stop(run)


def test_a_physical_connection_has_no_tags(bench: Bench, peer: Peer) -> None:
    run = start(bench, PROGRAM)
    samples = peer.subscribe("k")
    process = mirror(bench, run, peer, "sink.later", "--key=k")
    sample = samples.get(timeout=WAIT_S)
    assert sample.payload.to_bytes() == b"late"
    assert sorted(json.loads(sample.attachment.to_bytes())) == ["port", "sent"]
    end(process)
    stop(run)


def test_a_node_of_ros_2_sees_a_topic(bench: Bench, peer: Peer) -> None:
    run = start(bench, PROGRAM)
    peer.watch()
    samples = peer.subscribe(f"0/chatter/{STRING}")
    words = ["source.outs[1]", "--topic=chatter", "--type=std_msgs/msg/String"]
    process = mirror(bench, run, peer, *words)
    peer.await_token(f"/MP/%/%/hprm_mirror/%chatter/{STRING}/{TEN}")
    got = [samples.get(timeout=WAIT_S) for _ in range(3)]
    sender = numbers(got[0])[1]
    count = numbers(got[0])[0]
    assert [numbers(it) for it in got] == [(count + it, sender) for it in range(3)]
    payloads = [it.payload.to_bytes() for it in got]
    first = int(payloads[0][8:].rstrip(b"\0").split()[1])
    assert payloads == [text(f"value {first + it}") for it in range(3)]
    end(process)
    peer.await_token("/hprm_mirror/%chatter/", is_there=False)
    stop(run)


def test_cdr_on_a_plain_key(bench: Bench, peer: Peer) -> None:
    run = start(bench, PROGRAM)
    samples = peer.subscribe("speed")
    words = ["source.outs[3]", "--key=speed", "--as=cdr", "--type=std_msgs/msg/Float64"]
    process = mirror(bench, run, peer, *words)
    got = [samples.get(timeout=WAIT_S) for _ in range(2)]
    assert str(got[0].encoding) == "application/cdr"
    one, two = (struct.unpack("<4xd", it.payload.to_bytes())[0] for it in got)
    assert two == one + 1
    end(process)
    stop(run)


def test_it_ends_with_the_federation_and_counts_what_it_could_not_send(
    bench: Bench, peer: Peer
) -> None:
    run = start(bench, PROGRAM)
    process = mirror(bench, run, peer, "source.outs[3]", "--key=k")
    said = hear(process.stderr, "\n")
    assert said.startswith("warning: a value of source.outs[3] is not mirrored: an int is no bytes")
    stop(run)
    outcome = finish(process)
    assert outcome.code == 0
    assert "the federation has ended" in outcome.err
    counts = outcome.err.partition("not all messages were mirrored: 0 passed too fast, ")[2]
    assert int(counts.split()[0]) >= 1, outcome.err


def test_what_is_wrong_is_one_error(bench: Bench, peer: Peer) -> None:
    run = start(bench, PROGRAM)
    of = ["--of", str(run.pid), "--wait", "30", peer.option]
    image = ["source.outs[0]"]
    string = "--type=std_msgs/msg/String"
    for words, said in (
        (["source.outz", "--key=k"], ["source has no port outz"]),
        ([*image, "--key="], ["'' is no key", "one is robot/camera/image"]),
        ([*image, "--key=a//b"], ["each part between two `/` has a name"]),
        ([*image, "--key=a/*"], ["'*' has no place in a key to send to"]),
        ([*image, "--key=a b"], ["' ' has no place in a key to send to"]),
        ([*image, "--key=@/router"], ["keys with @ at their beginning are Zenoh's own"]),
        ([*image, "--key=" + "k" * 2000], ["'kkkkkkkkkkkkkkkkkkkk...' is no key"]),
        ([*image, "--key=k", string], ["--type is for messages of ROS 2", "use --as cdr"]),
        ([*image, "--topic=/a//b", string], ["no name of a topic", "repeated '/'"]),
        ([*image, "--topic=~/x", string], ["no name of a topic", "one is /robot/speed"]),
        ([*image, "--topic=t", "--type=nothing_msgs/msg/None"], ["no package 'nothing_msgs'"]),
        ([*image, "--topic=t", "--type=x"], ["types have names like std_msgs/msg/String"]),
        ([*image, "--topic=t", "--type=std_srvs/srv/Empty"], ["no type of messages"]),
        ([*image, "--topic=t", string, "--domain-id=999"], ["'999' is no domain"]),
        ([*image, "--topic=t", string, "--domain-id="], ["'' is no domain"]),
    ):
        outcome = finish(bench.call("mirror", *words, *of))
        assert outcome.code == 1, words
        outcome.assert_one_error(*said)
    stop(run)


def test_what_listens_must_be_a_router(bench: Bench) -> None:
    run = start(bench, PROGRAM)
    of = ["--of", str(run.pid), "--wait", "30"]
    with socket.create_server(("127.0.0.1", 0)) as mute:
        where = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        outcome = finish(bench.call("mirror", "source.outs[0]", "--key=k", f"--zenoh={where}", *of))
    assert (outcome.code, outcome.out) == (1, "")
    outcome.assert_one_error(f"no session of Zenoh at {where}", "does a router of Zenoh listen")
    for variables, said in (
        ({"ZENOH_SESSION_CONFIG_URI": "/nowhere.json5"}, "/nowhere.json5 cannot be used: No such"),
        ({"ZENOH_CONFIG_OVERRIDE": "mode=client"}, "Zenoh has no mode=client"),
    ):
        words = ["mirror", "source.outs[0]", "--key=k", "--zenoh=tcp/127.0.0.1:9", *of]
        outcome = finish(bench.call(*words, environment=variables))
        assert outcome.code == 1
        outcome.assert_one_error(f"{next(iter(variables))}: {said}")
    stop(run)


def test_sigterm_ends_it_as_ctrl_c_does(bench: Bench, peer: Peer) -> None:
    run = start(bench, PROGRAM)
    process = mirror(bench, run, peer, "source.outs[3]", "--key=k")
    assert "is not mirrored" in hear(process.stderr, "\n")
    process.send_signal(signal.SIGTERM)
    outcome = finish(process)
    assert outcome.code == 0
    assert "not all messages were mirrored: 0 passed too fast" in outcome.err
    stop(run)


def test_a_full_standard_output_is_one_error(bench: Bench, peer: Peer) -> None:
    run = start(bench, PROGRAM)
    hprm = Path(sys.executable).with_name("hprm")
    words = ["mirror", "source.outs[0]", "--key=k", peer.option, "--of", str(run.pid), "--wait=30"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [hprm, *words], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert done.returncode == 1
    said = "error: the standard output cannot be written: No space left on device\n"
    assert done.stderr == said
    stop(run)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["a.b"], "--key <KEY>"),
        (["a.b", "--key=k", "--topic=t", "--type=std_msgs/msg/String"], "cannot be used with"),
        (["a.b", "--topic=t"], "--type <PACKAGE/msg/NAME>"),
        (["a.b", "--key=k", "--as=cdr"], "--type <PACKAGE/msg/NAME>"),
        (["a.b", "--key=k", "--as=xml"], "possible values: raw, json, cdr"),
        (["a.b", "--key=k", "--domain-id=1"], "--topic <NAME>"),
    ],
)
def test_words_that_do_not_go_together(bench: Bench, words: list[str], said: str) -> None:
    outcome = finish(bench.call("mirror", *words))
    assert outcome.code == 2
    assert said in outcome.err


def test_without_the_package_the_error_says_how_to_install_it(bench: Bench, tmp_path: Path) -> None:
    run = start(bench, PROGRAM)
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['zenoh'] = None\n")
    words = ["mirror", "source.outs[0]", "--key=k", "--of", str(run.pid), "--wait", "30"]
    outcome = finish(bench.call(*words, environment={"PYTHONPATH": str(tmp_path)}))
    assert outcome.code == 1
    python = Path(sys.executable).with_name("python3")
    outcome.assert_one_error(
        f"the package eclipse-zenoh is not installed for {python}", "pip install 'hprm[zenoh]'"
    )
    stop(run)


# Values as bytes.


class Point(NamedTuple):
    """What has fields, and is a tuple."""

    x: float
    y: float


def test_raw_values() -> None:
    assert raw(b"ab") == (b"ab", "zenoh/bytes")
    assert raw(memoryview(b"ab")) == (b"ab", "zenoh/bytes")
    assert raw("\u00e4") == ("\u00e4".encode(), "zenoh/string")
    array = np.arange(6, dtype=">i2").reshape(2, 3).T
    assert raw(array) == (struct.pack(">6h", 0, 3, 1, 4, 2, 5), "zenoh/bytes;>i2[3,2]")
    assert raw(np.float32(1)) == (struct.pack("<f", 1), "zenoh/bytes;<f4[]")
    for value, said in (
        (1, "try --as json"),
        (None, "None is no bytes"),
        ([1], "try --as json"),
        ({"a": 1}, "try --as json"),
        (np.array([None]), "an array of object has no bytes"),
        (np.zeros(2, "M8[s]"), "an array of datetime64"),
        (np.zeros(2, [("a", "u1")]), "has no bytes that others can read"),
        (np.ma.array([1], mask=[True]), "has no bytes that others can read"),
        ("\ud800", "half a character"),
    ):
        with pytest.raises(Unsendable, match=said):
            raw(value)


def test_values_as_json() -> None:
    value = {
        "point": Point(1.5, 2.5),
        "named": SimpleNamespace(a=np.int64(3), b=(True, None)),
        4: np.eye(2, dtype=np.uint8),
        "wide": [np.longdouble(0.5), np.zeros(1, np.longdouble)],
    }
    data, encoding = as_json(value)
    assert (json.loads(data), encoding) == (
        {
            "point": {"x": 1.5, "y": 2.5},
            "named": {"a": 3, "b": [True, None]},
            "4": [[1, 0], [0, 1]],
            "wide": [0.5, [0.0]],
        },
        "application/json",
    )
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    for wrong, said in (
        (b"bytes", "it has no JSON"),
        (float("nan"), "infinity and NaN are not JSON"),
        ([np.inf], "infinity and NaN are not JSON"),
        ({1j}, "it has no JSON"),
        (np.zeros(1, np.clongdouble), "it has no JSON"),
        ({1: 0, "1": 0}, "two keys of a dict are the same text"),
        (np.ma.array([1], mask=[True]), "a masked array"),
        ("\ud800", "half a character"),
        (deep, "nested too deep"),
    ):
        with pytest.raises(Unsendable, match=said):
            as_json(wrong)


IMAGE = class_of("sensor_msgs/msg/Image")
JOINTS = class_of("sensor_msgs/msg/JointState")


def test_messages_of_ros_2() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    stamp = {"sec": 5, "nanosec": 6}
    made = message_of(
        IMAGE,
        SimpleNamespace(
            header={"stamp": stamp, "frame_id": "front"}, height=2, width=np.int64(4), data=pixels
        ),
    )
    assert (made.header.stamp.sec, made.header.frame_id, made.width) == (5, "front", 4)
    assert bytes(made.data) == pixels.tobytes()
    assert message_of(IMAGE, made) is made
    assert bytes(message_of(IMAGE, {"data": b"ab"}).data) == b"ab"
    assert bytes(message_of(IMAGE, {"data": np.array([1, 2])}).data) == b"\1\2"
    floats = class_of("std_msgs/msg/Float64MultiArray")
    assert list(message_of(floats, {"data": np.array([1, 2], np.float32)}).data) == [1.0, 2.0]
    path = class_of("nav_msgs/msg/Path")
    poses = [{"pose": {"position": {"x": 1}}}, {}]
    assert message_of(path, {"poses": poses}).poses[0].pose.position.x == 1.0
    names = np.array(["a", "b"])
    joints = message_of(JOINTS, {"name": names, "position": (1, 2.5), "effort": np.zeros((1, 2))})
    assert (joints.name, list(joints.position), list(joints.effort)) == (
        ["a", "b"],
        [1.0, 2.5],
        [0.0, 0.0],
    )
    assert message_of(class_of("std_msgs/msg/Byte"), 7).data == b"\7"
    assert message_of(class_of("std_msgs/msg/Bool"), np.True_).data is True


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        ("sensor_msgs/msg/Image", 3, "Image has the fields header, height"),
        ("std_msgs/msg/Empty", 3, "Empty has no fields, and the value is an int"),
        ("sensor_msgs/msg/Image", {"heigth": 2}, "Image has no field 'heigth'; its fields: header"),
        ("sensor_msgs/msg/Image", {"data": np.array([0.5])}, "data has numbers of uint8, and 0.5"),
        ("sensor_msgs/msg/Image", {"data": np.array([300])}, "data has numbers of uint8, and 300"),
        (
            "sensor_msgs/msg/Image",
            {"header": {"stamp": {"sec": "5"}}},
            "header.stamp.sec takes int",
        ),
        ("sensor_msgs/msg/Image", {"header": 3}, "header takes Header, and the value is an int"),
        ("sensor_msgs/msg/JointState", {"name": "ab"}, "name is a sequence, and the value is a s"),
        (
            "sensor_msgs/msg/JointState",
            {"name": [1]},
            r"name\[0\] takes str, and the value is an int",
        ),
        ("sensor_msgs/msg/JointState", {"position": None}, "position is a sequence"),
        ("std_msgs/msg/UInt8", 256, "data: The 'data' field must be an unsigned integer"),
        ("std_msgs/msg/Float32MultiArray", {"data": np.array([1e300])}, "of float32, and 1e.300"),
        ("std_msgs/msg/String", None, "data takes str, and the value is None"),
        ("std_msgs/msg/Int32", 1.5, "data takes int, and the value is a float"),
        ("std_msgs/msg/Int32", True, "data takes int, and the value is a bool"),
        ("std_msgs/msg/Bool", "x", "data takes bool, and the value is a str"),
        ("std_msgs/msg/Byte", 256, "data takes bytes, and the value is an int"),
    ],
)
def test_values_that_are_no_such_message(kind: str, value: Any, said: str) -> None:
    with pytest.raises(Unsendable, match=said):
        message_of(class_of(kind), value)
