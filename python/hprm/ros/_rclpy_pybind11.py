"""What programs import from rclpy's extension module, exceptions mostly, and nothing else of it."""

from hprm.ros.exceptions import InvalidHandle as InvalidHandle
from hprm.ros.exceptions import NodeNameNonExistentError as NodeNameNonExistentError
from hprm.ros.exceptions import RCLError as RCLError
from hprm.ros.exceptions import RCLInvalidROSArgsError as RCLInvalidROSArgsError
from hprm.ros.exceptions import UnknownROSArgsError as UnknownROSArgsError
from hprm.ros.exceptions import UnsupportedEventTypeError as UnsupportedEventTypeError
from hprm.ros.signals import SignalHandlerOptions as SignalHandlerOptions
from hprm.ros.utilities import (
    get_rmw_implementation_identifier as rclpy_get_rmw_implementation_identifier,
)

__all__ = [
    "InvalidHandle",
    "NodeNameNonExistentError",
    "RCLError",
    "RCLInvalidROSArgsError",
    "SignalHandlerOptions",
    "UnknownROSArgsError",
    "UnsupportedEventTypeError",
    "rclpy_get_rmw_implementation_identifier",
]
