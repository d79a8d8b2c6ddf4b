"""Transforms between frames over time, as in the package ``tf2_ros`` for Python."""

from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros._tf2_ros._core import BufferCore as BufferCore
from hprm.ros._tf2_ros._errors import ConnectivityException as ConnectivityException
from hprm.ros._tf2_ros._errors import ExtrapolationException as ExtrapolationException
from hprm.ros._tf2_ros._errors import InvalidArgumentException as InvalidArgumentException
from hprm.ros._tf2_ros._errors import LookupException as LookupException
from hprm.ros._tf2_ros._errors import TimeoutException as TimeoutException
from hprm.ros._tf2_ros._errors import TransformException as TransformException
from hprm.ros._tf2_ros.buffer import Buffer as Buffer
from hprm.ros._tf2_ros.buffer_interface import BufferInterface as BufferInterface
from hprm.ros._tf2_ros.buffer_interface import ConvertRegistration as ConvertRegistration
from hprm.ros._tf2_ros.buffer_interface import NotImplementedException as NotImplementedException
from hprm.ros._tf2_ros.buffer_interface import Stamped as Stamped
from hprm.ros._tf2_ros.buffer_interface import TransformRegistration as TransformRegistration
from hprm.ros._tf2_ros.buffer_interface import TypeException as TypeException
from hprm.ros._tf2_ros.buffer_interface import convert as convert
from hprm.ros._tf2_ros.static_transform_broadcaster import (
    StaticTransformBroadcaster as StaticTransformBroadcaster,
)
from hprm.ros._tf2_ros.transform_broadcaster import TransformBroadcaster as TransformBroadcaster
from hprm.ros._tf2_ros.transform_listener import TransformListener as TransformListener

# Messages that programs import from tf2_ros, because it uses them itself.
_MESSAGES = {
    "FrameGraph": "tf2_msgs.srv",
    "TFMessage": "tf2_msgs.msg",
    "TransformStamped": "geometry_msgs.msg",
}


def __getattr__(name: str) -> Any:
    """Return messages; say of what this package does not have what serves instead."""
    if name in _MESSAGES:
        return interface(_MESSAGES[name], name)
    if name == "BufferClient":
        raise ImportError(
            "tf2_ros.BufferClient is not there: a Buffer with a TransformListener does the same "
            "without a server"
        )
    raise AttributeError(f"module 'tf2_ros' has no attribute {name!r}")
