"""Topics on which nodes tell of themselves: their log, parameters and transitions.

Nothing is made, and no tag is needed for it, where no subscription takes such a topic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm.ros._graph import Flow
from hprm.ros._offers import Offer

if TYPE_CHECKING:
    from hprm.ros.node import Node
    from hprm.ros.qos import QoSProfile


class Telling:
    """One topic of a node."""

    def __init__(self, node: Node, type_name: str, topic: str, qos: QoSProfile) -> None:
        """Declare the publisher; ``topic`` is the full name."""
        self._runtime = node._runtime
        self._flow = Flow("topic", topic)
        endpoint = node._endpoint("publisher", topic, type_name, qos)
        self._offer = Offer(endpoint)
        self._runtime.declare(endpoint)

    def tell(self, make: Callable[[], Any]) -> None:
        """Publish what ``make`` returns; before the start, that is left until then."""
        self._runtime.tell(self._flow, lambda: self._offer.beside(make()))

    def is_taken(self) -> bool:
        """Return whether there is a subscription, as far as that is known."""
        return self._runtime.is_taken(self._flow)

    @property
    def has_begun(self) -> bool:
        """Whether the federation has begun, so that all its subscriptions are known."""
        return self._runtime.has_begun

    def at_start(self, action: Callable[[], None]) -> None:
        """Call ``action`` at the start of the federation."""
        self._runtime.request(action)
