"""Messages that publishers keep for subscriptions that come later: ``TRANSIENT_LOCAL``.

A script keeps what its own publishers have sent. A subscription that a script makes after the start
gets that of the same script at once, and asks other scripts for theirs, over the hub. It takes
nothing else until they have answered, so that messages stay in their order.

What a connection has brought before the subscription was there is counted on both sides: of what a
publisher has kept, the subscription gets that, and the rest comes over the connection anyway.

A script that begins late has had its connections from the start. It looks itself at what these
bring before it begins, so that what its subscriptions get first depends on no clock.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Protocol

from hprm.ros._graph import Endpoint, Flow
from hprm.ros._offers import is_kept

if TYPE_CHECKING:
    from hprm.ros._federation import Process
    from hprm.ros._meeting import Membership

#: How long a subscription waits for what others have kept: one of them may have ended.
PATIENCE_NS = 500_000_000

# How much of several publishers of one script is kept before a script begins that takes it.
_MANY = 1_000


class LateTaker(Protocol):
    """A subscription that gets what was sent before it was there."""

    def deliver(self, message: Any) -> None:
        """Take a message."""

    def deliver_before(self, messages: list[Any]) -> None:
        """Take messages that come before those that wait."""

    def hold(self, is_held: bool) -> None:
        """Call back no more until what comes first is there, or again."""

    @property
    def is_destroyed(self) -> bool:
        """Whether it takes nothing any more."""


class Kept:
    """The last messages of a publisher: as many as its depth, for as long as they live."""

    def __init__(self, depth: int | None, lifespan_ns: int | None) -> None:
        """Keep so many, or all, for so long, or for ever."""
        self._messages: deque[tuple[int, int, Any]] = deque(maxlen=depth)
        self._lifespan_ns = lifespan_ns

    def add(self, number: int, now: int, message: Any) -> None:
        """Keep a message, which is the one with that number of its topic."""
        self._messages.append((number, now, message))

    def left(self, now: int) -> Iterator[tuple[int, Any]]:
        """Return what is there now, with its numbers."""
        for number, sent, message in self._messages:
            if self._lifespan_ns is None or now - sent <= self._lifespan_ns:
                yield number, message


def is_durable(endpoint: Endpoint) -> bool:
    """Return whether a publisher keeps messages, or a subscription asks for them."""
    return endpoint.qos.get("durability") == "TRANSIENT_LOCAL"


class Keeping:
    """What a process keeps, and what it has asked others for."""

    def __init__(self) -> None:
        """Begin without anything."""
        self._kept: dict[Flow, list[Kept]] = {}
        #: How many messages of each topic this process has sent.
        self._sent: dict[Flow, int] = {}
        #: How many have come, by port and channel.
        self._taken: dict[tuple[str, int], int] = {}
        #: Subscriptions that wait for answers, and whose.
        self._asked: dict[int, tuple[LateTaker, set[str]]] = {}
        self._numbers = itertools.count(1)
        #: Durable subscriptions that were there at the start.
        self.first: list[tuple[Flow, LateTaker]] = []
        self._early: dict[tuple[str, int], deque[Any]] = {}

    def keep(self, flow: Flow, kept: Kept) -> None:
        """Let later subscriptions have what a publisher keeps."""
        self._kept.setdefault(flow, []).append(kept)

    def forget(self, flow: Flow, kept: Kept) -> None:
        """Keep nothing more of a publisher that was destroyed."""
        if kept in self._kept.get(flow, ()):
            self._kept[flow].remove(kept)

    def note_sent(self, flow: Flow, message: Any, kept: Kept | None, now: int) -> None:
        """Note that a message of a topic is sent."""
        number = self._sent[flow] = self._sent.get(flow, 0) + 1
        if kept is not None:
            kept.add(number, now, message)

    def note_taken(self, port: str, channel: int, messages: int) -> None:
        """Note that messages have come over a connection."""
        key = port, channel
        self._taken[key] = self._taken.get(key, 0) + messages

    def of(self, flow: Flow, now: int, limit: int | None = None) -> list[Any]:
        """Return what is kept of a topic, up to a number, in its order."""
        found = [each for kept in self._kept.get(flow, ()) for each in kept.left(now)]
        found.sort(key=lambda each: each[0])
        return [message for number, message in found if limit is None or number <= limit]

    # What subscriptions ask for.

    def ask(self, taker: LateTaker, others: set[str]) -> int:
        """Let a subscription wait for other scripts; return the number by which answers find it."""
        number = next(self._numbers)
        self._asked[number] = taker, set(others)
        taker.hold(True)
        return number

    def answer(self, number: int, sender: str, messages: list[Any]) -> None:
        """Give a subscription what another script has kept."""
        if number not in self._asked:
            return
        taker, others = self._asked[number]
        taker.deliver_before(messages)
        others.discard(sender)
        if not others:
            self.forget_asked(number)

    def forget_asked(self, number: int) -> None:
        """Wait for no more answers."""
        if number in self._asked:
            taker, _ = self._asked.pop(number)
            taker.hold(any(it is taker for it, _ in self._asked.values()))

    def waiting(self, sender: str) -> list[LateTaker]:
        """Return the subscriptions that wait for an answer of a script."""
        return [taker for taker, others in self._asked.values() if sender in others]

    def taken(self, flow: Flow, membership: Membership) -> dict[str, int]:
        """Return how many messages of a topic have come over connections, by their senders."""
        return {
            sender: self._taken.get((port.name, channel), 0)
            for port, channel, sender in _channels(membership)
            if port.flow == flow
        }

    # What comes before this process begins.

    def take_early(self, name: str, flow: Flow, process: Process, membership: Membership) -> None:
        """Keep what comes over a connection before this process begins, if it is for it."""
        for channel, it in enumerate(getattr(process, name)):
            if not it.is_present:
                continue
            self.note_taken(name, channel, len(it.value))
            if all(flow != wanted for wanted, _ in self.first):
                continue
            kept = self._early.get((name, channel))
            if kept is None:
                depth = _depth(flow, name, channel, membership)
                kept = self._early[name, channel] = deque(maxlen=depth)
            kept.extend(filter(is_kept, it.value))

    def deliver_early(self, membership: Membership) -> None:
        """Deliver that."""
        for flow, taker in self.first:
            for port, channel, _ in _channels(membership):
                if port.flow == flow:
                    taker.deliver_before(list(self._early.get((port.name, channel), ())))
        self._early.clear()


def durable_scripts(
    flow: Flow, membership: Membership, late: Iterable[tuple[str, Endpoint]]
) -> set[str]:
    """Return which other scripts have publishers of a topic that keep messages."""
    graph = membership.graph
    declared = ((it.name, endpoint) for it in graph.scripts for endpoint in it.endpoints)
    found = {
        name
        for name, endpoint in itertools.chain(declared, late)
        if endpoint.sends == flow and is_durable(endpoint)
    }
    return (found & {it.name for it in graph.scripts}) - {membership.name}


def _channels(membership: Membership) -> Iterator[tuple[Any, int, str]]:
    """Return the ports of this process, their channels and the scripts that send there."""
    own = next(it for it in membership.graph.members if it.name == membership.name)
    for port in own.inputs:
        for channel, sender in enumerate(port.senders):
            yield port, channel, sender


def _depth(flow: Flow, name: str, channel: int, membership: Membership) -> int | None:
    """Return how much a script keeps for others of what a channel brings."""
    (sender,) = (
        script for port, at, script in _channels(membership) if (port.name, at) == (name, channel)
    )
    script = next(it for it in membership.graph.scripts if it.name == sender)
    depths = [it.qos.get("depth") for it in script.endpoints if it.sends == flow and is_durable(it)]
    if not depths:
        return 0
    return depths[0] if len(depths) == 1 else _MANY
