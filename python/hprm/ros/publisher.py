"""Publishers, as ``rclpy.publisher``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from hprm.ros._entity import Destroyable
from hprm.ros._graph import Endpoint, Flow
from hprm.ros._interface import copy_of
from hprm.ros._keeping import Kept
from hprm.ros._offers import Offer, keeps
from hprm.ros.exceptions import InvalidHandle

if TYPE_CHECKING:
    from hprm.ros._liveliness import Assertions
    from hprm.ros.duration import Duration
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile

MsgT = TypeVar("MsgT")


class Publisher(Destroyable, Generic[MsgT]):
    """Sends messages to all subscriptions of a topic."""

    def __init__(
        self, node: Node, msg_type: type[MsgT], endpoint: Endpoint, qos_profile: QoSProfile
    ) -> None:
        """Make the publisher of a node that is the endpoint of a topic."""
        self._node = node
        self._flow = Flow("topic", endpoint.name)
        self._offer = Offer(endpoint)
        self.msg_type = msg_type
        self.topic = endpoint.name
        self.qos_profile = qos_profile
        self._destroyed = False
        #: What it has asserted of its liveliness, if its policy asks for that.
        self._assertions: Assertions | None = None
        #: What later subscriptions get of it.
        self._kept: Kept | None = None
        if keeps(qos_profile):
            lifespan = qos_profile.lifespan.nanoseconds
            self._kept = Kept(node._depth_of(qos_profile), lifespan or None)
            node._runtime.keeping.keep(self._flow, self._kept)
        self.event_handlers: list[Any] = []
        #: What is called with each message.
        self._on_message: list[Callable[[], None]] = []

    def publish(self, msg: MsgT | bytes) -> None:
        """Send a message: the callback that publishes it may change it afterwards.

        Raises
        ------
        TypeError
            If it is no message of the type of this publisher.

        """
        if self._destroyed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")
        if isinstance(msg, bytes):
            from hprm.ros.serialization import deserialize_message

            msg = deserialize_message(msg, self.msg_type)
        if not isinstance(msg, self.msg_type):
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        self._node._runtime.publish(self._flow, self._offer.beside(copy_of(msg)), self._kept)
        for note in self._on_message:
            note()

    def get_subscription_count(self) -> int:
        """Return how many subscriptions get what it publishes."""
        return len(self._node._matched(self))

    @property
    def topic_name(self) -> str:
        """The full name of the topic."""
        return self.topic

    def assert_liveliness(self) -> None:
        """Assert that it is alive, if its policy is ``MANUAL_BY_TOPIC``: others are while there."""
        if self._assertions is not None:
            self._assertions.note()

    def wait_for_all_acked(self, timeout: Duration | None = None) -> bool:
        """Return at once: what was published is in order on its way."""
        return True

    def destroy(self) -> None:
        """Publish no more."""
        self._destroyed = True
        if self._kept is not None:
            self._node._runtime.keeping.forget(self._flow, self._kept)
        self._node._withdraw(self)
        for handler in self.event_handlers:
            self._node._destroy(handler)
