"""Loggers of `hprm.ros`: what they print, their levels and filters, as in rclpy."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator

import pytest

from hprm.ros import logging
from hprm.ros._lines import write_line
from hprm.ros._log_console import Console, LogRecord, output
from hprm.ros.impl.rcutils_logger import RcutilsLogger
from hprm.ros.logging import LoggingSeverity, get_logger

NOW = 1_700_000_000_123_456_789


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """The time of messages, in a list so that a test can change it; all levels are forgotten."""
    for name in list(os.environ):
        if name.startswith("RCUTILS_"):
            monkeypatch.delenv(name)
    logging.clear_config()
    time = [NOW]
    output.set_time_source(lambda: time[0])
    yield time
    output.set_time_source(None)
    output.listeners.clear()
    logging.clear_config()


def test_a_message_is_one_line_on_the_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert get_logger("talker").info("hello") is True
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "[INFO] [1700000000.123456789] [talker]: hello\n"


def test_each_severity_has_a_method(capsys: pytest.CaptureFixture[str]) -> None:
    logging.set_logger_level("n", LoggingSeverity.DEBUG)
    for method in ("debug", "info", "warning", "warn", "error", "fatal"):
        getattr(get_logger("n"), method)("x")
    printed = re.findall(r"^\[(\w+)\]", capsys.readouterr().err, flags=re.MULTILINE)
    assert printed == ["DEBUG", "INFO", "WARN", "WARN", "ERROR", "FATAL"]


def test_without_a_time_source_the_time_is_that_of_the_system() -> None:
    code = "from hprm.ros.logging import get_logger; get_logger('a').info('b')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == ""
    stamp = re.fullmatch(r"\[INFO\] \[(\d{10})\.\d{9}\] \[a\]: b\n", run.stderr)
    assert stamp is not None and int(stamp[1]) > 1_700_000_000


def test_the_environment_configures_the_form(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    form = r"{severity}\t{message} {name} {time_as_nanoseconds} {function_name} {file_name} {x}"
    monkeypatch.setenv("RCUTILS_CONSOLE_OUTPUT_FORMAT", form)
    get_logger("n").warning("{name}")
    here = "test_the_environment_configures_the_form"
    assert capsys.readouterr().err == f"WARN\t{{name}} n {NOW} {here} {__file__} {{x}}\n"


def test_a_form_may_have_lines_and_dates() -> None:
    console = Console({"RCUTILS_CONSOLE_OUTPUT_FORMAT": "{line_number} {date_time_with_ms}"})
    record = LogRecord(NOW, LoggingSeverity.INFO, "n", "m", "file", "function", 12)
    assert re.fullmatch(r"12 2023-11-1\d \d\d:\d\d:\d\d\.123", console.line(record))


def test_times_near_the_epoch_have_ten_digits() -> None:
    record = LogRecord(1_000_000_005, LoggingSeverity.INFO, "n", "m", "file", "function", 1)
    assert Console({}).line(record) == "[INFO] [0000000001.000000005] [n]: m"


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_only_a_terminal_gets_colors(monkeypatch: pytest.MonkeyPatch) -> None:
    colors = {"debug": "\033[32m", "info": "\033[0m", "warn": "\033[33m", "error": "\033[31m"}
    logging.set_logger_level("n", 10)
    for method, color in colors.items():
        terminal = Terminal()
        monkeypatch.setattr(sys, "stderr", terminal)
        getattr(get_logger("n"), method)("x")
        assert terminal.getvalue().startswith(f"{color}[")
        assert terminal.getvalue().endswith("x\033[0m\n")
    plain = io.StringIO()
    monkeypatch.setattr(sys, "stderr", plain)
    get_logger("n").error("x")
    assert "\033" not in plain.getvalue()


def test_the_environment_overrides_colors(monkeypatch: pytest.MonkeyPatch) -> None:
    for value, stream in (("1", io.StringIO()), ("0", Terminal())):
        monkeypatch.setenv("RCUTILS_COLORIZED_OUTPUT", value)
        monkeypatch.setattr(sys, "stderr", stream)
        logging.initialize()
        get_logger("n").error("x")
        assert ("\033[31m" in stream.getvalue()) is (value == "1")
    with pytest.raises(ValueError, match="RCUTILS_COLORIZED_OUTPUT is 'yes': it must be 0 or 1"):
        Console({"RCUTILS_COLORIZED_OUTPUT": "yes"})


def test_the_environment_asks_for_the_standard_output(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RCUTILS_LOGGING_USE_STDOUT", "1")
    get_logger("n").info("x")
    assert capsys.readouterr().out.endswith("[n]: x\n")


def test_a_stream_that_is_gone_does_not_end_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = io.StringIO()
    closed.close()
    for stream in (closed, None):
        monkeypatch.setattr(sys, "stderr", stream)
        assert get_logger("n").info("x") is True


def test_loggers_inherit_levels_along_the_dots(capsys: pytest.CaptureFixture[str]) -> None:
    child = get_logger("robot").get_child("arm")
    assert child.name == "robot.arm"
    assert child.get_effective_level() == LoggingSeverity.INFO
    assert child.debug("no") is False
    logging.set_logger_level("robot", LoggingSeverity.DEBUG)
    assert child.debug("yes") is True
    assert get_logger("robotics").debug("no") is False
    assert logging.get_logger_level("robot.arm") == LoggingSeverity.UNSET
    assert logging.get_logger_effective_level("robot.arm") == LoggingSeverity.DEBUG
    child.set_level(LoggingSeverity.ERROR)
    assert child.is_enabled_for(30) is False
    child.set_level(LoggingSeverity.UNSET)
    assert child.get_effective_level() == LoggingSeverity.DEBUG
    assert capsys.readouterr().err.count("\n") == 1


def test_the_root_has_the_default_level() -> None:
    assert logging.get_logger_level("") == LoggingSeverity.INFO
    logging.set_logger_level("", LoggingSeverity.FATAL)
    assert get_logger("any").get_effective_level() == LoggingSeverity.FATAL
    logging.set_logger_level("", LoggingSeverity.UNSET)
    assert get_logger("any").debug("all is written") is True
    logging.clear_config()
    assert get_logger("any").get_effective_level() == LoggingSeverity.INFO


def test_names_and_levels_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="Logger name must not be empty"):
        get_logger("")
    with pytest.raises(ValueError, match="Child logger name must not be empty"):
        get_logger("a").get_child("")
    with pytest.raises(ValueError):
        logging.set_logger_level("a", 7)
    with pytest.raises(RuntimeError, match="'loud' is no severity: there are UNSET, DEBUG"):
        logging.get_logging_severity_from_string("loud")
    assert logging.get_logging_severity_from_string("warn") == LoggingSeverity.WARN
    with pytest.raises(TypeError, match="a message of the log must be a str, not int"):
        get_logger("a").info(1)  # type: ignore[arg-type]


def test_a_message_may_go_under_another_name(capsys: pytest.CaptureFixture[str]) -> None:
    RcutilsLogger("a").log("x", LoggingSeverity.INFO, name="b")
    assert "[b]: x" in capsys.readouterr().err


def test_once_and_skip_first_count_the_calls_of_a_place() -> None:
    logger = get_logger("n")
    once = [logger.info("x", once=True) for _ in range(3)]
    skipped = [logger.info("x", skip_first=True) for _ in range(3)]
    both = [logger.info("x", skip_first=True, once=True) for _ in range(3)]
    assert once == [True, False, False]
    assert skipped == [False, True, True]
    assert both == [False, True, False]
    assert (logger.info("x", once=True), logger.info("y", once=True)) == (True, True)


def test_a_throttle_goes_by_the_time_of_messages(clock: list[int]) -> None:
    logger = get_logger("n")
    written = []
    for _ in range(7):
        written.append(logger.info("x", throttle_duration_sec=1.0))
        clock[0] += 400_000_000
    assert written == [True, False, False, True, False, False, True]


def test_a_throttle_goes_by_a_clock() -> None:
    class Clock:
        nanoseconds = 5 * 10**9

        def now(self) -> Clock:
            return self

    clock = Clock()
    logger = get_logger("n")

    def log() -> bool:
        return logger.info("x", throttle_duration_sec=2, throttle_time_source_type=clock)

    assert [log(), log()] == [True, False]
    clock.nanoseconds += 2 * 10**9
    assert log()


def test_filters_that_cannot_be_are_refused() -> None:
    logger = get_logger("n")
    with pytest.raises(TypeError, match='parameter "often" is not one of the recognized'):
        logger.info("x", often=True)
    with pytest.raises(TypeError, match='required parameter "throttle_duration_sec"'):
        logger.info("x", throttle_time_source_type=object())
    with pytest.raises(ValueError, match="is not a clock instance"):
        logger.info("x", throttle_duration_sec=1, throttle_time_source_type="STEADY")
    assert logger.info("x", once=False, throttle_duration_sec=None) is True


@pytest.mark.parametrize(
    ("calls", "reason"),
    [
        ([{"severity": 20}, {"severity": 30}], "severity"),
        ([{"severity": 20}, {"severity": 20, "name": "b"}], "name"),
        ([{"severity": 20}, {"severity": 20, "once": True}], "filters"),
        (
            [
                {"severity": 20, "throttle_duration_sec": 1},
                {"severity": 20, "throttle_duration_sec": 2},
            ],
            "filter parameters",
        ),
    ],
)
def test_what_a_place_asks_for_does_not_change(calls: list[dict[str, object]], reason: str) -> None:
    logger = get_logger("n")
    with pytest.raises(ValueError, match=f"{reason} cannot be changed between calls"):
        for call in calls:
            logger.log("x", **call)  # type: ignore[arg-type]


def test_listeners_get_all_messages(capsys: pytest.CaptureFixture[str]) -> None:
    records: list[LogRecord] = []
    output.listeners.append(records.append)
    output.to_console = False
    try:
        get_logger("n").info("x")
    finally:
        output.to_console = True
    assert [(record.name, record.message, record.file) for record in records] == [
        ("n", "x", __file__)
    ]
    assert capsys.readouterr().err == ""


def test_the_folder_of_logs_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", "/logs")
    assert str(logging.get_logging_directory()) == "/logs"
    monkeypatch.delenv("ROS_LOG_DIR")
    monkeypatch.setenv("ROS_HOME", "/ros")
    assert str(logging.get_logging_directory()) == "/ros/log"


class Writes(io.StringIO):
    """Keeps what each call has written."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[str] = []

    def write(self, text: str) -> int:
        self.calls.append(text)
        return super().write(text)


def test_lines_of_threads_stay_whole() -> None:
    out = Writes()
    write_line("a line", out)
    assert out.calls == ["a line\n"]
