"""The types of a bag: the classes of its messages, and definitions for bags that are written."""

from __future__ import annotations

from typing import Any, NamedTuple

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg
from rosbags.typesys.store import Typestore

from hprm.ros._bags.errors import BagError
from hprm.ros._messages import class_of
from hprm.ros._messages.cdr import SERIALIZER
from hprm.ros._messages.definitions import DefinitionError

_FILLER = "structure_needs_at_least_one_member"


class Definition(NamedTuple):
    """What a bag has of a type: its text, with those of all types within it, and its hash."""

    text: str
    digest: str


def class_in(path: object, connection: Connection) -> Any:
    """Return the class of the messages of a topic; its fields must be those that the bag has."""
    kind = _class(path, connection.msgtype)
    described = _described(path, connection)
    if described is None:
        return kind
    name = SERIALIZER.register(kind)
    for each, (_, fields) in described.items():
        here = SERIALIZER.store.fielddefs.get(each)
        if here is not None and _plain(here[1]) != _plain(fields):
            raise BagError(
                f"{path}: the messages of {connection.topic} are of the type {name}, and {each} "
                f"has other fields in the bag than here: {_difference(fields, here[1])}"
            )
    return kind


def definition_of(kind: type) -> Definition:
    """Return the definition of a class, for a bag."""
    name = SERIALIZER.register(kind)
    text, _ = SERIALIZER.store.generate_msgdef(name, ros_version=2)
    return Definition(text, SERIALIZER.store.hash_rihs01(name))


def definition_in(path: object, connection: Connection) -> Definition:
    """Return the definition of the type of a topic; if the bag has none, that of the class."""
    described = _described(path, connection)
    if described is None:
        return definition_of(_class(path, connection.msgtype))
    store = Typestore()
    store.register(described)
    return Definition(connection.msgdef.data, store.hash_rihs01(connection.msgtype))


def _class(path: object, name: str) -> Any:
    try:
        return class_of(name)
    except (LookupError, DefinitionError) as error:
        raise BagError(f"{path}: the type {name} is not known here: {error.args[0]}") from None


def _described(path: object, connection: Connection) -> Any:
    """Read the definition that a bag has; None if it has none."""
    text, name = connection.msgdef.data, connection.msgtype
    try:
        if connection.msgdef.format == MessageDefinitionFormat.MSG:
            return get_types_from_msg(text, name)
        if connection.msgdef.format == MessageDefinitionFormat.IDL:
            return get_types_from_idl(text)
    except TypesysError as error:
        raise BagError(f"{path}: the bag's definition of {name} is wrong: {error}") from None
    return None


def _plain(fields: Any) -> list[Any]:
    return [it for it in fields if it[0] != _FILLER]


def _difference(there: Any, here: Any) -> str:
    in_bag, in_class = dict(_plain(there)), dict(_plain(here))
    shared = in_bag.keys() & in_class.keys()
    names = [
        *(f"{it} is only in the bag" for it in in_bag if it not in shared),
        *(f"{it} is only here" for it in in_class if it not in shared),
        *(f"{it} is of another type" for it in sorted(shared) if in_bag[it] != in_class[it]),
    ]
    return ", ".join(names) or "they have another order"
