"""Checks of parameters' names, as in ``rclpy.validate_parameter_name``."""

from typing import Literal

from hprm.ros.exceptions import InvalidParameterException


def validate_parameter_name(name: str) -> Literal[True]:
    """Return ``True`` for a valid name; raise ``InvalidParameterException`` for an empty one."""
    if not name:
        raise InvalidParameterException(name)
    return True
