"""The log of nodes as messages, and its levels, which other programs set."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from processes import Bench, finish

TALKS = """
import rclpy
from rclpy.logging import get_logger
from rclpy.node import Node

rclpy.init()
node = Node("talks", namespace="robot", enable_logger_service=True)
quiet = Node("quiet", enable_rosout=False)
node.get_logger().info("before the start")
count = 0


def talk():
    global count
    count += 1
    logger = node.get_logger()
    logger.debug(f"detail {count}")
    logger.info(f"count {count}")
    logger.get_child("arm").warning("a child")
    quiet.get_logger().info("not told")
    get_logger("nobody").error("not told")
    if count == 3:
        logger.fatal("over")
        raise SystemExit


node.create_timer(0.1, talk)
rclpy.spin(node)
"""

HEARS = """
import os
import rclpy
from rcl_interfaces.msg import Log, LoggerLevel
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

rclpy.init()
node = Node("hears")


def show(it):
    print(it.level, it.name, it.msg, os.path.basename(it.file), it.function, it.line, flush=True)
    if it.level == Log.FATAL:
        print((it.stamp.sec + it.stamp.nanosec * 1e-9) > 1e9)
        raise SystemExit


async def ask():
    timer.cancel()
    asked = ["robot.talks", "other"]
    levels = [LoggerLevel(name="robot.talks", level=10), LoggerLevel(name="other", level=11)]
    for result in (await setting.call_async(SetLoggerLevels.Request(levels=levels))).results:
        print(result.successful, result.reason)
    found = await getting.call_async(GetLoggerLevels.Request(names=asked))
    print([(it.name, it.level) for it in found.levels], flush=True)


node.create_subscription(Log, "/rosout", show, 100)
group = ReentrantCallbackGroup()
asks = dict(callback_group=group)
getting = node.create_client(GetLoggerLevels, "/robot/talks/get_logger_levels", **asks)
setting = node.create_client(SetLoggerLevels, "/robot/talks/set_logger_levels", **asks)
timer = node.create_timer(0.25, ask)
rclpy.spin(node)
"""

TOLD = """\
20 robot.talks before the start talks.py <module> 9
20 robot.talks count 1 talks.py talk 18
30 robot.talks.arm a child talks.py talk 19
20 robot.talks count 2 talks.py talk 18
30 robot.talks.arm a child talks.py talk 19
True\x20
False Failed reason: Invalid logger level.
[('robot.talks', 10), ('other', 0)]
10 robot.talks detail 3 talks.py talk 17
20 robot.talks count 3 talks.py talk 18
30 robot.talks.arm a child talks.py talk 19
50 robot.talks over talks.py talk 23
True
"""


@pytest.mark.parametrize("order", [("talks", "hears"), ("hears", "talks")], ids=["first", "last"])
def test_what_loggers_write_is_told(bench: Bench, tmp_path: Path, order: tuple[str, str]) -> None:
    (tmp_path / "talks.py").write_text(TALKS)
    (tmp_path / "hears.py").write_text(HEARS)
    outcome = finish(bench.call("ros", "run", f"{order[0]}.py", "+", f"{order[1]}.py"))
    assert outcome.code == 0, outcome.err
    label = f"[hears-{1 + order.index('hears')}] "
    assert outcome.out.replace(label, "") == TOLD, outcome.err
    assert "[quiet]: not told" in outcome.err


LEVELS = """
import rclpy
from rclpy.node import Node

rclpy.init()
for name in ("one", "two"):
    logger = Node(name).get_logger()
    logger.debug("debug")
    logger.info("info")
    logger.warning("warning")
"""


@pytest.mark.parametrize(
    ("words", "written"),
    [
        ([], ["one info", "one warning", "two info", "two warning"]),
        (["--log-level", "warn"], ["one warning", "two warning"]),
        (
            ["--log-level", "one:=debug", "--log-level", "two:=error"],
            ["one debug", "one info", "one warning"],
        ),
        (["--disable-stdout-logs"], []),
    ],
)
def test_the_command_line_sets_levels(
    bench: Bench, tmp_path: Path, words: list[str], written: list[str]
) -> None:
    (tmp_path / "levels.py").write_text(LEVELS)
    more = ["--ros-args", *words] if words else []
    outcome = finish(bench.call("ros", "run", "levels.py", *more))
    assert outcome.code == 0, outcome.err
    found = re.findall(r"^\[\w+\] \[[\d.]+\] \[(\w+)\]: (\w+)$", outcome.err, re.MULTILINE)
    assert [" ".join(it) for it in found] == written
