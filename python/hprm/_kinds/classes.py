"""Dataclasses, named tuples, enumerations, messages of ROS, and the classes of attrs and pydantic.

An object is its class, by the names of its module and itself, and its attributes. The rule for what
has arrived: a name leads to a class that the program could import itself, and only a class of one
of these kinds is made; nothing is called but what such a class has from its library. No
``__init__`` and no ``__post_init__`` runs, as with pickle. A class that has its own way of being
pickled is left to pickle. A class of messages, of ``hprm.ros`` or made by ROS itself, has a slot
``_x`` for each field ``x``, and nothing else.
"""

import copyreg
import dataclasses
import enum
import functools
import importlib
import sys
import types
from collections.abc import Callable
from typing import Any, NamedTuple

from hprm._kinds import Parts, loaded

# Of what a class has to be made as all others are.
_OWN_WAYS = ("__reduce__", "__reduce_ex__", "__getnewargs__", "__getnewargs_ex__", "__new__")

# And the method that would run when an object is freed that was filled elsewhere.
_FINALIZER = "__del__"

# Where what libraries add to a class comes from.
_GENERATED = ("dataclasses", "attr._make")


def instance(module: str, name: str, names: tuple[str, ...], *values: Any, trusted: bool) -> Any:
    """Make an object with attributes."""
    return _filler(_find(module, name, trusted))(names, values)


class _Way(NamedTuple):
    """Where objects of a class have their attributes."""

    fields: tuple[str, ...]
    #: The names of those that are in slots.
    slots: frozenset[str]
    #: The descriptors of the slots, if there is one for each field.
    descriptors: tuple[Any, ...]
    #: Whether all of them are in the dict, or all in slots, and the names of the fields lead there.
    is_plain: bool


@functools.lru_cache(maxsize=1024)
def _filler(kind: Any) -> Callable[[tuple[str, ...], tuple[Any, ...]], Any]:
    """Return what makes an object of a class of names and values; what that needs is found once."""
    messages = _message_slots(kind)
    if messages is not None:
        return functools.partial(_message, kind, messages)
    fields = _fields(kind)
    if fields is None or not _is_ordinary(kind):
        raise _refused(kind, "neither a dataclass nor a class of attrs nor one of messages")
    slots = frozenset(name for base in kind.__mro__ for name in _slots(base))
    descriptors = _descriptors(kind, fields)
    in_slots = len(descriptors) == len(fields) > 0 and all(
        type(it) is types.MemberDescriptorType for it in descriptors
    )
    in_dict = not slots and type(_static(kind, "__dict__")) is types.GetSetDescriptorType
    way = _Way(tuple(fields), slots, descriptors if in_slots else (), in_slots or in_dict)
    return functools.partial(_filled, kind, way)


def _filled(kind: Any, way: _Way, names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    made = object.__new__(kind)
    if way.is_plain and names == way.fields and len(values) == len(names):
        if way.descriptors:
            for descriptor, value in zip(way.descriptors, values, strict=True):
                descriptor.__set__(made, value)
        else:
            # With the class's own names, which Python finds quicker than those that came.
            made.__dict__.update(zip(way.fields, values, strict=True))
        return made
    for attribute, value in zip(names, values, strict=True):
        if type(attribute) is not str:
            raise ValueError(f"malformed payload: an attribute of {kind.__qualname__} has no name")
        if hasattr(made, "__dict__") and attribute not in way.slots:
            made.__dict__[attribute] = value
        elif attribute in way.fields:
            object.__setattr__(made, attribute, value)
        else:
            raise ValueError(f"malformed payload: {kind.__qualname__} has no attribute {attribute}")
    return made


def _message(kind: Any, slots: dict[str, Any], names: Any, values: tuple[Any, ...]) -> Any:
    if names != tuple(slots):
        raise ValueError(
            f"malformed payload: {kind.__qualname__} has other fields here: {tuple(slots)}"
        )
    made: Any = object.__new__(kind)
    for slot, value in zip(slots.values(), values, strict=True):
        slot.__set__(made, value)
    return made


def named_tuple(module: str, name: str, names: tuple[str, ...], *values: Any, trusted: bool) -> Any:
    """Make a named tuple."""
    kind = _find(module, name, trusted)
    if not _is_named_tuple(kind):
        raise _refused(kind, "no named tuple")
    if kind._fields != names:
        raise ValueError(f"malformed payload: {name} has other fields here: {kind._fields}")
    return tuple.__new__(kind, values)


def member(module: str, name: str, which: str, *, trusted: bool) -> enum.Enum:
    """Find a member of an enumeration."""
    found: enum.Enum = _enumeration(module, name, trusted).__members__[which]
    return found


def flags(module: str, name: str, value: int, *, trusted: bool) -> enum.Flag:
    """Make a combination of flags."""
    kind = _enumeration(module, name, trusted)
    if not issubclass(kind, enum.Flag) or type(value) is not int:
        raise _refused(kind, "no set of flags")
    combination: enum.Flag = kind(value)
    return combination


def model(module: str, name: str, state: dict[str, Any], *, trusted: bool) -> Any:
    """Make an object of a class of pydantic."""
    kind = _find(module, name, trusted)
    base = _pydantic(kind)
    if base is None:
        raise _refused(kind, "no model of pydantic")
    made = object.__new__(kind)
    base.__setstate__(made, state)
    return made


def taker(kind: Any) -> Any:
    """Return what takes apart values of a class; None if it is not of such a kind."""
    if not _is_found(kind):
        return None
    if issubclass(kind, enum.Enum):
        return _take_member
    if issubclass(kind, tuple):
        return _take_named_tuple if _is_named_tuple(kind) else None
    base = _pydantic(kind)
    if base is not None:
        return lambda value: (model, (kind.__module__, kind.__qualname__, base.__getstate__(value)))
    of_message = _message_slots(kind)
    if of_message is not None:
        return functools.partial(_take_message, of_message)
    fields = _fields(kind)
    if fields is None or not _is_ordinary(kind):
        return None
    slots = [name for name in fields if _is_slot(kind, name)]
    return lambda value: _take_instance(value, slots)


def slots_alone(kind: type) -> tuple[Any, ...] | None:
    """Return the descriptors of the slots of a class whose objects are taken apart unseen, or None.

    Code that runs while the attributes of an object are read could keep a reference to it.
    """
    fields = _fields(kind)
    if issubclass(kind, tuple):
        if not _is_named_tuple(kind) or _static(kind, "__iter__") is not tuple.__iter__:
            return None
    elif fields is None or not _is_ordinary(kind):
        return None
    plain = tuple if issubclass(kind, tuple) else object
    seen = _static(kind, "__getattribute__") is not plain.__getattribute__
    if seen or any(_static(kind, name) is not None for name in ("__getattr__", _FINALIZER)):
        return None
    attributes = _static(kind, "__dict__")
    slots = _descriptors(kind, fields or [])
    if attributes is not None and type(attributes) is not types.GetSetDescriptorType:
        return None
    if any(type(slot) is not types.MemberDescriptorType for slot in slots):
        return None
    return slots if _is_found(kind) else None


def _static(kind: type, name: str) -> Any:
    """Return what a class has by a name for its objects, without asking it."""
    return next((base.__dict__[name] for base in kind.__mro__ if name in base.__dict__), None)


def _take_instance(value: Any, slots: list[str]) -> Parts:
    kind = type(value)
    state = {name: getattr(value, name) for name in slots if hasattr(value, name)}
    state |= getattr(value, "__dict__", {})
    return instance, (kind.__module__, kind.__qualname__, tuple(state), *state.values())


def _take_message(slots: dict[str, Any], value: Any) -> Parts:
    kind = type(value)
    attributes = [slot.__get__(value) for slot in slots.values()]
    return instance, (kind.__module__, kind.__qualname__, tuple(slots), *attributes)


def _take_named_tuple(value: Any) -> Parts | None:
    kind = type(value)
    if getattr(value, "__dict__", None):
        return None
    return named_tuple, (kind.__module__, kind.__qualname__, kind._fields, *value)


def _take_member(value: enum.Enum) -> Parts | None:
    kind = type(value)
    name = value.name
    if name is not None and kind.__members__.get(name) is value:
        return member, (kind.__module__, kind.__qualname__, name)
    if isinstance(value, enum.Flag) and type(value.value) is int:
        return flags, (kind.__module__, kind.__qualname__, value.value)
    return None


def _fields(kind: type) -> list[str] | None:
    """Return the names of the fields that a dataclass or a class of attrs or messages declares."""
    if dataclasses.is_dataclass(kind):
        return list(kind.__dataclass_fields__)
    attributes = kind.__dict__.get("__attrs_attrs__")
    if attributes is not None:
        return [attribute.name for attribute in attributes]
    described = kind.__dict__.get("_fields_and_field_types")
    if isinstance(described, dict) and _slots(kind) == tuple(f"_{it}" for it in described):
        return list(_slots(kind))
    return None


@functools.lru_cache(maxsize=1024)
def _message_slots(kind: Any) -> dict[str, Any] | None:
    """Return the descriptors of the slots of a class of messages by field; None if it is none."""
    described = kind.__dict__.get("_fields_and_field_types")
    if not isinstance(described, dict) or _fields(kind) is None or not _is_ordinary(kind):
        return None
    slots = {str(it): _static(kind, f"_{it}") for it in described}
    descriptors = all(type(it) is types.MemberDescriptorType for it in slots.values())
    return slots if descriptors and not dataclasses.is_dataclass(kind) else None


def _descriptors(kind: type, fields: list[str]) -> tuple[Any, ...]:
    """Return what a class has for those of its fields that are in slots."""
    return tuple(_static(kind, name) for name in fields if _is_slot(kind, name))


def _is_slot(kind: type, name: str) -> bool:
    return any(name in _slots(base) for base in kind.__mro__)


def _slots(kind: type) -> tuple[str, ...]:
    slots = kind.__dict__.get("__slots__", ())
    return (slots,) if isinstance(slots, str) else tuple(slots)


def _is_ordinary(kind: type) -> bool:
    """Tell whether attributes are all that there is, and objects are pickled in the usual way."""
    if kind in copyreg.dispatch_table or any(
        getattr(kind, name, None) is not getattr(object, name, None)
        for name in (*_OWN_WAYS, _FINALIZER)
    ):
        return False
    fields = _fields(kind) or []
    if any(
        slot not in fields and slot != "__weakref__" and slot != "__dict__"
        for base in kind.__mro__
        for slot in _slots(base)
    ):
        return False
    return all(
        (way := getattr(kind, name, None)) is getattr(object, name, None)
        or getattr(way, "__module__", None) in _GENERATED
        for name in ("__getstate__", "__setstate__")
    )


@functools.lru_cache(maxsize=1024)
def _is_named_tuple(kind: Any) -> bool:
    new = getattr(kind.__new__, "__module__", "")
    ordinary = all(
        getattr(kind, name, None) is getattr(object, name, None)
        for name in ("__reduce__", "__reduce_ex__", "__getstate__", "__setstate__")
    )
    named = issubclass(kind, tuple) and isinstance(getattr(kind, "_fields", None), tuple)
    return named and ordinary and isinstance(new, str) and new.startswith("namedtuple_")


@functools.lru_cache(maxsize=1024)
def _pydantic(kind: Any) -> Any:
    """Return the base of all models, if the class is a model that is pickled as all are."""
    if "__pydantic_fields__" not in kind.__dict__:
        return None
    base = sys.modules["pydantic"].BaseModel
    ways = ("__getstate__", "__setstate__", *_OWN_WAYS)
    same = all(getattr(kind, name, None) is getattr(base, name, None) for name in ways)
    return base if issubclass(kind, base) and same else None


def _is_found(kind: type) -> bool:
    """Tell whether the names of a class lead to it."""
    try:
        return _find(kind.__module__, kind.__qualname__, False) is kind
    except Exception:
        return False


def _enumeration(module: str, name: str, trusted: bool) -> Any:
    kind = _find(module, name, trusted)
    if not issubclass(kind, enum.Enum):
        raise _refused(kind, "no enumeration")
    return kind


def _find(module: str, name: str, trusted: bool) -> Any:
    found: Any = loaded(module)
    if found is None:
        if not trusted:
            raise LookupError(
                f"an object of {module}.{name} has arrived from another machine, and this program "
                f"has not imported {module}; import it in a preamble"
            )
        found = importlib.import_module(module)
    for step in name.split("."):
        found = getattr(found, step)
        if not isinstance(found, type):
            raise _refused(found, "no class")
    return found


def _refused(what: Any, why: str) -> TypeError:
    name = getattr(what, "__qualname__", type(what).__qualname__)
    return TypeError(f"{name} is {why}, so no object of it is made from what has arrived")
