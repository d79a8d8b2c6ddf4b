"""The bridge: a part of the hub that gives scripts to nodes elsewhere, and those to scripts.

What comes has the time of its arrival as its tag, as all that comes over the hub, unless it is
aligned (``aligning.py``). The hub's thread
does all work; threads of Zenoh put what has come into a queue.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import zenoh

from hprm.ros._graph import Endpoint, Flow, Graph
from hprm.ros._lines import write_line
from hprm.ros._messages import DefinitionError
from hprm.ros._messages.cdr import SERIALIZER, SerializationError, Serializer
from hprm.ros._offers import call_from_elsewhere, from_elsewhere, message_of
from hprm.ros._zenoh.aligning import Aligning
from hprm.ros._zenoh.arrivals import Arrivals
from hprm.ros._zenoh.attachment import Attachment, read
from hprm.ros._zenoh.endpoints import Local
from hprm.ros._zenoh.graph import Outside
from hprm.ros._zenoh.keys import ADMIN, is_wanted
from hprm.ros._zenoh.numbers import Numbers

if TYPE_CHECKING:
    from hprm.ros._zenoh.session import Settings

#: How long a response may take: results of actions come when these are over.
_PATIENCE_S = 1e9

#: How long threads of Zenoh may take to end.
_ENDING_S = 2.0

#: How many requests of nodes elsewhere may wait for their responses.
_REQUESTS = 10_000

#: With what the names of clients elsewhere begin.
_CLIENT = "<elsewhere>"

Told = tuple[Sequence[int], Any]


class ZenohBridge:
    """What is between the hub and a session of Zenoh."""

    def __init__(self, session: zenoh.Session, settings: Settings) -> None:
        """Begin to learn which nodes there are elsewhere."""
        self._session, self._settings = session, settings
        self._arrivals = Arrivals(warn)
        self._local = Local(session, settings.domain, self._arrivals)
        self._outside = Outside(str(session.zid()), settings.wanted, warn)
        self._serializer = Serializer(views=True)
        self._scripts: range = range(0)
        self._names: list[str] = []
        self._numbers: dict[str, Numbers] = {}
        self._unread: set[str] = set()
        self._queries: dict[int, tuple[Any, Attachment]] = {}
        self._answered: set[str] = set()
        self._requests = 0
        wait_ns = settings.wait_ns
        self._aligning = None if wait_ns is None else Aligning(wait_ns, warn)
        self._watch = session.liveliness().declare_subscriber(
            f"{ADMIN}/{settings.domain}/**",
            lambda it: self._arrivals.put(
                "token", str(it.key_expr), it.kind == zenoh.SampleKind.PUT
            ),
            history=True,
        )

    @property
    def is_aligned(self) -> bool:
        """Whether what comes from elsewhere has tags by its stamps."""
        return self._aligning is not None

    def join(self, graph: Graph) -> None:
        """Show what the scripts have declared, before their federation begins."""
        self._scripts = range(len(graph.scripts))
        self._names = [it.name for it in graph.scripts]
        for number, script in enumerate(graph.scripts):
            for node in script.nodes:
                self._local.declare_node(number, node)
            for endpoint in script.endpoints:
                self._declare(number, endpoint)

    def leave(self, name: str) -> None:
        """Show nothing any more of a script that has ended; in any thread."""
        if name in self._names:
            self._arrivals.put("left", self._names.index(name))

    def close(self) -> None:
        """End, and say what was lost."""
        for name, numbers in self._numbers.items():
            if numbers.lost:
                warn(f"{numbers.lost} messages of {name} from elsewhere have not arrived")
        for name, count in self._arrivals.dropped.items():
            warn(
                f"{count} messages of {name} from elsewhere came faster than the hub forwards them"
            )
        if self._aligning is not None:
            self._aligning.report()
        self._session.close()  # type: ignore[no-untyped-call]
        # Python cannot end in order while threads of Zenoh call it.
        for thread in threading.enumerate():
            if "pyo3-closure" in thread.name:
                thread.join(_ENDING_S)

    # What the hub calls: ``hprm.ros._federation.Bridge``.

    def begin(self, wake: Any) -> None:
        """Have the hub ask for what arrives from now on."""
        self._arrivals.begin(wake)

    def take(self, sender: int, news: Any) -> None:
        """Take what a script tells: of a late endpoint or node, or a message."""
        kind, *told = news
        match kind:
            case "endpoint":
                self._declare(sender, Endpoint(**told[1]))
            case "joined":
                # What was told before has not reached it.
                self._arrivals.put("joined", sender)
            case "node":
                self._local.declare_node(sender, told[1])
            case "message":
                self._send(sender, Flow(told[0], told[1]), told[2])

    def arrived(self) -> list[Told]:
        """Return what has come for scripts."""
        told: list[Told] = []
        for kind, *what in self._arrivals.take():
            match kind:
                case "token":
                    key, is_there = what
                    news = self._outside.add(key) if is_there else self._outside.remove(key)
                    told += [(self._scripts, it) for it in news]
                case "message":
                    told += self._message(*what)
                case "query":
                    told += self._request(*what)
                case "reply":
                    told += self._response(*what)
                case "left":
                    self._local.leave(what[0])
                case "joined":
                    told += [((what[0],), it) for it in self._outside.known()]
        return told

    def due(self, news: Any, now: int) -> int:
        """Return when news are due that have come now: messages of topics by their stamps."""
        kind, *told = news
        if self._aligning is None or kind != "message" or told[0] != "topic":
            return now
        return self._aligning.due(told[1], message_of(told[2]), now)

    # From scripts.

    def _declare(self, script: int, endpoint: Endpoint) -> None:
        if not is_wanted(endpoint.name, self._settings.wanted):
            return
        try:
            digest = self._local.declare(script, endpoint)
        except (LookupError, DefinitionError, SerializationError) as error:
            warn(f"{endpoint.name} is not bridged: {error.args[0]}")
            return
        self._outside.declare(endpoint, digest)

    def _send(self, sender: int, flow: Flow, message: Any) -> None:
        try:
            match flow.kind:
                case "topic":
                    self._publish(sender, flow, message)
                case "request":
                    self._ask(sender, flow, *message[:3])
                case "response":
                    self._answer(flow, *message[:3])
        except (SerializationError, zenoh.ZError) as error:
            self._tell_unread(flow, str(error))

    def _publish(self, sender: int, flow: Flow, message: Any) -> None:
        found = self._local.publisher(sender, flow.name)
        if found is not None:
            publisher, numbers = found
            data = SERIALIZER.serialize(message_of(message))
            publisher.put(data, attachment=numbers.attachment().pack())

    def _ask(self, sender: int, flow: Flow, client: str, number: int, request: Any) -> None:
        """Send a request, whose response goes to the script that has sent it."""
        numbers = self._local.client(sender, flow.name)
        if numbers is None:
            return

        def on_reply(reply: Any) -> None:
            if reply.ok is not None:
                payload = reply.ok.payload.to_bytes()
                self._arrivals.put("reply", sender, flow.name, client, number, payload)

        self._session.get(
            self._local.keys[flow.name],
            on_reply,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_PATIENCE_S,
            payload=SERIALIZER.serialize(request),
            attachment=numbers.attachment().pack(),
            congestion_control=zenoh.CongestionControl.BLOCK,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def _answer(self, flow: Flow, client: str, number: int, response: Any) -> None:
        if client != _CLIENT:
            return
        query, asked = self._queries.pop(number, (None, None))
        if query is None or asked is None:
            return
        try:
            data = SERIALIZER.serialize(response)
            query.reply(
                self._local.keys[flow.name],
                data,
                attachment=asked._replace(time=time.time_ns()).pack(),
            )
        finally:
            query.drop()

    # From elsewhere.

    def _message(self, topic: str, payload: bytes, beside: bytes) -> list[Told]:
        attachment = read(beside)
        if attachment is not None:
            numbers = self._numbers.setdefault(topic, Numbers())
            is_first = numbers.lost == 0
            missing = numbers.note(attachment.gid, attachment.number)
            if missing and is_first:
                warn(
                    f"{missing} messages of {topic} from elsewhere are lost: number"
                    f" {attachment.number} came after number {attachment.number - missing - 1}"
                )
        return self._told(Flow("topic", topic), payload, from_elsewhere)

    def _request(self, service: str, query: Any, payload: bytes, beside: bytes) -> list[Told]:
        asked = read(beside)
        flow = Flow("request", service)
        if asked is None or len(self._queries) >= _REQUESTS:
            query.drop()
            self._tell_unread(flow, "it has no attachment" if asked is None else "too many wait")
            return []
        self._requests += 1
        number = self._requests
        told = self._told(
            flow, payload, lambda message: call_from_elsewhere(_CLIENT, number, message)
        )
        if not told:
            query.drop()
            return []
        self._queries[number] = query, asked
        if service not in self._answered:
            self._answered.add(service)
            told.insert(0, (self._scripts, ("open", "response", service)))
        return told

    def _response(
        self, script: int, service: str, client: str, number: int, payload: bytes
    ) -> list[Told]:
        flow = Flow("response", service)
        told = self._told(
            flow, payload, lambda message: call_from_elsewhere(client, number, message)
        )
        return [([script], news) for _, news in told[:1]]

    def _told(self, flow: Flow, payload: bytes, made: Any) -> list[Told]:
        """Return the news of a message for those that take it."""
        kind = self._local.message_class(flow)
        if kind is None:
            return []
        try:
            message = self._serializer.deserialize(payload, kind)
        except SerializationError as error:
            self._tell_unread(flow, str(error))
            return []
        receivers = self._local.takers(flow) if flow.kind != "response" else self._scripts
        return [(list(receivers), ("message", flow.kind, flow.name, made(message)))]

    def _tell_unread(self, flow: Flow, why: str) -> None:
        """Say that a message could not be forwarded, once for a topic or a service."""
        if flow.name not in self._unread:
            self._unread.add(flow.name)
            what = "message" if flow.kind == "topic" else flow.kind
            warn(f"a {what} of {flow.name} has not passed the bridge: {why}")


def warn(text: str) -> None:
    """Warn the user."""
    write_line(f"warning: {text}", sys.stderr)
