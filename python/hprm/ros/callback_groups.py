"""Callback groups, as ``rclpy.callback_groups``: which callbacks may be open at the same time.

Callbacks run one at a time. Several are *open* if one of them is blocked, in a call to a service
for example, while others run: executors with several threads allow that, between groups.
"""

from __future__ import annotations

from typing import Any


class CallbackGroup:
    """Some entities of nodes."""

    def __init__(self) -> None:
        """Make a group without entities."""
        self.entities: set[Any] = set()
        self._open: list[Any] = []

    def add_entity(self, entity: Any) -> None:
        """Add a timer, a subscription, a service, a client or the like."""
        self.entities.add(entity)

    def has_entity(self, entity: Any) -> bool:
        """Return whether it was added."""
        return entity in self.entities

    def can_execute(self, entity: Any) -> bool:
        """Return whether a callback of ``entity`` may begin."""
        raise NotImplementedError

    def beginning_execution(self, entity: Any) -> bool:
        """Begin a callback of ``entity`` if it may begin; return that."""
        if not self.can_execute(entity):
            return False
        self._open.append(entity)
        return True

    def ending_execution(self, entity: Any) -> None:
        """End a callback that has begun."""
        self._open.remove(entity)


class ReentrantCallbackGroup(CallbackGroup):
    """All callbacks may be open at the same time."""

    def can_execute(self, entity: Any) -> bool:
        """Return that it may begin."""
        return True


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """One callback may be open."""

    def can_execute(self, entity: Any) -> bool:
        """Return whether none is open."""
        return not self._open
