"""The bridge to nodes of ROS 2 elsewhere: interrupted while it starts, and beside a launch file."""

from __future__ import annotations

import signal
import socket
from pathlib import Path

import pytest
from processes import ROOT, Bench, finish, hear
from tcp_ports import free_ports
from zenoh_peer import STRING, TEN, Peer, beside, text

SCRIPTS = ROOT / "tests" / "ros2"
TALKER = str(SCRIPTS / "talker.py")

# Each interpreter imports it first: Ctrl-C comes when the command imports a module.
AT_IMPORT = """\
import os, signal, sys

class Finder:
    def find_spec(name, path=None, target=None):
        if name == os.environ["MOMENT"] and "HPRM_ROS_COORDINATOR" not in os.environ:
            sys.meta_path.remove(Finder)
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder)
"""

# Ctrl-C comes when the interpreter of a script starts, to the command and then to the script.
AT_SCRIPT = """\
import os, signal, time

if "HPRM_ROS_COORDINATOR" in os.environ:
    os.kill(os.getppid(), signal.SIGINT)
    until = time.monotonic() + 5
    while signal.SIGINT not in signal.sigpending() and time.monotonic() < until:
        pass
"""


@pytest.mark.parametrize(
    "moment",
    ["hprm.ros._coordinator", "zenoh", "zenoh.ext", "hprm.ros._zenoh.bridge"],
)
def test_a_bridge_that_is_loaded_may_be_interrupted(
    bench: Bench, tmp_path: Path, moment: str
) -> None:
    (tmp_path / "sitecustomize.py").write_text(AT_IMPORT)
    environment = {"PYTHONPATH": str(tmp_path), "MOMENT": moment}
    option = f"--zenoh=tcp/localhost:{free_ports(1)[0]}"
    outcome = finish(bench.call("ros", "run", option, TALKER, environment=environment))
    assert (outcome.code, outcome.out) == (130, "")
    # Nothing but that the run is the router.
    assert len(outcome.err.splitlines()) == (moment == "hprm.ros._zenoh.bridge"), outcome.err


def test_a_bridge_that_connects_may_be_interrupted(bench: Bench) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        # It accepts, and says nothing.
        option = f"--zenoh=tcp/0.0.0.0:{silent.getsockname()[1]}"
        process = bench.call("ros", "run", option, TALKER)
        with silent.accept()[0]:
            process.send_signal(signal.SIGINT)
            outcome = finish(process)
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "")


def test_a_bridge_that_is_open_may_be_interrupted(bench: Bench) -> None:
    process = bench.call("ros", "run", f"--zenoh=tcp/localhost:{free_ports(1)[0]}", TALKER)
    hear(process.stderr, "this run is one as long as it lasts\n")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert outcome.code == 130
    assert "Fatal" not in outcome.err and "Aborted" not in outcome.err


@pytest.mark.parametrize("is_bridged", [True, False])
def test_scripts_that_start_may_be_interrupted(
    bench: Bench, tmp_path: Path, is_bridged: bool
) -> None:
    (tmp_path / "sitecustomize.py").write_text(AT_SCRIPT)
    words = [f"--zenoh=tcp/localhost:{free_ports(1)[0]}"] if is_bridged else []
    words += [TALKER, "+", TALKER]
    outcome = finish(bench.call("ros", "run", *words, environment={"PYTHONPATH": str(tmp_path)}))
    assert (outcome.code, outcome.out) == (130, "")
    assert "Traceback" not in outcome.err and "Fatal" not in outcome.err, outcome.err


LAUNCH = """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([Node(executable={listener!r}, name="ear", namespace="robot")])
"""


def test_a_launch_file_has_a_bridge(bench: Bench, tmp_path: Path) -> None:
    listener = str(SCRIPTS / "listener.py")
    (tmp_path / "a.launch.py").write_text(LAUNCH.format(listener=listener))
    peer = Peer()
    try:
        peer.watch()
        process = bench.call("launch", peer.option, "a.launch.py")
        # What the launch file says of the node is seen elsewhere.
        token = peer.await_token("/ear/%robot%chatter/")
        assert token.endswith(f"/MS/%/%robot/ear/%robot%chatter/{STRING}/{TEN}"), token
        for number in range(1, 6):
            peer.put(f"0/robot/chatter/{STRING}", text(f"number {number}"), beside(number))
        outcome = finish(process)
    finally:
        peer.close()
    assert outcome.code == 0, outcome.err
    heard = [it.partition("heard: ")[2] for it in outcome.err.splitlines() if "heard" in it]
    assert heard == [f"number {it}" for it in range(1, 6)]
