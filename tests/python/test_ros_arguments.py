"""The command line after `--ros-args`, and parameters in YAML, as ROS 2 reads them."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest
from processes import Bench, finish

from hprm.ros import _rclpy_pybind11
from hprm.ros._overrides import Overrides, pattern_matches
from hprm.ros._parameter_yaml import (
    ParameterFileError,
    parse_parameter_value,
    read_parameter_file,
)
from hprm.ros._remapping import Remapping
from hprm.ros._ros_arguments import RosArguments, parse_ros_arguments
from hprm.ros.exceptions import RCLInvalidROSArgsError, UnknownROSArgsError
from hprm.ros.impl.logging_severity import LoggingSeverity


def parse(*arguments: str) -> RosArguments:
    return parse_ros_arguments(["prog", *arguments])


def test_arguments_of_the_program_stay() -> None:
    parsed = parse("-r", "x", "--ros-args", "-r", "a:=b", "--", "-p", "--ros-args", "-p", "c:=1")
    assert parsed.others == ["prog", "-r", "x", "-p"]
    assert [(rule.match, rule.replacement) for rule in parsed.rules] == [("a", "b")]
    assert parsed.overrides.of("/n") == {"c": 1}


def test_without_ros_arguments_nothing_is_asked_for() -> None:
    parsed = parse("a", "--b")
    nothing = RosArguments(overrides=parsed.overrides, others=["prog", "a", "--b"])
    assert parsed == nothing
    assert not parsed.overrides


def test_rules_outside_are_deprecated_and_work() -> None:
    parsed = parse("a:=b", "x:=1 2")
    assert parsed.deprecated == ["a:=b"]
    assert Remapping(parsed.rules).topic("/a", "n", "/") == "/b"
    assert parsed.others == ["prog", "x:=1 2"]


def test_parameters_are_for_all_nodes_or_for_one() -> None:
    parsed = parse("--ros-args", "-p", "speed:=2.5", "--param", "cam:tags.names:=[a, b]")
    assert parsed.overrides.of("/x/y") == {"speed": 2.5}
    assert parsed.overrides.of("/cam") == {"speed": 2.5, "tags.names": ["a", "b"]}


def test_levels_are_for_all_loggers_or_for_one() -> None:
    parsed = parse("--ros-args", "--log-level", "debug", "--log-level", "robot.cam:=WARN")
    assert parsed.level == LoggingSeverity.DEBUG
    assert parsed.levels == {"robot.cam": LoggingSeverity.WARN}


def test_outputs_of_the_log_are_switched() -> None:
    parsed = parse(
        *("--ros-args", "--disable-stdout-logs", "--disable-rosout-logs", "--enable-rosout-logs"),
        *("--disable-external-lib-logs", "--log-config-file", "f", "-e", "/robot"),
    )
    assert (parsed.log_to_console, parsed.log_to_rosout) == (False, True)
    assert parsed.ignored == ["--disable-external-lib-logs", "f"]
    assert parsed.enclave == "/robot"


def test_unknown_arguments_are_named() -> None:
    with pytest.raises(UnknownROSArgsError, match=r"unknown ROS arguments: \['--colour', 'x'\]"):
        parse("--ros-args", "--colour", "-r", "a:=b", "x")


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("-r",), "'-r': it needs a value behind it"),
        (("-r", "a"), "'-r a': a rule is written FROM:=TO"),
        (("-r", "__node:=1"), "'-r __node:=1': '1': node name must not start with a number"),
        (("-p", "a"), "'-p a': a parameter is written NAME:=VALUE"),
        (("-p", "a b:=1"), "'a b' is no name of a parameter"),
        (("-p", "a:=[1, x]"), "'-p a:=[1, x]': value:1: a list has values of one type"),
        (("-p", "a:="), "there is no value"),
        (("--log-level", "loud"), "'loud' is no level: there are unset, debug, info, warn"),
        (("--log-level", ":=info"), "there is no name of a logger before :="),
        (("--params-file", "/none.yaml"), "/none.yaml: the file of parameters cannot be read: No"),
        (("-e", "a b"), "an enclave is a path such as /robot/camera"),
    ],
)
def test_arguments_that_cannot_be_read_are_named(arguments: tuple[str, ...], what: str) -> None:
    with pytest.raises(RCLInvalidROSArgsError) as raised:
        parse("--ros-args", *arguments)
    assert str(raised.value).startswith("Failed to parse ROS arguments: '")
    assert what in str(raised.value)
    assert isinstance(raised.value, _rclpy_pybind11.RCLError)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("true", True),
        ("Yes", True),
        ("OFF", False),
        ("n", False),
        ("10", 10),
        ("-7", -7),
        ("0x1F", 31),
        ("010", 8),
        ("0", 0),
        ("08", 8.0),
        ("9223372036854775808", 9223372036854775808.0),
        ("1.5", 1.5),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("-.inf", -math.inf),
        ("infinity", math.inf),
        ("word", "word"),
        ("'10'", "10"),
        ('"true"', "true"),
        ("!!str 12.34", "12.34"),
        ("null", "null"),
        ("''", ""),
        ("1_000", "1_000"),
        ("2020-01-01", "2020-01-01"),
        ("[true, no]", [True, False]),
        ("[1, 2]", [1, 2]),
        ("[1.0, 2.5]", [1.0, 2.5]),
        ("[a, 'b c']", ["a", "b c"]),
        ("[]", []),
    ],
)
def test_values_have_the_types_of_rcl(text: str, value: object) -> None:
    parsed = parse_parameter_value(text)
    assert (type(parsed), parsed) == (type(value), value)


def test_a_value_may_be_no_number() -> None:
    for text in (".nan", "nan"):
        parsed = parse_parameter_value(text)
        assert isinstance(parsed, float) and math.isnan(parsed)


FILE = """\
lidar_ns:
  lidar_1:
    ros__parameters:
      id: 10
      driver:
        dx: 4.56
        specs: [12, 3]
/**:
  ros__parameters:
    use_sim_time: true
    id: 1
camera:
  ros__parameters: {id: 3}
/deep/ns/*:
  ros__parameters:
    deep: yes
empty:
  ros__parameters:
"""


def test_a_file_has_parameters_by_nodes(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(FILE)
    overrides = parse("--ros-args", "--params-file", str(file)).overrides
    assert overrides.of("/lidar_ns/lidar_1") == {
        "id": 1,
        "driver.dx": 4.56,
        "driver.specs": [12, 3],
        "use_sim_time": True,
    }
    assert overrides.of("/camera") == {"use_sim_time": True, "id": 3}
    assert overrides.of("/deep/ns/x")["deep"] is True
    assert "deep" not in overrides.of("/deep/x")


def test_later_values_replace_earlier_ones(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("/**:\n  ros__parameters: {a: 1, b: 1}\n")
    after = parse("--ros-args", "-p", "a:=2", "--params-file", str(file)).overrides
    before = parse("--ros-args", "--params-file", str(file), "-p", "a:=2").overrides
    assert (after.of("/n"), before.of("/n")) == ({"a": 1, "b": 1}, {"a": 2, "b": 1})


def test_an_empty_file_states_nothing(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("# nothing\n")
    overrides = Overrides()
    read_parameter_file(str(file), overrides)
    assert not overrides


@pytest.mark.parametrize(
    ("pattern", "fits", "misses"),
    [
        ("/**", ["/a", "/a/b"], []),
        ("/*", ["/a"], ["/a/b"]),
        ("/**/cam", ["/cam", "/a/cam", "/a/b/cam"], ["/cam2", "/cam/x"]),
        ("/a/*/c", ["/a/b/c"], ["/a/c", "/a/b/b/c"]),
        ("cam", ["/cam"], ["/a/cam"]),
    ],
)
def test_patterns_fit_names_of_nodes(pattern: str, fits: list[str], misses: list[str]) -> None:
    assert [name for name in fits + misses if pattern_matches(pattern, name)] == fits


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("- a\n", 1, "a file of parameters begins with names of nodes"),
        ("a: 1\n", 1, "'a' has a value, but it is not below ros__parameters"),
        ("ros__parameters:\n  a: 1\n", 2, "there is no node's name above ros__parameters"),
        ("n:\n  ros__parameters: 3\n", 2, "ros__parameters has names and values below it"),
        ("n:\n  ros__parameters:\n    a:\n", 3, "the parameter 'a' has no value"),
        ("n:\n  ros__parameters:\n    a: [1, 2.0]\n", 3, "'2.0' is a float, the first one is an"),
        ("n:\n  ros__parameters:\n    a: [[1]]\n", 3, "a list of parameters has scalars only"),
        ("n:\n  ros__parameters:\n    [1]: 2\n", 3, "a name is a text, not a list or a map"),
        ("n: &x {}\nm: *x\n", 2, "aliases (*x) are not supported"),
        ("n: {\n", 2, "expected the node content"),
        ("n:\n\tros__parameters:\n", 2, "cannot start any token"),
    ],
)
def test_a_mistake_in_a_file_is_reported_with_its_line(
    tmp_path: Path, text: str, line: int, what: str
) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(text)
    with pytest.raises(ParameterFileError) as raised:
        read_parameter_file(str(file), Overrides())
    assert str(raised.value).startswith(f"{file}:{line}: ")
    assert what in str(raised.value)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterFileError, match="it is no text in UTF-8"):
        read_parameter_file(str(file), Overrides())


def test_without_pyyaml_one_line_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['yaml'] = None\n"
        "from hprm.ros._ros_arguments import parse_ros_arguments as parse\n"
        "print(len(parse(['p', '--ros-args', '-r', 'a:=b']).rules))\n"
        "parse(['p', '--ros-args', '-p', 'a:=1'])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.stdout == "1\n"
    assert run.stderr.endswith(
        "ModuleNotFoundError: values of parameters need PyYAML, which is not installed: "
        "pip install 'hprm[ros]'\n"
    )


@pytest.mark.parametrize("words", [["--z", "1"], ["--fast", "--domain-id"], ["--x", "--zen=2"]])
def test_options_of_a_script_may_begin_like_those_of_the_command(
    bench: Bench, tmp_path: Path, words: list[str]
) -> None:
    (tmp_path / "one.py").write_text("import sys\nprint(*sys.argv[1:])\n")
    alone = finish(bench.call("ros", "run", "one.py", *words))
    both = finish(bench.call("ros", "run", "one.py", *words, "+", "one.py", *words))
    assert (alone.code, alone.out) == (0, " ".join(words) + "\n"), alone.err
    assert sorted(both.out.splitlines()) == [f"[one-{at}] {' '.join(words)}" for at in (1, 2)]
