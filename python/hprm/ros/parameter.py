"""Parameters of nodes, as ``rclpy.parameter``."""

from __future__ import annotations

import array
from collections.abc import Callable
from enum import Enum
from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros._messages.arrays import is_array

#: What is between the parts of a name.
PARAMETER_SEPARATOR_STRING = "."

#: The field of ``rcl_interfaces.msg.ParameterValue`` for each number of a type, and how it is made.
_FIELDS: dict[int, tuple[str, Callable[[Any], Any]]] = {
    1: ("bool_value", bool),
    2: ("integer_value", int),
    3: ("double_value", float),
    4: ("string_value", str),
    5: ("byte_array_value", list),
    6: ("bool_array_value", list),
    7: ("integer_array_value", list),
    8: ("double_array_value", list),
    9: ("string_array_value", list),
}


class Parameter:
    """A name with a value of a type."""

    class Type(Enum):
        """The types of values."""

        NOT_SET = 0
        BOOL = 1
        INTEGER = 2
        DOUBLE = 3
        STRING = 4
        BYTE_ARRAY = 5
        BOOL_ARRAY = 6
        INTEGER_ARRAY = 7
        DOUBLE_ARRAY = 8
        STRING_ARRAY = 9

        @classmethod
        def from_parameter_value(cls, parameter_value: Any) -> Parameter.Type:
            """Return the type of a value."""
            if parameter_value is None:
                return Parameter.Type.NOT_SET
            # A truth value is an integer, too.
            for kind, type_ in _SCALARS:
                if isinstance(parameter_value, kind):
                    return Parameter.Type[type_]
            if isinstance(parameter_value, list | tuple | array.array) or is_array(parameter_value):
                return _of_array(parameter_value)
            raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")

        def check(self, parameter_value: Any) -> bool:
            """Return whether a value is of this type."""
            if self is Parameter.Type.NOT_SET:
                return parameter_value is None
            try:
                found = Parameter.Type.from_parameter_value(parameter_value)
            except TypeError:
                return False
            empty = isinstance(parameter_value, list | tuple) and not parameter_value
            return found is self or (empty and self.name.endswith("_ARRAY"))

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        """Make one of an ``rcl_interfaces.msg.Parameter``."""
        type_ = Parameter.Type(param_msg.value.type)
        return cls(param_msg.name, type_, parameter_value_to_python(param_msg.value))

    def __init__(self, name: str, type_: Parameter.Type | None = None, value: Any = None) -> None:
        """Make one; the type is that of the value, if it is left out."""
        if type_ is None:
            type_ = Parameter.Type.from_parameter_value(value)
        if not isinstance(type_, Parameter.Type):
            raise TypeError("type must be an instance of 'Parameter.Type'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self._name = name
        self._type_ = type_
        self._value = value

    @property
    def name(self) -> str:
        """The name."""
        return self._name

    @property
    def type_(self) -> Parameter.Type:
        """The type of the value."""
        return self._type_

    @property
    def value(self) -> Any:
        """The value."""
        return self._value

    def get_parameter_value(self) -> Any:
        """Return the value as ``rcl_interfaces.msg.ParameterValue``."""
        message = interface("rcl_interfaces.msg", "ParameterValue")(type=self._type_.value)
        if self._type_ is not Parameter.Type.NOT_SET:
            field, made = _FIELDS[self._type_.value]
            setattr(message, field, made(self._value))
        return message

    def to_parameter_msg(self) -> Any:
        """Return it as ``rcl_interfaces.msg.Parameter``."""
        made = interface("rcl_interfaces.msg", "Parameter")
        return made(name=self._name, value=self.get_parameter_value())

    def __repr__(self) -> str:
        """Return name, type and value."""
        return f"Parameter(name={self._name!r}, type_={self._type_}, value={self._value!r})"


_SCALARS: list[tuple[type, str]] = [
    (bool, "BOOL"),
    (int, "INTEGER"),
    (float, "DOUBLE"),
    (str, "STRING"),
]


def _of_array(values: Any) -> Parameter.Type:
    if is_array(values):
        values = values.tolist()
    if len(values) == 0 or all(isinstance(it, bytes) for it in values):
        return Parameter.Type.BYTE_ARRAY
    for kind, type_ in _SCALARS:
        if all(isinstance(it, kind) for it in values):
            return Parameter.Type[f"{type_}_ARRAY"]
    raise TypeError("The given value is not a list of one of the allowed types.")


def parameter_value_to_python(parameter_value: Any) -> Any:
    """Return the value in an ``rcl_interfaces.msg.ParameterValue``."""
    if parameter_value.type == 0:
        return None
    if parameter_value.type not in _FIELDS:
        raise RuntimeError(f"unexpected parameter type {parameter_value.type}")
    value = getattr(parameter_value, _FIELDS[parameter_value.type][0])
    return list(value) if parameter_value.type >= 5 else value


def get_parameter_value(string_value: str) -> Any:
    """Read a value from a text, as the command line states it; what is no value is a text."""
    from hprm.ros._parameter_yaml import ParameterFileError, parse_parameter_value

    try:
        value = parse_parameter_value(string_value) if string_value else ""
    except ParameterFileError:
        value = string_value
    return Parameter("", value=value).get_parameter_value()


def parameter_dict_from_yaml_file(
    parameter_file: str,
    use_wildcard: bool = False,
    target_nodes: list[str] | None = None,
    namespace: str = "",
) -> dict[str, Any]:
    """Read the parameters that a file states for nodes, as messages by name.

    Parameters
    ----------
    parameter_file
        The path.
    use_wildcard
        Whether what the file states for all nodes (``/**``) counts, too.
    target_nodes
        The nodes; all of the file, if there are none.
    namespace
        What stands before all names.

    Raises
    ------
    RuntimeError
        If the file is no file of parameters, or has none for these nodes.

    """
    import yaml

    with open(parameter_file, encoding="utf-8") as file:
        stated = yaml.safe_load(file) or {}
    keys = ["/**"] if use_wildcard and "/**" in stated else []
    for node in target_nodes or ():
        if node not in stated:
            raise RuntimeError(
                f"Param file does not contain parameters for {node},only for nodes: {list(stated)} "
            )
    keys += target_nodes or [key for key in stated if key != "/**"]
    if not keys:
        raise RuntimeError("Param file does not contain selected parameters")
    found: dict[str, Any] = {}
    for key in keys:
        value = stated[key]
        if not isinstance(value, dict) or "ros__parameters" not in value:
            raise RuntimeError(f"YAML file is not a valid ROS parameter file for node {key}")
        found |= value["ros__parameters"]
    return _flattened(namespace, found)


def _flattened(prefix: str, stated: dict[str, Any]) -> dict[str, Any]:
    made = interface("rcl_interfaces.msg", "Parameter")
    found: dict[str, Any] = {}
    for name, value in stated.items():
        if isinstance(value, dict):
            found |= _flattened(f"{prefix}{name}.", value)
        else:
            full = f"{prefix}{name}"
            found[full] = made(name=full, value=get_parameter_value(str(value)))
    return found
