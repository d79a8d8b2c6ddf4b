"""Reading launch files in XML.

The file has an element ``launch``, the elements of which are actions::

    <launch>
      <arg name="rate" default="10"/>
      <node pkg="demo" exec="talker"><param name="rate" value="$(var rate)"/></node>
    </launch>

Below an action, elements of one name are a list of the attribute with this name.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from hprm.ros._launch._entities import LaunchDescription
from hprm.ros._launch._frontend import Map, listed
from hprm.ros._launch._plans import LaunchError

#: Whose elements are actions, in order.
_WITH_ACTIONS = ("launch", "group", "timer", "ros_timer")
#: Whose ``value`` is read as YAML.
_WITH_VALUES = ("param", "set_parameter")


@dataclass
class _Element:
    name: str
    attributes: dict[str, str]
    line: int
    elements: list[_Element] = field(default_factory=list)


def description_of_xml(path: Path) -> LaunchDescription:
    """Return what a launch file in XML describes; raise ``LaunchError`` with its line if none."""
    root = _read(path)
    if root.name != "launch":
        raise LaunchError(f"{path}:{root.line}: a launch file in XML has the element 'launch'")
    left = sorted(set(root.attributes) - {"version", "deprecated"})
    if left:
        raise LaunchError(f"{path}:{root.line}: launch: there is no attribute '{left[0]}'")
    actions = listed([_action(it, path) for it in root.elements], path, root.line)
    return LaunchDescription(actions, deprecated_reason=root.attributes.get("deprecated"))


def _read(path: Path) -> _Element:
    """Read the elements of a file, with their lines."""
    open_: list[_Element] = [_Element("", {}, 0)]
    parser = expat.ParserCreate()

    def begin(name: str, attributes: dict[str, str]) -> None:
        made = _Element(name.replace("-", "_"), attributes, parser.CurrentLineNumber)
        open_[-1].elements.append(made)
        open_.append(made)

    def text(data: str) -> None:
        if data.strip():
            line = parser.CurrentLineNumber
            raise LaunchError(f"{path}:{line}: the text {data.strip()!r} belongs to no attribute")

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: open_.pop()
    parser.CharacterDataHandler = text
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        why = expat.errors.messages[error.code]
        raise LaunchError(f"{path}:{error.lineno}: {why}") from None
    except OSError as error:
        raise LaunchError(f"{path}: the launch file cannot be read: {error}") from None
    return open_[0].elements[0]


def _action(element: _Element, path: Path) -> Map:
    made = Map({element.name: _attributes(element, path)})
    made.line = element.line
    return made


def _attributes(element: _Element, path: Path) -> Map:
    found = Map({name.replace("-", "_"): value for name, value in element.attributes.items()})
    found.line = element.line
    separator = found.pop("value_sep", None)
    if element.name in _WITH_VALUES and "value" in found and "type" not in found:
        found["value"] = _value(found["value"], separator)
    if element.name in _WITH_ACTIONS:
        found["children"] = [_action(it, path) for it in element.elements]
        return found
    for it in element.elements:
        if it.name in element.attributes:
            raise LaunchError(f"{path}:{it.line}: '{it.name}' is an attribute, too")
        found.setdefault(it.name, []).append(_attributes(it, path))
    return found


def _value(text: str, separator: str | None) -> Any:
    """Read the value of a parameter, which may be a list."""
    if separator is not None:
        return [_value(part.strip(), None) for part in text.split(separator)]
    if "$(" in text or not text:
        return text
    from hprm.ros._parameter_yaml import ParameterFileError, parse_parameter_value

    try:
        return parse_parameter_value(text)
    except ParameterFileError:
        return text
