"""Names of `hprm.ros`: what is valid, what short names stand for, and what rules rename."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hprm.ros import exceptions
from hprm.ros._names import (
    absolute_namespace,
    full_node_name,
    full_topic_error,
    logger_name,
    topic_error,
)
from hprm.ros._remapping import Remapping, parse_remap_rule
from hprm.ros.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
)
from hprm.ros.expand_topic_name import expand_topic_name
from hprm.ros.topic_or_service_is_hidden import topic_or_service_is_hidden
from hprm.ros.validate_full_topic_name import validate_full_topic_name
from hprm.ros.validate_namespace import validate_namespace
from hprm.ros.validate_node_name import validate_node_name
from hprm.ros.validate_parameter_name import validate_parameter_name
from hprm.ros.validate_topic_name import validate_topic_name


@pytest.mark.parametrize(
    "name", ["chatter", "/a/b_1", "~/pose", "~", "{node}/x", "a/{ns}", "/_hidden", "a{b}c"]
)
def test_topics_may_be_relative_private_and_have_substitutions(name: str) -> None:
    assert validate_topic_name(name) is True


@pytest.mark.parametrize(
    ("name", "index", "what"),
    [
        ("", 0, "topic name must not be empty string"),
        ("7foo", 0, "topic name token must not start with a number"),
        ("foo/7bar", 4, "topic name token must not start with a number"),
        ("foo/", 3, "topic name must not end with a forward slash"),
        ("/", 0, "topic name must not end with a forward slash"),
        ("foo bar", 3, "other than alphanumerics, '_', '~', '{', or '}'"),
        ("grün", 2, "other than alphanumerics, '_', '~', '{', or '}'"),
        ("a~", 1, "must not have tilde '~' unless it is the first character"),
        ("~foo", 1, "tilde '~' that is not followed by a forward slash '/'"),
        ("a/{b", 2, "unmatched (unbalanced) curly braces"),
        ("a}", 1, "unmatched (unbalanced) curly braces"),
        ("{{a}}", 1, "substitution name must not contain"),
        ("{a/b}", 2, "substitution name must not contain"),
        ("{a-b}", 2, "substitution name must not contain"),
        ("{1a}", 1, "substitution name must not start with a number"),
    ],
)
def test_an_invalid_topic_is_refused_with_its_place(name: str, index: int, what: str) -> None:
    with pytest.raises(InvalidTopicNameException) as raised:
        validate_topic_name(name)
    heading, shown, mark = str(raised.value).split("\n")
    assert heading.startswith("Invalid topic name: ") and what in heading
    assert shown == f"  '{name}'"
    assert mark.index("^") == index + 3
    with pytest.raises(InvalidServiceNameException, match="Invalid service name"):
        validate_topic_name(name, is_service=True)


@pytest.mark.parametrize(
    ("validate", "error", "name", "index", "what"),
    [
        (validate_full_topic_name, InvalidTopicNameException, "", 0, "must not be empty"),
        (validate_full_topic_name, InvalidTopicNameException, "a", 0, "must be absolute"),
        (validate_full_topic_name, InvalidTopicNameException, "/a/", 2, "must not end with a '/'"),
        (validate_full_topic_name, InvalidTopicNameException, "/a~", 2, "must not contain"),
        (validate_full_topic_name, InvalidTopicNameException, "/a//b", 3, "repeated '/'"),
        (validate_full_topic_name, InvalidTopicNameException, "/a/1", 3, "starts with a number"),
        (
            validate_full_topic_name,
            InvalidTopicNameException,
            "/" + "a" * 247,
            246,
            "topic length should not exceed '247'",
        ),
        (validate_namespace, InvalidNamespaceException, "", 0, "namespace must not be empty"),
        (validate_namespace, InvalidNamespaceException, "a", 0, "namespace must be absolute"),
        (validate_namespace, InvalidNamespaceException, "/a/", 2, "unless only a '/'"),
        (validate_namespace, InvalidNamespaceException, "/a b", 2, "namespace must not contain"),
        (
            validate_namespace,
            InvalidNamespaceException,
            "/" + "a" * 245,
            244,
            "namespace should not exceed '245'",
        ),
        (validate_node_name, InvalidNodeNameException, "", 0, "node name must not be empty"),
        (validate_node_name, InvalidNodeNameException, "a/b", 1, "alphanumerics or '_'"),
        (validate_node_name, InvalidNodeNameException, "1a", 0, "must not start with a number"),
        (
            validate_node_name,
            InvalidNodeNameException,
            "a" * 256,
            254,
            "node name length should not exceed '255'",
        ),
    ],
)
def test_invalid_full_names_are_refused_with_their_place(
    validate: Callable[[str], bool], error: type[Exception], name: str, index: int, what: str
) -> None:
    with pytest.raises(error) as raised:
        validate(name)
    lines = str(raised.value).split("\n")
    assert what in lines[0]
    assert lines[2].index("^") == index + 3


def test_valid_full_names_are_accepted() -> None:
    assert validate_full_topic_name("/a/b_2", is_service=True)
    assert validate_namespace("/") and validate_namespace("/robot/arm")
    assert validate_node_name("_camera1")
    assert validate_parameter_name("any thing")
    with pytest.raises(exceptions.InvalidParameterException, match="Invalid parameter name"):
        validate_parameter_name("")
    with pytest.raises(InvalidServiceNameException):
        validate_full_topic_name("a", is_service=True)


@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("chatter", "/robot/chatter"),
        ("/chatter", "/chatter"),
        ("~", "/robot/cam"),
        ("~/image", "/robot/cam/image"),
        ("{node}/x", "/robot/cam/x"),
        ("{ns}/x", "/robot/x"),
        ("/all{namespace}/x", "/all/robot/x"),
    ],
)
def test_names_are_expanded_in_a_node(name: str, full: str) -> None:
    assert expand_topic_name(name, "cam", "/robot") == full


def test_names_are_expanded_in_the_root_namespace() -> None:
    assert expand_topic_name("chatter", "cam", "/") == "/chatter"
    assert expand_topic_name("~/x", "cam", "/") == "/cam/x"


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("a b", "cam", "/"), "topic name 'a b' is invalid: topic name must not contain"),
        (("a", "c-m", "/"), "node name 'c-m' is invalid"),
        (("a", "cam", "x"), "node namespace 'x' is invalid"),
        (("{colour}", "cam", "/"), "unknown substitution: {colour}"),
    ],
)
def test_what_cannot_be_expanded_is_refused(arguments: tuple[str, str, str], what: str) -> None:
    with pytest.raises(ValueError) as raised:
        expand_topic_name(*arguments)
    assert what in str(raised.value)


@given(st.text("ab_/~{}1é", max_size=8))
def test_an_expanded_name_is_absolute(name: str) -> None:
    if topic_error(name) is None and "{" not in name:
        full = expand_topic_name(name, "n", "/s")
        assert full.startswith("/")
        assert full_topic_error(full) is None or "//" in full


def test_nodes_have_full_names_and_names_of_loggers() -> None:
    assert full_node_name("cam", "/") == "/cam"
    assert full_node_name("cam", "/robot") == "/robot/cam"
    assert logger_name("cam", "/robot") == "robot.cam"
    assert (absolute_namespace(""), absolute_namespace("a"), absolute_namespace("/a")) == (
        "/",
        "/a",
        "/a",
    )


def test_names_with_an_underscore_are_hidden() -> None:
    assert topic_or_service_is_hidden("/a/_b/c") and not topic_or_service_is_hidden("/a/b_/c")


def remapping(*rules: str) -> Remapping:
    return Remapping(parse_remap_rule(rule) for rule in rules)


def test_rules_rename_topics_and_services() -> None:
    renames = remapping("chatter:=other", "~/a:=/b", "/x:={node}/y")
    assert renames.topic("/ns/chatter", "n", "/ns") == "/ns/other"
    assert renames.service("/ns/chatter", "n", "/ns") == "/ns/other"
    assert renames.topic("/chatter", "n", "/ns") == "/chatter"
    assert renames.topic("/ns/n/a", "n", "/ns") == "/b"
    assert renames.topic("/x", "n", "/ns") == "/ns/n/y"


def test_a_rule_may_be_for_one_node_or_one_kind() -> None:
    renames = remapping("cam:a:=b", "rostopic://c:=d", "rosservice://e:=f")
    assert renames.topic("/a", "cam", "/") == "/b"
    assert renames.topic("/a", "other", "/") == "/a"
    assert (renames.topic("/c", "n", "/"), renames.service("/c", "n", "/")) == ("/d", "/c")
    assert (renames.topic("/e", "n", "/"), renames.service("/e", "n", "/")) == ("/e", "/f")


def test_rules_rename_and_move_nodes() -> None:
    renames = remapping("cam:__node:=left", "__ns:=/robot", "lidar:__name:=top")
    assert renames.node_name("cam") == "left"
    assert renames.node_name("lidar") == "top"
    assert renames.node_name("imu") == "imu"
    assert renames.namespace("left", "/") == "/robot"
    assert remapping("a:__ns:=/x").namespace("b", "/y") == "/y"


def test_the_first_rule_that_fits_decides() -> None:
    own = [parse_remap_rule("a:=own")]
    of_process = [parse_remap_rule("a:=global"), parse_remap_rule("a:=later")]
    assert Remapping(own, of_process).topic("/a", "n", "/") == "/own"
    assert Remapping(of_process).topic("/a", "n", "/") == "/global"


@pytest.mark.parametrize(
    ("rule", "what"),
    [
        ("a=b", "a rule is written FROM:=TO"),
        (":=b", "'': topic name must not be empty string"),
        ("a:=", "'': topic name must not be empty string"),
        ("a:=b c", "'b c': topic name must not contain"),
        ("__node:=a/b", "'a/b': node name must not contain"),
        ("__ns:=robot", "'robot': namespace must be absolute"),
    ],
)
def test_a_rule_that_cannot_be_is_refused(rule: str, what: str) -> None:
    with pytest.raises(ValueError) as raised:
        parse_remap_rule(rule)
    assert what in str(raised.value)


def test_exceptions_have_the_texts_of_rclpy() -> None:
    texts = {
        exceptions.NotInitializedException(): "rclpy.init() has not been called.",
        exceptions.NotInitializedException("x"): "rclpy.init() has not been called. msg:x",
        exceptions.NoTypeSupportImportedException(): "no type_support imported",
        exceptions.ParameterNotDeclaredException("a"): (
            "Invalid access to undeclared parameter(s): a"
        ),
        exceptions.ParameterAlreadyDeclaredException(["a"]): (
            "Parameter(s) already declared: ['a']"
        ),
        exceptions.InvalidParameterValueException("a", 1, "no"): (
            "Invalid parameter value (1) for parameter. Reason: no: a"
        ),
        exceptions.ParameterImmutableException("a"): ("Attempted to modify read-only parameter: a"),
        exceptions.ParameterUninitializedException("a"): (
            "The parameter 'a' is not initialized: a"
        ),
        exceptions.ROSInterruptException(): "rclpy.shutdown() has been called",
    }
    assert {str(error): text for error, text in texts.items() if str(error) != text} == {}


def test_an_exception_of_a_type_names_both_types() -> None:
    class Type:
        name = "INTEGER"

    class Parameter:
        name = "speed"
        value = 3
        type_ = Type

    error = exceptions.InvalidParameterTypeException(Parameter(), "DOUBLE")
    assert str(error) == (
        "Trying to set parameter 'speed' to '3' of type 'INTEGER', expecting type 'DOUBLE': speed"
    )
    assert isinstance(error, exceptions.ParameterException)
