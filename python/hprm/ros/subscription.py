"""Subscriptions, as ``rclpy.subscription``."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any, TypedDict

from hprm.ros._entity import Entity, Queue
from hprm.ros._graph import Endpoint, Flow
from hprm.ros._interface import check_callback, copy_of, takes
from hprm.ros._offers import Request
from hprm.ros.callback_groups import CallbackGroup

if TYPE_CHECKING:
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile


class MessageInfo(TypedDict):
    """What is known of a message: the second argument of a callback that takes two."""

    source_timestamp: int
    received_timestamp: int
    publication_sequence_number: int | None
    reception_sequence_number: int | None


class Subscription(Entity):
    """Calls back with each message of a topic."""

    order = 1

    class CallbackType(Enum):
        """What a callback takes."""

        MessageOnly = 0
        WithMessageInfo = 1

    def __init__(
        self,
        node: Node,
        msg_type: type[Any],
        endpoint: Endpoint,
        callback: Callable[..., Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
        raw: bool = False,
    ) -> None:
        """Make the subscription of a node that is the endpoint of a topic."""
        super().__init__(node, callback_group)
        self.msg_type = msg_type
        self.topic = endpoint.name
        self.topic_name = endpoint.name
        self.qos_profile = qos_profile
        self.raw = raw
        self._flow = Flow("topic", endpoint.name)
        self._request = Request(endpoint, msg_type)
        self.callback = callback
        self._queue = Queue(node._depth_of(qos_profile))
        #: Whether other processes may still have messages that come first.
        self._is_held = False
        self.event_handlers: list[Any] = []
        #: What is called with each message.
        self._on_message: list[Callable[[], None]] = []
        #: What this node takes first if both have come at one tag.
        self._after: Entity | None = None

    @property
    def callback(self) -> Callable[..., Any]:
        """What is called with each message."""
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any]) -> None:
        check_callback(value)
        self._callback = value
        if takes(value, 1):
            self._callback_type = Subscription.CallbackType.MessageOnly
        elif takes(value, 2):
            self._callback_type = Subscription.CallbackType.WithMessageInfo
        else:
            raise RuntimeError(
                f"the callback of the topic {self.topic} takes neither one argument (the message)"
                " nor two (the message and a dictionary of what is known of it)"
            )

    def get_publisher_count(self) -> int:
        """Return how many publishers there are whose messages it gets."""
        return len(self._node._matched(self))

    @property
    def dropped(self) -> int:
        """How many messages the queue has dropped, because no thread was spinning in time."""
        return self._queue.dropped

    def deliver(self, sent: Any) -> None:
        """Put a message that is for it in the queue; all subscriptions here get the same one."""
        message = self._request.message_of(sent)
        if message is not None and not self._destroyed:
            self._queue.put((message, self._node._runtime.now()))
            for note in self._on_message:
                note()

    def deliver_before(self, sent: list[Any]) -> None:
        """Put messages into the queue that publishers have kept, before those that wait."""
        now = self._node._runtime.now()
        messages = map(self._request.message_of, sent)
        self._queue.put_before([(message, now) for message in messages if message is not None])

    def hold(self, is_held: bool) -> None:
        """Call back no more until what comes first is there, or again."""
        self._is_held = is_held

    @property
    def is_destroyed(self) -> bool:
        """Whether it takes nothing any more."""
        return self._destroyed

    def has_work(self) -> bool:
        """Return whether a message waits."""
        if not len(self._queue) or self._destroyed or self._is_held:
            return False
        return self._after is None or not self._after.has_work()

    def take(self) -> Callable[[], Any]:
        """Take the oldest message."""
        _, received = self._queue.first()
        message = self._taken()
        if self._callback_type is Subscription.CallbackType.MessageOnly:
            return _call(self._callback, message)
        info: MessageInfo = {
            "source_timestamp": received,
            "received_timestamp": received,
            "publication_sequence_number": None,
            "reception_sequence_number": None,
        }
        return _call(self._callback, message, info)

    def _taken(self) -> Any:
        """Take the oldest message as the callback gets it."""
        message = copy_of(self._queue.take()[0])
        if self.raw:
            from hprm.ros.serialization import serialize_message

            message = serialize_message(message)
        return message

    def destroy(self) -> None:
        """Take no more messages."""
        super().destroy()
        self._node._runtime.withdraw(self._flow, self.deliver)
        for handler in self.event_handlers:
            self._node._destroy(handler)


def _call(callback: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    if inspect.iscoroutinefunction(callback):

        async def awaits() -> Any:
            return await callback(*arguments)

        return awaits
    return lambda: callback(*arguments)
