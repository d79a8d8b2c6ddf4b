"""Classes of interfaces by name, as ``rosidl_runtime_py.utilities`` finds them."""

from __future__ import annotations

from typing import Any

from hprm.ros._messages import class_of

__all__ = ["get_action", "get_interface", "get_message", "get_service"]


def get_interface(identifier: str) -> Any:
    """Return the class of ``package/kind/Name``.

    Raises ``ValueError`` for another form, ``ModuleNotFoundError`` for a package and
    ``AttributeError`` for a name that is not there.
    """
    parts = identifier.split("/")
    if len(parts) != 3 or not all(parts):
        raise ValueError(f"Expected the full name of an interface, got {identifier!r}")
    try:
        return class_of(identifier)
    except LookupError as error:
        kind = ModuleNotFoundError if "there is no package" in error.args[0] else AttributeError
        raise kind(error.args[0]) from None


def get_message(identifier: str) -> Any:
    """Return the class of a message, as of ``std_msgs/msg/String``."""
    return _of_kind(identifier, "msg")


def get_service(identifier: str) -> Any:
    """Return the class of a service, as of ``std_srvs/srv/Trigger``."""
    return _of_kind(identifier, "srv")


def get_action(identifier: str) -> Any:
    """Return the class of an action, as of ``example_interfaces/action/Fibonacci``."""
    return _of_kind(identifier, "action")


def _of_kind(identifier: str, kind: str) -> Any:
    if identifier.split("/")[1:2] != [kind]:
        raise ValueError(f"Expected the name of a {kind}, as package/{kind}/Name: {identifier!r}")
    return get_interface(identifier)
