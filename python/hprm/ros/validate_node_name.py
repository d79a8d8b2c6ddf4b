"""Checks of nodes' names, as in ``rclpy.validate_node_name``."""

from typing import Literal

from hprm.ros._names import node_name_error
from hprm.ros.exceptions import InvalidNodeNameException


def validate_node_name(node_name: str) -> Literal[True]:
    """Return ``True`` for a valid name; raise ``InvalidNodeNameException`` for any other."""
    wrong = node_name_error(node_name)
    if wrong is None:
        return True
    raise InvalidNodeNameException(node_name, *wrong)
