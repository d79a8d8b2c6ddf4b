"""Parameters in YAML: files of ``--params-file`` and values of ``-p``, with the types of rcl.

A scalar is a bool (``true``, ``yes``, ``on`` ...), an integer (``7``, ``0x1F``, ``010``), a float
(``1.5``, ``1e3``, ``.inf``) or else a text; in quotes it is a text. A list has values of one type.
The keys above ``ros__parameters`` are the pattern of a node's name, those below it the names of
parameters, with dots between them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from hprm.ros._overrides import Overrides, Scalar, Value

try:
    import yaml
except ModuleNotFoundError:
    raise ModuleNotFoundError(
        "values of parameters need PyYAML, which is not installed: pip install 'hprm[ros]'",
        name="yaml",
    ) from None

_PARAMETERS = "ros__parameters"
_TRUE = {"y", "yes", "true", "on", "Y", "Yes", "True", "On", "YES", "TRUE", "ON"}
_FALSE = {"n", "no", "false", "off", "N", "No", "False", "Off", "NO", "FALSE", "OFF"}
_INTEGER = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|[0-9]+)")
_FLOAT = re.compile(
    r"[+-]?(([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|\.(inf|Inf|INF)|(?i:inf|infinity|nan))"
    r"|\.(nan|NaN|NAN)"
)


# The tag of a scalar that has neither quotes nor a tag: its text says what it is.
_PLAIN = "plain"


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """A loader that leaves to rcl's rules what a plain scalar is."""

    def resolve(self, kind: type[yaml.Node], value: Any, implicit: Any) -> Any:
        if kind is yaml.ScalarNode and implicit[0]:
            return _PLAIN
        return super().resolve(kind, value, implicit)


class ParameterFileError(ValueError):
    """A file of parameters or a value cannot be used; the message says where and why."""


def read_parameter_file(path: str, overrides: Overrides) -> None:
    """Add what a file states; raise ``ParameterFileError`` if that is not possible."""
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text in UTF-8"
        raise ParameterFileError(f"{path}: the file of parameters cannot be read: {why}") from None
    root = _composed(text, path)
    if root is None:
        return
    if not isinstance(root, yaml.MappingNode):
        raise _error(path, root, "a file of parameters begins with names of nodes")
    for pattern, name, value in _nodes(path, root, ""):
        overrides.add(pattern, name, value)


def parse_parameter_value(text: str) -> Value:
    """Return the value that a text in YAML states; raise ``ParameterFileError`` if none."""
    node = _composed(text, "value")
    if node is None:
        raise ParameterFileError("there is no value")
    return _value("value", node)


def _composed(text: str, path: str) -> yaml.Node | None:
    try:
        for event in yaml.parse(text, Loader=_Loader):
            if isinstance(event, yaml.AliasEvent):
                line = event.start_mark.line + 1
                raise ParameterFileError(
                    f"{path}:{line}: aliases (*{event.anchor}) are not supported: repeat the value"
                )
        node: yaml.Node | None = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = path if mark is None else f"{path}:{mark.line + 1}"
        why = getattr(error, "problem", None) or str(error)
        raise ParameterFileError(f"{where}: {why}") from None
    return node


def _error(path: str, node: yaml.Node, why: str) -> ParameterFileError:
    return ParameterFileError(f"{path}:{node.start_mark.line + 1}: {why}")


def _entries(path: str, mapping: yaml.MappingNode) -> Iterator[tuple[str, yaml.Node]]:
    for key, value in mapping.value:
        if not isinstance(key, yaml.ScalarNode):
            raise _error(path, key, "a name is a text, not a list or a map")
        yield key.value, value


def _nodes(path: str, mapping: yaml.MappingNode, prefix: str) -> Iterator[tuple[str, str, Value]]:
    """Yield the pattern, the name and the value of all parameters below a namespace."""
    for name, content in _entries(path, mapping):
        if name == _PARAMETERS:
            if not prefix:
                raise _error(path, content, f"there is no node's name above {_PARAMETERS}")
            if isinstance(content, yaml.MappingNode):
                for parameter, value in _parameters(path, content, ""):
                    yield prefix, parameter, value
                continue
            if not _is_empty(content):
                raise _error(path, content, f"{_PARAMETERS} has names and values below it")
        elif isinstance(content, yaml.MappingNode):
            below = name.strip("/")
            yield from _nodes(path, content, f"{prefix}/{below}" if below else prefix)
        elif not _is_empty(content):
            raise _error(path, content, f"'{name}' has a value, but it is not below {_PARAMETERS}")


def _parameters(path: str, mapping: yaml.MappingNode, prefix: str) -> Iterator[tuple[str, Value]]:
    for name, content in _entries(path, mapping):
        if isinstance(content, yaml.MappingNode):
            yield from _parameters(path, content, f"{prefix}{name}.")
        else:
            yield prefix + name, _value(path, content, prefix + name)


def _is_empty(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and node.value == "" and node.tag == _PLAIN


def _value(path: str, node: yaml.Node, name: str = "") -> Value:
    if isinstance(node, yaml.ScalarNode):
        if _is_empty(node):
            raise _error(path, node, f"the parameter '{name}' has no value" if name else "no value")
        return _scalar(node)
    if not isinstance(node, yaml.SequenceNode):
        raise _error(path, node, "a value is a scalar or a list, not a map")
    values: list[Any] = []
    for item in node.value:
        if not isinstance(item, yaml.ScalarNode):
            raise _error(path, item, "a list of parameters has scalars only")
        value = _scalar(item)
        if values and type(value) is not type(values[0]):
            raise _error(
                path,
                item,
                f"a list has values of one type: {item.value!r} is {_noun(value)}, "
                f"the first one is {_noun(values[0])}",
            )
        values.append(value)
    return values


def _noun(value: Scalar) -> str:
    return {bool: "a bool", int: "an integer", float: "a float", str: "a text"}[type(value)]


def _scalar(node: yaml.ScalarNode) -> Scalar:
    text: str = node.value
    if node.tag != _PLAIN:
        return text
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if _INTEGER.fullmatch(text):
        number = _integer(text)
        if number is not None and -(1 << 63) <= number < 1 << 63:
            return number
    if _FLOAT.fullmatch(text):
        return float(re.sub(r"\.(?=[inIN])", "", text))
    return text


def _integer(text: str) -> int | None:
    digits = text.lstrip("+-")
    base = 16 if digits[:2] in ("0x", "0X") else 8 if digits[0] == "0" else 10
    try:
        return int(text, base)
    except ValueError:
        # Such as 08, which is no octal number.
        return None
