"""Checks of namespaces, as in ``rclpy.validate_namespace``."""

from typing import Literal

from hprm.ros._names import namespace_error
from hprm.ros.exceptions import InvalidNamespaceException


def validate_namespace(namespace: str) -> Literal[True]:
    """Return ``True`` for a valid namespace, which is absolute and not empty.

    Raises ``InvalidNamespaceException`` for any other.
    """
    wrong = namespace_error(namespace)
    if wrong is None:
        return True
    raise InvalidNamespaceException(namespace, *wrong)
