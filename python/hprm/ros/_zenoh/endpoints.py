"""The endpoints of scripts as those elsewhere see them: tokens, publishers, subscribers, services.

This is all that touches the session, but for requests. What Zenoh's threads bring goes to a queue.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import Any

import zenoh
import zenoh.ext

from hprm.ros._graph import Endpoint, Flow
from hprm.ros._messages.hashes import digest, interface
from hprm.ros._zenoh.arrivals import Arrivals
from hprm.ros._zenoh.attachment import Attachment
from hprm.ros._zenoh.keys import key
from hprm.ros._zenoh.tokens import Session, Token, gid, quality_text

#: How often a reliable publisher that keeps messages tells the number of its last one.
_HEARTBEAT_S = 0.5


class Sender:
    """What numbers the messages of a publisher, or the requests of a client."""

    def __init__(self, identity: bytes) -> None:
        """Begin with the number 1."""
        self.gid = identity
        self._numbers = itertools.count(1)

    def attachment(self) -> Attachment:
        """Return what comes beside the next message."""
        return Attachment(next(self._numbers), time.time_ns(), self.gid)


class Local:
    """The nodes and endpoints of the scripts."""

    def __init__(self, session: zenoh.Session, domain: int, arrivals: Arrivals) -> None:
        """Declare nothing yet."""
        self._session, self._arrivals = session, arrivals
        self._tokens_of = Session(domain, str(session.zid()))
        self._numbers = itertools.count()
        self._nodes: dict[str, int] = {}
        #: What each script has declared with Zenoh, which ends with it.
        self._declared: dict[int, list[Any]] = {}
        self._takers: dict[Flow, list[int]] = {}
        self._listeners: dict[Flow, tuple[bool, Any]] = {}
        self._types: dict[Flow, Any] = {}
        self._publishers: dict[tuple[int, str], tuple[Any, Sender]] = {}
        self._clients: dict[tuple[int, str], Sender] = {}
        self.keys: dict[str, str] = {}

    def declare_node(self, script: int, name: str) -> None:
        """Declare a node of a script."""
        if name not in self._nodes:
            self._nodes[name] = number = next(self._numbers)
            self._show(script, Token(self._tokens_of, "node", name, (number, number)))

    def declare(self, script: int, endpoint: Endpoint) -> str:
        """Declare an endpoint of a script; return the hash of its type."""
        kind = interface(endpoint.type)
        hashed = digest(kind)
        self.declare_node(script, endpoint.node)
        token = Token(
            self._tokens_of,
            endpoint.kind,
            endpoint.node,
            (self._nodes[endpoint.node], next(self._numbers)),
            endpoint.name,
            endpoint.type,
            hashed,
            quality_text(endpoint.qos),
        )
        self.keys[endpoint.name] = at = key(
            self._tokens_of.domain, endpoint.name, endpoint.type, hashed
        )
        for flow in (endpoint.takes, endpoint.sends):
            if flow is not None:
                self._types[flow] = _message_class(kind, flow)
        if endpoint.takes is not None and endpoint.kind != "client":
            self._listen(script, endpoint, at)
        if endpoint.kind == "publisher" and (script, endpoint.name) not in self._publishers:
            publisher = _publisher(self._session, at, endpoint.qos)
            self._publishers[script, endpoint.name] = publisher, Sender(gid(token.text()))
            self._declared.setdefault(script, []).append(publisher)
        if endpoint.kind == "client":
            self._clients.setdefault((script, endpoint.name), Sender(gid(token.text())))
        # Last: what it shows is there.
        self._show(script, token)
        return hashed

    def leave(self, script: int) -> None:
        """Declare nothing any more for a script that has ended."""
        for it in reversed(self._declared.pop(script, [])):
            it.undeclare()
        for senders in (self._publishers, self._clients):
            for each in [it for it in senders if it[0] == script]:
                del senders[each]
        for flow, takers in self._takers.items():
            if script in takers:
                takers.remove(script)
                if not takers:
                    self._listeners.pop(flow)[1].undeclare()

    def takers(self, flow: Flow) -> list[int]:
        """Return the numbers of the scripts that take a flow."""
        return self._takers.get(flow, [])

    def message_class(self, flow: Flow) -> Any:
        """Return the class of the messages of a flow; none if no script has it."""
        return self._types.get(flow)

    def publisher(self, script: int, topic: str) -> tuple[Any, Sender] | None:
        """Return the publisher of a script for a topic."""
        return self._publishers.get((script, topic))

    def client(self, script: int, service: str) -> Sender | None:
        """Return what numbers the requests of a script to a service."""
        return self._clients.get((script, service))

    def _show(self, script: int, token: Token) -> None:
        made = self._session.liveliness().declare_token(token.text())
        self._declared.setdefault(script, []).append(made)

    def _listen(self, script: int, endpoint: Endpoint, at: str) -> None:
        flow = endpoint.takes
        assert flow is not None
        takers = self._takers.setdefault(flow, [])
        if script not in takers:
            takers.append(script)
        wants_history = endpoint.qos.get("durability") == "TRANSIENT_LOCAL"
        has_history, listener = self._listeners.get(flow, (False, None))
        if listener is not None and (has_history or not wants_history):
            return
        if listener is not None:
            listener.undeclare()
        if endpoint.kind == "service":
            listener = self._session.declare_queryable(
                at,
                self._on_query(endpoint.name),
                complete=True,
                allowed_origin=zenoh.Locality.REMOTE,
            )
        else:
            listener = self._subscriber(at, endpoint, wants_history)
        self._listeners[flow] = wants_history, listener

    def _subscriber(self, at: str, endpoint: Endpoint, wants_history: bool) -> Any:
        on_sample = self._on_sample(endpoint.name)
        if not wants_history:
            return self._session.declare_subscriber(
                at, on_sample, allowed_origin=zenoh.Locality.REMOTE
            )
        depth = endpoint.qos.get("depth")
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=depth)
        recovery = zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True)
        return zenoh.ext.declare_advanced_subscriber(
            self._session,
            at,
            on_sample,
            history=history,
            recovery=recovery if endpoint.qos.get("reliability") != "BEST_EFFORT" else None,
            subscriber_detection=True,
        )

    def _on_sample(self, name: str) -> Callable[[Any], None]:
        def on_sample(sample: Any) -> None:
            self._arrivals.message(name, sample.payload.to_bytes(), _attachment(sample))

        return on_sample

    def _on_query(self, name: str) -> Callable[[Any], None]:
        def on_query(query: Any) -> None:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            self._arrivals.put("query", name, query, payload, _attachment(query))

        return on_query


def _attachment(of: Any) -> bytes:
    return of.attachment.to_bytes() if of.attachment is not None else b""


def _message_class(kind: Any, flow: Flow) -> Any:
    match flow.kind:
        case "request":
            return kind.Request
        case "response":
            return kind.Response
    return kind


def _publisher(session: zenoh.Session, at: str, quality: dict[str, Any]) -> Any:
    """Declare a publisher; it keeps messages for later subscriptions if that is its quality."""
    is_reliable = quality.get("reliability") != "BEST_EFFORT"
    wait = zenoh.CongestionControl.BLOCK if is_reliable else zenoh.CongestionControl.DROP
    how = zenoh.Reliability.RELIABLE if is_reliable else zenoh.Reliability.BEST_EFFORT
    if quality.get("durability") != "TRANSIENT_LOCAL":
        return session.declare_publisher(at, congestion_control=wait, reliability=how)
    # A publisher that keeps all still needs a bound.
    cache = zenoh.ext.CacheConfig(quality.get("depth") or 1000)
    misses = zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S)
    return zenoh.ext.declare_advanced_publisher(
        session,
        at,
        congestion_control=wait,
        reliability=how,
        cache=cache,
        sample_miss_detection=misses if is_reliable else None,
        publisher_detection=True,
    )
