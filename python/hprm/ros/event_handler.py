"""Callbacks for events of publishers and subscriptions, as ``rclpy.event_handler``.

Four kinds of events happen here: a deadline is missed, another endpoint is there or is gone,
publishers are alive or no more, and a queue has dropped messages. For the others,
``UnsupportedEventTypeError`` is raised, as by rclpy for what the middleware does not tell.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hprm.ros._entity import Entity
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.exceptions import UnsupportedEventTypeError
from hprm.ros.qos import _UNSPECIFIED, QoSPolicyKind

if TYPE_CHECKING:
    from hprm.ros.publisher import Publisher
    from hprm.ros.subscription import Subscription


@dataclass(frozen=True)
class QoSOfferedDeadlineMissedInfo:
    """How often a publisher has missed its deadline, and how often since the last callback."""

    total_count: int
    total_count_change: int


@dataclass(frozen=True)
class QoSRequestedDeadlineMissedInfo:
    """How often nothing has come before the deadline, and how often since the last callback."""

    total_count: int
    total_count_change: int


@dataclass(frozen=True)
class QoSLivelinessChangedInfo:
    """How many publishers are alive, how many are there and are not, and what has changed."""

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


@dataclass(frozen=True)
class QoSLivelinessLostInfo:
    """How often a publisher was alive no more, and how often since the last callback."""

    total_count: int
    total_count_change: int


@dataclass(frozen=True)
class QoSMessageLostInfo:
    """How many messages a queue has dropped, and how many since the last callback."""

    total_count: int
    total_count_change: int


@dataclass(frozen=True)
class QoSRequestedIncompatibleQoSInfo:
    """What callbacks for policies that are not compatible take: there are no such events here."""

    total_count: int = 0
    total_count_change: int = 0
    last_policy_kind: QoSPolicyKind = QoSPolicyKind.INVALID


#: The same for publishers.
QoSOfferedIncompatibleQoSInfo = QoSRequestedIncompatibleQoSInfo


@dataclass(frozen=True)
class QoSPublisherMatchedInfo:
    """How many subscriptions a publisher has had and has, and what has changed."""

    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


@dataclass(frozen=True)
class QoSSubscriptionMatchedInfo:
    """How many publishers a subscription has had and has, and what has changed."""

    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


class EventHandler(Entity):
    """Calls back with each event of one kind."""

    order = 4

    def __init__(
        self,
        of: Publisher[Any] | Subscription,
        callback: Callable[[Any], Any],
        callback_group: CallbackGroup,
    ) -> None:
        """Call back for events of a publisher or a subscription."""
        super().__init__(of._node, callback_group)
        self.callback = callback
        self._waiting: deque[Any] = deque()

    def has_work(self) -> bool:
        """Return whether an event waits."""
        return bool(self._waiting) and not self._destroyed

    def take(self) -> Callable[[], Any]:
        """Take the oldest event."""
        event, callback = self._waiting.popleft(), self.callback
        return lambda: callback(event)


class _Matched(EventHandler):
    """Looks how many endpoints there are at the other end."""

    def __init__(
        self, of: Publisher[Any] | Subscription, info: Callable[..., Any], other: str, **rest: Any
    ) -> None:
        super().__init__(of, **rest)
        self._info, self._other, self._topic = info, other, of.topic
        self._total = self._current = 0
        self._node._runtime.on_graph(self._look)

    def _look(self) -> None:
        if self._destroyed:
            return
        now = self._node._runtime.count(self._other, self._topic)
        change = now - self._current
        if change:
            self._total += max(change, 0)
            self._current = now
            self._waiting.append(self._info(self._total, max(change, 0), now, change))


class _Deadline(EventHandler):
    """Waits for the next message, from the first one on, by logical time."""

    def __init__(
        self, of: Publisher[Any] | Subscription, info: Callable[..., Any], **rest: Any
    ) -> None:
        super().__init__(of, **rest)
        self._info, self._total, self._last = info, 0, 0
        self._deadline = of.qos_profile.deadline.nanoseconds
        self._is_waiting = False
        if of.qos_profile.deadline != _UNSPECIFIED:
            of._on_message.append(self._note)

    def _note(self) -> None:
        runtime = self._node._runtime
        self._last = runtime.now()
        if not self._is_waiting:
            self._is_waiting = True
            runtime.call_at(self._deadline, self._look)

    def _look(self) -> None:
        if self._destroyed:
            return
        runtime = self._node._runtime
        left = self._last + self._deadline - runtime.now()
        if left <= 0:
            self._total += 1
            self._waiting.append(self._info(self._total, 1))
            self._last, left = runtime.now(), self._deadline
        runtime.call_at(left, self._look)


class _Liveliness(EventHandler):
    """Looks how many publishers of a topic are alive."""

    def __init__(self, of: Subscription, **rest: Any) -> None:
        super().__init__(of, **rest)
        self._topic, self._alive, self._dead = of.topic, 0, 0
        self._node._runtime.on_graph(self._look)

    def _look(self) -> None:
        if self._destroyed:
            return
        runtime = self._node._runtime
        dead = runtime.dead(self._topic)
        alive = max(runtime.count("publisher", self._topic) - dead, 0)
        changes = alive - self._alive, dead - self._dead
        if any(changes):
            self._alive, self._dead = alive, dead
            self._waiting.append(QoSLivelinessChangedInfo(alive, dead, *changes))


class _LivelinessLost(EventHandler):
    """Counts how often a publisher has not asserted in time that it is alive."""

    def __init__(self, of: Publisher[Any], **rest: Any) -> None:
        super().__init__(of, **rest)
        self._total = 0
        if of._assertions is not None:
            of._assertions.on_loss.append(self._note)

    def _note(self) -> None:
        self._total += 1
        self._waiting.append(QoSLivelinessLostInfo(self._total, 1))


class _Lost(EventHandler):
    """Counts what the queue of a subscription drops."""

    def __init__(self, of: Subscription, **rest: Any) -> None:
        super().__init__(of, **rest)
        self._of, self._told = of, 0
        of._on_message.append(self._look)

    def _look(self) -> None:
        dropped = self._of.dropped
        if dropped != self._told:
            self._waiting.append(QoSMessageLostInfo(dropped, dropped - self._told))
            self._told = dropped


class _EventCallbacks:
    """What publishers and subscriptions have in common."""

    def __init__(
        self,
        *,
        deadline: Callable[[Any], Any] | None = None,
        liveliness: Callable[[Any], Any] | None = None,
        incompatible_qos: Callable[[Any], Any] | None = None,
        incompatible_type: Callable[[Any], Any] | None = None,
        matched: Callable[[Any], Any] | None = None,
        use_default_callbacks: bool = True,
    ) -> None:
        """Take the callbacks, each of which gets what has happened."""
        self.deadline, self.liveliness, self.matched = deadline, liveliness, matched
        self.incompatible_qos, self.incompatible_type = incompatible_qos, incompatible_type
        self.use_default_callbacks = use_default_callbacks

    def _check(self) -> None:
        for what in ("incompatible_qos", "incompatible_type"):
            if getattr(self, what) is not None:
                raise UnsupportedEventTypeError(
                    f"events of the kind '{what}' are not supported by hprm.ros: the endpoints of"
                    " a topic exchange messages whatever their policies"
                )


class SubscriptionEventCallbacks(_EventCallbacks):
    """Callbacks for events of a subscription."""

    def __init__(
        self, *, message_lost: Callable[[Any], Any] | None = None, **callbacks: Any
    ) -> None:
        """Take the callbacks, each of which gets what has happened."""
        super().__init__(**callbacks)
        self.message_lost = message_lost

    def create_event_handlers(
        self, callback_group: CallbackGroup, subscription: Subscription, topic_name: str
    ) -> list[EventHandler]:
        """Make what calls them back."""
        self._check()
        made: list[EventHandler] = []
        group: Any = {"callback_group": callback_group}
        if self.deadline is not None:
            missed = QoSRequestedDeadlineMissedInfo
            made.append(_Deadline(subscription, missed, callback=self.deadline, **group))
        if self.liveliness is not None:
            made.append(_Liveliness(subscription, callback=self.liveliness, **group))
        if self.message_lost is not None:
            made.append(_Lost(subscription, callback=self.message_lost, **group))
        if self.matched is not None:
            info = QoSSubscriptionMatchedInfo
            made.append(_Matched(subscription, info, "publisher", callback=self.matched, **group))
        return made


class PublisherEventCallbacks(_EventCallbacks):
    """Callbacks for events of a publisher."""

    def create_event_handlers(
        self, callback_group: CallbackGroup, publisher: Publisher[Any], topic_name: str
    ) -> list[EventHandler]:
        """Make what calls them back."""
        self._check()
        made: list[EventHandler] = []
        group: Any = {"callback_group": callback_group}
        if self.deadline is not None:
            missed = QoSOfferedDeadlineMissedInfo
            made.append(_Deadline(publisher, missed, callback=self.deadline, **group))
        if self.liveliness is not None:
            made.append(_LivelinessLost(publisher, callback=self.liveliness, **group))
        if self.matched is not None:
            info = QoSPublisherMatchedInfo
            made.append(_Matched(publisher, info, "subscription", callback=self.matched, **group))
        return made
