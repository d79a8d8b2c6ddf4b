"""Callbacks for events of publishers and subscriptions, as ``rclpy.event_handler``.

Events happen when a deadline is missed, another endpoint is there or is gone, one is there that
does not fit, publishers are alive or no more, and a queue has dropped messages.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hprm.ros._entity import Entity
from hprm.ros._offers import matched, misfits, others
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.exceptions import UnsupportedEventTypeError as UnsupportedEventTypeError
from hprm.ros.qos import _UNSPECIFIED, QoSPolicyKind, qos_policy_name_from_kind

if TYPE_CHECKING:
    from hprm.ros._graph import Endpoint
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
    """How many publishers offer less than is requested, how many of them are new, and what."""

    total_count: int
    total_count_change: int
    last_policy_kind: QoSPolicyKind


#: The same of subscriptions that request more than a publisher offers.
QoSOfferedIncompatibleQoSInfo = QoSRequestedIncompatibleQoSInfo


@dataclass(frozen=True)
class IncompatibleTypeInfo:
    """How many endpoints have another type, and how many of them are new."""

    total_count: int
    total_count_change: int


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


class _OnGraph(EventHandler):
    """Looks at the endpoints at the other end whenever some come or go."""

    def __init__(self, of: Publisher[Any] | Subscription, **rest: Any) -> None:
        super().__init__(of, **rest)
        self._own = self._node._endpoints[of]
        self._node._runtime.on_graph(self._look_if_there)

    def _look_if_there(self) -> None:
        if not self._destroyed:
            self._look()

    def _look(self) -> None:
        raise NotImplementedError

    def destroy(self) -> None:
        """Look no more."""
        super().destroy()
        self._node._runtime.off_graph(self._look_if_there)


class _Matched(_OnGraph):
    """Looks how many endpoints there are that it exchanges messages with."""

    def __init__(
        self, of: Publisher[Any] | Subscription, info: Callable[..., Any], **rest: Any
    ) -> None:
        self._info = info
        self._total = self._current = 0
        super().__init__(of, **rest)

    def _look(self) -> None:
        now = len(matched(self._own, self._node._runtime.endpoints()))
        change = now - self._current
        if change:
            self._total += max(change, 0)
            self._current = now
            self._waiting.append(self._info(self._total, max(change, 0), now, change))


class _Incompatible(_OnGraph):
    """Looks which endpoints there are that it exchanges no messages with."""

    def __init__(self, of: Publisher[Any] | Subscription, **rest: Any) -> None:
        self._total = self._current = 0
        super().__init__(of, **rest)

    def _look(self) -> None:
        found = list(self._find(others(self._own, self._node._runtime.endpoints())))
        change, self._current = len(found) - self._current, len(found)
        if change > 0:
            self._total += change
            # The last one is the newest one.
            self._waiting.append(self._event(change, found[-1]))

    def _find(self, there: list[Endpoint]) -> Iterator[Any]:
        raise NotImplementedError

    def _event(self, change: int, why: Any) -> Any:
        raise NotImplementedError


class _IncompatibleQoS(_Incompatible):
    """Looks for endpoints whose quality of service does not fit."""

    def _find(self, there: list[Endpoint]) -> Iterator[QoSPolicyKind]:
        yield from misfits(self._own, there)

    def _event(self, change: int, why: QoSPolicyKind) -> QoSRequestedIncompatibleQoSInfo:
        return QoSRequestedIncompatibleQoSInfo(self._total, change, why)


class _IncompatibleType(_Incompatible):
    """Looks for endpoints that have another type."""

    def _find(self, there: list[Endpoint]) -> Iterator[str]:
        return (it.type for it in there if it.type != self._own.type)

    def _event(self, change: int, why: str) -> IncompatibleTypeInfo:
        return IncompatibleTypeInfo(self._total, change)


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


class _Liveliness(_OnGraph):
    """Looks how many publishers are alive whose messages a subscription gets."""

    def __init__(self, of: Subscription, **rest: Any) -> None:
        self._alive = self._dead = 0
        super().__init__(of, **rest)

    def _look(self) -> None:
        runtime = self._node._runtime
        dead = len(matched(self._own, runtime.dead()))
        alive = max(len(matched(self._own, runtime.endpoints())) - dead, 0)
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


# As of rclpy, since tools and people look for these words.
_WRONG_QOS = {
    "publisher": "New subscription discovered on topic '{}', requesting incompatible QoS. "
    "No messages will be sent to it. Last incompatible policy: {}",
    "subscription": "New publisher discovered on topic '{}', offering incompatible QoS. "
    "No messages will be received from it. Last incompatible policy: {}",
}
_WRONG_TYPE = "Incompatible type on topic '{}', no messages will be sent to it."


def _warning(own: Endpoint, policy: QoSPolicyKind) -> str:
    return _WRONG_QOS[own.kind].format(own.name, qos_policy_name_from_kind(policy))


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

    def _of_incompatible(
        self, of: Publisher[Any] | Subscription, group: CallbackGroup
    ) -> list[EventHandler]:
        """Make what tells of endpoints that get nothing: by a warning, if that is not stated."""
        qos, type_ = self.incompatible_qos, self.incompatible_type
        if self.use_default_callbacks:
            logger, topic, own = of._node.get_logger(), of.topic, of._node._endpoints[of]
            qos = qos or (lambda event: logger.warning(_warning(own, event.last_policy_kind)))
            type_ = type_ or (lambda _: logger.warning(_WRONG_TYPE.format(topic)))
        made: list[EventHandler] = []
        if qos is not None:
            made.append(_IncompatibleQoS(of, callback=qos, callback_group=group))
        if type_ is not None:
            made.append(_IncompatibleType(of, callback=type_, callback_group=group))
        return made


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
        made = self._of_incompatible(subscription, callback_group)
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
            made.append(_Matched(subscription, info, callback=self.matched, **group))
        return made


class PublisherEventCallbacks(_EventCallbacks):
    """Callbacks for events of a publisher."""

    def create_event_handlers(
        self, callback_group: CallbackGroup, publisher: Publisher[Any], topic_name: str
    ) -> list[EventHandler]:
        """Make what calls them back."""
        made = self._of_incompatible(publisher, callback_group)
        group: Any = {"callback_group": callback_group}
        if self.deadline is not None:
            missed = QoSOfferedDeadlineMissedInfo
            made.append(_Deadline(publisher, missed, callback=self.deadline, **group))
        if self.liveliness is not None:
            made.append(_LivelinessLost(publisher, callback=self.liveliness, **group))
        if self.matched is not None:
            info = QoSPublisherMatchedInfo
            made.append(_Matched(publisher, info, callback=self.matched, **group))
        return made
