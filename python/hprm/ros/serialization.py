"""Messages as bytes and back: what ``rclpy.serialization`` has."""

from __future__ import annotations

from typing import Any

from hprm.ros._messages.cdr import SERIALIZER, SerializationError

__all__ = ["SerializationError", "deserialize_message", "serialize_message"]


def serialize_message(message: Any) -> bytes:
    """Return a message as bytes in CDR, as ROS 2 sends it."""
    return SERIALIZER.serialize(message)


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    """Make a message of bytes in CDR.

    Raises ``SerializationError`` if they are no message of this type.
    """
    return SERIALIZER.deserialize(serialized_message, message_type)
