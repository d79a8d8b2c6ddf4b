"""Checks of topics' names as programs write them, as in ``rclpy.validate_topic_name``."""

from typing import Literal

from hprm.ros._names import topic_error
from hprm.ros.exceptions import InvalidServiceNameException, InvalidTopicNameException

TOPIC_SEPARATOR_STRING = "/"


def validate_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return ``True`` for a valid name, which may be relative and have substitutions.

    Raises ``InvalidTopicNameException``, or ``InvalidServiceNameException`` for a service.
    """
    wrong = topic_error(name)
    if wrong is None:
        return True
    raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *wrong)
