"""Runs scripts of rclpy beside nodes of ROS 2 by another implementation, hiroz, and compares.

Both sides speak as `rmw_zenoh` does; the run of HPRM is the router. Each case is a script of
`tests/ros2` here and a role of the executable there. Run by `make conformance-ros2`, which compiles
that first. The exit code is 1 if a case does not do what it should.
"""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

SCRIPTS = Path(__file__).resolve().parents[1] / "ros2"
HPRM = Path(sys.executable).with_name("hprm")
PATIENCE_S = 60.0
SENT = "10368000 bytes that sum up to 1321920000"

VIEWER = """
import numpy as np
import rclpy
from sensor_msgs.msg import Image

def show(image):
    pixels = np.frombuffer(image.data, np.uint8)
    print(f"seen: {pixels.size} bytes that sum up to {pixels.sum()}", flush=True)
    raise SystemExit

rclpy.init()
node = rclpy.create_node("viewer")
node.create_subscription(Image, "image", show, 1)
rclpy.spin(node)
"""

CAMERA = """
import numpy as np
import rclpy
from sensor_msgs.msg import Image

rclpy.init()
node = rclpy.create_node("camera")
publisher = node.create_publisher(Image, "image", 1)
pixels = np.arange(3 * 2400 * 1440).astype(np.uint8)

def take():
    image = Image(width=2400, height=1440, encoding="rgb8", step=7200)
    image.data = pixels
    if publisher.get_subscription_count():
        publisher.publish(image)

node.create_timer(0.2, take)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""


class Wrong(Exception):
    """A case that does not do what it should; the message says what it does."""


class Run:
    """A run of HPRM, which is the router for the nodes beside it."""

    def __init__(self, script: Path, *words: str) -> None:
        """Start a script, and wait until nodes elsewhere can connect."""
        with socket.create_server(("127.0.0.1", 0)) as listener:
            self.endpoint = f"tcp/127.0.0.1:{listener.getsockname()[1]}"
        command = [HPRM, "ros", "run", f"--zenoh={self.endpoint}", script, *words]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        first = self.process.stderr.readline()
        if "this run is one as long as it lasts" not in first:
            raise Wrong(f"the run is no router: {first}{self.process.stderr.read()}")

    def ended(self) -> str:
        """Wait for the end, and return all that was written."""
        printed, errors = self.process.communicate(timeout=PATIENCE_S)
        return printed + errors

    def interrupt(self) -> None:
        """End the run in order."""
        self.process.send_signal(signal.SIGINT)
        self.ended()


@contextmanager
def running(script: Path, *words: str) -> Iterator[Run]:
    """Run a script meanwhile."""
    run = Run(script, *words)
    try:
        yield run
    finally:
        run.process.kill()
        run.process.wait()


def node(executable: str, role: str, run: Run) -> str:
    """Let a node elsewhere play its role, and return what it prints."""
    command = [executable, role, run.endpoint]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    if done.returncode != 0:
        raise Wrong(f"the node that is a {role} has failed: {done.stderr}")
    return done.stdout


def same(found: object, expected: object) -> None:
    """Refuse what differs."""
    if found != expected:
        raise Wrong(f"found {found!r}, not {expected!r}")


def a_topic_there(executable: str) -> None:
    """Five messages from a node elsewhere, which waits for our subscription."""
    with running(SCRIPTS / "listener.py") as run:
        node(executable, "talker", run)
        same(re.findall("heard: (.*)", run.ended()), [f"number {it}" for it in range(1, 6)])


def a_topic_here(executable: str) -> None:
    """Two subscriptions elsewhere, the one after the other has gone; nothing is missing between."""
    with running(SCRIPTS / "talker.py", "--ros-args", "-p", "period:=0.05") as run:
        for _ in range(2):
            numbers = [int(it.split()[1]) for it in node(executable, "listener", run).splitlines()]
            same(numbers, list(range(numbers[0], numbers[0] + 5)))
        run.interrupt()


def a_service_here(executable: str) -> None:
    """A client elsewhere calls our service."""
    with running(SCRIPTS / "add_server.py") as run:
        same(node(executable, "client", run), "40\n41\n42\n")
        run.interrupt()


def a_service_there(executable: str) -> None:
    """Our client calls a service elsewhere."""
    with running(SCRIPTS / "add_client.py", "40") as run:
        node(executable, "server", run)
        same(re.findall(r"40 \+ . is (\d+)", run.ended()), ["40", "41", "42"])


def an_image_there(executable: str) -> None:
    """An image of 10 MB comes from elsewhere."""
    with script(VIEWER) as path, running(path) as run:
        node(executable, "camera", run)
        same(re.findall("seen: (.*)", run.ended()), [SENT])


def an_image_here(executable: str) -> None:
    """An image of 10 MB goes elsewhere."""
    with script(CAMERA) as path, running(path) as run:
        same(node(executable, "viewer", run), f"2400 x 1440 rgb8 {SENT}\n")
        run.interrupt()


@contextmanager
def script(text: str) -> Iterator[Path]:
    """Write a script for a case."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "script.py")
        path.write_text(text)
        yield path


CASES: list[Callable[[str], None]] = [
    a_topic_there,
    a_topic_here,
    a_service_here,
    a_service_there,
    an_image_there,
    an_image_here,
]


def main() -> int:
    """Run all cases."""
    (executable,) = sys.argv[1:]
    failed = 0
    for case in CASES:
        try:
            case(executable)
            print(f"ok      {case.__name__.replace('_', ' ')}", flush=True)
        except (Wrong, subprocess.TimeoutExpired) as error:
            failed += 1
            print(f"FAILED  {case.__name__.replace('_', ' ')}: {error}", flush=True)
    print(f"{len(CASES) - failed} of {len(CASES)} cases pass")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
