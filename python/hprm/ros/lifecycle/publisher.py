"""Publishers that publish while they are activated, as ``rclpy.lifecycle.publisher``."""

from __future__ import annotations

from typing import Any, TypeVar

from hprm.ros.lifecycle.managed_entity import SimpleManagedEntity
from hprm.ros.publisher import Publisher

MsgT = TypeVar("MsgT")


class LifecyclePublisher(SimpleManagedEntity, Publisher[MsgT]):
    """A publisher that follows the lifecycle of its node."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Make a publisher that is deactivated."""
        SimpleManagedEntity.__init__(self)
        Publisher.__init__(self, *args, **kwargs)

    @SimpleManagedEntity.when_enabled
    def publish(self, msg: MsgT | bytes) -> None:
        """Send a message if the publisher is activated; otherwise do nothing."""
        Publisher.publish(self, msg)
