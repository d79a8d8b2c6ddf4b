"""Whether programs of ROS 2 do the same in each run on a loaded machine, with tags and without.

The programs are those of `examples/ros2_port`. Each runs some times as it is, and all logical
traces have to be equal. The fusion runs as often again so that its messages travel without tags, as
in ROS 2: all that it publishes or subscribes to is made after the start (`ros2_late.py`). What is
counted then is how many different choices it makes of measurements that belong together. Run by
`make bench-ros2-order`. The exit code is 1 if traces differ.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from busy import busy

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ROOT / "examples" / "ros2_port"
LATE = Path(__file__).with_name("ros2_late.py")
HPRM = Path(sys.executable).with_name("hprm")

#: The words behind `hprm` that run each program.
TAGGED = {
    "talker and listener": ["ros", "run", "{}", "talker.py", "+", "listener.py"],
    "service": ["launch", "{}", "service.launch.py"],
    "action": ["launch", "{}", "action.launch.py"],
    "parameters": ["launch", "{}", "parameters.launch.py"],
    "images": ["launch", "{}", "images.launch.py"],
    "transforms": ["ros", "run", "{}", "carrot.py", "+", "follower.py"],
    "fusion": ["launch", "{}", "fusion.launch.py"],
    "lifecycle": ["launch", "{}", "lifecycle.launch.py"],
}
#: What the launch file of the fusion starts.
SENSORS = {"left": "0.033", "right": "0.033", "lidar": "0.1"}
TIME_LIMIT_S = 120.0


class Failed(Exception):
    """A program did not do its work; the message says which and why."""


def main() -> int:
    """Run all of it, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="of each program (10)")
    parser.add_argument("--load", type=int, default=2 * (os.cpu_count() or 1), metavar="N")
    options = parser.parse_args()
    if options.runs < 2 or options.load < 0:
        parser.error("it takes two runs or more, and no negative load")
    print(f"{options.runs} runs each, beside {options.load} processes that compute")
    try:
        with busy(options.load):
            equal = [traces_are_equal(name, options.runs) for name in TAGGED]
            results = Counter(untagged_fusion() for _ in range(options.runs))
    except Failed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"fusion without tags: {len(results)} different results in {options.runs} runs")
    for result, count in results.most_common(2):
        print(f"  {count} times:", *(line.partition("fused ")[2] for line in result.splitlines()))
    return 0 if all(equal) else 1


def traces_are_equal(name: str, runs: int) -> bool:
    """Run a program, print whether it did the same each time, and return it."""
    with tempfile.TemporaryDirectory() as folder:
        traces = [Path(folder, f"{number}.trace") for number in range(runs)]
        for trace in traces:
            option = f"--logical-trace={trace}"
            words = [word.format(option) for word in TAGGED[name]]
            words.insert(words.index(option), "--start-time=0")
            run([str(HPRM), *words])
        compared = [
            subprocess.run([HPRM, "diff", traces[0], other], capture_output=True, text=True)
            for other in traces[1:]
        ]
    different = [it.stdout + it.stderr for it in compared if it.returncode]
    how = f"{len(different)} traces differ: {different[0]}" if different else "all traces are equal"
    print(f"{name}: {how}", flush=True)
    return not different


def untagged_fusion() -> str:
    """Run the fusion without tags, and return which measurements it has put together."""
    words = [str(HPRM), "ros", "run", "--start-time=0"]
    for name, period in SENSORS.items():
        words += [str(LATE), "sensor.py", "--ros-args", "-r", f"__node:={name}", "+"]
        words[-1:-1] = ["-p", f"period:={period}", "-p", "count:=40", "-r", f"measured:={name}"]
    lines = run([*words, str(LATE), "fusion.py"]).splitlines()
    return "\n".join(line.partition(" at ")[0] for line in lines)


def run(command: list[str]) -> str:
    """Run a command among the programs, and return what it has printed."""
    try:
        done = subprocess.run(
            command, cwd=PROGRAMS, capture_output=True, text=True, timeout=TIME_LIMIT_S
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"{' '.join(command)} took longer than {TIME_LIMIT_S:.0f} s") from None
    if done.returncode != 0:
        raise Failed(f"{' '.join(command)} failed\n{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
