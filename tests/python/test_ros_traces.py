"""Logical traces of programs of rclpy, where physical time decides on their end."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from processes import Bench, finish

# A thread ends it, some time after so many messages.
TALKER = """
import sys
import threading
import time
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("talker")
publisher = node.create_publisher(Int64, "numbers", 10)
is_enough = threading.Event()
count = 0


def end():
    is_enough.wait()
    # Between two callbacks.
    time.sleep(0.2)
    rclpy.shutdown()


def tick():
    global count
    count += 1
    publisher.publish(Int64(data=count))
    if count == int(sys.argv[1]):
        is_enough.set()


node.create_timer(0.5, tick)
threading.Thread(target=end).start()
try:
    rclpy.spin(node)
except ExternalShutdownException:
    pass
"""

LISTENER = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("listener")
ticks = 0


def tick():
    global ticks
    ticks += 1
    if ticks == 80:
        raise SystemExit


node.create_subscription(Int64, "numbers", lambda message: None, 10)
node.create_timer(0.02, tick)
rclpy.spin(node)
"""


# The thread ends it while a callback runs, which the script notices at the tag of that.
BUSY = """
import sys
import threading
import time
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Int64

rclpy.init()
node = Node("busy")
publisher = node.create_publisher(Int64, "numbers", 10)
runs, is_over = threading.Event(), threading.Event()
count = 0


def end():
    runs.wait()
    rclpy.get_default_context().on_shutdown(is_over.set)
    rclpy.shutdown()


def tick():
    global count
    count += 1
    publisher.publish(Int64(data=count))
    if count == int(sys.argv[1]):
        runs.set()
        is_over.wait()


node.create_timer(0.1, tick)
threading.Thread(target=end, daemon=sys.argv[2] == "daemon").start()
try:
    rclpy.spin(node)
except ExternalShutdownException:
    rclpy.try_shutdown()
"""


@pytest.mark.parametrize("kind", ["daemon", "joined"])
def test_a_script_that_its_thread_ends_during_a_callback_leaves_at_a_tag_of_the_clock(
    bench: Bench, tmp_path: Path, kind: str
) -> None:
    (tmp_path / "busy.py").write_text(BUSY)
    (tmp_path / "listener.py").write_text(LISTENER)
    for count in ("2", "4"):
        words = ["--start-time=0", f"--logical-trace={count}.trace", "busy.py", count, kind]
        outcome = finish(bench.call("ros", "run", *words, "+", "listener.py"))
        # Nothing waits for a thread that is at its end.
        assert (outcome.code, outcome.err) == (0, "")
    until = compared(tmp_path, "2.trace", "4.trace")
    assert 200_000_000 < until < 300_000_000


def test_a_script_that_its_thread_ends_is_compared_up_to_its_end(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "talker.py").write_text(TALKER)
    (tmp_path / "listener.py").write_text(LISTENER)
    for count in ("1", "2"):
        words = ["--start-time=0", f"--logical-trace={count}.trace", "talker.py", count]
        outcome = finish(bench.call("ros", "run", *words, "+", "listener.py"))
        assert outcome.code == 0, outcome.err
    # After the last message of the shorter run.
    assert compared(tmp_path, "1.trace", "2.trace") > 500_000_000


def compared(folder: Path, *traces: str) -> int:
    """Up to which logical time two traces are compared, which are equal."""
    hprm = Path(sys.executable).with_name("hprm")
    command = [hprm, "diff", *traces]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    until = re.search(r"equal: \d+ reactions compared, .* before \((\d+) ns, 1\)", done.stdout)
    assert until, done.stdout
    return int(until[1])
