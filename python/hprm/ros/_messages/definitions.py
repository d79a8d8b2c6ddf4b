"""The language of ``.msg``, ``.srv`` and ``.action`` files: text to structures.

What is wrong is one error, which begins with its file and line.

This module opens no file and makes no class.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from typing import Any, NamedTuple

#: The types that are part of the language, as such a file names them.
BASIC = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
    **{f"{sign}int{bits}": f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)},
    "string": "string",
    "wstring": "wstring",
}

_LINE = re.compile(
    r"(?P<base>[A-Za-z]\w*(?:/\w+){0,2})(?:<=(?P<bound>\d+))?(?P<many>\[(?:<=)?\d*\])?"
    r"\s+(?P<name>\w+)\s*(?P<equals>=)?\s*(?P<value>.*)"
)
_FIELD_NAME = re.compile(r"[a-z](?:_?[a-z0-9]+)*")
_CONSTANT_NAME = re.compile(r"[A-Z](?:_?[A-Z0-9]+)*")
_TYPE_NAME = re.compile(r"[A-Z][A-Za-z0-9]*")
_SEPARATOR = "---"
_INTEGER = re.compile(r"u?int(8|16|32|64)")


class DefinitionError(ImportError):
    """A definition that cannot be compiled; the text begins with its file and line."""


class Source(NamedTuple):
    """A definition as text, and where that text begins."""

    text: str
    file: str
    line: int = 1


@dataclass(frozen=True)
class Type:
    """The type of a field: a basic or another message, at most so long, once or many times."""

    #: A name in ``BASIC``, or ``package/Name``.
    base: str
    #: The longest text, if there is a limit.
    bound: int | None = None
    #: ``array`` of a fixed size, ``sequence`` without one or of a largest size; None if once.
    many: str | None = None
    size: int | None = None

    @property
    def is_message(self) -> bool:
        """Tell whether the type, or that of the elements, is a message."""
        return self.base not in BASIC

    @property
    def name(self) -> str:
        """The name that ``get_fields_and_field_types`` tells."""
        base = BASIC.get(self.base, self.base)
        if self.bound is not None:
            base = f"{base}<{self.bound}>"
        if self.many == "array":
            return f"{base}[{self.size}]"
        if self.many == "sequence":
            return f"sequence<{base}>" if self.size is None else f"sequence<{base}, {self.size}>"
        return base


@dataclass(frozen=True)
class Field:
    """A field, and its default value if the definition has one."""

    name: str
    type: Type
    default: Any = None
    line: int = 0


@dataclass(frozen=True)
class Structure:
    """What a message consists of."""

    #: ``package/kind/Name``.
    name: str
    file: str = ""
    fields: list[Field] = field(default_factory=list)
    #: Names, types of ``BASIC`` and values.
    constants: dict[str, tuple[str, Any]] = field(default_factory=dict)

    def place(self, line: int) -> str:
        """Say where a line of it is, for errors."""
        return f"{self.file}:{line}"


def parse(name: str, source: Source, parts: int) -> list[Structure]:
    """Read a definition of so many parts, between which are lines of three hyphens."""
    structures = [Structure(name, source.file)]
    for number, written in enumerate(source.text.splitlines(), start=source.line):
        line = written.partition("#")[0].strip()
        if line == _SEPARATOR:
            structures.append(Structure(name, source.file))
        elif line:
            _read(line, number, structures[-1])
    if len(structures) != parts:
        raise DefinitionError(
            f"{source.file}:{source.line}: {name} has {len(structures)} parts between lines of "
            f"{_SEPARATOR!r}, and needs {parts}"
        )
    return structures


def is_type_name(name: str) -> bool:
    """Tell whether a file of this name, without its suffix, can define something."""
    return _TYPE_NAME.fullmatch(name) is not None


def _read(line: str, number: int, into: Structure) -> None:
    found = _LINE.fullmatch(line)
    place = into.place(number)
    if found is None:
        raise DefinitionError(
            f"{place}: {line!r} is neither a field, as in `float64 x`, nor a constant, as in "
            "`uint8 RED=1`"
        )
    type_ = _type(found, place, into.name.partition("/")[0])
    name, value = found["name"], found["value"]
    if name in into.constants or any(name == it.name for it in into.fields):
        raise DefinitionError(f"{place}: {into.name} has two members of the name {name!r}")
    if found["equals"]:
        if type_.many or type_.is_message:
            raise DefinitionError(f"{place}: a constant is of a basic type, not {type_.name}")
        if _CONSTANT_NAME.fullmatch(name) is None:
            raise DefinitionError(f"{place}: {name!r}: constants have names like MAX_SPEED")
        into.constants[name] = type_.base, _value(type_, value, place)
        return
    if _FIELD_NAME.fullmatch(name) is None:
        raise DefinitionError(f"{place}: {name!r}: fields have names like wheel_speed")
    default = _default(type_, value, place) if value else None
    into.fields.append(Field(name, type_, default, number))


def _type(found: re.Match[str], place: str, package: str) -> Type:
    base, many = found["base"], found["many"]
    bound = None if found["bound"] is None else int(found["bound"])
    if bound is not None and base not in ("string", "wstring"):
        raise DefinitionError(f"{place}: only texts have a bound, as in `string<=10`, not {base}")
    if base not in BASIC:
        parts = base.split("/")
        if len(parts) == 3 and parts.pop(1) != "msg":
            raise DefinitionError(f"{place}: {base}: fields are messages, as in `package/Name`")
        # A name alone is one of the same package.
        base = "/".join(parts if len(parts) == 2 else (package, *parts))
        if not is_type_name(parts[-1]):
            raise DefinitionError(
                f"{place}: the type {found['base']!r} is unknown; basic types are "
                f"{', '.join(BASIC)}, and messages have names like `Pose` or `geometry_msgs/Pose`"
            )
    if many is None:
        return Type(base, bound)
    size = many[1:-1].removeprefix("<=")
    if "<=" in many and not size:
        raise DefinitionError(f"{place}: {many} has no largest length, as in `[<=3]`")
    fixed = size and "<=" not in many
    return Type(base, bound, "array" if fixed else "sequence", int(size) if size else None)


def _default(type_: Type, text: str, place: str) -> Any:
    if type_.is_message:
        raise DefinitionError(f"{place}: a message has no default value here, only basic types do")
    if type_.many is None:
        return _value(type_, text, place)
    if not (text.startswith("[") and text.endswith("]")):
        raise DefinitionError(f"{place}: {text!r}: the default of many values is a list, as [1, 2]")
    values = [_value(type_, it.strip(), place) for it in _elements(text[1:-1])]
    right = len(values) == type_.size if type_.many == "array" else True
    if type_.many == "sequence" and type_.size is not None:
        right = len(values) <= type_.size
    if not right:
        raise DefinitionError(f"{place}: {text}: {len(values)} values are not {type_.name}")
    return values


def _elements(text: str) -> list[str]:
    """Split at commas that are not between quotes."""
    return [it for it in re.findall(r"""\s*("[^"]*"|'[^']*'|[^,]+)\s*,?""", text) if it.strip()]


def _value(type_: Type, text: str, place: str) -> Any:
    base = type_.base
    try:
        if base == "bool":
            return {"true": True, "1": True, "false": False, "0": False}[text.lower()]
        if base in ("string", "wstring"):
            return _text(text)
        if base.startswith("float"):
            return float(text)
        value = int(text, 0)
        low, high = limits(base)
        if not low <= value <= high:
            raise ValueError
    except (KeyError, ValueError, SyntaxError):
        raise DefinitionError(f"{place}: {text!r} is no value of the type {base}") from None
    return bytes([value]) if base == "byte" else value


def _text(written: str) -> str:
    if len(written) > 1 and written[0] == written[-1] and written[0] in "\"'":
        return str(ast.literal_eval(written))
    return written


def limits(base: str) -> tuple[int, int]:
    """Return the smallest and the largest number of an integer type."""
    if base in ("byte", "char"):
        return 0, 255
    matched = _INTEGER.fullmatch(base)
    if matched is None:
        raise ValueError(base)
    bits = int(matched[1])
    return (0, 2**bits - 1) if base.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
