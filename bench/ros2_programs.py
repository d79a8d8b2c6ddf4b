"""How quick programs of rclpy are: messages beside Cyclone DDS and Zenoh, a timer, a launch.

A talker sends images of 64 B and of 10 MB to a listener in another process, and the bindings for
Python of the peers do the same; contenders take turns. Beside that: which part of a processor a
node with a timer of 100 Hz takes, and how long a launch of 20 nodes takes to the first callback of
the last one. Run by `make bench-ros2`; writes out/ros2.json.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "peers"))

import environments
from ports import free_ports
from shown import show

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = Path(__file__).with_name("ros2")
HPRM = Path(sys.executable).with_name("hprm")
OUT = ROOT / "out" / "ros2.json"
TIME_LIMIT_S = 120.0

#: Size in bytes, number and period in seconds of the messages.
SIZES = {"64 B": (64, 300, 0.01), "10 MB": (10_000_000, 60, 0.05)}
#: The peers, each with the environment and the program of its talker and listener.
PEERS = {"cyclonedds": "dds.py", "zenoh": "keyed.py"}
#: The domain of Cyclone DDS, in which nothing else is.
DOMAIN = "77"


class Failed(Exception):
    """A program did not do its work; the message says which and why."""


def main() -> int:
    """Measure all of it, and show it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=5, help="of each figure (5)")
    parser.add_argument("--quick", action="store_true", help="one of each, with few messages")
    options = parser.parse_args()
    repetitions = 1 if options.quick else options.repetitions
    contenders = ["hprm.ros", *filter(_takes_part, PEERS)]
    took: dict[str, list[float]] = {}
    try:
        for _ in range(repetitions):
            for size in SIZES:
                for name in contenders:
                    took.setdefault(f"{name} {size}", []).extend(pair(name, size, options.quick))
        used = [idle(options.quick) for _ in range(repetitions)]
        started = [launch(20) for _ in range(repetitions)]
    except Failed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    figures = {name: _figures(values) for name, values in took.items()}
    show(
        "Talker to listener, us one way",
        ["", *(f"{size} {part}" for size in SIZES for part in ("median", "99 %"))],
        [
            [name, *(f"{it:.0f}" for size in SIZES for it in figures[f"{name} {size}"])]
            for name in contenders
        ],
    )
    print(f"node with a timer of 100 Hz: {100 * statistics.median(used):.2f} % of a processor")
    print(f"launch of 20 nodes: {statistics.median(started):.2f} s to the last first callback")
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps({"us": figures, "idle": used, "launch_s": started}, indent=1))
    return 0


def _takes_part(name: str) -> bool:
    """Make the environment of a peer, or say why it takes no part."""
    try:
        environments.prepare(name)
    except environments.Unavailable as why:
        print(f"{name} takes no part: {why}", file=sys.stderr)
        return False
    return True


def _figures(values: list[float]) -> tuple[float, float]:
    """The median, and what 99 % do not exceed, in us."""
    ordered = sorted(values)
    return statistics.median(ordered) / 1e3, ordered[int(0.99 * (len(ordered) - 1))] / 1e3


def pair(name: str, size: str, is_quick: bool) -> list[float]:
    """Run a talker and a listener; return how long each message has taken, in ns."""
    length, count, period = SIZES[size]
    words = [str(length), str(10 if is_quick else count), str(period)]
    if name == "hprm.ros":
        program = str(PROGRAMS / "pair.py")
        scripts = [program, "talker", *words, "+", program, "listener", *words]
        printed = run([str(HPRM), "ros", "run", *scripts])
        (line,) = [it for it in printed.splitlines() if it.startswith("[pair-2] ")]
        return list(map(float, line.split()[1:]))
    words.append(DOMAIN if name == "cyclonedds" else str(free_ports(1)[0]))
    program = [str(environments.python_of(name)), str(PROGRAMS / PEERS[name])]
    with subprocess.Popen([*program, "talker", *words]) as talker:
        try:
            printed = run([*program, "listener", *words])
            talker.wait(TIME_LIMIT_S)
        finally:
            talker.kill()
    return list(map(float, printed.split()))


def idle(is_quick: bool) -> float:
    """Return which part of a processor a node takes with a timer of 100 Hz."""
    program = str(PROGRAMS / "idle.py")
    return float(run([str(HPRM), "ros", "run", program, "100", "20" if is_quick else "500"]))


def launch(nodes: int) -> float:
    """Return after how many seconds the last node of a launch runs its first callback."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "all.launch.py")
        file.write_text(
            "from launch import LaunchDescription\n"
            "from launch_ros.actions import Node\n"
            "def generate_launch_description():\n"
            f"    return LaunchDescription([Node(executable={str(PROGRAMS / 'first.py')!r},"
            f" name=f'first{{it}}') for it in range({nodes})])\n"
        )
        begun = time.monotonic_ns()
        printed = run([str(HPRM), "launch", str(file)])
    times = [int(line.split()[1]) for line in printed.splitlines()]
    if len(times) != nodes:
        raise Failed(f"{len(times)} of {nodes} nodes have run: {printed}")
    return (max(times) - begun) / 1e9


def run(words: list[str]) -> str:
    """Run a command to its end; return what it prints."""
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        raise Failed(f"{' '.join(words)} has not ended for {TIME_LIMIT_S:g} s") from None
    if done.returncode != 0:
        raise Failed(f"{' '.join(words)} has failed: {done.stderr}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
