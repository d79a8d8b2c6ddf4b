"""`hprm echo --foxglove`, seen by a client of Foxglove's protocol over a real WebSocket."""

from __future__ import annotations

import base64
import json
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from processes import Bench, finish, hear
from test_echo import start, stop
from websockets.sync.client import ClientConnection, connect

from hprm._foxglove import topic_of

PROGRAM = """\
target Python { keepalive: true }
preamble {=
import dataclasses
import numpy as np
@dataclasses.dataclass
class Pose:
    x: float
    points: np.ndarray
=}
reactor Camera {
  output[6] outs
  state n = 0
  timer t(0, 20 ms)
  reaction(t) -> outs {=
    values = [
        np.full((4, 6, 3), self.n % 256, dtype=np.uint8),
        np.arange(12, dtype=np.float32).reshape(4, 3) + self.n,
        self.n,
        {"n": self.n, "nested": {"speed": 0.5}, "mask": np.eye(4, dtype=np.uint8)},
        f"frame {self.n}",
        Pose(1.5, np.zeros((2, 4))),
    ]
    for out, value in zip(outs, values):
        out.set(value)
    self.n += 1
  =}
}
reactor Sink {
  input[6] inputs
  reaction(inputs) {= pass =}
}
federated reactor {
  camera = new Camera()
  sink = new Sink()
  camera.outs -> sink.inputs
}
"""


class Client:
    """A viewer."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.topics: dict[str, dict[str, Any]] = {}
        self.subscriptions: dict[int, str] = {}

    def _receive(self) -> tuple[str, int, bytes] | None:
        """Take what comes next: if it is a message, its topic, its time, and itself."""
        received = self.connection.recv(timeout=30)
        if isinstance(received, str):
            told = json.loads(received)
            for channel in told.get("channels", []) if told["op"] == "advertise" else []:
                self.topics[channel["topic"]] = channel
            return None
        if received[0] != 1:
            return None
        number, time = struct.unpack_from("<IQ", received, 1)
        return self.subscriptions[number], time, bytes(received[13:])

    def read(self, topic: str) -> tuple[int, bytes]:
        """Subscribe to a topic, and return a message on it."""
        while topic not in self.topics:
            self._receive()
        number = len(self.subscriptions)
        self.subscriptions[number] = topic
        subscription = {"id": number, "channelId": self.topics[topic]["id"]}
        asked = {"op": "subscribe", "subscriptions": [subscription]}
        self.connection.send(json.dumps(asked))
        while True:
            received = self._receive()
            if received is not None and received[0] == topic:
                return received[1:]

    def message(self, topic: str) -> tuple[int, Any]:
        """Return the time of a message, and what it says by the schema of its topic."""
        time, data = self.read(topic)
        return time, decoded(self.topics[topic], data)

    def fields(self, topic: str) -> tuple[int, Any]:
        """Return the time of a message in JSON, and its fields."""
        time, data = self.read(topic)
        return time, json.loads(data)


@contextmanager
def viewer(echo: subprocess.Popen[str]) -> Iterator[Client]:
    """A client of the server that the command says it is."""
    address = hear(echo.stdout, "\n").split()[1]
    assert address.startswith("ws://127.0.0.1:")
    protocol: Any = "foxglove.sdk.v1"
    with connect(address, subprotocols=[protocol]) as connection:
        yield Client(connection)


def watch(bench: Bench, run: subprocess.Popen[str], *words: str) -> subprocess.Popen[str]:
    options = ["--foxglove=127.0.0.1:0", "--wait", "30", "--of", str(run.pid)]
    return bench.call("echo", *words, *options)


def decoded(channel: dict[str, Any], data: bytes) -> Any:
    """A message, read by the schema that the channel has."""
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    described = pool.FindMessageTypeByName(channel["schemaName"])
    return message_factory.GetMessageClass(described).FromString(data)


def test_a_viewer_sees_images_points_numbers_and_texts(bench: Bench) -> None:
    run = start(bench, PROGRAM)
    echo = watch(bench, run)
    with viewer(echo) as client:
        time, image = client.message("/camera/outs/0")
        assert (image.encoding, image.width, image.height, image.step) == ("rgb8", 6, 4, 18)
        number = image.data[0]
        assert image.data == bytes([number]) * 72
        assert image.timestamp.ToNanoseconds() == time
        again, image = client.message("/camera/outs/0")
        # The time is that of the tags, so its steps are exact.
        assert (again - time) % 20_000_000 == 0
        assert (again - time) // 20_000_000 % 256 == (image.data[0] - number) % 256
        _, cloud = client.message("/camera/outs/1")
        names = [(it.name, it.offset, it.type) for it in cloud.fields]
        assert names == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
        points = np.frombuffer(cloud.data, np.float32).reshape(-1, cloud.point_stride // 4)
        assert (points - points[0, 0]).tolist() == np.arange(12.0).reshape(4, 3).tolist()
        time, fields = client.fields("/camera/outs/2")
        assert (time - again) // 20_000_000 % 256 == (fields["value"] - image.data[0]) % 256
        _, fields = client.fields("/camera/outs/3")
        assert (fields["n"] > 0, fields["nested"]) == (True, {"speed": 0.5})
        _, mask = client.message("/camera/outs/3/mask")
        assert (mask.encoding, mask.data[:5]) == ("mono8", bytes([1, 0, 0, 0, 0]))
        _, log = client.message("/camera/outs/4")
        assert log.message.startswith("frame ")
        # A class that the viewer does not have.
        assert client.fields("/camera/outs/5")[1] == {"x": 1.5}
        _, cloud = client.message("/camera/outs/5/points")
        names = [(it.name, it.offset, it.type) for it in cloud.fields]
        assert names == [("x", 0, 8), ("y", 8, 8), ("z", 16, 8), ("intensity", 24, 8)]
        time, about = client.fields("/camera/outs/2/message")
        assert about["elapsed"] * 1e9 % 20_000_000 < 1_000
        assert abs(about["sent"] - about["delay"] - time / 1e9) < 1e-3
        schema = json.loads(client.topics["/camera/outs/3"]["schema"])
        assert schema["properties"]["nested"]["properties"] == {"speed": {"type": "number"}}
    echo.send_signal(signal.SIGINT)
    outcome = finish(echo)
    assert (outcome.code, outcome.err) == (0, "")
    stop(run)


def test_what_cannot_be_shown_is_told_once(bench: Bench) -> None:
    text = PROGRAM.replace("self.n,\n        {", "b'raw',\n        {")
    text = text.replace('f"frame {self.n}"', "{'lock': complex(1)}").replace("Pose(1.5", "Odd(1.5")
    text = text.replace("class Pose:", "class Odd:\n    def __reduce__(self): return Odd, (1, 2)")
    run = start(bench, text)
    echo = watch(bench, run)
    with viewer(echo) as client:
        first, _ = client.message("/camera/outs/0")
        while client.message("/camera/outs/0")[0] < first + 10 * 20_000_000:
            pass
    echo.send_signal(signal.SIGINT)
    outcome = finish(echo)
    assert outcome.code == 0
    assert sorted(outcome.err.splitlines()) == [
        "camera.outs[2] is not shown: it is a bytes",
        "camera.outs[4]/lock is not shown: it is a complex",
        "camera.outs[5] is not shown: the value at camera.outs[5] is a pickle of __main__.Odd, "
        "and pickles are not read",
    ]
    stop(run)


def test_the_end_of_the_federation_ends_it(bench: Bench) -> None:
    run = start(bench, PROGRAM)
    echo = watch(bench, run, "camera.outs[2]")
    hear(echo.stdout, "\n")
    stop(run)
    outcome = finish(echo)
    assert (outcome.code, outcome.err) == (0, "the federation has ended\n")


def test_only_ports_that_are_named_are_shown(bench: Bench) -> None:
    run = start(bench, PROGRAM)
    echo = watch(bench, run, "sink.inputs[2]", "camera.outs[4]")
    with viewer(echo) as client:
        for _ in range(3):
            client.fields("/sink/inputs/2")
            client.message("/camera/outs/4")
        messages = {f"{it}/message" for it in ("/sink/inputs/2", "/camera/outs/4")}
        assert set(client.topics) == {"/sink/inputs/2", "/camera/outs/4"} | messages
    echo.send_signal(signal.SIGINT)
    assert finish(echo).code == 0
    stop(run)


def test_what_is_wrong_is_one_error(bench: Bench) -> None:
    run = start(bench, PROGRAM)
    outcome = finish(watch(bench, run, "camera.outz"))
    assert outcome.code == 1
    outcome.assert_one_error("camera has no port outz", "its ports: `outs[0]`")
    outcome = finish(bench.call("echo", "--foxglove", "--of", "NoSuchFederation"))
    assert outcome.code == 1
    outcome.assert_one_error("no federation NoSuchFederation of this user runs")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        words = ["echo", f"--foxglove={address}", "--of", str(run.pid), "--wait", "30"]
        outcome = finish(bench.call(*words))
    assert outcome.code == 1
    outcome.assert_one_error(f"cannot listen at {address}: Address already in use", "free port")
    for words, said in (
        (["--foxglove=8765"], "not an address, such as 127.0.0.1:8765"),
        (["--foxglove", "--full"], "cannot be used with '--full'"),
        (["--foxglove", "--once"], "cannot be used with '--once'"),
    ):
        outcome = finish(bench.call("echo", *words))
        assert outcome.code == 2
        outcome.assert_one_error(said)
    stop(run)


def test_without_the_package_the_error_says_how_to_install_it(bench: Bench, tmp_path: Path) -> None:
    # A module in the way that is like none.
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['foxglove'] = None\n")
    environment = {"PYTHONPATH": str(tmp_path)}
    outcome = finish(bench.call("echo", "--foxglove", environment=environment))
    assert outcome.code == 1
    python = Path(sys.executable).with_name("python3")
    outcome.assert_one_error(
        f"the package foxglove-sdk is not installed for {python}",
        f"install it there: {python} -m pip install foxglove-sdk",
    )


@pytest.mark.parametrize(
    ("port", "topic"),
    [("camera.image", "/camera/image"), ("camera[1].image[0]", "/camera/1/image/0")],
)
def test_topics_have_no_brackets(port: str, topic: str) -> None:
    assert topic_of(port) == topic
