"""Guard conditions, as ``rclpy.guard_condition``: callbacks that any thread may ask for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm.ros._entity import Entity
from hprm.ros.callback_groups import CallbackGroup

if TYPE_CHECKING:
    from hprm.ros.node import Node


class GuardCondition(Entity):
    """Calls back once after it was triggered, however often."""

    order = 2

    def __init__(
        self, node: Node, callback: Callable[[], Any] | None, callback_group: CallbackGroup
    ) -> None:
        """Make the guard condition of a node."""
        super().__init__(node, callback_group)
        self.callback = callback
        self._triggered = False

    def trigger(self) -> None:
        """Have the callback called."""
        self._triggered = True
        self._node._runtime.wake()

    def has_work(self) -> bool:
        """Return whether it was triggered."""
        return self._triggered and not self._destroyed

    def take(self) -> Callable[[], Any]:
        """Take that."""
        self._triggered = False
        return self.callback if self.callback is not None else lambda: None
