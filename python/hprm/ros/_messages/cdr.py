"""Messages as bytes, in CDR, by the code that the package ``rosbags`` generates for each type.

That code reads attributes and NumPy arrays, and calls what makes a message with the values of all
its fields in their order. What fields hold otherwise is translated here.
"""

from __future__ import annotations

import array
import struct
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy

from hprm.ros._messages.arrays import LARGE
from hprm.ros._messages.definitions import Field, Structure, Type
from hprm.ros._messages.fields import NUMBERS

try:
    from rosbags.interfaces import Nodetype
    from rosbags.serde import SerdeError
    from rosbags.typesys.store import Typestore
except ModuleNotFoundError as missing:
    if (missing.name or "").partition(".")[0] != "rosbags":
        raise
    raise ImportError(
        f"the package rosbags is not installed for {sys.executable}, and messages as bytes and "
        f"bags need it; install it there: {sys.executable} -m pip install 'hprm[ros]'",
        name="rosbags",
    ) from None

#: The field that a type without fields has among the bytes.
_FILLER = "structure_needs_at_least_one_member"

Translate = Callable[[Any], Any]


class SerializationError(ValueError):
    """A message that has no bytes, or bytes that are no such message."""


class Serializer:
    """The code for all types that have been registered.

    Where it makes messages, a sequence of numbers is an ``array.array``. With ``views`` a large one
    is a NumPy array over the bytes, which cannot be written to.
    """

    def __init__(self, views: bool = False) -> None:
        """Know no type yet."""
        self._views = views
        #: What ``rosbags`` calls a type store, for its writers too.
        self.store = Typestore()
        self._outgoing: dict[str, dict[str, Translate]] = {}

    def register(self, kind: type) -> str:
        """Make a class of messages known, with all that it consists of. Return its name."""
        structure = structure_of(kind)
        if structure.name in self._outgoing:
            return structure.name
        kinds: dict[str, type] = kind.__hprm_kinds__  # type: ignore[attr-defined]
        outgoing: dict[str, Translate] = {}
        incoming: list[Translate | None] = []
        described: list[Any] = []
        for it in structure.fields:
            if it.type.is_message:
                self.register(kinds[it.name])
            described.append((it.name, _description(it, kinds[it.name], structure)))
            out = self._to_bytes(it, kinds[it.name])
            if out is not None:
                outgoing[it.name] = out
            incoming.append(_from_bytes(it.type, self._views))
        if not described:
            described.append((_FILLER, (Nodetype.BASE, ("uint8", 0))))
            outgoing[_FILLER] = lambda _: 0
        constants = [(name, base, value) for name, (base, value) in structure.constants.items()]
        self.store.fielddefs[structure.name] = (constants, described)  # type: ignore[assignment]
        self.store.types[structure.name] = _maker(kind, incoming)  # type: ignore[assignment]
        self._outgoing[structure.name] = outgoing
        return structure.name

    def serialize(self, message: Any) -> bytes:
        """Return the bytes of a message, little-endian, with their header."""
        name = self.register(type(message))
        try:
            data = self.store.serialize_cdr(
                self._translated(name, message), name, little_endian=True
            )
        except (SerdeError, struct.error, UnicodeEncodeError, ValueError) as error:
            raise SerializationError(f"this message of {name} has no bytes: {error}") from error
        return bytes(data)

    def deserialize(self, data: Any, kind: type) -> Any:
        """Make a message of bytes."""
        name = self.register(kind)
        try:
            return self.store.deserialize_cdr(memoryview(data).cast("B"), name)
        except (SerdeError, AssertionError) as error:
            raise SerializationError(f"these bytes are no message of {name}: {error}") from error

    def _translated(self, name: str, message: Any) -> Any:
        outgoing = self._outgoing[name]
        if not outgoing:
            return message
        members = {it: getattr(message, it) for it in message._fields_and_field_types}
        for it, translate in outgoing.items():
            members[it] = translate(members.get(it))
        return SimpleNamespace(**members)

    def _to_bytes(self, it: Field, kind: type) -> Translate | None:
        base, many = it.type.base, it.type.many
        if it.type.is_message:
            name = structure_of(kind).name
            if many is None:
                return lambda value: self._translated(name, value)
            return lambda values: [self._translated(name, value) for value in values]
        if base == "byte":
            return _signed if many is None else _octets
        if many is None:
            return None
        if base in NUMBERS:
            dtype = NUMBERS[base][1]
            return lambda values: numpy.ascontiguousarray(values, dtype)
        if base == "bool":
            return lambda values: numpy.array(list(values), numpy.bool_)
        return None


def structure_of(kind: type) -> Structure:
    """Return what a class of messages consists of."""
    found = getattr(kind, "__hprm_structure__", None)
    if not isinstance(found, Structure):
        raise TypeError(
            f"{kind.__module__}.{kind.__qualname__} is no class of messages of hprm.ros; import "
            "messages after `import hprm.ros`"
        )
    return found


def _description(it: Field, kind: type, structure: Structure) -> Any:
    """Return the type of a field in the terms of ``rosbags``."""
    if it.type.base == "wstring":
        raise SerializationError(
            f"{structure.name} has the field {it.name!r} of wide text (wstring), which has no "
            "bytes here; use string"
        )
    one: Any
    if it.type.is_message:
        one = Nodetype.NAME, structure_of(kind).name
    else:
        one = Nodetype.BASE, (it.type.base, it.type.bound or 0)
    if it.type.many is None:
        return one
    node = Nodetype.ARRAY if it.type.many == "array" else Nodetype.SEQUENCE
    return node, (one, it.type.size or 0)


def _from_bytes(type_: Type, views: bool) -> Translate | None:
    base, many = type_.base, type_.many
    if base == "byte":
        if many is None:
            return lambda value: bytes([value & 0xFF])
        return lambda values: [bytes([it & 0xFF]) for it in values.tolist()]
    if many is None:
        return None
    if base == "bool":
        return lambda values: values.tolist()
    if base not in NUMBERS:
        return None
    if many == "array":
        return lambda values: values.copy()
    code = NUMBERS[base][0]

    def grown(values: Any) -> Any:
        if views and values.nbytes > LARGE:
            return values
        made: array.array[Any] = array.array(code)
        if len(values):
            made.frombytes(memoryview(values).cast("B"))
        return made

    return grown


def _maker(kind: type, incoming: list[Translate | None]) -> Callable[..., Any]:
    """Return what makes a message of the values of its fields, which are of the right types."""
    slots = [kind.__dict__[it] for it in kind.__slots__]  # type: ignore[attr-defined]

    def make(*values: Any) -> Any:
        made: Any = object.__new__(kind)
        for slot, translate, value in zip(slots, incoming, values, strict=False):
            slot.__set__(made, value if translate is None else translate(value))
        return made

    return make


def _signed(value: bytes) -> int:
    return int.from_bytes(value, "little", signed=True)


def _octets(values: Any) -> Any:
    return numpy.frombuffer(b"".join(values), numpy.int8)


#: The code for the types of this process.
SERIALIZER = Serializer()
