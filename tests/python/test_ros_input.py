"""What is typed is for the first of several scripts of rclpy."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

from processes import finish, hear

KEYS = """\
import sys
import termios
import tty
import rclpy
from std_msgs.msg import String

before = termios.tcgetattr(sys.stdin)
rclpy.init()
node = rclpy.create_node("keys")
publisher = node.create_publisher(String, "keys", 10)
tty.setraw(sys.stdin.fileno())
print("ready", flush=True)
try:
    while (key := sys.stdin.read(1)) != "\\x03":
        publisher.publish(String(data=key))
finally:
    termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
"""

EAR = """\
import sys
import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("ear")
node.create_subscription(String, "keys", lambda key: print("key", key.data, flush=True), 10)
assert sys.stdin.read() == ""
rclpy.spin(node)
"""


def test_a_script_reads_keys_beside_another_one(tmp_path: Path) -> None:
    (tmp_path / "keys.py").write_text(KEYS)
    (tmp_path / "ear.py").write_text(EAR)
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [Path(sys.executable).parent / "hprm", "ros", "run", "keys.py", "+", "ear.py"],
        cwd=tmp_path,
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        heard = hear(process.stdout, "ready\n")
        for key in "ab":
            os.write(ours, key.encode())
            heard += hear(process.stdout, f"key {key}\n")
        os.write(ours, b"\x03")
        process.send_signal(signal.SIGINT)
        assert finish(process).code == 130
    finally:
        process.kill()
        os.close(ours)
        os.close(theirs)
    keys = [it for it in heard.splitlines() if "[ear-2]" in it]
    assert keys == ["[ear-2] key a", "[ear-2] key b"]
