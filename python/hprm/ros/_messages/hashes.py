"""Hashes of types (RIHS01), by which bags and the middlewares of ROS 2 know them."""

from __future__ import annotations

from functools import cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from hprm.ros._messages import class_of, type_name
from hprm.ros._messages.cdr import SERIALIZER

_INFO = "service_msgs/msg/ServiceEventInfo"


@cache
def interface(name: str) -> Any:
    """Find the class of a message or a service by its name, or of what carries an action."""
    package, kind, last = name.split("/")
    action, _, part = last.rpartition("_")
    if kind == "action" and part in ("SendGoal", "GetResult"):
        return getattr(class_of(f"{package}/action/{action}").Impl, f"{part}Service")
    if kind == "action" and part == "FeedbackMessage":
        return class_of(f"{package}/action/{action}").Impl.FeedbackMessage
    return class_of(name)


@cache
def digest(kind: Any) -> str:
    """Return the hash of the class of a message or a service."""
    store = Typestore()
    fields: dict[str, Any] = store.fielddefs
    if hasattr(kind, "Request"):
        name = type_name(kind)
        fields |= _service(name, kind)
    else:
        name = SERIALIZER.register(kind)
    for each, (_, described) in SERIALIZER.store.fielddefs.items():
        fields[each] = [], [(field, _hashed(type_)) for field, type_ in described]
    return store.hash_rihs01(name)


def _service(name: str, kind: Any) -> dict[str, Any]:
    """Describe a service: it has a request, a response, and an event that tells of both."""
    request, response, info = (
        (Nodetype.NAME, SERIALIZER.register(it))
        for it in (kind.Request, kind.Response, class_of(_INFO))
    )
    event = [
        ("info", info),
        ("request", (Nodetype.SEQUENCE, (request, 1))),
        ("response", (Nodetype.SEQUENCE, (response, 1))),
    ]
    whole = [
        ("request_message", request),
        ("response_message", response),
        ("event_message", (Nodetype.NAME, f"{name}_Event")),
    ]
    return {f"{name}_Event": ([], event), name: ([], whole)}


def _hashed(described: Any) -> Any:
    """Return the type of a field as it is hashed: ``char`` is another word for ``uint8``."""
    node, rest = described
    if node == Nodetype.BASE and rest[0] == "char":
        return node, ("uint8", rest[1])
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return node, (_hashed(rest[0]), rest[1])
    return described
