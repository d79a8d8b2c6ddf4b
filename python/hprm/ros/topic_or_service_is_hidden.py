"""Hidden topics and services, as in ``rclpy.topic_or_service_is_hidden``."""

from hprm.ros._names import is_hidden

HIDDEN_TOPIC_PREFIX = "_"


def topic_or_service_is_hidden(name: str) -> bool:
    """Return whether a part of a name begins with an underscore."""
    return is_hidden(name)
