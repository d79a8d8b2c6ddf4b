"""What all filters are: sources of messages with callbacks; and subscriptions as such sources."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hprm.ros._log_console import output
from hprm.ros.clock_type import ClockType
from hprm.ros.logging import get_logger
from hprm.ros.time import Time


class SimpleFilter:
    """A source of messages, to which callbacks are connected."""

    def __init__(self) -> None:
        """Begin without callbacks."""
        self.callbacks: dict[int, tuple[Callable[..., Any], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., Any], *args: Any) -> int:
        """Have a function called with each output, and with these arguments behind it.

        Returns the number of the connection.
        """
        connection = len(self.callbacks)
        self.callbacks[connection] = (cb, args)
        return connection

    def signalMessage(self, *msg: Any) -> None:
        """Call all callbacks with an output, in the order in which they were connected."""
        for callback, arguments in list(self.callbacks.values()):
            callback(*msg, *arguments)


class Subscriber(SimpleFilter):
    """A subscription of a node as a filter.

    Parameters
    ----------
    node
        The node that subscribes.
    msg_type
        The class of the messages.
    topic
        The name of the topic.
    qos_profile
        A profile or a depth.
    **kwargs
        Other arguments of ``Node.create_subscription``.

    """

    def __init__(
        self, node: Any, msg_type: Any, topic: str, qos_profile: Any = 10, **kwargs: Any
    ) -> None:
        """Subscribe."""
        super().__init__()
        self.node = node
        self.topic = topic
        self.sub = node.create_subscription(
            msg_type, topic, self.callback, qos_profile=qos_profile, **kwargs
        )

    def callback(self, msg: Any) -> None:
        """Forward a message of the subscription."""
        self.signalMessage(msg)

    def getTopic(self) -> str:
        """Return the name of the topic, as it was given."""
        return self.topic

    def __getattr__(self, key: str) -> Any:
        # A filter serves as the subscription itself; before there is one, there is nothing.
        if key == "sub":
            raise AttributeError(key)
        return getattr(self.sub, key)


def stamp_of(message: Any, allow_headerless: bool, logger: str) -> Time | None:
    """Return the stamp of a message, or the time now if it may be without.

    Otherwise a warning of a logger says so, and there is no stamp.
    """
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        if allow_headerless:
            return arrival()
        get_logger(logger).warning(
            "can not use message filters messages without timestamp infomation when "
            '"allow_headerless" is disabled. auto assign ROSTIME to headerless '
            'messages once enabling constructor option of "allow_headerless".'
        )
        return None
    if isinstance(stamp, Time):
        return stamp
    return Time(seconds=stamp.sec, nanoseconds=stamp.nanosec, clock_type=ClockType.ROS_TIME)


def arrival() -> Time:
    """Return the time now, which is that of messages of the log: in a callback, logical time."""
    return Time(nanoseconds=output.now(), clock_type=ClockType.ROS_TIME)
