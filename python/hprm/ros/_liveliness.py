"""Whether publishers are alive: those that are there, or that assert it in time.

A publisher with the policy ``MANUAL_BY_TOPIC`` and a lease is alive as long as it publishes, or
asserts that it is alive, within its lease, by logical time. Its own process looks after that, and
tells others of changes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm.ros._graph import Endpoint
from hprm.ros.qos import _UNSPECIFIED, LivelinessPolicy

if TYPE_CHECKING:
    from hprm.ros.publisher import Publisher


class Assertions:
    """What a publisher has asserted, and until when it is alive by that."""

    def __init__(self, publisher: Publisher[Any], endpoint: Endpoint, lease_ns: int) -> None:
        """Begin with the first assertion."""
        self._publisher, self._endpoint, self._lease_ns = publisher, endpoint, lease_ns
        self._last = 0
        self._is_waiting = self._is_lost = False
        #: What is called when an assertion has not come in time.
        self.on_loss: list[Callable[[], None]] = []

    @classmethod
    def of(cls, publisher: Publisher[Any], endpoint: Endpoint) -> Assertions | None:
        """Look after a publisher, if its policy asks for that."""
        qos = publisher.qos_profile
        lease = qos.liveliness_lease_duration
        if qos.liveliness is not LivelinessPolicy.MANUAL_BY_TOPIC or lease == _UNSPECIFIED:
            return None
        made = cls(publisher, endpoint, lease.nanoseconds)
        publisher._on_message.append(made.note)
        return made

    def note(self) -> None:
        """Note an assertion, which each message is."""
        runtime = self._publisher._node._runtime
        self._last = runtime.now()
        if self._is_lost:
            self._is_lost = False
            runtime.tell_alive(self._endpoint, True)
        if not self._is_waiting:
            self._is_waiting = True
            runtime.call_at(self._lease_ns, self._look)

    def _look(self) -> None:
        if self._publisher._destroyed:
            return
        runtime = self._publisher._node._runtime
        left = self._last + self._lease_ns - runtime.now()
        if left > 0:
            runtime.call_at(left, self._look)
            return
        self._is_waiting, self._is_lost = False, True
        runtime.tell_alive(self._endpoint, False)
        for tell in self.on_loss:
            tell()
