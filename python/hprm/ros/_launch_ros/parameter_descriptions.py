"""Parameters of nodes in launch files, as in ``launch_ros.parameter_descriptions``.

A value in Python keeps its type. A substitution is read as YAML, so that ``2.5`` becomes a number,
unless ``ParameterValue`` states the type.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hprm.ros._launch._entities import LaunchContext, SomeText, Substitution, flag, perform
from hprm.ros._launch._plans import LaunchError, Parameters
from hprm.ros._overrides import Value

_HINT = "if it is meant as a text, write ParameterValue(value, value_type=str)"


class ParameterValue:
    """A value with a type.

    Parameters
    ----------
    value
        The value, or a substitution.
    value_type
        ``str``, ``int``, ``float``, ``bool`` or a list of these (``typing.List[int]``); ``None``
        leaves it to YAML.

    """

    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        """Take value and type."""
        self.value = value
        self.value_type = value_type

    def evaluate(self, context: LaunchContext) -> Value:
        """Return the value; raise ``LaunchError`` if it has another type."""
        if self.value_type is None:
            return value_of("value", self.value, context)
        if self.value_type is str:
            return self.value if isinstance(self.value, str) else perform(context, self.value)
        found = value_of("value", self.value, context)
        item = next(iter(getattr(self.value_type, "__args__", ())), None)
        if item is not None and isinstance(found, list) and all(_is(one, item) for one in found):
            return [item(one) for one in found]
        if item is None and isinstance(self.value_type, type) and _is(found, self.value_type):
            converted: Value = self.value_type(found)
            return converted
        raise LaunchError(f"{found!r} is no {self.value_type}")


def _is(value: Any, kind: type) -> bool:
    """Return whether a value has a type, or is an integer where a float is meant."""
    return type(value) is kind or (kind is float and type(value) is int)


class Parameter(ParameterValue):
    """A value with its name."""

    def __init__(self, name: SomeText, value: Any, *, value_type: Any = None) -> None:
        """Take name, value and type."""
        super().__init__(value, value_type=value_type)
        self.name = name


class ParameterFile:
    """A file of parameters.

    Parameters
    ----------
    param_file
        The path.
    allow_substs
        Whether the file has substitutions, as ``$(var name)``; that is not supported.

    """

    def __init__(self, param_file: SomeText, *, allow_substs: bool | SomeText = False) -> None:
        """Take the path."""
        self.param_file = param_file
        self.allow_substs = allow_substs

    def evaluate(self, context: LaunchContext) -> Path:
        """Return the path; raise ``LaunchError`` if there is no such file."""
        path = context.folder / perform(context, self.param_file)
        if not path.is_file():
            raise LaunchError(f"there is no file of parameters {path}")
        if flag(context, self.allow_substs, "allow_substs"):
            raise LaunchError(f"{path}: substitutions in files of parameters are not supported")
        return path


def evaluated(parameters: Iterable[Any], context: LaunchContext) -> list[Parameters]:
    """Return the parameters of a node: files, dictionaries, and single ones."""
    if isinstance(parameters, str | Mapping):
        raise LaunchError(f"parameters is a list of dictionaries and files, not {parameters!r}")
    result: list[Parameters] = []
    for some in parameters:
        if isinstance(some, Parameter):
            result.append({perform(context, some.name): some.evaluate(context)})
        elif isinstance(some, ParameterFile):
            result.append(some.evaluate(context))
        elif isinstance(some, Mapping):
            result.append(flattened(some, context))
        elif isinstance(some, str | os.PathLike | Substitution | Sequence):
            result.append(ParameterFile(some).evaluate(context))
        else:
            raise LaunchError(f"{some!r} is neither a dictionary of parameters nor a file")
    return result


def flattened(
    values: Mapping[Any, Any], context: LaunchContext, prefix: str = ""
) -> dict[str, Value]:
    """Return values by name; of nested dictionaries, names have dots between them."""
    result: dict[str, Value] = {}
    for key, value in values.items():
        name = prefix + perform(context, key)
        if isinstance(value, Mapping):
            result |= flattened(value, context, f"{name}.")
        else:
            result[name] = value_of(name, value, context)
    return result


def value_of(name: str, value: Any, context: LaunchContext) -> Value:
    """Return the value of a parameter; raise ``LaunchError`` if it can be none."""
    if isinstance(value, ParameterValue):
        return value.evaluate(context)
    if isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Substitution):
        return _parsed(name, perform(context, value))
    if isinstance(value, os.PathLike):
        return str(os.fspath(value))
    if isinstance(value, Sequence) and not isinstance(value, bytes):
        return _list_of(name, value, context)
    raise LaunchError(f"the parameter '{name}' cannot be {value!r}")


def _list_of(name: str, values: Sequence[Any], context: LaunchContext) -> Value:
    kinds = {Substitution if isinstance(each, Substitution) else type(each) for each in values}
    if Substitution in kinds and kinds <= {str, Substitution}:
        # Several substitutions are one text, as everywhere else.
        return _parsed(name, perform(context, values))
    if kinds == {int, float}:
        return [float(each) for each in values]
    items: list[Any] = [
        _parsed(name, perform(context, each))
        if isinstance(each, Substitution | list | tuple)
        else each
        for each in values
    ]
    if len({type(each) for each in items}) > 1:
        raise LaunchError(f"the parameter '{name}' is a list of several types: {items}")
    if items and not isinstance(items[0], bool | int | float | str):
        raise LaunchError(f"the parameter '{name}' is a list of {items[0]!r}")
    return items


def _parsed(name: str, text: str) -> Value:
    from hprm.ros._parameter_yaml import ParameterFileError, parse_parameter_value

    if not text:
        return ""
    try:
        return parse_parameter_value(text)
    except ParameterFileError as error:
        raise LaunchError(f"the parameter '{name}' cannot be read: {error}; {_HINT}") from None
