"""Actions of launch files in YAML and XML: the same ones as in Python, and errors with lines.

An action is a map with its name as the only key, below which are its attributes; what has several
elements is a list of maps. ``_yaml.py`` and ``_xml.py`` read files as that.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hprm.ros._launch import actions
from hprm.ros._launch._entities import Action, Condition, truth
from hprm.ros._launch._plans import LaunchError
from hprm.ros._launch._text import parse
from hprm.ros._launch.conditions import IfCondition, UnlessCondition
from hprm.ros._launch.launch_description_sources import AnyLaunchDescriptionSource


class Map(dict[str, Any]):
    """A map of the file, with its line."""

    line = 0


class _Attributes:
    """The attributes of one action, each of which is taken once."""

    def __init__(self, name: str, attributes: Map, path: Path) -> None:
        self._name, self._left, self.path = name, dict(attributes), path
        self.line = attributes.line

    def error(self, why: str) -> LaunchError:
        return LaunchError(f"{self.path}:{self.line}: {self._name}: {why}")

    def take(self, name: str, *others: str) -> Any:
        """Return an attribute, or ``None``; it may have several names."""
        for each in (name, *others):
            if each in self._left:
                return self._left.pop(each)
        return None

    def text(self, name: str, *others: str) -> Any:
        """Return the substitutions of an attribute, or ``None``."""
        value = self.take(name, *others)
        if value is None:
            return None
        if isinstance(value, dict | list):
            raise self.error(f"'{name}' is a text")
        try:
            return parse(_as_text(value))
        except LaunchError as error:
            raise self.error(str(error)) from None

    def needed(self, name: str, *others: str) -> Any:
        """Return the substitutions of an attribute that has to be there."""
        text = self.text(name, *others)
        if text is None:
            raise self.error(f"'{name}' is missing")
        return text

    def several(self, name: str) -> list[_Attributes]:
        """Return the elements of an attribute, which is a list of maps."""
        value = self.take(name) or []
        if not isinstance(value, list) or not all(isinstance(one, Map) for one in value):
            raise self.error(f"'{name}' is a list of maps")
        return [_Attributes(name, one, self.path) for one in value]

    def flag(self, name: str, default: bool) -> bool:
        """Return an attribute that is true or false."""
        value = self.take(name)
        if value is None or isinstance(value, bool):
            return default if value is None else value
        try:
            return truth(str(value), f"'{name}'")
        except LaunchError as error:
            raise self.error(str(error)) from None

    def condition(self) -> Condition | None:
        """Return the condition that ``if`` or ``unless`` states."""
        holds, holds_not = self.text("if"), self.text("unless")
        if holds is not None and holds_not is not None:
            raise self.error("there is either 'if' or 'unless'")
        if holds is not None:
            return IfCondition(holds)
        return None if holds_not is None else UnlessCondition(holds_not)

    def finish(self) -> None:
        """Raise ``LaunchError`` if there is an attribute that was not taken."""
        if self._left:
            raise self.error(f"there is no attribute '{next(iter(self._left))}'")


def _as_text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def listed(elements: Any, path: Path, line: int) -> list[Action]:
    """Return the actions of a list; raise ``LaunchError`` with its line for one that is wrong."""
    if not isinstance(elements, list):
        raise LaunchError(f"{path}:{line}: actions are a list")
    return [_action(element, path, line) for element in elements]


def _action(element: Any, path: Path, line: int) -> Action:
    line = getattr(element, "line", line)
    if not isinstance(element, Map) or len(element) != 1:
        raise LaunchError(f"{path}:{line}: an action is a map with its name as the only key")
    ((name, attributes),) = element.items()
    make = _MAKERS.get(str(name).replace("-", "_"))
    if make is None:
        known = ", ".join(sorted(_MAKERS))
        raise LaunchError(f"{path}:{line}: there is no action '{name}'; there are: {known}")
    if isinstance(attributes, list):
        # A group may be the list of its actions.
        wrapped = Map(children=attributes)
        wrapped.line = line
        attributes = wrapped
    if not isinstance(attributes, Map):
        raise LaunchError(f"{path}:{line}: '{name}' has a map of attributes")
    found = _Attributes(str(name), attributes, path)
    action = make(found)
    found.finish()
    return action


def _arg(found: _Attributes) -> Action:
    name = found.take("name")
    if name is None:
        raise found.error("'name' is missing")
    choices = [choice.take("value") for choice in found.several("choice")]
    return actions.DeclareLaunchArgument(
        _as_text(name),
        default_value=found.text("default"),
        description=found.take("description"),
        choices=[_as_text(choice) for choice in choices] or None,
        condition=found.condition(),
    )


def _let(found: _Attributes) -> Action:
    return actions.SetLaunchConfiguration(
        found.needed("name"), found.needed("value"), condition=found.condition()
    )


def _set_env(found: _Attributes) -> Action:
    return actions.SetEnvironmentVariable(
        found.needed("name"), found.needed("value"), condition=found.condition()
    )


def _unset_env(found: _Attributes) -> Action:
    return actions.UnsetEnvironmentVariable(found.needed("name"), condition=found.condition())


def _log(found: _Attributes) -> Action:
    return actions.LogInfo(msg=found.needed("message"), condition=found.condition())


def _children(found: _Attributes) -> list[Any]:
    return listed(found.take("children"), found.path, found.line)


def _group(found: _Attributes) -> Action:
    scoped, forwarding = found.flag("scoped", True), found.flag("forwarding", True)
    return actions.GroupAction(
        _children(found), scoped=scoped, forwarding=forwarding, condition=found.condition()
    )


def _timer(found: _Attributes) -> Action:
    return actions.TimerAction(
        period=found.needed("period"), actions=_children(found), condition=found.condition()
    )


def _include(found: _Attributes) -> Action:
    stated = [*found.several("arg"), *found.several("let")]
    arguments = [(one.needed("name"), one.needed("value")) for one in stated]
    return actions.IncludeLaunchDescription(
        AnyLaunchDescriptionSource(found.needed("file")),
        launch_arguments=arguments,
        condition=found.condition(),
    )


def _process_options(found: _Attributes) -> dict[str, Any]:
    options = {
        "cwd": found.text("cwd"),
        "output": found.take("output") or "log",
        "respawn": found.text("respawn") or False,
        "additional_env": {
            _as_text(one.take("name")): one.needed("value") for one in found.several("env")
        },
        "condition": found.condition(),
    }
    on_exit = found.take("on_exit")
    if on_exit not in (None, "shutdown"):
        raise found.error(f"on_exit is '{on_exit}': it may be shutdown")
    if on_exit is not None:
        options["on_exit"] = actions.Shutdown()
    for name in ("respawn_delay", "respawn_max_retries"):
        stated = found.text(name)
        if stated is not None:
            options[name] = stated
    for name in ("sigterm_timeout", "sigkill_timeout"):
        found.take(name)
    prefix = found.text("launch-prefix", "launch_prefix")
    return options if prefix is None else {**options, "prefix": prefix}


def _executable(found: _Attributes) -> Action:
    words = _words(found, "cmd")
    if not words:
        raise found.error("'cmd' is missing")
    return actions.ExecuteProcess(
        cmd=words,
        name=found.text("name"),
        shell=found.flag("shell", False),
        **_process_options(found),
    )


def _words(found: _Attributes, name: str) -> list[Any]:
    """Return the words of a command line; blanks in substitutions part nothing."""
    text = found.take(name)
    if text is None:
        return []
    held: list[str] = []

    def hold(match: re.Match[str]) -> str:
        held.append(match[0])
        return f"\0{len(held) - 1}\0"

    text = _replaced_innermost(_as_text(text), hold)
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise found.error(f"'{name}' cannot be read: {error}") from None

    def release(word: str) -> str:
        while "\0" in word:
            word = re.sub("\0(\\d+)\0", lambda match: held[int(match[1])], word)
        return word

    try:
        return [parse(release(word)) for word in words]
    except LaunchError as error:
        raise found.error(str(error)) from None


def _replaced_innermost(text: str, hold: Callable[[re.Match[str]], str]) -> str:
    while (shorter := re.sub(r"\$\([^()]*\)", hold, text)) != text:
        text = shorter
    return text


def _node(found: _Attributes) -> Action:
    from hprm.ros._launch_ros.actions import Node

    remaps = [(one.needed("from"), one.needed("to")) for one in found.several("remap")]
    return Node(
        package=found.text("pkg"),
        executable=found.needed("exec"),
        name=found.text("name"),
        namespace=found.text("namespace"),
        parameters=_parameters(found),
        remappings=remaps,
        arguments=_words(found, "args"),
        ros_arguments=_words(found, "ros_args"),
        **_process_options(found),
    )


def _parameters(found: _Attributes) -> list[Any]:
    result: list[Any] = []
    for one in found.several("param"):
        file = one.text("from")
        result.append(_named_value(one) if file is None else file)
        one.take("allow_substs")
        one.finish()
    return result


def _named_value(one: _Attributes) -> dict[str, Any]:
    name = one.take("name")
    if name is None:
        raise one.error("a parameter has a 'name', or is read 'from' a file")
    nested = one.several("param")
    if nested:
        values: dict[str, Any] = {}
        for below in nested:
            values |= _named_value(below)
            below.finish()
        return {_as_text(name): values}
    value = one.take("value")
    if value is None:
        raise one.error(f"the parameter '{name}' has no value")
    kind = one.take("type")
    return {_as_text(name): _value(one, value, kind)}


def _value(one: _Attributes, value: Any, kind: str | None) -> Any:
    from hprm.ros._launch_ros.parameter_descriptions import ParameterValue

    if kind is not None:
        kinds = {"str": str, "int": int, "float": float, "bool": bool}
        if kind not in kinds:
            raise one.error(f"'type' is one of {', '.join(kinds)}")
        return ParameterValue(parse(_as_text(value)), value_type=kinds[kind])
    if isinstance(value, str) and "$(" in value:
        parts = parse(value)
        return parts[0] if len(parts) == 1 else parts
    if isinstance(value, list):
        return [_value(one, each, None) for each in value]
    return value


def _namespace(found: _Attributes) -> Action:
    from hprm.ros._launch_ros.actions import PushROSNamespace

    return PushROSNamespace(found.needed("namespace"), condition=found.condition())


def _set_parameter(found: _Attributes) -> Action:
    from hprm.ros._launch_ros.actions import SetParameter

    name = found.needed("name")
    return SetParameter(name, _value(found, found.take("value"), None), condition=found.condition())


def _set_parameters_from_file(found: _Attributes) -> Action:
    from hprm.ros._launch_ros.actions import SetParametersFromFile

    return SetParametersFromFile(found.needed("filename"), condition=found.condition())


def _set_remap(found: _Attributes) -> Action:
    from hprm.ros._launch_ros.actions import SetRemap

    return SetRemap(found.needed("from"), found.needed("to"), condition=found.condition())


def _set_use_sim_time(found: _Attributes) -> Action:
    from hprm.ros._launch_ros.actions import SetUseSimTime

    return SetUseSimTime(found.needed("value"), condition=found.condition())


def _components(found: _Attributes) -> Action:
    raise found.error("not supported: components are libraries in C++")


_MAKERS: dict[str, Callable[[_Attributes], Action]] = {
    "arg": _arg,
    "executable": _executable,
    "group": _group,
    "include": _include,
    "let": _let,
    "log": _log,
    "load_composable_node": _components,
    "node": _node,
    "node_container": _components,
    "push_ros_namespace": _namespace,
    "ros_timer": _timer,
    "set_env": _set_env,
    "set_parameter": _set_parameter,
    "set_parameters_from_file": _set_parameters_from_file,
    "set_remap": _set_remap,
    "set_use_sim_time": _set_use_sim_time,
    "timer": _timer,
    "unset_env": _unset_env,
}
