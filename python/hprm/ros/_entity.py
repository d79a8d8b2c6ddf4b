"""What a node consists of: timers, subscriptions, services, clients and guard conditions."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

from hprm.ros.callback_groups import CallbackGroup

if TYPE_CHECKING:
    from hprm.ros.node import Node

D = TypeVar("D", bound="Destroyable")


class Destroyable:
    """Something that is destroyed where a ``with`` statement ends."""

    def destroy(self) -> None:
        """Destroy it; again is no error."""
        raise NotImplementedError

    def __enter__(self: D) -> D:
        """Return it."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Destroy it."""
        self.destroy()


class Entity(Destroyable):
    """Something of a node with callbacks, and what waits for them."""

    #: In which order the kinds of entities of a node are looked at.
    order = 0
    #: Whether its callback is known to be no coroutine, so that it is called as it is.
    is_plain = False

    def __init__(self, node: Node, callback_group: CallbackGroup) -> None:
        """Make an entity of a node."""
        self._node = node
        self.callback_group = callback_group
        callback_group.add_entity(self)
        self._destroyed = False

    def has_work(self) -> bool:
        """Return whether a callback is due."""
        return False

    def take(self) -> Callable[[], Any]:
        """Take what is due, and return what runs the callback for it."""
        raise NotImplementedError

    def destroy(self) -> None:
        """Have no callbacks any more, and count as gone; again is no error."""
        self._destroyed = True
        self._node._withdraw(self)


class Queue:
    """Messages that wait, as many as the quality of service says; the oldest one is dropped."""

    def __init__(self, depth: int | None) -> None:
        """Keep ``depth`` messages, or all."""
        self._depth = depth
        self._messages: deque[Any] = deque()
        #: How many were dropped.
        self.dropped = 0

    def put(self, message: Any) -> None:
        """Add a message."""
        if self._depth is not None and len(self._messages) >= self._depth:
            self._messages.popleft()
            self.dropped += 1
        self._messages.append(message)

    def put_before(self, messages: list[Any]) -> None:
        """Add messages that are older than those that wait, as many as there is room for."""
        room = len(messages) if self._depth is None else self._depth - len(self._messages)
        if room > 0:
            self._messages.extendleft(reversed(messages[-room:]))

    def first(self) -> Any:
        """Return the oldest message."""
        return self._messages[0]

    def take(self) -> Any:
        """Remove and return the oldest message."""
        return self._messages.popleft()

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._messages)
