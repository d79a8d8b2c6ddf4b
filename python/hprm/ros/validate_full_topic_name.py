"""Checks of topics' full names, as in ``rclpy.validate_full_topic_name``."""

from typing import Literal

from hprm.ros._names import full_topic_error
from hprm.ros.exceptions import InvalidServiceNameException, InvalidTopicNameException


def validate_full_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return ``True`` for a valid name, which is absolute and has no substitutions.

    Raises ``InvalidTopicNameException``, or ``InvalidServiceNameException`` for a service.
    """
    wrong = full_topic_error(name)
    if wrong is None:
        return True
    raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *wrong)
