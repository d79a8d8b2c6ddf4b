"""Which endpoints exchange messages: by type and quality of service.

What a publisher offers is at least what a subscription requests, policy by policy, or no message
passes between the two. A publisher that offers anything but the default profile sends its offer
beside each message. So each subscription decides by itself, whatever else a script publishes on
that topic, and whenever it was made. Nodes elsewhere, over Zenoh, exchange messages in any case.

A client offers requests and requests responses, and a service the other way round, each by its one
profile. Where one of the two does not fit, the client does not find the service.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hprm.ros._graph import Endpoint
from hprm.ros.duration import Infinite
from hprm.ros.qos import (
    DeadlineBestAvailable,
    DurabilityPolicy,
    LivelinessPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)

#: Whether messages are reliable, whether they are kept, the longest time in nanoseconds between
#: two of them, whether the publisher asserts that it is alive, and how often, in nanoseconds.
Terms = tuple[bool, bool, int, bool, int]

_NEVER = Infinite.nanoseconds
_BEST = DeadlineBestAvailable.nanoseconds
_PLAIN: Terms = (True, False, _NEVER, False, _NEVER)
#: What is beside messages from elsewhere.
_ELSEWHERE = ()
#: In the description of an endpoint elsewhere.
_MARK = "is_elsewhere"

# What is told of a policy that is not fulfilled, in the order of the terms.
_KINDS = (
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
    QoSPolicyKind.DEADLINE,
    QoSPolicyKind.LIVELINESS,
    QoSPolicyKind.LIVELINESS,
)


def described(kind: str, qos: QoSProfile, depth: int | None) -> dict[str, Any]:
    """Describe the quality of service of an endpoint, with its depth, as others know it."""
    reliability, durability, liveliness = qos.reliability, qos.durability, qos.liveliness
    if kind == "publisher":
        # The best that is available is the best: a publisher can do all.
        if reliability is ReliabilityPolicy.BEST_AVAILABLE:
            reliability = ReliabilityPolicy.RELIABLE
        if durability is DurabilityPolicy.BEST_AVAILABLE:
            durability = DurabilityPolicy.TRANSIENT_LOCAL
    if kind in ("client", "service"):
        # Of services, the best that is available is the default, as the best for one of the two
        # directions might be too much for the other one.
        if reliability is ReliabilityPolicy.BEST_AVAILABLE:
            reliability = ReliabilityPolicy.RELIABLE
        if durability is DurabilityPolicy.BEST_AVAILABLE:
            durability = DurabilityPolicy.VOLATILE
        if liveliness is LivelinessPolicy.BEST_AVAILABLE:
            liveliness = LivelinessPolicy.AUTOMATIC
    told: dict[str, Any] = {
        "reliability": reliability.name,
        "durability": durability.name,
        "depth": depth,
    }
    if liveliness is not LivelinessPolicy.SYSTEM_DEFAULT:
        told["liveliness"] = liveliness.name
    for policy in ("deadline", "lifespan", "liveliness_lease_duration"):
        nanoseconds = getattr(qos, policy).nanoseconds
        if nanoseconds == _BEST and kind in ("client", "service"):
            continue
        if nanoseconds:
            told[policy] = nanoseconds
    return told


def elsewhere(qos: dict[str, Any]) -> dict[str, Any]:
    """Describe the quality of service of an endpoint elsewhere, which is compatible with all."""
    return qos | {_MARK: True}


def keeps(qos: QoSProfile) -> bool:
    """Return whether a publisher keeps messages for subscriptions that come later."""
    return qos.durability in (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.BEST_AVAILABLE)


def offered(qos: dict[str, Any]) -> Terms:
    """Return what a publisher offers, or a client or a service for what it sends."""
    return (
        qos["reliability"] != "BEST_EFFORT",
        qos["durability"] == "TRANSIENT_LOCAL",
        _time(qos, "deadline", 0),
        qos.get("liveliness") in ("MANUAL_BY_TOPIC", "BEST_AVAILABLE"),
        _time(qos, "liveliness_lease_duration", 0),
    )


def requested(qos: dict[str, Any]) -> Terms:
    """Return what a subscription requests; the best that is available is any.

    Or a client or a service of what it takes.
    """
    return (
        qos["reliability"] == "RELIABLE",
        qos["durability"] == "TRANSIENT_LOCAL",
        _time(qos, "deadline", _NEVER),
        qos.get("liveliness") == "MANUAL_BY_TOPIC",
        _time(qos, "liveliness_lease_duration", _NEVER),
    )


def _time(qos: dict[str, Any], policy: str, best: int) -> int:
    stated = qos.get(policy, _NEVER)
    return best if stated == _BEST else int(stated)


def refused(offer: Terms, request: Terms) -> QoSPolicyKind | None:
    """Return the first policy by which an offer is less than a request; none if it is enough."""
    for kind, has, wants in zip(_KINDS, offer, request, strict=True):
        # Of two times, the shorter one is more.
        is_less = wants and not has if isinstance(wants, bool) else has > wants
        if is_less:
            return kind
    return None


def mismatch(one: Endpoint, other: Endpoint) -> QoSPolicyKind | None:
    """Return by which policy the two ends of a topic or a service do not fit; none if they do."""
    if one.qos.get(_MARK) or other.qos.get(_MARK):
        return None
    sender, taker = (one, other) if one.kind in ("publisher", "client") else (other, one)
    wrong = refused(offered(sender.qos), requested(taker.qos))
    if wrong is None and sender.kind == "client":
        wrong = refused(offered(taker.qos), requested(sender.qos))
    return wrong


_OTHER_ENDS = {
    "publisher": "subscription",
    "subscription": "publisher",
    "client": "service",
    "service": "client",
}


def others(own: Endpoint, endpoints: Iterable[Endpoint]) -> list[Endpoint]:
    """Return the endpoints at the other end of a topic or a service, whether they fit or not."""
    kind = _OTHER_ENDS[own.kind]
    return [it for it in endpoints if it.kind == kind and it.name == own.name]


def misfits(own: Endpoint, endpoints: Iterable[Endpoint]) -> list[QoSPolicyKind]:
    """Return by which policies others of its type do not fit an endpoint."""
    there = [mismatch(own, it) for it in others(own, endpoints) if it.type == own.type]
    return [policy for policy in there if policy is not None]


def matched(own: Endpoint, endpoints: Iterable[Endpoint]) -> list[Endpoint]:
    """Return those that exchange messages with an endpoint."""
    there = others(own, endpoints)
    return [it for it in there if it.type == own.type and mismatch(own, it) is None]


# Messages, with or without an offer beside them.


class Offer:
    """What a publisher offers, a client or a service, for its messages."""

    def __init__(self, endpoint: Endpoint) -> None:
        """Look at the description of the endpoint."""
        self._terms = offered(endpoint.qos)

    def beside(self, message: Any) -> Any:
        """Return what is sent for a message."""
        return message if self._terms == _PLAIN else (self._terms, message)

    def of_call(self, client: str, number: int, message: Any) -> Call:
        """Return what is sent for a request of a client, or the response to it."""
        call = (client, number, message)
        return call if self._terms == _PLAIN else (*call, self._terms)


#: A request or a response: of which client, its number there, and the message; then an offer,
#: perhaps.
Call = tuple[Any, ...]


def call_from_elsewhere(client: str, number: int, message: Any) -> Call:
    """Return what is sent for a request or a response from elsewhere, which all take."""
    return (client, number, message, _ELSEWHERE)


class Request:
    """What a subscription takes, a client or a service."""

    def __init__(self, endpoint: Endpoint, type_: type[Any] = object) -> None:
        """Look at the description of the endpoint, whose messages have that type."""
        self._type = type_
        terms = requested(endpoint.qos)
        self._terms = terms
        self._takes_plain = refused(_PLAIN, terms) is None

    def message_of(self, sent: Any) -> Any:
        """Return the message that was sent; none if it is not for this subscription."""
        takes, message = self._takes_plain, sent
        if type(sent) is tuple:
            offer, message = sent
            takes = not offer or refused(offer, self._terms) is None
        return message if takes and isinstance(message, self._type) else None

    def takes_call(self, call: Call) -> bool:
        """Return whether a client or a service takes a response or a request."""
        if len(call) == 3:
            return self._takes_plain
        return not call[3] or refused(call[3], self._terms) is None


def message_of(sent: Any) -> Any:
    """Return the message that was sent, whatever is beside it."""
    return sent[1] if type(sent) is tuple else sent


def is_kept(sent: Any) -> bool:
    """Return whether a publisher keeps a message that it has sent."""
    return type(sent) is tuple and bool(sent[0]) and sent[0][1]


def from_elsewhere(message: Any) -> Any:
    """Return what is sent for a message from elsewhere, which all subscriptions take."""
    return (_ELSEWHERE, message)
